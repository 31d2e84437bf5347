#pragma once

// Two small programs for tests of readers and writers, and the comparison of everything that QPT
// can express.

#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/core/scalar.hpp"
#include "clothctl/io/qp_problem.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

inline const double kInfinity = clothctl::scalar_traits<double>::infinity();

/// Three unknowns, two rows, bounds of every kind, a complete answer.
inline clothctl::QpProblem single_program() {
  clothctl::QpProblem p;
  p.name = "tiny";
  p.r = -1.5;
  p.H = (Eigen::MatrixXd(3, 3) << 2, 0, -0.5, 0, 4, 0, -0.5, 0, 1).finished();
  p.g = (Eigen::VectorXd(3) << -3, 0, 1e-3).finished();
  p.A = (Eigen::MatrixXd(2, 3) << 1, 1, 0, 0, 0, -2).finished();
  p.rl = (Eigen::VectorXd(2) << -kInfinity, 1).finished();
  p.ru = (Eigen::VectorXd(2) << 4, 1).finished();
  p.lb = (Eigen::VectorXd(3) << 0, -kInfinity, -1).finished();
  p.ub = (Eigen::VectorXd(3) << kInfinity, kInfinity, 2.5).finished();
  p.reference.status = "optimal";
  p.reference.objective = -7.25;
  p.reference.unique = true;
  p.reference.x = (Eigen::VectorXd(3) << 1, 2, -0.5).finished();
  p.reference.y = (Eigen::VectorXd(2) << 0, -1).finished();
  p.reference.z = (Eigen::VectorXd(3) << 0, 0, 0.5).finished();
  return p;
}

/// The text of single_program().
inline const std::string kSingleProgram =
    "qpt 1\nname tiny\nn 3\nm 2\nr -1.5\n"
    "H 4\n0 0 2\n0 2 -0.5\n1 1 4\n2 2 1\n"
    "g 2\n0 -3\n2 1e-3\n"
    "A 3\n0 0 1\n0 1 1\n1 2 -2\n"
    "rows 2\n-inf 4\n1 1\n"
    "cols 3\n0 inf\n-inf inf\n-1 2.5\n"
    "status optimal\nobjective -7.25\nunique 1\n"
    "x 3\n1 2 -0.5\ny 2\n0 -1\nz 3\n0 0 0.5\nend\n";

/// Two unknowns and one row. One frame changes nothing, one the gradient and rows, one the bounds.
inline clothctl::QpProblem program_sequence() {
  clothctl::QpProblem p;
  p.name = "moves";
  p.H = (Eigen::MatrixXd(2, 2) << 2, 1, 1, 3).finished();
  p.g = (Eigen::VectorXd(2) << 0, 5).finished();
  p.A = (Eigen::MatrixXd(1, 2) << 1, -1).finished();
  p.rl = Eigen::VectorXd::Zero(1);
  p.ru = Eigen::VectorXd::Ones(1);
  p.lb = Eigen::VectorXd::Zero(2);
  p.ub = (Eigen::VectorXd(2) << 1, 2).finished();
  p.shift = 1;
  p.frames.assign(3, {p.g, p.rl, p.ru, p.lb, p.ub, {}});
  p.frames[0].reference.status = "optimal";
  p.frames[0].reference.objective = 1;
  p.frames[1].g = (Eigen::VectorXd(2) << -1, 0).finished();
  p.frames[1].rl[0] = -1;
  p.frames[1].ru[0] = 2;
  p.frames[1].reference.status = "infeasible";
  p.frames[2].ub.setZero();
  p.frames[2].reference.objective = -4;
  return p;
}

/// Checks that two matrices have the same size and entries.
template <class Matrix>
void check_equal(const char* name, const Matrix& a, const Matrix& b) {
  INFO(name);
  REQUIRE(a.rows() == b.rows());
  REQUIRE(a.cols() == b.cols());
  CHECK(a == b);
}

/// Checks that two answers, frames, programs or solutions are equal.
inline void check_same(const clothctl::QpReference& a, const clothctl::QpReference& b) {
  CHECK(a.status == b.status);
  CHECK(a.objective == b.objective);
  CHECK(a.unique == b.unique);
  check_equal("x", a.x, b.x);
  check_equal("y", a.y, b.y);
  check_equal("z", a.z, b.z);
  check_equal("ray", a.ray, b.ray);
  check_equal("farkas_y", a.farkas_y, b.farkas_y);
  check_equal("farkas_z", a.farkas_z, b.farkas_z);
}

inline void check_same(const clothctl::QpSequenceFrame& a, const clothctl::QpSequenceFrame& b) {
  check_equal("g", a.g, b.g);
  check_equal("rl", a.rl, b.rl);
  check_equal("ru", a.ru, b.ru);
  check_equal("lb", a.lb, b.lb);
  check_equal("ub", a.ub, b.ub);
  check_same(a.reference, b.reference);
}

template <class Frame>
void check_same(const std::vector<Frame>& a, const std::vector<Frame>& b) {
  REQUIRE(a.size() == b.size());
  for (std::size_t t = 0; t < a.size(); ++t) check_same(a[t], b[t]);
}

inline void check_same(const clothctl::QpProblem& a, const clothctl::QpProblem& b) {
  CHECK(a.name == b.name);
  CHECK(a.r == b.r);
  check_equal("H", a.H, b.H);
  check_equal("A", a.A, b.A);
  CHECK(a.shift == b.shift);
  check_same(static_cast<const clothctl::QpSequenceFrame&>(a),
             static_cast<const clothctl::QpSequenceFrame&>(b));
  check_same(a.frames, b.frames);
}

inline void check_same(const clothctl::QpSolution& a, const clothctl::QpSolution& b) {
  CHECK(a.name == b.name);
  CHECK(a.n == b.n);
  CHECK(a.m == b.m);
  check_same(a.reference, b.reference);
  check_same(a.frames, b.frames);
}

}  // namespace clothctl_test
