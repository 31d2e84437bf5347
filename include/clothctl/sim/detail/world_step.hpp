#pragma once

// A step of a world: its parts, in the order that world.hpp tells.

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/sim/detail/body_coupling.hpp"
#include "clothctl/sim/detail/world_grips.hpp"
#include "clothctl/sim/detail/world_layers.hpp"
#include "clothctl/sim/detail/world_parts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What a world consists of, and the memory of its steps.
template <RealScalar S>
class WorldStep {
 public:
  using Scalar = S;
  using Report = WorldReport<Scalar>;

  explicit WorldStep(const WorldSettings<Scalar>& s) : parts(s.bodies), settings(s) {}

  /// Returns an empty string, or why every step is refused. Allocates after something was added.
  std::string check_setup();
  /// Returns an empty string, or why a step of `dt` s is refused. Allocates.
  std::string check_input(const Scalar& dt);
  /// Advances everything by `dt` s.
  Report step(const Scalar& dt, const ExecutorRef& executor);
  /// Gives the shapes of links the motion of their frames.
  void move_links();

  WorldParts<Scalar> parts;
  WorldGrips<Scalar> grips;
  WorldSettings<Scalar> settings;
  /// False after something was added.
  bool prepared = false;
  /// The contacts of each sheet in the last step.
  std::vector<std::vector<ObstacleContact<Scalar>>> contacts;
  /// The length of the last part of that step, s; 0 before any.
  Scalar last_part = Scalar(0);

 private:
  using Sheet = WorldSheet<Scalar>;
  using Obstacle = WorldObstacle<Scalar>;

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static bool is_step_length(const Scalar& dt) {
    return is_finite(dt) && !(dt < Scalar(1e-9)) && !(Scalar(1e3) < dt);
  }

  /// Makes what depends on all that was added. Allocates. Returns an empty string, or what is
  /// wrong.
  std::string prepare();
  /// Lists the obstacles and bodies that a sheet may touch.
  void list_obstacles(std::size_t number);
  /// A part of a step.
  bool advance(const Scalar& dt, const Scalar& share, const ExecutorRef& executor, Report& report);
  /// Parts that `dt` s are divided into: at least `least`, and so many, up to `most`, that no sheet
  /// gets farther in one than contacts are looked for.
  int part_count(const Scalar& dt, int least, int most) const;
  bool step_hands(const Scalar& dt, const Scalar& rest, Report& report);
  bool step_sheet(int number, const Scalar& dt, const Scalar& share, Report& report);
  /// Gives bodies and hands the impulses of a sheet's contacts.
  void push_back(Sheet& sheet, const Scalar& dt);
  bool solve_pads(const Scalar& dt, Report& report);
  /// Tells how deep sheets are below their distance from obstacles, after pads have moved them.
  void note_penetration(const Scalar& dt, Report& report) const;
  /// Gives bodies and hands what pads changed at a sheet's contacts.
  void push_strained(const Sheet& sheet, const Scalar& dt);
  /// Whether a body sleeps on when an impulse changes its velocity by `gain` (m/s).
  bool sleeps_on(int body, const Scalar& gain, const Scalar& dt) const {
    using std::sqrt;
    const Scalar fall = dt * sqrt(settings.bodies.gravity.squaredNorm());
    return parts.bodies.asleep(body) && gain < fall + settings.bodies.sleep_speed;
  }
  void keep_layers_apart(const Scalar& dt, Report& report);
  /// Solves the bodies, and gives hands what bodies press on their links.
  bool finish_bodies(const ExecutorRef& executor, Report& report);
  bool move_all(const Scalar& dt, Report& report);
  /// Wakes bodies that a moving obstacle may touch within a step of `dt` s.
  void wake_bodies(const Scalar& dt);
  void save();
  void restore();

  /// Parts that fast sheets divide a step into, at most.
  static constexpr int kMostParts = 16;
  int substeps_ = 1;
  WorldLayers<Scalar> layers_;
  BodyCoupling<Scalar> coupling_;
  std::vector<Vector3<Scalar>> body_impulse_;

  /// What a failed step goes back to.
  std::vector<ClothState<Scalar>> saved_states_;
  std::vector<RigidMotion<Scalar>> saved_motions_;
  std::vector<HandState<Scalar>> saved_hands_;
  std::vector<VectorX<Scalar>> saved_torques_;
  RigidBodiesState<Scalar> saved_bodies_;
};

