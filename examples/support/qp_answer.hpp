#pragma once

// The report of qp_solve on one solve: an independent check of the answer on the file's own
// numbers.

#include <optional>
#include <string>

#include "clothctl/io/qp_problem.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem.hpp"

namespace program {

using clothctl::QpStatus;

/// A solve and the results of its check.
struct Answer {
  QpStatus status = QpStatus::InvalidData;
  int iterations = 0;
  double seconds = 0;
  clothctl::KktResiduals<double> kkt;
  bool has_point = false;  // x, y, z are the best iterate, with residuals in kkt
  double objective = 0;    // in the file's sense, including r
  std::optional<double> proof_residual, proof_value;
  std::optional<double> shift_norm;  // how far --closest-point had to move the rows
  std::string note;
  clothctl::QpReference reference;  // for --solution
};

/// The last solve, before it is checked.
struct Outcome {
  /// The solver's result. Its status is set even if no solver ran.
  const clothctl::QpResult<double>& result;
  /// The first pair of bounds whose lower is above its upper (unknowns, then rows), or -1.
  clothctl::Index crossed = -1;
  /// Why a matrix was refused, or empty.
  const std::string& refused;
  /// True when --closest-point was given.
  bool closest_point = false;
};

/// Checks an outcome for the vectors of one frame.
Answer check_answer(const clothctl::QpProblem& problem, const clothctl::QpSequenceFrame& frame,
                    const Outcome& outcome, double seconds);

/// Names the matrix entry that a solver refused. Ends the program when the matrix cannot be part of
/// any quadratic program.
std::string refused_entry(const clothctl::QpRefusal& why, const char* matrix,
                          const clothctl::MatrixX<double>& M, const std::string& file);

/// Returns true for statuses that come with a certificate.
bool is_proof(QpStatus status);

/// Returns true when the answer passes its check and does not contradict the file. `constant` is
/// the constant of the objective.
bool is_right(const Answer& answer, const clothctl::QpReference& expected, double constant);

}  // namespace program
