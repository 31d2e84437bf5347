#pragma once

// The exact frozen predictor: the model's own linearised step, about the measured state, K frames ahead (paper 000, eq. 5-6):
//
//   A v_k = M v_{k-1} + h ( f - K q_{k-1} + E u_k ),   q_k = q_{k-1} + h v_k,   y_k = C (x + q_k)
//
// A, K and R = A - (1 + h α) M are symmetric, so the answer of output y to an input is read from the *step response* z of
// the sheet to a constant unit force on y, one lane an output, K solves in all and none for the inputs:
//
//   a = Cᵀ_y, w = 0;   repeat m = 0 … K-1:  w += A⁻¹ ( h a - h α M w - R w ),  z_m = w,  a -= h K w
//   free:      y_{m+1} = y + z_mᵀ M v + h Z_mᵀ f,                  Z_m = Σ_{i<=m} z_i
//   force:     T_m = h z_m at the held vertices
//   velocity:  T_m = -(R z_m) - h² Σ_{i<m} K z_i at the held vertices    (held rows of z are zero)
//
// Solving for the change of w keeps single precision accurate, and so does taking the mean of w out of the products where the
// response says that internal forces do not feel it (a sheet on forces moves almost as one): R w̄ = h C w̄. Cost: one
// factorisation and K solves of 3·outputs lanes.

#include <algorithm>
#include <array>
#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/window.hpp"

namespace clothctl {

/// Settings of an ExactPredictor.
template <RealScalar Scalar>
struct ExactPredictorSettings {
  /// Share of the measured net force in the prediction, 0 … 1: 0 trusts the model's force at the measured state, 1 replaces it
  /// by M ((v - v₋)/h + α v) + C₋ (v̄ - w₋) + C w - (the input that was applied), v̄ the sheet's mean velocity: air on the drift
  /// of the sheet counts once, since A holds it. Dampers are not added back: on plants that jitter they would add noise. Held
  /// vertices whose input is not known keep the model's force. For plants whose elongation is not tension.
  Scalar measured_force = Scalar(0);

  /// For plants whose elongation is not tension: the measured net force.
  static ExactPredictorSettings loose_plant() { return {Scalar(1)}; }

  /// Returns an empty string, or a line that names the bad setting and its value.
  std::string check() const {
    if (!is_finite(measured_force) || measured_force < Scalar(0) || Scalar(1) < measured_force)
      return "measured_force is " + number_text(measured_force) + ", must be 0 to 1";
    return {};
  }
};

/// Predicts with a StepResponse about the measured state. S is the planner's scalar; the response may be single precision.
template <StepResponse Response, RealScalar S = double>
class ExactPredictor {
 public:
  /// The planner's scalar.
  using Scalar = S;
  /// The scalar of the recursion.
  using Inner = typename Response::Scalar;
  /// Outputs that run side by side.
  static constexpr int kLanes = kResponseLanes<Inner>;

  /// Takes over a response. Allocates. Fails when: the settings do not pass their check (assert).
  explicit ExactPredictor(Response response, ExactPredictorSettings<S> settings = {})
      : response_(std::move(response)), settings_(settings) {
    assert(settings.check().empty());
    const Index n = response_.vertex_count();
    for (Lanes<Inner, kLanes>* lanes : {&a_, &w_, &change_, &stiff_, &coupled_}) lanes->setZero(kLanes, 3 * n);
    for (Points<Inner>* p : {&x_, &v_, &force_, &measured_, &gust_[0], &gust_[1], &gust_[2]}) p->setZero(3, n);
    last_velocity_.setZero(3, n);
    Inner count = Inner(0);
    for (Index i = 0; i < n; ++i) count += Inner(1);
    share_ = Inner(1) / count;
  }

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<S>& request, WindowResponse<S>& response) {
    response.impulse.setZero(request.output_rows(), request.inputs() * request.horizon);
    response.free.setZero(request.output_rows(), request.horizon);
    response.plan.setZero(request.inputs(), request.horizon);
    held_sum_.setZero(kLanes, request.inputs());
    gust_response_.setZero(3 * kLanes, request.horizon);
    has_last_ = false;
  }

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false when the step matrix is not
  /// positive definite. Never allocates after `reserve`. Complexity: one factorisation, K·⌈3·outputs/lanes⌉ solves.
  bool predict(const PointsView<S>& x, const PointsView<S>& v, const WindowRequest<S>& request, WindowResponse<S>& response) {
    const Index n = response_.vertex_count();
    if (x.cols() != n || v.cols() != n) return false;
    // Where nothing depends on the place, single precision is spent on the shape alone.
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
    const bool velocity_input = request.kind == InputKind::Velocity;
    const Vector3<S> wind = request.wind.col(0);
    const Inner dt = static_cast<Inner>(request.dt);
    const bool measured = S(0) < settings_.measured_force && has_last_;
    if (measured) measure_force(dt);
    if (!response_.linearise(x_, v_, wind.template cast<Inner>(), dt, velocity_input ? request.held : none_)) {
      has_last_ = false;
      return false;
    }
    gather_force(request);
    if (measured) blend_measured(request);
    for (Index first = 0; first < request.output_rows(); first += kLanes) run_lanes(first, x, request, response);
    add_plan(request.plan, response);
    response.plan = request.plan;
    last_velocity_ = v_;
    last_wind_ = wind.template cast<Inner>();
    has_last_ = true;
    return true;
  }

