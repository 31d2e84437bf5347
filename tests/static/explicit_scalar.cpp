// The whole library with a scalar that allows no silent conversion; see instantiations.inc.

#include "explicit_scalar.hpp"

#include <clothctl/clothctl.hpp>

namespace clothctl::inline CLOTHCTL_ABI {

/// Stores the class in snapshots like a double.
template <>
struct snapshot_scalar_traits<clothctl_test::ExplicitDouble> {
  static constexpr std::uint32_t kCode = snapshot_scalar_traits<double>::kCode;
  static constexpr std::size_t kBytes = snapshot_scalar_traits<double>::kBytes;
  static void store(const clothctl_test::ExplicitDouble& value, std::byte* out) {
    snapshot_scalar_traits<double>::store(value.unboxed(), out);
  }
  static void load(const std::byte* in, clothctl_test::ExplicitDouble& value) {
    double number = 0.0;
    snapshot_scalar_traits<double>::load(in, number);
    value = clothctl_test::ExplicitDouble(number);
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#define CLOTHCTL_EXPLICIT_SCALAR
#define CLOTHCTL_SCALAR clothctl_test::ExplicitDouble
#include "instantiations.inc"
