#pragma once

// Shared by the tests of readers: returns the value or the error of a result, and changes a text in
// one place.

#include <cstddef>
#include <string>
#include <utility>

#include "clothctl/core/result.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Returns the value of a result. If there is none, the test ends and shows the error.
template <class T>
T value_of(clothctl::Result<T> result) {
  INFO((result ? std::string() : result.error()));
  REQUIRE(result.has_value());
  return std::move(result).value();
}

/// Returns the error of a result, or "accepted" if it has a value.
template <class T>
std::string refusal_of(const clothctl::Result<T>& result) {
  return result ? "accepted" : result.error();
}

/// Replaces the first `from` in a text. The text must contain it.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  REQUIRE(place != std::string::npos);
  return text.replace(place, from.size(), to);
}

}  // namespace clothctl_test
