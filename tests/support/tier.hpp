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

/// True in builds with sanitizers, which run many times slower: large cases are left out there.
inline constexpr bool kSanitized =
#ifdef CLOTHCTL_SANITIZED_BUILD
    true;
#else
    false;
#endif

/// Returns the number of trials for the chosen tier.
inline int trials(int quick, int full) { return full_tier() ? full : quick; }

/// The same for trials of which the sanitizers need fewer: they look for what does not depend on
/// the outcome.
inline int trials(int quick, int full, int sanitized) {
  return trials(kSanitized ? sanitized : quick, full);
}

}  // namespace clothctl_test
