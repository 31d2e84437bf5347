#pragma once

// The studies of the evaluation, [Bai 2016], section 6.2: each is a list of cases, and each case
// runs once for every seed.

#include <string>
#include <vector>

#include "support/options.hpp"

namespace program {

/// What the user asks for.
struct Evaluation {
  std::string study;
  std::string kind;  // of curves: known, fast or random; empty: what the study has by default
  int seeds = 5;
  double seconds = 5;
  std::vector<std::string> curves;  // files, instead of curves from seeds
  bool resume = false;
  int shard = 1, shards = 1;
  Options run;  // options of a run that are the same in all cases, unless the study sets them
};

/// A quantity of the plant's material that differs from what the planner knows.
struct Mismatch {
  std::string quantity;  // density, stiffness, drag or bending; empty: none
  double factor = 1;
};

/// A case of a study.
struct Case {
  std::string name;
  double value = 0;  // what the study varies: its place on the axis of the plot
  std::string kind = "known";
  double noise_sd = 0;  // of the control points of curves from seeds, m
  Mismatch mismatch;
  Options run;
};

/// The names of all studies.
const std::vector<std::string>& study_names();

/// The kinds of curves from seeds. Each is the name of a study, too, which has these curves.
const std::vector<std::string>& curve_kinds();

/// Returns whether a study is named after its kind of curves.
bool is_curve_kind(const std::string& study);

/// Returns the options that a study sets itself, as "--horizon", so that the user cannot.
std::vector<std::string> options_set_by(const std::string& study);

/// Returns the cases of a study; all runs have at least `frames` frames.
std::vector<Case> make_cases(const Evaluation& e, long frames);

/// A run of the evaluation.
struct Job {
  int study_case = 0;
  int seed = 1;
};

/// Returns all runs, all cases of a seed together.
std::vector<Job> make_jobs(int cases, int seeds);

/// Returns whether a job belongs to a shard (from 1). Neighbours of a case and of a seed go to
/// different shards, since cases differ in cost.
inline bool in_shard(const Job& job, int shard, int shards) {
  return (job.study_case + job.seed - 1) % shards == shard - 1;
}

/// Reads "i/n"; refuses anything else.
void read_shard(const std::string& text, Evaluation& e);

}  // namespace program
