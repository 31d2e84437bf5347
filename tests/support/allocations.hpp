#pragma once

// Counts heap allocations, so that a test can show that a step makes none:
//
//   if (allocation_counting_works()) {
//     const long before = allocations();
//     model.step(...);
//     CHECK(allocations() == before);
//   }
//
// All of malloc, calloc, realloc, aligned_alloc, posix_memalign, memalign and hence operator new of
// every kind are counted, on every thread. It works with glibc, and under the address sanitizer.

namespace clothctl_test {

/// How often the heap was asked for memory since the program started.
long allocations();

/// The canary: allocates in each of the ways above; returns true when the counter saw every one.
/// False with other C libraries and sanitizers, where a test of allocations must be skipped.
bool allocation_counting_works();

}  // namespace clothctl_test
