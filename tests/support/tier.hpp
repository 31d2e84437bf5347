#pragma once

// The two tiers of tests: quick (every run) and full (`scripts/test --full`, or CLOTHCTL_FULL=1 in
// the environment).

#include <cstdlib>
#include <cstring>

namespace clothctl_test {

/// Returns whether the full tier was chosen.
inline bool full_tier() {
  const char* value = std::getenv("CLOTHCTL_FULL");
  return value != nullptr && std::strcmp(value, "1") == 0;
}

/// Returns the number of trials for the chosen tier.
inline int trials(int quick, int full) { return full_tier() ? full : quick; }

}  // namespace clothctl_test
