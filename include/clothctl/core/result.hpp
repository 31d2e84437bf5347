#pragma once

// Set-up from outside data returns a value, or an error that names the offending item. Nothing
// throws.

#include <cassert>
#include <cstdlib>
#include <string>
#include <utility>
#include <variant>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Why set-up failed: one line that names the item, its index and the bad value.
struct Error {
  /// The line, without a full stop and without a line break.
  std::string message;
};

/// A value of type T or an Error. Test `has_value()` (or the result itself as a bool) before you
/// use the value. `value()` is checked in every build, `*` and `->` only where assertions are on.
template <class T>
class [[nodiscard]] Result {
 public:
  /// Holds a value.
  Result(T value) : content_(std::move(value)) {}
  /// Holds an error.
  Result(Error error) : content_(std::move(error)) {}

  /// Returns true when this holds a value, false when it holds an error.
  bool has_value() const { return content_.index() == 0; }
  /// Returns true when this holds a value, false when it holds an error.
  explicit operator bool() const { return has_value(); }
  /// Returns the value. Fails when: this holds an error; ends the program (abort).
  T& value() & {
    require_value();
    return **this;
  }
  /// Returns the value. Fails when: this holds an error; ends the program (abort).
  const T& value() const& {
    require_value();
    return **this;
  }
  /// Moves the value out. Fails when: this holds an error; ends the program (abort).
  T&& value() && {
    require_value();
    return std::move(**this);
  }
  /// Returns the value. Fails when: this holds an error (assert).
  T& operator*() & {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  /// Returns the value. Fails when: this holds an error (assert).
  const T& operator*() const& {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  /// Accesses a member of the value. Fails when: this holds an error (assert).
  T* operator->() { return &**this; }
  /// Accesses a member of the value. Fails when: this holds an error (assert).
  const T* operator->() const { return &**this; }
  /// Returns the message of the error. Fails when: this holds a value (assert).
  const std::string& error() const {
    assert(!has_value());
    return std::get_if<1>(&content_)->message;
  }

 private:
  void require_value() const {
    assert(has_value());
    if (!has_value()) std::abort();
  }

  std::variant<T, Error> content_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
