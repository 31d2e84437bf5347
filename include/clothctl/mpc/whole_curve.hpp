#pragma once

// The best that hands can do on a whole curve: the paths that minimise the planner's cost
// (planner_settings.hpp) over all frames at once, on the nonlinear sheet itself. A planner sees a
// window and predicts by a simpler model; what remains between its error and this one's is what a
// better controller could still gain, the rest is unavoidable for these weights.
//
//   J(p) = w_f Σ |y_k(p) - ȳ_k|² + the cost of the hands' paths (detail/hand_path_cost.hpp)
//
// Gauss-Newton with Levenberg damping λ: each iteration linearises every step of the sheet along
// the present paths p and solves
//
//   ( w_f JᵀJ + H + λ I ) d = -½ ∇J,       J = ∂y/∂p, H half the Hessian of the paths' cost
//
// by conjugate gradients, with products J v and Jᵀ w of a sweep each through the frames
// (detail/curve_sweeps.hpp). A backtracking line search on the true cost follows, so that the cost
// never rises. The minimum is a local one: where sheets can fold in several ways, another start may
// find another. Steps that fail are tried again with a stronger damping, linearised another way.
// Reference: Nocedal and Wright, Numerical Optimization (2006), chapters 3, 7 and 10.

#include <array>
#include <cassert>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring_derivative.hpp"
#include "clothctl/mpc/detail/curve_sweeps.hpp"
#include "clothctl/mpc/detail/hand_path_cost.hpp"
#include "clothctl/mpc/detail/window_cost.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a WholeCurve.
template <RealScalar Scalar>
struct WholeCurveSettings {
  /// Weights of the cost. `feature`, `velocity`, `smooth`, `jerk` and `anchor` count; the anchor is
  /// off by default, since no frame lies beyond the end of the curve.
  PlannerWeights<Scalar> weights = without_anchor({});
  /// Length of a frame h, s.
  Scalar dt = Scalar(0.02);
  /// Directions in which the hand anchor averages.
  HeavyChainAxes heavy_chain_axes = HeavyChainAxes::SheetNormal;
  /// Size of gravity, m/s² (hand anchor).
  Scalar gravity = Scalar(9.81);
  /// Largest number of Gauss-Newton iterations.
  int max_iterations = 60;
  /// Largest number of products with JᵀJ in an iteration.
  int max_products = 100;
  /// Ends as converged when an iteration expects to lower the cost by less than this share of it.
  Scalar least_decrease = Scalar(1e-4);
  /// λ of the first iteration, as a share of the feature weight.
  Scalar first_damping = Scalar(0.1);
  /// Share of the compression part of the stiffness in the linearised steps, from 0 to 1. With 1
  /// they are exact, but where the sheet is about to buckle their matrix is next to singular, and a
  /// step towards that moment's linear answer leads nowhere. With less the search sees over it. The
  /// cost is the true one in any case.
  Scalar compression = Scalar(0.9);

  /// Returns weights without an anchor.
  static PlannerWeights<Scalar> without_anchor(PlannerWeights<Scalar> weights) {
    weights.anchor = Scalar(0);
    return weights;
  }

  /// Returns the settings that optimise what a planner with `settings` optimises, but for the
  /// anchor.
  static WholeCurveSettings of(const PlannerSettings<Scalar>& settings) {
    WholeCurveSettings s;
    s.weights = without_anchor(settings.weights);
    s.dt = settings.dt;
    s.heavy_chain_axes = settings.heavy_chain_axes;
    s.gravity = settings.gravity;
    return s;
  }

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    PlannerSettings<Scalar> planner;
    planner.weights = weights;
    planner.dt = dt;
    planner.gravity = gravity;
    if (std::string problem = planner.validate(); !problem.empty()) return problem;
    if (!(Scalar(0) < weights.feature)) return "feature is 0, must be positive";
    if (max_iterations < 0)
      return "max_iterations is " + std::to_string(max_iterations) + ", must not be negative";
    if (max_products < 1)
      return "max_products is " + std::to_string(max_products) + ", must be at least 1";
    for (const auto& [name, value] : {std::pair{"least_decrease", &least_decrease},
                                      std::pair{"first_damping", &first_damping}}) {
      if (!is_finite(*value) || !(Scalar(0) < *value))
        return std::string(name) + " is " + number_text(*value) + ", must be positive";
    }
    if (!is_finite(compression) || compression < Scalar(0) || Scalar(1) < compression)
      return "compression is " + number_text(compression) + ", must be 0 to 1";
    return {};
  }
};

