#include "support/qp_answer.hpp"

#include <algorithm>
#include <cmath>

#include "clothctl/core/number_text.hpp"
#include "clothctl/io/qpt.hpp"
#include "support/options.hpp"

namespace program {

using clothctl::Index;
using clothctl::QpProblem;
using clothctl::QpReference;
using clothctl::QpSequenceFrame;
using Vector = clothctl::VectorX<double>;

namespace {

/// Tolerances of right answers: residuals relative to the size of the program, objective relative
/// to max(1, |objective|, |r|).
constexpr double kAccepted = 1e-6;

std::string qpt_status(QpStatus s) {
  if (s == QpStatus::Solved) return "optimal";
  if (s == QpStatus::PrimalInfeasible) return "infeasible";
  if (s == QpStatus::DualInfeasible) return "unbounded";
  return std::string(to_string(s));
}

/// Returns the largest wᵀt over lower ≤ t ≤ upper.
double largest(const Vector& w, const Vector& lower, const Vector& upper) {
  double sum = 0;
  for (Index i = 0; i < w.size(); ++i) {
    if (w[i] < 0 || w[i] > 0) sum += w[i] * (w[i] > 0 ? upper[i] : lower[i]);
  }
  return sum;
}

/// Returns how far a direction violates bounds.
double outward(const Vector& d, const Vector& lower, const Vector& upper) {
  double worst = 0;
  for (Index i = 0; i < d.size(); ++i) {
    if (!clothctl::is_unbounded(lower[i])) worst = std::max(worst, -d[i]);
    if (!clothctl::is_unbounded(upper[i])) worst = std::max(worst, d[i]);
  }
  return worst;
}

}  // namespace

bool is_proof(QpStatus s) {
  return s == QpStatus::PrimalInfeasible || s == QpStatus::DualInfeasible;
}

std::string refused_entry(const clothctl::QpRefusal& why, const char* matrix,
                          const clothctl::MatrixX<double>& M, const std::string& file) {
  std::string refused;
  refused = why.message;
  if (why.index >= 0) {
    const Index i = why.index % M.rows(), j = why.index / M.rows();
    refused = std::string(matrix) + "(" + std::to_string(i) + "," + std::to_string(j) + ") is " +
              clothctl::number_text(M(i, j)) + ": " + why.message;
  }
  if (why.status == QpStatus::InvalidData) refuse(file + ": " + refused);
  return refused;
}

Answer check_answer(const QpProblem& problem, const QpSequenceFrame& f, const Outcome& outcome,
                    double seconds) {
  const clothctl::QpResult<double>& result = outcome.result;
  const Index crossed = outcome.crossed;
  const Vector &x = result.x, &y = result.row_multipliers, &z = result.bound_multipliers;
  Answer a;
  a.status = result.status;
  a.iterations = result.iterations;
  a.seconds = seconds;
  a.note = a.status == QpStatus::InvalidData ? result.message : outcome.refused;
  a.reference.status = qpt_status(a.status);
  if (crossed >= 0 && a.status == QpStatus::PrimalInfeasible) {
    const bool row = crossed >= problem.n();
    const Index i = row ? crossed - problem.n() : crossed;
    a.note = (row ? "row " : "unknown ") + std::to_string(i) + ": lower bound " +
             clothctl::number_text(row ? f.rl[i] : f.lb[i]) + " above " +
             clothctl::number_text(row ? f.ru[i] : f.ub[i]);
  } else if (a.status == QpStatus::PrimalInfeasible) {
    a.reference.farkas_y = y;
    a.reference.farkas_z = z;
    const double size =
        std::max(y.size() > 0 ? y.lpNorm<Eigen::Infinity>() : 0, z.lpNorm<Eigen::Infinity>());
    Vector rest = z;
    if (y.size() > 0) rest += problem.A.transpose() * y;
    a.proof_residual = rest.lpNorm<Eigen::Infinity>() / size;
    a.proof_value = (largest(y, f.rl, f.ru) + largest(z, f.lb, f.ub)) / size;
    if (outcome.closest_point) {
      a.reference.x = x;
      a.shift_norm = result.row_shifts.norm();
      a.note = result.message;
    }
  } else if (a.status == QpStatus::DualInfeasible) {
    const Vector& d = result.ray;
    a.reference.x = x;
    a.reference.ray = d;
    const double size = d.lpNorm<Eigen::Infinity>();
    double worst = std::max((problem.H * d).lpNorm<Eigen::Infinity>(), outward(d, f.lb, f.ub));
    if (y.size() > 0) worst = std::max(worst, outward(problem.A * d, f.rl, f.ru));
    a.proof_residual = worst / size;
    a.proof_value = f.g.dot(d) / size;
  } else if (outcome.refused.empty() && a.status != QpStatus::InvalidData) {
    a.has_point = true;
    a.kkt = clothctl::kkt_residuals(problem.H, f.g, problem.A, f.rl, f.ru, f.lb, f.ub, x, y, z);
    a.objective = (problem.maximise ? -1 : 1) * (a.kkt.objective + problem.r);
    a.reference.objective = a.objective;
    a.reference.x = x;
    a.reference.y = y;
    a.reference.z = z;
  }
  return a;
}

/// Returns whether the solver ended with a checked answer that does not contradict the file.
bool is_right(const Answer& a, const QpReference& expected, double r) {
  if (a.status != QpStatus::Solved && !is_proof(a.status)) return false;
  if (a.status == QpStatus::Solved && !(a.kkt.worst() <= kAccepted)) return false;
  if (!expected.status.empty() && expected.status != qpt_status(a.status)) return false;
  if (!expected.objective || a.status != QpStatus::Solved) return true;
  return std::abs(a.objective - *expected.objective) <=
         kAccepted * std::max({1.0, std::abs(*expected.objective), std::abs(r)});
}

}  // namespace program
