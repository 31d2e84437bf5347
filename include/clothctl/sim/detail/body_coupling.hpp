#pragma once

// What a sheet takes for granted of the bodies that it touches in a step.
//
// A sheet sees a body move with given velocities u, as if nothing could stop it, and the body
// receives the opposite J(u) of the sheet's impulses. With a body that is heavier than what it
// touches, u at the start of the step will do. A light one would be thrown back: a sheet between it
// and an obstacle gives way to neither. Where the impulses change a body by more than it
// approached, the step of the sheet is made again with other u, until they are nearly the
// velocities that the body ends with:
//
//   v(u) = v_free + M⁻¹ J(u),    u = u_0 + s M⁻¹ W,    g(s) = W·(v(u) - u) / W·M⁻¹ W
//
// W: the wrench of the normal impulses at u_0, about the centre of mass. g falls with s; its root
// is found for each body on its own by false position. (Friction needs no search: it is bounded by
// the normal impulses.) Any model can be asked like this. Bodies search at the same time, which may
// fail where they act on each other through the sheet. Bodies that joints or contacts hold are not
// searched for: how they answer is known only after their own solve.
//
// Where the impulses on a body, held or not, are too large after that, the step has not converged;
// if the sheet can lean on something else, the body does not receive the excess.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "clothctl/sim/detail/world_sheet.hpp"
#include "clothctl/sim/rigid_bodies.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Makes the steps of sheets again where bodies are light.
template <RealScalar S>
class BodyCoupling {
 public:
  using Scalar = S;
  using Sheet = WorldSheet<Scalar>;
  using Bodies = RigidBodies<Scalar>;

  /// Makes room for bodies and the sheets. Allocates.
  void reserve(int bodies, const std::vector<std::unique_ptr<Sheet>>& sheets) {
    tries_.assign(static_cast<std::size_t>(bodies), {});
    start_.resize(sheets.size());
    std::size_t room = 0;
    for (std::size_t i = 0; i < sheets.size(); ++i) {
      start_[i] = sheets[i]->state;
      room = (std::max)(room, sheets[i]->contacts.capacity());
    }
    listed_.reserve(room);
  }

  /// Notes where sheet `number` is before its step, if it may touch a body that impulses move.
  void begin(std::size_t number, const Sheet& sheet, const Bodies& bodies) {
    number_ = number;
    evaluations_ = 0;
    settled_ = true;
    for (Try& t : tries_) t = {};
    listed_.clear();
    const auto moves = [&](const ObstacleContact<Scalar>& c) {
      return movable(bodies, body_of(sheet, c));
    };
    const auto list = sheet.contacts.contacts();
    touches_ = std::any_of(list.begin(), list.end(), moves);
    if (!touches_) return;
    listed_.assign(list.begin(), list.end());
    start_[number] = sheet.state;
  }
  /// After the step: returns true when it must be made again. Sheet and bodies are then as before,
  /// with other velocities of what it touches.
  bool again(Sheet& sheet, Bodies& bodies, const Scalar& dt, const Scalar& fall);
  /// False when a search did not end.
  bool settled() const { return settled_; }
  /// The part of its impulses that a body shall receive: 1 where the search ended.
  const Scalar& share(int body) const { return tries_[static_cast<std::size_t>(body)].share; }

 private:
  using Vec = Vector3<Scalar>;
  static constexpr int kMost = 12;

  /// Velocities of a body, or impulses about its centre.
  struct Twist {
    Vec linear = Vec::Constant(Scalar(0)), angular = Vec::Constant(Scalar(0));

    Scalar dot(const Twist& o) const { return linear.dot(o.linear) + angular.dot(o.angular); }
    Vec at(const Vec& arm) const { return linear + angular.cross(arm); }
  };
  /// The search of a body.
  struct Try {
    /// J(u), and its normal part.
    Twist impulse, normal;
    /// How much farther than to the sheet the body goes, times the normal impulses, and with
    /// friction, N s m/s.
    Scalar approach = Scalar(0), power = Scalar(0);
    /// What the sheet took for granted, how much faster the body is without it (v_free - u), and
    /// M⁻¹ J.
    Twist u, before, gain;
    Twist u0, wrench, direction;
    /// W·M⁻¹ W.
    Scalar scale = Scalar(0);
    Scalar s = Scalar(0), low = Scalar(0), low_g = Scalar(0), high = Scalar(0), high_g = Scalar(0);
    Scalar tolerance = Scalar(0), share = Scalar(1);
    bool open = false, bracketed = false;
  };

