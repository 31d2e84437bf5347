#pragma once

// The preconditioners of the conjugate gradient method in a mass-spring step: a complete factor of
// an earlier step matrix, kept in the next lower precision, or an incomplete factor of the present
// one with a coarse correction. A factor in float takes half the time and half the memory of one in
// double.

#include <span>
#include <type_traits>
#include <vector>

#include "clothctl/cloth/detail/coarse_correction.hpp"
#include "clothctl/cloth/detail/incomplete_cholesky.hpp"
#include "clothctl/linalg/block_cholesky.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The scalar of the kept factor: float for double, else the scalar itself.
template <RealScalar Scalar>
using FactorScalar = std::conditional_t<std::is_same_v<Scalar, double>, float, Scalar>;

/// A positive definite approximation P of a step matrix, with the operation P⁻¹ r.
template <RealScalar Scalar>
class StepPreconditioner {
 public:
  /// A preconditioner without memory.
  StepPreconditioner() = default;

  /// Makes the memory of complete factors. Allocates.
  StepPreconditioner(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree)
      : matrix_(pattern.template cast<Low>()), factor_(matrix_, tree) {
    right_.setZero(1, 3 * pattern.rows());
  }

  /// Makes the memory of incomplete factors and of the coarse correction of a body (arguments:
  /// CoarseCorrection). Allocates.
  StepPreconditioner(const BlockSymmetric<Scalar>& pattern, const std::vector<SurfaceEdge<>>& sides,
                     const Points<double>& places)
      : incomplete_(pattern), coarse_(pattern, sides, places), is_incomplete_(true) {}

  /// Makes the memory of incomplete factors alone. Allocates.
  explicit StepPreconditioner(const BlockSymmetric<Scalar>& pattern)
      : incomplete_(pattern), is_incomplete_(true) {}

  /// True when factors are incomplete, and so cheap that every matrix can have its own.
  bool is_incomplete() const { return is_incomplete_; }

  /// Factorises a matrix of the pattern. Returns false when it is not positive definite in the
  /// precision of the factor; the preconditioner must then not be used. Never allocates.
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix,
                               std::span<const unsigned char> held) {
    if (is_incomplete_) {
      coarse_.factorize(matrix, held);  // where it has no factor, it corrects nothing
      return incomplete_.factorize(matrix, held);
    }
    matrix_.assign(matrix);
    return factor_.factorize(matrix_, held);
  }

  /// Writes z = P⁻¹ r; entries of held vertices are copied. Never allocates.
  void apply(const Lanes<Scalar, 1>& r, Lanes<Scalar, 1>& z) {
    if (is_incomplete_) {
      z = r;
      incomplete_.solve(z);
      coarse_.add(r, z);
      return;
    }
    // Scaled, so that no number leaves the range of the lower precision.
    const Scalar largest = largest_magnitude(r);
    if (!(Scalar(0) < largest)) {
      z = r;
      return;
    }
    for (Index k = 0; k < r.cols(); ++k) right_[k] = static_cast<Low>(r[k] / largest);
    factor_.template solve<1>(right_);
    for (Index k = 0; k < r.cols(); ++k) z[k] = static_cast<Scalar>(right_[k]) * largest;
  }

 private:
  using Low = FactorScalar<Scalar>;

  BlockSymmetric<Low> matrix_;
  BlockCholesky<Low> factor_;
  Lanes<Low, 1> right_;
  IncompleteCholesky<Scalar> incomplete_;
  CoarseCorrection<Scalar> coarse_;
  bool is_incomplete_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
