#pragma once

// Escapes text for a page: as the content of an element, and as a JSON string in a <script>
// element.

#include <cstddef>
#include <string>
#include <string_view>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the length (1 to 4) of the well-formed UTF-8 sequence at the beginning of `text`, or 0
/// if there is none.
inline std::size_t utf8_length(std::string_view text) {
  const auto byte = [text](std::size_t i) {
    return static_cast<unsigned>(static_cast<unsigned char>(text[i]));
  };
  if (text.empty()) return 0;
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xc2 && first <= 0xdf   ? 2
                             : first >= 0xe0 && first <= 0xef ? 3
                             : first >= 0xf0 && first <= 0xf4 ? 4
                                                              : 0;
  if (length == 0 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0u) != 0x80) return 0;
  }
  // Overlong forms, surrogates and values beyond the last code point are not well formed.
  if ((first == 0xe0 && byte(1) < 0xa0) || (first == 0xed && byte(1) > 0x9f)) return 0;
  if ((first == 0xf0 && byte(1) < 0x90) || (first == 0xf4 && byte(1) > 0x8f)) return 0;
  return length;
}

/// Calls `emit` with each character of `text` as UTF-8. A byte that is not part of well-formed
/// UTF-8 becomes the replacement character.
template <class Emit>
void for_each_character(std::string_view text, Emit&& visit) {
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    visit(length == 0 ? std::string_view("\xef\xbf\xbd") : text.substr(0, length));
    text.remove_prefix(length == 0 ? 1 : length);
  }
}

/// Appends `text` as the content of an element. Control characters become spaces.
inline void append_html(std::string_view text, std::string& out) {
  for_each_character(text, [&out](std::string_view c) {
    switch (c[0]) {
      case '&': out += "&amp;"; return;
      case '<': out += "&lt;"; return;
      case '>': out += "&gt;"; return;
      case '"': out += "&quot;"; return;
      default: break;
    }
    if (c.size() == 1 && (static_cast<unsigned char>(c[0]) < 0x20 || c[0] == 0x7f)) {
      out += ' ';
    } else {
      out += c;
    }
  });
}

/// Appends `text` as a JSON string. It escapes `<`, `>` and `&`, so that the text cannot end the
/// <script> element around it.
inline void append_json(std::string_view text, std::string& out) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  out += '"';
  for_each_character(text, [&out, kDigits](std::string_view c) {
    const auto first = static_cast<unsigned char>(c[0]);
    if (c == "\"" || c == "\\") {
      out += '\\';
      out += c;
    } else if (c.size() == 1 && (first < 0x20 || c == "<" || c == ">" || c == "&")) {
      out += "\\u00";
      out += kDigits[first >> 4];
      out += kDigits[first & 15u];
    } else {
      out += c;
    }
  });
  out += '"';
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
