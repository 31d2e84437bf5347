#include "clothctl/core/quoted_text.hpp"

#include <string>

#include "support/catch.hpp"

using clothctl::quoted_text;

TEST_CASE("quoted_text puts a name in quotes") {
  CHECK(quoted_text("cotton") == "\"cotton\"");
  CHECK(quoted_text("") == "\"\"");
  CHECK(quoted_text("größe") == "\"größe\"");
}

TEST_CASE("quoted_text keeps a message on one line") {
  CHECK(quoted_text("two\nlines") == "\"two\\nlines\"");
  CHECK(quoted_text("a\tb\rc") == "\"a\\tb\\x0dc\"");
  CHECK(quoted_text(std::string_view("nul\0del\x7f", 8)) == "\"nul\\x00del\\x7f\"");
  for (int c = 0; c < 256; ++c) {
    const std::string shown = quoted_text(std::string(1, static_cast<char>(c)));
    INFO(c);
    CHECK(shown.find_first_of("\n\r\v\f") == std::string::npos);
  }
}

TEST_CASE("quoted_text escapes quotes and backslashes") {
  CHECK(quoted_text("say \"x\"") == "\"say \\\"x\\\"\"");
  CHECK(quoted_text("a\\n") == "\"a\\\\n\"");
}

TEST_CASE("quoted_text shows the beginning of a long name") {
  CHECK(quoted_text(std::string(80, 'a')) == "\"" + std::string(80, 'a') + "\"");
  CHECK(quoted_text(std::string(81, 'a')) == "\"" + std::string(80, 'a') + "...\"");
  // Two bytes for each character: byte 80 is in the middle of one.
  std::string wide = "a";
  for (int i = 0; i < 60; ++i) wide += "é";
  CHECK(quoted_text(wide) == "\"" + wide.substr(0, 79) + "...\"");
  CHECK(quoted_text(std::string(200, '\x80')).size() < 100);
}
