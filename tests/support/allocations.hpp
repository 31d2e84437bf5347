#pragma once

// Counts heap allocations, so that a test can show that a step does not allocate:
//
//   if (allocation_counting_works()) {
//     const long before = allocations();
//     model.step(...);
//     CHECK(allocations() == before);
//   }
//
// Counts malloc, calloc, realloc, aligned_alloc, posix_memalign and memalign, and so every kind of
// operator new, on every thread. Works with glibc, and under the address sanitizer.

namespace clothctl_test {

/// Returns the number of allocations since the program started.
long allocations();

/// Checks the counter itself: allocates in each of the ways above and returns whether each was
/// counted. With other C libraries and sanitizers it returns false; tests of allocations must then
/// be skipped.
bool allocation_counting_works();

}  // namespace clothctl_test