/// How an optimisation ended.
enum class WholeCurveStatus {
  /// Next to nothing can be gained near these paths (WholeCurveSettings::least_decrease).
  Converged,
  /// The iterations are used up.
  IterationLimit,
  /// No step lowers the cost, although one is expected to: the sheet buckles there, so that its
  /// cost has a kink, or rounding hides what is left.
  Stalled
};

/// Returns the name of a status.
constexpr std::string_view to_string(WholeCurveStatus status) {
  switch (status) {
    case WholeCurveStatus::Converged: return "converged";
    case WholeCurveStatus::IterationLimit: return "iteration_limit";
    case WholeCurveStatus::Stalled: return "stalled";
  }
  return "unknown";
}

/// Paths of hands, and what comes of them.
template <RealScalar Scalar>
struct WholeCurveResult {
  /// How the optimisation ended.
  WholeCurveStatus status = WholeCurveStatus::IterationLimit;
  /// Centroids of the grips at the ends of the frames, 3·grips × frames, m.
  MatrixX<Scalar> path;
  /// Features at the ends of the frames, 3·features × frames, m.
  MatrixX<Scalar> features;
  /// The cost J, and the norm of its exact gradient with respect to the paths, 1/m.
  Scalar cost = Scalar(0), gradient_norm = Scalar(0);
  /// J of the start and after each iteration that lowered it.
  std::vector<Scalar> costs;
  /// Iterations, products with JᵀJ, and rollouts of the whole curve.
  int iterations = 0, products = 0, rollouts = 0;
  /// Frames at whose end the exact stiffness is not definite (MassSpringDerivative): there, the
  /// gradient is not exact.
  int weakened_frames = 0;
};

/// The problem of one curve. Its memory is a factor of the step matrix for each frame: 40 MB for
/// 250 frames of 9×9 vertices, 200 MB of 17×17. Each thread needs an object of its own.
template <RealScalar S>
class WholeCurve {
 public:
  /// The scalar type.
  using Scalar = S;
  /// What an optimisation returns.
  using Answer = WholeCurveResult<Scalar>;

  /// Makes the problem of `frames` frames from time `t` (s) on, for a sheet that starts at `start`;
  /// `target(feature, time)` is the wanted position of a feature (m), also up to 2 √(L/g) before
  /// and after the curve, where the anchor of a hanging length L looks. `model` is the plant
  /// itself: integrated by Newton's method, without air. Grips translate: their vertices keep their
  /// offsets from the centroid, which is all there is to grips of one vertex. Allocates. Returns an
  /// error that names what is wrong with model, set-up, settings, start or targets.
  template <class Contact, class Features, class Target>
  static Result<WholeCurve> create(const MassSpring<Scalar>& model,
                                   const PlannerSetup<Scalar, Contact, Features>& setup,
                                   const WholeCurveSettings<Scalar>& settings,
                                   const ClothState<Scalar>& start, const Target& target, Scalar t,
                                   Index frames);

  /// Returns the number of frames.
  Index frames() const { return targets_.cols(); }
  /// Returns the targets of the features at the ends of the frames, 3·features × frames, m.
  const MatrixX<Scalar>& targets() const { return targets_; }
  /// Returns where the anchors put the hands (hand_anchor.hpp), 3·grips × frames, m: a start.
  const MatrixX<Scalar>& anchor_path() const { return anchors_; }

  /// Rolls out `path` (3·grips × frames, m) and linearises there: a result without iterations, with
  /// its cost, and in `gradient` ∂J/∂path (1/m). Allocates. Fails when the path has another size, a
  /// coordinate is not finite or beyond 10⁶ m, or the sheet cannot follow it.
  Result<Answer> evaluate(const MatrixX<Scalar>& path, MatrixX<Scalar>& gradient);

