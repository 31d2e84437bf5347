#include "clothctl/core/report.hpp"

#include <type_traits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("a new report does not claim that a step advanced", "[report]", float, double) {
  const StepReport<TestType> report;
  CHECK(report.status == StepStatus::Converged);
  CHECK_FALSE(report.advanced);
  CHECK(report.residual == TestType(0));
  CHECK(report.iterations == 0);
  CHECK(std::is_trivially_copyable_v<StepReport<TestType>>);
}

TEST_CASE("a report distinguishes an unconverged step from an unchanged state", "[report]") {
  const StepReport<double> advanced{StepStatus::IterationLimit, true, 1e-3, 100};
  const StepReport<double> untouched{StepStatus::InvalidInput, false, 0.0, 0};
  CHECK(advanced.advanced);
  CHECK(advanced.status != StepStatus::Converged);
  CHECK_FALSE(untouched.advanced);
}
