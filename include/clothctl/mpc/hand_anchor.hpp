#pragma once

// Where the hands belong while the features follow their target. The tracking cost sees only the
// features. Between them and the hands lies a swinging sheet (the control is non-collocated):
// inverting the sheet's dynamics drives the hands apart. The anchor pulls each hand to
//
//   p̄(t) = ȳ(t) + R(t) (p_rest - y_rest) + squeeze,
//
// ȳ the target of the features that it follows, p_rest and y_rest the positions of hand and
// features at rest. R turns the sheet as a rigid body with the line from the first to the last
// feature, about the vertical and as one feature rises above the other. A sheet at rest hangs so,
// whatever it is made of, as long as the hands do not carry it in a line. The squeeze moves the
// hands together along that line by k times as much as the features: what hands come together goes
// into folds of the upper edge, and little of it reaches the free edge. With g and g₀ the distance
// of the features now and at rest, h and h₀ that of the hands:
//
//   h = min( h₀ exp(k (g - g₀)/h₀), max(h₀, g₀) )
//
// In the directions in which the sheet swings, ȳ is replaced by the inverse of a hanging chain of
// length L:
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
  /// Way from the first to the last feature at rest, m, with which the offset turns; zero: it does
  /// not turn, and hands do not come together.
  Vector3<Scalar> across = Vector3<Scalar>::Zero();
  /// Place of the hand along that way at rest, from the mean of all features, m.
  Scalar along = Scalar(0);
  /// Distance h₀ of the outer hands along that way at rest, m; 0: hands do not come together.
  Scalar hand_gap = Scalar(0);
  /// How much more than the features the hands come together, k.
  Scalar gather = Scalar(2);

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
    if (!all_finite(across)) return " has a way across that is not finite";
    if (!is_finite(along)) return " has the place " + number_text(along) + " along the features";
    for (const auto& [name, value] :
         {std::pair<const char*, const Scalar*>{"distance of the hands", &hand_gap},
          {"factor of gathering", &gather},
          {"hanging length", &hanging_length}}) {
      if (!is_finite(*value) || *value < Scalar(0))
        return " has the " + std::string(name) + " " + number_text(*value) +
               ", must be finite and not negative";
    }
    return {};
  }
};

namespace detail {

/// Sets the distance of the outer hands, of those that turn with the features. Never allocates.
template <RealScalar Scalar>
void measure_hand_gap(std::vector<HandAnchor<Scalar>>& anchors) {
  Scalar low = Scalar(0), high = Scalar(0);
  bool none = true;
  for (const HandAnchor<Scalar>& anchor : anchors) {
    if (!(Scalar(0) < anchor.across.squaredNorm())) continue;
    if (none || anchor.along < low) low = anchor.along;
    if (none || high < anchor.along) high = anchor.along;
    none = false;
  }
  for (HandAnchor<Scalar>& anchor : anchors) anchor.hand_gap = high - low;
}

}  // namespace detail

/// Returns anchors that keep the offsets of a start pose, with the features at the columns of
/// `features` (m) and the hands at those of `hands` (m). Hand i follows feature i if there are as
/// many hands as features, and the mean of all features otherwise. Allocates.
template <RealScalar Scalar>
std::vector<HandAnchor<Scalar>> make_anchors(const Points<Scalar>& features,
                                             const Points<Scalar>& hands) {
  using std::sqrt;
  std::vector<HandAnchor<Scalar>> anchors;
  const Scalar number = Scalar(static_cast<double>(features.cols()));
  Vector3<Scalar> middle = Vector3<Scalar>::Zero(), across = Vector3<Scalar>::Zero();
  if (features.cols() > 0) {
    middle = features.rowwise().sum() / number;
    across = features.col(features.cols() - 1) - features.col(0);
  }
  const Scalar gap = sqrt(across.squaredNorm());
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
    if (Scalar(0) < anchor.hanging_length && scalar_traits<Scalar>::epsilon() < gap) {
      anchor.across = across;
      anchor.along = (hands.col(g) - middle).dot(across) / gap;
    }
    anchors.push_back(std::move(anchor));
  }
  detail::measure_hand_gap<Scalar>(anchors);
  return anchors;
}