  /// Improves `path`, such as the one that a planner took. Allocates. Fails as `evaluate` does.
  Result<Answer> optimise(const MatrixX<Scalar>& path);

  /// Returns J v at the paths that were evaluated last: the change of the features (3·features ×
  /// frames) by a change `v` of the paths (3·grips × frames). Allocates. Fails when: nothing was
  /// evaluated, or `v` has another size (assert).
  MatrixX<Scalar> product(const MatrixX<Scalar>& v);

 private:
  static constexpr int kMostFailures = 8;

  WholeCurve(detail::CurveSweeps<Scalar> sweeps, detail::HandPathCost<Scalar> cost,
             const WholeCurveSettings<Scalar>& settings, MatrixX<Scalar> targets,
             MatrixX<Scalar> anchors)
      : sweeps_(std::move(sweeps)),
        cost_(std::move(cost)),
        settings_(settings),
        targets_(std::move(targets)),
        anchors_(std::move(anchors)),
        features_(targets_),
        half_gradient_(anchors_) {}

  std::string check_path(const MatrixX<Scalar>& path) const;
  /// Rolls out the path of `answer`. Returns false when the sheet cannot follow.
  bool roll_out(Answer& answer);
  /// Linearises there and makes the gradient.
  bool linearise(Answer& answer, const Scalar& compression);
  /// Improves a path that was rolled out and linearised. Returns false when nothing more can be
  /// expected, or done.
  bool improve(Answer& answer);
  /// Returns the share of the compression part to linearise with: the setting's, and others where
  /// steps with it have failed.
  Scalar compression() const;
  /// out = (w_f JᵀJ + H + λ I) v.
  void multiply(const MatrixX<Scalar>& v, MatrixX<Scalar>& out, Answer& answer);
  /// Solves for the step d by conjugate gradients. Returns the expected decrease of J.
  Scalar solve(Answer& answer);
  /// Takes the longest step d, d/2, d/4 ... that lowers the cost enough.
  bool search(Answer& answer, const Scalar& expected);

  detail::CurveSweeps<Scalar> sweeps_;
  detail::HandPathCost<Scalar> cost_;
  WholeCurveSettings<Scalar> settings_;
  MatrixX<Scalar> targets_, anchors_, features_, half_gradient_, step_;
  Scalar damping_ = Scalar(0), length_ = Scalar(0);
  bool evaluated_ = false;
  int choice_ = 0, failures_ = 0;  // of compression; of searches, one after another
};

template <RealScalar S>
template <class Contact, class Features, class Target>
auto WholeCurve<S>::create(const MassSpring<Scalar>& model,
                           const PlannerSetup<Scalar, Contact, Features>& setup,
                           const WholeCurveSettings<Scalar>& settings,
                           const ClothState<Scalar>& start, const Target& target, Scalar t,
                           Index frames) -> Result<WholeCurve> {
  std::string problem = settings.validate();
  if (problem.empty()) problem = check_state(start, model.vertex_count());
  if (problem.empty()) problem = setup.validate(model.vertex_count());
  if (problem.empty() && frames < 1) problem = std::to_string(frames) + " frames, must be positive";
  if (!problem.empty()) return Error{problem};
  detail::HeldVertices<Scalar> held;
  for (const auto& grip : setup.grips) held.add_grip(grip.vertices());
  auto derivative = MassSpringDerivative<Scalar>::create(model, held.vertices());
  if (!derivative) return Error{derivative.error()};
  PointFeatures<Scalar> features;
  features.add_map(setup.features);
  const Index grips = static_cast<Index>(setup.grips.size());
  Points<Scalar> points(3, features.count()), hands(3, grips), rates(3, grips);
  evaluate_features<Scalar>(features, start.positions, points);
  for (Index g = 0; g < grips; ++g) {
    hands.col(g) = held.centroid(start.positions, static_cast<std::size_t>(g));
    rates.col(g) = held.centroid(start.velocities, static_cast<std::size_t>(g));
  }
  const auto anchors = setup.anchors.empty() ? make_anchors<Scalar>(points, hands) : setup.anchors;
  MatrixX<Scalar> wanted(3 * features.count(), frames), places(3 * grips, frames);
  for (Index k = 0; k < frames; ++k) {
    const Scalar end = t + Scalar(static_cast<double>(k + 1)) * settings.dt;
    for (Index i = 0; i < features.count(); ++i) {
      const Vector3<Scalar> point = target(i, end);
      wanted.template block<3, 1>(3 * i, k) = point;
      if (!detail::within_reach(point))
        return Error{"the target of feature " + std::to_string(i) + " at " + number_text(end) +
                     " s is not finite or beyond 1e6 m"};
    }
    for (Index g = 0; g < grips; ++g)
      places.template block<3, 1>(3 * g, k) =
          anchor_position(anchors[static_cast<std::size_t>(g)], settings.heavy_chain_axes,
                          settings.gravity, target, end);
  }
  if (!detail::within_reach(places))
    return Error{
        "a target near the curve, which the anchor averages, is not finite or beyond 1e6 m"};
  const bool anchored = Scalar(0) < settings.weights.anchor;
  return WholeCurve(
      detail::CurveSweeps<Scalar>(model, std::move(derivative).value(), std::move(held),
                                  std::move(features), start, settings.dt, frames),
      detail::HandPathCost<Scalar>(settings.weights, settings.dt, hands, rates,
                                   anchored ? places : MatrixX<Scalar>(3 * grips, 0)),
      settings, std::move(wanted), std::move(places));
}

