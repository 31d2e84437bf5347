#include "clothctl/mpc/detail/curve_sweeps.hpp"

#include "mpc/short_curve.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ShortCurve;

namespace {

constexpr Index kFrames = 8;

// A grip of two vertices and one of one.
detail::CurveSweeps<double> make_sweeps(const ShortCurve& c) {
  detail::HeldVertices<double> held;
  held.add_grip(c.sheet.corner_patch(0, 1));
  held.add_grip({c.sheet.upper_right() - 1, c.sheet.upper_right()});
  auto derivative = MassSpringDerivative<double>::create(c.model, held.vertices()).value();
  return {c.model, std::move(derivative), std::move(held), c.setup.features, c.sheet.state, 0.02,
          kFrames};
}

MatrixX<double> random_matrix(unsigned seed) {
  return clothctl_test::noise<double>(seed, 2 * kFrames, 1.0).reshaped(6, kFrames);
}

}  // namespace

TEST_CASE("sweeps give the derivative of a rollout and its transpose", "[mpc]") {
  const ShortCurve c;
  auto sweeps = make_sweeps(c);
  MatrixX<double> path(6, kFrames), ahead(6, kFrames), behind(6, kFrames), pushed(6, kFrames),
      pulled(6, kFrames);
  for (Index k = 0; k < kFrames; ++k) {
    for (Index g = 0; g < 2; ++g)
      path.block<3, 1>(3 * g, k) =
          sweeps.held().centroid(c.sheet.state.positions, static_cast<std::size_t>(g));
  }
  path += 0.01 * random_matrix(1);
  const MatrixX<double> way = random_matrix(2), weights = random_matrix(3);
  REQUIRE(sweeps.roll_out(path + 1e-7 * way, ahead) == -1);
  REQUIRE(sweeps.roll_out(path - 1e-7 * way, behind) == -1);
  REQUIRE(sweeps.roll_out(path, pulled) == -1);
  REQUIRE(sweeps.linearise(1.0));
  CHECK(sweeps.weakened() == 0);
  sweeps.push(way, pushed);
  const MatrixX<double> expected = (ahead - behind) / 2e-7;
  CHECK((pushed - expected).norm() < 1e-5 * expected.norm());
  sweeps.pull(weights, pulled);
  CHECK(pulled.cwiseProduct(way).sum() == Approx(weights.cwiseProduct(pushed).sum()).epsilon(1e-9));
  // The vertices of a grip keep their offsets.
  const Points<double>& x = sweeps.state(kFrames).positions;
  const int last = c.sheet.upper_right();
  CHECK((x.col(last) - x.col(last - 1) - c.sheet.state.positions.col(last) +
         c.sheet.state.positions.col(last - 1))
            .norm() < 1e-12);
}
