// Triangle elements on torn and cut meshes.

#include "clothctl/network/detail/element_transfer.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <random>

#include "clothctl/mesh/surface_cut.hpp"
#include "clothctl/network/network_change.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/triangle_elements.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Network = SpringNetwork<double>;

Network elastic_sheet(int rows, int cols) {
  const Network plain =
      sheet_network<double>(make_grid<double>(rows, cols, 0.5, 0.4).value(), Material<double>())
          .value();
  Network made =
      add_triangle_elements<double>(plain, Vector3<double>(1, 0.2, 0), {1, 2, 3, 4}).value();
  for (std::size_t e = 0; e < made.elements.size(); ++e) {
    made.elements[e].warp += 0.1 * double(e);
    auto& v = made.elements[e].vertex;  // some start at another corner
    if (e % 3 != 1) continue;
    const DenseMatrix<double, 2, 2> rest = made.elements[e].rest_inverse.inverse();
    DenseMatrix<double, 2, 2> turned;
    turned << rest.col(1) - rest.col(0), -rest.col(0);
    v = {v[1], v[2], v[0]};
    REQUIRE(made.elements[e].set_rest(turned));
  }
  return made;
}

// Sum over the elements of warp stiffness times area.
double weighted_area(const Network& network) {
  double sum = 0;
  for (const auto& e : network.elements) sum += e.warp * e.rest_area();
  return sum;
}

// Every element lies on a triangle, and its edges have the lengths of the rest shape.
void check_elements(const Network& network) {
  std::map<std::array<int, 3>, int> count;
  const auto sorted = [](std::array<int, 3> v) {
    std::sort(v.begin(), v.end());
    return v;
  };
  for (const auto& t : network.triangles) ++count[sorted(t)];
  REQUIRE(network.elements.size() == network.triangles.size());
  for (const auto& e : network.elements) {
    CHECK(--count[sorted(e.vertex)] == 0);
    const DenseMatrix<double, 2, 2> rest = e.rest_inverse.inverse();
    const Vector3<double> a =
        network.rest_positions.col(e.vertex[1]) - network.rest_positions.col(e.vertex[0]);
    const Vector3<double> b =
        network.rest_positions.col(e.vertex[2]) - network.rest_positions.col(e.vertex[0]);
    CHECK(rest.col(0).norm() == Approx(a.norm()));
    CHECK(rest.col(1).norm() == Approx(b.norm()));
    CHECK(rest.col(0).dot(rest.col(1)) == Approx(a.dot(b)).margin(1e-9));
  }
}

}  // namespace

TEST_CASE("elements follow a torn edge and keep their numbers", "[network]") {
  const Network network = elastic_sheet(4, 5);
  check_elements(network);
  auto editor = MeshEditor<double>::create(network.rest_positions, network.triangles).value();
  REQUIRE(editor.mark(1, 6));
  REQUIRE(editor.mark(6, 11));
  REQUIRE(editor.open_marked() == 2);
  const auto torn = change_network(network, editor.change()).value();
  check_elements(torn.network);
  for (std::size_t e = 0; e < network.elements.size(); ++e) {
    const auto &a = network.elements[e], &b = torn.network.elements[e];
    CHECK(a.rest_inverse == b.rest_inverse);
    CHECK(a.warp == b.warp);
    for (std::size_t j = 0; j < 3; ++j)
      CHECK(torn.remap.origin(b.vertex[j])[0].vertex == a.vertex[j]);
  }
}

TEST_CASE("elements of a divided triangle share its rest shape", "[network]") {
  const Network network = elastic_sheet(6, 6);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> part(0.0, 1.0);
  const Vector3<double> low = network.rest_positions.rowwise().minCoeff();
  const Vector3<double> size = network.rest_positions.rowwise().maxCoeff() - low;
  int divided = 0;
  for (int trial = 0; trial < 20; ++trial) {
    auto editor = MeshEditor<double>::create(network.rest_positions, network.triangles).value();
    Points<double> line(3, 3);
    for (Index k = 0; k < 9; ++k)
      line(k % 3, k / 3) = low[k % 3] + size[k % 3] * (0.1 + 0.8 * part(random));
    if (!mark_cut<double>(editor, line).has_value()) continue;
    editor.open_marked();
    const auto made = change_network(network, editor.change());
    INFO((made ? std::string() : made.error()));
    REQUIRE(made);
    check_elements(made->network);
    CHECK(weighted_area(made->network) == Approx(weighted_area(network)).epsilon(1e-9));
    if (made->network.elements.size() > network.elements.size()) ++divided;
  }
  CHECK(divided > 5);
}

TEST_CASE("an element on no triangle stays with the first copies", "[network]") {
  Network network = elastic_sheet(4, 5);
  network.elements.resize(1);
  network.elements[0].vertex = {0, 4, 15};
  auto editor = MeshEditor<double>::create(network.rest_positions, network.triangles).value();
  REQUIRE(editor.mark(1, 6));
  REQUIRE(editor.open_marked() == 1);
  const auto moved = detail::move_elements(network, editor.change());
  REQUIRE(moved.size() == 1);
  CHECK(moved[0].vertex == network.elements[0].vertex);
  CHECK(moved[0].rest_inverse == network.elements[0].rest_inverse);
}
