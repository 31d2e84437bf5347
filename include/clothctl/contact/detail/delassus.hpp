#pragma once

// Builds the contact problem D, b of contacts from what their sides answer. With the frame F_i of a
// contact (rows n, t1, t2), its weights w_ik at the points k of a side, and σ = +1 on A, -1 on B:
//
//   D_ij = Σ_sides Σ_kl σ_i σ_j w_ik w_jl F_i W_kl F_jᵀ
//   b_i  = Σ_sides Σ_k σ_i w_ik F_i u_k  -  F_i drift_i

#include <span>

#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/contact/detail/contact_sample.hpp"
#include "clothctl/contact/detail/friction_problem.hpp"
#include "clothctl/contact/friction_cone.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the frame of a contact: its rows are n, t1, t2. `normal` has any length but 0.
template <RealScalar Scalar>
Matrix3<Scalar> contact_frame(const Vector3<Scalar>& normal) {
  using std::sqrt;
  const Vector3<Scalar> n = normal / sqrt(normal.squaredNorm());
  Vector3<Scalar> t1, t2;
  tangent_frame<Scalar>(n, t1, t2);
  Matrix3<Scalar> F;
  F.row(0) = n.transpose();
  F.row(1) = t1.transpose();
  F.row(2) = t2.transpose();
  return F;
}

/// Calls `function(place, sign)` for the places of a contact on the given side.
template <RealScalar Scalar, class Function>
void for_each_place(const ContactSample<Scalar>& contact, int side, Function&& function) {
  if (contact.a.side == side) function(contact.a, Scalar(1));
  if (contact.b.side == side) function(contact.b, Scalar(-1));
}

/// Returns σ w_i σ w_j Σ W_kl of two places.
template <RealScalar Scalar>
Matrix3<Scalar> place_mobility(const Eigen::Ref<const MatrixX<Scalar>>& W,
                               const ContactPlace<Scalar>& p, const ContactPlace<Scalar>& q) {
  Matrix3<Scalar> sum = Matrix3<Scalar>::Constant(Scalar(0));
  for (int k = 0; k < 3 && p.point[static_cast<std::size_t>(k)] >= 0; ++k) {
    for (int l = 0; l < 3 && q.point[static_cast<std::size_t>(l)] >= 0; ++l) {
      const Scalar share = p.weight[k] * q.weight[l];
      const Index row = 3 * p.point[static_cast<std::size_t>(k)];
      const Index col = 3 * q.point[static_cast<std::size_t>(l)];
      sum += share * W.template block<3, 3>(row, col);
    }
  }
  return sum;
}

/// Adds side `side` to a problem: its mobility W (3n×3n) and its velocities u (3n). `frames` holds
/// the frames of the contacts side by side (3×3c).
template <RealScalar Scalar>
void add_side(std::span<const ContactSample<Scalar>> contacts, const Points<Scalar>& frames,
              int side, const Eigen::Ref<const MatrixX<Scalar>>& W,
              const Eigen::Ref<const VectorX<Scalar>>& u, FrictionProblem<Scalar>& problem) {
  using Place = ContactPlace<Scalar>;
  typename FrictionProblem<Scalar>::Matrix D = problem.D();
  const Index c = static_cast<Index>(contacts.size());
  for (Index j = 0; j < c; ++j) {
    const Matrix3<Scalar> F_j = frames.template middleCols<3>(3 * j);
    for_each_place<Scalar>(
        contacts[static_cast<std::size_t>(j)], side, [&](const Place& q, const Scalar& s_j) {
          Vector3<Scalar> moves = Vector3<Scalar>::Constant(Scalar(0));
          for (int l = 0; l < 3 && q.point[static_cast<std::size_t>(l)] >= 0; ++l)
            moves += q.weight[l] * u.template segment<3>(3 * q.point[static_cast<std::size_t>(l)]);
          problem.b().template segment<3>(3 * j) += s_j * (F_j * moves);
          for (Index i = 0; i <= j; ++i) {
            const Matrix3<Scalar> F_i = frames.template middleCols<3>(3 * i);
            for_each_place<Scalar>(
                contacts[static_cast<std::size_t>(i)], side,
                [&](const Place& p, const Scalar& s_i) {
                  const Matrix3<Scalar> left = F_i * place_mobility<Scalar>(W, p, q);
                  D.template block<3, 3>(3 * i, 3 * j) += (s_i * s_j) * (left * F_j.transpose());
                });
          }
        });
  }
}

/// Adds drift, compliance, gaps and offsets for a step of h (s), and completes D, of which the
/// upper blocks are known.
template <RealScalar Scalar>
void complete_problem(std::span<const ContactSample<Scalar>> contacts, const Points<Scalar>& frames,
                      const Scalar& h, FrictionProblem<Scalar>& problem) {
  typename FrictionProblem<Scalar>::Matrix D = problem.D();
  for (Index i = 0; i < static_cast<Index>(contacts.size()); ++i) {
    const ContactSample<Scalar>& contact = contacts[static_cast<std::size_t>(i)];
    const Matrix3<Scalar> F = frames.template middleCols<3>(3 * i);
    const Matrix3<Scalar> own = D.template block<3, 3>(3 * i, 3 * i);
    D.template block<3, 3>(3 * i, 3 * i) = Scalar(0.5) * (own + own.transpose());
    Vector3<Scalar> b = problem.b().template segment<3>(3 * i);
    const Vector3<Scalar> s = F * contact.offset;
    b -= F * contact.drift;
    const Scalar soft_n = h + contact.compliance * contact.damping;
    const Scalar soft_t = h + contact.tangential_compliance * contact.damping;
    D(3 * i, 3 * i) += contact.compliance / (h * soft_n);
    b[0] += contact.gap / soft_n;
    for (Index k = 1; k < 3; ++k) {
      D(3 * i + k, 3 * i + k) += contact.tangential_compliance / (h * soft_t);
      b[k] += s[k] / soft_t;
    }
    problem.b().template segment<3>(3 * i) = b;
    problem.friction(i) = contact.friction;
    for (Index j = 0; j < i; ++j)
      D.template block<3, 3>(3 * i, 3 * j) = D.template block<3, 3>(3 * j, 3 * i).transpose();
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
