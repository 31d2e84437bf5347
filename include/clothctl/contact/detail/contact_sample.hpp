#pragma once

// One contact of two sides: where it acts, its frame, its friction, and the spring and damper of
// what is soft there. With the gap g (m, negative where the sides overlap), the tangential way s
// (m) from where it stuck, the relative velocity u (m/s) of A seen from B, the step h (s), the
// compliances c_n, c_t (m/N) and the damping d (N s/m), the impulse λ (N s) of a closed contact
// that sticks is that of an implicit spring and damper,
//
//   c_n λ_n = -h (g + h u_n) - h d c_n u_n
//   c_t λ_t = -h (s + h u_t) - h d c_t u_t
//
// The first is the same as
//
//   u_n + c_n λ_n / (h (h + c_n d)) + g / (h + c_n d) = 0
//
// so that a compliance adds to the diagonal of the Delassus operator, and the gap to the
// velocities. c = 0 is a rigid contact: it closes the gap, and removes an overlap, within the step.
//
// A contact that slips is that spring and damper in series with a slider of the speed w: u_t - w
// takes the place of u_t. Either way, once λ is known, the spring at the end of the step is
//
//   s⁺ = c_t (d s - λ_t) / (h + c_t d)
//
// (a return mapping, as in plasticity; where it sticks, this is s + h u_t). An open contact
// remembers nothing, s⁺ = 0. Without s, contacts would creep under load.

#include <array>
#include <string_view>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What a contact does in a step.
enum class ContactState {
  /// It transmits nothing.
  Open,
  /// The sides do not slide on each other.
  Stick,
  /// The sides slide, or would without compliance; the friction is at its limit.
  Slip
};

/// Returns the name of a contact's state.
constexpr std::string_view to_string(ContactState state) {
  switch (state) {
    case ContactState::Open: return "open";
    case ContactState::Stick: return "stick";
    case ContactState::Slip: return "slip";
  }
  return "unknown";
}

/// The place of a contact on one side: a weighted sum of up to three of its points.
template <RealScalar Scalar>
struct ContactPlace {
  /// Number of the side in the call of the solver; -1 for the resting world, without points.
  int side = -1;
  /// The points of the side; unused entries are -1 and come last.
  std::array<int, 3> point{-1, -1, -1};
  /// Their weights; those of unused entries have no meaning.
  Vector3<Scalar> weight = Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
};

/// A contact: what ContactSolver reads, and what it writes. Make one for each point of a finger,
/// or vertex, and keep it as long as it touches: the memory (`impulse`, `offset`) moves with it.
template <RealScalar Scalar>
struct ContactSample {
  /// Where it is on the sides A and B.
  ContactPlace<Scalar> a, b;
  /// Unit normal, from B to A.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// Friction coefficient μ.
  Scalar friction = Scalar(0);
  /// Gap g at the start of the step, m; negative where the sides overlap.
  Scalar gap = Scalar(0);
  /// Velocity of the surface of B that its points do not have, m/s: that of a collider which is no
  /// side, or of a belt.
  Vector3<Scalar> drift = Vector3<Scalar>::Constant(Scalar(0));
  /// Compliance along the normal and across it, m/N; 0 if rigid.
  Scalar compliance = Scalar(0), tangential_compliance = Scalar(0);
  /// Damping of the soft part, N s/m. It has no effect on a rigid contact.
  Scalar damping = Scalar(0);

  /// The way s of A on B from where the contact stuck, m (world axes; its part along the normal is
  /// ignored). At the start of the step; after a solve, at its end. To solve the same step again,
  /// start from a copy.
  Vector3<Scalar> offset = Vector3<Scalar>::Constant(Scalar(0));
  /// The impulse on A, N s (world axes); -impulse acts on B. Before a solve a guess, such as that
  /// of the last step; after it the answer.
  Vector3<Scalar> impulse = Vector3<Scalar>::Constant(Scalar(0));
  /// What the contact did in the last solve.
  ContactState state = ContactState::Open;
};

namespace detail {

/// Gives a contact the state and the impulse λ (n, t1, t2) that a step of h (s) found, and its
/// spring the length s⁺ at the end of the step (see the top of this header). `F`: rows n, t1, t2.
template <RealScalar Scalar>
void end_contact(const Matrix3<Scalar>& F, const Vector3<Scalar>& lambda, ContactState state,
                 const Scalar& h, ContactSample<Scalar>& contact) {
  const Scalar c = contact.tangential_compliance, soft = h + c * contact.damping;
  Vector3<Scalar> s = F * contact.offset;
  s[0] = Scalar(0);
  for (Index k = 1; k < 3; ++k) s[k] = c * (contact.damping * s[k] - lambda[k]) / soft;
  if (state == ContactState::Open) s.setConstant(Scalar(0));
  contact.state = state;
  contact.offset = F.transpose() * s;
  contact.impulse = F.transpose() * lambda;
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
