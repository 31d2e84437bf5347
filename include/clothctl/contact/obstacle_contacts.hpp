#pragma once

// The contacts of one sheet with obstacles: colliders whose motion is given for the step. Three
// parts of a step:
//
//   update   lists the points of the sheet that may touch within the step: vertices, and points
//            inside edges and triangles (collision/sheet_contacts.hpp), at most a margin from a
//            surface. The margin is the way that sheet and obstacles can go in the step.
//   step     of the model (MassSpring, PositionBased) keeps these points on their side of the
//            surface, with Coulomb friction, and writes impulse and state of each
//   update   of the next step finds the contacts again that stay, by the vertices that carry them,
//            and gives them the force of the last step to start from
//
// A contact that is listed with a gap closes within the step, so that nothing passes through a
// thin or fast obstacle. Restitution is 0.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/sheet_contacts.hpp"
#include "clothctl/contact/detail/contact_sample.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a sheet meets obstacles.
template <RealScalar Scalar>
struct ObstacleContactSettings {
  /// Distance of the sheet's middle surface from a surface that it touches, m.
  Scalar thickness = Scalar(1e-3);
  /// Largest distance at which contacts are listed, m. Where a step may go farther, a vertex may
  /// pass through the obstacle, and `complete` says so.
  Scalar reach = Scalar(0.2);
  /// A point that starts a step too deep is pushed out at most this fast, m/s.
  Scalar push_out_speed = Scalar(0.5);

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(thickness) || thickness < Scalar(0))
      return "the thickness " + number_text(thickness) + " m, must be finite and not negative";
    if (!is_finite(reach) || !(thickness < reach))
      return "the reach " + number_text(reach) + " m, must be finite and above the thickness";
    if (!is_finite(push_out_speed) || !(Scalar(0) < push_out_speed))
      return "the push-out speed " + number_text(push_out_speed) +
             " m/s, must be finite and positive";
    return {};
  }
};

/// A point of a sheet that touches an obstacle, or may within the step.
template <RealScalar Scalar>
struct ObstacleContact {
  /// Where it is on the sheet at the start of the step, and the obstacle's surface there.
  SheetContact<Scalar> point;
  /// The obstacle's place in the list of the update.
  int obstacle = 0;
  /// The impulse on the sheet, N s. Before a step that of the last one, scaled to the new step
  /// length; after it the answer. The obstacle received the opposite.
  Vector3<Scalar> impulse = Vector3<Scalar>::Constant(Scalar(0));
  /// The way on the surface from where it stuck, m. A model whose friction has another memory
  /// leaves it 0.
  Vector3<Scalar> offset = Vector3<Scalar>::Constant(Scalar(0));
  /// The part of the normal force that the next step starts from, N. A model that has no use for it
  /// leaves it 0.
  Scalar carried = Scalar(0);
  /// What it did in the last step.
  ContactState state = ContactState::Open;
  /// Number of steps that it has been closed for.
  int age = 0;
};

/// What a step did at its contacts.
template <RealScalar Scalar>
struct ObstacleContactReport {
  /// Contacts that transmit a force, and those of them that slip.
  Index closed = 0, slipping = 0;
  /// Largest depth below the thickness at the end of the step, m; 0 if none.
  Scalar penetration = Scalar(0);
  /// Largest violation of the laws of contact and friction, as a force (N) and as the velocity
  /// (m/s) that it gives the point; 0 where the model solves one contact after the other.
  Scalar force_residual = Scalar(0), velocity_residual = Scalar(0);
  /// Solves of the step, or iterations of Newton's method; 0 where the model solves one contact
  /// after the other.
  int rounds = 0;
};

/// Lists the contacts of a sheet with obstacles, and remembers them from step to step. `create`
/// allocates; nothing else does.
template <RealScalar Scalar>
class ObstacleContacts {
 public:
  /// The settings.
  using Settings = ObstacleContactSettings<Scalar>;
  /// The obstacles of a step.
  using Obstacles = std::span<const ColliderRef<Scalar>>;

  /// Makes room for `capacity` contacts. Allocates. Fails when: `settings.validate()` does, or
  /// `capacity` is negative.
  static Result<ObstacleContacts> create(Index capacity, const Settings& settings = {}) {
    if (const std::string bad = settings.validate(); !bad.empty())
      return Error{"the contacts with obstacles have " + bad};
    if (capacity < 0) return Error{"room for " + std::to_string(capacity) + " contacts"};
    return ObstacleContacts(static_cast<std::size_t>(capacity), settings);
  }

  /// Lists the contacts of a step of `dt` (s) from the finder's positions with the `velocities`
  /// (3×n, m/s). The obstacles must stay until the step is made. InvalidArgument: dt is not
  /// positive or not finite, another number of vertices, or an obstacle did not answer.
  /// InvalidPoint: a velocity is not finite. There are no contacts then, and those of the last step
  /// are forgotten.
  QueryStatus update(Obstacles obstacles, const PointsView<Scalar>& velocities, const Scalar& dt,
                     SheetContactFinder<Scalar>& finder);