template <RealScalar S>
void WorldStep<S>::list_obstacles(std::size_t number) {
  Sheet& sheet = *parts.sheets[number];
  sheet.obstacles.clear();
  sheet.obstacle_number.clear();
  const auto add = [&](const ColliderRef<Scalar>& collider, int k) {
    if (!parts.meet(number, k) || grips.carries(k)) return;
    sheet.obstacles.push_back(collider);
    sheet.obstacle_number.push_back(k);
  };
  for (std::size_t k = 0; k < parts.obstacles.size(); ++k)
    add(parts.obstacles[k]->collider(), static_cast<int>(k));
  for (int b = 0; b < parts.bodies.body_count(); ++b) add(parts.bodies.collider(b), -1 - b);
}

template <RealScalar S>
std::string WorldStep<S>::prepare() {
  const std::size_t bodies = parts.body_groups.size();
  substeps_ = 1;
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    list_obstacles(i);
    if (substeps_ < parts.setups[i].substeps) substeps_ = parts.setups[i].substeps;
  }
  body_impulse_.resize(bodies);
  coupling_.reserve(static_cast<int>(bodies), parts.sheets);
  saved_motions_.resize(parts.obstacles.size());
  saved_states_.resize(parts.sheets.size());
  saved_hands_.resize(parts.hands.size());
  saved_torques_.resize(parts.hands.size());
  const std::size_t room = 32 * (bodies + 1);
  parts.bodies.reserve(room);
  saved_bodies_ = parts.bodies.state();
  saved_bodies_.contacts.reserve(room);
  const std::string bad = grips.prepare(parts);
  return bad.empty() ? layers_.prepare(parts.sheets, parts.setups, settings.sheet_friction) : bad;
}

template <RealScalar S>
std::string WorldStep<S>::check_setup() {
  std::string bad = settings.validate();
  if (bad.empty() && parts.body_groups.size() != index(parts.bodies.body_count()))
    bad = "a body was added elsewhere";
  if (bad.empty() && !prepared) {
    bad = prepare();
    prepared = bad.empty();
  }
  return bad;
}

template <RealScalar S>
std::string WorldStep<S>::check_input(const Scalar& dt) {
  std::string bad = check_setup();
  if (!bad.empty()) return bad;
  if (!is_step_length(dt))
    return "step length dt must be from 1e-9 to 1000 s, got " + number_text(dt) + " s";
  for (std::size_t i = 0; i < parts.hands.size(); ++i) {
    bad = parts.hands[i]->check_drive();
    if (!bad.empty()) return "hand " + std::to_string(i) + " has " + bad;
  }
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    const Sheet& sheet = *parts.sheets[i];
    bad = check_step_input(sheet.state, sheet.input, dt, sheet.mesh.vertex_count());
    if (!bad.empty()) return "sheet " + std::to_string(i) + ": " + bad;
  }
  return {};
}

template <RealScalar S>
void WorldStep<S>::save() {
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) saved_states_[i] = parts.sheets[i]->state;
  for (std::size_t i = 0; i < parts.obstacles.size(); ++i)
    saved_motions_[i] = parts.obstacles[i]->motion();
  for (std::size_t i = 0; i < parts.hands.size(); ++i) {
    saved_hands_[i] = parts.hands[i]->state;
    saved_torques_[i] = parts.hands[i]->torques;
  }
  grips.save();
  saved_bodies_ = parts.bodies.state();
}

template <RealScalar S>
void WorldStep<S>::restore() {
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    parts.sheets[i]->state = saved_states_[i];
    parts.sheets[i]->contacts.clear();
  }
  for (std::size_t i = 0; i < parts.obstacles.size(); ++i)
    (void)parts.obstacles[i]->set_motion(saved_motions_[i]);
  (void)parts.bodies.restore(saved_bodies_);
  for (std::size_t i = 0; i < parts.hands.size(); ++i) {
    parts.hands[i]->state = saved_hands_[i];
    parts.hands[i]->torques = saved_torques_[i];
    parts.hands[i]->forget_impulses();
    parts.hands[i]->update_frames();
  }
  grips.restore();
}

