#pragma once

// Where the hands belong while the features follow their target. The tracking cost sees only the
// features. Between them and the hands lies a swinging sheet (the control is non-collocated):
// inverting the sheet's dynamics drives the hands apart. The anchor pulls each hand to
//
//   p̄(t) = ȳ(t) + (p_rest - y_rest),
//
// ȳ the target of the features that it follows, p_rest and y_rest the positions of hand and
// features at rest. In the directions in which the sheet swings, ȳ is replaced by the inverse of a
// hanging chain of length L:
//
//   ȳ_n(t) -> (1/2π) ∫_{-π}^{π} ȳ_n(t + τ sin a) da,   τ = 2 √(L/g)
//
// This moving average looks τ ahead and needs no derivatives. It is computed as a mean of 32
// samples. Reference: Petit, Rouchon, Flatness of heavy chain systems (2001).
//
// Air that accelerates the sheet by a (mean over the sheet, with its drag) adds to gravity: the
// sheet hangs along g + a, and its hand leads by
//
//   L ( (g ẑ - a) / |g ẑ - a| - ẑ )

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The directions of the target in which the average over the hanging chain is taken.
enum class HeavyChainAxes {
  /// None: the hands keep their rest offset to the features.
  Off,
  /// The horizontal normal of the line from the first to the last feature: for a sheet held by two
  /// hands. A single feature makes no line; it is treated as Horizontal.
  SheetNormal,
  /// Both horizontal directions: a rope, or a sheet held at one point.
  Horizontal
};

/// The anchor of one hand: the features that it follows, and its offset from them.
template <RealScalar Scalar>
struct HandAnchor {
  /// Weights of the features in the point that the hand follows; their sum is 1.
  std::vector<Scalar> feature_weights;
  /// Position of the hand minus that of the point, at rest, m.
  Vector3<Scalar> offset = Vector3<Scalar>::Zero();
  /// Length L of the sheet that hangs below the hand, m; 0 switches the average off.
  Scalar hanging_length = Scalar(0);

  /// Returns an empty string, or what is wrong with an anchor for `features` features, to be put
  /// after its name. Allocates.
  std::string validate(Index features) const {
    if (static_cast<Index>(feature_weights.size()) != features) {
      return " has " + std::to_string(feature_weights.size()) + " weights for " +
             std::to_string(features) + " features";
    }
    for (const Scalar& weight : feature_weights) {
      if (!is_finite(weight)) return " has the weight " + number_text(weight);
    }
    if (!all_finite(offset)) return " has an offset that is not finite";
    if (!is_finite(hanging_length) || hanging_length < Scalar(0))
      return " has the hanging length " + number_text(hanging_length) +
             ", must be finite and not negative";
    return {};
  }
};

/// Returns anchors that keep the offsets of a start pose, with the features at the columns of
/// `features` (m) and the hands at those of `hands` (m). Hand i follows feature i if there are as
/// many hands as features, and the mean of all features otherwise. Allocates.
template <RealScalar Scalar>
std::vector<HandAnchor<Scalar>> make_anchors(const Points<Scalar>& features,
                                             const Points<Scalar>& hands) {
  std::vector<HandAnchor<Scalar>> anchors;
  const Scalar number = Scalar(static_cast<double>(features.cols()));
  for (Index g = 0; g < hands.cols(); ++g) {
    HandAnchor<Scalar> anchor;
    Vector3<Scalar> followed = Vector3<Scalar>::Zero();
    for (Index i = 0; i < features.cols(); ++i) {
      const Scalar paired = Scalar(i == g ? 1.0 : 0.0);
      const Scalar weight = features.cols() == hands.cols() ? paired : Scalar(1) / number;
      anchor.feature_weights.push_back(weight);
      followed += weight * features.col(i);
    }
    anchor.offset = hands.col(g) - followed;
    anchor.hanging_length = Scalar(0) < anchor.offset[2] ? anchor.offset[2] : Scalar(0);
    anchors.push_back(std::move(anchor));
  }
  return anchors;
}