  /// The contacts, obstacle by obstacle. The same input gives the same order.
  std::span<ObstacleContact<Scalar>> contacts() { return contacts_; }
  /// The contacts.
  std::span<const ObstacleContact<Scalar>> contacts() const { return contacts_; }
  /// The number of contacts that there is room for.
  std::size_t capacity() const { return contacts_.capacity(); }
  /// False when the last update found more contacts than there was room for, or sheet and obstacle
  /// can get farther in the step than `reach`.
  bool complete() const { return complete_; }
  /// True when a contact was closed in the last step.
  bool any_closed() const { return !memory_.empty(); }
  /// The settings.
  const Settings& settings() const { return settings_; }
  /// The collider of a contact.
  const ColliderRef<Scalar>& obstacle(const ObstacleContact<Scalar>& contact) const {
    return obstacles_[static_cast<std::size_t>(contact.obstacle)];
  }
  /// Returns what the collider of a contact answers about a point (m), now.
  SurfacePoint<Scalar> surface_at(const ObstacleContact<Scalar>& contact,
                                  const Vector3<Scalar>& x) const {
    SurfacePoint<Scalar> out;
    const Eigen::Map<const Points<Scalar>> point(x.data(), 3, 1);
    const std::span<SurfacePoint<Scalar>> answers(&out, 1);
    if (obstacle(contact).closest(point, answers) != QueryStatus::Answered) return {};
    return out;
  }
  /// The step length of the last update, s; 0 before the first.
  const Scalar& step_length() const { return dt_; }

  /// What the last step did; written by the model that made it.
  ObstacleContactReport<Scalar>& report() { return report_; }
  /// What the last step did.
  const ObstacleContactReport<Scalar>& report() const { return report_; }

  /// Takes contacts that were listed for this step (`contacts` after `update`), as to make the step
  /// again, perhaps with other velocities of the surface. What there is no room for is left out.
  void set_contacts(std::span<const ObstacleContact<Scalar>> list) {
    if (contacts_.capacity() < list.size()) list = list.first(contacts_.capacity());
    contacts_.assign(list.begin(), list.end());
    report_ = {};
  }
  /// Adds an impulse (N s) on the sheet to the contact of an obstacle at the vertices of `point`,
  /// which is added if there is none. Returns false where there is no room for it.
  bool add(const SheetContact<Scalar>& point, int obstacle, const Vector3<Scalar>& impulse);

  /// Returns the largest speed of an obstacle's surface near three points of a sheet (3×n, m), m/s.
  static Scalar surface_speed(const ColliderRef<Scalar>& obstacle, const PointsView<Scalar>& x);
  /// Returns whether contacts of a step of `dt` s are listed far enough where sheet and obstacle
  /// approach each other with `speed` (m/s).
  bool reaches(const Scalar& speed, const Scalar& dt) const {
    return margin_for(speed, dt) <= settings_.reach;
  }

  /// Forgets all contacts, as after the sheet was put elsewhere.
  void clear() {
    contacts_.clear();
    memory_.clear();
    report_ = {};
  }

 private:
  /// A contact of the last step that was closed.
  struct Memory {
    std::array<int, 4> key;
    Vector3<Scalar> force, offset;
    Scalar carried;
    int age;
  };

  ObstacleContacts(std::size_t capacity, const Settings& settings) : settings_(settings) {
    contacts_.reserve(capacity);
    memory_.reserve(capacity);
  }

  static std::array<int, 4> key_of(const ObstacleContact<Scalar>& contact) {
    const std::array<int, 3>& v = contact.point.vertex;
    return {contact.obstacle, v[0], v[1], v[2]};
  }
  /// Moves the closed contacts of the last step to the memory, in order of their keys.
  void remember();
  /// Gives a contact what is remembered of it.
  void recall(ObstacleContact<Scalar>& contact, const Scalar& dt) const;
  /// Returns the distance at which contacts should be listed.
  Scalar margin_for(const Scalar& speed, const Scalar& dt) const {
    // Tension pulls vertices faster than any was: the corner of a sheet cracks like a whip.
    return Scalar(2) * settings_.thickness + dt * (Scalar(2) * speed + Scalar(40) * dt);
  }
  QueryStatus list(Obstacles obstacles, const PointsView<Scalar>& velocities, const Scalar& dt,
                   SheetContactFinder<Scalar>& finder);

  Settings settings_;
  std::vector<ObstacleContact<Scalar>> contacts_;
  std::vector<Memory> memory_;
  Obstacles obstacles_;
  ObstacleContactReport<Scalar> report_;
  Scalar dt_ = Scalar(0);
  bool complete_ = true;
};

