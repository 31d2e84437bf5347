#pragma once

// Predicts with the model's step linearised once, at the measured state, for all K frames ([Bai
// 2016], eq. 5-6):
//
//   A v_k = M v_{k-1} + h (f - K q_{k-1} + E u_k),   q_k = q_{k-1} + h v_k,   y_k = C (x + q_k)
//
// x are the measured positions, q_k the displacement from them after k frames of length h, v_k the
// velocity, u_k the input of frame k, f the net force at the measured state, and y_k the outputs.
// The prediction is exact for this linear model.
//
// A, K and R = A - (1 + h α) M are symmetric. By reciprocity, the response of an output y to any
// input can therefore be read from the step response z of the sheet to a constant unit force on y.
// This takes K solves for all outputs together, one lane an output, and none for the inputs:
//
//   a = Cᵀ_y, w = 0;   for m = 0 .. K-1:  w += A⁻¹ (h a - h α M w - R w),  z_m = w,  a -= h K w
//   free:    y_{m+1} = y + z_mᵀ M v + h Z_mᵀ f,                 Z_m = Σ_{i<=m} z_i
//   force:   T_m = h z_m at the held vertices
//   pose:    T_m = -(R z_m) - h² Σ_{i<m} K z_i at the held vertices   (z is zero at held vertices)
//
// Two measures keep single precision accurate: each solve is for the change of w, and the mean of w
// is taken out of the products with K and R where internal forces do not feel a translation, since
// a sheet that hangs on forces moves almost as one body: R w̄ = h C w̄, C the air drag. Cost: one
// factorisation and K solves of 3·outputs lanes.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a LinearisedPredictor.
template <RealScalar Scalar>
struct LinearisedPredictorSettings {
  /// How much of the predicted net force is measured, from 0 to 1. 0 takes the model's force at the
  /// measured state. 1 takes what the last frame shows, M ((v - v₋)/h + α v) + C₋ (v̄ - w₋) + C w
  /// minus the input that was applied: v₋ and w₋ are velocity and wind of the last frame, v̄ is the
  /// mean velocity of the sheet, C and C₋ are the air drag now and then. Internal damping is left
  /// out, because it would add noise on plants that jitter. Held vertices whose input is not known
  /// keep the model's force. For plants whose elongation does not tell their tension.
  Scalar measured_force = Scalar(0);

  /// Returns an empty string, or a line that names the bad setting and its value.
  std::string validate() const {
    if (!is_finite(measured_force) || measured_force < Scalar(0) || Scalar(1) < measured_force)
      return "measured_force is " + number_text(measured_force) + ", must be 0 to 1";
    return {};
  }
};

/// Predicts with a StepResponse linearised at the measured state. `S` is the scalar type of the
/// planner; that of the response may be single precision.
template <StepResponse Response, RealScalar S = double>
class LinearisedPredictor {
 public:
  /// The planner's scalar.
  using Scalar = S;
  /// The scalar type of the response.
  using Inner = typename step_response_traits<Response>::scalar_type;
  /// Number of outputs that are solved for side by side.
  static constexpr int kLanes = kResponseLanes<Inner>;

  /// Takes a response. Allocates. Fails when the settings are not valid (assert).
  explicit LinearisedPredictor(Response response, LinearisedPredictorSettings<S> settings = {});

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<S>& request, WindowResponse<S>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false
  /// when sizes do not fit or the step matrix is not positive definite. Never allocates after
  /// `reserve`. Complexity: one factorisation and K·⌈3·outputs/lanes⌉ solves.
  bool predict(const PointsView<S>& x, const PointsView<S>& v, const WindowRequest<S>& request,
               WindowResponse<S>& response);

  /// Returns the number of vertices of the sheet.
  Index vertex_count() const { return Traits::vertex_count(response_); }
  /// Forgets the last frame. Call it after the plant jumped.
  void reset() { has_last_ = false; }
  /// Returns the response, linearised where the last prediction was made.
  Response& response() { return response_; }

 private:
  using Traits = step_response_traits<Response>;

  bool translation_free() const {
    if constexpr (requires { Traits::translation_free(response_); })
      return Traits::translation_free(response_);
    return false;
  }

  /// Writes M ((v - v₋)/h + α v) + C₋ (v̄ - w₋). The response still holds C₋, the air drag of the
  /// last linearisation.
  void measure_force(Inner dt);

  /// Blends the model's force with the measured one, which counts neither the input nor the change
  /// of the wind.
  void blend_measured(const WindowRequest<S>& request);

  void gather_force(const WindowRequest<S>& request);

  /// Starts the lanes of the output rows first .. first + used - 1: a = Cᵀ, w = 0, and the free
  /// response at the measured outputs.
  void start_lanes(Index first, Index used, const PointsView<S>& x, const WindowRequest<S>& request,
                   WindowResponse<S>& response);

  /// Writes T_m of the lanes' rows, and sums K z for the next frames.
  void read_impulse_response(Index m, Index first, Index used, const WindowRequest<S>& request,
                             WindowResponse<S>& response);

  /// Computes the step responses of the output rows first .. first + kLanes - 1.
  void run_lanes(Index first, const PointsView<S>& x, const WindowRequest<S>& request,
                 WindowResponse<S>& response);

  /// stiff = K w, coupled = R w.
  void multiply(Inner dt);

  /// Adds the direct part of outputs that contain a prescribed vertex: they move with it at once,
  /// T_m += h weight for every m.
  void add_direct(Index first, Index used, const WindowRequest<S>& request,
                  WindowResponse<S>& response) const;

  void gather_gust(Index m, Index used);

  /// Adds wind that differs from that of the first frame: y_k += h Σ_j (zᵀ_{k-j} C) (w_j - w_1).
  void add_gusts(Index first, Index used, const WindowRequest<S>& request,
                 WindowResponse<S>& response) const;

  Response response_;
  LinearisedPredictorSettings<S> settings_;
  Lanes<Inner, kLanes> a_, w_, change_, stiff_, coupled_, held_sum_;
  Points<Inner> x_, v_, force_, measured_, last_velocity_;
  Vector3<Inner> last_wind_ = Vector3<Inner>::Zero();
  std::array<Points<Inner>, 3> gust_;
  MatrixX<Inner> gust_response_;
  std::vector<int> none_;
  Inner share_ = Inner(0);
  bool airy_ = false;
  bool has_last_ = false;
  bool gusty_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/mpc/detail/linearised_predictor_impl.hpp"
