#pragma once

// Identifies a predictor from recorded motion of the plant, by least squares over whole windows:
//
//   E(θ)² = 1/K Σ_k ( Σ |ŷ_k(θ) - y_k|² / Σ |y_k - y_0|² ),   least ≤ θ ≤ most,
//   minimise E(θ)² + w |θ - θ_0|²
//
// y_k are the features that were recorded in frame k = 1..K of a window, ŷ_k those that a predictor
// with the parameters θ predicts for the recorded motion of the hands, y_0 the features at the
// start of the window. The inner sums are over all windows of the record, so that each frame counts
// by its relative error; otherwise the last frames, where most is wrong, would decide alone. E is 0
// for a perfect predictor, 1 for one that says that nothing moves. The minimum is found by
// Levenberg and Marquardt's method with differences for derivatives, so any predictor will do. The
// weak pull w towards the start θ_0 keeps parameters where the record does not tell them.

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/linalg/small_cholesky.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/motion_record.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A parameter of a predictor, for `fit_predictor`.
template <RealScalar Scalar>
struct FitParameter {
  /// Where the fit starts, and what it keeps to where the record says nothing.
  Scalar start = Scalar(0);
  /// Bounds, least < most.
  Scalar least = Scalar(-1), most = Scalar(1);
};

/// Settings of a fit.
template <RealScalar Scalar>
struct FitSettings {
  /// Frames K of a window, as in the planner.
  Index horizon = 20;
  /// Frames at the start of the record that are predicted, for predictors with a memory, but do not
  /// count.
  Index skipped = 10;
  /// The weight w, for parameters of order 1.
  Scalar prior = Scalar(1e-2);
  /// Most rounds of the search; each evaluates the predictor once for each parameter, and once or
  /// more for the step.
  int rounds = 10;
  /// Differences of parameters for derivatives; half a step this short ends the search.
  Scalar difference = Scalar(0.02);

  /// Returns an empty string, or a line that names the bad setting and its value.
  std::string validate() const {
    if (horizon < 1) return "horizon is " + std::to_string(horizon) + ", must be at least 1";
    if (skipped < 0) return "skipped is " + std::to_string(skipped) + ", must not be negative";
    if (!is_finite(prior) || prior < Scalar(0))
      return "prior is " + number_text(prior) + ", must be finite and not negative";
    if (rounds < 1) return "rounds is " + std::to_string(rounds) + ", must be at least 1";
    if (!is_finite(difference) || !(Scalar(0) < difference))
      return "difference is " + number_text(difference) + ", must be positive";
    return {};
  }
};

/// The outcome of a fit.
template <RealScalar Scalar>
struct PredictorFit {
  /// The parameters θ.
  VectorX<Scalar> parameters;
  /// Relative error E of the windows at the start and at the end.
  Scalar first_error = Scalar(0), error = Scalar(0);
  /// How often the whole record was predicted.
  int evaluations = 0;
};

namespace detail {

/// The windows of a record, and what predictors say about them.
template <RealScalar Scalar>
class RecordedWindows {
 public:
  /// Keeps references to both. Allocates.
  RecordedWindows(const MotionRecord<Scalar>& record, const PointFeatures<Scalar>& features,
                  const FitSettings<Scalar>& settings)
      : record_(record), features_(features), settings_(settings) {
    request_.horizon = settings.horizon;
    request_.dt = record.dt;
    request_.kind = GripInput::Pose;
    request_.held = record.held;
    request_.outputs.add_map(features);
    request_.held_outputs = features.count();
    for (const int vertex : record.held) request_.outputs.add_point(vertex);
    request_.plan.setZero(request_.inputs(), settings.horizon);
    request_.path = request_.plan;
    request_.applied.setZero(request_.inputs());
    request_.wind.setZero(3, settings.horizon);
    measured_.setZero(3, features.count());
    start_ = measured_;
    measure_motion();
  }

  /// Returns what is wrong with the record for these settings, or an empty string.
  std::string validate() const {
    if (frames() <= settings_.skipped + settings_.horizon) {
      return "the record has " + std::to_string(frames()) + " frames, must have more than " +
             std::to_string(settings_.skipped + settings_.horizon);
    }
    if (!(Scalar(0) < scale_.minCoeff())) return "the features do not move in the record";
    return {};
  }

  /// Number of residuals.
  Index size() const { return windows() * settings_.horizon * 3 * features_.count(); }

