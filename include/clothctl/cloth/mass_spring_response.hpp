#pragma once

// The linearised step of a spring network about a measured state, as an operator (StepResponse):
//
//   A v⁺ = M v + h ( f - K q + u ),   A = (1 + h α) M + R,   R = h (D + C) + h² K
//
// h step length, q displacement since the linearisation, v and v⁺ velocities before and after the
// step, u input forces, f forces at the linearised state, M masses, α drag, K stiffness, D dampers,
// C air matrices. A, K and R are assembled once for each linearisation, and A is factored once.
// Some plants carry their weight by elongation rather than by tension, for example a position-based
// sheet with few sweeps. Scale factors on K make this model a better predictor of such plants: see
// StiffnessScale.

#include <algorithm>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a MassSpringResponse.
template <RealScalar Scalar>
struct ResponseSettings {
  /// Factors on the parts of the stiffness matrix.
  StiffnessScale<Scalar> scale = {};
  /// If false, bending is left out of A and K but stays in f. The factor is then sparser and
  /// faster, and the model slightly less accurate.
  bool bending_in_matrix = true;
};

/// The linearised step (one linear solve) of a spring network. Satisfies the concept StepResponse.
/// It holds the memory of its solves, so each thread needs an object of its own.
template <RealScalar S>
class MassSpringResponse {
 public:
  /// The scalar type; float is precise enough for prediction.
  using Scalar = S;

  /// Copies the network and the dynamics (gravity, drag, air, pinned vertices) of a model, which
  /// may have another scalar. Allocates.
  template <RealScalar Other>
  explicit MassSpringResponse(const MassSpring<Other>& model,
                              const ResponseSettings<Scalar>& settings = {});

  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }
  /// Returns the vertex masses, n, kg.
  const VectorX<Scalar>& mass() const { return network_.mass; }
  /// Returns the mass-proportional drag α, 1/s.
  Scalar drag() const { return drag_; }
  /// Returns gravity, m/s².
  const Vector3<Scalar>& gravity() const { return gravity_; }
  /// Returns the forces at the linearised state, 3×n, N: springs, bending, gravity and C w, without
  /// drag and inputs.
  const Points<Scalar>& force() const { return force_; }
  /// Returns a flag for each vertex: 1 when it is driven or pinned, else 0.
  const std::vector<unsigned char>& held() const { return held_; }

  /// Returns true when a translation of the whole body changes no internal force, i.e. when the
  /// weights of every bending stencil sum to zero.
  bool translation_free() const { return translation_free_; }

  /// Linearises about positions `x` (3×n, m) and velocities `v` (3×n, m/s) in air that moves at
  /// `wind` (m/s), for steps of `dt` (s). The motion of the `driven` vertices is prescribed.
  /// Returns false when an argument is not finite or has another size, `dt` is not positive, a
  /// driven vertex is off the mesh, or the step matrix is not positive definite. After false, call
  /// nothing but `linearise`. Never allocates. Complexity: one factorisation.
  [[nodiscard]] bool linearise(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                               const Vector3<Scalar>& wind, Scalar dt,
                               const std::vector<int>& driven);

  /// Computes stiffness = K w and coupling = R w for kLanes vectors (kLanes×3n each). Never
  /// allocates. Returns false and writes nothing when an argument has another size or an output is
  /// `w` itself.
  template <int kLanes>
  bool multiply(const Lanes<Scalar, kLanes>& w, Lanes<Scalar, kLanes>& stiffness,
                Lanes<Scalar, kLanes>& coupling) const;

  /// Replaces w (kLanes×3n) by A⁻¹ w on the free vertices. Entries of held vertices must be zero
  /// and stay zero. Never allocates. Returns false and leaves w unchanged when it has another size.
  template <int kLanes>
  bool solve(Lanes<Scalar, kLanes>& w);

  /// Adds to `out` (3×n, N) the forces that a change `dw` (m/s) of the wind causes, with the air
  /// matrices of the linearised state. Never allocates. Returns false and writes nothing when `out`
  /// has another size.
  bool add_wind_force(const Vector3<Scalar>& dw, Points<Scalar>& out) const;

 private:
  SpringNetwork<Scalar> network_;
  ResponseSettings<Scalar> settings_;
  AirSettings<Scalar> air_settings_;
  Vector3<Scalar> gravity_;
  Scalar drag_;
  std::vector<int> pinned_;
  detail::SpringPattern<Scalar> pattern_;
  BlockCholesky<Scalar> factor_;
  BlockSymmetric<Scalar> stiffness_, coupling_;
  std::vector<Matrix3<Scalar>> diagonal_, air_;
  std::vector<unsigned char> held_;
  Points<Scalar> direction_, force_;
  bool translation_free_ = true;
};

