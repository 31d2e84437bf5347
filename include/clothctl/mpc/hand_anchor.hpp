#pragma once

// Where the hands belong while the features follow their target. The tracking cost sees only the features; inverting it
// through a swinging sheet drives the hands apart (non-collocated control). The anchor pulls each hand to
//
//   p̄(t) = ȳ(t) + (p_rest - y_rest),
//
// with the swinging directions of ȳ replaced by the inverse of a hanging chain of length L:
//
//   ȳ_n(t) -> (1/2π) ∫_{-π}^{π} ȳ_n(t + τ sin a) da,   τ = 2 √(L/g)
//
// a moving average that looks τ ahead and needs no derivatives. Here: 32-point mean.
// Reference: Petit & Rouchon, Flatness of heavy chain systems (2001).

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl {

/// Which directions of the target the heavy-chain average applies to.
enum class Swing {
  /// None: the hands keep their rest offset to the features.
  None,
  /// The horizontal normal of the line from the first to the last feature: a sheet held by two hands. One feature makes no
  /// line and swings as Pendulum.
  Sheet,
  /// Both horizontal directions: a rope, or a sheet held at one point.
  Pendulum
};

/// The anchor of one hand: which features it follows, at what offset.
template <RealScalar Scalar>
struct HandAnchor {
  /// Weight of each feature in the point that the hand follows; they sum to one.
  std::vector<Scalar> feature_weights;
  /// Hand minus that point at rest, m.
  Vector3<Scalar> offset = Vector3<Scalar>::Zero();
  /// Length L that hangs below the hand, m; 0 switches the average off.
  Scalar drop = Scalar(0);

  /// Returns an empty string, or what is wrong with an anchor for `features` features, to follow its name. Allocates.
  std::string check(Index features) const {
    if (static_cast<Index>(feature_weights.size()) != features) {
      return " has " + std::to_string(feature_weights.size()) + " weights for " + std::to_string(features) + " features";
    }
    for (const Scalar& weight : feature_weights) {
      if (!is_finite(weight)) return " has the weight " + number_text(weight);
    }
    if (!all_finite(offset)) return " has an offset that is not finite";
    if (!is_finite(drop) || drop < Scalar(0)) return " has the drop " + number_text(drop) + ", must be finite and not negative";
    return {};
  }
};

/// Anchors that keep the offsets of a start pose: features at the columns of `features` (m), hands at those of `hands`. Hand i
/// follows feature i if there are as many, else the mean of all. Allocates.
template <RealScalar Scalar>
std::vector<HandAnchor<Scalar>> make_anchors(const Points<Scalar>& features, const Points<Scalar>& hands) {
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
    anchor.drop = Scalar(0) < anchor.offset[2] ? anchor.offset[2] : Scalar(0);
    anchors.push_back(std::move(anchor));
  }
  return anchors;
}

/// Where the hand of `anchor` belongs at time `t` (s): `target(feature, time)` gives ȳ in m. `gravity`: its size, m/s².
/// Never allocates. Complexity: 33 evaluations of each feature.
template <RealScalar Scalar, class Target>
Vector3<Scalar> anchor_position(const HandAnchor<Scalar>& anchor, Swing swing, Scalar gravity, const Target& target, Scalar t) {
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
  if (swing == Swing::None || !(Scalar(0) < anchor.drop)) return now + anchor.offset;
  const Scalar tau = Scalar(2) * sqrt(anchor.drop / gravity);
  Vector3<Scalar> mean = Vector3<Scalar>::Zero();
  constexpr int kSamples = 32;
  const Scalar share = Scalar(1.0 / kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const Scalar angle = Scalar((2.0 * std::numbers::pi) * (static_cast<double>(i) + 0.5) / kSamples);
    mean += share * followed(t + tau * sin(angle));
  }
  Vector3<Scalar> ahead = mean - now;
  ahead[2] = Scalar(0);
  if (swing == Swing::Sheet && anchor.feature_weights.size() > 1) {
    const Vector3<Scalar> first = target(Index(0), t);
    const Vector3<Scalar> last = target(static_cast<Index>(anchor.feature_weights.size()) - 1, t);
    Vector3<Scalar> normal(first[1] - last[1], last[0] - first[0], Scalar(0));
    const Scalar squared = normal.squaredNorm();
    if (!(scalar_traits<Scalar>::epsilon() < squared)) return now + anchor.offset;
    ahead = normal * (normal.dot(ahead) / squared);
  }
  return now + ahead + anchor.offset;
}

}  // namespace clothctl
