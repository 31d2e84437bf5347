// Random problems of every family (random_problems.hpp), solved by both solvers. The status must be
// the one that the problem was built for, and an independent check in long double must accept every
// answer and certificate. Some problems are followed by a second one on the same solver, which
// starts warm from the result of the first.
//
// A failure names family and seed. With CLOTHCTL_QP_TRIAL="family/seed" in the environment, only
// that problem runs.

#include "qp/random_problems.hpp"

#include <cstdlib>
#include <iomanip>
#include <sstream>
#include <type_traits>

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// Tolerances of answers.
struct Demands {
  /// Limits of the three residuals, of the objective's error, and of rounding in certificates.
  double residual, objective, rounding;
  /// From this value of RandomQp::miss on, only a certificate is accepted.
  double seen;
};

template <class S>
Demands demands() {
  return sizeof(S) == sizeof(float) ? Demands{4e-4, 1e-3, 1e-5, 1e-2}
                                    : Demands{1e-8, 1e-6, 1e-12, 1e-6};
}

/// A solver and its last answer.
template <class S, class Solver>
class Bench {
 public:
  static constexpr bool kRows = std::is_same_v<Solver, ActiveSet<S>>;

  /// Returns "", or what was refused.
  std::string set(const RandomQp& q) {
    if (solver_.set_hessian(q.H.cast<S>()) != QpStatus::Solved)
      return std::string("H was refused: ") + solver_.refusal().message;
    if constexpr (kRows) {
      if (solver_.set_rows(q.A.cast<S>()) != QpStatus::Solved)
        return std::string("A was refused: ") + solver_.refusal().message;
    }
    return {};
  }

  /// Solves, and returns what is wrong with the answer.
  std::string solve(const RandomQp& q) {
    const VectorX<S> g = q.g.cast<S>(), lb = q.lb.cast<S>(), ub = q.ub.cast<S>();
    QpStatus status;
    if constexpr (kRows) {
      status = solver_.solve(g, lb, ub, q.rl.cast<S>(), q.ru.cast<S>(), result);
    } else {
      status = solver_.solve(g, lb, ub, result);
    }
    if (status != result.status) return "the status returned is not that of the result";
    const std::string fault = judge(q);
    if (!fault.empty())
      return std::string(to_string(status)) + " after " + std::to_string(result.iterations) +
             " rounds: " + fault;
    const Index most = 10 * (q.H.rows() + q.A.rows()) + 10;
    return result.iterations <= most ? "" : "more rounds than the limit";
  }

  QpResult<S> result;

 private:
  std::string judge(const RandomQp& q) const {
    const Demands d = demands<S>();
    const bool clear = q.miss >= d.seen;
    const VectorXd x = result.x.template cast<double>(),
                   y = result.row_multipliers.template cast<double>(),
                   z = result.bound_multipliers.template cast<double>(),
                   ray = result.ray.template cast<double>();
    switch (result.status) {
      case QpStatus::Solved:
        if (q.outcome != Outcome::Optimal && clear) return "it has no solution";
        return fault_of_solution(q, x, y, z, d.residual, d.objective);
      case QpStatus::PrimalInfeasible:
        if (q.outcome != Outcome::Infeasible && q.outcome != Outcome::Neither)
          return "it is feasible";
        return fault_of_farkas(q, y, z, d.rounding);
      case QpStatus::DualInfeasible:
        if (q.outcome != Outcome::Unbounded && clear) return "it is not unbounded, or not feasible";
        return fault_of_ray(q, ray, x, d.rounding, d.residual);
      case QpStatus::InvalidData:
        return q.outcome == Outcome::Crossed && result.invalid_index >= 0
                   ? ""
                   : std::string("refused: ") + result.message;
      default: return clear ? "not finished" : "";
    }
  }

  Solver solver_;
};

/// The result of a trial.
struct Trial {
  std::string fault;
  /// Whether the problem itself is wrong because of rounding with uneven scales.
  bool spoilt = false;
  int rounds = 0;
  /// Iterations divided by the documented limit.
  double effort = 0.0;
};

