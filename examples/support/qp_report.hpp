#pragma once

// What qp_solve prints and writes: figures as lines or JSON, a table, a solution file.

#include <vector>

#include "clothctl/io/qp_problem.hpp"
#include "support/qp_answer.hpp"
#include "support/qp_request.hpp"

namespace program {

/// Reports a solve. Returns the exit code: 0 if the answer is right, else 1.
int report_single(const clothctl::QpProblem& problem, const Request& request, const Answer& answer);

/// Reports a sequence that was solved frame by frame, cold and warm. Returns the exit code: 0 if
/// all answers are right, else 1.
int report_sequence(const clothctl::QpProblem& problem, const Request& request,
                    const std::vector<Answer>& cold, const std::vector<Answer>& warm);

}  // namespace program
