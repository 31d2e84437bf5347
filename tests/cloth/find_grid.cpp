#include "clothctl/cloth/detail/find_grid.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <set>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;

namespace {

template <class Scalar = double>
SpringNetwork<Scalar> sheet(int rows, int cols, double width = 0.4, double height = 0.6) {
  const GridMesh<Scalar> mesh =
      make_grid<Scalar>(rows, cols, Scalar(width), Scalar(height)).value();
  return sheet_network<Scalar>(mesh, Material<Scalar>()).value();
}

/// Puts springs and stencils, and the ends of springs, into another order.
void shuffle(SpringNetwork<double>& network, unsigned seed) {
  Numbers random(seed);
  random.shuffle(network.springs);
  random.shuffle(network.bends);
  for (Spring<double>& spring : network.springs) {
    if (random.below(2) == 0) std::swap(spring.a, spring.b);
  }
  for (BendStencil<double>& bend : network.bends) {
    if (random.below(2) == 0) std::swap(bend.vertex[0], bend.vertex[2]);
  }
}

/// Checks that every spring and stencil is where its vertices are.
void check_places(const SpringNetwork<double>& network, const GridShape& grid) {
  REQUIRE(grid.springs.size() == network.springs.size());
  REQUIRE(grid.bends.size() == network.bends.size());
  std::set<std::array<std::size_t, 3>> taken;
  bool good = true;
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const GridSlot& slot = grid.springs[e];
    const auto r = slot.row, c = slot.col;
    const std::array<std::array<std::array<int, 2>, 2>, 4> ends{{{{{r, c}, {r, c + 1}}},
                                                                 {{{r, c}, {r + 1, c}}},
                                                                 {{{r, c}, {r + 1, c + 1}}},
                                                                 {{{r, c + 1}, {r + 1, c}}}}};
    const auto a = grid.place(network.springs[e].a), b = grid.place(network.springs[e].b);
    const auto& pair = ends[slot.kind];
    good = good && ((a == pair[0] && b == pair[1]) || (a == pair[1] && b == pair[0]));
    good = taken.insert({slot.kind, std::size_t(r), std::size_t(c)}).second && good;
  }
  for (std::size_t e = 0; e < network.bends.size(); ++e) {
    const GridSlot& slot = grid.bends[e];
    std::array<int, 2> step{slot.kind == 1 ? 1 : 0, slot.kind == 0 ? 1 : 0};
    const auto& v = network.bends[e].vertex;
    const auto first = grid.place(v[0]), middle = grid.place(v[1]), last = grid.place(v[2]);
    const std::array<int, 2> upper{slot.row, slot.col};
    const std::array<int, 2> below{slot.row + 2 * step[0], slot.col + 2 * step[1]};
    good = good && middle == std::array<int, 2>{slot.row + step[0], slot.col + step[1]};
    good = good && ((first == upper && last == below) || (first == below && last == upper));
    good =
        taken.insert({4 + slot.kind, std::size_t(slot.row), std::size_t(slot.col)}).second && good;
  }
  CHECK(good);
}

}  // namespace

TEST_CASE("find grid: sheets of any size are found, in any order of their springs", "[find_grid]") {
  for (const auto& [rows, cols] : std::vector<std::array<int, 2>>{
           {8, 8}, {8, 9}, {9, 8}, {33, 33}, {24, 17}, {17, 24}, {12, 40}, {40, 12}, {16, 8}}) {
    for (unsigned seed = 0; seed < 3; ++seed) {
      SpringNetwork<double> network = sheet(rows, cols);
      if (seed > 0) shuffle(network, seed);
      const auto grid = find_grid(network);
      REQUIRE(grid.has_value());
      // The lanes divide the longer side.
      CHECK(grid->rows == std::max(rows, cols));
      CHECK(grid->cols == std::min(rows, cols));
      CHECK(grid->transposed == (cols > rows));
      std::set<std::array<int, 2>> places;
      for (int v = 0; v < rows * cols; ++v) {
        const auto place = grid->place(v);
        CHECK((place[0] >= 0 && place[0] < grid->rows && place[1] >= 0 && place[1] < grid->cols));
        places.insert(place);
      }
      CHECK(places.size() == static_cast<std::size_t>(rows * cols));
      check_places(network, *grid);
      CHECK(is_regular(network, *grid));
    }
  }
}

TEST_CASE("find grid: springs and stencils may be missing", "[find_grid]") {
  SpringNetwork<double> network = sheet(20, 11);
  shuffle(network, 4);
  network.springs.resize(network.springs.size() - 30);
  network.bends.resize(network.bends.size() / 2);
  const auto grid = find_grid(network);
  REQUIRE(grid.has_value());
  CHECK(grid->rows == 20);
  check_places(network, *grid);
  CHECK_FALSE(is_regular(network, *grid));  // not whole
  // No diagonals and no stencils at all.
  SpringNetwork<double> net = sheet(10, 12);
  net.bends.clear();
  std::erase_if(net.springs, [](const Spring<double>& s) { return s.kind == SpringKind::Shear; });
  const auto threads = find_grid(net);
  REQUIRE(threads.has_value());
  CHECK(is_regular(net, *threads));
}