template <RealScalar S>
std::string WholeCurve<S>::check_path(const MatrixX<Scalar>& path) const {
  if (path.rows() != anchors_.rows() || path.cols() != frames()) {
    return "the path is " + std::to_string(path.rows()) + " x " + std::to_string(path.cols()) +
           ", must be 3 grips x frames, " + std::to_string(anchors_.rows()) + " x " +
           std::to_string(frames());
  }
  for (Index k = 0; k < frames(); ++k) {
    if (!detail::within_reach(path.col(k)))
      return "the path of frame " + std::to_string(k) + " is not finite or beyond 1e6 m";
  }
  return {};
}

template <RealScalar S>
bool WholeCurve<S>::roll_out(Answer& answer) {
  ++answer.rollouts;
  if (sweeps_.roll_out(answer.path, answer.features) >= 0) return false;
  answer.cost = settings_.weights.feature * (answer.features - targets_).squaredNorm() +
                cost_.cost(answer.path);
  return is_finite(answer.cost);
}

template <RealScalar S>
bool WholeCurve<S>::linearise(Answer& answer, const Scalar& compression) {
  using std::sqrt;
  if (!sweeps_.linearise(compression)) return false;
  answer.weakened_frames = sweeps_.weakened();
  features_ = settings_.weights.feature * (answer.features - targets_);
  sweeps_.pull(features_, half_gradient_);
  cost_.add_half_gradient(answer.path, half_gradient_);
  answer.gradient_norm = Scalar(2) * sqrt(half_gradient_.squaredNorm());
  return is_finite(answer.gradient_norm);
}

template <RealScalar S>
auto WholeCurve<S>::evaluate(const MatrixX<Scalar>& path, MatrixX<Scalar>& gradient)
    -> Result<Answer> {
  const std::string problem = check_path(path);
  if (!problem.empty()) return Error{problem};
  Answer answer;
  answer.path = path;
  answer.features = targets_;
  if (!roll_out(answer) || !linearise(answer, Scalar(1)))
    return Error{"the sheet cannot follow the path: a step fails, or has no derivative"};
  answer.costs.push_back(answer.cost);
  gradient = Scalar(2) * half_gradient_;
  evaluated_ = true;
  return answer;
}

template <RealScalar S>
MatrixX<S> WholeCurve<S>::product(const MatrixX<Scalar>& v) {
  assert(evaluated_ && v.rows() == anchors_.rows() && v.cols() == frames());
  MatrixX<Scalar> out(targets_.rows(), targets_.cols());
  sweeps_.push(v, out);
  return out;
}

template <RealScalar S>
void WholeCurve<S>::multiply(const MatrixX<Scalar>& v, MatrixX<Scalar>& out, Answer& answer) {
  ++answer.products;
  sweeps_.push(v, features_);
  features_ *= settings_.weights.feature;
  sweeps_.pull(features_, out);
  cost_.add_product(v, out);
  out += damping_ * v;
}

