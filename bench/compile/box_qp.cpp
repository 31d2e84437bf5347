// A quadratic program with bounds.

#include "clothctl/qp.hpp"

int main() {
  const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(3, 3);
  const Eigen::VectorXd g = Eigen::VectorXd::Ones(3), ub = 0.5 * g, lb = -ub;
  clothctl::BoxActiveSet<double> solver;
  clothctl::QpResult<double> result;
  if (solver.set_hessian(H) != clothctl::QpStatus::Solved) return 1;
  return solver.solve(g, lb, ub, result) == clothctl::QpStatus::Solved ? 0 : 1;
}
