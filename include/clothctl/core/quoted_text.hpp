#pragma once

// Names from outside data inside error messages. A message is one line, so line breaks and quotes
// in a name are escaped.

#include <string>
#include <string_view>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns `text` in double quotes, for a message of one line. Quotes and backslashes get a
/// backslash in front; a line break becomes \n, a tab \t, any other control character \x and two
/// hexadecimal digits. Only the first 80 bytes are shown, and "..." marks that there are more.
/// Bytes from 0x80 on (UTF-8) pass unchanged. Allocates.
inline std::string quoted_text(std::string_view text) {
  constexpr std::size_t kLongest = 80;
  constexpr std::string_view kDigits = "0123456789abcdef";
  const bool cut = text.size() > kLongest;
  if (cut) {
    std::size_t length = kLongest;  // do not cut a UTF-8 character in two
    while (length > kLongest - 4 && (static_cast<unsigned char>(text[length]) & 0xc0u) == 0x80)
      --length;
    text = text.substr(0, length);
  }
  std::string out = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '\n') {
      out += "\\n";
    } else if (c == '\t') {
      out += "\\t";
    } else if (byte < 0x20 || byte == 0x7f) {
      out += "\\x";
      out += kDigits[byte >> 4];
      out += kDigits[byte & 15u];
    } else {
      out += c;
    }
  }
  out += cut ? "...\"" : "\"";
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
