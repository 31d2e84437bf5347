// Fields of a QPS line: words in free form, columns in fixed form, optional fields, and messages
// about wrong ones.

#include "clothctl/io/detail/qps_fields.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "support/catch.hpp"

using clothctl::detail::qps_bound_has_value;
using clothctl::detail::qps_fixed_fields;
using clothctl::detail::qps_free_fields;
using clothctl::detail::QpsFields;
using clothctl::detail::QpsWords;

namespace {

using Splitter = std::string(const std::string&, std::string_view, QpsFields&);

/// The fields as one text (type, name, then each pair), or the error.
std::string fields(Splitter& split, const std::string& section, std::string_view line) {
  QpsFields f;
  if (const std::string wrong = split(section, line, f); !wrong.empty()) return wrong;
  std::string out = std::string(f.type) + "|" + std::string(f.name);
  for (std::size_t k = 0; k < f.pairs; ++k)
    out += "|" + std::string(f.key[k]) + "=" + std::string(f.value[k]);
  return out;
}
std::string free_fields(const std::string& section, std::string_view line) {
  return fields(qps_free_fields, section, line);
}
std::string fixed_fields(const std::string& section, std::string_view line) {
  return fields(qps_fixed_fields, section, line);
}

/// A line with texts starting at the given columns, where the first column is 1.
std::string line_of(const std::vector<std::pair<std::size_t, std::string>>& texts) {
  std::string line;
  for (const auto& [column, text] : texts) {
    if (line.size() + 1 < column) line.resize(column - 1, ' ');
    line.replace(column - 1, text.size(), text);
  }
  return line;
}

/// All fields of a bound and of two pairs in fixed form, each at its largest width.
const std::string kBound =
    line_of({{2, "UP"}, {5, "NAME5678"}, {15, "KEY45678"}, {25, "123456789012"}});
const std::string kPairs = line_of({{5, "NAME5678"},
                                    {15, "KEY45678"},
                                    {25, "123456789012"},
                                    {40, "SECOND78"},
                                    {50, "210987654321"}});

}  // namespace

TEST_CASE("a line's words are separated by blanks of any kind", "[qps_fields]") {
  const std::string line = " \tone  two\v3\fa,b\r";
  const QpsWords words(line);
  CHECK(words.count == 4);
  CHECK(words.word == std::array<std::string_view, 6>{"one", "two", "3", "a,b", "", ""});
  CHECK(words.word[0].data() == line.data() + 2);  // a view, not a copy
  CHECK(QpsWords("").count == 0);
  CHECK(QpsWords(" \t ").count == 0);
  CHECK(QpsWords("x").count == 1);
}

TEST_CASE("words after the sixth are counted but not kept", "[qps_fields]") {
  const QpsWords words("a b c d e f g h");
  CHECK(words.count == 8);
  CHECK(words.word == std::array<std::string_view, 6>{"a", "b", "c", "d", "e", "f"});
}

TEST_CASE("bounds that open a side have no number", "[qps_fields]") {
  for (const std::string_view type : {"FR", "MI", "PL"}) CHECK_FALSE(qps_bound_has_value(type));
  for (const std::string_view type : {"LO", "UP", "FX", "BV", "fr", "F", "FRX", ""})
    CHECK(qps_bound_has_value(type));
}

TEST_CASE("free form: rows have a type and a name", "[qps_fields]") {
  CHECK(free_fields("ROWS", " N  cost ") == "N|cost|=");
  CHECK(free_fields("ROWS", "\tE\trow1\t") == "E|row1|=");
  CHECK(free_fields("ROWS", " ") == "expected a type and a name, found 0 fields");
  CHECK(free_fields("ROWS", " cost") == "expected a type and a name, found 1 fields");
  CHECK(free_fields("ROWS", " N MY COST") == "expected a type and a name, found 3 fields");
}

TEST_CASE("free form: columns and matrix entries have a name and one or two pairs",
          "[qps_fields]") {
  for (const std::string section : {"COLUMNS", "QUADOBJ", "QMATRIX", "QSECTION"}) {
    CHECK(free_fields(section, " x r1 1.5") == "|x|r1=1.5");
    CHECK(free_fields(section, " x  r1  1.5  r2  -2 ") == "|x|r1=1.5|r2=-2");
    for (const auto& [line, count] : {std::pair<std::string, std::string>(" ", "0"),
                                      {" x", "1"},
                                      {" x r1", "2"},
                                      {" x r1 1 r2", "4"},
                                      {" x r1 1 r2 2 r3", "6"},
                                      {" x r1 1 r2 2 r3 3", "7"}}) {
      CHECK(free_fields(section, line) ==
            "expected a name, then one or two names with numbers, found " + count + " fields");
    }
  }
}

