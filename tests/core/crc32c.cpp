#include "clothctl/core/detail/crc32c.hpp"

#include <random>
#include <string_view>
#include <vector>

#include "support/catch.hpp"

using clothctl::detail::crc32c;

namespace {

/// The remainder by definition, bit by bit.
std::uint32_t slow_crc32c(std::span<const std::byte> bytes) {
  std::uint32_t crc = 0xffffffffu;
  for (const std::byte byte : bytes) {
    crc ^= std::to_integer<std::uint32_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1u) != 0 ? (crc >> 1) ^ 0x82f63b78u : crc >> 1;
  }
  return ~crc;
}

std::uint32_t of(std::string_view text) {
  return crc32c(std::as_bytes(std::span<const char>(text.data(), text.size())));
}

}  // namespace

TEST_CASE("crc32c has the published check values", "[core]") {
  CHECK(of("123456789") == 0xe3069283u);
  CHECK(of("") == 0u);
  // RFC 3720, B.4: 32 bytes of zeros, of ones, ascending.
  std::vector<std::byte> bytes(32, std::byte(0));
  CHECK(crc32c(bytes) == 0x8a9136aau);
  bytes.assign(32, std::byte(0xff));
  CHECK(crc32c(bytes) == 0x62a8ab43u);
  for (std::size_t i = 0; i < 32; ++i) bytes[i] = static_cast<std::byte>(i);
  CHECK(crc32c(bytes) == 0x46dd794eu);
}

TEST_CASE("crc32c by tables is the remainder by definition at every length", "[core]") {
  std::mt19937 random(7);
  std::vector<std::byte> bytes;
  for (std::size_t length = 0; length < 100; ++length) {
    CHECK(crc32c(bytes) == slow_crc32c(bytes));
    bytes.push_back(static_cast<std::byte>(random() & 255u));
  }
}

TEST_CASE("crc32c notices every burst of up to 32 bits", "[core]") {
  std::vector<std::byte> bytes(40, std::byte(0x5a));
  const std::uint32_t whole = crc32c(bytes);
  std::mt19937 random(11);
  for (std::size_t first = 0; first + 5 <= bytes.size(); ++first) {
    for (int trial = 0; trial < 50; ++trial) {
      std::vector<std::byte> spoilt = bytes;
      const std::uint64_t burst = (static_cast<std::uint64_t>(random()) | 1u)
                                  << (random() % 8u);  // at most 39 bits wide
      for (std::size_t k = 0; k < 5; ++k)
        spoilt[first + k] ^= static_cast<std::byte>((burst >> (8 * k)) & 255u);
      CHECK(crc32c(spoilt) != whole);
    }
  }
}
