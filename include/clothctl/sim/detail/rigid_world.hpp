#pragma once

// What RigidBodies holds, and how bodies, obstacles and joints are added. The parts of a step are
// in rigid_step.hpp.

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/body_contacts.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/sim/detail/broad_phase.hpp"
#include "clothctl/sim/detail/contact_memory.hpp"
#include "clothctl/sim/detail/free_rotation.hpp"
#include "clothctl/sim/detail/island_solver.hpp"
#include "clothctl/sim/detail/rigid_islands.hpp"
#include "clothctl/sim/rigid_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A body: what does not change.
template <RealScalar Scalar>
struct RigidBodyData {
  ConvexShape<Scalar> shape;
  BodyKind kind;
  Scalar mass, lightness, friction, restitution;
  Matrix3<Scalar> inertia, inverse;
  CollisionGroups groups;
  bool may_sleep;
  std::unique_ptr<MovingShape<Scalar>> moving;
};

/// An obstacle.
template <RealScalar Scalar>
struct RigidObstacle {
  ColliderRef<Scalar> collider;
  Scalar restitution;
  CollisionGroups groups;
};

/// Bodies, obstacles, joints, their state, and the memory of a step.
template <RealScalar Scalar>
struct RigidWorld {
  using Contact = RigidContact<Scalar>;
  using State = RigidBodiesState<Scalar>;
  using Joint = JointState<Scalar>;

  explicit RigidWorld(const RigidBodiesSettings<Scalar>& s)
      : settings(s), valid(s.validate().empty()) {}

  Result<int> add(const RigidBodySetup<Scalar>& setup);
  Result<int> add_obstacle(const ColliderRef<Scalar>& collider, const Scalar& restitution,
                           const CollisionGroups& groups);
  Result<int> add_joint(const RigidJointSetup<Scalar>& setup);
  void reserve(std::size_t contacts);
  std::string set_motion(int n, const RigidMotion<Scalar>& motion);
  bool is_held(int n, const Vector3<Scalar>& v, const Vector3<Scalar>& w) const;
  bool apply_impulse(int n, const Vector3<Scalar>& impulse, const Vector3<Scalar>& point);
  void wake(int n);
  bool restore(const State& from);

  StepStatus predict(const Scalar& dt);
  void solve(const ExecutorRef& executor);
  RigidStepReport<Scalar> finish();

  const RigidBodyData<Scalar>& body(int n) const {
    assert(n >= 0 && n < count());
    return bodies[static_cast<std::size_t>(n)];
  }
  typename State::Body& body_state(int n) { return state.bodies[static_cast<std::size_t>(n)]; }
  const typename State::Body& body_state(int n) const {
    assert(n >= 0 && n < count());
    return state.bodies[static_cast<std::size_t>(n)];
  }
  Matrix3<Scalar> inverse_inertia(int n) const {
    const Matrix3<Scalar>& R = body_state(n).motion.R_world_body;
    const Matrix3<Scalar> turned = R * body(n).inverse;
    return turned * R.transpose();
  }
  int count() const { return static_cast<int>(bodies.size()); }
  /// Whether impulses move a body.
  bool free(int n) const { return n >= 0 && body(n).kind == BodyKind::Free; }
  /// Whether a body is awake and impulses move it.
  bool active(int n) const { return free(n) && body_state(n).asleep < 0; }
  /// Whether a body that no impulse moves moves nevertheless.
  bool driven(int n) const {
    if (n < 0 || free(n)) return false;
    if (jumped_[static_cast<std::size_t>(n)] != 0) return true;
    const RigidMotion<Scalar>& m = body_state(n).motion;
    return Scalar(0) < m.velocity.squaredNorm() + m.angular_velocity.squaredNorm();
  }
  /// How fast the fastest point of a body may be, m/s.
  Scalar speed(int n) const {
    const RigidMotion<Scalar>& m = body_state(n).motion;
    return length_of<Scalar>(m.velocity) +
           body(n).shape.outer_radius() * length_of<Scalar>(m.angular_velocity);
  }

