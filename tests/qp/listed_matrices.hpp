#pragma once

// H, A and Aᵀ of a quadratic program with lists of their nonzeros, for the tests of the sparse
// factors.

#include <utility>

#include "clothctl/linalg/columns.hpp"

namespace clothctl_test {

/// Matrices of n unknowns and m rows, and their columns in the form that the factors take.
template <class Scalar>
struct ListedMatrices {
  clothctl::MatrixX<Scalar> H, A, At;
  clothctl::Columns<Scalar> h, a, at;

  ListedMatrices(clothctl::MatrixX<Scalar> hessian, clothctl::MatrixX<Scalar> rows)
      : H(std::move(hessian)), A(std::move(rows)) {
    h.reserve(n(), n());
    a.reserve(m(), n());
    at.reserve(n(), m());
    list();
  }

  ListedMatrices(const ListedMatrices&) = delete;  // the lists point into the matrices
  ListedMatrices& operator=(const ListedMatrices&) = delete;

  clothctl::Index n() const { return A.cols(); }
  clothctl::Index m() const { return A.rows(); }

  /// Updates the lists after a change of H or A.
  void list() {
    At = A.transpose();
    h.list(H.data(), n(), n());
    a.list(A.data(), m(), n());
    at.list(At.data(), n(), m());
  }
};

}  // namespace clothctl_test