template <RealScalar S>
int WorldStep<S>::part_count(const Scalar& dt, int least, int most) const {
  using std::sqrt;
  int count = least;
  for (const auto& sheet : parts.sheets) {
    if (sheet->obstacles.empty()) continue;
    Scalar obstacle(0);
    for (const ColliderRef<Scalar>& o : sheet->obstacles) {
      const Scalar speed = sheet->contacts.surface_speed(o, sheet->state.positions);
      if (obstacle < speed) obstacle = speed;
    }
    const Scalar fastest =
        obstacle + sqrt(sheet->state.velocities.colwise().squaredNorm().maxCoeff());
    while (count < most &&
           !sheet->contacts.reaches(fastest, dt / Scalar(static_cast<double>(count))))
      ++count;
  }
  return count;
}

template <RealScalar S>
WorldReport<S> WorldStep<S>::step(const Scalar& dt, const ExecutorRef& executor) {
  Report report;
  report.status = StepStatus::InvalidInput;
  if (!is_step_length(dt) || !check_setup().empty()) return report;
  report.status = StepStatus::Converged;
  save();
  grips.begin();
  Scalar left = dt, part = dt;
  for (int open = substeps_; 0 < open; ++report.parts) {
    // A sheet may have become faster in the last part.
    open = part_count(left, open, kMostParts - report.parts);
    // Driven vertices go an equal part of what is left of their way.
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(open));
    part = left * share;
    if (!advance(part, share, executor, report)) {
      restore();
      report.advanced = false;
      return report;
    }
    left -= part;
    --open;
  }
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    const auto list = parts.sheets[i]->contacts.contacts();
    contacts[i].assign(list.begin(), list.end());
    grips.add_supports(static_cast<int>(i), contacts[i]);
    for (ObstacleContact<Scalar>& c : contacts[i])
      c.obstacle = parts.sheets[i]->obstacle_number[index(c.obstacle)];
  }
  last_part = part;
  report.advanced = true;
  return report;
}

template <RealScalar S>
bool WorldStep<S>::advance(const Scalar& dt, const Scalar& share, const ExecutorRef& executor,
                           Report& report) {
  report.contacts = report.layers = 0;
  grips.begin_part(parts, dt);
  wake_bodies(dt);
  const StepStatus predicted = parts.bodies.predict(dt);
  if (predicted != StepStatus::Converged) {
    report.status = predicted;
    return false;
  }
  if (!step_hands(dt, Scalar(dt / share - dt), report)) return false;
  layers_.begin(parts.sheets);
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    report.sheet = static_cast<int>(i);
    if (!step_sheet(report.sheet, dt, share, report)) return false;
    push_back(*parts.sheets[i], dt);
  }
  report.sheet = -1;
  for (const auto& hand : parts.hands) hand->take_impulses();
  if (!solve_pads(dt, report)) return false;
  note_penetration(dt, report);
  keep_layers_apart(dt, report);
  if (!finish_bodies(executor, report) || !move_all(dt, report)) return false;
  grips.end_part(parts);
  return true;
}

template <RealScalar S>
bool WorldStep<S>::step_hands(const Scalar& dt, const Scalar& rest, Report& report) {
  for (std::size_t i = 0; i < parts.hands.size(); ++i) {
    const PdReport told = parts.hands[i]->predict(dt, rest);
    if (told.status == PdStatus::Solved) continue;
    report.hand = static_cast<int>(i);
    report.control = told;
    if (told.status == PdStatus::Clipped) continue;
    const bool input = told.status == PdStatus::InvalidInput || told.status == PdStatus::WrongSize;
    report.status = input ? StepStatus::InvalidInput : StepStatus::NumericalFailure;
    return false;
  }
  move_links();
  return true;
}

template <RealScalar S>
void WorldStep<S>::move_links() {
  for (const auto& obstacle : parts.obstacles) {
    if (obstacle->hand >= 0)
      (void)obstacle->set_motion(parts.hands[index(obstacle->hand)]->frame_motion(obstacle->frame));
  }
}

template <RealScalar S>
bool WorldStep<S>::solve_pads(const Scalar& dt, Report& report) {
  for (const auto& sheet : parts.sheets) sheet->strained.clear();
  report.pads = grips.solve(parts, dt);
  for (const auto& sheet : parts.sheets) push_strained(*sheet, dt);
  if (report.pads.status == ContactStatus::Solved) return true;
  const bool found = report.pads.status == ContactStatus::NotConverged;
  report.status = found ? StepStatus::IterationLimit : StepStatus::NumericalFailure;
  return found;
}