TEST_CASE("free form: right-hand sides and ranges may omit the name of the set", "[qps_fields]") {
  for (const std::string section : {"RHS", "RANGES"}) {
    CHECK(free_fields(section, " set r1 1") == "|set|r1=1");
    CHECK(free_fields(section, " set r1 1 r2 2") == "|set|r1=1|r2=2");
    CHECK(free_fields(section, " r1 1") == "||r1=1");
    CHECK(free_fields(section, " r1 1 r2 2") == "||r1=1|r2=2");
    for (const auto& [line, count] :
         {std::pair<std::string, std::string>(" ", "0"), {" r1", "1"}, {" set r1 1 r2 2 r3", "6"}})
      CHECK(free_fields(section, line) ==
            "expected a name, then one or two names with numbers, found " + count + " fields");
  }
}

TEST_CASE("free form: bounds may omit the name of the set and a number that is not needed",
          "[qps_fields]") {
  CHECK(free_fields("BOUNDS", " UP set x 4") == "UP|set|x=4");
  CHECK(free_fields("BOUNDS", " UP x 4") == "UP||x=4");
  CHECK(free_fields("BOUNDS", " FR set x") == "FR|set|x=");
  CHECK(free_fields("BOUNDS", " FR x") == "FR||x=");
  CHECK(free_fields("BOUNDS", " MI set x 0") == "MI|set|x=");
  CHECK(free_fields("BOUNDS", " XX set x 4") == "XX|set|x=4");  // the type is checked later
  const std::string expected = "expected a type, a set, a column and a value, found ";
  CHECK(free_fields("BOUNDS", " ") == expected + "0 fields");
  CHECK(free_fields("BOUNDS", " FR") == expected + "1 fields");
  CHECK(free_fields("BOUNDS", " UP x") == expected + "2 fields");
  CHECK(free_fields("BOUNDS", " UP set x 4 5") == expected + "5 fields");
  CHECK(free_fields("BOUNDS", " FR set x 0 0") == expected + "5 fields");
}

TEST_CASE("fixed form: fields fill their columns to the last", "[qps_fields]") {
  CHECK(fixed_fields("BOUNDS", kBound) == "UP|NAME5678|KEY45678=123456789012");
  CHECK(fixed_fields("COLUMNS", kPairs) == "|NAME5678|KEY45678=123456789012|SECOND78=210987654321");
  QpsFields f;
  REQUIRE(qps_fixed_fields("COLUMNS", kPairs, f).empty());
  CHECK(f.value[1].data() == kPairs.data() + 49);  // a view, not a copy
  CHECK(fixed_fields("RHS", line_of({{15, "KEY45678"}, {25, "1"}})) == "||KEY45678=1");
}

TEST_CASE("fixed form: blanks around fields are dropped, blanks within are kept", "[qps_fields]") {
  const std::string line =
      line_of({{5, " COL A"}, {15, "MY  ROW"}, {33, "-1.5"}, {41, "B  C"}, {61, "2"}});
  CHECK(fixed_fields("COLUMNS", line) == "|COL A|MY  ROW=-1.5|B  C=2");
  CHECK(fixed_fields("COLUMNS", line + std::string(30, ' ')) == "|COL A|MY  ROW=-1.5|B  C=2");
  for (const std::string section : {"ROWS", "BOUNDS"}) {
    CHECK(fixed_fields(section, line_of({{2, "N"}, {5, "MY COST"}})) == "N|MY COST|=");
    CHECK(fixed_fields(section, line_of({{3, "N"}, {5, "MY COST"}})) == "N|MY COST|=");
  }
}

TEST_CASE("fixed form: a second pair exists if either half of it does", "[qps_fields]") {
  const std::string one = line_of({{5, "X"}, {15, "R1"}, {25, "1"}});
  CHECK(fixed_fields("COLUMNS", one) == "|X|R1=1");
  CHECK(fixed_fields("COLUMNS", one + std::string(60, ' ')) == "|X|R1=1");
  CHECK(fixed_fields("COLUMNS", one + line_of({{15, "R2"}})) == "|X|R1=1|R2=");
  CHECK(fixed_fields("COLUMNS", one + line_of({{25, "2"}})) == "|X|R1=1|=2");
}

