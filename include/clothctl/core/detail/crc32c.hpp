#pragma once

// CRC-32C (Castagnoli), the checksum of snapshots: the remainder of the bytes, read as a polynomial
// over the field of two elements, modulo
//
//   x³² + x²⁸ + x²⁷ + x²⁶ + x²⁵ + x²³ + x²² + x²⁰ + x¹⁹ + x¹⁸ + x¹⁴ + x¹³ + x¹¹ + x¹⁰ + x⁹ + x⁸ +
//   x⁶ + 1
//
// with reflected bits, the initial value and the final complement all ones. Two byte strings of one
// length that differ in one bit, or only within 32 consecutive bits, never have the same checksum.
// Eight tables serve eight bytes at a time: table k holds the effect of a byte that k more bytes
// follow.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {
namespace detail {

using Crc32cTables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr Crc32cTables make_crc32c_tables() {
  constexpr std::uint32_t kPolynomial = 0x82f63b78u;  // reflected, without x³²
  Crc32cTables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t value = byte;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ ((value & 1u) * kPolynomial);
    tables[0][byte] = value;
  }
  for (std::size_t k = 1; k < 8; ++k) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const std::uint32_t last = tables[k - 1][byte];
      tables[k][byte] = (last >> 8) ^ tables[0][last & 255u];
    }
  }
  return tables;
}

inline constexpr Crc32cTables kCrc32cTables = make_crc32c_tables();

/// Returns the CRC-32C of `bytes`. Complexity: O(bytes).
inline std::uint32_t crc32c(std::span<const std::byte> bytes) {
  const Crc32cTables& table = kCrc32cTables;
  std::uint32_t crc = 0xffffffffu;
  std::size_t i = 0;
  for (; i + 8 <= bytes.size(); i += 8) {
    std::uint32_t next = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::uint32_t low = (crc >> (8 * k)) & 255u;
      next ^= table[7 - k][low ^ std::to_integer<std::uint32_t>(bytes[i + k])];
      next ^= table[3 - k][std::to_integer<std::uint32_t>(bytes[i + 4 + k])];
    }
    crc = next;
  }
  for (; i < bytes.size(); ++i)
    crc = (crc >> 8) ^ table[0][(crc & 255u) ^ std::to_integer<std::uint32_t>(bytes[i])];
  return ~crc;
}

}  // namespace detail
}  // namespace clothctl::inline CLOTHCTL_ABI
