// The player's style sheet: well-formed, without outside requests, complete in both themes, and
// without unused rules.

#include "clothctl/io/detail/player_style.hpp"

#include <set>
#include <string>
#include <vector>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl_test::all_matches;
using clothctl_test::distinct_matches;
using namespace clothctl::detail;

namespace {

struct Rules {
  std::vector<std::string> selectors, at_rules, bodies;
  int depth = 0;  // number of open braces
};

/// Splits a style sheet at its braces.
Rules rules_of(const std::string& text) {
  Rules out;
  std::size_t begin = 0;
  for (std::size_t at = text.find_first_of("{}"); at != std::string::npos;
       at = text.find_first_of("{}", begin)) {
    std::string part = text.substr(begin, at - begin);
    part.erase(0, part.find_first_not_of(" \n"));
    begin = at + 1;
    if (text[at] == '{') {
      (part.rfind("@", 0) == 0 ? out.at_rules : out.selectors).push_back(part);
      ++out.depth;
    } else {
      if (!part.empty()) out.bodies.push_back(part);
      if (--out.depth < 0) return out;
    }
  }
  return out;
}

const std::string kStyle = std::string(kPlayerStyle) + kPlayerStyleNarrow;

std::set<std::string> variables_of(const std::string& selector) {
  const std::size_t at = kStyle.find(selector + " {");
  REQUIRE(at != std::string::npos);
  return distinct_matches(kStyle.substr(at, kStyle.find('}', at) - at), "(--[a-z-]+):");
}

}  // namespace

TEST_CASE("the style sheet makes no outside request and writes no markup", "[player_style]") {
  clothctl_test::check_stays_inside(kPlayerStyle);
  clothctl_test::check_stays_inside(kPlayerStyleNarrow);
}

TEST_CASE("each part of the style sheet has matching braces, selectors and declarations",
          "[player_style]") {
  for (const char* part : {kPlayerStyle, kPlayerStyleNarrow}) {
    const Rules rules = rules_of(part);
    CHECK(rules.depth == 0);
    CHECK(rules.selectors.size() == rules.bodies.size());
    for (const std::string& selector : rules.selectors) {
      INFO(selector);
      CHECK_FALSE(selector.empty());
      CHECK(selector.find(';') == std::string::npos);
    }
    for (const std::string& body : rules.bodies) {
      INFO(body);
      const std::string left =
          std::regex_replace(body, std::regex("\\s*[a-z-]+:\\s?[^:;]+;\\s*"), "");
      CHECK(left == "");
    }
    for (const std::string& rule : rules.at_rules) CHECK(rule.rfind("@media (", 0) == 0);
  }
}

TEST_CASE("both themes define every named colour, and no others", "[player_style]") {
  const std::set<std::string> light = variables_of(":root"),
                              dark = variables_of(":root[data-theme=\"dark\"]");
  CHECK(light == dark);
  std::set<std::string> used =
      distinct_matches(kStyle + clothctl_test::all_scripts(), "var\\((--[a-z-]+)\\)");
  used.merge(distinct_matches(clothctl_test::all_scripts(), "css\\('(--[a-z-]+)'\\)"));
  CHECK(used.erase("--fill") == 1);  // set by sliders
  CHECK(used == light);
}

TEST_CASE("colours that scripts read are plain hexadecimal in both themes", "[player_style]") {
  for (const std::string& name :
       distinct_matches(clothctl_test::all_scripts(), "rgb\\(css\\('(--[a-z-]+)'\\)\\)")) {
    INFO(name);
    CHECK(all_matches(kStyle, name + ": (#[0-9a-f]{6});").size() == 2);
  }
}

TEST_CASE("every class and id in a rule exists in the page", "[player_style]") {
  const std::string page = kPlayerBody + clothctl_test::all_scripts();
  std::set<std::string> classes;
  for (const std::string& list : all_matches(page, "class(?:Name)?(?:=| = )[\"']([^\"']*)")) {
    for (const std::string& name : all_matches(list, "([^ ]+)")) classes.insert(name);
  }
  int found = 0;
  for (const std::string& selector : rules_of(kStyle).selectors) {
    for (const std::string& name : all_matches(selector, "\\.([a-z][a-z-]*)")) {
      INFO(selector);
      CHECK(classes.count(name) == 1);
      ++found;
    }
    for (const std::string& id : all_matches(selector, "#([a-z][a-z-]*)")) {
      INFO(selector);
      CHECK(page.find(" id=\"" + id + "\"") != std::string::npos);
    }
  }
  CHECK(found > 50);
}

TEST_CASE("the page's grid has all its areas in wide and narrow windows", "[player_style]") {
  const std::set<std::string> areas = distinct_matches(kStyle, "grid-area: ([a-z]+);");
  CHECK(areas == std::set<std::string>{"head", "plot", "side", "stage"});
  for (const std::string& grid : all_matches(kStyle, "grid-template: ([^;]*);")) {
    std::set<std::string> named;
    for (const std::string& row : all_matches(grid, "\"([a-z ]+)\""))
      named.merge(distinct_matches(row, "([a-z]+)"));
    CHECK(named == areas);
  }
}
