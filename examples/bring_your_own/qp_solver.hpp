#pragma once

// Another QP solver joins BoxQpSolver and QpSolver by one specialisation of qp_solver_traits: the
// alternating direction method of multipliers [Stellato 2020], with its own result type and signs.
// With C = [A; I] and the bounds l, u of rows and unknowns:
//
//   (H + σ + ρ CᵀC) x = σ x' - g + Cᵀ(ρ z - y),   z = clip(C x + y/ρ, l, u),   y += ρ (C x - z)
//
// Its multipliers satisfy H x + g + Cᵀ y = 0; clothctl's have the opposite sign.

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "clothctl/concepts/qp_solver.hpp"

namespace splitting {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

/// The result of a run.
struct Outcome {
  Vector point, bound_price, row_price;
  bool exact = false;  // the optimality conditions hold to the tolerance
  int iterations = 0;
};

/// Minimises ½ xᵀHx + gᵀx with bounds on x and A x. Keeps z and y for the next run.
class Admm {
 public:
  double tolerance = 1e-6;
  int most_iterations = 400;

  void hessian(const Matrix& H) { H_ = H, factored_ = false; }
  void rows(const Matrix& A) { A_ = A, factored_ = false; }

  void run(const Vector& g, const Vector& lower, const Vector& upper, Outcome& out) {
    const Eigen::Index n = H_.rows(), m = A_.rows();
    if (!factored_) factor();
    if (z_.size() != m + n) z_ = y_ = Vector::Zero(m + n);
    if (x_.size() != n) x_ = Vector::Zero(n);
    for (int k = 1;; ++k) {
      const Vector pulled = rho_ * z_ - y_;
      x_ = factor_.solve(sigma_ * x_ - g + A_.transpose() * pulled.head(m) + pulled.tail(n));
      Vector shown(m + n);
      shown << A_ * x_, x_;
      const Vector mixed = 1.6 * shown - 0.6 * z_;  // over-relaxation
      const Vector last = mixed + y_ / rho_;
      z_ = last.cwiseMax(lower).cwiseMin(upper);
      y_ = rho_ * (last - z_);
      out.iterations = k;
      if (k % 20 != 0 && k != most_iterations) continue;
      out.point = z_.tail(n);  // is within its bounds
      out.bound_price = y_.tail(n), out.row_price = y_.head(m);
      out.exact = optimal(g, out);
      if (out.exact || k == most_iterations) return;
    }
  }

 private:
  void factor() {
    const Eigen::Index n = H_.rows();
    if (A_.cols() != n) A_.resize(0, n);
    rho_ = std::max(1e-3, 0.1 * std::sqrt(H_.diagonal().maxCoeff() * H_.diagonal().minCoeff()));
    Matrix K = H_ + rho_ * (A_.transpose() * A_);
    K.diagonal().array() += sigma_ + rho_;
    factor_.compute(K);
    factored_ = true;
  }

  /// Checks the unscaled optimality conditions. By construction, x is within its bounds and z is
  /// complementary; the gradient and the violation of rows remain.
  bool optimal(const Vector& g, const Outcome& o) const {
    const Vector slope = H_ * o.point, price = A_.transpose() * o.row_price + o.bound_price;
    const double size = std::max({1.0, slope.cwiseAbs().maxCoeff(), g.cwiseAbs().maxCoeff()});
    if ((slope + g + price).cwiseAbs().maxCoeff() > tolerance * size) return false;
    if (A_.rows() == 0) return true;
    const Vector at = A_ * o.point, held = z_.head(A_.rows());
    return (at - held).cwiseAbs().maxCoeff() <= tolerance * std::max(1.0, at.cwiseAbs().maxCoeff());
  }

  Matrix H_, A_;
  Eigen::LLT<Matrix> factor_;
  Vector x_, z_, y_;
  double rho_ = 1, sigma_ = 1e-8;
  bool factored_ = false;
};

}  // namespace splitting

/// Everything that clothctl needs from a solver, with bounds alone and with rows.
template <>
struct clothctl::qp_solver_traits<splitting::Admm> {
  using Admm = splitting::Admm;
  using View = Eigen::Ref<const VectorX<double>>;
  using MatrixView = Eigen::Ref<const MatrixX<double>>;
  struct result_type : splitting::Outcome {
    VectorX<double> z, y;  // multipliers in clothctl's sign
  };

  static void reserve(Admm&, Index, Index = 0) {}
  static QpStatus set_hessian(Admm& solver, const MatrixView& H) {
    if (H.rows() == 0 || H.rows() != H.cols() || !all_finite(H)) return QpStatus::InvalidData;
    solver.hessian(H);
    return QpStatus::Solved;
  }
  static QpStatus set_rows(Admm& solver, const MatrixView& A) {
    if (!all_finite(A)) return QpStatus::InvalidData;
    solver.rows(A);
    return QpStatus::Solved;
  }
  static QpStatus solve(Admm& solver, const View& g, const View& lb, const View& ub,
                        result_type& result) {
    return solve(solver, g, lb, ub, VectorX<double>(), VectorX<double>(), result);
  }
  /// Solved only if the optimality conditions hold; otherwise the best point so far.
  static QpStatus solve(Admm& solver, const View& g, const View& lb, const View& ub, const View& rl,
                        const View& ru, result_type& result) {
    if (!all_finite(g)) return QpStatus::InvalidData;
    VectorX<double> lower(rl.size() + g.size()), upper(rl.size() + g.size());
    lower << rl, lb;
    upper << ru, ub;
    solver.run(g, lower, upper, result);
    result.z = -result.bound_price;
    result.y = -result.row_price;
    return result.exact ? QpStatus::Solved : QpStatus::IterationLimit;
  }
  static const VectorX<double>& solution(const result_type& result) { return result.point; }
  static const VectorX<double>& bound_multipliers(const result_type& r) { return r.z; }
  static const VectorX<double>& row_multipliers(const result_type& r) { return r.y; }
};
