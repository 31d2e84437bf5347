// A program of several units, one of them compiled for another instruction set where the compiler has it. That it links shows
// that no function of the headers is defined twice; that it runs, that the units do not take each other's code for their own.

#include <cstdio>

#include "units.hpp"

namespace {

bool is_small(const char* what, double error) {
  std::printf("%s: error %.2g\n", what, error);
  return error < 1e-3;
}

bool can_run_two() {
#ifdef TWO_NEEDS_AVX2
  return __builtin_cpu_supports("avx2") != 0;
#else
  return true;
#endif
}

}  // namespace

int main() {
  bool good = one::makes_memory();
  good = is_small("one, factor", one::factor_error()) && good;
  good = is_small("one, step", one::step_error()) && good;
  if (can_run_two()) {
    good = is_small("two, factor", two::factor_error()) && good;
    good = is_small("two, step", two::step_error()) && good;
  } else {
    std::printf("two: linked, but not for this processor\n");
  }
  return good ? 0 : 1;
}
