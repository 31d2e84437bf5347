#pragma once

// The three parts of a step of rigid bodies (rigid_bodies.hpp): predict, solve and finish.

#include <algorithm>
#include <cstddef>

#include "clothctl/sim/detail/rigid_world.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

template <RealScalar Scalar>
StepStatus RigidWorld<Scalar>::predict(const Scalar& dt) {
  if (!valid || !is_finite(dt) || !(Scalar(0) < dt) || is_unbounded(dt))
    return StepStatus::InvalidInput;
  h_ = dt;
  events.erase(events.begin(), events.begin() + static_cast<std::ptrdiff_t>(reported_));
  reported_ = 0;
  before_ = state.bodies;
  for (int i = 0; i < count(); ++i) {
    if (active(i)) body_state(i).motion.velocity += dt * settings.gravity;
  }
  find_contacts();
  group();
  return StepStatus::Converged;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::find_boxes() {
  const std::size_t n = bodies.size();
  for (int i = 0; i < count(); ++i) {
    if (free(i) && !active(i)) continue;  // as it was when it fell asleep
    const RigidMotion<Scalar>& m = body_state(i).motion;
    boxes_[static_cast<std::size_t>(i)] =
        body(i).shape.bounds(m.R_world_body, m.position).grown(margin(i));
  }
  for (std::size_t k = 0; k < obstacles.size(); ++k)
    boxes_[n + k] = obstacles[k].collider.bounds(h_);
}

template <RealScalar Scalar>
bool RigidWorld<Scalar>::wanted(int i, int j) const {
  if (i >= count()) return false;
  if (j >= count()) {
    const CollisionGroups& groups = obstacles[static_cast<std::size_t>(j - count())].groups;
    return active(i) && body(i).groups.meets(groups);
  }
  const bool some = active(i) || active(j);
  const bool wakes = (driven(i) && free(j)) || (driven(j) && free(i));
  if (!(some || wakes) || !body(i).groups.meets(body(j).groups)) return false;
  return !std::binary_search(apart.begin(), apart.end(), BoxPair(i, j));
}

template <RealScalar Scalar>
BodyContacts<Scalar> RigidWorld<Scalar>::touch(int i, int j) const {
  const RigidMotion<Scalar>& A = body_state(i).motion;
  if (j >= count()) {
    const RigidObstacle<Scalar>& o = obstacles[static_cast<std::size_t>(j - count())];
    return find_collider_contacts<Scalar>(body(i).shape, A.R_world_body, A.position, o.collider,
                                          margin(i));
  }
  const RigidMotion<Scalar>& B = body_state(j).motion;
  const Scalar reach = margin(i) + margin(j);
  return find_body_contacts<Scalar>(body(i).shape, A.R_world_body, A.position, body(j).shape,
                                    B.R_world_body, B.position, reach);
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::wake_touched() {
  const auto want = [this](int i, int j) { return wanted(i, j); };
  for (bool again = true; again;) {
    again = false;
    for (const BoxPair& p : broad_.find(boxes_, want)) {
      if (p.second >= count()) continue;
      const bool asleep_a = free(p.first) && !active(p.first);
      const bool asleep_b = free(p.second) && !active(p.second);
      const bool wakes_a = asleep_a && (active(p.second) || driven(p.second));
      const bool wakes_b = asleep_b && (active(p.first) || driven(p.first));
      if ((!wakes_a && !wakes_b) || touch(p.first, p.second).count == 0) continue;
      wake(wakes_a ? p.first : p.second);
      again = true;
    }
  }
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::find_contacts() {
  find_boxes();
  wake_touched();
  next_.clear();
  memory_.start(state.contacts);
  // Contacts of bodies that are asleep stay as they are.
  const auto keep = [this](const Contact& c) {
    const bool sleeps = (free(c.a) && !active(c.a)) || (free(c.b) && !active(c.b));
    if (sleeps) next_.push_back(c);
  };
  for (const BoxPair& p : broad_.pairs()) {
    if (!active(p.first) && (p.second >= count() || !active(p.second))) continue;
    const int b = p.second < count() ? p.second : -1 - (p.second - count());
    memory_.go_to(p.first, b, keep);
    add_contacts(p.first, p.second);
  }
  memory_.go_to(count(), 0, keep);
  state.contacts.swap(next_);
  woken_ = false;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::add_contacts(int i, int j) {
  using std::sqrt;
  const BodyContacts<Scalar> found = touch(i, j);
  const std::size_t first = next_.size();
  const bool obstacle = j >= count();
  const std::size_t k = obstacle ? static_cast<std::size_t>(j - count()) : std::size_t(0);
  for (int p = 0; p < found.count; ++p) {
    const BodyContactPoint<Scalar>& point = found.points[static_cast<std::size_t>(p)];
    Contact c;
    c.a = i;
    c.b = obstacle ? -1 - static_cast<int>(k) : j;
    c.age = -1;
    c.position = point.position;
    c.feature = point.feature;
    c.gap = point.gap;
    c.sample.normal = point.normal;
    c.sample.drift = point.drift;
    c.sample.friction = sqrt(body(i).friction * (obstacle ? point.friction : body(j).friction));
    const Scalar other = obstacle ? obstacles[k].restitution : body(j).restitution;
    c.restitution = body(i).restitution < other ? other : body(i).restitution;
    next_.push_back(c);
  }
  if (found.count == 0) return;
  memory_.remember(&next_[first], found.count,
                   Scalar(0.05) * body(i).shape.inner_radius() + h_ * speed(i));
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::group() {
  islands_.clear(count());
  for (const Contact& c : state.contacts) {
    if (active(c.a) && c.b >= 0 && active(c.b)) islands_.join(c.a, c.b);
  }
  for (const Joint& j : joints) {
    if (active(j.a) && active(j.b)) islands_.join(j.a, j.b);
  }
  const auto mover = [this](int a, int b) { return active(a) ? a : (active(b) ? b : -1); };
  islands_.build([this](int i) { return active(i); }, static_cast<int>(state.contacts.size()),
                 [&](int i) {
                   const Contact& c = state.contacts[static_cast<std::size_t>(i)];
                   return mover(c.a, c.b);
                 },
                 static_cast<int>(joints.size()),
                 [&](int i) {
                   const Joint& j = joints[static_cast<std::size_t>(i)];
                   return mover(j.a, j.b);
                 });
  // Islands are dealt out to lanes by their work, so that each lane has its own memory.
  std::array<double, static_cast<std::size_t>(kLanes)> load{};
  lane_.resize(static_cast<std::size_t>(islands_.count()));
  for (int k = 0; k < islands_.count(); ++k) {
    const double c = static_cast<double>(islands_.contacts(k).size());
    const std::size_t least =
        static_cast<std::size_t>(std::min_element(load.begin(), load.end()) - load.begin());
    load[least] += 1 + c + (c <= settings.newton_contacts ? c * c * c / 100 : 30 * c);
    lane_[static_cast<std::size_t>(k)] = static_cast<int>(least);
  }
  reports_.assign(lane_.size(), {});
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::load() {
  for (int i = 0; i < count(); ++i) {
    const RigidMotion<Scalar>& m = body_state(i).motion;
    SolverBody<Scalar>& s = solver_[static_cast<std::size_t>(i)];
    const bool moves = active(i);
    s.lightness = moves ? body(i).lightness : Scalar(0);
    if (moves)
      s.inverse = inverse_inertia(i);
    else
      s.inverse.setConstant(Scalar(0));
    s.x = m.position;
    s.v = m.velocity;
    s.w = m.angular_velocity;
  }
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::solve(const ExecutorRef& executor) {
  if (woken_) {  // by an impulse after the prediction
    find_contacts();
    group();
  }
  load();
  const auto run = [this](int lane) { solve_lane(lane); };
  executor.for_each_block(kLanes, run);
  for (int i = 0; i < count(); ++i) {
    if (!active(i)) continue;
    body_state(i).motion.velocity = solver_[static_cast<std::size_t>(i)].v;
    body_state(i).motion.angular_velocity = solver_[static_cast<std::size_t>(i)].w;
  }
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::solve_lane(int lane) {
  const Scalar falls = Scalar(2) * h_ * length_of<Scalar>(settings.gravity);
  const IslandRules<Scalar> rules{h_,
                                  settings.relaxation,
                                  settings.stiffness,
                                  settings.push_speed,
                                  settings.bounce_speed < falls ? falls : settings.bounce_speed,
                                  settings.velocity_tolerance,
                                  settings.newton_contacts,
                                  192,
                                  settings.sweeps};
  const SolverBody<Scalar> world;
  for (int k = 0; k < islands_.count(); ++k) {
    if (lane_[static_cast<std::size_t>(k)] != lane) continue;
    Scalar heaviest(0);
    for (const int i : islands_.bodies(k)) {
      if (heaviest < body(i).mass) heaviest = body(i).mass;
    }
    for (const int n : islands_.joints(k)) {
      Joint& j = joints[static_cast<std::size_t>(n)];
      const SolverBody<Scalar>& B = j.b < 0 ? world : solver_[static_cast<std::size_t>(j.b)];
      const Matrix3<Scalar> R_b =
          j.b < 0 ? Matrix3<Scalar>::Identity() : body_state(j.b).motion.R_world_body;
      j.update(solver_[static_cast<std::size_t>(j.a)], body_state(j.a).motion.R_world_body, B, R_b,
               h_, settings.relaxation, settings.push_speed * h_ / settings.relaxation);
    }
    if (islands_.contacts(k).empty() && islands_.joints(k).empty()) continue;
    reports_[static_cast<std::size_t>(k)] = solvers_[static_cast<std::size_t>(lane)].solve(
        rules, heaviest, islands_.contacts(k), islands_.joints(k), solver_, state.contacts, joints);
  }
}

template <RealScalar Scalar>
RigidStepReport<Scalar> RigidWorld<Scalar>::finish() {
  RigidStepReport<Scalar> report;
  for (int i = 0; i < count(); ++i) {
    if (active(i) || driven(i)) move(i);
  }
  if (!finite()) {
    state.bodies = before_;
    for (Contact& c : state.contacts) c.sample.impulse.setConstant(Scalar(0));
    for (Joint& j : joints) j.impulse.setConstant(Scalar(0));
    report.status = StepStatus::NumericalFailure;
    return report;
  }
  for (int i = 0; i < count(); ++i) {
    if (!active(i) && !driven(i)) continue;
    const std::string bad =
        bodies[static_cast<std::size_t>(i)].moving->set_motion(body_state(i).motion);
    assert(bad.empty());
    static_cast<void>(bad);
  }
  for (int k = 0; k < islands_.count(); ++k) fall_asleep(k);
  for (std::size_t k = 0; k < joints.size(); ++k) state.joints[k] = joints[k].impulse;
  note_contacts();
  reported_ = events.size();
  std::fill(jumped_.begin(), jumped_.end(), char(0));
  report.advanced = true;
  report.contacts = static_cast<int>(state.contacts.size());
  report.islands = islands_.count();
  for (const IslandReport<Scalar>& r : reports_) {
    if (!r.solved) ++report.unsolved;
    report.newton_steps += r.newton_steps;
    report.sweeps += r.sweeps;
    if (report.force_residual < r.force) report.force_residual = r.force;
    if (report.velocity_residual < r.velocity) report.velocity_residual = r.velocity;
  }
  if (report.unsolved > 0) report.status = StepStatus::IterationLimit;
  count_energy(report);
  return report;
}

template <RealScalar Scalar>
Scalar RigidWorld<Scalar>::first_impact(int n, const ColliderRef<Scalar>& other,
                                        const BoundingBox<Scalar>& box) const {
  const RigidMotion<Scalar>& m = body_state(n).motion;
  const Vector3<Scalar> end = m.position + h_ * m.velocity;
  BoundingBox<Scalar> way{m.position, m.position};
  way.include(end);
  const Scalar radius = Scalar(0.5) * body(n).shape.inner_radius();
  if (!all_finite(end) || !way.grown(radius).overlaps(box)) return no_impact<Scalar>();
  const Scalar t = sweep_of<Scalar>(other, m.position, end, radius, h_);
  // What overlaps that much from the start is for the contacts.
  return Scalar(0) < t ? t : no_impact<Scalar>();
}

template <RealScalar Scalar>
Scalar RigidWorld<Scalar>::free_share(int n) const {
  const RigidMotion<Scalar>& m = body_state(n).motion;
  const Scalar way = h_ * length_of<Scalar>(m.velocity);
  if (!settings.continuous || !free(n) || !(Scalar(0.5) * body(n).shape.inner_radius() < way))
    return Scalar(1);
  Scalar first(1);
  const auto take = [&](const ColliderRef<Scalar>& other) {
    const Scalar t = first_impact(n, other, other.bounds(h_));
    if (t < first) first = t;
  };
  for (int j = 0; j < count(); ++j) {
    if (j == n || !body(n).groups.meets(body(j).groups)) continue;
    const BoxPair pair((std::min)(n, j), (std::max)(n, j));
    if (!std::binary_search(apart.begin(), apart.end(), pair)) take(body(j).moving->collider());
  }
  for (const RigidObstacle<Scalar>& o : obstacles) {
    if (body(n).groups.meets(o.groups)) take(o.collider);
  }
  return first;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::move(int n) {
  RigidMotion<Scalar>& m = body_state(n).motion;
  const Scalar share = free_share(n);
  m.position += (share * h_) * m.velocity;
  if (free(n)) {
    rotate_freely<Scalar>(body(n).inertia, body(n).inverse, h_, m.R_world_body, m.angular_velocity);
  } else {
    const Vector3<Scalar> turn = h_ * m.angular_velocity;
    m.R_world_body = rotation_exp<Scalar>(turn) * m.R_world_body;
  }
  m.R_world_body = orthonormal_rotation<Scalar>(m.R_world_body);
}

template <RealScalar Scalar>
bool RigidWorld<Scalar>::finite() const {
  for (const typename State::Body& b : state.bodies) {
    const RigidMotion<Scalar>& m = b.motion;
    if (!all_finite(m.position) || !all_finite(m.R_world_body) || !all_finite(m.velocity) ||
        !all_finite(m.angular_velocity) || !m.validate().empty())
      return false;
  }
  return true;
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::fall_asleep(int island) {
  bool still = Scalar(0) < settings.sleep_time;
  for (const int i : islands_.bodies(island)) {
    typename State::Body& b = body_state(i);
    b.still = speed(i) < settings.sleep_speed ? Scalar(b.still + h_) : Scalar(0);
    still = still && body(i).may_sleep && !(b.still < settings.sleep_time);
  }
  if (!still) return;
  for (const int k : islands_.contacts(island)) {
    const Contact& c = state.contacts[static_cast<std::size_t>(k)];
    if (driven(c.a) || driven(c.b) || Scalar(0) < c.sample.drift.squaredNorm()) return;
  }
  for (const int k : islands_.joints(island)) {
    const Joint& j = joints[static_cast<std::size_t>(k)];
    if (driven(j.a) || driven(j.b)) return;
  }
  const int label = islands_.bodies(island).front();
  for (const int i : islands_.bodies(island)) {
    typename State::Body& b = body_state(i);
    b.asleep = label;
    b.motion.velocity.setConstant(Scalar(0));
    b.motion.angular_velocity.setConstant(Scalar(0));
    bodies[static_cast<std::size_t>(i)].moving->set_motion(b.motion);
    boxes_[static_cast<std::size_t>(i)] =
        body(i).shape.bounds(b.motion.R_world_body, b.motion.position).grown(margin(i));
    events.push_back({RigidEventKind::Slept, i, -1});
  }
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::note_contacts() {
  touched_.swap(touching_);
  touching_.clear();
  for (const Contact& c : state.contacts) {
    const BoxPair pair(c.a, c.b);
    if (c.touches() && (touching_.empty() || touching_.back() != pair)) touching_.push_back(pair);
  }
  std::size_t i = 0, j = 0;
  while (i < touched_.size() || j < touching_.size()) {
    const bool ended =
        j == touching_.size() || (i < touched_.size() && pair_before(touched_[i], touching_[j]));
    const bool began = !ended && (i == touched_.size() || pair_before(touching_[j], touched_[i]));
    if (ended)
      events.push_back({RigidEventKind::ContactEnded, touched_[i].first, touched_[i].second});
    if (began)
      events.push_back({RigidEventKind::ContactBegan, touching_[j].first, touching_[j].second});
    if (!began) ++i;
    if (!ended) ++j;
  }
}

template <RealScalar Scalar>
void RigidWorld<Scalar>::count_energy(RigidStepReport<Scalar>& report) const {
  for (int i = 0; i < count(); ++i) {
    if (!free(i)) continue;
    if (!active(i)) ++report.asleep;
    const RigidMotion<Scalar>& m = body_state(i).motion;
    const Vector3<Scalar> spin = m.R_world_body.transpose() * m.angular_velocity;
    const Vector3<Scalar> L = body(i).inertia * spin;
    report.kinetic += Scalar(0.5) * (body(i).mass * m.velocity.squaredNorm() + spin.dot(L));
    report.potential -= body(i).mass * settings.gravity.dot(m.position);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
