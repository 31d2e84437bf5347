// Tables of numbers: accepted tables, refused tables with their messages, and written numbers that
// read back exactly.

#include "clothctl/io/csv.hpp"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <random>
#include <string>

#include "support/catch.hpp"

using clothctl::CsvHeader;
using clothctl::CsvTable;
using clothctl::CsvWriter;
using clothctl::parse_csv;
using clothctl::Result;

namespace {

std::string refusal(const std::string& text, CsvHeader header, std::size_t columns = 0) {
  const Result<CsvTable> table = parse_csv(text, "f.csv", header, columns);
  return table ? "accepted" : table.error();
}

}  // namespace

TEST_CASE("a plain table is read", "[csv]") {
  const Result<CsvTable> table = parse_csv("a,b\n1,-2.5\n3e-2,+4\n", "f.csv", CsvHeader::Names);
  REQUIRE(table.has_value());
  CHECK(table->header == std::vector<std::string>{"a", "b"});
  CHECK(table->values.rows() == 2);
  CHECK(table->values(0, 1) == -2.5);
  CHECK(table->values(1, 0) == 0.03);
  CHECK(table->values(1, 1) == 4);
  CHECK(table->lines == std::vector<clothctl::Index>{2, 3});
}

TEST_CASE(
    "a byte-order mark, CRLF, spaces, tabs, blank last lines and a missing line break are accepted",
    "[csv]") {
  for (const std::string text : {"\xef\xbb\xbf"
                                 "a,b\r\n1,2\r\n3,4\r\n",
                                 " a , b \n\t1,2\n3 ,4\n\n  \n\r\n", "a,b\n1,2\n3,4"}) {
    const Result<CsvTable> table = parse_csv(text, "f.csv", CsvHeader::Names);
    REQUIRE(table.has_value());
    CHECK(table->header == std::vector<std::string>{"a", "b"});
    CHECK(table->values == (Eigen::Matrix2d() << 1, 2, 3, 4).finished());
  }
}

TEST_CASE("errors in tables are named with file, line and value", "[csv]") {
  using enum CsvHeader;
  CHECK(refusal("", Names) == "f.csv:1: the file is empty");
  CHECK(refusal("\xef\xbb\xbf \r\n\n", Absent) == "f.csv:1: the file is empty");
  CHECK(refusal("a,b\n", Names) == "f.csv:1: no row after the header");
  CHECK(refusal("a,b\n1,2\n3\n", Names) == "f.csv:3: expected 2 values, found 1");
  CHECK(refusal("a,b\n1,2,\n", Names) == "f.csv:2: expected 2 values, found 3");
  CHECK(refusal("1,2,3\n1,2\n", Absent) == "f.csv:2: expected 3 values, found 2");
  CHECK(refusal("1,2\n", Absent, 3) == "f.csv:1: expected 3 values, found 2");
  CHECK(refusal("a,b\n1,2\n\n3,4\n", Names) == "f.csv:3: blank line before the last row");
  CHECK(refusal("a,b\n1,x7\n", Names) == "f.csv:2: column 'b': 'x7' is not a number");
  CHECK(refusal("1,2\n1,2m\n", Absent) == "f.csv:2: column 2: '2m' is not a number");
  CHECK(refusal("1,,2\n", Absent) == "f.csv:1: column 2: found an empty cell, expected a number");
  CHECK(refusal("a\nnan\n", Names) == "f.csv:2: column 'a': 'nan' is not finite");
  CHECK(refusal("a\n-inf\n", Names) == "f.csv:2: column 'a': '-inf' is not finite");
  CHECK(refusal("a\n1e999\n", Names) ==
        "f.csv:2: column 'a': '1e999' is out of the range of a double");
  for (const std::string bad :
       {"1;2", "1 2", "0x10", "--1", "+-1", "++1", "1,5e", "1e", ".", "+", "\"1\"", "1\xc2\xa0"}) {
    CHECK(refusal("a\n" + bad + "\n", Names) != "accepted");
  }
}

TEST_CASE("infinity is written as a word, with or without a sign", "[csv]") {
  using clothctl::detail::parse_infinity;
  const double infinity = clothctl::scalar_traits<double>::infinity();
  for (const std::string word : {"inf", "infinity", "oo"}) {
    for (const std::string sign : {"", "+", "-"}) {
      double value = 3;
      CHECK(parse_infinity(sign + word, word, value));
      CHECK(value == (sign == "-" ? -infinity : infinity));
    }
  }
  for (const std::string text :
       {"", "+", "-", "in", "infi", "Inf", "INF", "infinity", " inf", "inf ", "--inf", "++inf",
        "+-inf", "-+inf", "- inf", "nan", "1e999", "0"}) {
    double value = 3;
    INFO(text);
    CHECK_FALSE(parse_infinity(text, "inf", value));
    CHECK(value == 3);  // unchanged
  }
  double value = 3;
  CHECK_FALSE(parse_infinity("inf", "infinity", value));
}

TEST_CASE("a message is one short printable line for any file contents", "[csv]") {
  std::mt19937 engine(1);
  std::uniform_int_distribution<int> byte(0, 255);
  for (int trial = 0; trial < 300; ++trial) {
    std::string text;
    for (int i = 0; i < 200; ++i)
      text += static_cast<char>(trial % 2 == 0 ? byte(engine)
                                               : "0123456789.,-e\n\r \"a"[byte(engine) % 19]);
    for (const CsvHeader header : {CsvHeader::Absent, CsvHeader::Names}) {
      const std::string message = refusal(text, header);
      CHECK(message.find_first_of("\n\r") == std::string::npos);
      CHECK(message.find('\0') == std::string::npos);
      CHECK(message.size() < 200);
    }
  }
  CHECK(refusal("a\n" + std::string(100000, '7') + "x\n", CsvHeader::Names).size() < 200);
}