  static int body_of(const Sheet& sheet, const ObstacleContact<Scalar>& c) {
    return -1 - sheet.obstacle_number[static_cast<std::size_t>(c.obstacle)];
  }
  static bool movable(const Bodies& bodies, int b) {
    return b >= 0 && Scalar(0) < bodies.inverse_mass(b) && !bodies.asleep(b);
  }
  /// M⁻¹ of a wrench.
  static Twist response(const Bodies& bodies, int b, const Twist& wrench) {
    const Matrix3<Scalar> inverse = bodies.inverse_inertia(b);
    return {bodies.inverse_mass(b) * wrench.linear, inverse * wrench.angular};
  }
  /// What the sheet takes for granted of a body.
  Twist assumed(const Bodies& bodies, int b, const Try& t) const {
    if (!t.open) {
      const RigidMotion<Scalar>& m = bodies.surface_motion(b);
      return {m.velocity, m.angular_velocity};
    }
    return {t.u0.linear + t.s * t.direction.linear, t.u0.angular + t.s * t.direction.angular};
  }
  /// Returns whether the sheet can lean on something besides one body.
  bool add_impulses(const Sheet& sheet, const Bodies& bodies, const Scalar& dt);
  /// Starts the search of a body where its impulses are too large. Returns whether they are.
  static bool start(Try& t, const Twist& response, const Scalar& fall);
  /// Takes g(s), and finds the next s. Returns whether that is needed.
  static bool narrow(Try& t, const Scalar& g);
  void go_back(Sheet& sheet, Bodies& bodies);
  /// Withholds from a body what throws it back, if the sheet can lean on something else.
  void limit(Try& t, bool squeezed, const Scalar& fall);

  std::vector<Try> tries_;
  std::vector<ClothState<Scalar>> start_;
  std::vector<ObstacleContact<Scalar>> listed_;
  std::size_t number_ = 0;
  int evaluations_ = 0;
  bool touches_ = false, settled_ = true;
};

template <RealScalar S>
bool BodyCoupling<S>::add_impulses(const Sheet& sheet, const Bodies& bodies, const Scalar& dt) {
  bool others = !sheet.mesh.pinned.empty() || !sheet.input.driven_vertices.empty();
  int last = -1;
  for (Try& t : tries_) {
    t.impulse = t.normal = {};
    t.approach = t.power = Scalar(0);
  }
  const Scalar thickness = sheet.contacts.settings().thickness;
  for (const ObstacleContact<Scalar>& c : sheet.contacts.contacts()) {
    const int b = body_of(sheet, c);
    if (c.state == ContactState::Open) continue;
    if (!movable(bodies, b) || (0 <= last && b != last)) others = true;
    if (!movable(bodies, b)) continue;
    last = b;
    Try& t = tries_[static_cast<std::size_t>(b)];
    const SurfacePoint<Scalar>& there = c.point.surface;
    const Vec arm = there.point - bodies.motion(b).position;
    const Scalar size = c.impulse.dot(there.normal);
    const Vec normal = size * there.normal;
    t.impulse.linear -= c.impulse;
    t.impulse.angular -= arm.cross(c.impulse);
    t.normal.linear -= normal;
    t.normal.angular -= arm.cross(normal);
    Vec before = Vec::Constant(Scalar(0));
    for (int k = 0; k < c.point.vertex_count(); ++k)
      before += c.point.weight[k] *
                start_[number_].velocities.col(c.point.vertex[static_cast<std::size_t>(k)]);
    const Scalar gap = there.distance - thickness + c.point.slack;
    const Vec closing = assumed(bodies, b, t).at(arm) - before;
    const Scalar way = Scalar(0) < gap ? Scalar(size * gap / dt) : Scalar(0);
    t.approach += normal.dot(closing) - way;
    t.power += c.impulse.dot(closing) - way;
  }
  return others;
}

template <RealScalar S>
bool BodyCoupling<S>::start(Try& t, const Twist& response, const Scalar& fall) {
  using std::sqrt;
  const Scalar approach = Scalar(0) < t.approach ? t.approach : Scalar(0);
  const Scalar slow = fall * sqrt(t.normal.linear.squaredNorm());
  const Scalar mismatch = t.normal.dot(t.before) + t.normal.dot(t.gain);
  if (!(approach + slow < mismatch)) return false;
  t.open = true;
  t.u0 = t.u;
  t.wrench = t.normal;
  t.direction = response;
  t.scale = t.wrench.dot(response);
  t.low_g = mismatch / t.scale;
  t.tolerance = (Scalar(0.5) * slow + Scalar(0.1) * approach) / t.scale;
  // As far as stops the body at the sheet.
  t.s = (Scalar(0.5) * slow + approach) / t.scale;
  if (Scalar(1) < t.s) t.s = Scalar(1);
  return true;
}

