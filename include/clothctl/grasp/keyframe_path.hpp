#pragma once

// Curves of joint positions through keys (t_i, P_i), once continuously differentiable. On segment
// i, of duration h = t_{i+1} - t_i and mean velocity d_i = (P_{i+1} - P_i) / h, each joint follows
// a cubic Hermite curve. With s = (t - t_i) / h, r = 1 - s and the velocities m at the keys,
//
//   p(t)  = P_i + s² (3 - 2s) (P_{i+1} - P_i) + h s r (r m_i - s m_{i+1})
//   p'(t) = r² m_i + 2 r s (3 d_i - m_i - m_{i+1}) + s² m_{i+1}.
//
// Catmull and Rom's velocities are m_i = (P_{i+1} - P_{i-1}) / (t_{i+1} - t_{i-1}), here zero at
// the first and the last key. Such a curve leaves the range of its keys.
//
// The monotone ones are zero where d_{i-1} d_i ≤ 0, and elsewhere Catmull and Rom's, made smaller
// to |m_i| ≤ 3/2 min(|d_{i-1}|, |d_i|). Let m_i = α d_i and m_{i+1} = β d_i, with α, β in [0, 3/2]:
//
// * The three factors of r², 2rs and s² in p' / d_i are α, 3 - α - β and β. None is negative, so no
//   segment turns round, and p stays between its two keys. Fritsch and Carlson show that 3 in place
//   of 3/2 suffices for this; Steffen takes 2.
// * p' / d_i ≤ 3/2. It is linear in α and in β, so its largest values are at the corners of their
//   square: 6rs ≤ 3/2 at (0, 0), 3/2 (1 - s²) at (3/2, 0), 3/2 (1 - r²) at (0, 3/2), and
//   3/2 (1 - 2rs) at (3/2, 3/2).
//   No segment is therefore faster than one from rest to rest, which has α = β = 0 and the speed
//   3/2 |d_i| in its middle. This is why the limit is 3/2.
//
// Reference: Catmull, Rom, A class of local interpolating splines (1974). Fritsch, Carlson, SIAM J.
// Numer. Anal. 17, 238 (1980). Steffen, Astron. Astrophys. 239, 443 (1990).

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Joint positions at a time.
template <RealScalar Scalar>
struct Keyframe {
  /// When, s.
  Scalar time = Scalar(0);
  /// The position of each joint (m or rad).
  VectorX<Scalar> positions;
};

/// How a KeyframePath chooses the velocities at its keys.
enum class KeyframeTangents {
  /// From the two neighbours of a key. Smooth, but the path leaves the range of its keys: take it
  /// where no joint limit is near.
  CatmullRom,
  /// The same, limited, so that each joint stays between its positions at the two keys around:
  /// limits that hold at the keys hold everywhere. A joint that turns round at a key stops there.
  Monotone,
  /// Zero: it stands still at each key, and moves on a straight line of joint positions between two
  /// of them. So it keeps to a path that was proved free (plan_joint_path).
  Standstill
};

namespace detail {

/// Returns an error message for the first bad key, or "".
template <RealScalar Scalar>
std::string bad_keyframe(const std::vector<Keyframe<Scalar>>& keys) {
  if (keys.empty()) return "keys: expected at least 1, found 0";
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const Keyframe<Scalar>& key = keys[i];
    const std::string where = "key " + std::to_string(i) + ": ";
    if (key.positions.size() != keys[0].positions.size()) {
      return where + "expected " + std::to_string(keys[0].positions.size()) +
             " positions as in key 0, found " + std::to_string(key.positions.size());
    }
    for (Index j = 0; j < key.positions.size(); ++j) {
      if (is_finite(key.positions[j])) continue;
      return where + "position " + std::to_string(j) + " is " + number_text(key.positions[j]) +
             ", expected a finite number";
    }
    if (!is_finite(key.time))
      return where + "time is " + number_text(key.time) + ", expected a finite number";
    if (i > 0 && !(keys[i - 1].time < key.time)) {
      return where + "time " + number_text(key.time) + " does not come after " +
             number_text(keys[i - 1].time);
    }
  }
  return {};
}

}  // namespace detail