  /// Number of vertices of the sheet.
  Index vertex_count() const { return response_.vertex_count(); }
  /// Forgets the last frame's velocity (after a jump of the plant).
  void reset() { has_last_ = false; }
  /// The response operator at the last linearisation.
  Response& response() { return response_; }

 private:
  bool translation_free() const {
    if constexpr (requires(const Response& r) { r.translation_free() ? 0 : 1; }) return response_.translation_free();
    return false;
  }

  /// M ((v - v₋)/h + α v) + C₋ (v̄ - w₋) with the air of the last linearisation, which the response still holds.
  void measure_force(Inner dt) {
    Vector3<Inner> mean = Vector3<Inner>::Zero();
    for (Index i = 0; i < v_.cols(); ++i) mean += v_.col(i);
    mean *= share_;
    measured_.setZero();
    response_.add_wind_force(mean - last_wind_, measured_);
    for (Index i = 0; i < v_.cols(); ++i) {
      const Vector3<Inner> rate = (v_.col(i) - last_velocity_.col(i)) / dt + response_.drag() * v_.col(i);
      measured_.col(i) += response_.mass()[i] * rate;
    }
  }

  /// force = (1 - share) force + share (measured net force, without the input and in the wind of now).
  void blend_measured(const WindowRequest<S>& request) {
    const Vector3<S> wind = request.wind.col(0);
    response_.add_wind_force(wind.template cast<Inner>(), measured_);
    for (std::size_t j = 0; j < request.held.size(); ++j) {
      const int vertex = request.held[j];
      if (request.kind == InputKind::Force && request.has_applied) {
        const Vector3<S> applied = request.applied.template segment<3>(3 * static_cast<Index>(j));
        measured_.col(vertex) -= applied.template cast<Inner>();
      } else {
        measured_.col(vertex) = force_.col(vertex);
      }
    }
    force_ += static_cast<Inner>(settings_.measured_force) * (measured_ - force_);
  }

  void gather_force(const WindowRequest<S>& request) {
    force_ = response_.force();
    if (request.outer_force.cols() > 0) force_ += request.outer_force.template cast<Inner>();
    gusty_ = false;
    for (Index k = 1; k < request.horizon; ++k) gusty_ = gusty_ || !(request.wind.col(k) == request.wind.col(0));
    airy_ = false;
    for (Index c = 0; c < 3; ++c) {
      Points<Inner>& gust = gust_[static_cast<std::size_t>(c)];
      gust.setZero();
      Vector3<Inner> axis = Vector3<Inner>::Zero();
      axis[c] = Inner(1);
      response_.add_wind_force(axis, gust);
      airy_ = airy_ || Inner(0) < gust.cwiseAbs().maxCoeff();
    }
  }