TEST_CASE("fixed form: text between the columns of the fields is refused", "[qps_fields]") {
  constexpr std::size_t kBetween[] = {1, 4, 13, 14, 23, 24, 37, 38, 39, 48, 49, 62, 80, 200};
  for (const std::size_t column : kBetween) {
    std::string line = kPairs;
    if (line.size() < column) line.resize(column, ' ');
    REQUIRE(line[column - 1] == ' ');
    line[column - 1] = '#';
    INFO("column " << column);
    CHECK(fixed_fields("COLUMNS", line) == "'#' stands between the columns of the fields");
    // Also if the line ends there.
    CHECK(fixed_fields("COLUMNS", line.substr(0, column)) ==
          "'#' stands between the columns of the fields");
  }
  CHECK(fixed_fields("COLUMNS", line_of({{5, "X"}, {36, "12345"}})) ==
        "'234' stands between the columns of the fields");
  const std::string tail(100, 'z');
  CHECK(fixed_fields("COLUMNS", kPairs + tail) ==
        "'" + tail.substr(0, 40) + "…' stands between the columns of the fields");
}

TEST_CASE("fixed form: a row ends with its name, a bound with its value", "[qps_fields]") {
  const std::string row = line_of({{2, "N"}, {5, "MY COST"}});
  CHECK(fixed_fields("ROWS", row + std::string(60, ' ')) == "N|MY COST|=");
  CHECK(fixed_fields("BOUNDS", kBound + std::string(60, ' ')) ==
        "UP|NAME5678|KEY45678=123456789012");
  constexpr std::size_t kFirst[] = {15, 25, 40, 50};
  const std::string range[] = {"15 to 22", "25 to 36", "40 to 47", "50 to 61"};
  for (std::size_t k = 0; k < 4; ++k) {
    const std::string more = line_of({{kFirst[k], "MORE"}});
    const std::string wrong = "'MORE' stands in columns " + range[k] + ", expected nothing there";
    CHECK(fixed_fields("ROWS", row + more.substr(row.size())) == wrong);
    if (k >= 2) CHECK(fixed_fields("BOUNDS", kBound + more.substr(kBound.size())) == wrong);
  }
  // As in free form, a bound that opens a side may have a number.
  CHECK(fixed_fields("BOUNDS", line_of({{2, "FR"}, {15, "X"}, {25, "0"}})) == "FR||X=0");
}

TEST_CASE("fixed form: rows and bounds have a type, and other lines have none", "[qps_fields]") {
  const std::string typed = line_of({{2, "UP"}, {5, "NAME"}}), plain = line_of({{5, "NAME"}});
  for (const std::string section : {"ROWS", "BOUNDS"}) {
    CHECK(fixed_fields(section, typed) == "UP|NAME|=");
    CHECK(fixed_fields(section, plain) == "no type in columns 2 and 3");
    CHECK(fixed_fields(section, "") == "no type in columns 2 and 3");
  }
  for (const std::string section : {"COLUMNS", "RHS", "RANGES", "QUADOBJ", "QMATRIX", "QSECTION"}) {
    CHECK(fixed_fields(section, plain) == "|NAME|=");
    CHECK(fixed_fields(section, typed) == "'UP' stands in columns 2 and 3");
    CHECK(fixed_fields(section, "") == "||=");
  }
}

TEST_CASE("fixed form: a short line has the fields before its end", "[qps_fields]") {
  const std::size_t first[] = {1, 4, 14, 24, 39, 49}, end[] = {3, 12, 22, 36, 47, 61};
  for (const auto& [section, line] :
       {std::pair<std::string, std::string>("BOUNDS", kBound), {"COLUMNS", kPairs}}) {
    for (std::size_t length = 2; length <= line.size(); ++length) {
      std::array<std::string, 6> part;
      for (std::size_t k = 0; k < 6; ++k) {
        const std::size_t last = std::min(end[k], length);
        if (first[k] < last)
          part[k] = std::string(clothctl::detail::trimmed(line.substr(first[k], last - first[k])));
      }
      std::string expected = part[0] + "|" + part[1] + "|" + part[2] + "=" + part[3];
      if (!part[4].empty()) expected += "|" + part[4] + "=" + part[5];
      INFO(section << " " << length);
      CHECK(fixed_fields(section, std::string_view(line).substr(0, length)) == expected);
    }
  }
}