template <RealScalar S>
void WorldStep<S>::note_penetration(const Scalar& dt, Report& report) const {
  for (std::size_t i = 0; i < parts.sheets.size(); ++i) {
    const Sheet& sheet = *parts.sheets[i];
    const bool moved = grips.touches(static_cast<int>(i));
    const Scalar depth = moved ? sheet.depth(dt) : sheet.contacts.report().penetration;
    if (report.penetration < depth) report.penetration = depth;
  }
}

template <RealScalar S>
bool WorldStep<S>::finish_bodies(const ExecutorRef& executor, Report& report) {
  parts.bodies.solve(executor);
  report.bodies = parts.bodies.finish();
  if (!report.bodies.advanced) {
    report.status = report.bodies.status;
    return false;
  }
  if (report.bodies.status != StepStatus::Converged) report.status = report.bodies.status;
  for (const RigidContact<Scalar>& c : parts.bodies.contacts()) {
    if (c.b >= 0 || !c.touches()) continue;
    const Obstacle& obstacle = *parts.obstacles[index(-1 - c.b)];
    if (obstacle.hand >= 0)
      parts.hands[index(obstacle.hand)]->add_impulse(
          obstacle.frame, c.position, Vector3<Scalar>(Scalar(-1) * c.sample.impulse));
  }
  for (const auto& hand : parts.hands) hand->take_impulses();
  return true;
}

template <RealScalar S>
bool WorldStep<S>::move_all(const Scalar& dt, Report& report) {
  for (std::size_t i = 0; i < parts.hands.size(); ++i) {
    if (parts.hands[i]->finish(dt)) continue;
    report.hand = static_cast<int>(i);
    report.status = StepStatus::NumericalFailure;
    return false;
  }
  for (const auto& obstacle : parts.obstacles) {
    if (obstacle->hand < 0) obstacle->move(dt);
  }
  move_links();
  return true;
}

template <RealScalar S>
bool WorldStep<S>::step_sheet(int number, const Scalar& dt, const Scalar& share, Report& report) {
  using std::sqrt;
  Sheet& sheet = *parts.sheets[index(number)];
  if (sheet.find_contacts(dt) != QueryStatus::Answered || !grips.find(parts, number)) {
    report.status = StepStatus::InvalidState;
    return false;
  }
  grips.find_patches(parts, number, dt);
  grips.expect(parts, number);
  const ClothInput<Scalar>* now = &sheet.input;
  if (share < Scalar(1) && !sheet.input.driven_vertices.empty()) {
    sheet.part = sheet.input;
    const Index given = sheet.part.driven_positions.cols();
    for (std::size_t k = 0; k < sheet.part.driven_vertices.size(); ++k) {
      const int v = sheet.part.driven_vertices[k];
      // The model refuses these.
      if (v < 0 || v >= sheet.state.positions.cols() || given <= static_cast<Index>(k)) continue;
      const Vector3<Scalar> from = sheet.state.positions.col(v);
      auto to = sheet.part.driven_positions.col(static_cast<Index>(k));
      to = from + share * (to - from);
    }
    now = &sheet.part;
  }
  coupling_.begin(index(number), sheet, parts.bodies);
  // Speeds below this do no harm.
  const Scalar fall = Scalar(0.01) + dt * sqrt(settings.bodies.gravity.squaredNorm());
  StepReport<Scalar> made;
  do made = sheet.step(dt, *now);
  while (made.advanced && coupling_.again(sheet, parts.bodies, dt, fall));
  if (made.advanced && !coupling_.settled()) made.status = StepStatus::IterationLimit;
  report.complete = report.complete && sheet.contacts.complete();
  if (made.status != StepStatus::Converged) report.status = made.status;
  const ObstacleContactReport<Scalar>& told = sheet.contacts.report();
  report.contacts += told.closed;
  if (report.force_residual < told.force_residual) report.force_residual = told.force_residual;
  return made.advanced;
}

