// The planned finger forces of a window.

#include "clothctl/mpc/detail/finger_plan.hpp"

#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::kWindow;
using clothctl_test::SmallWindow;

TEST_CASE("a finger plan starts at zero and names each finger's vertices", "[mpc]") {
  const SmallWindow window(GripInput::Force);
  const auto& basis = window.problem.basis;
  detail::FingerPlan<double> plan;
  plan.reset(basis, kWindow);
  // The basis names them too, when it computes forces.
  std::vector<FingerForce<double>> expected(static_cast<std::size_t>(basis.force_count()));
  basis.finger_forces(VectorX<double>::Constant(basis.unknowns(), 0.1), expected);
  for (Index k = 0; k < kWindow; ++k) {
    REQUIRE(plan.frame(k).size() == expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const FingerForce<double>& f = plan.frame(k)[i];
      CHECK((f.grip == expected[i].grip && f.finger == expected[i].finger &&
             f.vertex == expected[i].vertex));
      CHECK(f.force.isZero(0.0));
    }
  }
}

TEST_CASE("a finger plan moves on by a frame and repeats its last", "[mpc]") {
  const SmallWindow window(GripInput::Force);
  detail::FingerPlan<double> plan;
  plan.reset(window.problem.basis, kWindow);
  for (Index k = 0; k < kWindow; ++k) plan.frame(k)[3].force[2] = static_cast<double>(k);
  const long before = clothctl_test::allocations();
  plan.shift();
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  for (Index k = 0; k < kWindow; ++k)
    CHECK(plan.frame(k)[3].force[2] == static_cast<double>(std::min(k + 1, kWindow - 1)));
  plan.frame(kWindow - 1)[3].force[2] = 9.0;  // the repeated frame is a copy
  CHECK(plan.frame(kWindow - 2)[3].force[2] == static_cast<double>(kWindow - 1));
  plan.reset(window.problem.basis, 1);
  plan.frame(0)[0].force[0] = 5.0;
  plan.shift();
  CHECK(plan.frame(0)[0].force[0] == 5.0);
}
