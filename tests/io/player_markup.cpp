// The markup of the player page: well-formed, without outside requests, and consistent with the
// scripts and the style sheet.

#include "clothctl/io/detail/player_markup.hpp"

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl_test::all_matches;
using clothctl_test::distinct_matches;
using namespace clothctl::detail;

namespace {

const std::string kBody = kPlayerBody;

}  // namespace

TEST_CASE("the markup makes no outside request", "[player_markup]") {
  std::string head = kPlayerHead;
  const std::string svg = "xmlns='http://www.w3.org/2000/svg'";  // a name, which nobody fetches
  const std::size_t at = head.find(svg);
  REQUIRE(at != std::string::npos);
  head.erase(at, svg.size());
  clothctl_test::check_stays_inside(head);
  clothctl_test::check_stays_inside(kBody);
  CHECK(all_matches(head + kBody, "href=\"(?!data:)([^\"]*)").empty());
  CHECK(all_matches(head + kBody, "\\s(on[a-z]+|style)=").empty());
}

TEST_CASE("the content policy precedes everything it applies to and names no host",
          "[player_markup]") {
  const std::string head = kPlayerHead;
  const std::vector<std::string> policy =
      all_matches(head, "Content-Security-Policy\"\\s+content=\"([^\"]*)\"");
  REQUIRE(policy.size() == 1);
  CHECK(policy[0].rfind("default-src 'none';", 0) == 0);
  CHECK(all_matches(policy[0], "([a-z]+-src) ") ==
        std::vector<std::string>{"default-src", "style-src", "script-src", "img-src"});
  CHECK(policy[0].find_first_of("*/.") == std::string::npos);
  CHECK(head.find("Content-Security-Policy") < head.find("<link"));
  CHECK(head.find("charset=\"utf-8\"") < 120);
  CHECK(head.substr(head.size() - 7) == "<title>");
}

TEST_CASE("every id that the scripts use exists once, and every id is used", "[player_markup]") {
  const std::vector<std::string> ids = all_matches(kBody, "\\sid=\"([^\"]*)\"");
  const std::set<std::string> known(ids.begin(), ids.end());
  CHECK(known.size() == ids.size());
  std::set<std::string> wanted =
      distinct_matches(clothctl_test::all_scripts(), "\\$\\('([^']*)'\\)");
  CHECK(wanted.erase("scene") == 1);  // the element of the data
  CHECK(wanted.size() > 25);
  std::vector<std::string> missing, unused;
  std::set_difference(wanted.begin(), wanted.end(), known.begin(), known.end(),
                      std::back_inserter(missing));
  std::set_difference(known.begin(), known.end(), wanted.begin(), wanted.end(),
                      std::back_inserter(unused));
  CHECK(missing == std::vector<std::string>{});
  CHECK(unused == std::vector<std::string>{});
}

TEST_CASE("every class in markup and scripts has a style", "[player_markup]") {
  std::set<std::string> used;
  for (const std::string& list :
       all_matches(kBody + clothctl_test::all_scripts(), "class(?:Name)?(?:=| = )[\"']([^\"']*)")) {
    for (const std::string& name : all_matches(list, "([^ ]+)")) used.insert(name);
  }
  CHECK(used.size() > 20);
  const std::set<std::string> styled = distinct_matches(
      clothctl_test::joined({kPlayerStyle, kPlayerStyleNarrow}), "\\.([a-z][a-z-]*)(?=[^;}]*\\{)");
  for (const std::string& name : used) {
    INFO(name);
    CHECK(styled.count(name) == 1);
  }
}

TEST_CASE("tags match, and all controls have accessible names", "[player_markup]") {
  // Reading the page checks that tags match.
  clothctl_test::check_in_page(clothctl_test::page_of(), R"js(
const tagged = name => elements.filter(e => e.tagName === name);
for (const button of tagged('BUTTON')) {
  check('type of ' + button.attributes.title, button.attributes.type === 'button');
  check('name of ' + button.id,
    Boolean(button.textContent.trim() || button.attributes['aria-label']));
}
for (const e of [...tagged('INPUT'), ...tagged('SELECT'), ...tagged('CANVAS')]) {
  check('name of ' + e.id, Boolean(e.attributes['aria-label']));
}
for (const e of tagged('svg')) {
  check('drawings are hidden from screen readers', e.attributes['aria-hidden'] === 'true');
}
check('one heading and one main element', tagged('H1').length === 1 && tagged('MAIN').length === 1);
check('language', document.documentElement.attributes.lang === 'en');
check('a theme from the start', document.documentElement.dataset.theme === 'light');
)js");
}

TEST_CASE("buttons of views name presets, and marks of the axes name axes", "[player_markup]") {
  const std::set<std::string> views = distinct_matches(kBody, "data-view=\"([^\"]*)\"");
  const std::string presets =
      all_matches(kPlayerGeometryScript, "const presets = \\{([^}]*)\\}").at(0);
  CHECK(views == distinct_matches(presets, "([a-z]+): \\["));
  CHECK(all_matches(kBody, "<line data-axis=\"([^\"]*)\"") ==
        std::vector<std::string>{"0", "1", "2"});
  CHECK(all_matches(kBody, "<text data-axis=\"([^\"]*)\"") ==
        std::vector<std::string>{"0", "1", "2"});
}
