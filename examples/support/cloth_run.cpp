#include "support/cloth_run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/core/number_text.hpp"
#include "support/obstacles.hpp"
#include "support/timing.hpp"

namespace program {

namespace {

constexpr double kGravity = 9.81;

/// Collects what the figures need of each frame.
class ClothMeter {
 public:
  ClothMeter(const ClothRunOptions& run, const ClothScene& scene)
      : run_(run), scene_(scene), start_(energy(scene.state.positions, scene.state.velocities)) {
    end_ = most_ = start_;
  }

  /// Measures a frame.
  void add(const Points& x, const Points& v) {
    for (Index i = 0; i < x.size(); ++i)
      nonfinite_ +=
          (clothctl::is_finite(x.data()[i]) ? 0 : 1) + (clothctl::is_finite(v.data()[i]) ? 0 : 1);
    for (const clothctl::Spring<double>& s : scene_.network.springs) {
      if (s.kind != clothctl::SpringKind::Structural) continue;
      const double stretch = (x.col(s.b) - x.col(s.a)).norm() / s.rest_length - 1;
      stretch_max_ = std::max(stretch_max_, stretch);
      stretch_sum_ += std::max(0.0, stretch);
      ++stretch_count_;
    }
    end_ = energy(x, v);
    most_ = std::max(most_, end_);
  }

  /// Writes the figures of all frames.
  void write(ClothFigures& figures) const {
    const double scale = kGravity * scene_.network.mass.sum() * scene_.extent;
    const double unknown = std::numeric_limits<double>::quiet_NaN();  // "null" in JSON
    const bool windy = !scene_.wind.isZero(0);
    figures.nonfinite = nonfinite_;
    figures.stretch_max = stretch_max_;
    figures.stretch_mean =
        stretch_count_ > 0 ? stretch_sum_ / static_cast<double>(stretch_count_) : 0;
    figures.energy_drift = windy ? unknown : (end_ - start_) / scale;
    figures.energy_rise_max = windy ? unknown : (most_ - start_) / scale;
  }

 private:
  double energy(const Points& x, const Points& v) const { return cloth_energy(run_, scene_, x, v); }

  const ClothRunOptions& run_;
  const ClothScene& scene_;
  double start_, end_ = 0, most_ = 0, stretch_max_ = 0, stretch_sum_ = 0;
  long long stretch_count_ = 0, nonfinite_ = 0;
};

/// Calls visit(model) with the model called `run.model`: pbd, xpbd or mass-spring.
template <class Visit>
void visit_model(const ClothRunOptions& run, const ClothScene& scene, Visit visit) {
  const bool windy = !scene.wind.isZero(0);
  if (run.cap > 0 && run.model != "xpbd")
    refuse("--cap: " + run.model + " has no limit of stretch; take xpbd");
  if (run.model == "mass-spring") {
    auto settings = clothctl::MassSpringSettings<double>::of(scene.material, windy);
    // With contacts, one linear solve a step is several times as fast and rests as well.
    settings.integration =
        run.touches() ? clothctl::Integration::LinearlyImplicit : clothctl::Integration::Newton;
    settings.pinned = scene.pinned;
    return visit(must(clothctl::MassSpring<double>::create(scene.network, settings)));
  }
  const auto of = clothctl::PositionBasedSettings<double>::of(scene.material, windy);
  auto settings = run.model == "pbd" ? clothctl::PositionBasedSettings<double>::verlet() : of;
  settings.drag = of.drag;
  settings.air = of.air;
  settings.pinned = scene.pinned;
  settings.stretch_limit = run.cap;
  visit(must(clothctl::PositionBased<double>::create(scene.network, settings)));
}

/// A sheet alone, or in a world with what it touches.
class SimulatedSheet {
 public:
  SimulatedSheet(const ClothRunOptions& run, const ClothScene& scene)
      : mass_(scene.network.mass),
        balanced_(scene.pinned.empty() && scene.wind.isZero(0) && !run.self &&
                  !(scene.material.drag > 0) && run.model != "pbd") {
    clothctl::ClothInput<double> input;
    input.wind = scene.wind;
    if (run.touches()) solids_ = add_obstacles(run.obstacles, run.friction, world_);
    visit_model(run, scene, [&](auto model) {
      if (!run.touches()) {
        plant_.emplace(std::move(model));
        plant_->set_state(scene.state);
        return plant_->apply(input);
      }
      clothctl::WorldSheetSetup<double> setup;
      setup.thickness = run.thickness;
      setup.meets_sheets = run.self;
      must(world_.add_sheet(std::move(model), scene.state, setup));
      world_.input(0) = input;
    });
  }

  const Points& positions() const { return plant_ ? plant_->positions() : state().positions; }
  const Points& velocities() const { return plant_ ? plant_->velocities() : state().velocities; }
  const Points& solids() const { return solids_; }

