#pragma once

// The laws that every ImpulseResponse must obey. Call check_impulse_response_laws<Scalar>(side,
// tolerance) inside a TEST_CASE; the side keeps the velocities that random impulses gave it.
//
//   symmetry     W = Wᵀ
//   passivity    no eigenvalue of W is negative
//   addition     add_mobility adds to what stands in the matrix
//   answer       after apply(p) the velocities are u + W p, and W is the same bits
//   sum          apply(p) and apply(q) act like apply(p + q)
//   reciprocity  an impulse at i moves j as one at j moves i, measured by apply alone
//   again        repeated queries give the same bits, as does an ImpulseResponseRef
//   memory       nothing allocates
//
// `tolerance` is relative to the largest entry of W and of u.

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "clothctl/concepts/impulse_response.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

namespace clothctl_test {

namespace law_detail {

template <class Scalar>
clothctl::VectorX<Scalar> random_impulses(clothctl::Index size, Numbers& random) {
  clothctl::VectorX<Scalar> p(size);
  for (clothctl::Index k = 0; k < size; ++k) p[k] = static_cast<Scalar>(random(-1, 1));
  return p;
}

template <class Scalar, class R>
clothctl::VectorX<Scalar> velocities_of(const R& side, clothctl::Index size) {
  clothctl::VectorX<Scalar> u = clothctl::VectorX<Scalar>::Constant(size, Scalar(7));
  clothctl::impulse_response_traits<R>::velocities(side, Eigen::Ref<clothctl::VectorX<Scalar>>(u));
  return u;
}

template <class Scalar, class R>
clothctl::MatrixX<Scalar> mobility_of(const R& side, clothctl::Index size) {
  clothctl::MatrixX<Scalar> W = clothctl::MatrixX<Scalar>::Zero(size, size);
  clothctl::impulse_response_traits<R>::add_mobility(side,
                                                     Eigen::Ref<clothctl::MatrixX<Scalar>>(W));
  return W;
}

template <class Scalar, class R>
void push(R& side, const clothctl::VectorX<Scalar>& p) {
  clothctl::impulse_response_traits<R>::apply(side, Eigen::Ref<const clothctl::VectorX<Scalar>>(p));
}

template <class Scalar>
Scalar size_of(const clothctl::MatrixX<Scalar>& m) {
  return m.size() == 0 ? Scalar(0) : m.cwiseAbs().maxCoeff();
}

template <class Scalar, class R>
void check_mobility(const R& side, clothctl::Index size, Scalar tolerance) {
  using Matrix = clothctl::MatrixX<Scalar>;
  const Matrix W = mobility_of<Scalar>(side, size);
  REQUIRE(clothctl::all_finite(W));
  const Scalar scale = std::max(size_of<Scalar>(W), Scalar(1e-30));
  CHECK(size_of<Scalar>(W - W.transpose()) <= tolerance * scale);
  if (size > 0) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(Scalar(0.5) * (W + W.transpose())));
    CHECK(eigen.eigenvalues().minCoeff() >=
          -tolerance * std::max(eigen.eigenvalues().maxCoeff(), scale));
  }
  Matrix sum = Matrix::Constant(size, size, Scalar(3));
  clothctl::impulse_response_traits<R>::add_mobility(side, Eigen::Ref<Matrix>(sum));
  CHECK(size_of<Scalar>(sum - W - Matrix::Constant(size, size, Scalar(3))) <=
        tolerance * (scale + Scalar(3)));
}

template <class Scalar, class R>
void check_answer(R& side, clothctl::Index size, Scalar tolerance) {
  using Vector = clothctl::VectorX<Scalar>;
  using Matrix = clothctl::MatrixX<Scalar>;
  Numbers random(11);
  const Matrix W = mobility_of<Scalar>(side, size);
  const Vector p = random_impulses<Scalar>(size, random), q = random_impulses<Scalar>(size, random);
  const Vector start = velocities_of<Scalar>(side, size);
  const Scalar reach = Scalar(static_cast<double>(size)) * size_of<Scalar>(W) +
                       size_of<Scalar>(start) + Scalar(1e-30);
  push<Scalar>(side, p);
  const Vector once = velocities_of<Scalar>(side, size);
  CHECK(size_of<Scalar>(once - start - W * p) <= tolerance * reach);
  CHECK(mobility_of<Scalar>(side, size) == W);
  push<Scalar>(side, q);
  const Vector twice = velocities_of<Scalar>(side, size);
  push<Scalar>(side, Vector(-(p + q)));
  const Vector back = velocities_of<Scalar>(side, size);
  CHECK(size_of<Scalar>(twice - start - W * (p + q)) <= tolerance * reach);
  CHECK(size_of<Scalar>(back - start) <= tolerance * reach);
  push<Scalar>(side, Vector(Vector::Zero(size)));
  CHECK(velocities_of<Scalar>(side, size) == back);
  Matrix measured(size, size);
  for (clothctl::Index j = 0; j < size; ++j) {
    const Vector before = velocities_of<Scalar>(side, size);
    Vector unit = Vector::Zero(size);
    unit[j] = Scalar(1);
    push<Scalar>(side, unit);
    measured.col(j) = velocities_of<Scalar>(side, size) - before;
    push<Scalar>(side, Vector(-unit));
  }
  CHECK(size_of<Scalar>(measured - measured.transpose()) <= tolerance * reach);
}

template <class Scalar, class R>
void check_memory(R& side, clothctl::Index size) {
  using Vector = clothctl::VectorX<Scalar>;
  using Matrix = clothctl::MatrixX<Scalar>;
  using Traits = clothctl::impulse_response_traits<R>;
  const clothctl::ImpulseResponseRef<Scalar> reference(side);
  Vector u(size), u_again(size);
  Matrix W = Matrix::Zero(size, size), W_again = W;
  const Vector none = Vector::Zero(size);
  const Eigen::Ref<Vector> u_view(u), u_again_view(u_again);
  const Eigen::Ref<Matrix> W_view(W), W_again_view(W_again);
  const Eigen::Ref<const Vector> p(none);
  const long before = allocations();
  Traits::velocities(side, u_view);
  Traits::add_mobility(side, W_view);
  reference.velocities(u_again_view);
  reference.add_mobility(W_again_view);
  Traits::apply(side, p);
  reference.apply(p);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  CHECK(u == u_again);
  CHECK(W == W_again);
  CHECK(reference.point_count() == static_cast<clothctl::Index>(Traits::point_count(side)));
}

}  // namespace law_detail

/// Checks all laws of this file on a side with its points set.
template <class Scalar, class R>
void check_impulse_response_laws(R& side, Scalar tolerance) {
  static_assert(clothctl::ImpulseResponse<R, Scalar>);
  const clothctl::Index size =
      3 * static_cast<clothctl::Index>(clothctl::impulse_response_traits<R>::point_count(side));
  law_detail::check_mobility<Scalar>(side, size, tolerance);
  law_detail::check_answer<Scalar>(side, size, tolerance);
  law_detail::check_memory<Scalar>(side, size);
}

}  // namespace clothctl_test