  /// Writes the residuals of a predictor to `out`, scaled so that the sum of their squares is E².
  /// Returns false when it cannot predict, or not finitely.
  template <class Predictor>
  bool evaluate(Predictor& predictor, VectorX<Scalar>& out) {
    using Traits = predictor_traits<Predictor>;
    WindowResponse<Scalar> response;
    Traits::reserve(predictor, request_, response);
    Traits::reset(predictor);
    Index row = 0;
    for (Index frame = 0; frame + settings_.horizon <= frames(); ++frame) {
      load(frame);
      response.plan = request_.plan;
      const std::size_t at = static_cast<std::size_t>(frame);
      if (!Traits::predict(predictor, record_.positions[at], record_.velocities[at], request_,
                           response))
        return false;
      if (frame < settings_.skipped) continue;
      for (Index k = 0; k < settings_.horizon; ++k) {
        evaluate_features<Scalar>(
            features_, record_.positions[at + static_cast<std::size_t>(k + 1)], measured_);
        for (Index i = 0; i < features_.count(); ++i) {
          out.template segment<3>(row) =
              (response.free_response.template block<3, 1>(3 * i, k) - measured_.col(i)) *
              scale_[k];
          row += 3;
        }
      }
    }
    return all_finite(out);
  }

 private:
  Index frames() const { return static_cast<Index>(record_.positions.size()) - 1; }
  Index windows() const { return frames() - settings_.horizon + 1 - settings_.skipped; }

  /// Scales frame k by the size of the features' motion up to it, or by 0 where there is none.
  void measure_motion() {
    using std::sqrt;
    scale_.setZero(settings_.horizon);
    for (Index frame = settings_.skipped; frame + settings_.horizon <= frames(); ++frame) {
      evaluate_features<Scalar>(features_, record_.positions[static_cast<std::size_t>(frame)],
                                start_);
      for (Index k = 0; k < settings_.horizon; ++k) {
        evaluate_features<Scalar>(
            features_, record_.positions[static_cast<std::size_t>(frame + k + 1)], measured_);
        scale_[k] += (measured_ - start_).squaredNorm();
      }
    }
    const Scalar number = Scalar(static_cast<double>(settings_.horizon));
    for (Index k = 0; k < settings_.horizon; ++k) {
      if (Scalar(0) < scale_[k]) scale_[k] = Scalar(1) / Scalar(sqrt(number * scale_[k]));
    }
  }

  /// Returns the velocity of the j-th held vertex in the frame after `frame`.
  Vector3<Scalar> hand(Index frame, std::size_t j) const {
    const std::size_t at = static_cast<std::size_t>(frame);
    const int vertex = record_.held[j];
    return (record_.positions[at + 1].col(vertex) - record_.positions[at].col(vertex)) / record_.dt;
  }

  /// Sets the request to what the hands did from `frame` on.
  void load(Index frame) {
    for (std::size_t j = 0; j < record_.held.size(); ++j) {
      const Index row = 3 * static_cast<Index>(j);
      for (Index k = 0; k < settings_.horizon; ++k)
        request_.plan.template block<3, 1>(row, k) = hand(frame + k, j);
      if (0 < frame) request_.applied.template segment<3>(row) = hand(frame - 1, j);
    }
    request_.path = request_.plan;
    request_.has_path = true;
    request_.has_applied = 0 < frame;
  }

  const MotionRecord<Scalar>& record_;
  const PointFeatures<Scalar>& features_;
  FitSettings<Scalar> settings_;
  WindowRequest<Scalar> request_;
  Points<Scalar> measured_, start_;
  VectorX<Scalar> scale_;
};

/// Levenberg and Marquardt's method within bounds. `residuals(θ, out)` returns false where it has
/// no value.
template <RealScalar Scalar, class Residuals>
class BoundedFit {
 public:
  BoundedFit(Residuals residuals, const std::vector<FitParameter<Scalar>>& parameters,
             const FitSettings<Scalar>& settings, Index size)
      : residuals_(std::move(residuals)),
        parameters_(parameters),
        settings_(settings),
        slope_(size, count()),
        value_(VectorX<Scalar>::Zero(size)),
        trial_(value_),
        normal_(count()) {
    fit_.parameters.resize(count());
    for (Index p = 0; p < count(); ++p) fit_.parameters[p] = parameter(p).start;
  }

  /// Searches. Returns false when there are no residuals at the start.
  bool run() {
    using std::sqrt;
    if (!evaluate(fit_.parameters, value_)) return false;
    fit_.first_error = Scalar(sqrt(value_.squaredNorm()));
    for (int round = 0; round < settings_.rounds; ++round) {
      if (!differentiate() || !improve()) break;
    }
    fit_.error = Scalar(sqrt(value_.squaredNorm()));
    return true;
  }

  const PredictorFit<Scalar>& fit() const { return fit_; }

 private:
  Index count() const { return static_cast<Index>(parameters_.size()); }
  const FitParameter<Scalar>& parameter(Index p) const {
    return parameters_[static_cast<std::size_t>(p)];
  }

  bool evaluate(const VectorX<Scalar>& theta, VectorX<Scalar>& out) {
    ++fit_.evaluations;
    return residuals_(theta, out);
  }

