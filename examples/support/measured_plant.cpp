#include "support/measured_plant.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "clothctl/mesh/grid.hpp"

namespace program {

namespace {

using Rollout = clothctl::MassSpringRollout<double>;

clothctl::PointFeatures<double> markers(const Scene& scene, const Options& o) {
  const auto grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  if (grid.positions.cols() != scene.body.network.vertex_count())
    refuse("--markers: the body is not a square sheet");
  return spread_markers(grid, o.markers == 0 ? o.cloth : o.markers);
}

Rollout model(const Scene& scene, const Options& o) {
  const Body& body = scene.body;
  clothctl::RolloutModelSettings settings = rollout_model_settings(body.network.vertex_count());
  if (o.plant == "linear-implicit") settings.integration = clothctl::Integration::LinearlyImplicit;
  return Rollout(make_mass_spring(body, body.network, settings.integration), settings);
}

/// The input that keeps the hands where they are.
clothctl::ClothInput<double> hold(const Scene& scene, const Points& x) {
  clothctl::ClothInput<double> input;
  for (const clothctl::Grip<double>& grip : scene.setup.grips) {
    for (const int v : grip.vertices()) input.driven_vertices.push_back(v);
  }
  input.driven_positions = x(Eigen::all, input.driven_vertices);
  return input;
}

long frames(const Scene& scene, double seconds) { return std::lround(seconds / scene.settings.dt); }

clothctl::EstimatorSettings<double> estimator_settings(const Scene& scene, const Options& o) {
  clothctl::EstimatorSettings<double> settings;
  settings.dt = scene.settings.dt;
  settings.noise = std::max(o.noise, 0.001);
  settings.correlation = o.size;
  settings.latency = o.latency;
  settings.history = frames(scene, o.delay) + o.latency + 1;
  return settings;
}

}  // namespace

MeasuredPlant::MeasuredPlant(const Scene& scene, const Options& o, AnyPlant& plant)
    : plant_(&plant),
      camera_(markers(scene, o), o.noise, frames(scene, o.delay), o.noise_seed),
      estimator_(must(Estimator::create(
          model(scene, o), markers(scene, o), {plant.positions(), plant.velocities()},
          hold(scene, plant.positions()), estimator_settings(scene, o)))),
      sent_(static_cast<std::size_t>(o.latency), hold(scene, plant.positions())) {}

void MeasuredPlant::look() {
  if (!camera_.look(frame_, plant_->positions(), picture_)) return;
  const clothctl::EstimateReport<double> report = estimator_.correct(picture_);
  if (report.status != clothctl::EstimateStatus::Corrected)
    refuse("the estimate of frame " + std::to_string(frame_) +
           " failed: " + std::string(to_string(report.status)));
}

void MeasuredPlant::apply(const clothctl::ClothInput<double>& input) {
  estimator_.apply(input);
  sent_.push_back(input);
}

clothctl::StepReport<double> MeasuredPlant::advance(double dt) {
  plant_->apply(sent_.front());
  sent_.pop_front();
  const clothctl::StepReport<double> report = estimator_.advance(dt);
  if (!report.advanced) return report;
  ++frame_;
  return plant_->advance(dt);
}

}  // namespace program
