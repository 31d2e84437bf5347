// Base64: the examples of RFC 4648, a round trip, and refused text.

#include "clothctl/io/detail/base64.hpp"

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "support/catch.hpp"

namespace {

std::string encoded(const std::string& text) {
  return clothctl::detail::encode_base64(std::vector<std::uint8_t>(text.begin(), text.end()));
}

}  // namespace

TEST_CASE("encoding reproduces the examples of RFC 4648", "[base64]") {
  CHECK(encoded("") == "");
  CHECK(encoded("f") == "Zg==");
  CHECK(encoded("fo") == "Zm8=");
  CHECK(encoded("foo") == "Zm9v");
  CHECK(encoded("foob") == "Zm9vYg==");
  CHECK(encoded("fooba") == "Zm9vYmE=");
  CHECK(encoded("foobar") == "Zm9vYmFy");
}

TEST_CASE("decoding inverts encoding for every length and byte", "[base64]") {
  std::mt19937 engine(3);
  std::uniform_int_distribution<int> byte(0, 255);
  for (std::size_t length = 0; length < 300; ++length) {
    std::vector<std::uint8_t> bytes(length);
    for (std::uint8_t& b : bytes) b = static_cast<std::uint8_t>(byte(engine));
    const auto back = clothctl::detail::decode_base64(clothctl::detail::encode_base64(bytes));
    REQUIRE(back.has_value());
    CHECK(*back == bytes);
  }
}

TEST_CASE("text that is not base64 is refused", "[base64]") {
  CHECK(clothctl::detail::decode_base64("Zg=").error() == "base64: length 3 is no multiple of 4");
  CHECK(clothctl::detail::decode_base64("Z g=").error() == "base64: foreign letter at position 1");
  CHECK(clothctl::detail::decode_base64("Zm=v").error() == "base64: foreign letter at position 2");
  CHECK(!clothctl::detail::decode_base64("====").has_value());
  CHECK(!clothctl::detail::decode_base64("Zg==Zg==").has_value());
  CHECK(!clothctl::detail::decode_base64("Zg-_").has_value());
}
