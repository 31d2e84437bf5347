// A sheet has the same bits after 100 steps whatever compiler built the program, at baseline flags.

#include "support/catch.hpp"
#include "support/state_hash.hpp"

using namespace clothctl_test;

TEST_CASE("100 steps give the committed bits at baseline flags", "[cloth]") {
  if (!kBaselineFlags) {
    WARN("skipped: equal bits are promised for x86-64 at baseline flags only");
    return;
  }
  CHECK(sheet_hashes<double>() == kDoubleHashes);
  CHECK(sheet_hashes<float>() == kFloatHashes);
}

TEST_CASE("100 steps give the same bits again", "[cloth]") {
  CHECK(sheet_hashes<double>() == sheet_hashes<double>());
}
