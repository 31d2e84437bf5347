#pragma once

// Fields of a line of QPS (qps.hpp), in free form between blanks, in fixed form in columns 2-3,
// 5-12, 15-22, 25-36, 40-47 and 50-61 with blanks between:
//
//   type | name | key value | key value
//
// for example " UP BND X1 4", " X1 COST 1 ROW2 -1" or " RHS ROW1 3".
//
// In free form, lines of RHS, RANGES and BOUNDS may omit the name, which is that of a set.

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "clothctl/io/csv.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// The fields of a data line, as views into the text. `pairs`: number of keys with values, 1 or 2.
struct QpsFields {
  std::string_view type, name;
  std::array<std::string_view, 2> key, value;
  std::size_t pairs = 1;
};

/// The first six words of a line (no line of QPS has more), and the number of all its words.
struct QpsWords {
  explicit QpsWords(std::string_view line) {
    for (line = trimmed(line); !line.empty(); line = trimmed(line)) {
      const std::size_t end = (std::min)(line.find_first_of(kSpaces), line.size());
      if (count < word.size()) word[count] = line.substr(0, end);
      ++count;
      line.remove_prefix(end);
    }
  }
  std::array<std::string_view, 6> word;
  std::size_t count = 0;
};

/// Returns true when a bound of this type has a value.
inline bool qps_bound_has_value(std::string_view type) {
  return type != "FR" && type != "MI" && type != "PL";
}

/// Splits a line in free form into its fields. Returns what is wrong, or "".
inline std::string qps_free_fields(const std::string& section, std::string_view line,
                                   QpsFields& f) {
  const QpsWords words(line);
  const std::size_t count = words.count;
  const std::string found = ", found " + std::to_string(count) + " fields";
  if (section == "ROWS") {
    f.type = words.word[0];
    f.name = words.word[1];
    return count == 2 ? "" : "expected a type and a name" + found;
  }
  if (section == "BOUNDS") {
    f.type = words.word[0];
    const bool valued = qps_bound_has_value(f.type);
    const std::size_t least = valued ? 3 : 2, key = count == least ? 1 : 2;
    if (count < least || count > 4) return "expected a type, a set, a column and a value" + found;
    f.name = key == 2 ? words.word[1] : std::string_view();
    f.key[0] = words.word[key];
    f.value[0] = valued ? words.word[key + 1] : std::string_view();
    return {};
  }
  const bool nameless = section == "RHS" || section == "RANGES";
  const std::size_t named = count % 2;
  if (count < 2 || count > 5 || (named == 0 && !nameless))
    return "expected a name, then one or two names with numbers" + found;
  f.name = named == 1 ? words.word[0] : std::string_view();
  f.pairs = count / 2;
  for (std::size_t k = 0; k < f.pairs; ++k) {
    f.key[k] = words.word[named + 2 * k];
    f.value[k] = words.word[named + 2 * k + 1];
  }
  return {};
}

/// Splits a line in fixed form into its fields. Returns what is wrong, or "".
inline std::string qps_fixed_fields(const std::string& section, std::string_view line,
                                    QpsFields& f) {
  constexpr std::array<std::size_t, 6> kFirst{1, 4, 14, 24, 39, 49};  // from 0
  constexpr std::array<std::size_t, 6> kEnd{3, 12, 22, 36, 47, 61};
  std::array<std::string_view, 6> field;
  std::size_t last = 0;
  for (std::size_t k = 0; k <= field.size() && last < line.size(); ++k) {
    const std::string_view gap =
        trimmed(k == 6 ? line.substr(last) : line.substr(last, kFirst[k] - last));
    if (!gap.empty()) return in_quotes(gap) + " stands between the columns of the fields";
    if (k == 6 || kFirst[k] >= line.size()) break;
    field[k] = trimmed(line.substr(kFirst[k], kEnd[k] - kFirst[k]));
    last = kEnd[k];
  }
  const bool typed = section == "ROWS" || section == "BOUNDS";
  if (typed && field[0].empty()) return "no type in columns 2 and 3";
  if (!typed && !field[0].empty()) return in_quotes(field[0]) + " stands in columns 2 and 3";
  for (std::size_t k = section == "ROWS" ? 2 : section == "BOUNDS" ? 4 : 6; k < field.size(); ++k) {
    if (!field[k].empty()) {
      return in_quotes(field[k]) + " stands in columns " + std::to_string(kFirst[k] + 1) + " to " +
             std::to_string(kEnd[k]) + ", expected nothing there";
    }
  }
  f.type = field[0];
  f.name = field[1];
  f.key = {field[2], field[4]};
  f.value = {field[3], field[5]};
  f.pairs = field[4].empty() && field[5].empty() ? 1 : 2;
  return {};
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
