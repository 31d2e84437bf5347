#pragma once

// Stacks the rows of the window's least-squares cost, so that one pass condenses them all. Three
// rows belong to a point z = Σ w_o y_o of the predicted outputs, differenced n times in time:
//
//   e_k = s (Σ_i b_i z_{k-i} - target_k),   b = 1 | 1,-1 | 1,-2,1 | 1,-3,3,-1
//
// Frames are k = 1..K. z_0, z_-1 and z_-2 come from measurements. Features whose response changes
// along the window (WindowResponse::jacobian) have rows of their own, e_k = s (y_k - target_k).

#include <array>
#include <cassert>
#include <span>

#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One output in a weighted sum.
template <RealScalar Scalar>
struct OutputTerm {
  /// Index of the output point.
  Index output;
  /// Its weight.
  Scalar weight;
};

/// Weighted, differenced outputs of a window. Made for a largest number of rows; `add` never
/// allocates.
template <RealScalar Scalar>
class TermStack {
 public:
  /// Makes room for `max_rows` rows, and for the features. Allocates.
  void reserve(Index max_rows, Index features, Index inputs, Index horizon) {
    blocks_.setZero(max_rows, inputs * horizon);
    feature_response_.setZero(inputs * horizon, 3 * features * horizon);
    feature_residual_.setZero(3 * features, horizon);
    residual_.setZero(max_rows, horizon);
    rows_ = 0;
  }
  /// Removes all rows.
  void clear() {
    rows_ = 0;
    has_features_ = false;
  }
  /// Returns the number of scalar rows.
  Index rows() const { return rows_; }
  /// Returns the response of all rows to the raw inputs, Z_0 .. Z_{K-1} side by side, rows ×
  /// inputs·K.
  auto blocks() const { return blocks_.topRows(rows_); }
  /// Returns the residuals e_k of all rows at the plan, rows × K.
  auto residual() const { return residual_.topRows(rows_); }

  /// True when the features were added by their Jacobian.
  bool has_features() const { return has_features_; }
  /// Returns their responses, (inputs·K) × (3·features·K): column 3 F k + i is the response of row
  /// i in frame k to all inputs.
  const MatrixX<Scalar>& feature_response() const { return feature_response_; }
  /// Returns their residuals e_k at the plan, 3·features × K.
  const MatrixX<Scalar>& feature_residual() const { return feature_residual_; }

  /// Adds the rows of all features of a window that has their Jacobian. `targets`: 3·features × K,
  /// m.
  void add_features(const WindowResponse<Scalar>& window, Scalar scale,
                    const MatrixX<Scalar>& targets) {
    has_features_ = true;
    feature_response_ = scale * window.jacobian.transpose();
    feature_residual_ = scale * (window.free_response.topRows(targets.rows()) - targets);
  }

  /// Adds the three rows of a point. `past`: z_0, z_-1, z_-2. `order`: number of differences, 0 to
  /// 3. `scale`: s, i.e. √weight, divided by h where the weight is on velocities. `target(k - 1)`:
  /// target_k, for k = 1..K.
  template <class Target>
  void add(const WindowResponse<Scalar>& window, std::span<const OutputTerm<Scalar>> point,
           const std::array<Vector3<Scalar>, 3>& past, int order, Scalar scale,
           const Target& target) {
    if (!(Scalar(0) < scale)) return;
    static const std::array<std::array<double, 4>, 4> kBinomials{
        {{1, 0, 0, 0}, {1, -1, 0, 0}, {1, -2, 1, 0}, {1, -3, 3, -1}}};
    const Index horizon = residual_.cols();
    const Index inputs = blocks_.cols() / horizon;
    assert(rows_ + 3 <= blocks_.rows() && order >= 0 && order <= 3);
    blocks_.middleRows(rows_, 3).setZero();
    for (Index k = 0; k < horizon; ++k) {
      Vector3<Scalar> sum = Vector3<Scalar>::Zero();
      for (int i = 0; i <= order; ++i) {
        const Scalar b =
            Scalar(kBinomials[static_cast<std::size_t>(order)][static_cast<std::size_t>(i)]);
        const Index frame = k - i;
        if (frame >= 0) {
          for (const OutputTerm<Scalar>& t : point) {
            sum += (b * t.weight) * window.free_response.template block<3, 1>(3 * t.output, frame);
            blocks_.block(rows_, k * inputs, 3, inputs) +=
                (scale * b * t.weight) *
                window.impulse_response.block(3 * t.output, frame * inputs, 3, inputs);
          }
        } else {
          sum += b * past[static_cast<std::size_t>(-frame - 1)];
        }
      }
      const Vector3<Scalar> wanted = target(k);
      residual_.template block<3, 1>(rows_, k) = scale * (sum - wanted);
    }
    rows_ += 3;
  }

  /// Adds three rows that keep the differenced point where the plan has it: e_k = s Σ_i b_i
  /// (z_{k-i} - z̄_{k-i}), z̄ at the plan of the prediction.
  void add_change(const WindowResponse<Scalar>& window, std::span<const OutputTerm<Scalar>> point,
                  int order, Scalar scale) {
    const Index before = rows_;
    const std::array<Vector3<Scalar>, 3> still{Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero(),
                                               Vector3<Scalar>::Zero()};
    add(window, point, still, order, scale,
        [](Index) { return Vector3<Scalar>(Vector3<Scalar>::Zero()); });
    residual_.middleRows(before, rows_ - before).setZero();
  }

 private:
  MatrixX<Scalar> blocks_, residual_, feature_response_, feature_residual_;
  bool has_features_ = false;
  Index rows_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
