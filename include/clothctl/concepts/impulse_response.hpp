#pragma once

// ImpulseResponse: what each side of a contact must tell, namely how its velocities answer to
// impulses. A side has n points at which impulses p (3n, N s, world axes) may act; point i has the
// entries 3i, 3i+1, 3i+2. With the velocities u (3n, m/s) that its points have without them, the
// velocities with them are
//
//   u⁺ = u + W p,     W = J H⁻¹ Jᵀ      symmetric, positive semidefinite (3n×3n, 1/kg)
//
// J maps the side's own velocities to those of its points, and H is its mass matrix or the matrix
// of its implicit step:
//
//   kinematic body    W = 0
//   rigid body        H = M
//   articulated hand  H = M + h Kd (+ h² Kp), the matrix of stable PD
//   particles         W diagonal, the inverse masses
//   implicit sheet    H = A, its step matrix; the points are the touched vertices
//
// W is called the mobility or, seen from the contacts, the Delassus operator.

#include <concepts>
#include <memory>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a type acts as a side of a contact. The primary template forwards to members of the same
/// names.
template <class R>
struct impulse_response_traits {
  /// Returns the number n of points at which impulses may act.
  static auto point_count(const R& side) requires requires { side.point_count(); }
  { return side.point_count(); }

  /// Writes the velocities u (3n, m/s) of the points without further impulses. Must not allocate.
  template <class Out>
  requires requires(const R& r, Out& u) { r.velocities(u); }
  static void velocities(const R& side, Out&& u) { side.velocities(u); }

  /// Adds the mobility W (1/kg) to the matrix `W` (3n×3n). Must not allocate.
  template <class Out>
  requires requires(const R& r, Out& W) { r.add_mobility(W); }
  static void add_mobility(const R& side, Out&& W) { side.add_mobility(W); }

  /// Changes the side's own velocities by the impulses p (3n, N s). Must not allocate.
  template <class Impulses>
  requires requires(R& r, const Impulses& p) { r.apply(p); }
  static void apply(R& side, const Impulses& p) { side.apply(p); }
};

/// A side of a contact. ContactSolver takes it.
///
/// Axioms: W is symmetric and positive semidefinite. After `apply(p)` the velocities are u + W p,
/// and W is the same: two impulses one after the other act like their sum. Hence reciprocity, an
/// impulse at point i moves point j as one at j moves i, and passivity, pᵀWp >= 0: impulses never
/// move their own points backwards. Nothing allocates, throws or prints. Vectors and matrices of
/// another size are bugs of the caller.
///
/// Optional hooks: none.
template <class R, class Scalar = double>
concept ImpulseResponse = RealScalar<Scalar> &&
    requires(R& side, const R& constant, Eigen::Ref<VectorX<Scalar>> u,
             Eigen::Ref<MatrixX<Scalar>> W, const Eigen::Ref<const VectorX<Scalar>>& p) {
  { impulse_response_traits<R>::point_count(constant) } -> std::convertible_to<Index>;
  impulse_response_traits<R>::velocities(constant, u);
  impulse_response_traits<R>::add_mobility(constant, W);
  impulse_response_traits<R>::apply(side, p);
};

/// A reference to any side, so that a list can hold sides of many types. Models ImpulseResponse.
template <RealScalar Scalar>
class ImpulseResponseRef {
 public:
  /// Refers to a side, which must outlive this.
  template <ImpulseResponse<Scalar> R>
  requires(!std::same_as<R, ImpulseResponseRef>) explicit ImpulseResponseRef(R& side)
      : side_(std::addressof(side)), calls_(&kCalls<R>) {}

  /// See `impulse_response_traits::point_count`.
  Index point_count() const { return calls_->point_count(side_); }
  /// See `impulse_response_traits::velocities`.
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const { calls_->velocities(side_, u); }
  /// See `impulse_response_traits::add_mobility`.
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const { calls_->add_mobility(side_, W); }
  /// See `impulse_response_traits::apply`.
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p) const { calls_->apply(side_, p); }

 private:
  struct Calls {
    Index (*point_count)(const void*);
    void (*velocities)(const void*, Eigen::Ref<VectorX<Scalar>>&);
    void (*add_mobility)(const void*, Eigen::Ref<MatrixX<Scalar>>&);
    void (*apply)(void*, const Eigen::Ref<const VectorX<Scalar>>&);
  };

  template <class R>
  static constexpr Calls kCalls = {
      [](const void* r) -> Index {
        return impulse_response_traits<R>::point_count(*static_cast<const R*>(r));
      },
      [](const void* r, Eigen::Ref<VectorX<Scalar>>& u) {
        impulse_response_traits<R>::velocities(*static_cast<const R*>(r), u);
      },
      [](const void* r, Eigen::Ref<MatrixX<Scalar>>& W) {
        impulse_response_traits<R>::add_mobility(*static_cast<const R*>(r), W);
      },
      [](void* r, const Eigen::Ref<const VectorX<Scalar>>& p) {
        impulse_response_traits<R>::apply(*static_cast<R*>(r), p);
      }};

  void* side_;
  const Calls* calls_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
