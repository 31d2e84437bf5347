// Tokens between white space: their text and line, accepted numbers, and messages about the others.

#include "clothctl/io/detail/token_reader.hpp"

#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "support/catch.hpp"

using clothctl::Index;
using clothctl::detail::TokenReader;
using namespace std::string_literals;

namespace {

/// Returns the message when `text` is read as a whole number.
std::string count_refusal(const std::string& text, Index least, Index most) {
  TokenReader reader(text, "f");
  Index value = 0;
  return reader.count("size", least, most, value) ? "accepted" : reader.error();
}

Index counted(const std::string& text, Index least, Index most) {
  TokenReader reader(text, "f");
  Index value = -77;
  INFO(text);
  REQUIRE(reader.count("size", least, most, value));
  return value;
}

std::string number_refusal(const std::string& text, bool open) {
  TokenReader reader(text, "f");
  double value = 0;
  return reader.number("weight", value, open) ? "accepted" : reader.error();
}

double number(const std::string& text, bool open) {
  TokenReader reader(text, "f");
  double value = -77;
  INFO(text);
  REQUIRE(reader.number("weight", value, open));
  return value;
}

}  // namespace

TEST_CASE("tokens are separated by any white space and know their line", "[token_reader]") {
  TokenReader reader(" \r\n one\ttwo\n\n\vthree\f\r\nfo-ur,5\n", "f");
  std::string_view token;
  const std::vector<std::pair<std::string, Index>> expected{
      {"one", 2}, {"two", 2}, {"three", 4}, {"fo-ur,5", 5}};
  CHECK(reader.line() == 1);
  for (const auto& [text, line] : expected) {
    REQUIRE(reader.next(token, "here"));
    CHECK(token == text);
    CHECK(reader.line() == line);
  }
  CHECK(reader.error().empty());
  CHECK_FALSE(reader.next(token, "here"));
  CHECK(reader.error() == "f:6: the file ends in section 'here', without 'end'");
}

TEST_CASE("a token may contain any byte but white space, and may end with the text",
          "[token_reader]") {
  const std::string text = "a\0b \xff\xfe\x01 last"s;
  TokenReader reader(text, "f");
  std::string_view token;
  for (const std::string& expected : {"a\0b"s, "\xff\xfe\x01"s, "last"s}) {
    REQUIRE(reader.next(token, "here"));
    CHECK(token == expected);
  }
  CHECK(reader.at_end("last"));
}

TEST_CASE("an empty text ends in its first line", "[token_reader]") {
  for (const std::string text : {"", " \t"}) {
    TokenReader reader(text, "f");
    std::string_view token = "as it was";
    CHECK_FALSE(reader.next(token, "the head"));
    CHECK(token == "as it was");
    CHECK(reader.line() == 1);
    CHECK(reader.error() == "f:1: the file ends in section 'the head', without 'end'");
  }
}

TEST_CASE("the first error is kept with the line of its token", "[token_reader]") {
  TokenReader reader("one\ntwo three", "dir/file.qpt");
  std::string_view token;
  REQUIRE(reader.next(token, "here"));
  REQUIRE(reader.next(token, "here"));
  CHECK_FALSE(reader.fail("H: 'two' is odd"));
  CHECK(reader.error() == "dir/file.qpt:2: H: 'two' is odd");
  CHECK_FALSE(reader.fail("something else"));
  REQUIRE(reader.next(token, "here"));
  CHECK_FALSE(reader.next(token, "here"));
  CHECK(reader.error() == "dir/file.qpt:2: H: 'two' is odd");
}

TEST_CASE("whole numbers within the range are accepted", "[token_reader]") {
  CHECK(counted("3", 3, 5) == 3);
  CHECK(counted("5", 3, 5) == 5);
  CHECK(counted("-4\n", -4, 0) == -4);
  CHECK(counted(" 007", 0, 7) == 7);
  CHECK(counted("0", 0, 0) == 0);
  const Index largest = std::numeric_limits<Index>::max(),
              smallest = std::numeric_limits<Index>::min();
  CHECK(counted(std::to_string(largest), smallest, largest) == largest);
  CHECK(counted(std::to_string(smallest), smallest, largest) == smallest);
  CHECK(count_refusal("2", 3, 5) == "f:1: size: '2' is not within 3 to 5");
  CHECK(count_refusal("\n6", 3, 5) == "f:2: size: '6' is not within 3 to 5");
  CHECK(count_refusal("-1", 0, 5) == "f:1: size: '-1' is not within 0 to 5");
  CHECK(count_refusal("1", 4, 4) == "f:1: size: '1' is not 4");
  CHECK(count_refusal("0", 0, -1) ==
        "f:1: size: '0' is not possible where there is nothing to index");
}

