#pragma once

// Predicts with the model's step linearised once, at the measured state, for all K frames ([Bai
// 2016], eq. 5-6):
//
//   A v_k = M v_{k-1} + h (f - K q_{k-1} + E u_k),   q_k = q_{k-1} + h v_k,   y_k = C (x + q_k)
//
// A is the step matrix, M holds the masses and K is the stiffness (cloth/mass_spring_response.hpp).
// x are the measured positions, q_k the displacement from them after k frames of length h, v_k the
// velocity, u_k the input of frame k, which E adds to the held vertices, f the net force at the
// measured state, and y_k the outputs, with their weights C. The prediction is exact for this
// linear model. (As a number of frames or solves, K is the horizon.)
//
// A, K and R = A - (1 + h α) M are symmetric. By reciprocity, the response of an output y to any
// input can therefore be read from the step response z of the sheet to a constant unit force on y.
// This takes K solves for all outputs together, one lane for each scalar output, and none for the
// inputs:
//
//   a = Cᵀ_y, w = 0;   for m = 0 .. K-1:  w += A⁻¹ (h a - h α M w - R w),  z_m = w,  a -= h K w
//   free:    y_{m+1} = y + z_mᵀ M v + h Z_mᵀ f,                 Z_m = Σ_{i<=m} z_i
//   force:   T_m = h z_m at the held vertices
//   pose:    T_m = -(R z_m) - h² Σ_{i<m} K z_i at the held vertices   (z is zero at held vertices)
//
// Two measures keep single precision accurate: each solve is for the change of w, and the mean w̄
// of w is taken out of the products with K and R where internal forces do not feel a translation,
// since a sheet that hangs on forces moves almost as one body: K w̄ = 0 and R w̄ = h C w̄, here
// with C the air drag. Cost: one factorisation and K solves of 3·outputs lanes.

#include <algorithm>
#include <array>
#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/prediction/window.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/cloth/mass_spring_response.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a LinearisedPredictor.
template <RealScalar Scalar>
struct LinearisedPredictorSettings {
  /// How much of the predicted net force is measured, from 0 to 1. 0 takes the model's force at the
  /// measured state. 1 takes what the last frame shows, M ((v - v₋)/h + α v) + C₋ (v̄ - w₋) + C w
  /// minus the input that was applied: M are the masses, α is the drag, v₋ and w₋ are velocity and
  /// wind of the last frame, w is the wind now, v̄ the mean velocity of the sheet, C and C₋ are the
  /// matrices of the air drag now and in the last frame. Internal damping is left out, because it
  /// would add noise on plants that jitter. Vertices whose input is not known, or that were let go
  /// after it, keep the model's force. Use it for plants whose elongation does not tell their
  /// tension.
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