template <RealScalar Scalar>
void ObstacleContacts<Scalar>::remember() {
  memory_.clear();
  for (const ObstacleContact<Scalar>& contact : contacts_) {
    if (contact.state == ContactState::Open || !(Scalar(0) < dt_)) continue;
    memory_.push_back(
        {key_of(contact), contact.impulse / dt_, contact.offset, contact.carried, contact.age});
  }
  std::sort(memory_.begin(), memory_.end(),
            [](const Memory& a, const Memory& b) { return a.key < b.key; });
}

template <RealScalar Scalar>
void ObstacleContacts<Scalar>::recall(ObstacleContact<Scalar>& contact, const Scalar& dt) const {
  const std::array<int, 4> key = key_of(contact);
  const auto found =
      std::lower_bound(memory_.begin(), memory_.end(), key,
                       [](const Memory& a, const std::array<int, 4>& k) { return a.key < k; });
  if (found == memory_.end() || found->key != key) return;
  contact.impulse = dt * found->force;
  contact.offset = found->offset;
  contact.carried = found->carried;
  contact.age = found->age;
  contact.state = ContactState::Stick;
}

template <RealScalar Scalar>
bool ObstacleContacts<Scalar>::add(const SheetContact<Scalar>& point, int obstacle,
                                   const Vector3<Scalar>& impulse) {
  const auto same = [&](const ObstacleContact<Scalar>& c) {
    return c.obstacle == obstacle && c.point.vertex == point.vertex;
  };
  auto found = std::find_if(contacts_.begin(), contacts_.end(), same);
  if (found == contacts_.end()) {
    if (contacts_.size() == contacts_.capacity()) {
      complete_ = false;
      return false;
    }
    ObstacleContact<Scalar> contact;
    contact.point = point;
    contact.obstacle = obstacle;
    contacts_.push_back(contact);
    found = contacts_.end() - 1;
  }
  if (found->state == ContactState::Open) {
    found->state = ContactState::Slip;
    ++found->age;
    ++report_.closed;
    ++report_.slipping;
  }
  found->impulse += impulse;
  return true;
}

template <RealScalar Scalar>
Scalar ObstacleContacts<Scalar>::surface_speed(const ColliderRef<Scalar>& obstacle,
                                               const PointsView<Scalar>& x) {
  using std::sqrt;
  // The velocity of a rigid obstacle at a few places tells whether it moves.
  const Index n = x.cols();
  Matrix3<Scalar> places;
  places.col(0) = x.col(0);
  places.col(1) = x.col(n / 2);
  places.col(2) = x.col(n - 1);
  std::array<SurfacePoint<Scalar>, 3> there;
  Scalar other = Scalar(0);
  if (obstacle.closest(places, there) == QueryStatus::Answered) {
    for (const SurfacePoint<Scalar>& q : there) {
      const Scalar size = sqrt(q.velocity.squaredNorm());
      if (other < size) other = size;
    }
  }
  return other;
}

template <RealScalar Scalar>
QueryStatus ObstacleContacts<Scalar>::list(Obstacles obstacles,
                                           const PointsView<Scalar>& velocities, const Scalar& dt,
                                           SheetContactFinder<Scalar>& finder) {
  using std::sqrt;
  if (!is_finite(dt) || !(Scalar(0) < dt) || velocities.cols() != finder.positions().cols())
    return QueryStatus::InvalidArgument;
  if (!all_finite(velocities)) return QueryStatus::InvalidPoint;
  Scalar speed = Scalar(0);
  for (Index v = 0; v < velocities.cols(); ++v) {
    const Scalar size = velocities.col(v).squaredNorm();
    if (speed < size) speed = size;
  }
  speed = sqrt(speed);
  if (velocities.cols() == 0) return QueryStatus::Answered;
  for (std::size_t i = 0; i < obstacles.size(); ++i) {
    const Scalar wanted = margin_for(speed + surface_speed(obstacles[i], finder.positions()), dt);
    const bool within = wanted <= settings_.reach;
    complete_ = complete_ && within;
    const QueryStatus status = finder.find(obstacles[i], within ? wanted : settings_.reach, dt);
    if (status != QueryStatus::Answered) return status;
    complete_ = complete_ && finder.complete();
    for (const SheetContact<Scalar>& point : finder.contacts()) {
      if (contacts_.size() == contacts_.capacity()) {
        complete_ = false;
        break;
      }
      ObstacleContact<Scalar> contact;
      contact.point = point;
      contact.obstacle = static_cast<int>(i);
      recall(contact, dt);
      contacts_.push_back(contact);
    }
  }
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
QueryStatus ObstacleContacts<Scalar>::update(Obstacles obstacles,
                                             const PointsView<Scalar>& velocities, const Scalar& dt,
                                             SheetContactFinder<Scalar>& finder) {
  remember();
  contacts_.clear();
  report_ = {};
  complete_ = true;
  obstacles_ = obstacles;
  const QueryStatus status = list(obstacles, velocities, dt, finder);
  if (status != QueryStatus::Answered) contacts_.clear();
  dt_ = status == QueryStatus::Answered ? dt : Scalar(0);
  return status;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class ObstacleContacts<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