/// A path of joint positions through keys. It rests at its first and at its last key.
template <RealScalar Scalar>
class KeyframePath {
 public:
  /// A key.
  using Key = Keyframe<Scalar>;

  /// Makes the path through `keys`. Allocates. Complexity: O(keys · joints). Fails when: there is
  /// no key, a time or a position is not finite, the times do not increase, numbers of positions
  /// differ, or a velocity overflows.
  static Result<KeyframePath> create(std::vector<Key> keys,
                                     KeyframeTangents tangents = KeyframeTangents::Monotone) {
    if (std::string bad = detail::bad_keyframe(keys); !bad.empty()) return Error{std::move(bad)};
    KeyframePath path;
    path.tangents_ = tangents;
    path.keys_ = std::move(keys);
    const std::size_t n = path.keys_.size();
    path.velocities_.assign(n, VectorX<Scalar>::Constant(path.size(), Scalar(0)));
    for (std::size_t i = 0; i + 1 < n; ++i) {
      if (!all_finite(path.mean_velocity(i))) {
        return Error{"key " + std::to_string(i + 1) + ": time " +
                     number_text(path.keys_[i + 1].time) +
                     " is too close to the key before for its positions"};
      }
      if (i > 0 && tangents != KeyframeTangents::Standstill) path.set_velocity(i);
    }
    return path;
  }

  /// Writes positions (m or rad) and velocities (m/s or rad/s) at time t (s); q and qd have
  /// `size()` entries (assert). Before the first key and after the last one the positions are those
  /// of that key, and the velocities are zero; a NaN counts as before the first. Complexity: O(log
  /// keys + joints). Never allocates.
  void sample(const Scalar& t, Eigen::Ref<VectorX<Scalar>> q,
              Eigen::Ref<VectorX<Scalar>> qd) const {
    assert(q.size() == size() && qd.size() == size());
    const bool before = is_finite(t) ? !(begin_time() < t) : !(is_unbounded(t) && Scalar(0) < t);
    if (before || !(t < end_time())) {
      q = before ? keys_.front().positions : keys_.back().positions;
      qd.setConstant(Scalar(0));
      return;
    }
    const auto next = std::upper_bound(keys_.begin(), keys_.end(), t,
                                       [](const Scalar& a, const Key& b) { return a < b.time; });
    const auto i = static_cast<std::size_t>(next - keys_.begin()) - 1;
    const Scalar h = keys_[i + 1].time - keys_[i].time;
    const Scalar s = (t - keys_[i].time) / h, r = Scalar(1) - s;
    const VectorX<Scalar>&from = keys_[i].positions, &to = keys_[i + 1].positions;
    const VectorX<Scalar>&m = velocities_[i], &m_next = velocities_[i + 1];
    for (Index j = 0; j < size(); ++j) {
      const Scalar way = to[j] - from[j];
      q[j] = from[j] + s * s * (Scalar(3) - Scalar(2) * s) * way +
             h * s * r * (r * m[j] - s * m_next[j]);
      qd[j] = r * r * m[j] + Scalar(2) * r * s * (Scalar(3) * (way / h) - m[j] - m_next[j]) +
              s * s * m_next[j];
      if (tangents_ == KeyframeTangents::CatmullRom) continue;
      // Rounding must not leave the limits either.
      const Scalar low = way < Scalar(0) ? to[j] : from[j];
      const Scalar high = way < Scalar(0) ? from[j] : to[j];
      if (q[j] < low) q[j] = low;
      if (high < q[j]) q[j] = high;
    }
  }

  /// Time of the first key, s.
  const Scalar& begin_time() const { return keys_.front().time; }
  /// Time of the last key, s.
  const Scalar& end_time() const { return keys_.back().time; }
  /// The number of joints: the size of q and qd.
  Index size() const { return keys_.front().positions.size(); }
  /// The keys.
  const std::vector<Key>& keys() const { return keys_; }

 private:
  KeyframePath() = default;

