#include "support/hand_bulge.hpp"

#include <algorithm>
#include <span>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/grasp/held_grips.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/sim/contact_summary.hpp"
#include "support/hand_figures.hpp"

namespace program {

using clothctl::Index;

clothctl::Result<std::unique_ptr<BulgePlan>> BulgePlan::create(
    const clothctl::World<double>& world, const clothctl::StaticContacts<double>& contacts,
    const clothctl::GridMesh<double>& grid, const BulgeOptions& options,
    const std::array<Vec, 2>& tips, const Vec& middle) {
  std::unique_ptr<BulgePlan> out(new BulgePlan(world, contacts, grid, options));
  if (std::string bad = out->start(tips, middle); !bad.empty()) return clothctl::Error{bad};
  return out;
}

std::string BulgePlan::start(const std::array<Vec, 2>& tips, const Vec& middle) {
  using namespace clothctl;
  const auto network = sheet_network(grid_, options_.material);
  if (!network) return network.error();
  const auto model =
      MassSpring<double>::create(*network, MassSpringSettings<double>::of(options_.material));
  if (!model) return model.error();
  response_ = std::make_unique<Response>(*model);
  PlannerSetup<double> setup;
  setup.triangles = grid_.triangles;
  const auto add_nearest = [&](const Vec& place) {
    Index found = 0;
    (x().topRows(2).colwise() - place.head<2>()).colwise().squaredNorm().minCoeff(&found);
    setup.features.add_point(static_cast<int>(found));
  };
  for (const Vec& tip : tips) add_nearest(tip);
  for (const double along : {-1.5, -0.5, 0.5, 1.5})
    add_nearest(middle + Vec(0, along * options_.spacing, 0));
  if (std::string bad = take_grips(); !bad.empty()) return bad;
  setup.grips = grips_;
  PlannerSettings<double> settings;
  settings.horizon = options_.horizon;
  settings.dt = options_.dt;
  settings.input = GripInput::Pose;
  settings.weights.smooth = 0.1;  // fingers on a table answer a frame late
  settings.max_step = 1.5e-3;     // where the sheet snaps, the linear model wants too much
  auto planner = Planner<Predictor>::create(setup, settings, Predictor{*response_}, x());
  if (!planner) return planner.error();
  planner_ = std::make_unique<Planner<Predictor>>(std::move(*planner));
  plan_ = planner_->make_result();
  start_ = features();
  return {};
}

std::string BulgePlan::make(double t) {
  if (contacts_.changed() && take_grips().empty()) {
    if (std::string bad = planner_->set_grips(grips_, x()); !bad.empty()) return bad;
    plan_ = planner_->make_result();
  }
  // The table carries the sheet, and what the fingers press.
  clothctl::contact_supports<double>(world_, 0, options_.dt, options_.fingertips, 1e-3, supports_);
  if (std::string bad = planner_->set_supports(supports_); !bad.empty()) return bad;
  const auto status = planner_->plan(
      x(), world_.state(0).velocities, t, [this](Index i, double at) { return target(i, at); },
      plan_);
  return can_apply(status) ? std::string() : "planner: " + std::string(to_string(status));
}

BulgePlan::Points BulgePlan::next(int finger) const {
  const Index first = finger == 0 ? 0 : static_cast<Index>(held(0).size());
  return plan_.input.driven_positions.middleCols(first, static_cast<Index>(held(finger).size()));
}

BulgePlan::Points BulgePlan::features() const {
  Points out(3, planner_->setup().features.count());
  clothctl::evaluate_features<double>(planner_->setup().features, x(), out);
  return out;
}

BulgePlan::Vec BulgePlan::target(Index feature, double t) const {
  const double share = smooth_share(std::min(1.0, t / options_.seconds));
  Vec at = start_.col(feature);
  if (feature < 2) {
    at[0] += share * (options_.ends[static_cast<std::size_t>(feature)] - at[0]);
  } else {
    at[2] += share * options_.height;
  }
  return at;
}

std::string BulgePlan::take_grips() {
  std::vector<clothctl::Grip<double>> grips;
  for (int k : {0, 1}) {
    const clothctl::HoldingFinger<double> finger{k, Vec(0, 0, -1), options_.friction};
    auto grip =
        clothctl::make_held_grip<double>(contacts_, std::span(&finger, 1), x(), grid_.triangles);
    if (!grip) return grip.error();
    grips.push_back(std::move(*grip));
  }
  grips_ = std::move(grips);
  return {};
}

}  // namespace program