  clothctl::StepReport<double> advance(double dt) {
    if (plant_) return plant_->advance(dt);
    const Vec before = momentum();
    told_ = world_.step(dt);
    Vec rest = momentum() - before + Vec(0, 0, kGravity * dt * mass_.sum());
    for (const auto& contact : world_.contacts(0)) rest -= contact.impulse;
    missing_ = rest.norm();
    clothctl::StepReport<double> report;
    report.status = told_.status;
    report.advanced = told_.advanced;
    return report;
  }

  /// Adds what the last step did at contacts.
  void measure(ClothFigures& f) const {
    if (plant_) return;
    const double unknown = std::numeric_limits<double>::quiet_NaN();  // "null" in JSON
    f.contacts_max = std::max(f.contacts_max, static_cast<long>(told_.contacts + told_.layers));
    f.self_crossings = told_.crossings;
    f.penetration_max_m = std::max(f.penetration_max_m, told_.penetration);
    f.penetration_end_m = told_.penetration;
    f.speed_end_m_s = 0;
    for (const auto& contact : world_.contacts(0)) {
      if (contact.state == clothctl::ContactState::Open) continue;
      for (std::size_t k = 0; k < 3 && contact.point.vertex[k] >= 0; ++k)
        f.speed_end_m_s =
            std::max(f.speed_end_m_s, state().velocities.col(contact.point.vertex[k]).norm());
    }
    f.momentum_residual = balanced_ ? std::max(f.momentum_residual, missing_) : unknown;
    f.solver_residual_max = std::max(f.solver_residual_max, told_.force_residual);
  }

 private:
  const clothctl::ClothState<double>& state() const { return world_.state(0); }
  Vec momentum() const { return state().velocities * mass_; }

  std::optional<AnyPlant> plant_;
  clothctl::World<double> world_;
  clothctl::WorldReport<double> told_;
  Points solids_ = Points(3, 0);
  clothctl::VectorX<double> mass_;
  /// Whether gravity and the contacts with obstacles are all that changes the momentum; by how much
  /// they miss that in the last step, N s.
  bool balanced_ = false;
  double missing_ = 0;
};

}  // namespace

double cloth_energy(const ClothRunOptions& run, const ClothScene& scene, const Points& x,
                    const Points& v) {
  const clothctl::SpringNetwork<double>& network = scene.network;
  double energy = 0;
  for (Index i = 0; i < x.cols(); ++i)
    energy += network.mass[i] * (0.5 * v.col(i).squaredNorm() + kGravity * x(2, i));
  if (run.model == "pbd" || run.cap > 0) return energy;  // the springs are constraints
  for (const clothctl::Spring<double>& s : network.springs) {
    const double longer = (x.col(s.b) - x.col(s.a)).norm() - s.rest_length;
    energy += 0.5 * s.stiffness * longer * longer;
  }
  for (const clothctl::BendStencil<double>& b : network.bends) {
    Vec sum = Vec::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      sum += b.weight[i] * x.col(b.vertex[i]);
    energy += 0.5 * b.stiffness * sum.squaredNorm();
  }
  return energy;
}

ClothFigures run_cloth(const ClothRunOptions& run, const ClothScene& scene,
                       clothctl::PlayerRecorder* page, long every) {
  SimulatedSheet plant(run, scene);
  if (page != nullptr) page->scene().solids = plant.solids();
  const Points none(3, 0);
  const auto record = [&](long step) {
    if (page != nullptr && step % every == 0)
      page->add_frame(plant.positions(), none, none, none, none);
  };
  ClothFigures figures;
  figures.vertices = scene.network.vertex_count();
  ClothMeter meter(run, scene);
  Progress progress;
  const long steps = std::max(1L, std::lround(run.seconds / run.dt));
  const double constraints =
      static_cast<double>(scene.network.springs.size()) +
      (run.model == "mass-spring" ? 0.0 : static_cast<double>(scene.network.bends.size()));
  double seconds = 0, solves = 0;
  record(0);
  for (long step = 1; step <= steps; ++step) {
    progress.show(step, steps);
    const double before = thread_seconds();
    const clothctl::StepReport<double> report = plant.advance(run.dt);
    seconds += thread_seconds() - before;
    if (!report.advanced) {
      figures.status =
          "step " + std::to_string(step) + ": " + std::string(to_string(report.status));
      break;
    }
    ++figures.steps;
    figures.unconverged_steps += report.status == clothctl::StepStatus::Converged ? 0 : 1;
    solves += constraints * report.iterations;
    plant.measure(figures);
    meter.add(plant.positions(), plant.velocities());
    record(step);
  }
  progress.clear();
  meter.write(figures);
  if (figures.nonfinite > 0 && figures.status == "finished") figures.status = "not finite";
  if (seconds > 0) {
    figures.real_time_factor = run.dt * static_cast<double>(figures.steps) / seconds;
    figures.solves_per_second = solves / seconds;
  }
  return figures;
}

}  // namespace program