namespace detail {

/// Returns the matrix that turns what hangs as the way `rest` between two features turns to `now`:
/// the columns e (along the way), n (its horizontal normal) and e × n go with it. Where a way is
/// steep (within 0.2 to 0.1 of its length from the vertical) the turn fades to none, since it has
/// no normal there. Never allocates.
template <RealScalar Scalar>
Matrix3<Scalar> hanging_turn(const Vector3<Scalar>& rest, const Vector3<Scalar>& now) {
  using std::sqrt;
  Matrix3<Scalar> frames[2];
  Scalar share = Scalar(1);
  for (int i = 0; i < 2; ++i) {
    const Vector3<Scalar>& way = i == 0 ? rest : now;
    const Scalar length = sqrt(way.squaredNorm());
    const Scalar level = sqrt(way[0] * way[0] + way[1] * way[1]);
    if (!(scalar_traits<Scalar>::epsilon() < length) || !(Scalar(0.1) * length < level))
      return Matrix3<Scalar>::Identity();
    const Scalar fade = Scalar(10) * level / length - Scalar(1);
    if (fade < share) share = fade;
    const Vector3<Scalar> e = way / length;
    const Vector3<Scalar> n(-way[1] / level, way[0] / level, Scalar(0));
    frames[i].col(0) = e;
    frames[i].col(1) = n;
    frames[i].col(2) = e.cross(n);
  }
  const Matrix3<Scalar> turn = frames[1] * frames[0].transpose();
  return share * turn + (Scalar(1) - share) * Matrix3<Scalar>::Identity();
}

/// Returns the offset of a hand from the point that it follows, with the features `across` (m)
/// apart: turned, and moved along the features as the hands come together. Never allocates.
template <RealScalar Scalar>
Vector3<Scalar> hanging_offset(const HandAnchor<Scalar>& anchor, const Vector3<Scalar>& across) {
  using std::exp;
  using std::sqrt;
  const Scalar rest = sqrt(anchor.across.squaredNorm()), gap = sqrt(across.squaredNorm());
  if (!(scalar_traits<Scalar>::epsilon() < rest) || !(scalar_traits<Scalar>::epsilon() < gap))
    return anchor.offset;
  Vector3<Scalar> turned = hanging_turn(anchor.across, across) * anchor.offset;
  const Scalar& hands = anchor.hand_gap;
  if (!(Scalar(0) < hands)) return turned;
  const Scalar widest = hands < rest ? rest : hands;
  const Scalar power = anchor.gather * (gap - rest) / hands;
  const Scalar wanted = Scalar(10) < power ? widest : Scalar(hands * exp(power));
  const Scalar squeezed = (wanted < widest ? wanted : widest) / hands - Scalar(1);
  const Scalar followed = anchor.along - anchor.offset.dot(anchor.across) / rest;
  return turned + across * ((anchor.along * squeezed - followed * (gap / rest - Scalar(1))) / gap);
}

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

/// Moves the hand of `anchor` by `jump` (m), which is measured where the features are `across` (m)
/// apart. Never allocates.
template <RealScalar Scalar>
void move_hand(HandAnchor<Scalar>& anchor, const Vector3<Scalar>& across,
               const Vector3<Scalar>& jump) {
  using std::sqrt;
  const Vector3<Scalar> at_rest = hanging_turn(anchor.across, across).transpose() * jump;
  anchor.offset += at_rest;
  const Scalar rest = sqrt(anchor.across.squaredNorm());
  if (scalar_traits<Scalar>::epsilon() < rest) anchor.along += at_rest.dot(anchor.across) / rest;
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
  const Vector3<Scalar> first = target(Index(0), t);
  const Vector3<Scalar> last = target(static_cast<Index>(anchor.feature_weights.size()) - 1, t);
  const Vector3<Scalar> across = last - first;
  Vector3<Scalar> place = now + detail::hanging_offset(anchor, across);
  if (heavy_chain_axes == HeavyChainAxes::Off || !(Scalar(0) < anchor.hanging_length)) return place;
  const Scalar tau = Scalar(2) * sqrt(anchor.hanging_length / gravity);
  Vector3<Scalar> mean = Vector3<Scalar>::Zero();
  constexpr int kSamples = 32;
  const Scalar share = Scalar(1.0 / kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const Scalar angle =
        Scalar((2.0 * std::numbers::pi) * (static_cast<double>(i) + 0.5) / kSamples);
    mean += share * followed(t + tau * sin(angle));
  }
  const Vector3<Scalar> ahead = mean - now;
  return place + detail::swing_part(anchor, heavy_chain_axes, across, ahead);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