  /// Runs the step responses of output rows first … first + kLanes - 1.
  void run_lanes(Index first, const PointsView<S>& x, const WindowRequest<S>& request, WindowResponse<S>& response) {
    using Lane = Eigen::Matrix<Inner, kLanes, 1>;
    const Index n = response_.vertex_count();
    const Index used = (std::min<Index>)(kLanes, request.output_rows() - first);
    const std::vector<unsigned char>& held = response_.held();
    const bool velocity_input = request.kind == InputKind::Velocity;
    const Inner dt = static_cast<Inner>(request.dt);
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
        if (held[static_cast<std::size_t>(vertex)] == 0) a_(lane, 3 * vertex + c) += static_cast<Inner>(weight);
      });
      response.free.row(row).setConstant(start);
    }
    Lane force_sum = Lane::Zero();
    for (Index m = 0; m < request.horizon; ++m) {
      for (Index i = 0; i < n; ++i) {
        if (held[static_cast<std::size_t>(i)] != 0) {
          change_.template middleCols<3>(3 * i).setZero();
        } else {
          const Inner drag = dt * response_.drag() * response_.mass()[i];
          change_.template middleCols<3>(3 * i) = dt * a_.template middleCols<3>(3 * i) -
                                                  drag * w_.template middleCols<3>(3 * i) -
                                                  coupled_.template middleCols<3>(3 * i);
        }
      }
      response_.solve(change_);
      w_ += change_;
      multiply(dt);
      a_ -= dt * stiff_;
      Lane inertia = Lane::Zero();
      for (Index i = 0; i < n; ++i) {
        const Inner mass = response_.mass()[i];
        for (Index c = 0; c < 3; ++c) {
          inertia += w_.col(3 * i + c) * (mass * v_(c, i));
          force_sum += w_.col(3 * i + c) * force_(c, i);
        }
      }
      for (Index lane = 0; lane < used; ++lane) {
        response.free(first + lane, m) += static_cast<S>(inertia[lane] + dt * force_sum[lane]);
      }
      for (std::size_t j = 0; j < request.held.size(); ++j) {
        const Index column = request.inputs() * m + 3 * static_cast<Index>(j);
        for (Index c = 0; c < 3; ++c) {
          const Index dof = 3 * request.held[j] + c;
          const Index input = 3 * static_cast<Index>(j) + c;
          for (Index lane = 0; lane < used; ++lane) {
            const Inner value = velocity_input ? -coupled_(lane, dof) - dt * dt * held_sum_(lane, input) : dt * w_(lane, dof);
            response.impulse(first + lane, column + c) = static_cast<S>(value);
          }
          held_sum_.col(input) += stiff_.col(dof);
        }
      }
      if (gusty_) gather_gust(m, used);
    }
    if (velocity_input) add_direct(first, used, request, response);
    if (gusty_) add_gusts(first, used, request, response);
  }

  /// stiff = K w, coupled = R w.
  void multiply(Inner dt) {
    if (!translation_free()) {
      response_.multiply(w_, stiff_, coupled_);
      return;
    }
    const Index n = response_.vertex_count();
    Eigen::Matrix<Inner, kLanes, 3> mean = Eigen::Matrix<Inner, kLanes, 3>::Zero();
    for (Index i = 0; i < n; ++i) mean += w_.template middleCols<3>(3 * i);
    mean *= share_;
    for (Index i = 0; i < n; ++i) change_.template middleCols<3>(3 * i) = w_.template middleCols<3>(3 * i) - mean;
    response_.multiply(change_, stiff_, coupled_);
    if (!airy_) return;
    for (Index c = 0; c < 3; ++c) {
      const Points<Inner>& gust = gust_[static_cast<std::size_t>(c)];
      for (Index i = 0; i < n; ++i) {
        for (Index d = 0; d < 3; ++d) coupled_.col(3 * i + d) += mean.col(c) * (dt * gust(d, i));
      }
    }
  }

  /// Outputs that hold a prescribed vertex move with it at once: T_m += h weight for every m.
  void add_direct(Index first, Index used, const WindowRequest<S>& request, WindowResponse<S>& response) const {
    for (Index lane = 0; lane < used; ++lane) {
      const Index row = first + lane;
      request.outputs.for_each_term(row / 3, [&](int vertex, const S& weight) {
        for (std::size_t j = 0; j < request.held.size(); ++j) {
          if (request.held[j] != vertex) continue;
          for (Index m = 0; m < request.horizon; ++m) {
            response.impulse(row, request.inputs() * m + 3 * static_cast<Index>(j) + row % 3) += request.dt * weight;
          }
        }
      });
    }
  }

  void gather_gust(Index m, Index used) {
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

  /// Wind that differs from the first frame's: y_k += h Σ_j (zᵀ_{k-j} C) (w_j - w_1).
  void add_gusts(Index first, Index used, const WindowRequest<S>& request, WindowResponse<S>& response) const {
    for (Index k = 0; k < request.horizon; ++k) {
      for (Index j = 1; j <= k; ++j) {
        for (Index lane = 0; lane < used; ++lane) {
          for (Index c = 0; c < 3; ++c) {
            const S change = request.wind(c, j) - request.wind(c, 0);
            response.free(first + lane, k) += request.dt * static_cast<S>(gust_response_(3 * lane + c, k - j)) * change;
          }
        }
      }
    }
  }

  Response response_;
  ExactPredictorSettings<S> settings_;
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

}  // namespace clothctl
