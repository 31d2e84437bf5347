// What passes from one set of grips to the next: who goes on from whom, and with which forces,
// coefficients and velocities.

#include "clothctl/mpc/detail/grip_change.hpp"

#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using V = Vector3<double>;

namespace {

using Basis = detail::GripBasis<double>;
using Change = detail::GripChange<double>;

const clothctl_test::HangingSheet& sheet() {
  static const clothctl_test::HangingSheet made = clothctl_test::hanging_sheet(5, 1, 5);
  return made;
}

// Pinches of the given vertices.
Basis basis_of(const std::vector<std::vector<int>>& grips, GripInput input = GripInput::Force) {
  std::vector<Grip<double>> made;
  for (const std::vector<int>& vertices : grips)
    made.push_back(make_pinch<double>(vertices, 0.5, 9.0));
  Basis basis(made, sheet().network.triangles, input);
  basis.update(sheet().state.positions);
  return basis;
}

std::vector<int> continued(const std::vector<std::vector<int>>& before,
                           const std::vector<std::vector<int>>& after) {
  const Basis last = basis_of(before), now = basis_of(after);
  const Change change(last, now, sheet().state.positions);
  std::vector<int> from;
  for (std::size_t g = 0; g < after.size(); ++g) from.push_back(change.grip(g));
  return from;
}

}  // namespace

TEST_CASE("a grip goes on from the one that shares most vertices, else from its index", "[mpc]") {
  using Ints = std::vector<int>;
  CHECK(continued({{0, 1}, {8}}, {{0, 1}, {8}}) == Ints{0, 1});
  CHECK(continued({{0, 1}, {8}}, {{8, 9}}) == Ints{1});
  CHECK(continued({{0, 1}}, {{0}, {8}}) == Ints{0, -1});
  CHECK(continued({{0, 1, 2}}, {{0}, {1, 2}}) == Ints{0, -1});  // the first takes it
  CHECK(continued({{0}, {8}}, {{3}, {8}}) == Ints{0, 1});
  CHECK(continued({{0}, {8}}, {{8}, {3}}) == Ints{1, -1});
  const Basis last = basis_of({{0, 1}, {8}}), now = basis_of({{8, 9}, {1}});
  const Change change(last, now, sheet().state.positions);
  CHECK((change.slot(0) == 2 && change.slot(1) == -1 && change.slot(2) == 1));
}

TEST_CASE("planned forces are passed on without loss", "[mpc]") {
  const std::vector<std::vector<std::vector<int>>> sets{
      {{0, 1, 2, 3}, {20, 21}}, {{0, 1, 2, 3, 4}, {20}},
      {{1, 6, 7}, {20, 21}},    {{20}},
      {{0}, {20, 21}, {13}},    {{11, 12}}};
  for (std::size_t a = 0; a < sets.size(); ++a) {
    for (std::size_t b = 0; b < sets.size(); ++b) {
      CAPTURE(a, b);
      const Basis last = basis_of(sets[a]), now = basis_of(sets[b]);
      const Change change(last, now, sheet().state.positions);
      const MatrixX<double>& W = change.weights();
      CHECK((W.rows() == now.force_count() && W.cols() == last.force_count()));
      CHECK(W.minCoeff() >= 0.0);
      CHECK((W.colwise().sum().array() - 1.0).abs().maxCoeff() < 1e-14);
      if (a == b) {
        CHECK(W.isIdentity(0.0));
        CHECK(change.unknowns().isIdentity(0.0));
      }
      // Each finger keeps the sum of its forces, unless others are gone.
      for (const auto& f : now.fingers()) {
        const int g = change.grip(static_cast<std::size_t>(f.grip));
        if (g < 0) continue;
        const auto& from = last.fingers()[static_cast<std::size_t>(2 * g + f.finger)];
        const Index m = static_cast<Index>(f.held_slots.size()),
                    n = static_cast<Index>(from.held_slots.size());
        const MatrixX<double> own = W.block(f.first_force, from.first_force, m, n);
        CHECK((own.colwise().sum().array() - 1.0).abs().maxCoeff() < 1e-14);
      }
    }
  }
}

TEST_CASE("vertices that stay keep their coefficients, generator by generator", "[mpc]") {
  const Basis last = basis_of({{0, 1}, {20}}), now = basis_of({{1, 2}, {20}});
  const Change change(last, now, sheet().state.positions);
  const MatrixX<double>& map = change.unknowns();  // two fingers of 8, two of 4
  REQUIRE((map.rows() == 24 && map.cols() == 24));
  for (Index f : {0, 8}) {
    for (Index i = 0; i < 4; ++i) {
      // Vertex 1 keeps half and takes half of vertex 0, vertex 2 takes the other halves.
      VectorX<double> stays = VectorX<double>::Zero(24), joins = VectorX<double>::Zero(24);
      stays[f + 4 + i] = joins[f + 4 + i] = stays[f + i] = joins[f + i] = 0.5;
      CHECK(map.row(f + i).transpose() == stays);
      CHECK(map.row(f + 4 + i).transpose() == joins);
    }
  }
  CHECK(map.bottomRightCorner(8, 8).isIdentity(0.0));
}

TEST_CASE("generators on a whole patch keep their coefficients when the patch changes", "[mpc]") {
  using Soft = SoftFinger<double>;
  const auto made = [](const std::vector<int>& vertices) {
    detail::GripBasis<double, Soft> basis({make_pinch<double>(vertices, Soft{}, 9.0)}, {},
                                          GripInput::Force);
    basis.update(sheet().state.positions);
    return basis;
  };
  const auto last = made({0, 1}), now = made({0, 1, 2});
  const detail::GripChange<double, Soft> change(last, now, sheet().state.positions);
  CHECK(change.unknowns().isIdentity(1e-14));
}

TEST_CASE("a grip keeps its rigid motion when its vertices change", "[mpc]") {
  const Points<double>& x = sheet().state.positions;
  const Basis last = basis_of({{0, 1, 5}, {20}}, GripInput::Pose),
              now = basis_of({{1, 5, 6}, {20, 21}, {13}}, GripInput::Pose);
  const Change change(last, now, x);
  VectorX<double> u(last.unknowns());
  for (Index i = 0; i < u.size(); ++i) u[i] = 0.3 - 0.1 * static_cast<double>(i % 7);
  const MatrixX<double> plan = last.matrix() * u;
  const Points<double> measured = Points<double>::Constant(3, x.cols(), 0.25);
  MatrixX<double> out = MatrixX<double>::Zero(now.inputs(), 1);
  change.carry_velocities(plan, measured, out);
  // The unknowns say the same about the grips that go on; the new one goes on as measured.
  const VectorX<double> mapped = now.matrix() * (change.unknowns() * u);
  CHECK((out.col(0).head(15) - mapped.head(15)).norm() < 1e-12);
  CHECK(out.col(0).tail(3) == V::Constant(0.25));
  CHECK(out.col(0).segment<3>(0) == plan.col(0).segment<3>(3));  // vertex 1, bit for bit
  const V jump = now.held().centroid(x, 0) - last.held().centroid(x, 0);
  CHECK(change.jump(0) == jump);
}
