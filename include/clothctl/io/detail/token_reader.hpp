#pragma once

// Splits text into tokens at white space, and keeps the line of each for messages. Functions return
// true on success; the first error is kept as one line `file:line: section: what is wrong`.

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Reads tokens, integers and real numbers. `what` names the item in messages.
class TokenReader {
 public:
  TokenReader(std::string_view text, std::string name) : text_(text), file_(std::move(name)) {}

  /// Stores the error unless one is stored already. Returns false.
  bool fail(const std::string& what) {
    if (error_.empty()) error_ = at_line(file_, token_line_) + what;
    return false;
  }

  /// Reads the next token. If the text ends, the message names the section `where`.
  bool next(std::string_view& token, const std::string& where) {
    if (!skip_blank())
      return fail("the file ends in section " + in_quotes(where) + ", without 'end'");
    const std::size_t last = (std::min)(text_.find_first_of(kBlank, place_), text_.size());
    token = text_.substr(place_, last - place_);
    place_ = last;
    return true;
  }

  /// Reads an integer from `least` to `most`.
  bool count(const std::string& what, Index least, Index most, Index& value) {
    std::string_view token;
    if (!next(token, what)) return false;
    const std::from_chars_result end =
        std::from_chars(token.data(), token.data() + token.size(), value);
    if (end.ptr != token.data() + token.size() || end.ec == std::errc::invalid_argument)
      return fail(what + ": " + in_quotes(token) + " is not a whole number");
    if (end.ec == std::errc() && least <= value && value <= most) return true;
    return fail(what + ": " + in_quotes(token) + " is not " + bounds(least, most));
  }

  /// Returns the range in words, for messages.
  static std::string bounds(Index least, Index most) {
    if (most < least) return "possible where there is nothing to index";
    if (most == least) return std::to_string(least);
    return "within " + std::to_string(least) + " to " + std::to_string(most);
  }

  /// Reads a number. With `open`, it may be infinite.
  bool number(const std::string& what, double& value, bool open = false) {
    std::string_view token;
    if (!next(token, what)) return false;
    if (open && parse_infinity(token, "inf", value)) return true;
    const std::string wrong = parse_number(token, value);
    return wrong.empty() || fail(what + ": " + wrong);
  }

  bool word(const std::string& what, std::string& value) {
    std::string_view token;
    if (!next(token, what)) return false;
    value = std::string(token);
    return true;
  }

  /// Returns true when only white space is left; else fails and names the next token. `after`: what
  /// was read last, for the message.
  bool at_end(const std::string& after) {
    if (!skip_blank()) return true;
    const std::string_view rest = text_.substr(place_);
    return fail(in_quotes(rest.substr(0, rest.find_first_of(kBlank))) + " after " +
                in_quotes(after));
  }

  /// Returns the line number of the last token, counted from 1.
  Index line() const { return token_line_; }
  /// The first error, or "".
  const std::string& error() const { return error_; }

 private:
  static constexpr std::string_view kBlank = " \t\r\v\f\n";

  /// Moves to the next token. Returns false where there is none.
  bool skip_blank() {
    for (; place_ < text_.size() && kBlank.find(text_[place_]) != std::string_view::npos;
         ++place_) {
      if (text_[place_] == '\n') ++line_;
    }
    token_line_ = line_;
    return place_ < text_.size();
  }

  std::string_view text_;
  std::string file_, error_;
  std::size_t place_ = 0;
  Index line_ = 1, token_line_ = 1;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
