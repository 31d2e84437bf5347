#include "clothctl/core/number_text.hpp"

#include "support/catch.hpp"

TEST_CASE("numbers in error lines keep nine digits") {
  CHECK(clothctl::detail::number_text(0.25) == "0.25");
  CHECK(clothctl::detail::number_text(-1.0f) == "-1");
  CHECK(clothctl::detail::number_text(1.0 / 3.0) == "0.333333333");
}