TEST_CASE("whole numbers too large for any integer are reported as out of range",
          "[token_reader]") {
  const Index largest = std::numeric_limits<Index>::max(),
              smallest = std::numeric_limits<Index>::min();
  for (const std::string text :
       {"9223372036854775808", "-9223372036854775809", "99999999999999999999999999999999"}) {
    const std::string range =
        "within " + std::to_string(smallest) + " to " + std::to_string(largest);
    CHECK(count_refusal(text, smallest, largest) == "f:1: size: '" + text + "' is not " + range);
    CHECK(count_refusal(text + "x", smallest, largest) ==
          "f:1: size: '" + text + "x' is not a whole number");
  }
}

TEST_CASE("text that is not a whole number is refused with a message", "[token_reader]") {
  for (const std::string text :
       {"x", "2.5", "2.", "1e3", "0x10", "+3", "--3", "-", "3,", "3;4", "inf", "nan"})
    CHECK(count_refusal(text, -1000, 1000) == "f:1: size: '" + text + "' is not a whole number");
  CHECK(count_refusal("", 0, 5) == "f:1: the file ends in section 'size', without 'end'");
  CHECK(count_refusal("3\0"s, 0, 5) == "f:1: size: '3?' is not a whole number");
}

TEST_CASE("ranges are described in words", "[token_reader]") {
  CHECK(TokenReader::bounds(-2, 7) == "within -2 to 7");
  CHECK(TokenReader::bounds(0, 1) == "within 0 to 1");
  CHECK(TokenReader::bounds(7, 7) == "7");
  CHECK(TokenReader::bounds(0, -1) == "possible where there is nothing to index");
}

TEST_CASE("numbers are read in any notation", "[token_reader]") {
  for (const bool open : {false, true}) {
    CHECK(number("2.5", open) == 2.5);
    CHECK(number(" +4\n", open) == 4);
    CHECK(number("-1e-3", open) == -0.001);
    CHECK(number(".5", open) == 0.5);
    CHECK(number("1E300", open) == 1e300);
    for (const std::string text :
         {"x", "1,5", "1.5m", "0x1p3", "+-1", "-", "1e", "infi", "+-inf", "--inf", "- inf"}) {
      const std::string token = text.substr(0, text.find(' '));
      CHECK(number_refusal(text, open) == "f:1: weight: '" + token + "' is not a number");
    }
    CHECK(number_refusal("nan", open) == "f:1: weight: 'nan' is not finite");
    CHECK(number_refusal("\n\n-1e999", open) ==
          "f:3: weight: '-1e999' is out of the range of a double");
    CHECK(number_refusal(" ", open) == "f:1: the file ends in section 'weight', without 'end'");
  }
}

TEST_CASE("numbers may be infinite only where that is allowed, and only as inf", "[token_reader]") {
  const double infinity = clothctl::scalar_traits<double>::infinity();
  CHECK(number("inf", true) == infinity);
  CHECK(number("+inf", true) == infinity);
  CHECK(number("-inf", true) == -infinity);
  for (const std::string text : {"inf", "-inf"})
    CHECK(number_refusal(text, false) == "f:1: weight: '" + text + "' is not finite");
  for (const std::string text : {"Inf", "INF", "infinity", "-infinity"})
    CHECK(number_refusal(text, true) == "f:1: weight: '" + text + "' is not finite");
}

TEST_CASE("numbers are read one after the other", "[token_reader]") {
  TokenReader reader("3 0.5\n-inf name", "f");
  Index count = 0;
  double value = 0, bound = 0;
  std::string name;
  CHECK(reader.count("a", 0, 9, count));
  CHECK(reader.number("b", value));
  CHECK(reader.number("c", bound, true));
  CHECK(reader.line() == 2);
  CHECK(reader.word("d", name));
  CHECK(count == 3);
  CHECK(value == 0.5);
  CHECK(bound == -clothctl::scalar_traits<double>::infinity());
  CHECK(name == "name");
  CHECK(reader.error().empty());
  CHECK_FALSE(reader.word("d", name));
  CHECK(name == "name");
  CHECK(reader.error() == "f:2: the file ends in section 'd', without 'end'");
}

TEST_CASE("text after the end is named", "[token_reader]") {
  const auto after_end = [](const std::string& rest) {
    const std::string text = "end" + rest;
    TokenReader reader(text, "f");
    std::string_view token;
    REQUIRE(reader.next(token, "here"));
    return reader.at_end("end") ? std::string("nothing") : reader.error();
  };
  CHECK(after_end("") == "nothing");
  CHECK(after_end(" \r\n\n\t") == "nothing");
  CHECK(after_end(" 7 8") == "f:1: '7' after 'end'");
  CHECK(after_end("\n\n seven") == "f:3: 'seven' after 'end'");
  CHECK(after_end(" \x01\x1b[31m x") == "f:1: '??[31m' after 'end'");
  CHECK(after_end(" "s + std::string(1000, 'y')) ==
        "f:1: '" + std::string(40, 'y') + "…' after 'end'");
}
