#pragma once

// What a planner of joint paths checks before it starts, and where it draws random postures.

#include <string>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/grasp/detail/joint_trees.hpp"
#include "clothctl/grasp/detail/motion_check.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns an error message for the first bad number of the input, or "".
template <RealScalar Scalar>
std::string bad_joint_input(const VectorX<Scalar>& from, const VectorX<Scalar>& to,
                            const VectorX<Scalar>& lower, const VectorX<Scalar>& upper,
                            const VectorX<Scalar>& reach) {
  const std::pair<const char*, const VectorX<Scalar>*> all[] = {
      {"to", &to}, {"lower", &lower}, {"upper", &upper}, {"reach", &reach}};
  for (const auto& [name, values] : all) {
    if (values->size() == from.size()) continue;
    return std::string(name) + ": expected " + std::to_string(from.size()) +
           " values as in from, found " + std::to_string(values->size());
  }
  const auto is_nan = [](const Scalar& x) { return !is_finite(x) && !is_unbounded(x); };
  for (Index i = 0; i < from.size(); ++i) {
    const std::string joint = "joint " + std::to_string(i) + ": ";
    if (!is_finite(from[i])) return joint + "the start is " + number_text(from[i]);
    if (!is_finite(to[i])) return joint + "the goal is " + number_text(to[i]);
    if (is_nan(lower[i])) return joint + "the lower limit is nan";
    if (is_nan(upper[i])) return joint + "the upper limit is nan";
    if (upper[i] < lower[i]) {
      return joint + "the lower limit " + number_text(lower[i]) + " is above the upper limit " +
             number_text(upper[i]);
    }
    if (!is_finite(reach[i]) || reach[i] < Scalar(0)) {
      return joint + "the reach is " + number_text(reach[i]) +
             " m, expected a finite number that is not negative";
    }
  }
  if (!is_finite(joint_way(from, to, reach))) return "the way from start to goal overflows";
  return {};
}

/// Returns a message about the first joint of a posture that is beyond its limit, or "".
template <RealScalar Scalar>
std::string beyond_limit(const char* what, const VectorX<Scalar>& q, const VectorX<Scalar>& lower,
                         const VectorX<Scalar>& upper) {
  for (Index i = 0; i < q.size(); ++i) {
    const bool below = q[i] < lower[i];
    if (!below && !(upper[i] < q[i])) continue;
    return "joint " + std::to_string(i) + ": the " + what + ' ' + number_text(q[i]) + " is " +
           (below ? "below the lower limit " + number_text(lower[i])
                  : "above the upper limit " + number_text(upper[i]));
  }
  return {};
}

/// Returns where random postures lie: within the limits, and where a joint has none, no farther
/// beyond start and goal than the way between these takes that joint.
template <RealScalar Scalar>
JointBox<Scalar> sampling_box(const VectorX<Scalar>& from, const VectorX<Scalar>& to,
                              const VectorX<Scalar>& lower, const VectorX<Scalar>& upper,
                              const VectorX<Scalar>& reach) {
  JointBox<Scalar> box{lower, upper};
  const Scalar way = joint_way(from, to, reach);
  for (Index i = 0; i < from.size(); ++i) {
    const Scalar low = from[i] < to[i] ? from[i] : to[i], high = from[i] < to[i] ? to[i] : from[i];
    // A joint that moves nothing need not go beyond.
    const Scalar beyond = Scalar(0) < reach[i] ? Scalar(way / reach[i]) : Scalar(0);
    if (is_unbounded(lower[i])) box.lower[i] = low - beyond;
    if (is_unbounded(upper[i])) box.upper[i] = high + beyond;
  }
  return box;
}

/// Returns "the clearance is nan at (…)".
template <RealScalar Scalar>
std::string broken_clearance(const VectorX<Scalar>& q) {
  std::string text = "the clearance is nan at (";
  for (Index i = 0; i < q.size(); ++i) text += (i > 0 ? ", " : "") + number_text(q[i]);
  return text + ')';
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
