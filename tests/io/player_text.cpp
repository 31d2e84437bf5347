// Text inside a page: no text can end its element, and all output is well-formed UTF-8.

#include "clothctl/io/detail/player_text.hpp"

#include <random>
#include <string>

#include "support/catch.hpp"

namespace {

std::string html(const std::string& text) {
  std::string out;
  clothctl::detail::append_html(text, out);
  return out;
}

std::string json(const std::string& text) {
  std::string out;
  clothctl::detail::append_json(text, out);
  return out;
}

}  // namespace

TEST_CASE("markup is escaped", "[player_text]") {
  CHECK(html("</title><b a=\"1\">&amp;") == "&lt;/title&gt;&lt;b a=&quot;1&quot;&gt;&amp;amp;");
  CHECK(html("a\nb\x01"
             "c") == "a b c");
  CHECK(json("</script><!--&\"\\\n\x01") ==
        "\"\\u003c/script\\u003e\\u003c!--\\u0026\\\"\\\\\\u000a\\u0001\"");
}

TEST_CASE("well-formed UTF-8 passes and other bytes are replaced one by one", "[player_text]") {
  const std::string good = "ünïcödé – 日本 🧵 \xed\x9f\xbf\xee\x80\x80\xf4\x8f\xbf\xbf";
  CHECK(html(good) == good);
  CHECK(json(good) == "\"" + good + "\"");
  const std::string mark = "\xef\xbf\xbd";
  CHECK(html("\xff") == mark);
  CHECK(html("a\xc3") == "a" + mark);
  CHECK(html("\xc0\xaf") == mark + mark);                        // overlong
  CHECK(html("\xe0\x80\xaf") == mark + mark + mark);             // overlong
  CHECK(html("\xed\xa0\x80") == mark + mark + mark);             // surrogate
  CHECK(html("\xf4\x90\x80\x80") == mark + mark + mark + mark);  // beyond the last code point
  CHECK(html("\xe6\x97<") == mark + mark + "&lt;");
}

TEST_CASE("no sequence of bytes can end its element", "[player_text]") {
  std::mt19937 engine(4);
  std::uniform_int_distribution<int> byte(0, 255);
  for (int trial = 0; trial < 500; ++trial) {
    std::string text;
    for (int i = 0; i < 40; ++i) text += static_cast<char>(byte(engine));
    CHECK(html(text).find_first_of("<>\"") == std::string::npos);
    const std::string quoted = json(text);
    CHECK(quoted.find_first_of("<>&\n\r") == std::string::npos);
    CHECK(quoted.front() == '"');
    CHECK(quoted.back() == '"');
  }
}
