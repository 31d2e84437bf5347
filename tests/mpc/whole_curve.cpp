#include "clothctl/mpc/whole_curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "mpc/short_curve.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ShortCurve;

namespace {

using Curve = WholeCurve<double>;
using Settings = WholeCurveSettings<double>;

Curve make_curve(const ShortCurve& c, const Settings& settings, Index frames, double scale = 1) {
  return Curve::create(c.model, c.setup, settings, c.sheet.state, c.target(scale), 0.0, frames)
      .value();
}

// A path that wanders by centimetres.
MatrixX<double> wandering(const ShortCurve& c, Index frames) {
  MatrixX<double> path = c.still(frames);
  for (Index k = 0; k < frames; ++k) {
    for (Index r = 0; r < 6; ++r)
      path(r, k) += 0.03 * std::sin(0.3 * static_cast<double>(k) + static_cast<double>(r)) -
                    0.03 * std::sin(static_cast<double>(r));
  }
  return path;
}

// Half the square root of the Hessian of the paths' cost for one coordinate, frames before the
// first at rest: rows for velocity, smoothness and jerk.
MatrixX<double> hand_rows(const PlannerWeights<double>& w, double dt, Index frames) {
  MatrixX<double> difference = MatrixX<double>::Identity(frames, frames);
  for (Index k = 1; k < frames; ++k) difference(k, k - 1) = -1;
  MatrixX<double> rows(3 * frames, frames);
  rows << std::sqrt(w.velocity) / dt * difference,
      std::sqrt(w.smooth) / dt * difference * difference,
      std::sqrt(w.jerk) / dt * difference * difference * difference;
  return rows;
}

}  // namespace

TEST_CASE("the gradient of a whole curve is the limit of differences of its cost", "[mpc]") {
  const ShortCurve c;
  constexpr Index kFrames = 15;
  Settings settings;
  settings.weights.anchor = 2;
  settings.weights.jerk = 0.01;
  Curve curve = make_curve(c, settings, kFrames);
  const MatrixX<double> path = wandering(c, kFrames);
  MatrixX<double> gradient, ignored;
  const auto here = curve.evaluate(path, gradient).value();
  REQUIRE(here.weakened_frames == 0);
  CHECK(here.gradient_norm == Approx(gradient.norm()));
  for (unsigned seed = 0; seed < 4; ++seed) {
    // Steps converge to 1e-12 m/s; the error of a central difference is a third derivative times
    // the square of its step, 1e-12 m².
    const MatrixX<double> way =
        clothctl_test::noise<double>(seed, 2 * kFrames, 1.0).reshaped(6, kFrames);
    const double e = 1e-6, ahead = curve.evaluate(path + e * way, ignored).value().cost,
                 behind = curve.evaluate(path - e * way, ignored).value().cost;
    CHECK(gradient.cwiseProduct(way).sum() == Approx((ahead - behind) / (2 * e)).epsilon(1e-5));
  }
}

TEST_CASE("costs fall, and the gradient with them", "[mpc]") {
  const ShortCurve c;
  Settings settings;
  settings.compression = 1;
  settings.least_decrease = 1e-6;
  Curve curve = make_curve(c, settings, 25, 0.2);
  MatrixX<double> gradient;
  const double first = curve.evaluate(c.still(25), gradient).value().gradient_norm;
  const auto best = curve.optimise(c.still(25)).value();
  CHECK(best.status == WholeCurveStatus::Converged);
  for (std::size_t i = 1; i < best.costs.size(); ++i) CHECK(best.costs[i] < best.costs[i - 1]);
  CHECK(best.cost < 0.1 * best.costs.front());
  CHECK(best.cost == best.costs.back());
  CHECK(best.gradient_norm < 1e-2 * first);
  // The result is what its path does, and another run finds the same bits.
  const auto again = curve.evaluate(best.path, gradient).value();
  CHECK(again.cost == best.cost);
  CHECK(again.features == best.features);
  Curve other = make_curve(c, settings, 25, 0.2);
  CHECK(other.optimise(c.still(25)).value().path == best.path);
}

