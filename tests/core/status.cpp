#include "clothctl/core/status.hpp"

#include <set>
#include <string>
#include <string_view>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Returns the names of all values, up to the first "unknown".
template <class Status>
std::set<std::string> names_of_all() {
  std::set<std::string> names;
  int count = 0;
  for (; count < 100; ++count) {
    const std::string_view name = to_string(static_cast<Status>(count));
    if (name == "unknown") break;
    names.emplace(name);
  }
  CHECK(static_cast<int>(names.size()) == count);
  return names;
}

}  // namespace

TEST_CASE("every status has its own name in snake case", "[status]") {
  const std::set<std::string> step = names_of_all<StepStatus>();
  const std::set<std::string> qp = names_of_all<QpStatus>();
  const std::set<std::string> plan = names_of_all<PlanStatus>();
  CHECK(step.size() == static_cast<std::size_t>(StepStatus::NumericalFailure) + 1);
  CHECK(qp.size() == static_cast<std::size_t>(QpStatus::InvalidData) + 1);
  CHECK(plan.size() == static_cast<std::size_t>(PlanStatus::Failed) + 1);
  for (const std::set<std::string>* names : {&step, &qp, &plan}) {
    for (const std::string& name : *names) {
      CHECK(name.find_first_not_of("abcdefghijklmnopqrstuvwxyz_") == std::string::npos);
    }
  }
}

TEST_CASE("names of statuses are compile-time constants", "[status]") {
  static_assert(to_string(StepStatus::Converged) == "converged");
  static_assert(to_string(QpStatus::PrimalInfeasible) == "primal_infeasible");
  static_assert(to_string(PlanStatus::Relaxed) == "relaxed");
  SUCCEED();
}

TEST_CASE("a value outside the enum has the name unknown", "[status]") {
  CHECK(to_string(static_cast<StepStatus>(77)) == "unknown");
  CHECK(to_string(static_cast<QpStatus>(77)) == "unknown");
  CHECK(to_string(static_cast<PlanStatus>(77)) == "unknown");
}