  RigidBodiesSettings<Scalar> settings;
  bool valid;
  std::vector<RigidBodyData<Scalar>> bodies;
  std::vector<RigidObstacle<Scalar>> obstacles;
  std::vector<Joint> joints;
  std::vector<BoxPair> apart;  // pairs of bodies that a joint keeps from colliding
  State state;
  std::vector<RigidEvent> events;

 private:
  static constexpr int kLanes = 4;

  void load();
  void find_boxes();
  bool wanted(int i, int j) const;
  Scalar margin(int i) const;
  BodyContacts<Scalar> touch(int i, int j) const;
  void wake_touched();
  void find_contacts();
  void add_contacts(int i, int j);
  void group();
  void solve_lane(int lane);
  void move(int n);
  Scalar free_share(int n) const;
  Scalar first_impact(int n, const ColliderRef<Scalar>& other,
                      const BoundingBox<Scalar>& box) const;
  bool finite() const;
  void fall_asleep(int island);
  void note_contacts();
  void count_energy(RigidStepReport<Scalar>& report) const;

  Scalar h_ = Scalar(0);
  bool woken_ = false;
  std::vector<char> jumped_;  // bodies that were given another pose before this step
  std::size_t reported_ = 0;  // events that the last step reported
  std::vector<typename State::Body> before_;
  std::vector<SolverBody<Scalar>> solver_;
  std::vector<BoundingBox<Scalar>> boxes_;
  BroadPhase<Scalar> broad_;
  ContactMemory<Scalar> memory_;
  std::vector<Contact> next_;
  RigidIslands islands_;
  std::vector<int> lane_;
  std::vector<IslandReport<Scalar>> reports_;
  std::vector<BoxPair> touching_, touched_;
  std::array<IslandSolver<Scalar>, static_cast<std::size_t>(kLanes)> solvers_;
};

template <RealScalar Scalar>
Result<int> RigidWorld<Scalar>::add(const RigidBodySetup<Scalar>& setup) {
  const int n = count();
  const std::string name = "body " + std::to_string(n) + " has ";
  const std::string bad = setup.validate();
  if (!bad.empty()) return Error{name + bad};
  RigidBodyData<Scalar> data{setup.shape,    setup.kind,        setup.mass, Scalar(0),
                             setup.friction, setup.restitution, {},         {},
                             setup.groups,   setup.may_sleep,   nullptr};
  data.inverse.setConstant(Scalar(0));
  data.inertia.setConstant(Scalar(0));
  const bool moves = setup.kind == BodyKind::Free;
  if (moves) {
    const Scalar volume = setup.shape.volume();
    if (!(Scalar(0) < data.mass)) data.mass = setup.density * volume;
    if (!is_finite(data.mass) || !(Scalar(0) < data.mass) || is_unbounded(data.mass))
      return Error{name + "the mass " + number_text(data.mass) + " kg of its density"};
    data.inertia = (data.mass / volume) * setup.shape.unit_inertia();
    if (!invert_inertia<Scalar>(data.inertia, data.inverse))
      return Error{name + "an inertia that is not positive to rounding"};
    data.lightness = Scalar(1) / data.mass;
  } else {
    data.mass = Scalar(0);
  }
  typename State::Body now;
  now.motion = setup.motion;
  now.motion.R_world_body = orthonormal_rotation<Scalar>(setup.motion.R_world_body);
  if (setup.kind == BodyKind::Pinned) {
    now.motion.velocity.setConstant(Scalar(0));
    now.motion.angular_velocity.setConstant(Scalar(0));
  }
  Result<MovingShape<Scalar>> moving =
      MovingShape<Scalar>::create(setup.shape, now.motion, {setup.friction, n});
  if (!moving) return Error{name + moving.error()};
  data.moving = std::make_unique<MovingShape<Scalar>>(std::move(*moving));
  bodies.push_back(std::move(data));
  state.bodies.push_back(now);
  before_.reserve(bodies.capacity());
  jumped_.push_back(0);
  solver_.resize(bodies.size());
  boxes_.resize(bodies.size() + obstacles.size());
  reserve(8 * bodies.size());
  return n;
}

