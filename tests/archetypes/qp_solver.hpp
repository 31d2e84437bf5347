#pragma once

// The least types that satisfy BoxQpSolver and QpSolver. They have only what the concepts name: no
// copies, no warm start. They do not solve; qp_solver_laws.hpp says what a real solver must do.

#include "clothctl/concepts/qp_solver.hpp"

namespace clothctl_test {

/// A result with what the concepts read.
template <class Scalar>
struct QpResultArchetype {
  clothctl::VectorX<Scalar> x, bound_multipliers, row_multipliers;
};

/// A solver of bound-constrained programs with only what BoxQpSolver names.
template <class Scalar>
class BoxQpSolverArchetype {
 public:
  using result_type = QpResultArchetype<Scalar>;
  using View = Eigen::Ref<const clothctl::VectorX<Scalar>>;

  explicit BoxQpSolverArchetype(int) {}
  BoxQpSolverArchetype(const BoxQpSolverArchetype&) = delete;
  BoxQpSolverArchetype& operator=(const BoxQpSolverArchetype&) = delete;

  void reserve(clothctl::Index) {}
  clothctl::QpStatus set_hessian(const Eigen::Ref<const clothctl::MatrixX<Scalar>>&) {
    return clothctl::QpStatus::Solved;
  }
  clothctl::QpStatus solve(const View& g, const View&, const View&, result_type& result) {
    result.x.setZero(g.size());
    result.bound_multipliers.setZero(g.size());
    return clothctl::QpStatus::IterationLimit;
  }
};

/// A solver of general programs with only what QpSolver names.
template <class Scalar>
class QpSolverArchetype {
 public:
  using result_type = QpResultArchetype<Scalar>;
  using View = Eigen::Ref<const clothctl::VectorX<Scalar>>;
  using MatrixView = Eigen::Ref<const clothctl::MatrixX<Scalar>>;

  explicit QpSolverArchetype(int) {}
  QpSolverArchetype(const QpSolverArchetype&) = delete;
  QpSolverArchetype& operator=(const QpSolverArchetype&) = delete;

  void reserve(clothctl::Index, clothctl::Index) {}
  clothctl::QpStatus set_hessian(const MatrixView&) { return clothctl::QpStatus::Solved; }
  clothctl::QpStatus set_rows(const MatrixView&) { return clothctl::QpStatus::Solved; }
  clothctl::QpStatus solve(const View& g, const View&, const View&, const View& rl, const View&,
                           result_type& result) {
    result.x.setZero(g.size());
    result.bound_multipliers.setZero(g.size());
    result.row_multipliers.setZero(rl.size());
    return clothctl::QpStatus::IterationLimit;
  }
};

}  // namespace clothctl_test
