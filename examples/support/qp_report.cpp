#include "support/qp_report.hpp"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "clothctl/core/number_text.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/qpt_writer.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace program {

using clothctl::Index;
using clothctl::QpProblem;
using clothctl::QpReference;

namespace {

void print(const nlohmann::ordered_json& figures, bool json) {
  if (json) {
    std::printf("%s\n",
                figures.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    return;
  }
  for (const auto& [key, value] : figures.items()) {
    const std::string text = value.is_string() ? value.get<std::string>()
                             : value.is_null() ? "-"
                                               : value.dump();
    std::printf("%-32s %s\n", key.c_str(), text.c_str());
  }
}

/// The figures that single programs and sequences share; unknown ones are null.
nlohmann::ordered_json figures_of(const QpProblem& problem, const std::string& status,
                                  const Answer& a, bool kkt_known) {
  const auto number = [](double v, bool known) {
    return known ? nlohmann::ordered_json(v) : nlohmann::ordered_json();
  };
  nlohmann::ordered_json j;
  j["status"] = status;
  j["objective"] = number(a.objective, a.has_point);
  j["kkt_stationarity"] = number(a.kkt.relative_stationarity, kkt_known);
  j["kkt_feasibility"] = number(a.kkt.relative_feasibility, kkt_known);
  j["kkt_complementarity"] = number(a.kkt.relative_complementarity, kkt_known);
  j["kkt_stationarity_absolute"] = number(a.kkt.stationarity, kkt_known);
  j["kkt_feasibility_absolute"] = number(a.kkt.feasibility, kkt_known);
  j["kkt_complementarity_absolute"] = number(a.kkt.complementarity, kkt_known);
  j["iterations"] = a.iterations;
  j["seconds"] = a.seconds;
  j["name"] = problem.name;
  j["n"] = problem.n();
  j["m"] = problem.m();
  j["solver"] = problem.m() == 0 ? "BoxActiveSet" : "ActiveSet";
  return j;
}

void write(const std::string& path, const std::string& text) {
  if (!path.empty()) must(clothctl::write_file(path, text));
}

constexpr const char* kTableHead =
    "frame,objective,status,iterations,ms,cold_objective,cold_status,cold_iterations,cold_ms,"
    "expected_objective,right\n";

/// Adds a row of --out; unknown objectives stay empty.
std::string table_row(std::size_t frame, const Answer& warm, const Answer& cold,
                      const QpReference& expected, bool right) {
  std::vector<std::string> cells{std::to_string(frame)};
  for (const Answer* a : {&warm, &cold}) {
    cells.push_back(a->has_point ? clothctl::number_text(a->objective) : "");
    cells.emplace_back(to_string(a->status));
    cells.push_back(std::to_string(a->iterations));
    cells.push_back(clothctl::number_text(1000 * a->seconds));
  }
  cells.push_back(expected.objective ? clothctl::number_text(*expected.objective) : "");
  cells.emplace_back(right ? "1" : "0");
  std::string row;
  for (const std::string& cell : cells) {
    row += cell;
    row += &cell == &cells.back() ? '\n' : ',';
  }
  return row;
}

/// Adds the times of one way of solving a sequence, and the number of right frames.
void add_times(nlohmann::ordered_json& j, const std::string& way, const QpProblem& problem,
               const std::vector<Answer>& all) {
  Index right = 0;
  std::vector<double> ms, iterations;
  for (std::size_t t = 0; t < all.size(); ++t) {
    right += is_right(all[t], problem.frames[t].reference, problem.r) ? 1 : 0;
    if (t == 0 && all.size() > 1) continue;  // the first frame has no warm start
    ms.push_back(1000 * all[t].seconds);
    iterations.push_back(all[t].iterations);
  }
  j[way + "_median_ms"] = quantile(ms, 0.5);
  j[way + "_p99_ms"] = quantile(ms, 0.99);
  j[way + "_iterations_median"] = quantile(iterations, 0.5);
  j[way + "_right"] = right;
}

}  // namespace

int report_single(const QpProblem& problem, const Request& o, const Answer& a) {
  const bool right = is_right(a, problem.reference, problem.r);
  if (a.status == QpStatus::InvalidData) refuse(o.file + ": " + a.note);
  nlohmann::ordered_json j = figures_of(problem, std::string(to_string(a.status)), a, a.has_point);
  if (a.proof_residual) j["proof_residual"] = *a.proof_residual;
  if (a.proof_value) j["proof_value"] = *a.proof_value;
  if (a.shift_norm) j["shift_norm"] = *a.shift_norm;
  if (!a.note.empty()) j["note"] = a.note;
  if (!problem.reference.status.empty()) j["expected"] = problem.reference.status;
  if (problem.reference.objective) j["expected_objective"] = *problem.reference.objective;
  j["right"] = right;
  write(o.solution,
        clothctl::qpt_solution_text({problem.name, problem.n(), problem.m(), a.reference, {}}));
  write(o.out, kTableHead + table_row(0, a, a, problem.reference, right));
  print(j, o.json);
  return right ? 0 : 1;
}

int report_sequence(const QpProblem& problem, const Request& o, const std::vector<Answer>& cold,
                    const std::vector<Answer>& warm) {
  const std::size_t count = problem.frames.size();
  clothctl::QpSolution solution{problem.name, problem.n(), problem.m(), {}, {}};
  Answer whole;  // the last objective, the worst residuals, and the sums of all else
  whole.has_point = warm.back().has_point;
  whole.objective = warm.back().objective;
  std::string table = kTableHead, status = "solved", note;
  Index right_both = 0;
  for (std::size_t t = 0; t < count; ++t) {
    const QpReference& expected = problem.frames[t].reference;
    const bool right =
        is_right(warm[t], expected, problem.r) && is_right(cold[t], expected, problem.r);
    right_both += right ? 1 : 0;
    whole.iterations += warm[t].iterations;
    whole.seconds += warm[t].seconds + cold[t].seconds;
    for (const Answer* a : {&cold[t], &warm[t]}) {
      const bool good = is_right(*a, expected, problem.r);
      if (!good && note.empty()) {
        status = a->status == QpStatus::Solved || is_proof(a->status)
                     ? "wrong"
                     : std::string(to_string(a->status));
        note = "frame " + std::to_string(t) + (a == &warm[t] ? ", warm: " : ", cold: ") +
               std::string(to_string(a->status)) + (a->note.empty() ? "" : ", " + a->note);
      }
      if (!a->has_point) continue;
      using K = clothctl::KktResiduals<double>;
      for (auto part :
           {&K::stationarity, &K::feasibility, &K::complementarity, &K::relative_stationarity,
            &K::relative_feasibility, &K::relative_complementarity})
        whole.kkt.*part = std::max(whole.kkt.*part, a->kkt.*part);
    }
    table += table_row(t, warm[t], cold[t], expected, right);
    solution.frames.push_back(warm[t].reference);
  }
  nlohmann::ordered_json j = figures_of(problem, status, whole, true);
  j["frames"] = count;
  j["frames_right"] = right_both;
  add_times(j, "cold", problem, cold);
  add_times(j, "warm", problem, warm);
  if (!note.empty()) j["note"] = note;
  j["right"] = right_both == static_cast<Index>(count);
  write(o.solution, clothctl::qpt_solution_text(solution));
  write(o.out, table);
  print(j, o.json);
  return right_both == static_cast<Index>(count) ? 0 : 1;
}

}  // namespace program
