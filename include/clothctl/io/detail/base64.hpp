#pragma once

// Base64 (RFC 4648, with padding): three bytes become four letters of an alphabet that is safe
// inside a web page.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

inline constexpr std::string_view kBase64Letters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Appends the encoding of `bytes` to `text`. Allocates. Complexity: O(bytes).
inline void append_base64(std::span<const std::uint8_t> bytes, std::string& text) {
  text.reserve(text.size() + (bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = bytes.size() - i;
    const std::uint32_t word = (std::uint32_t(bytes[i]) << 16) |
                               (left > 1 ? std::uint32_t(bytes[i + 1]) << 8 : 0u) |
                               (left > 2 ? std::uint32_t(bytes[i + 2]) : 0u);
    text += kBase64Letters[word >> 18];
    text += kBase64Letters[(word >> 12) & 63u];
    text += left > 1 ? kBase64Letters[(word >> 6) & 63u] : '=';
    text += left > 2 ? kBase64Letters[word & 63u] : '=';
  }
}

/// Returns the encoding of `bytes`. Allocates. Complexity: O(bytes).
inline std::string encode_base64(std::span<const std::uint8_t> bytes) {
  std::string text;
  append_base64(bytes, text);
  return text;
}

/// Returns the bytes that `text` encodes. Allocates. Complexity: O(length). Fails when: the length
/// is not a multiple of four, a character is not in the alphabet (a space, for example), or padding
/// occurs before the end.
inline Result<std::vector<std::uint8_t>> decode_base64(std::string_view text) {
  if (text.size() % 4 != 0)
    return Error{"base64: length " + std::to_string(text.size()) + " is no multiple of 4"};
  std::array<std::int8_t, 256> value{};
  value.fill(-1);
  for (std::size_t i = 0; i < 64; ++i) {
    value[static_cast<unsigned char>(kBase64Letters[i])] = static_cast<std::int8_t>(i);
  }
  std::size_t padding = 0;
  while (padding < 2 && padding < text.size() && text[text.size() - 1 - padding] == '=') ++padding;
  std::vector<std::uint8_t> bytes;
  bytes.reserve(text.size() / 4 * 3);
  std::uint32_t word = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const int digit = i + padding < text.size() ? value[static_cast<unsigned char>(text[i])] : 0;
    if (digit < 0) return Error{"base64: foreign letter at position " + std::to_string(i)};
    word = (word << 6) | static_cast<std::uint32_t>(digit);
    if (i % 4 != 3) continue;
    for (int shift = 16; shift >= 0; shift -= 8)
      bytes.push_back(static_cast<std::uint8_t>((word >> shift) & 255u));
    word = 0;
  }
  for (; padding > 0; --padding) bytes.pop_back();
  return bytes;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
