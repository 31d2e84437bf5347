#pragma once

// Random Hessians, diagonal plus low rank, dense and factored, for the tests of the curvatures and
// of the box method.

#include <cmath>
#include <random>

#include "clothctl/qp/detail/special/low_rank_curvature.hpp"

namespace clothctl_test {

/// D + NᵀN with n unknowns and rank r.
template <class Scalar>
struct FactoredHessian {
  clothctl::VectorX<Scalar> D;
  clothctl::MatrixX<Scalar> N;

  FactoredHessian(clothctl::Index n, clothctl::Index r, unsigned seed, double ridge = 0.1)
      : D(n), N(r, n) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (clothctl::Index i = 0; i < n; ++i) {
      D[i] = Scalar(ridge * (1.0 + std::abs(normal(random))));
      for (clothctl::Index k = 0; k < r; ++k) N(k, i) = Scalar(normal(random));
    }
  }

  clothctl::MatrixX<Scalar> dense() const {
    clothctl::MatrixX<Scalar> H = N.transpose() * N;
    H.diagonal() += D;
    return H;
  }

  void fill(clothctl::detail::LowRankCurvature<Scalar>& curvature) const {
    curvature.resize(N.cols(), N.rows());
    curvature.N() = N;
    for (clothctl::Index i = 0; i < D.size(); ++i) curvature.set_diagonal(i, D[i]);
  }
};

}  // namespace clothctl_test
