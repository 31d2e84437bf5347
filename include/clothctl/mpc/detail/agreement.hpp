#pragma once

// How well the plant does what the last frame predicted:
//
//   error     = rms of the distances between measured and predicted features
//   agreement = 1 - error / max(1 mm, rms of the features' motion in the last frame), in [0, 1]

#include <cmath>

#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Remembers the features that a frame measured and those that it predicted for the next one.
template <RealScalar Scalar>
class PredictionAgreement {
 public:
  /// Makes room. Allocates.
  void reserve(Index feature_count) {
    measured_.setZero(3, feature_count);
    last_ = measured_;
    predicted_ = measured_;
  }

  /// Measures the features at `x` (3×n, m). Writes prediction_error and agreement of `result`;
  /// without a prediction they are 0 and 1. Never allocates.
  template <class Features>
  void measure(const Features& features, const PointsView<Scalar>& x, bool has_prediction,
               PlanResult<Scalar>& result) {
    using std::sqrt;
    last_.swap(measured_);
    evaluate_features<Scalar>(features, x, measured_);
    result.prediction_error = Scalar(0);
    result.agreement = Scalar(1);
    if (!has_prediction) return;
    const Scalar number = Scalar(static_cast<double>(measured_.cols()));
    result.prediction_error = sqrt((measured_ - predicted_).squaredNorm() / number);
    Scalar moved = sqrt((measured_ - last_).squaredNorm() / number);
    if (moved < Scalar(1e-3)) moved = Scalar(1e-3);
    result.agreement = Scalar(1) - result.prediction_error / moved;
    if (result.agreement < Scalar(0)) result.agreement = Scalar(0);
  }

  /// Keeps the features predicted for the end of this frame: column 0 of a 3·features × K matrix,
  /// m. Never allocates.
  void predict(const MatrixX<Scalar>& predicted) {
    for (Index i = 0; i < predicted_.cols(); ++i)
      predicted_.col(i) = predicted.template block<3, 1>(3 * i, 0);
  }

  /// The features at the last measurement, 3×features, m.
  const Points<Scalar>& measured() const { return measured_; }

 private:
  Points<Scalar> measured_, last_, predicted_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
