#pragma once

// Damaged texts for readers of any format: truncated, or with bytes inserted, replaced or removed.
// A reader must answer with one short line without control characters, which starts with the file
// and a line number of the text.

#include <algorithm>
#include <cstddef>
#include <random>
#include <string>

#include "support/catch.hpp"

namespace clothctl_test {

/// Calls `judge` with every prefix of a text, from the empty one to all but its last character and
/// the line break after it.
template <class Judge>
void for_each_prefix(const std::string& text, const Judge& judge) {
  for (std::size_t length = 0; length + 1 < text.size(); ++length) judge(text.substr(0, length));
}

/// Calls `judge` with `trials` copies of a text of at least 20 bytes. Each is damaged in one to
/// four places: a byte is inserted or replaced, by one of `bytes` or by any byte, or up to five
/// bytes are removed. The same seed gives the same texts.
template <class Judge>
void for_each_spoilt(const std::string& text, const std::string& bytes, unsigned seed, int trials,
                     const Judge& judge) {
  std::mt19937 engine(seed);
  for (int trial = 0; trial < trials; ++trial) {
    std::string spoilt = text;
    for (auto changes = 1 + engine() % 4; changes > 0; --changes) {
      const std::size_t place = engine() % spoilt.size();
      const char byte =
          engine() % 2 == 0 ? static_cast<char>(engine() & 0xff) : bytes[engine() % bytes.size()];
      switch (engine() % 3) {
        case 0: spoilt.insert(place, 1, byte); break;
        case 1: spoilt[place] = byte; break;
        default: spoilt.erase(place, 1 + engine() % 5);
      }
    }
    judge(spoilt);
  }
}

/// Checks that a message about `text` is one short printable line `file:line: error`, and that the
/// text has that line.
inline void check_refusal(const std::string& message, const std::string& file,
                          const std::string& text) {
  INFO(message);
  REQUIRE(message.rfind(file + ":", 0) == 0);
  const std::size_t colon = message.find(": ", file.size());
  REQUIRE(colon != std::string::npos);
  const std::string number = message.substr(file.size() + 1, colon - file.size() - 1);
  REQUIRE(!number.empty());
  REQUIRE(number.find_first_not_of("0123456789") == std::string::npos);
  const long line = std::stol(number);
  CHECK(line >= 1);
  CHECK(line <= 1 + static_cast<long>(std::count(text.begin(), text.end(), '\n')));
  CHECK(message.size() > colon + 2);
  CHECK(message.size() < 300);
  CHECK(std::none_of(message.begin(), message.end(),
                     [](unsigned char c) { return c < 0x20 || c == 0x7f; }));
}

}  // namespace clothctl_test
