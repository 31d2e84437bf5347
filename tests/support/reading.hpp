#pragma once

// What tests of readers share: the value that must have been read, why a text was refused, and
// texts that differ in one place.

#include <cstddef>
#include <string>
#include <utility>

#include "clothctl/core/result.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// The value of a result; without one the test ends, with what went wrong.
template <class T>
T value_of(clothctl::Result<T> result) {
  INFO((result ? std::string() : result.error()));
  REQUIRE(result.has_value());
  return std::move(result).value();
}

/// What went wrong, "accepted" when nothing did.
template <class T>
std::string refusal_of(const clothctl::Result<T>& result) {
  return result ? "accepted" : result.error();
}

/// A text with the first `from`, which it must hold, replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  REQUIRE(place != std::string::npos);
  return text.replace(place, from.size(), to);
}

}  // namespace clothctl_test