  /// Returns d_i.
  VectorX<Scalar> mean_velocity(std::size_t i) const {
    return (keys_[i + 1].positions - keys_[i].positions) / (keys_[i + 1].time - keys_[i].time);
  }
  /// Sets m_i of a key that has two neighbours.
  void set_velocity(std::size_t i) {
    using std::abs;
    const VectorX<Scalar> before = mean_velocity(i - 1), after = mean_velocity(i);
    // Catmull and Rom's is the mean of the two, weighted by durations. As a mean it cannot
    // overflow.
    const Scalar weight =
        (keys_[i].time - keys_[i - 1].time) / (keys_[i + 1].time - keys_[i - 1].time);
    VectorX<Scalar>& m = velocities_[i];
    m = weight * before + (Scalar(1) - weight) * after;
    if (tangents_ == KeyframeTangents::CatmullRom) return;
    for (Index j = 0; j < m.size(); ++j) {
      const bool rising = Scalar(0) < before[j] && Scalar(0) < after[j];
      const bool falling = before[j] < Scalar(0) && after[j] < Scalar(0);
      const Scalar most = Scalar(1.5) * (abs(before[j]) < abs(after[j]) ? before[j] : after[j]);
      if (!rising && !falling) {
        m[j] = Scalar(0);
      } else if (abs(most) < abs(m[j])) {
        m[j] = most;
      }
    }
  }

  std::vector<Key> keys_;
  std::vector<VectorX<Scalar>> velocities_;
  KeyframeTangents tangents_ = KeyframeTangents::Monotone;
};

/// Gives times to `positions` (m or rad, of each key), the first at `start` (s), such that no joint
/// exceeds its velocity limit (m/s or rad/s, > 0, infinite for none) on the Monotone path through
/// the keys. A segment takes 3/2 of the time that its slowest joint needs at full speed (see the
/// proof above), and at least 1e-3 s, also between equal keys. The number of keys stays. Allocates.
/// Complexity: O(keys · joints). Fails when: there is no key, a position or `start` is not finite,
/// a limit is not positive, sizes differ, or a time overflows.
template <RealScalar Scalar>
Result<std::vector<Keyframe<Scalar>>> time_keyframes(std::vector<VectorX<Scalar>> positions,
                                                     const VectorX<Scalar>& velocity_limits,
                                                     const std::type_identity_t<Scalar>& start) {
  using std::abs;
  for (Index j = 0; j < velocity_limits.size(); ++j) {
    const Scalar& limit = velocity_limits[j];
    if ((!is_finite(limit) && !is_unbounded(limit)) || !(Scalar(0) < limit)) {
      return Error{"joint " + std::to_string(j) + ": velocity limit is " + number_text(limit) +
                   ", expected a positive number"};
    }
  }
  if (!positions.empty() && positions[0].size() != velocity_limits.size()) {
    return Error{"velocity limits: expected " + std::to_string(positions[0].size()) +
                 " as positions in key 0, found " + std::to_string(velocity_limits.size())};
  }
  std::vector<Keyframe<Scalar>> keys(positions.size());
  for (std::size_t i = 0; i < keys.size(); ++i) {
    keys[i].time = start;
    keys[i].positions = std::move(positions[i]);
    if (keys[i].positions.size() != velocity_limits.size()) break;  // refused below
    if (i == 0) continue;
    Scalar duration = Scalar(1e-3);
    for (Index j = 0; j < velocity_limits.size(); ++j) {
      if (is_unbounded(velocity_limits[j])) continue;
      const Scalar way = abs(keys[i].positions[j] - keys[i - 1].positions[j]);
      const Scalar least = Scalar(1.5) * way / velocity_limits[j];
      if (duration < least) duration = least;
    }
    // The rounding of the sum must not shorten the segment.
    const Scalar& before = keys[i - 1].time;
    keys[i].time = before + (duration + Scalar(8) * scalar_traits<Scalar>::epsilon() *
                                            (abs(before) + duration));
  }
  if (std::string bad = detail::bad_keyframe(keys); !bad.empty()) return Error{std::move(bad)};
  return keys;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class KeyframePath<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
