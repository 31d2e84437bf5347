#pragma once

// The linearised step of a spring network about a measured state, as an operator (StepResponse):
//
//   A v⁺ = M v + h ( f - K q + u ),   A = (1 + h α) M + R,   R = h (D + C) + h² K
//
// h step length, q displacement since the linearisation, v velocities, u input forces, f forces at
// the linearised state, M masses, α drag, K stiffness, D dampers, C air matrices. A, K and R are
// assembled once for each linearisation, and A is factored once. Some plants carry their weight by
// elongation rather than by tension, for example a position-based sheet with few sweeps. Scale
// factors on K make this model a better predictor of such plants: see StiffnessScale.

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
  /// With false, bending is left out of the matrices but stays in the force. The factor is then
  /// sparser and faster, and the model slightly worse.
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
                              ResponseSettings<Scalar> settings = {});

  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }
  /// Returns the vertex masses, n, kg.
  const VectorX<Scalar>& mass() const { return network_.mass; }
  /// Returns the mass-proportional drag α, 1/s.
  Scalar drag() const { return drag_; }
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

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/cloth/detail/mass_spring_response_impl.hpp"
