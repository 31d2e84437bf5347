// The kernels of Eigen's dense products and factors in double precision, which many tests use as an
// independent oracle. Here they are compiled with optimisation, where the tests are not.

#include <Eigen/Dense>

namespace clothctl_test {

Eigen::MatrixXd use_eigen_kernels(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const Eigen::MatrixXd products = a * b + a.transpose() * b + a * b.transpose();
  Eigen::MatrixXd square = products * products.transpose();
  square.selfadjointView<Eigen::Lower>().rankUpdate(b);
  const Eigen::LLT<Eigen::MatrixXd> llt(square);
  const Eigen::PartialPivLU<Eigen::MatrixXd> lu(square);
  const Eigen::VectorXd x = llt.solve(a.col(0)) + lu.solve(b.col(0)) + a * b.col(0);
  return llt.solve(a) + lu.solve(b) + square.inverse() + x * x.transpose();
}

}  // namespace clothctl_test
