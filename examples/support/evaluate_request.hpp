#pragma once

// The command line of the evaluation, with its checks.

#include "support/evaluate_study.hpp"

namespace program {

/// What the command line asks for.
struct EvaluationRequest {
  Evaluation evaluation;
  long shortest = 0;  // frames of the shortest curve
};

/// Reads the command line. Bad input prints one line and exits with 2.
EvaluationRequest read_evaluation(int argc, char** argv);

}  // namespace program
