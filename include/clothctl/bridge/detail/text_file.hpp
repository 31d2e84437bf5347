#pragma once

// Reads a whole file, for what bridges parse. (io/file.hpp is of a room that bridges do not see.)

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <string>
#include <system_error>

#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the contents of a file, or why it cannot be read. Of a file of over `most` bytes it
/// returns a part that is longer than that, which the caller refuses.
inline Result<std::string> read_text_file(const std::string& path, std::size_t most) {
  const auto refuse = [&path](const char* what) {
    return Error{path + ": " + what + " (" + std::generic_category().message(errno) + ")"};
  };
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  errno = 0;
  const std::unique_ptr<std::FILE, Closer> file(std::fopen(path.c_str(), "rb"));
  if (!file) return refuse("cannot be opened");
  std::string text;
  std::array<char, 16384> block{};
  while (const std::size_t count = std::fread(block.data(), 1, block.size(), file.get())) {
    text.append(block.data(), count);
    if (most < text.size()) return text;
  }
  if (std::ferror(file.get()) != 0) return refuse("cannot be read");
  return text;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