/// Runs a problem and the problems that follow it on the same solver. Calls `watch` before each
/// solve.
template <class S, class Solver, class Watch>
Trial run(const QpRecipe& recipe, Draws& draws, const Watch& watch) {
  Trial trial;
  Bench<S, Solver> bench;
  QpMaker maker(recipe, draws);
  RandomQp q = maker.make();
  const auto answer = [&](const char* when) {
    trial.fault = fault_of_construction(q);
    if (recipe.uneven && !trial.fault.empty()) {
      trial.spoilt = true;
      trial.fault.clear();
      return false;
    }
    if (trial.fault.empty()) {
      watch(q);
      trial.fault = bench.solve(q);
    }
    trial.rounds = std::max(trial.rounds, bench.result.iterations);
    trial.effort =
        std::max(trial.effort, bench.result.iterations /
                                   (10.0 * static_cast<double>(q.H.rows() + q.A.rows()) + 10.0));
    if (!trial.fault.empty()) trial.fault = when + trial.fault;
    return trial.fault.empty();
  };
  trial.fault = bench.set(q);
  if (!trial.fault.empty() || !answer("")) return trial;
  const bool solved = q.outcome == Outcome::Optimal;
  switch (draws.between(0, 8)) {
    case 0:
      if (answer("again: ") && solved && bench.result.iterations > 0)
        trial.fault = "again: it took rounds";
      break;
    case 1:
      q = solved ? maker.turn() : maker.make(Outcome::Optimal);
      answer("then with another gradient: ");
      break;
    case 2:
      q = maker.make(Outcome::Optimal);
      answer("then with other bounds: ");
      break;
    case 3:
      if (recipe.m == 0) break;
      q = maker.make(Outcome::Infeasible);
      if (answer("then infeasible: ")) {
        q = maker.make(Outcome::Optimal);
        answer("then infeasible, then feasible: ");
      }
      break;
    case 4: {
      QpMaker other(recipe, draws);
      q = other.make();
      trial.fault = bench.set(q);
      if (trial.fault.empty()) answer("then with other matrices: ");
      break;
    }
    default: break;
  }
  return trial;
}

/// Runs the trial of a family and seed.
template <class S, class Watch>
Trial run_seed(const QpFamilyEntry& family, std::uint64_t seed, const Watch& watch) {
  Draws draws(seed);
  QpRecipe recipe = draw_recipe(family, draws);
  if (sizeof(S) == sizeof(float)) {  // small integers, and no differences below float's tolerances
    recipe.span = 3;
    recipe.n = recipe.contact ? recipe.n : std::min(recipe.n, 30);
    recipe.margin = std::max(recipe.margin, 0.0625);
    recipe.copies = std::min(recipe.copies, 0.3);
  }
  const bool box = recipe.m == 0 && draws.chance(0.8);
  return box ? run<S, BoxActiveSet<S>>(recipe, draws, watch)
             : run<S, ActiveSet<S>>(recipe, draws, watch);
}

std::string title(const QpFamilyEntry& family, std::uint64_t seed) {
  return std::string(family.name) + "/" + std::to_string(seed);
}

/// Families whose numbers differ by 1e±8. Residuals are measured relative to the largest terms and
/// may hide an error of the objective, and the status may rightly be "not finished". Both are
/// counted separately; wrong claims are not allowed.
bool is_uneven(const QpFamilyEntry& family) {
  const std::string name = family.name;
  return name.find("scaled") != std::string::npos || name.find("mixture") != std::string::npos;
}

/// Whether a fault is not a wrong claim: the solver did not finish, or its residuals are small and
/// only the objective is off.
bool is_beyond(const std::string& fault) {
  return fault.find("not finished") != std::string::npos ||
         fault.find("objective error") != std::string::npos;
}