template <RealScalar S>
bool BodyCoupling<S>::narrow(Try& t, const Scalar& g) {
  const Scalar size = g < Scalar(0) ? Scalar(-g) : g;
  if (size <= t.tolerance) return false;
  if (Scalar(0) < g) {
    const Scalar slope = (t.low_g - g) / (t.s - t.low);
    t.low = t.s;
    t.low_g = g;
    if (t.bracketed) {
      t.high_g *= Scalar(0.5);  // Illinois
    } else {
      // No more than ten times as far.
      const Scalar step = Scalar(1.1) * g;
      t.s += Scalar(0.12) * slope * t.s < step ? Scalar(9) * t.s : step / slope;
      return true;
    }
  } else {
    t.high = t.s;
    t.high_g = g;
    if (t.bracketed) t.low_g *= Scalar(0.5);
    t.bracketed = true;
  }
  const bool apart = !(Scalar(0) < t.impulse.linear.squaredNorm());
  t.s = apart ? Scalar(0.5) * (t.low + t.high)
              : t.low + (t.high - t.low) * t.low_g / (t.low_g - t.high_g);
  return true;
}

template <RealScalar S>
void BodyCoupling<S>::go_back(Sheet& sheet, Bodies& bodies) {
  sheet.state = start_[number_];
  for (std::size_t i = 0; i < tries_.size(); ++i) {
    const int b = static_cast<int>(i);
    if (!tries_[i].open) continue;
    const Twist u = assumed(bodies, b, tries_[i]);
    bodies.set_surface_velocity(b, u.linear, u.angular);
  }
  for (ObstacleContact<Scalar>& c : listed_) {
    const int b = body_of(sheet, c);
    if (b < 0 || !tries_[static_cast<std::size_t>(b)].open) continue;
    const Vec arm = c.point.surface.point - bodies.motion(b).position;
    c.point.surface.velocity = assumed(bodies, b, tries_[static_cast<std::size_t>(b)]).at(arm);
  }
  sheet.contacts.set_contacts(listed_);
}

template <RealScalar S>
bool BodyCoupling<S>::again(Sheet& sheet, Bodies& bodies, const Scalar& dt, const Scalar& fall) {
  if (!touches_) return false;
  ++evaluations_;
  const bool squeezed = add_impulses(sheet, bodies, dt);
  bool more = false;
  for (std::size_t i = 0; i < tries_.size(); ++i) {
    Try& t = tries_[i];
    const int b = static_cast<int>(i);
    if (!movable(bodies, b)) continue;
    t.u = assumed(bodies, b, t);
    t.gain = response(bodies, b, t.impulse);
    const RigidMotion<Scalar>& m = bodies.motion(b);
    t.before = {m.velocity - t.u.linear, m.angular_velocity - t.u.angular};
    if (evaluations_ == 1) {
      const Twist way = response(bodies, b, t.normal);
      if (!bodies.is_held(b, way.linear, way.angular)) more = start(t, way, fall) || more;
    } else if (t.open && evaluations_ < kMost) {
      more = narrow(t, (t.wrench.dot(t.before) + t.wrench.dot(t.gain)) / t.scale) || more;
    }
  }
  if (more) {
    go_back(sheet, bodies);
    return true;
  }
  for (std::size_t i = 0; i < tries_.size(); ++i) {
    // Pads may press the sheet on a body with all their impulses.
    const Scalar pressed = bodies.inverse_mass(static_cast<int>(i)) * sheet.expected_impulse;
    limit(tries_[i], squeezed, Scalar(fall + Scalar(0.5) * pressed));
  }
  return false;
}

template <RealScalar S>
void BodyCoupling<S>::limit(Try& t, bool squeezed, const Scalar& fall) {
  using std::sqrt;
  const Scalar gained = t.impulse.dot(t.gain);
  if (!(Scalar(0) < gained)) return;
  const Scalar power = Scalar(0) < t.power ? t.power : Scalar(0);
  const Scalar most = Scalar(1.1) * power +
                      Scalar(2) * fall * sqrt(t.impulse.linear.squaredNorm()) -
                      t.impulse.dot(t.before);
  if (!(most < gained)) return;
  settled_ = false;
  if (squeezed) t.share = Scalar(0) < most ? Scalar(most / gained) : Scalar(0);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
