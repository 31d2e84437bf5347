// Solves a quadratic program, or a sequence of them, from a file; judges the answer on the file's own numbers.
//
//   qp_solve HS118.qpt --solution hs118.txt        formats: clothctl/io/qpt.hpp, clothctl/io/qps.hpp
//   qp_solve sequence.qpt --json --out frames.csv

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "clothctl/io/qps.hpp"
#include "clothctl/io/qpt.hpp"
#include "clothctl/io/qpt_text.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using clothctl::Index;
using clothctl::QpProblem;
using clothctl::QpReference;
using clothctl::QpSequenceFrame;
using clothctl::QpStatus;
using Vector = Eigen::VectorXd;

/// What counts as right: residuals relative to the size of the program, objective to max(1, |objective|, |r|).
constexpr double kAccepted = 1e-6;

struct Request {
  std::string file, solution, out;
  double time_limit = 0, tolerance = 0;
  int max_iterations = 0, passes = 3;
  bool json = false, closest_point = false;
};

/// Processor time of this thread, s: other work on the machine disturbs it little.
double seconds_now() {
#ifdef CLOCK_THREAD_CPUTIME_ID
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
#else
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
#endif
}

/// The clock of --time-limit, s.
double wall_clock(void*) { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

std::string lower_case_end(const std::string& path) {
  std::string end = path.substr(std::min(path.size(), path.find_last_of('.')));
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return end;
}

QpProblem read_problem(const std::string& path) {
  const std::string text = must(clothctl::read_file(path));
  const std::string end = lower_case_end(path);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  const bool starts_as_qpt = first != std::string::npos && text.compare(first, 3, "qpt") == 0;
  const bool is_qps = end == ".qps" || end == ".mps" || (end != ".qpt" && !starts_as_qpt);
  return must(is_qps ? clothctl::parse_qps(text, path) : clothctl::parse_qpt(text, path));
}

/// One solve and what an independent check says of it.
struct Answer {
  QpStatus status = QpStatus::InvalidData;
  int iterations = 0;
  double seconds = 0;
  clothctl::KktResiduals<double> kkt;
  bool has_point = false;  // x, y, z are the best iterate, and kkt judges them
  double objective = 0;    // in the file's sense, r included
  std::optional<double> proof_residual, proof_value;
  std::optional<double> shift_norm;  // how far --closest-point had to move the rows
  std::string note;
  QpReference reference;  // for --solution
};

bool is_proof(QpStatus s) { return s == QpStatus::PrimalInfeasible || s == QpStatus::DualInfeasible; }

std::string qpt_status(QpStatus s) {
  if (s == QpStatus::Solved) return "optimal";
  if (s == QpStatus::PrimalInfeasible) return "infeasible";
  if (s == QpStatus::DualInfeasible) return "unbounded";
  return std::string(to_string(s));
}

/// Either solver behind one face: bounds alone go to BoxActiveSet.
class Solver {
 public:
  Solver(const QpProblem& problem, const Request& o)
      : problem_(problem), boxed_(problem.m() == 0), closest_(o.closest_point), box_(settings(o)), rows_(settings(o)) {
    result_.resize(problem.n(), problem.m());
    refusal_ = boxed_ ? box_.set_hessian(problem.H) : rows_.set_hessian(problem.H);
    if (refusal_ != QpStatus::Solved) {
      note(boxed_ ? box_.refusal() : rows_.refusal(), "H", problem.H, o.file);
    } else if (!boxed_) {
      refusal_ = rows_.set_rows(problem.A);
      if (refusal_ != QpStatus::Solved) note(rows_.refusal(), "A", problem.A, o.file);
    }
  }

  void shift() {
    if (boxed_) return box_.shift(problem_.shift);
    rows_.shift(problem_.shift, problem_.row_shift());
  }
  void reset() { boxed_ ? box_.reset() : rows_.reset(); }

  /// Solves one frame. A crossed pair of bounds proves by itself that nothing is feasible.
  void solve(const QpSequenceFrame& f) {
    result_.iterations = 0;
    crossed_ = clothctl::first_crossed_bound(f);
    result_.status = refusal_ != QpStatus::Solved ? refusal_
                     : crossed_ >= 0              ? QpStatus::PrimalInfeasible
                     : boxed_                     ? box_.solve(f.g, f.lb, f.ub, result_)
                                                  : rows_.solve(f.g, f.lb, f.ub, f.rl, f.ru, result_);
  }

  /// The answer of the last solve.
  Answer judge(const QpSequenceFrame& f, double seconds) const {
    const Vector &x = result_.x, &y = result_.row_multipliers, &z = result_.bound_multipliers;
    Answer a;
    a.status = result_.status;
    a.iterations = result_.iterations;
    a.seconds = seconds;
    a.note = a.status == QpStatus::InvalidData ? result_.message : refused_;
    a.reference.status = qpt_status(a.status);
    if (crossed_ >= 0 && a.status == QpStatus::PrimalInfeasible) {
      const bool row = crossed_ >= problem_.n();
      const Index i = row ? crossed_ - problem_.n() : crossed_;
      a.note = (row ? "row " : "unknown ") + std::to_string(i) + ": lower bound " +
               clothctl::number_text(row ? f.rl[i] : f.lb[i]) + " above " + clothctl::number_text(row ? f.ru[i] : f.ub[i]);
    } else if (a.status == QpStatus::PrimalInfeasible) {
      a.reference.farkas_y = y;
      a.reference.farkas_z = z;
      const double size = std::max(y.size() > 0 ? y.lpNorm<Eigen::Infinity>() : 0, z.lpNorm<Eigen::Infinity>());
      Vector rest = z;
      if (y.size() > 0) rest += problem_.A.transpose() * y;
      a.proof_residual = rest.lpNorm<Eigen::Infinity>() / size;
      a.proof_value = (largest(y, f.rl, f.ru) + largest(z, f.lb, f.ub)) / size;
      if (closest_) {
        a.reference.x = x;
        a.shift_norm = result_.row_shifts.norm();
        a.note = result_.message;
      }
    } else if (a.status == QpStatus::DualInfeasible) {
      const Vector& d = result_.ray;
      a.reference.x = x;
      a.reference.ray = d;
      const double size = d.lpNorm<Eigen::Infinity>();
      double worst = std::max((problem_.H * d).lpNorm<Eigen::Infinity>(), outward(d, f.lb, f.ub));
      if (y.size() > 0) worst = std::max(worst, outward(problem_.A * d, f.rl, f.ru));
      a.proof_residual = worst / size;
      a.proof_value = f.g.dot(d) / size;
    } else if (refusal_ == QpStatus::Solved && a.status != QpStatus::InvalidData) {
      a.has_point = true;
      a.kkt = clothctl::kkt_residuals(problem_.H, f.g, problem_.A, f.rl, f.ru, f.lb, f.ub, x, y, z);
      a.objective = (problem_.maximise ? -1 : 1) * (a.kkt.objective + problem_.r);
      a.reference.objective = a.objective;
      a.reference.x = x;
      a.reference.y = y;
      a.reference.z = z;
    }
    return a;
  }

  double shift_and_solve_seconds(const QpSequenceFrame& f, bool first) {
    const double before = seconds_now();
    if (!first) shift();
    solve(f);
    return seconds_now() - before;
  }

 private:
  static clothctl::QpSettings<double> settings(const Request& o) {
    clothctl::QpSettings<double> s;
    if (o.tolerance > 0) s.stationarity_tolerance = s.feasibility_tolerance = s.complementarity_tolerance = o.tolerance;
    s.max_iterations = o.max_iterations;
    s.time_limit = o.time_limit;
    s.clock = wall_clock;
    s.closest_point = o.closest_point;
    return s;
  }

  /// Keeps the words for a matrix that is not convex; ends the program for one that is no matrix of a program at all.
  void note(const clothctl::QpRefusal& why, const char* matrix, const Eigen::MatrixXd& M, const std::string& file) {
    refused_ = why.message;
    if (why.index >= 0) {
      const Index i = why.index % M.rows(), j = why.index / M.rows();
      refused_ = std::string(matrix) + "(" + std::to_string(i) + "," + std::to_string(j) + ") is " +
                 clothctl::number_text(M(i, j)) + ": " + why.message;
    }
    if (why.status == QpStatus::InvalidData) refuse(file + ": " + refused_);
  }

  /// The largest wᵀt over lower ≤ t ≤ upper.
  static double largest(const Vector& w, const Vector& lower, const Vector& upper) {
    double sum = 0;
    for (Index i = 0; i < w.size(); ++i) {
      if (w[i] < 0 || w[i] > 0) sum += w[i] * (w[i] > 0 ? upper[i] : lower[i]);
    }
    return sum;
  }

  /// How far a direction runs into bounds.
  static double outward(const Vector& d, const Vector& lower, const Vector& upper) {
    double worst = 0;
    for (Index i = 0; i < d.size(); ++i) {
      if (!clothctl::is_unbounded(lower[i])) worst = std::max(worst, -d[i]);
      if (!clothctl::is_unbounded(upper[i])) worst = std::max(worst, d[i]);
    }
    return worst;
  }

  const QpProblem& problem_;
  bool boxed_, closest_;
  clothctl::BoxActiveSet<double> box_;
  clothctl::ActiveSet<double> rows_;
  clothctl::QpResult<double> result_;
  QpStatus refusal_ = QpStatus::Solved;
  std::string refused_;
  Index crossed_ = -1;
};

/// A cold solve: a new solver, its memory and its matrices are part of the time.
Answer solve_cold(const QpProblem& problem, const QpSequenceFrame& frame, const Request& o) {
  const double before = seconds_now();
  Solver solver(problem, o);
  solver.solve(frame);
  const double seconds = seconds_now() - before;
  return solver.judge(frame, seconds);
}

/// Whether the solver ended with a checked answer that does not contradict the file.
bool is_right(const Answer& a, const QpReference& expected, double r) {
  if (a.status != QpStatus::Solved && !is_proof(a.status)) return false;
  if (a.status == QpStatus::Solved && !(a.kkt.worst() <= kAccepted)) return false;
  if (!expected.status.empty() && expected.status != qpt_status(a.status)) return false;
  if (!expected.objective || a.status != QpStatus::Solved) return true;
  return std::abs(a.objective - *expected.objective) <= kAccepted * std::max({1.0, std::abs(*expected.objective), std::abs(r)});
}

void print(const nlohmann::ordered_json& figures, bool json) {
  if (json) {
    std::printf("%s\n", figures.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    return;
  }
  for (const auto& [key, value] : figures.items()) {
    const std::string text = value.is_string() ? value.get<std::string>() : value.is_null() ? "-" : value.dump();
    std::printf("%-32s %s\n", key.c_str(), text.c_str());
  }
}

/// The figures that one program and a sequence have in common; what is not known is null.
nlohmann::ordered_json figures_of(const QpProblem& problem, const std::string& status, const Answer& a, bool kkt_known) {
  const auto number = [](double v, bool known) { return known ? nlohmann::ordered_json(v) : nlohmann::ordered_json(); };
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

/// Refuses two names of one file: the second to be written would end the first.
void keep_apart(const char* what, const std::string& path, const char* other, const std::string& other_path) {
  std::error_code none;
  const bool same = path == other_path || std::filesystem::equivalent(path, other_path, none);
  if (!path.empty() && same) refuse(std::string(what) + ": '" + path + "' is the same file as " + other);
}

constexpr const char* kTableHead =
    "frame,objective,status,iterations,ms,cold_objective,cold_status,cold_iterations,cold_ms,expected_objective,right\n";

/// A row of --out; objectives that are not known stay empty.
std::string table_row(std::size_t frame, const Answer& warm, const Answer& cold, const QpReference& expected, bool right) {
  std::string row = std::to_string(frame);
  for (const Answer* a : {&warm, &cold}) {
    row += "," + (a->has_point ? clothctl::number_text(a->objective) : "") + "," + std::string(to_string(a->status)) + "," +
           std::to_string(a->iterations) + "," + clothctl::number_text(1000 * a->seconds);
  }
  return row + "," + (expected.objective ? clothctl::number_text(*expected.objective) : "") + (right ? ",1\n" : ",0\n");
}

int solve_single(const QpProblem& problem, const Request& o) {
  const Answer a = solve_cold(problem, problem, o);
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
  write(o.solution, clothctl::qpt_solution_text({problem.name, problem.n(), problem.m(), a.reference, {}}));
  write(o.out, kTableHead + table_row(0, a, a, problem.reference, right));
  print(j, o.json);
  return right ? 0 : 1;
}

/// Adds what one way of solving a sequence took, and the number of frames that it got right.
void add_times(nlohmann::ordered_json& j, const std::string& way, const QpProblem& problem, const std::vector<Answer>& all) {
  Index right = 0;
  std::vector<double> ms, iterations;
  for (std::size_t t = 0; t < all.size(); ++t) {
    right += is_right(all[t], problem.frames[t].reference, problem.r) ? 1 : 0;
    if (t == 0 && all.size() > 1) continue;  // nothing to be warm from
    ms.push_back(1000 * all[t].seconds);
    iterations.push_back(all[t].iterations);
  }
  j[way + "_median_ms"] = quantile(ms, 0.5);
  j[way + "_p99_ms"] = quantile(ms, 0.99);
  j[way + "_iterations_median"] = quantile(iterations, 0.5);
  j[way + "_right"] = right;
}

int solve_sequence(const QpProblem& problem, const Request& o) {
  const std::size_t count = problem.frames.size();
  std::vector<Answer> cold, warm;
  Progress progress;
  for (std::size_t t = 0; t < count; ++t) {
    cold.push_back(solve_cold(problem, problem.frames[t], o));
    if (cold.back().status == QpStatus::InvalidData) refuse(o.file + ": frame " + std::to_string(t) + ": " + cold.back().note);
    progress.show(static_cast<long>(t + 1), static_cast<long>(count));
  }
  Solver solver(problem, o);
  for (int pass = 0; pass < o.passes; ++pass) {
    solver.reset();
    for (std::size_t t = 0; t < count; ++t) {
      const double seconds = solver.shift_and_solve_seconds(problem.frames[t], t == 0);
      if (pass == 0) warm.push_back(solver.judge(problem.frames[t], seconds));
      warm[t].seconds = std::min(warm[t].seconds, seconds);
    }
  }
  progress.clear();

  clothctl::QpSolution solution{problem.name, problem.n(), problem.m(), {}, {}};
  Answer whole;  // the last objective, the worst residuals, and the sums of all
  whole.has_point = warm.back().has_point;
  whole.objective = warm.back().objective;
  std::string table = kTableHead, status = "solved", note;
  Index right_both = 0;
  for (std::size_t t = 0; t < count; ++t) {
    const QpReference& expected = problem.frames[t].reference;
    const bool right = is_right(warm[t], expected, problem.r) && is_right(cold[t], expected, problem.r);
    right_both += right ? 1 : 0;
    whole.iterations += warm[t].iterations;
    whole.seconds += warm[t].seconds + cold[t].seconds;
    for (const Answer* a : {&cold[t], &warm[t]}) {
      const bool good = is_right(*a, expected, problem.r);
      if (!good && note.empty()) {
        status = a->status == QpStatus::Solved || is_proof(a->status) ? "wrong" : std::string(to_string(a->status));
        note = "frame " + std::to_string(t) + (a == &warm[t] ? ", warm: " : ", cold: ") + std::string(to_string(a->status)) +
               (a->note.empty() ? "" : ", " + a->note);
      }
      if (!a->has_point) continue;
      using K = clothctl::KktResiduals<double>;
      for (auto part : {&K::stationarity, &K::feasibility, &K::complementarity, &K::relative_stationarity,
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

}  // namespace

int main(int argc, char** argv) {
  Request o;
  CLI::App app{
      "Solves a quadratic program, or every frame of a sequence cold and warm, and checks the answer on the file's own "
      "numbers. "
      "Exit code 0: solved, or proved infeasible or unbounded, as the file expects; 1: not so; 2: bad input."};
  app.add_option("FILE", o.file, "QPT file, or QPS/MPS file with a quadratic objective")->required();
  app.add_option(
      "--solution", o.solution,
      "File for status, objective, x, y, z (or the proof): QPT sections; with H x + g = A'y + z, multipliers >= 0 at "
      "lower bounds; for OBJSENSE MAX those of the negated objective");
  app.add_option("--out", o.out, "CSV file with a row a frame: objective, status, iterations, ms; warm and cold");
  app.add_flag("--json", o.json, "Print the figures as one JSON object on the last line");
  app.add_option("--time-limit", o.time_limit, "Seconds that each solve may take by the wall clock (default: any)")
      ->check(between(1e-6, 1e6));
  app.add_option("--max-iterations", o.max_iterations, "Rounds of a solve (default: 10 (n + m))")->check(between(1, 1e9));
  app.add_option("--tolerance", o.tolerance, "Relative residuals that count as solved (default: 1.6e-9)")
      ->check(between(1e-14, 0.1));
  app.add_flag("--closest-point", o.closest_point, "Infeasible programs: go to the closest point; --solution then has its x");
  app.add_option("--passes", o.passes, "Sequences: warm times are the least of this many passes")
      ->check(between(1, 1000))
      ->capture_default_str();
  parse(app, argc, argv);
  keep_apart("--solution", o.solution, "FILE", o.file);
  keep_apart("--out", o.out, "FILE", o.file);
  keep_apart("--out", o.out, "--solution", o.solution);
  const QpProblem problem = read_problem(o.file);
  return problem.frames.empty() ? solve_single(problem, o) : solve_sequence(problem, o);
}
