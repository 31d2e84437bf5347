// Tests of the counter itself: it counts allocations and nothing else.

#include "support/allocations.hpp"

#include <Eigen/Core>
#include <string>
#include <vector>

#include "support/catch.hpp"

using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;

namespace {

// Makes the optimiser assume that the bytes are read, so that it keeps the allocation.
void keep(const void* block) { asm volatile("" : : "r"(block) : "memory"); }

}  // namespace

TEST_CASE("the counter sees every kind of allocation wherever counting is possible",
          "[allocations]") {
#if defined(__GLIBC__)
  CHECK(allocation_counting_works());
#else
  CHECK_FALSE(allocation_counting_works());
#endif
}

TEST_CASE("containers and Eigen are counted, and work in existing memory is not", "[allocations]") {
  if (!allocation_counting_works()) {
    WARN("allocations cannot be counted in this build");
    return;
  }
  long before = allocations();
  std::vector<int> list(100, 1);
  keep(list.data());
  CHECK(allocations() > before);

  before = allocations();
  Eigen::VectorXd x = Eigen::VectorXd::Constant(50, 1.0);
  Eigen::MatrixXd a = Eigen::MatrixXd::Identity(50, 50);
  Eigen::VectorXd y(50);
  CHECK(allocations() >= before + 3);

  before = allocations();
  y.noalias() = a * x;
  list[3] = 7;
  const long during = allocations() - before;
  CHECK(during == 0);
  CHECK(y.sum() == 50.0);

  before = allocations();
  y = a * x;  // a temporary, which allocates; a step must not do this
  const long sloppy = allocations() - before;
  CHECK(sloppy > 0);
}
