#pragma once

// A rigid motion x -> R x + t that goes to where it shall be, at most at given speeds: its jumps
// become ways. The middle of what it moves goes on a straight line, and it turns about that.

#include <cmath>

#include "clothctl/math/rotation.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The motion.
template <RealScalar Scalar>
class LimitedMotion {
 public:
  /// The rotation of the motion now.
  const Matrix3<Scalar>& R() const { return R_; }
  /// Returns where a point is now.
  Vector3<Scalar> at(const Vector3<Scalar>& x) const { return Vector3<Scalar>(R_ * x + t_); }

  /// What the last `advance` left of the way, m, and of the turn, rad.
  const Scalar& way_left() const { return way_left_; }
  const Scalar& turn_left() const { return turn_left_; }

  /// Goes back to no motion, at once.
  void reset() { *this = LimitedMotion(); }
  /// Shall be at x -> R x + t. Returns false, and changes nothing, when that is no motion.
  bool move_to(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    if (!is_rotation<Scalar>(R, Scalar(1e-3)) || !all_finite(t)) return false;
    for (Index i = 0; i < 3; ++i) {
      if (is_unbounded(t[i])) return false;
    }
    R_wanted_ = renewed(R);
    t_wanted_ = t;
    return true;
  }
  /// Shall be at x -> R x + t of where it is now. Returns false, and changes nothing, when that is
  /// no motion.
  bool move_by(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    const Vector3<Scalar> moved = R * t_ + t;
    return is_rotation<Scalar>(R, Scalar(1e-3)) && move_to(renewed(R * R_), moved);
  }
  /// Goes on: the point that was at `middle` at first by at most `way` (m), and by a turn of at
  /// most `turn` (rad).
  void advance(const Vector3<Scalar>& middle, const Scalar& way, const Scalar& turn) {
    using std::sqrt;
    const Vector3<Scalar> from = at(middle);
    Vector3<Scalar> left = R_wanted_ * middle + t_wanted_ - from;
    const Scalar length = sqrt(left.squaredNorm());
    way_left_ = turn_left_ = Scalar(0);
    if (way < length) {
      left *= way / length;
      way_left_ = length - way;
    }
    const Vector3<Scalar> to_turn = rotation_log<Scalar>(R_wanted_ * R_.transpose());
    const Scalar angle = sqrt(to_turn.squaredNorm());
    if (turn < angle) {
      const Vector3<Scalar> part = (turn / angle) * to_turn;
      R_ = renewed(Matrix3<Scalar>(rotation_exp<Scalar>(part) * R_));
      turn_left_ = angle - turn;
    } else {
      R_ = R_wanted_;
    }
    t_ = from + left - R_ * middle;
  }

 private:
  /// Products of rotations drift from being one.
  static Matrix3<Scalar> renewed(const Matrix3<Scalar>& product) {
    return rotation_from_quaternion<Scalar>(quaternion_from_rotation<Scalar>(product));
  }

  Matrix3<Scalar> R_ = Matrix3<Scalar>::Identity(), R_wanted_ = R_;
  Vector3<Scalar> t_ = Vector3<Scalar>::Constant(Scalar(0)), t_wanted_ = t_;
  Scalar way_left_ = Scalar(0), turn_left_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
