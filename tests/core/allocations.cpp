// The counter itself: it sees what it should, and it sees nothing where nothing is allocated.

#include "support/allocations.hpp"

#include <Eigen/Core>
#include <string>
#include <vector>

#include "support/catch.hpp"

using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;

namespace {

// Lets the optimiser believe that someone looks at the bytes, so that it does not remove an
// allocation.
void keep(const void* block) { asm volatile("" : : "r"(block) : "memory"); }

}  // namespace

TEST_CASE("the allocation canary sings wherever counting is possible", "[allocations]") {
#if defined(__GLIBC__)
  CHECK(allocation_counting_works());
#else
  CHECK_FALSE(allocation_counting_works());
#endif
}

TEST_CASE("containers and Eigen are counted, work on existing memory is not", "[allocations]") {
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
  y = a * x;  // a temporary: the assignment that design rule 7 forbids in a step
  const long sloppy = allocations() - before;
  CHECK(sloppy > 0);
}
