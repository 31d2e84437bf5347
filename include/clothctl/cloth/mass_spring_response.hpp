#pragma once

// The linearised step of a spring network about a measured state, as an operator (StepResponse):
//
//   A v⁺ = M v + h ( f - K q + u ),   A = (1 + h α) M + R,   R = h (D + C) + h² K,   q = displacement since linearising
//
// A, K and R are assembled once a frame; A is factored once. Scale factors turn the true model into a better predictor of
// plants whose elongation is not tension (unconverged position-based sheets): see StiffnessScale.

#include <algorithm>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl {

/// Settings of a MassSpringResponse.
template <RealScalar Scalar>
struct ResponseSettings {
  /// Factors on the stiffness blocks.
  StiffnessScale<Scalar> scale = {};
  /// False leaves bending out of the matrices (it stays in the force): a sparser, faster factor, a slightly worse model.
  bool bending_in_matrix = true;

  /// For plants that carry their weight by elongation rather than tension (substepped position-based cloth): the axial and
  /// the tension part of the stiffness scaled down. Goes with ExactPredictorSettings::loose_plant and
  /// PlannerSettings::loose_plant.
  static ResponseSettings loose_plant() {
    ResponseSettings s;
    s.scale.axial = Scalar(0.2);
    s.scale.geometric = Scalar(0.04);
    return s;
  }
};

/// The linearised one-solve step of a spring network; models StepResponse. Own one for each thread.
template <RealScalar S>
class MassSpringResponse {
 public:
  /// The scalar type; float serves for prediction.
  using Scalar = S;