template <RealScalar Scalar>
Result<int> RigidWorld<Scalar>::add_obstacle(const ColliderRef<Scalar>& collider,
                                             const Scalar& restitution,
                                             const CollisionGroups& groups) {
  const int k = static_cast<int>(obstacles.size());
  const std::string bad = validate_within<Scalar>("restitution", restitution, Scalar(0), Scalar(1));
  if (!bad.empty()) return Error{"obstacle " + std::to_string(k) + " has " + bad};
  obstacles.push_back({collider, restitution, groups});
  boxes_.resize(bodies.size() + obstacles.size());
  return k;
}

template <RealScalar Scalar>
Result<int> RigidWorld<Scalar>::add_joint(const RigidJointSetup<Scalar>& setup) {
  const std::string name = "joint " + std::to_string(joints.size()) + " has ";
  const int n = count();
  if (setup.a < 0 || setup.a >= n || setup.b < -1 || setup.b >= n || setup.a == setup.b)
    return Error{name + "the bodies " + std::to_string(setup.a) + " and " +
                 std::to_string(setup.b) + ", of " + std::to_string(n)};
  if (!free(setup.a) && !free(setup.b)) return Error{name + "no body that is free"};
  std::string bad = validate_point<Scalar>("anchor", setup.anchor);
  if (bad.empty()) bad = validate_point<Scalar>("axis", setup.axis);
  const Scalar length = length_of<Scalar>(setup.axis);
  if (bad.empty() && setup.kind == JointKind::Hinge)
    bad = validate_size<Scalar>("axis of length", length);
  if (bad.empty())
    bad = validate_within<Scalar>("compliance", setup.compliance, Scalar(0), Scalar(1e15));
  if (!bad.empty()) return Error{name + bad};
  const RigidMotion<Scalar> world;
  const RigidMotion<Scalar>& A = body_state(setup.a).motion;
  const RigidMotion<Scalar>& B = setup.b < 0 ? world : body_state(setup.b).motion;
  Joint j;
  j.kind = setup.kind;
  j.a = setup.a;
  j.b = setup.b;
  j.compliance = setup.compliance;
  j.anchor_a = A.R_world_body.transpose() * Vector3<Scalar>(setup.anchor - A.position);
  j.anchor_b = B.R_world_body.transpose() * Vector3<Scalar>(setup.anchor - B.position);
  const Vector3<Scalar> axis = unit_or_zero<Scalar>(setup.axis);
  j.axis_a = A.R_world_body.transpose() * axis;
  j.axis_b = B.R_world_body.transpose() * axis;
  j.R_a_b = A.R_world_body.transpose() * B.R_world_body;
  joints.push_back(j);
  state.joints.push_back(j.impulse);
  if (!setup.collide && setup.b >= 0) {
    apart.push_back({(std::min)(setup.a, setup.b), (std::max)(setup.a, setup.b)});
    std::sort(apart.begin(), apart.end());
  }
  wake(setup.a);
  wake(setup.b);
  reserve(8 * bodies.size());
  return static_cast<int>(joints.size()) - 1;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::reserve(std::size_t contacts) {
  contacts = (std::max)(contacts, state.contacts.capacity());
  state.contacts.reserve(contacts);
  next_.reserve(contacts);
  memory_.reserve(contacts);
  events.reserve(2 * contacts + bodies.size());
  touching_.reserve(contacts);
  touched_.reserve(contacts);
  broad_.reserve(bodies.size() + obstacles.size() + 64, 4 * contacts);
  islands_.reserve(bodies.size(), contacts, joints.size());
  lane_.reserve(bodies.size());
  reports_.reserve(bodies.size());
  Index rows = kJointRows;
  for (const Joint& j : joints) rows += j.rows();
  if (rows > 192) rows = 192;
  const Index room = valid ? Index(settings.newton_contacts) : Index(0);
  for (IslandSolver<Scalar>& s : solvers_) s.reserve(room, rows, contacts);
}

template <RealScalar Scalar>
std::string RigidWorld<Scalar>::set_motion(int n, const RigidMotion<Scalar>& motion) {
  if (n < 0 || n >= count()) return missing_item_line("body", n, count());
  const std::string bad = motion.validate();
  if (!bad.empty()) return "body " + std::to_string(n) + " has " + bad;
  RigidMotion<Scalar> now = motion;
  now.R_world_body = orthonormal_rotation<Scalar>(motion.R_world_body);
  if (body(n).kind == BodyKind::Pinned) {
    now.velocity.setConstant(Scalar(0));
    now.angular_velocity.setConstant(Scalar(0));
  }
  wake(n);
  for (const Contact& c : state.contacts) {  // what it leaves has to notice
    if (c.b == n) wake(c.a);
    if (c.a == n) wake(c.b);
  }
  body_state(n).motion = now;
  jumped_[static_cast<std::size_t>(n)] = 1;
  std::string moved = bodies[static_cast<std::size_t>(n)].moving->set_motion(now);
  assert(moved.empty());
  return moved;
}

template <RealScalar Scalar>
bool RigidWorld<Scalar>::is_held(int n, const Vector3<Scalar>& v, const Vector3<Scalar>& w) const {
  for (const Joint& j : joints) {
    if (j.a == n || j.b == n) return true;
  }
  for (const Contact& c : state.contacts) {
    if ((c.a != n && c.b != n) || !(c.touches() || c.gap <= Scalar(0))) continue;
    // The normal points to a.
    const Vector3<Scalar> arm = c.position - body_state(n).motion.position;
    const Scalar leaves = c.sample.normal.dot(Vector3<Scalar>(v + w.cross(arm)));
    if (c.a == n ? leaves < Scalar(0) : Scalar(0) < leaves) return true;
  }
  return false;
}

template <RealScalar Scalar>
bool RigidWorld<Scalar>::apply_impulse(int n, const Vector3<Scalar>& impulse,
                                       const Vector3<Scalar>& point) {
  if (!all_finite(impulse) || !all_finite(point)) return false;
  if (!free(n)) return true;
  wake(n);
  RigidMotion<Scalar>& m = body_state(n).motion;
  const Vector3<Scalar> r = point - m.position;
  const Vector3<Scalar> v = m.velocity + body(n).lightness * impulse;
  const Vector3<Scalar> moment = r.cross(impulse);
  const Vector3<Scalar> w = m.angular_velocity + inverse_inertia(n) * moment;
  if (!all_finite(v) || !all_finite(w)) return false;
  m.velocity = v;
  m.angular_velocity = w;
  return true;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::wake(int n) {
  if (n < 0) return;
  const int label = body_state(n).asleep;
  body_state(n).still = Scalar(0);
  if (label < 0) return;
  for (int i = 0; i < count(); ++i) {
    typename State::Body& b = body_state(i);
    if (b.asleep != label) continue;
    b.asleep = -1;
    b.still = Scalar(0);
    woken_ = true;
    events.push_back({RigidEventKind::Woke, i, -1});
  }
}

template <RealScalar Scalar>
Scalar RigidWorld<Scalar>::margin(int i) const {
  // Contacts are looked for as far as bodies may come in the step, at most half the inner radius;
  // farther is for the sweep.
  const Scalar reach = Scalar(0.5) * body(i).shape.inner_radius();
  const Scalar way = h_ * speed(i);
  return Scalar(0.02) * body(i).shape.inner_radius() + (way < reach ? way : reach);
}

template <RealScalar Scalar>
bool RigidWorld<Scalar>::restore(const State& from) {
  if (from.bodies.size() != bodies.size() || from.joints.size() != joints.size()) return false;
  state = from;
  for (std::size_t k = 0; k < joints.size(); ++k) joints[k].impulse = from.joints[k];
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const std::string bad = bodies[i].moving->set_motion(from.bodies[i].motion);
    if (!bad.empty()) return false;
    const RigidMotion<Scalar>& m = from.bodies[i].motion;
    const int n = static_cast<int>(i);
    boxes_[i] = body(n).shape.bounds(m.R_world_body, m.position).grown(margin(n));
  }
  std::fill(jumped_.begin(), jumped_.end(), char(0));
  touching_.clear();
  for (const Contact& c : state.contacts) {
    if (c.touches() && (touching_.empty() || touching_.back() != BoxPair(c.a, c.b)))
      touching_.push_back({c.a, c.b});
  }
  events.clear();
  reported_ = 0;
  woken_ = true;
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
