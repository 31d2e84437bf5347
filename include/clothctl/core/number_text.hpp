#pragma once

// Numbers as text, for error lines.

#include <cstdio>
#include <string>

#include "clothctl/core/scalar.hpp"

namespace clothctl {

namespace detail {

/// Writes a number for an error line; a scalar that has no conversion to double is written as "?".
template <RealScalar Scalar>
std::string number_text(const Scalar& value) {
  if constexpr (requires { static_cast<double>(value); }) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", static_cast<double>(value));
    return text;
  } else {
    return "?";
  }
}

}  // namespace detail

}  // namespace clothctl