namespace detail {

/// Returns the horizontal part of `v` in which a sheet swings; `across` goes from its first to its
/// last feature. Zero along lines that are shorter than rounding. Never allocates.
template <RealScalar Scalar>
Vector3<Scalar> swing_part(const HandAnchor<Scalar>& anchor, HeavyChainAxes heavy_chain_axes,
                           const Vector3<Scalar>& across, const Vector3<Scalar>& v) {
  Vector3<Scalar> level(v[0], v[1], Scalar(0));
  if (heavy_chain_axes == HeavyChainAxes::Horizontal || anchor.feature_weights.size() < 2)
    return level;
  const Vector3<Scalar> normal(-across[1], across[0], Scalar(0));
  const Scalar squared = normal.squaredNorm();
  if (!(scalar_traits<Scalar>::epsilon() < squared)) return Vector3<Scalar>::Zero();
  return normal * (normal.dot(level) / squared);
}

}  // namespace detail

/// Returns by how much the hand of `anchor` leads where the air accelerates the sheet by `air`
/// (m/s², mean over the sheet), m. `gravity`: magnitude of gravity (m/s²), `across`: way from the
/// first to the last feature (m). At most 2 L long; zero where gravity and air cancel. Never
/// allocates.
template <RealScalar Scalar>
Vector3<Scalar> air_lead(const HandAnchor<Scalar>& anchor, HeavyChainAxes heavy_chain_axes,
                         Scalar gravity, const Vector3<Scalar>& across,
                         const Vector3<Scalar>& air) {
  if (heavy_chain_axes == HeavyChainAxes::Off || !(Scalar(0) < anchor.hanging_length))
    return Vector3<Scalar>::Zero();
  Vector3<Scalar> pull = -detail::swing_part(anchor, heavy_chain_axes, across, air);
  pull[2] = gravity - air[2];
  const Scalar strength = pull.norm();
  if (!(scalar_traits<Scalar>::epsilon() * gravity < strength)) return Vector3<Scalar>::Zero();
  pull /= strength;
  pull[2] -= Scalar(1);
  return anchor.hanging_length * pull;
}

/// Returns where the hand of `anchor` belongs at time `t` (s) in still air, m. `target(feature,
/// time)` is the target of a feature (m), `gravity` the magnitude of gravity (m/s²). Never
/// allocates. Complexity: at most 34 evaluations of each feature's target.
template <RealScalar Scalar, class Target>
Vector3<Scalar> anchor_position(const HandAnchor<Scalar>& anchor, HeavyChainAxes heavy_chain_axes,
                                Scalar gravity, const Target& target, Scalar t) {
  using std::sin;
  using std::sqrt;
  const auto followed = [&](Scalar time) {
    Vector3<Scalar> point = Vector3<Scalar>::Zero();
    for (std::size_t i = 0; i < anchor.feature_weights.size(); ++i) {
      const Vector3<Scalar> feature = target(static_cast<Index>(i), time);
      point += anchor.feature_weights[i] * feature;
    }
    return point;
  };
  const Vector3<Scalar> now = followed(t);
  if (heavy_chain_axes == HeavyChainAxes::Off || !(Scalar(0) < anchor.hanging_length))
    return now + anchor.offset;
  const Scalar tau = Scalar(2) * sqrt(anchor.hanging_length / gravity);
  Vector3<Scalar> mean = Vector3<Scalar>::Zero();
  constexpr int kSamples = 32;
  const Scalar share = Scalar(1.0 / kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const Scalar angle =
        Scalar((2.0 * std::numbers::pi) * (static_cast<double>(i) + 0.5) / kSamples);
    mean += share * followed(t + tau * sin(angle));
  }
  const Vector3<Scalar> first = target(Index(0), t);
  const Vector3<Scalar> last = target(static_cast<Index>(anchor.feature_weights.size()) - 1, t);
  const Vector3<Scalar> across = last - first, ahead = mean - now;
  return now + detail::swing_part(anchor, heavy_chain_axes, across, ahead) + anchor.offset;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