/// Runs many trials of the families that `wanted` accepts, and lists the first failures.
template <class S, class Wanted>
void campaign(std::uint64_t first, int count, const Wanted& wanted) {
  constexpr int kListed = 30;
  int failed = 0, unfinished = 0, spoilt = 0, uneven = 0, beyond = 0;
  double effort = -1.0;
  std::string slowest;
  for (int k = 0; k < count; ++k) {
    const QpFamilyEntry& family = qp_families()[static_cast<std::size_t>(qp_family_of(k))];
    if (!wanted(family)) continue;
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    const Trial trial = run_seed<S>(family, seed, [](const RandomQp&) {});
    spoilt += trial.spoilt ? 1 : 0;
    uneven += is_uneven(family) ? 1 : 0;
    if (trial.effort > effort) {
      effort = trial.effort;
      slowest = title(family, seed) + " took " + std::to_string(trial.rounds) + " rounds";
    }
    if (trial.fault.empty()) continue;
    if (is_uneven(family) && is_beyond(trial.fault)) {
      ++beyond;
      continue;
    }
    if (trial.fault.find("not finished") != std::string::npos) ++unfinished;
    if (++failed <= kListed) UNSCOPED_INFO(title(family, seed) << ": " << trial.fault);
  }
  UNSCOPED_INFO("the slowest: " << slowest << ", " << effort << " of the limit");
  CHECK(failed == unfinished);
  CHECK(1000 * unfinished <= count);
  CHECK(20 * beyond <= uneven);
  CHECK(spoilt <= count / 200);
  if (full_tier())
    WARN(count << " trials, " << beyond << " of " << uneven << " uneven ones unfinished or off, "
               << unfinished << " others unfinished; the slowest: " << slowest << ", " << effort
               << " of the limit");
}

}  // namespace

TEST_CASE(
    "random problems of every family end as they were built, and a check in long double accepts "
    "them",
    "[qp][random]") {
  const char* single = std::getenv("CLOTHCTL_QP_TRIAL");
  if (single == nullptr) {
    campaign<double>(1, trials(1500, 100000), [](const QpFamilyEntry&) { return true; });
    return;
  }
  bool known = false;
  for (const QpFamilyEntry& family : qp_families()) {
    const std::string wanted = single, name = family.name;
    if (wanted.rfind(name + "/", 0) != 0) continue;
    known = true;
    CHECK(run_seed<double>(family, std::strtoull(wanted.c_str() + name.size() + 1, nullptr, 10),
                           [](const RandomQp&) {})
              .fault == "");
  }
  CHECK(known);
}

TEST_CASE("in float, random problems with small integers end as they were built", "[qp][random]") {
  campaign<float>(1, trials(500, 10000), [](const QpFamilyEntry& family) {
    const std::string name = family.name;
    return name.find("scaled") == std::string::npos && name.find("mixture") == std::string::npos &&
           name.find("sparse") == std::string::npos && name != "dense";
  });
}

TEST_CASE("random problems that once ended wrong end right", "[qp][random]") {
  struct Lesson {
    const char* family;
    std::uint64_t seed;
    bool finished;
  };
  // The old errors: a ray was lost in the rounding of H d; an unknown between its bounds hid a ray;
  // plain sums did not show the residual of a far point, in the null space or on columns of 2^60;
  // a second solve ended although only the caller's tolerance was met; a soft penalty did not show
  // a violated row with a large unit; a start from other matrices was so far that it spent the
  // budget; the proximal term let a flat direction take hundreds of steps; single entries of the
  // point that was called solved at the end were wrong; and the same problem went to the structured
  // method again, which had not solved it.
  const Lesson lessons[] = {{"unbounded", 9141, true},        {"unbounded box", 17051, true},
                            {"unbounded box", 57420, true},   {"unbounded", 86191, true},
                            {"scaled box", 25082, true},      {"mixture", 73349, false},
                            {"scaled box", 86320, false},     {"scaled box", 33693, true},
                            {"sparse mixture", 12215, false}, {"sparse mixture", 76669, false},
                            {"mixture", 50919, false},        {"scaled infeasible", 9175, false},
                            {"tiny unbounded", 21069, true},  {"scaled infeasible", 32992, false},
                            {"contact", 44905, true}};
  for (const Lesson& lesson : lessons) {
    for (const QpFamilyEntry& family : qp_families()) {
      if (std::string(family.name) != lesson.family) continue;
      const std::string fault = run_seed<double>(family, lesson.seed, [](const RandomQp&) {}).fault;
      INFO(title(family, lesson.seed) << ": " << fault);
      CHECK((fault.empty() || (!lesson.finished && is_beyond(fault))));
    }
  }
}

TEST_CASE("in float, a point within the tolerances on a ray of a small slope is no solution",
          "[qp][random]") {
  for (const QpFamilyEntry& family : qp_families()) {
    if (std::string(family.name) != "unbounded") continue;
    CHECK(run_seed<float>(family, 6864, [](const RandomQp&) {}).fault == "");
  }
}