  /// Takes the network and the dynamics (gravity, drag, air, pins) of a model in any scalar. Allocates.
  template <RealScalar Other>
  explicit MassSpringResponse(const MassSpring<Other>& model, ResponseSettings<Scalar> settings = {})
      : network_(model.network().template cast<Scalar>()),
        settings_(settings),
        gravity_(model.settings().gravity.template cast<Scalar>()),
        drag_(static_cast<Scalar>(model.settings().drag)),
        pinned_(model.settings().pinned) {
    air_settings_.density = static_cast<Scalar>(model.settings().air.density);
    air_settings_.normal_coefficient = static_cast<Scalar>(model.settings().air.normal_coefficient);
    air_settings_.tangent_coefficient = static_cast<Scalar>(model.settings().air.tangent_coefficient);
    pattern_ = SpringPattern<Scalar>(network_, settings_.bending_in_matrix, air_settings_.enabled());
    factor_ = BlockCholesky<Scalar>(pattern_.matrix(), nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions));
    for (const BendStencil<Scalar>& b : network_.bends) {
      Scalar sum = Scalar(0), size = Scalar(0);
      for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
        sum += b.weight[i];
        size += b.weight[i] < Scalar(0) ? -b.weight[i] : b.weight[i];
      }
      const Scalar rounding = Scalar(8) * scalar_traits<Scalar>::epsilon() * size;
      translation_free_ = translation_free_ && !(rounding < sum) && !(sum < -rounding);
    }
    stiffness_ = pattern_.matrix();
    coupling_ = pattern_.matrix();
    held_.assign(static_cast<std::size_t>(vertex_count()), 0);
    direction_.setZero(3, static_cast<Index>(network_.springs.size()));
    force_.setZero(3, vertex_count());
    diagonal_.assign(static_cast<std::size_t>(vertex_count()), Matrix3<Scalar>::Zero());
    air_.assign(air_settings_.enabled() ? network_.triangles.size() : 0, Matrix3<Scalar>::Zero());
  }

  /// Number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }
  /// Vertex masses, kg.
  const VectorX<Scalar>& mass() const { return network_.mass; }
  /// Mass-proportional drag α, 1/s.
  Scalar drag() const { return drag_; }
  /// Force at the linearised state: springs, bending, gravity and C w; without drag and inputs. 3×n, N.
  const Points<Scalar>& force() const { return force_; }
  /// Flags of the vertices that are prescribed or pinned.
  const std::vector<unsigned char>& held() const { return held_; }

  /// Tells whether internal forces do not feel a translation of the whole body: the weights of every bending stencil sum to
  /// zero.
  bool translation_free() const { return translation_free_; }

  /// Linearises about positions `x` (3×n, m) and velocities `v` (3×n, m/s) in air that moves at `wind` (m/s), for steps of
  /// `dt` s; `driven` vertices are prescribed. Returns false when an argument is not finite or of another size, a
  /// driven vertex is off the mesh, or the step matrix is not positive definite; nothing but `linearise` may be called then.
  /// Never allocates. Complexity: one factorisation.
  [[nodiscard]] bool linearise(const PointsView<Scalar>& x, const PointsView<Scalar>& v, const Vector3<Scalar>& wind, Scalar dt,
                               const std::vector<int>& driven) {
    if (x.cols() != vertex_count() || v.cols() != vertex_count()) return false;
    for (int i : driven) {
      if (i < 0 || i >= vertex_count()) return false;
    }
    if (!all_finite(x) || !all_finite(v) || !all_finite(wind) || !is_finite(dt) || !(Scalar(0) < dt)) return false;
    std::fill(held_.begin(), held_.end(), static_cast<unsigned char>(0));
    for (int i : pinned_) held_[static_cast<std::size_t>(i)] = 1;
    for (int i : driven) held_[static_cast<std::size_t>(i)] = 1;
    force_.noalias() = gravity_ * network_.mass.transpose();
    add_spring_forces<Scalar>(network_, x, force_);
    spring_directions<Scalar>(network_, x, direction_);
    freeze_air<Scalar>(network_, x, v, wind, air_settings_, air_, force_);
    stiffness_.set_zero();
    pattern_.add_springs(network_, x, settings_.scale, Scalar(1), stiffness_);
    pattern_.add_bending(network_, settings_.scale.bending, stiffness_);
    coupling_.set_zero();
    pattern_.add_frozen(network_, direction_, air_, dt, coupling_);
    coupling_.add_scaled(stiffness_, dt * dt);
    const Scalar inertia = Scalar(1) + dt * drag_;
    for (Index i = 0; i < vertex_count(); ++i) {
      diagonal_[static_cast<std::size_t>(i)] = coupling_.diagonal(i);
      coupling_.diagonal(i).diagonal().array() += inertia * network_.mass[i];
    }
    const bool definite = factor_.factorize(coupling_, held_);
    for (Index i = 0; i < vertex_count(); ++i) coupling_.diagonal(i) = diagonal_[static_cast<std::size_t>(i)];
    return definite;
  }

  /// Computes stiffness = K w and coupling = R w for kLanes vectors; neither may be `w`. Never allocates.
  template <int kLanes>
  void multiply(const Lanes<Scalar, kLanes>& w, Lanes<Scalar, kLanes>& stiffness, Lanes<Scalar, kLanes>& coupling) const {
    stiffness_.multiply(w, stiffness);
    coupling_.multiply(w, coupling);
  }

  /// Replaces w by A⁻¹ w on the free vertices; held entries must be zero and stay so. Never allocates.
  template <int kLanes>
  void solve(Lanes<Scalar, kLanes>& w) {
    factor_.template solve<kLanes>(w);
  }

  /// Adds the force on each vertex (N) of a wind change `dw` (m/s) at the linearised air matrices to `out` (3×n).
  /// Never allocates.
  void add_wind_force(const Vector3<Scalar>& dw, Points<Scalar>& out) const {
    const Scalar third = Scalar(1) / Scalar(3);
    for (std::size_t e = 0; e < air_.size(); ++e) {
      const Vector3<Scalar> push = air_[e] * dw * third;
      for (int i : network_.triangles[e]) out.col(i) += push;
    }
  }

 private:
  SpringNetwork<Scalar> network_;
  ResponseSettings<Scalar> settings_;
  AirSettings<Scalar> air_settings_;
  Vector3<Scalar> gravity_;
  Scalar drag_;
  std::vector<int> pinned_;
  SpringPattern<Scalar> pattern_;
  BlockCholesky<Scalar> factor_;
  BlockSymmetric<Scalar> stiffness_, coupling_;
  std::vector<Matrix3<Scalar>> diagonal_, air_;
  std::vector<unsigned char> held_;
  Points<Scalar> direction_, force_;
  bool translation_free_ = true;
};

}  // namespace clothctl
