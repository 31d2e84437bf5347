#include "clothctl/core/number_text.hpp"

#include <bit>
#include <charconv>
#include <clocale>
#include <cstdint>
#include <limits>
#include <random>
#include <string>

#include "support/catch.hpp"

using clothctl::number_text;
using clothctl::rounded_text;

namespace {

/// A scalar that cannot become a double.
struct Sealed {
  Sealed() = default;
  explicit Sealed(double) {}
  Sealed operator+(Sealed) const { return {}; }
  Sealed operator-(Sealed) const { return {}; }
  Sealed operator*(Sealed) const { return {}; }
  Sealed operator/(Sealed) const { return {}; }
  bool operator<(Sealed) const { return false; }
  Sealed& operator+=(Sealed) { return *this; }
};

/// A scalar that can become a double.
struct Open : Sealed {
  using Sealed::Sealed;
  Open() = default;
  Open(Sealed) {}
  Open& operator+=(Open) { return *this; }
  explicit operator double() const { return 2.5; }
};

}  // namespace

namespace clothctl {

template <>
struct scalar_traits<Sealed> {
  static Sealed epsilon() { return {}; }
  static Sealed infinity() { return {}; }
  static bool is_finite(const Sealed&) { return true; }
  static bool is_unbounded(const Sealed&) { return false; }
};
template <>
struct scalar_traits<Open> : scalar_traits<Sealed> {};

}  // namespace clothctl

TEST_CASE("numbers are written with the fewest digits that distinguish them") {
  CHECK(number_text(0.25) == "0.25");
  CHECK(number_text(-1.0f) == "-1");
  CHECK(number_text(0.0) == "0");
  CHECK(number_text(-0.0) == "-0");
  CHECK(number_text(0.1f) == "0.1");
  CHECK(number_text(0.1) == "0.1");
  CHECK(number_text(0.1 + 0.2) == "0.30000000000000004");
  CHECK(number_text(1.0 / 3.0) == "0.3333333333333333");
  CHECK(number_text(1e300) == "1e+300");
  CHECK(number_text(100.0L) == "100");
}

TEST_CASE("infinities and NaN have names, under -ffast-math too") {
  const double infinity = std::numeric_limits<double>::infinity();
  CHECK(number_text(infinity) == "inf");
  CHECK(number_text(-infinity) == "-inf");
  CHECK(number_text(std::numeric_limits<float>::infinity()) == "inf");
  CHECK(number_text(std::numeric_limits<double>::quiet_NaN()) == "nan");
  CHECK(number_text(-std::numeric_limits<float>::quiet_NaN()) == "nan");
}

TEST_CASE("other scalars are written as doubles, or as ? if they do not convert") {
  CHECK(number_text(Open()) == "2.5");
  CHECK(number_text(Sealed()) == "?");
}

TEST_CASE("messages about numbers that nothing has, and that are too large") {
  using clothctl::missing_item_line;
  CHECK(missing_item_line("obstacle", 99, 1) == "no obstacle 99 (there are 1)");
  CHECK(missing_item_line("hand", -1, 0) == "no hand -1 (there are 0)");
  using clothctl::detail::unbounded_text;
  CHECK(unbounded_text(1e300) == ", at most 1e20");
  CHECK(unbounded_text(1e19).empty());
  CHECK(unbounded_text(-std::numeric_limits<double>::infinity()).empty());
  CHECK(unbounded_text(std::numeric_limits<double>::quiet_NaN()).empty());
}

TEST_CASE("written numbers read back as the same number") {
  std::mt19937_64 engine(3);
  for (int i = 0; i < 2000; ++i) {
    const double value = std::bit_cast<double>(engine());
    if (!clothctl::is_finite(value) || (value < 1e-300 && value > -1e-300)) continue;
    const std::string text = number_text(value);
    double read = 0;
    std::from_chars(text.data(), text.data() + text.size(), read);
    if (read != value) FAIL(text);
  }
  SUCCEED();
}

TEST_CASE("the locale does not change how numbers are written") {
  const std::string before = std::setlocale(LC_NUMERIC, nullptr);
  bool found = false;
  for (const char* name : {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "fr_FR"})
    found = found || std::setlocale(LC_NUMERIC, name);
  if (!found) WARN("no locale with a decimal comma is installed");
  CHECK(number_text(0.5) == "0.5");
  CHECK(number_text(1234567.25) == "1234567.25");
  std::setlocale(LC_NUMERIC, before.c_str());
}

TEST_CASE("measured quantities are written with four digits") {
  CHECK(rounded_text(0.1 + 0.2) == "0.3");
  CHECK(rounded_text(1.0 / 3.0) == "0.3333");
  CHECK(rounded_text(-12345.678) == "-1.235e+04");
  CHECK(rounded_text(1.0f / 3.0f) == "0.3333");
  CHECK(rounded_text(1e300 / 3) == "3.333e+299");
  CHECK(rounded_text(-std::numeric_limits<double>::quiet_NaN()) == "nan");
  CHECK(rounded_text(-std::numeric_limits<float>::infinity()) == "-inf");
  CHECK(rounded_text(Open{}) == "2.5");
  CHECK(rounded_text(Sealed{}) == "?");
}