TEST_CASE("the message about an unreadable file names it", "[csv]") {
  const std::string folder = std::filesystem::temp_directory_path().string();
  const std::string missing = folder + "/clothctl_no_such_file.csv";
  CHECK(clothctl::read_csv(missing, CsvHeader::Absent)
            .error()
            .rfind(missing + ": cannot be opened", 0) == 0);
  CHECK(clothctl::read_csv(folder, CsvHeader::Absent).error().rfind(folder + ": cannot be", 0) ==
        0);
}

TEST_CASE("written numbers read back bit for bit", "[csv]") {
  CsvWriter writer({"t", "x"});
  std::mt19937_64 engine(2);
  std::vector<double> values = {0.0,
                                -0.0,
                                0.1,
                                1.0 / 3,
                                1e300,
                                -1e-300,
                                std::numeric_limits<double>::min(),
                                std::numeric_limits<double>::max()};
#ifndef __FAST_MATH__  // -ffast-math flushes subnormal numbers to zero
  values.push_back(std::numeric_limits<double>::denorm_min());
  values.push_back(-1e-310);
#endif
  while (values.size() < 400) {
    const std::uint64_t bits = engine();
    double value = 0;
    std::memcpy(&value, &bits, sizeof value);
    if (clothctl::is_finite(value) && std::abs(value) >= std::numeric_limits<double>::min())
      values.push_back(value);
  }
  for (std::size_t i = 0; i < values.size(); i += 2) writer.add_row({values[i], values[i + 1]});
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_csv_roundtrip.csv").string();
  const Result<std::size_t> written = writer.write(path);
  REQUIRE(written.has_value());
  CHECK(*written == writer.text().size());
  const Result<CsvTable> table = clothctl::read_csv(path, CsvHeader::Names);
  std::filesystem::remove(path);
  REQUIRE(table.has_value());
  REQUIRE(table->values.rows() == static_cast<clothctl::Index>(values.size() / 2));
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double read =
        table->values(static_cast<clothctl::Index>(i / 2), static_cast<clothctl::Index>(i % 2));
    CHECK(std::memcmp(&read, &values[i], sizeof read) == 0);
  }
}

TEST_CASE("tables that could not be read back are not written", "[csv]") {
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_csv_refused.csv").string();
  std::filesystem::remove(path);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
        -std::numeric_limits<double>::infinity()}) {
    CsvWriter writer({"t", "x"});
    writer.add_row({0, 1});
    writer.add_row({1, bad});
    writer.add_row({bad, 2});
    CHECK(writer.write(path).error() ==
          path + ": row 2, column 'x': " + clothctl::number_text(bad) + " is not finite");
    CHECK(parse_csv(writer.text(), "f", CsvHeader::Names).error().rfind("f:3: column 'x': ", 0) ==
          0);
  }
  CHECK(CsvWriter({"t"}).write(path).error() == path + ": no row after the header");
  for (const std::string name : {"b,c", "d\"e", "f\ng", "\"", " a", "a\t", "a\r"}) {
    CsvWriter writer({"t", name});
    writer.add_row({0, 1});
    INFO(name);
    CHECK(writer.write(path).error().rfind(path + ": column 2: the name '", 0) == 0);
  }
  CHECK_FALSE(std::filesystem::exists(path));
}

TEST_CASE("every written table is read back", "[csv]") {
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_csv_names.csv").string();
  const std::string pieces[] = {"a",  "é", "x y", ",", "\"", "\n", "\r",          " ",
                                "\t", "1", "nan", "",  "'",  ";",  "\xef\xbb\xbf"};
  std::mt19937 engine(6);
  int written = 0, refused = 0;
  for (int trial = 0; trial < 600; ++trial) {
    std::vector<std::string> names(1 + engine() % 3);
    for (std::string& name : names) {
      for (int i = 0; i < 1 + trial % 2; ++i) name += pieces[engine() % std::size(pieces)];
    }
    CsvWriter writer(names);
    const std::vector<double> row(names.size(), 0.1);
    writer.add_row(row);
    if (!writer.write(path)) {
      ++refused;
      continue;
    }
    ++written;
    const Result<CsvTable> table = clothctl::read_csv(path, CsvHeader::Names);
    REQUIRE(table.has_value());
    CHECK(table->header == names);
    CHECK(table->values.cols() == static_cast<clothctl::Index>(names.size()));
    CHECK(table->values(0, 0) == 0.1);
  }
  std::filesystem::remove(path);
  CHECK(written > 100);
  CHECK(refused > 100);
}

TEST_CASE("names of columns are quoted if necessary", "[csv]") {
  CHECK(CsvWriter({"a", "b,c", "d\"e"}).text() == "a,\"b,c\",\"d\"\"e\"\n");
}

TEST_CASE("the error of an unwritable table names the reason", "[csv]") {
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_no_such_folder" / "a.csv").string();
  CsvWriter writer({"a"});
  writer.add_row({1});
  CHECK(writer.write(path).error().rfind(path + ": cannot be written", 0) == 0);
}

TEST_CASE("a row with the wrong number of values is named when the table is written", "[io]") {
  CsvWriter table({"t", "x"});
  table.add_row({0.0, 1.0});
  table.add_row({1.0, 2.0, 3.0});
  table.add_row({2.0});
  CHECK(table.text() == "t,x\n0,1\n");
  const Result<std::size_t> written = table.write("never_written.csv");
  REQUIRE_FALSE(written.has_value());
  CHECK(written.error() == "never_written.csv: row 2: expected 2 values, found 3");
}