TEST_CASE("the optimum of a tiny motion is that of linear least squares", "[mpc]") {
  const ShortCurve c;
  constexpr Index kFrames = 12;
  Settings settings;
  settings.weights.jerk = 0.01;
  settings.compression = 1;
  settings.first_damping = 1e-6;
  settings.least_decrease = 1e-7;
  settings.max_products = 200;
  const MatrixX<double> still = c.still(kFrames);
  MatrixX<double> gradient;
  // The sheet still sinks a little. Targets are near where it is then.
  const MatrixX<double> sinking =
      make_curve(c, settings, kFrames).evaluate(still, gradient).value().features;
  const auto motion = c.target(1e-4);
  const auto target = [&](Index i, double t) {
    const Index k = static_cast<Index>(std::lround(t / settings.dt)) - 1;
    const Index frame = (std::min)((std::max)(k, Index(0)), kFrames - 1);
    return Vector3<double>(sinking.block<3, 1>(3 * i, frame) + motion(i, t) - motion(i, -1));
  };
  Curve curve =
      Curve::create(c.model, c.setup, settings, c.sheet.state, target, 0.0, kFrames).value();
  const auto start = curve.evaluate(still, gradient).value();
  const Index n = 6 * kFrames;
  MatrixX<double> jacobian(n, n), v = MatrixX<double>::Zero(6, kFrames);
  for (Index j = 0; j < n; ++j) {
    v.setZero();
    v(j) = 1;
    jacobian.col(j) = curve.product(v).reshaped();
  }
  const MatrixX<double> rows = hand_rows(settings.weights, settings.dt, kFrames);
  MatrixX<double> hessian = 40.0 * jacobian.transpose() * jacobian;
  const MatrixX<double> hands = rows.transpose() * rows;
  for (Index k = 0; k < kFrames; ++k) {
    for (Index l = 0; l < kFrames; ++l) {
      for (Index r = 0; r < 6; ++r) hessian(6 * k + r, 6 * l + r) += hands(k, l);
    }
  }
  const VectorX<double> pull =
      40.0 * jacobian.transpose() * (curve.targets() - start.features).reshaped().matrix();
  const VectorX<double> expected = hessian.ldlt().solve(pull);
  const auto best = curve.optimise(still).value();
  CHECK(best.status == WholeCurveStatus::Converged);
  CHECK(((best.path - still).reshaped().matrix() - expected).norm() < 1e-3 * expected.norm());
  const double quadratic = start.cost - pull.dot(expected);
  CHECK(best.cost == Approx(quadratic).epsilon(1e-3));
}

TEST_CASE("whole curves refuse what they cannot use", "[mpc]") {
  const ShortCurve c;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto error = [&](const MassSpring<double>& model, const Settings& settings,
                         const ClothState<double>& start, double scale, Index frames) {
    const auto made = Curve::create(model, c.setup, settings, start, c.target(scale), 0.0, frames);
    return made ? std::string() : made.error();
  };
  const ClothState<double>& rest = c.sheet.state;
  CHECK(error(c.model, {}, rest, 1, 3).empty());
  CHECK(error(c.model, {}, rest, 1, 0) == "0 frames, must be positive");
  CHECK(error(c.model, {}, rest, nan, 3).find("target of feature 0") == 4);
  CHECK(error(c.sheet.model(Integration::LinearlyImplicit), {}, rest, 1, 3).find("Newton") !=
        std::string::npos);
  ClothState<double> broken = rest;
  broken.positions(2, 4) = nan;
  CHECK(error(c.model, {}, broken, 1, 3).find("position of vertex 4") == 0);
  broken.positions.resize(3, 2);
  CHECK(error(c.model, {}, broken, 1, 3).find("2 positions") == 0);
  Settings settings;
  settings.weights.smooth = -1;
  CHECK(error(c.model, settings, rest, 1, 3).find("smooth is -1") == 0);
  settings = {};
  settings.compression = nan;
  CHECK(error(c.model, settings, rest, 1, 3).find("compression") == 0);
  settings = {};
  settings.first_damping = 0;
  CHECK(error(c.model, settings, rest, 1, 3).find("first_damping is 0") == 0);

  Curve curve = make_curve(c, {}, 3);
  MatrixX<double> path = c.still(3), gradient;
  path(1, 2) = nan;
  CHECK(curve.optimise(path).error() == "the path of frame 2 is not finite or beyond 1e6 m");
  CHECK(curve.evaluate(c.still(2), gradient).error().find("the path is 6 x 2") == 0);
}

TEST_CASE("the settings of a whole curve are those of a planner without its anchor", "[mpc]") {
  const auto planner = PlannerSettings<double>::rollout();
  const Settings settings = Settings::of(planner);
  CHECK(settings.weights.jerk == planner.weights.jerk);
  CHECK(settings.weights.smooth == planner.weights.smooth);
  CHECK(settings.weights.anchor == 0);
  CHECK(settings.validate().empty());
  CHECK(to_string(WholeCurveStatus::Stalled) == "stalled");
}
