// A quadratic program with bounds and rows.

#include "clothctl/qp.hpp"

int main() {
  const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(3, 3), A = Eigen::MatrixXd::Ones(1, 3);
  const Eigen::VectorXd g = Eigen::VectorXd::Ones(3), ub = 0.5 * g, lb = -ub;
  const Eigen::VectorXd ru = Eigen::VectorXd::Ones(1), rl = -ru;
  clothctl::ActiveSet<double> solver;
  clothctl::QpResult<double> result;
  if (solver.set_hessian(H) != clothctl::QpStatus::Solved) return 1;
  if (solver.set_rows(A) != clothctl::QpStatus::Solved) return 1;
  return solver.solve(g, lb, ub, rl, ru, result) == clothctl::QpStatus::Solved ? 0 : 1;
}