  Scalar cost(const VectorX<Scalar>& theta, const VectorX<Scalar>& residual) const {
    Scalar sum = residual.squaredNorm();
    for (Index p = 0; p < count(); ++p) {
      const Scalar change = theta[p] - parameter(p).start;
      sum += settings_.prior * change * change;
    }
    return sum;
  }

  /// Differences towards the middle of the bounds, so that they stay within.
  bool differentiate() {
    for (Index p = 0; p < count(); ++p) {
      VectorX<Scalar> theta = fit_.parameters;
      const bool low = theta[p] + theta[p] < parameter(p).least + parameter(p).most;
      const Scalar step = low ? settings_.difference : -settings_.difference;
      theta[p] += step;
      if (!evaluate(theta, trial_)) return false;
      slope_.col(p) = (trial_ - value_) / step;
    }
    return true;
  }

  /// Returns the step with the present damping, cut at the bounds.
  bool step(VectorX<Scalar>& theta) {
    normal_.resize(count());
    VectorX<Scalar> change(count());
    for (Index p = 0; p < count(); ++p) {
      const Scalar own = slope_.col(p).squaredNorm() + settings_.prior;
      for (Index q = p; q < count(); ++q) normal_(q, p) = slope_.col(p).dot(slope_.col(q));
      normal_(p, p) = own + damping_ * own + Scalar(1e-12);
      change[p] =
          -slope_.col(p).dot(value_) - settings_.prior * (fit_.parameters[p] - parameter(p).start);
    }
    if (normal_.solve(change) != -1) return false;
    theta = fit_.parameters + change;
    for (Index p = 0; p < count(); ++p) {
      if (theta[p] < parameter(p).least) theta[p] = parameter(p).least;
      if (parameter(p).most < theta[p]) theta[p] = parameter(p).most;
    }
    return true;
  }

  /// Takes a step that lowers the cost. Returns false when there is none, or it was the last one.
  bool improve() {
    const Scalar before = cost(fit_.parameters, value_);
    VectorX<Scalar> theta(count());
    for (int attempt = 0; attempt < 6; ++attempt) {
      if (!step(theta)) return false;
      const Scalar moved = (theta - fit_.parameters).cwiseAbs().maxCoeff();
      if (evaluate(theta, trial_) && cost(theta, trial_) < before) {
        fit_.parameters = theta;
        value_.swap(trial_);
        damping_ *= Scalar(0.2);
        return Scalar(0.5) * settings_.difference < moved;
      }
      if (moved < Scalar(0.5) * settings_.difference) return false;
      damping_ *= Scalar(10);
    }
    return false;
  }

  Residuals residuals_;
  const std::vector<FitParameter<Scalar>>& parameters_;
  FitSettings<Scalar> settings_;
  MatrixX<Scalar> slope_;
  VectorX<Scalar> value_, trial_;
  SmallCholesky<Scalar> normal_;
  Scalar damping_ = Scalar(0.01);
  PredictorFit<Scalar> fit_;
};

/// Returns the windows of a record, or what is wrong with the arguments of a fit. Both must outlive
/// the windows.
template <RealScalar Scalar>
Result<RecordedWindows<Scalar>> recorded_windows(const MotionRecord<Scalar>& record,
                                                 const PointFeatures<Scalar>& features,
                                                 const FitSettings<Scalar>& settings) {
  std::string problem = settings.validate();
  if (problem.empty()) problem = record.validate();
  if (problem.empty())
    problem = validate_features<Scalar>(features, record.positions.front().cols());
  if (!problem.empty()) return Error{problem};
  RecordedWindows<Scalar> windows(record, features, settings);
  if (problem = windows.validate(); !problem.empty()) return Error{problem};
  return windows;
}

}  // namespace detail

/// Returns the relative error E of a predictor's windows over a record (see the top of this file).
/// Allocates. Fails when: settings, record or features are bad, the record is not longer than
/// `skipped` and a window, the features do not move in it, or the predictor refuses a window.
template <RealScalar Scalar, WindowPredictor P>
Result<Scalar> window_error(P& predictor, const MotionRecord<Scalar>& record,
                            const PointFeatures<Scalar>& features,
                            const FitSettings<Scalar>& settings = {}) {
  using std::sqrt;
  auto windows = detail::recorded_windows(record, features, settings);
  if (!windows) return Error{windows.error()};
  VectorX<Scalar> residual = VectorX<Scalar>::Zero(windows->size());
  if (!windows->evaluate(predictor, residual))
    return Error{"the predictor does not predict the record"};
  return Scalar(sqrt(residual.squaredNorm()));
}

