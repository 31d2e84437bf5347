// A program of two translation units made from the same source. One is compiled for a wider
// instruction set if the compiler has it. If it links, no function is defined twice. If both give
// the same results, neither uses the code or memory layout of the other.

#include <cmath>
#include <cstdio>

#include "units.hpp"

namespace {

bool can_run_wide() {
#ifdef WIDE_IS_AVX2
  return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
#else
  return true;
#endif
}

bool is_near(const char* what, double value, double expected, double tolerance) {
  const double scale = std::fmax(1.0, std::fmax(std::fabs(value), std::fabs(expected)));
  const bool near_enough = std::fabs(value - expected) <= tolerance * scale;  // false for NaN
  std::printf("%-26s %.12g %.12g%s\n", what, value, expected, near_enough ? "" : "  <-- differ");
  return near_enough;
}

}  // namespace

int main() {
  bool good = true;
  const std::vector<Figure> plain = plain::figures();
  if (!can_run_wide()) {
    std::printf("the wide unit is linked, but not for this processor\n");
    for (const Figure& figure : plain)
      good = is_near(figure.name, figure.value, figure.value, 0.0) && good;
    return good ? 0 : 1;
  }
  const std::vector<Figure> wide = wide::figures(), again = plain::figures();
  for (std::size_t i = 0; i < plain.size(); ++i) {
    good = is_near(plain[i].name, plain[i].value, wide[i].value, plain[i].tolerance) && good;
    good = again[i].value == plain[i].value && good;
  }
  for (int order = 0; order < 2; ++order) {
    Passed passed;
    (order == 0 ? plain::fill : wide::fill)(passed);
    const double grown = (order == 0 ? wide::grow : plain::grow)(passed);
    good = is_near("passed between units", grown, 38 + 8 + 55 * 11 + 55 * 4, 0.0) && good;
  }
  return good ? 0 : 1;
}