// The settings come by reference: g++ 12 with AVX-512 passes the defaults of StiffnessScale<double>
// (1, 1, 1, 0) by value as (1, 1, 1, 1) from -O2 on, and then A need not be positive definite.
template <RealScalar S>
template <RealScalar Other>
MassSpringResponse<S>::MassSpringResponse(const MassSpring<Other>& model,
                                          const ResponseSettings<Scalar>& settings)
    : network_(model.network().template cast<Scalar>()),
      settings_(settings),
      air_settings_(model.settings().air.template cast<Scalar>()),
      gravity_(model.settings().gravity.template cast<Scalar>()),
      drag_(static_cast<Scalar>(model.settings().drag)),
      pinned_(model.settings().pinned) {
  pattern_ = detail::SpringPattern<Scalar>(
      network_,
      settings_.bending_in_matrix ? detail::BendingBlocks::All : detail::BendingBlocks::Absent,
      air_settings_.enabled());
  factor_ = BlockCholesky<Scalar>(
      pattern_.matrix(), nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions));
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

template <RealScalar S>
bool MassSpringResponse<S>::linearise(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                      const Vector3<Scalar>& wind, Scalar dt,
                                      const std::vector<int>& driven) {
  if (x.cols() != vertex_count() || v.cols() != vertex_count()) return false;
  for (int i : driven) {
    if (i < 0 || i >= vertex_count()) return false;
  }
  if (!all_finite(x) || !all_finite(v) || !all_finite(wind) || !is_finite(dt) || !(Scalar(0) < dt))
    return false;
  std::fill(held_.begin(), held_.end(), static_cast<unsigned char>(0));
  for (int i : pinned_) held_[static_cast<std::size_t>(i)] = 1;
  for (int i : driven) held_[static_cast<std::size_t>(i)] = 1;
  for (Index i = 0; i < vertex_count(); ++i)
    detail::set_column(force_, i, detail::triple(gravity_) * network_.mass[i]);
  detail::add_spring_forces<Scalar>(network_, x, force_);
  detail::spring_directions<Scalar>(network_, x, direction_);
  detail::freeze_air<Scalar>(network_, x, v, wind, air_settings_, air_, force_);
  stiffness_.set_zero();
  pattern_.add_springs(network_, x, settings_.scale, Scalar(1), stiffness_);
  pattern_.add_bending(network_, x, settings_.scale.bending, stiffness_);
  coupling_.set_zero();
  pattern_.add_frozen(network_, direction_, air_, dt, coupling_);
  coupling_.add_scaled(stiffness_, dt * dt);
  const Scalar inertia = Scalar(1) + dt * drag_;
  for (Index i = 0; i < vertex_count(); ++i) {
    diagonal_[static_cast<std::size_t>(i)] = coupling_.diagonal(i);
    detail::add_to_diagonal(coupling_.diagonal(i), Scalar(inertia * network_.mass[i]));
  }
  const bool definite = factor_.factorize(coupling_, held_);
  for (Index i = 0; i < vertex_count(); ++i)
    coupling_.diagonal(i) = diagonal_[static_cast<std::size_t>(i)];
  return definite;
}

template <RealScalar S>
template <int kLanes>
bool MassSpringResponse<S>::multiply(const Lanes<Scalar, kLanes>& w,
                                     Lanes<Scalar, kLanes>& stiffness,
                                     Lanes<Scalar, kLanes>& coupling) const {
  const Index columns = 3 * vertex_count();
  if (w.cols() != columns || stiffness.cols() != columns || coupling.cols() != columns)
    return false;
  if (&w == &stiffness || &w == &coupling || &stiffness == &coupling) return false;
  stiffness_.multiply(w, stiffness);
  coupling_.multiply(w, coupling);
  return true;
}

template <RealScalar S>
template <int kLanes>
bool MassSpringResponse<S>::solve(Lanes<Scalar, kLanes>& w) {
  if (w.cols() != 3 * vertex_count()) return false;
  factor_.template solve<kLanes>(w);
  return true;
}

template <RealScalar S>
bool MassSpringResponse<S>::add_wind_force(const Vector3<Scalar>& dw, Points<Scalar>& out) const {
  if (out.cols() != vertex_count()) return false;
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < air_.size(); ++e) {
    const detail::Triple<Scalar> push = detail::product(air_[e], detail::triple(dw)) * third;
    for (int i : network_.triangles[e]) detail::add_to_column(out, i, push);
  }
  return true;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class MassSpringResponse<float>);
CLOTHCTL_INSTANTIATE(MassSpringResponse<float>::MassSpringResponse(const MassSpring<double>&,
                                                                   const ResponseSettings<float>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
