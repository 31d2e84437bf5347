#pragma once

// Numbers as text, for files and error messages. The text is the same in every locale.

#include <array>
#include <charconv>
#include <concepts>
#include <string>
#include <string_view>

#include "clothctl/core/scalar.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns `value` with the fewest digits that read back as the same number of its type. Values
/// that are not finite become "nan", "inf" or "-inf". A foreign scalar is converted to double
/// first; it becomes "?" when it has no such conversion. Allocates when the text is long.
template <RealScalar Scalar>
std::string number_text(const Scalar& value) {
  if constexpr (std::floating_point<Scalar>) {
    std::array<char, 64> text{};
    const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
    const std::string_view written(text.data(), static_cast<std::size_t>(end.ptr - text.data()));
    return std::string(written.ends_with("nan") ? "nan"
                                                : written);  // the sign of a NaN has no meaning
  } else if constexpr (requires { static_cast<double>(value); }) {
    return number_text(static_cast<double>(value));
  } else {
    return "?";
  }
}

/// Returns `value` with at most four digits, for measured quantities in messages: 0.0123, 1.5e-07.
/// Else as `number_text`. Allocates when the text is long.
template <RealScalar Scalar>
std::string rounded_text(const Scalar& value) {
  if constexpr (std::floating_point<Scalar>) {
    if (!is_finite(value)) return number_text(value);
    std::array<char, 32> text{};
    const std::to_chars_result end =
        std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 4);
    return std::string(text.data(), static_cast<std::size_t>(end.ptr - text.data()));
  } else if constexpr (requires { static_cast<double>(value); }) {
    return rounded_text(static_cast<double>(value));
  } else {
    return "?";
  }
}

/// Returns "NAME PROBLEM: VALUE", a message about a bad number. Allocates.
template <RealScalar Scalar>
std::string bad_number_line(const std::string& name, const std::string& problem,
                            const Scalar& value) {
  return name + ' ' + problem + ": " + number_text(value);
}

namespace detail {

/// Returns ", at most 1e20" for a number that is finite and yet counts as no bound (see
/// `is_unbounded`), else "": the end of a message that says "must be finite".
template <RealScalar Scalar>
std::string unbounded_text(const Scalar& value) {
  return is_finite(value) && is_unbounded(value) ? ", at most 1e20" : "";
}

}  // namespace detail

/// Returns "no ITEM NUMBER (there are COUNT)", a message about a number that nothing has.
/// Allocates.
inline std::string missing_item_line(const std::string& item, long long number, long long count) {
  return "no " + item + ' ' + std::to_string(number) + " (there are " + std::to_string(count) + ')';
}

}  // namespace clothctl::inline CLOTHCTL_ABI