  /// Makes room for requests of this size. The last frame is not forgotten, whatever vertices were
  /// held in it. Allocates.
  void reserve(const WindowRequest<S>& request, WindowResponse<S>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false
  /// when sizes do not fit or the step matrix is not positive definite. Never allocates after
  /// `reserve`. Complexity: one factorisation and K·⌈3·outputs/lanes⌉ solves.
  bool predict(const PointsView<S>& x, const PointsView<S>& v, const WindowRequest<S>& request,
               WindowResponse<S>& response) {
    if (!predict_air(x, v, request, response)) return false;
    predict_rest(x, request, response);
    return true;
  }
  /// The first part of `predict`: linearises, and writes `response.air`. Fails as `predict` does.
  bool predict_air(const PointsView<S>& x, const PointsView<S>& v, const WindowRequest<S>& request,
                   WindowResponse<S>& response);
  /// The second part, which may be left out: the rest of the response. Never allocates.
  void predict_rest(const PointsView<S>& x, const WindowRequest<S>& request,
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
  /// Blends the model's force with the measured one, after it has subtracted the applied input from
  /// the latter and added the force of the present wind.
  void blend_measured(const WindowRequest<S>& request);
  void gather_force(const WindowRequest<S>& request);
  /// Returns the mean acceleration by outer forces and supports across gravity, which hang the
  /// sheet askew as air does, times the share of the weight that they do not bear: what lies on a
  /// table does not hang. Zero for a response that tells no gravity.
  Vector3<S> level_outer_acceleration(const WindowRequest<S>& request) const;
  /// Writes the acceleration by the air drag of the linearisation, and by outer forces.
  void write_air(const WindowRequest<S>& request, WindowResponse<S>& response) const;

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
  std::vector<int> none_, last_held_;
  Inner share_ = Inner(0), mass_ = Inner(0);  // of a vertex in a mean; of the sheet, kg
  bool airy_ = false;
  bool has_last_ = false;
  bool gusty_ = false;
};

template <StepResponse Response, RealScalar S>
LinearisedPredictor<Response, S>::LinearisedPredictor(Response response,
                                                      LinearisedPredictorSettings<S> settings)
    : response_(std::move(response)), settings_(settings) {
  assert(settings.validate().empty());
  const Index n = Traits::vertex_count(response_);
  for (Lanes<Inner, kLanes>* lanes : {&a_, &w_, &change_, &stiff_, &coupled_})
    lanes->setZero(kLanes, 3 * n);
  for (Points<Inner>* p : {&x_, &v_, &force_, &measured_}) p->setZero(3, n);
  for (Points<Inner>& gust : gust_) gust.setZero(3, n);
  last_velocity_.setZero(3, n);
  Inner count = Inner(0);
  for (Index i = 0; i < n; ++i) {
    count += Inner(1);
    mass_ += Traits::mass(response_)[i];
  }
  share_ = Inner(1) / count;
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::reserve(const WindowRequest<S>& request,
                                               WindowResponse<S>& response) {
  response.impulse_response.setZero(request.output_rows(), request.inputs() * request.horizon);
  response.free_response.setZero(request.output_rows(), request.horizon);
  response.plan.setZero(request.inputs(), request.horizon);
  response.air.setZero(3, request.horizon);
  held_sum_.setZero(kLanes, request.inputs());
  gust_response_.setZero(3 * kLanes, request.horizon);
  last_held_.reserve(request.held.size());
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::predict_rest(const PointsView<S>& x,
                                                    const WindowRequest<S>& request,
                                                    WindowResponse<S>& response) {
  for (Index first = 0; first < request.output_rows(); first += kLanes)
    run_lanes(first, x, request, response);
  add_plan(request.plan, response);
  response.plan = request.plan;
}

template <StepResponse Response, RealScalar S>
bool LinearisedPredictor<Response, S>::predict_air(const PointsView<S>& x, const PointsView<S>& v,
                                                   const WindowRequest<S>& request,
                                                   WindowResponse<S>& response) {
  const Index n = Traits::vertex_count(response_);
  if (x.cols() != n || v.cols() != n || !request.supports_fit(n)) return false;
  // If translations have no effect, only the shape is stored in single precision.
  Vector3<S> place = Vector3<S>::Zero();
  if (translation_free()) {
    for (Index i = 0; i < n; ++i) place += x.col(i);
    place *= static_cast<S>(share_);
  }
  for (Index i = 0; i < n; ++i) {
    const Vector3<S> local = x.col(i) - place;
    x_.col(i) = local.template cast<Inner>();
  }
  v_ = v.template cast<Inner>();
  const Vector3<S> wind = request.wind.col(0);
  const Inner dt = static_cast<Inner>(request.dt);
  const bool measured = S(0) < settings_.measured_force && has_last_;
  if (measured) measure_force(dt);
  if (!Traits::linearise(response_, x_, v_, wind.template cast<Inner>(), dt,
                         request.kind == GripInput::Pose ? request.held : none_)) {
    has_last_ = false;
    return false;
  }
  gather_force(request);
  write_air(request, response);
  if (measured) blend_measured(request);
  last_velocity_ = v_;
  last_wind_ = wind.template cast<Inner>();
  last_held_ = request.held;
  has_last_ = true;
  return true;
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::measure_force(Inner dt) {
  Vector3<Inner> mean = Vector3<Inner>::Zero();
  for (Index i = 0; i < v_.cols(); ++i) mean += v_.col(i);
  mean *= share_;
  measured_.setZero();
  Traits::add_wind_force(response_, mean - last_wind_, measured_);
  for (Index i = 0; i < v_.cols(); ++i) {
    const Vector3<Inner> rate =
        (v_.col(i) - last_velocity_.col(i)) / dt + Traits::drag(response_) * v_.col(i);
    measured_.col(i) += Traits::mass(response_)[i] * rate;
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::blend_measured(const WindowRequest<S>& request) {
  const Vector3<S> wind = request.wind.col(0);
  Traits::add_wind_force(response_, wind.template cast<Inner>(), measured_);
  for (const int vertex : last_held_) {  // what was let go felt an input that is not known here
    if (std::find(request.held.begin(), request.held.end(), vertex) == request.held.end())
      measured_.col(vertex) = force_.col(vertex);
  }
  for (std::size_t j = 0; j < request.held.size(); ++j) {
    const int vertex = request.held[j];
    if (request.kind == GripInput::Force && request.has_applied) {
      const Vector3<S> applied = request.applied.template segment<3>(3 * static_cast<Index>(j));
      measured_.col(vertex) -= applied.template cast<Inner>();
    } else {
      measured_.col(vertex) = force_.col(vertex);
    }
  }
  force_ += static_cast<Inner>(settings_.measured_force) * (measured_ - force_);
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::gather_force(const WindowRequest<S>& request) {
  force_ = Traits::force(response_);
  if (request.outer_force.cols() > 0) force_ += request.outer_force.template cast<Inner>();
  for (const VertexSupport<S>& support : request.supports)
    force_.col(support.vertex) += support.force.template cast<Inner>();
  gusty_ = false;
  for (Index k = 1; k < request.horizon; ++k)
    gusty_ = gusty_ || !(request.wind.col(k) == request.wind.col(0));
  airy_ = false;
  for (Index c = 0; c < 3; ++c) {
    Points<Inner>& gust = gust_[static_cast<std::size_t>(c)];
    gust.setZero();
    Vector3<Inner> axis = Vector3<Inner>::Zero();
    axis[c] = Inner(1);
    Traits::add_wind_force(response_, axis, gust);
    airy_ = airy_ || Inner(0) < gust.cwiseAbs().maxCoeff();
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::write_air(const WindowRequest<S>& request,
                                                 WindowResponse<S>& response) const {
  Matrix3<S> rate;
  for (Index c = 0; c < 3; ++c) {
    const Vector3<Inner> force = gust_[static_cast<std::size_t>(c)].rowwise().sum();
    for (Index d = 0; d < 3; ++d) rate(d, c) = static_cast<S>(force[d] / mass_);
  }
  const S drag = static_cast<S>(Traits::drag(response_));
  const Vector3<S> level = level_outer_acceleration(request);
  for (Index k = 0; k < request.horizon; ++k) {
    Vector3<S> drift = Vector3<S>::Zero();
    if (request.drift.cols() > 0) drift = request.drift.col(k);
    const Vector3<S> relative = request.wind.col(k) - drift;
    response.air.col(k) = rate * relative - drag * drift + level;
  }
}

template <StepResponse Response, RealScalar S>
Vector3<S> LinearisedPredictor<Response, S>::level_outer_acceleration(
    const WindowRequest<S>& request) const {
  Vector3<S> level = Vector3<S>::Zero();
  if constexpr (requires { Traits::gravity(response_); }) {
    const Vector3<Inner> pull = Traits::gravity(response_);
    const Vector3<S> gravity = pull.template cast<S>();
    const S squared = gravity.squaredNorm();
    const bool none = request.outer_force.cols() == 0 && request.supports.empty();
    if (none || !(S(0) < squared)) return level;
    for (Index i = 0; i < request.outer_force.cols(); ++i) level += request.outer_force.col(i);
    for (const VertexSupport<S>& support : request.supports) level += support.force;
    level /= static_cast<S>(mass_);
    const S borne = -level.dot(gravity) / squared;
    level += borne * gravity;
    if (S(0) < borne) level *= borne < S(1) ? S(1) - borne : S(0);
  }
  return level;
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::start_lanes(Index first, Index used, const PointsView<S>& x,
                                                   const WindowRequest<S>& request,
                                                   WindowResponse<S>& response) {
  const std::vector<unsigned char>& held = Traits::held(response_);
  a_.setZero();
  w_.setZero();
  stiff_.setZero();
  coupled_.setZero();
  held_sum_.setZero();
  for (Index lane = 0; lane < used; ++lane) {
    const Index row = first + lane;
    const Index c = row % 3;
    S start = Scalar(0);
    request.outputs.for_each_term(row / 3, [&](int vertex, const S& weight) {
      start += weight * x(c, vertex);
      if (held[static_cast<std::size_t>(vertex)] == 0)
        a_(lane, 3 * vertex + c) += static_cast<Inner>(weight);
    });
    response.free_response.row(row).setConstant(start);
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::read_impulse_response(Index m, Index first, Index used,
                                                             const WindowRequest<S>& request,
                                                             WindowResponse<S>& response) {
  const bool velocity_input = request.kind == GripInput::Pose;
  const Inner dt = static_cast<Inner>(request.dt);
  for (std::size_t j = 0; j < request.held.size(); ++j) {
    const Index column = request.inputs() * m + 3 * static_cast<Index>(j);
    for (Index c = 0; c < 3; ++c) {
      const Index dof = 3 * request.held[j] + c;
      const Index input = 3 * static_cast<Index>(j) + c;
      for (Index lane = 0; lane < used; ++lane) {
        const Inner value = velocity_input ? -coupled_(lane, dof) - dt * dt * held_sum_(lane, input)
                                           : dt * w_(lane, dof);
        response.impulse_response(first + lane, column + c) = static_cast<S>(value);
      }
      held_sum_.col(input) += stiff_.col(dof);
    }
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::run_lanes(Index first, const PointsView<S>& x,
                                                 const WindowRequest<S>& request,
                                                 WindowResponse<S>& response) {
  using Lane = Eigen::Matrix<Inner, kLanes, 1>;
  const Index n = Traits::vertex_count(response_);
  const Index used = (std::min<Index>)(kLanes, request.output_rows() - first);
  const std::vector<unsigned char>& held = Traits::held(response_);
  const Inner dt = static_cast<Inner>(request.dt);
  start_lanes(first, used, x, request, response);
  Lane force_sum = Lane::Zero();
  for (Index m = 0; m < request.horizon; ++m) {
    for (Index i = 0; i < n; ++i) {
      if (held[static_cast<std::size_t>(i)] != 0) {
        change_.template middleCols<3>(3 * i).setZero();
      } else {
        const Inner drag = dt * Traits::drag(response_) * Traits::mass(response_)[i];
        change_.template middleCols<3>(3 * i) = dt * a_.template middleCols<3>(3 * i) -
                                                drag * w_.template middleCols<3>(3 * i) -
                                                coupled_.template middleCols<3>(3 * i);
      }
    }
    Traits::solve(response_, change_);
    w_ += change_;
    multiply(dt);
    a_ -= dt * stiff_;
    Lane inertia = Lane::Zero();
    for (Index i = 0; i < n; ++i) {
      const Inner mass = Traits::mass(response_)[i];
      for (Index c = 0; c < 3; ++c) {
        inertia += w_.col(3 * i + c) * (mass * v_(c, i));
        force_sum += w_.col(3 * i + c) * force_(c, i);
      }
    }
    for (Index lane = 0; lane < used; ++lane) {
      response.free_response(first + lane, m) +=
          static_cast<S>(inertia[lane] + dt * force_sum[lane]);
    }
    read_impulse_response(m, first, used, request, response);
    if (gusty_) gather_gust(m, used);
  }
  if (request.kind == GripInput::Pose) add_direct(first, used, request, response);
  if (gusty_) add_gusts(first, used, request, response);
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::multiply(Inner dt) {
  if (!translation_free()) {
    Traits::multiply(response_, w_, stiff_, coupled_);
    return;
  }
  const Index n = Traits::vertex_count(response_);
  Eigen::Matrix<Inner, kLanes, 3> mean = Eigen::Matrix<Inner, kLanes, 3>::Zero();
  for (Index i = 0; i < n; ++i) mean += w_.template middleCols<3>(3 * i);
  mean *= share_;
  for (Index i = 0; i < n; ++i)
    change_.template middleCols<3>(3 * i) = w_.template middleCols<3>(3 * i) - mean;
  Traits::multiply(response_, change_, stiff_, coupled_);
  if (!airy_) return;
  for (Index c = 0; c < 3; ++c) {
    const Points<Inner>& gust = gust_[static_cast<std::size_t>(c)];
    for (Index i = 0; i < n; ++i) {
      for (Index d = 0; d < 3; ++d) coupled_.col(3 * i + d) += mean.col(c) * (dt * gust(d, i));
    }
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::add_direct(Index first, Index used,
                                                  const WindowRequest<S>& request,
                                                  WindowResponse<S>& response) const {
  for (Index lane = 0; lane < used; ++lane) {
    const Index row = first + lane;
    request.outputs.for_each_term(row / 3, [&](int vertex, const S& weight) {
      for (std::size_t j = 0; j < request.held.size(); ++j) {
        if (request.held[j] != vertex) continue;
        for (Index m = 0; m < request.horizon; ++m) {
          response.impulse_response(row, request.inputs() * m + 3 * static_cast<Index>(j) +
                                             row % 3) += request.dt * weight;
        }
      }
    });
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::gather_gust(Index m, Index used) {
  for (Index lane = 0; lane < used; ++lane) {
    for (Index c = 0; c < 3; ++c) {
      const Points<Inner>& gust = gust_[static_cast<std::size_t>(c)];
      Inner sum = Inner(0);
      for (Index i = 0; i < gust.cols(); ++i) {
        for (Index d = 0; d < 3; ++d) sum += w_(lane, 3 * i + d) * gust(d, i);
      }
      gust_response_(3 * lane + c, m) = sum;
    }
  }
}

template <StepResponse Response, RealScalar S>
void LinearisedPredictor<Response, S>::add_gusts(Index first, Index used,
                                                 const WindowRequest<S>& request,
                                                 WindowResponse<S>& response) const {
  for (Index k = 0; k < request.horizon; ++k) {
    for (Index j = 1; j <= k; ++j) {
      for (Index lane = 0; lane < used; ++lane) {
        for (Index c = 0; c < 3; ++c) {
          const S change = request.wind(c, j) - request.wind(c, 0);
          response.free_response(first + lane, k) +=
              request.dt * static_cast<S>(gust_response_(3 * lane + c, k - j)) * change;
        }
      }
    }
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class LinearisedPredictor<MassSpringResponse<float>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