template <RealScalar S>
S WholeCurve<S>::solve(Answer& answer) {
  MatrixX<Scalar> r = -half_gradient_, image(r.rows(), r.cols());
  step_.setZero(r.rows(), r.cols());
  cost_.factorize(frames(), damping_ + settings_.weights.feature);  // as if J were the identity
  MatrixX<Scalar> z = r;
  cost_.solve(z);
  MatrixX<Scalar> direction = z;
  Scalar size = r.cwiseProduct(z).sum();
  const Scalar enough = Scalar(1e-4) * size;
  for (int i = 0; i < settings_.max_products && enough < size; ++i) {
    multiply(direction, image, answer);
    const Scalar length = size / direction.cwiseProduct(image).sum();
    step_ += length * direction;
    r -= length * image;
    z = r;
    cost_.solve(z);
    const Scalar last = size;
    size = r.cwiseProduct(z).sum();
    direction = z + (size / last) * direction;
  }
  // -2 d·g - d·A d, with g half the gradient and A d = -g - r.
  return r.cwiseProduct(step_).sum() - half_gradient_.cwiseProduct(step_).sum();
}

template <RealScalar S>
bool WholeCurve<S>::search(Answer& answer, const Scalar& expected) {
  Answer trial = answer;
  for (length_ = Scalar(1); Scalar(0.04) < length_; length_ *= Scalar(0.5)) {
    trial.path = answer.path + length_ * step_;
    const bool rolled = roll_out(trial);
    answer.rollouts = trial.rollouts;
    if (!rolled || !(trial.cost < answer.cost - Scalar(1e-4) * length_ * expected)) continue;
    answer = std::move(trial);
    return true;
  }
  return false;
}

template <RealScalar S>
S WholeCurve<S>::compression() const {
  const Scalar lack = Scalar(1) - settings_.compression;
  constexpr std::array<double, 4> factors{1.0, 0.25, 2.0, 0.0625};
  const Scalar share = Scalar(1) - Scalar(factors[static_cast<std::size_t>(choice_ % 4)]) * lack;
  return share < Scalar(0) ? Scalar(0) : share;
}

template <RealScalar S>
bool WholeCurve<S>::improve(Answer& answer) {
  const Scalar expected = solve(answer), before = answer.cost;
  const Scalar first = settings_.first_damping * settings_.weights.feature;
  const bool little = !(settings_.least_decrease * before < expected);
  if (little && !(first < damping_)) {
    answer.status = WholeCurveStatus::Converged;
    return false;
  }
  if (little || !search(answer, expected)) {
    if (++failures_ == kMostFailures) {
      answer.status = WholeCurveStatus::Stalled;
      return false;
    }
    damping_ = little ? first : Scalar(4) * damping_;  // little is expected of any damped step
    ++choice_;
    return roll_out(answer) && linearise(answer, compression());
  }
  failures_ = 0;
  answer.costs.push_back(answer.cost);
  const bool whole = !(length_ < Scalar(1));
  if (whole && Scalar(0.5) * expected < before - answer.cost) damping_ *= Scalar(0.2);
  if (!whole) damping_ *= Scalar(length_ < Scalar(0.4) ? 4.0 : 2.0);
  return linearise(answer, compression());
}

template <RealScalar S>
auto WholeCurve<S>::optimise(const MatrixX<Scalar>& path) -> Result<Answer> {
  MatrixX<Scalar> gradient;
  Result<Answer> start = evaluate(path, gradient);
  if (!start) return start;
  Answer answer = std::move(start).value();
  damping_ = settings_.first_damping * settings_.weights.feature;
  choice_ = failures_ = 0;
  bool goes_on = linearise(answer, compression());
  for (int i = 0; goes_on && i < settings_.max_iterations; ++i) {
    ++answer.iterations;
    goes_on = improve(answer);
  }
  Result<Answer> end = evaluate(answer.path, gradient);
  if (!end) return end;
  answer.gradient_norm = end->gradient_norm;
  answer.weakened_frames = end->weakened_frames;
  return answer;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
