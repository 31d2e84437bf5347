#pragma once

// Set-up from outside data answers with a value or with an error that names the offending item. No exceptions.

#include <cassert>
#include <string>
#include <utility>
#include <variant>

namespace clothctl {

/// Why set-up refused its data: one line that names what, where and which value.
struct Error {
  /// The line, without a full stop or a newline at its end.
  std::string message;
};

/// A value of type T or an Error. Ask `has_value()` (or test it as a bool) before taking the value.
template <class T>
class [[nodiscard]] Result {
 public:
  /// Holds a value.
  Result(T value) : content_(std::move(value)) {}
  /// Holds an error.
  Result(Error error) : content_(std::move(error)) {}

  /// Tells whether a value is held.
  bool has_value() const { return content_.index() == 0; }
  /// Tells whether a value is held.
  explicit operator bool() const { return has_value(); }
  /// The value. Fails when: an error is held (assert).
  T& value() & {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  /// The value. Fails when: an error is held (assert).
  const T& value() const& {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  /// The value, moved out. Fails when: an error is held (assert).
  T&& value() && {
    assert(has_value());
    return std::move(*std::get_if<0>(&content_));
  }
  /// The value. Fails when: an error is held (assert).
  T& operator*() & { return value(); }
  /// The value. Fails when: an error is held (assert).
  const T& operator*() const& { return value(); }
  /// The value's member. Fails when: an error is held (assert).
  T* operator->() { return &value(); }
  /// The value's member. Fails when: an error is held (assert).
  const T* operator->() const { return &value(); }
  /// The error's line. Fails when: a value is held (assert).
  const std::string& error() const {
    assert(!has_value());
    return std::get_if<1>(&content_)->message;
  }

 private:
  std::variant<T, Error> content_;
};

}  // namespace clothctl