template <RealScalar S>
void WorldStep<S>::push_back(Sheet& sheet, const Scalar& dt) {
  using std::sqrt;
  for (Vector3<Scalar>& sum : body_impulse_) sum.setConstant(Scalar(0));
  sheet.shares.clear();
  for (const ObstacleContact<Scalar>& c : sheet.contacts.contacts()) {
    const int b = -1 - sheet.obstacle_number[index(c.obstacle)];
    sheet.shares.push_back(b < 0 ? Scalar(1) : coupling_.share(b));
  }
  const auto for_each = [&](auto visit) {
    for (const ObstacleContact<Scalar>& c : sheet.contacts.contacts()) {
      if (c.state != ContactState::Open) visit(sheet.obstacle_number[index(c.obstacle)], c);
    }
  };
  for_each([&](int number, const ObstacleContact<Scalar>& c) {
    if (number < 0) body_impulse_[index(-1 - number)] -= c.impulse;
  });
  for_each([&](int number, const ObstacleContact<Scalar>& c) {
    const Vector3<Scalar> back = Scalar(-1) * c.impulse, &at = c.point.surface.point;
    if (number >= 0) {
      const Obstacle& obstacle = *parts.obstacles[index(number)];
      if (obstacle.hand >= 0)
        parts.hands[index(obstacle.hand)]->add_impulse(obstacle.frame, at, back);
      return;
    }
    // A sheet that lies on a sleeping body does not wake it.
    const int b = -1 - number;
    const Scalar gain = parts.bodies.inverse_mass(b) * sqrt(body_impulse_[index(b)].squaredNorm());
    if (sleeps_on(b, gain, dt)) return;
    parts.bodies.apply_impulse(b, Vector3<Scalar>(coupling_.share(b) * back), at);
  });
}

template <RealScalar S>
void WorldStep<S>::push_strained(const Sheet& sheet, const Scalar& dt) {
  using std::sqrt;
  for (std::size_t i = 0; i < sheet.strained.size(); ++i) {
    const SheetContact<Scalar>& point = sheet.contacts.contacts()[i].point;
    const Vector3<Scalar> back = Scalar(-1) * sheet.strained[i], &at = point.surface.point;
    const Scalar size = sqrt(back.squaredNorm());
    if (!(Scalar(0) < size)) continue;
    const int number = sheet.obstacle_number[index(sheet.contacts.contacts()[i].obstacle)];
    const int b = -1 - number;
    if (b >= 0) {
      if (!sleeps_on(b, Scalar(parts.bodies.inverse_mass(b) * size), dt))
        parts.bodies.apply_impulse(b, Vector3<Scalar>(sheet.shares[i] * back), at);
    } else if (const Obstacle& obstacle = *parts.obstacles[index(number)]; obstacle.hand >= 0) {
      parts.hands[index(obstacle.hand)]->add_impulse(obstacle.frame, at, back);
    }
  }
}

template <RealScalar S>
void WorldStep<S>::keep_layers_apart(const Scalar& dt, Report& report) {
  const SheetImpactReport told = layers_.keep_apart(parts.sheets, dt);
  report.layers = told.contacts;
  report.crossings = told.crossings_left;
  report.complete = report.complete && told.complete;
  if (told.status != StepStatus::Converged) report.status = StepStatus::IterationLimit;
  layers_.for_each_support(parts.sheets, [this](const Sheet& sheet,
                                                const ObstacleContact<Scalar>& c,
                                                const Vector3<Scalar>& impulse) {
    const int body = -1 - sheet.obstacle_number[index(c.obstacle)];
    if (body < 0 || !(Scalar(0) < impulse.squaredNorm()) || parts.bodies.asleep(body)) return;
    parts.bodies.apply_impulse(body, Vector3<Scalar>(Scalar(-1) * impulse), c.point.surface.point);
  });
}

template <RealScalar S>
void WorldStep<S>::wake_bodies(const Scalar& dt) {
  for (const auto& obstacle : parts.obstacles) {
    if (!obstacle->moves()) continue;
    const BoundingBox<Scalar> box = obstacle->collider().bounds(dt);
    for (int b = 0; b < parts.bodies.body_count(); ++b) {
      if (parts.bodies.asleep(b) && obstacle->groups.meets(parts.body_groups[index(b)]) &&
          box.overlaps(parts.bodies.collider(b).bounds(Scalar(0))))
        parts.bodies.wake(b);
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
