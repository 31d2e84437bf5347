// At baseline flags, a sheet has the same bits after 100 steps with every compiler.

#include "support/catch.hpp"
#include "support/state_hash.hpp"

using namespace clothctl_test;

TEST_CASE("100 steps give the recorded bits at baseline flags", "[cloth]") {
  if (!kBaselineFlags) {
    WARN("skipped: equal bits are promised for x86-64 at baseline flags only");
    return;
  }
  CHECK(sheet_hashes<double>() == kDoubleHashes);
  CHECK(sheet_hashes<float>() == kFloatHashes);
}

TEST_CASE("100 steps give the same bits when repeated", "[cloth]") {
  CHECK(sheet_hashes<double>() == sheet_hashes<double>());
}