TEST_CASE("find grid: what does not belong to a grid makes a network no grid", "[find_grid]") {
  const SpringNetwork<double> good = sheet(12, 10);
  REQUIRE(find_grid(good).has_value());
  SpringNetwork<double> changed = good;
  SECTION("a chord across the sheet") {
    changed.springs.push_back({0, 119, 0.7, 10, 0, SpringKind::Structural});
  }
  SECTION("a spring over two edges") {
    changed.springs.push_back({0, 2, 0.1, 10, 0, SpringKind::Structural});
  }
  SECTION("a spring around the edge of the sheet") {
    changed.springs.push_back({9, 10, 0.1, 10, 0, SpringKind::Structural});
  }
  SECTION("a spring twice") { changed.springs.push_back(good.springs[7]); }
  SECTION("a spring twice, the other way round") {
    Spring<double> spring = good.springs[7];
    std::swap(spring.a, spring.b);
    changed.springs.push_back(spring);
  }
  SECTION("a spring that resists bending") { changed.springs[3].kind = SpringKind::Bend; }
  SECTION("other weights") { changed.bends[5].weight[1] = -2.5; }
  SECTION("weights in another order") { changed.bends[5].weight = {-2, 1, 1, 0}; }
  SECTION("weights that are not numbers") {
    changed.bends[5].weight[0] = std::numeric_limits<double>::quiet_NaN();
    // NaN compares as equal; the model refuses such a network before.
    CHECK_FALSE(changed.validate().empty());
    changed.bends[5].weight[0] = 2.0;
  }
  SECTION("a stencil of two vertices") { changed.bends[5].count = 2; }
  SECTION("a stencil around a corner") { changed.bends[5].vertex = {0, 1, 11, 0}; }
  SECTION("a diagonal stencil") { changed.bends[5].vertex = {0, 11, 22, 0}; }
  SECTION("a stencil that turns back") { changed.bends[5].vertex = {1, 0, 1, 0}; }
  SECTION("a stencil twice") { changed.bends.push_back(good.bends[2]); }
  SECTION("shuffled vertices") {
    for (Spring<double>& spring : changed.springs) {
      for (int* v : {&spring.a, &spring.b}) *v = (*v * 7 + 3) % 120;
    }
  }
  SECTION("no springs") { changed.springs.clear(); }
  CHECK_FALSE(find_grid(changed).has_value());
}

TEST_CASE("find grid: small and irregular sheets are no grids", "[find_grid]") {
  CHECK_FALSE(find_grid(sheet(7, 20)).has_value());
  CHECK_FALSE(find_grid(sheet(20, 7)).has_value());
  const auto mesh = clothctl_test::irregular_sheet(14, 14, 0.05, 0.2, 3);
  const auto network =
      sheet_network<double>(mesh.positions, mesh.triangles, Material<double>()).value();
  CHECK_FALSE(find_grid(network).has_value());
  // Two panels with a seam.
  SpringNetwork<double> one = sheet(10, 10), two = one;
  two.rest_positions.conservativeResize(3, 200);
  two.rest_positions.rightCols(100) = one.rest_positions;
  two.mass.setConstant(200, one.mass[0]);
  for (Spring<double> s : one.springs) {
    s.a += 100;
    s.b += 100;
    two.springs.push_back(s);
  }
  for (int i = 0; i < 10; ++i)
    two.springs.push_back({i * 10 + 9, 109 + i * 10, 0.01, 50, 0, SpringKind::Seam});
  CHECK_FALSE(find_grid(two).has_value());
}

TEST_CASE("find grid: only flat sheets of equal cells are regular", "[find_grid]") {
  SpringNetwork<double> network = sheet(14, 9);
  const auto grid = find_grid(network);
  REQUIRE(grid.has_value());
  const auto regular = [&]() { return is_regular(network, *grid); };
  REQUIRE(regular());
  SECTION("anywhere in space, also oblique cells") {
    Matrix3<double> map;
    map << 0.8, 0.2, 0.3, -0.1, 0.9, 0.2, 0.4, 0.1, 1.1;
    network.rest_positions =
        ((map * network.rest_positions).colwise() + Vector3<double>(3, -2, 1)).eval();
    for (Spring<double>& s : network.springs)
      s.rest_length = (network.rest_positions.col(s.a) - network.rest_positions.col(s.b)).norm();
    CHECK(regular());
  }
  SECTION("a spring with another length") {
    network.springs[11].rest_length *= 1.01;
    CHECK_FALSE(regular());
  }
  SECTION("a missing thread") {
    network.springs[4].stiffness = 0;
    CHECK_FALSE(regular());
  }
  SECTION("a diagonal may be without stiffness") {
    network.springs.back().stiffness = 0;
    CHECK(regular());
  }
  SECTION("a vertex out of line, springs at rest") {
    network.rest_positions(0, 60) += 0.01;
    for (Spring<double>& s : network.springs)
      s.rest_length = (network.rest_positions.col(s.a) - network.rest_positions.col(s.b)).norm();
    CHECK_FALSE(regular());
  }
  SECTION("a sheet that is bent at rest") {
    for (Index v = 0; v < network.vertex_count(); ++v)
      network.rest_positions(1, v) =
          0.2 * network.rest_positions(0, v) * network.rest_positions(0, v);
    for (Spring<double>& s : network.springs)
      s.rest_length = (network.rest_positions.col(s.a) - network.rest_positions.col(s.b)).norm();
    CHECK_FALSE(regular());
  }
}
