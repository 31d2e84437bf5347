#pragma once

// Shortens a path of free motions. Two random points of the path, on different motions, are joined
// by a straight one where that is free. Afterwards each corner that a straight motion can pass by
// is left out. As way(a, b) is a norm of b - a, a shortcut is never longer than what it replaces.

#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/grasp/detail/motion_check.hpp"
#include "clothctl/grasp/detail/split_mix.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A path of free motions that becomes shorter. Refers to the motions.
template <RealScalar Scalar, class Clearance>
class PathShortcuts {
 public:
  /// A path from its first posture to its last. Ends never change.
  using Path = std::vector<Posture<Scalar>>;

  /// Takes a path of at least two postures.
  PathShortcuts(MotionCheck<Scalar, Clearance>& motions, Path path)
      : check_(motions), path_(std::move(path)) {}

  /// Tries a shortcut between two random points. Allocates. Complexity: O(postures · joints), and
  /// the checks of three motions.
  void cut(SplitMix& random) {
    const Scalar total = length();
    Place from = place(random.uniform<Scalar>() * total);
    Place to = place(random.uniform<Scalar>() * total);
    if (to.motion < from.motion) std::swap(from, to);
    if (from.motion == to.motion) return;
    const Posture<Scalar> a = posture(from), b = posture(to);
    // The parts of the two motions are checked again: they are other motions to a check.
    if (!check_.is_free(a, b) || !check_.is_free(path_[from.motion], a) ||
        !check_.is_free(b, path_[to.motion + 1]))
      return;
    const auto first = path_.begin() + static_cast<std::ptrdiff_t>(from.motion) + 1;
    const auto last = path_.begin() + static_cast<std::ptrdiff_t>(to.motion) + 1;
    const auto after = path_.erase(first, last);
    path_.insert(after, {a, b});
  }
  /// Leaves out corners, from the start on.
  void drop_corners() {
    for (std::size_t i = 1; i + 1 < path_.size();) {
      if (check_.is_free(path_[i - 1], path_[i + 1])) {
        path_.erase(path_.begin() + static_cast<std::ptrdiff_t>(i));
      } else {
        ++i;
      }
    }
  }
  /// Returns the sum of the ways (m).
  Scalar length() const {
    Scalar sum(0);
    for (std::size_t i = 0; i + 1 < path_.size(); ++i)
      sum += check_.way(path_[i].q, path_[i + 1].q);
    return sum;
  }
  /// The path.
  const Path& path() const { return path_; }

 private:
  /// A point of the path: a motion and the share of it that lies before.
  struct Place {
    std::size_t motion;
    Scalar share;
  };

  /// Returns the point at a way from the start.
  Place place(Scalar way) const {
    for (std::size_t i = 0; i + 2 < path_.size(); ++i) {
      const Scalar here = check_.way(path_[i].q, path_[i + 1].q);
      if (way < here) return {i, way / here};
      way -= here;
    }
    const std::size_t last = path_.size() - 2;
    const Scalar here = check_.way(path_[last].q, path_[last + 1].q);
    return {last, way < here ? Scalar(way / here) : Scalar(1)};
  }
  Posture<Scalar> posture(const Place& at) {
    const VectorX<Scalar>&a = path_[at.motion].q, &b = path_[at.motion + 1].q;
    VectorX<Scalar> q = a + at.share * (b - a);
    // Rounding must not leave the range of the two, which limits may end.
    for (Index i = 0; i < q.size(); ++i) {
      const Scalar low = a[i] < b[i] ? a[i] : b[i], high = a[i] < b[i] ? b[i] : a[i];
      if (q[i] < low) q[i] = low;
      if (high < q[i]) q[i] = high;
    }
    return check_.posture(std::move(q));
  }

  MotionCheck<Scalar, Clearance>& check_;
  Path path_;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