/// Fits parameters of a predictor to a record (see the top of this file). `make(θ)` returns the
/// predictor with the parameters θ. Allocates. Complexity: about `rounds`·(parameters + 2)
/// predictions of every frame.
///
/// Fails when: as `window_error` with the parameters at their start; there are no parameters, or a
/// start is not within its bounds, or bounds are closer than two differences.
template <RealScalar Scalar, class Make>
Result<PredictorFit<Scalar>> fit_predictor(const Make& make,
                                           const std::vector<FitParameter<Scalar>>& parameters,
                                           const MotionRecord<Scalar>& record,
                                           const PointFeatures<Scalar>& features,
                                           const FitSettings<Scalar>& settings = {}) {
  auto windows = detail::recorded_windows(record, features, settings);
  if (!windows) return Error{windows.error()};
  if (parameters.empty()) return Error{"there are no parameters"};
  for (std::size_t p = 0; p < parameters.size(); ++p) {
    const FitParameter<Scalar>& at = parameters[p];
    const bool wide = at.least + settings.difference + settings.difference <= at.most;
    if (!wide || !(at.least <= at.start && at.start <= at.most)) {
      return Error{"parameter " + std::to_string(p) + " starts at " + number_text(at.start) +
                   " within " + number_text(at.least) + " to " + number_text(at.most)};
    }
  }
  const auto residuals = [&](const VectorX<Scalar>& theta, VectorX<Scalar>& out) {
    auto predictor = make(theta);
    return windows->evaluate(predictor, out);
  };
  detail::BoundedFit<Scalar, decltype(residuals)> fit(residuals, parameters, settings,
                                                      windows->size());
  if (!fit.run()) return Error{"the predictor does not predict the record"};
  return fit.fit();
}

/// What `identify_response` found: settings of a LinearisedPredictor and of its MassSpringResponse.
template <RealScalar Scalar, RealScalar Inner = float>
struct IdentifiedResponse {
  /// For the MassSpringResponse: factors on axial stiffness and on the effective tension.
  ResponseSettings<Inner> response = {};
  /// For the LinearisedPredictor: how much of the force is measured.
  LinearisedPredictorSettings<Scalar> predictor = {};
  /// Relative error E of the windows with the nominal settings and with these.
  Scalar nominal_error = Scalar(0), error = Scalar(0);
  /// How often the whole record was predicted.
  int evaluations = 0;
};

/// Identifies what a plant's cloth adds to the springs of `model`: the effective axial stiffness
/// (0.05 to 2 times that of the model), the effective tension (0.01 to 2 times what elongations
/// say) and how much of the net force must be measured. On plants that carry their weight by
/// unfinished sweeps this finds what WeightBearing::Elongation sets by hand. `nominal` is the
/// start, with factors within these bounds. Allocates. Complexity: 40 to 60 predictions of every
/// frame.
///
/// Fails when: as `fit_predictor`, or the record is of another mesh.
template <RealScalar Scalar, RealScalar Inner = float>
Result<IdentifiedResponse<Scalar, Inner>> identify_response(
    const MassSpring<Scalar>& model, const MotionRecord<Scalar>& record,
    const PointFeatures<Scalar>& features, const FitSettings<Scalar>& settings = {},
    const ResponseSettings<Inner>& nominal = {}) {
  using std::exp;
  using std::log;
  if (!record.positions.empty() && record.positions.front().cols() != model.vertex_count()) {
    return Error{"the record has " + std::to_string(record.positions.front().cols()) +
                 " vertices, the model " + std::to_string(model.vertex_count())};
  }
  IdentifiedResponse<Scalar, Inner> found;
  const auto apply = [&](const VectorX<Scalar>& theta) {
    found.response = nominal;
    found.response.scale.axial = static_cast<Inner>(exp(theta[0]));
    found.response.scale.geometric = static_cast<Inner>(exp(theta[1]));
    found.predictor.measured_force = theta[2];
  };
  const auto make = [&](const VectorX<Scalar>& theta) {
    apply(theta);
    return LinearisedPredictor<MassSpringResponse<Inner>, Scalar>(
        MassSpringResponse<Inner>(model, found.response), found.predictor);
  };
  const auto factor = [](const Inner& start, double least) {
    return FitParameter<Scalar>{Scalar(log(static_cast<Scalar>(start))), Scalar(log(Scalar(least))),
                                Scalar(log(Scalar(2.0)))};
  };
  const std::vector<FitParameter<Scalar>> parameters{factor(nominal.scale.axial, 0.05),
                                                     factor(nominal.scale.geometric, 0.01),
                                                     {Scalar(0), Scalar(0), Scalar(1)}};
  const Result<PredictorFit<Scalar>> fit =
      fit_predictor<Scalar>(make, parameters, record, features, settings);
  if (!fit) return Error{fit.error()};
  apply(fit->parameters);
  found.nominal_error = fit->first_error;
  found.error = fit->error;
  found.evaluations = fit->evaluations;
  return found;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
