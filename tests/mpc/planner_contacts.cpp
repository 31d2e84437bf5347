// Closed loops with contacts other than hard fingers, and with a foreign feature map.

#include <algorithm>
#include <vector>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "mpc/instances.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

namespace other_engine {

// Another engine's tracked points, each on an edge of the sheet.
struct EdgePoint {
  int from, to;
  float along;
};
struct Tracker {
  std::vector<EdgePoint> points;
};

}  // namespace other_engine

template <>
struct clothctl::feature_traits<other_engine::Tracker> {
  static int count(const other_engine::Tracker& tracker) {
    return static_cast<int>(tracker.points.size());
  }
  template <class Function>
  static void for_each_term(const other_engine::Tracker& tracker, Index i, Function&& function) {
    const other_engine::EdgePoint& p = tracker.points[static_cast<std::size_t>(i)];
    function(p.from, 1.0 - static_cast<double>(p.along));
    function(p.to, static_cast<double>(p.along));
  }
};

using namespace clothctl;
using clothctl_test::HangingSheet;

namespace {

using Soft = SoftFinger<double>;
using Sticky = AdhesiveFinger<double>;
using SoftPlanner = Planner<clothctl_test::FrozenPredictor, PlannerSetup<double, Soft>>;
using StickyPlanner =
    Planner<clothctl_test::FrozenPredictor, PlannerSetup<double, Sticky, other_engine::Tracker>>;

const HangingSheet& sheet(int patch) {
  static const HangingSheet single = clothctl_test::hanging_sheet(5, 1, 150);
  static const HangingSheet wide = clothctl_test::hanging_sheet(5, 2, 150);
  return patch == 1 ? single : wide;
}

// Extremes over a loop.
struct Seen {
  double mean_error = 0, violation = 0, least_normal = 0, torsion = 0;
};

// Largest violation of a contact law, least normal force and largest torsion of any finger, for one
// frame's forces, planned at positions x.
template <class AnyPlanner>
void judge(const AnyPlanner& planner, const PlanResult<double>& plan, const Points<double>& x,
           Seen& seen) {
  using Contact = typename AnyPlanner::Contact;
  for (std::size_t first = 0; first < plan.finger_forces.size();) {
    const FingerForce<double>& lead = plan.finger_forces[first];
    const auto& finger = planner.grips()[static_cast<std::size_t>(lead.grip)]
                             .fingers[static_cast<std::size_t>(lead.finger)];
    const Index m = static_cast<Index>(finger.vertices.size());
    Points<double> points(3, m), normals(3, m), forces(3, m);
    double pressed = 0, torsion = 0;
    for (Index j = 0; j < m; ++j) {
      const FingerForce<double>& f = plan.finger_forces[first + static_cast<std::size_t>(j)];
      points.col(j) = x.col(f.vertex);
      normals.col(j) = f.normal;
      forces.col(j) = f.force;
      pressed += f.force.dot(f.normal);
    }
    const Vector3<double> centre = points.rowwise().mean(), normal = normals.rowwise().mean();
    for (Index j = 0; j < m; ++j) {
      const Vector3<double> arm = points.col(j) - centre, f = forces.col(j);
      torsion += normal.dot(arm.cross(f));
    }
    seen.violation = std::max(
        seen.violation, contact_traits<Contact>::violation(finger.contact, points, normals, forces,
                                                           finger.max_normal_force));
    seen.least_normal = std::min(seen.least_normal, pressed);
    seen.torsion = std::max(seen.torsion, std::abs(torsion));
    first += static_cast<std::size_t>(m);
  }
}

template <class AnyPlanner, class Setup>
Seen run_sheet(const HangingSheet& from, const Setup& setup, const Points<double>& start) {
  PlannerSettings<double> settings;
  settings.horizon = 8;
  settings.gravity_load = {0, 0, 9.81 * from.network.mass.sum()};
  const MassSpring<double> model = from.model(Integration::LinearlyImplicit);
  auto made = AnyPlanner::create(setup, settings,
                                 clothctl_test::FrozenPredictor(MassSpringResponse<float>(model)),
                                 from.state.positions);
  REQUIRE(made.has_value());
  AnyPlanner planner = std::move(made).value();
  ModelPlant<MassSpring<double>> plant(model);
  plant.set_state(from.state);
  PlanResult<double> plan = planner.make_result();
  const auto target = [&](Index i, double t) -> Vector3<double> {
    const double ramp = t > 0 ? 1 - std::exp(-t * t / 0.1) : 0;
    return start.col(i) + ramp * Vector3<double>(0.0, 0.05 * std::sin(4 * t), 0.03);
  };
  Seen seen;
  const int frames = 30;
  for (int k = 0; k < frames; ++k) {
    const Points<double> x = plant.positions();
    const FrameReport<double> report = run_frame(planner, plant, 0.02 * k, target, plan);
    REQUIRE(report.advanced());
    seen.mean_error += report.mean_error / frames;
    judge(planner, plan, x, seen);
  }
  return seen;
}

}  // namespace

TEST_CASE("soft fingers hold and move a sheet within their contact law", "[mpc]") {
  const HangingSheet& from = sheet(2);
  PlannerSetup<double, Soft> setup;
  setup.triangles = from.network.triangles;
  for (int v : {from.lower_left(), from.lower_right()}) setup.features.add_point(v);
  for (int side : {0, 1})
    setup.grips.push_back(make_pinch<double>(from.corner_patch(side, 2), Soft{0.8, 0.02, 4}, 20.0));
  Points<double> start(3, 2);
  start.col(0) = from.state.positions.col(from.lower_left());
  start.col(1) = from.state.positions.col(from.lower_right());
  const Seen seen = run_sheet<SoftPlanner>(from, setup, start);
  CAPTURE(seen.mean_error, seen.torsion);
  CHECK(seen.violation <= 1e-9);
  CHECK(seen.mean_error < 0.02);
  CHECK(seen.torsion > 1e-5);  // torsion is used
}

TEST_CASE("one adhesive finger at each corner moves foreign features, and pulls", "[mpc]") {
  const HangingSheet& from = sheet(1);
  PlannerSetup<double, Sticky, other_engine::Tracker> setup;
  setup.triangles = from.network.triangles;
  const int below_left = from.grid.vertex(1, 0), below_right = from.grid.vertex(1, 4);
  setup.features.points = {{from.lower_left(), below_left, 0.25f},
                           {from.lower_right(), below_right, 0.5f}};
  for (int side : {0, 1}) {
    Grip<double, Sticky> grip;
    grip.fingers.push_back({from.corner_patch(side, 1), 1.0, Sticky{{0.8, 4}, 4.0}, 20.0});
    setup.grips.push_back(grip);
  }
  Points<double> start(3, 2);
  evaluate_features<double>(setup.features, from.state.positions, start);
  const Seen seen = run_sheet<StickyPlanner>(from, setup, start);
  CAPTURE(seen.mean_error, seen.least_normal);
  CHECK(seen.violation <= 1e-9);
  CHECK(seen.mean_error < 0.02);
  CHECK(seen.least_normal < -0.01);  // a single finger cannot pull without adhesion
  CHECK(seen.least_normal >= -4.0);
}
