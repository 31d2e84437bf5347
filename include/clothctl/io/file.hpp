#pragma once

// Reads and writes whole files. Errors are one line that names the file and the reason.

#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>

#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

inline Error file_error(const std::string& path, const char* what, int code) {
  return Error{path + ": " + what + " (" + std::generic_category().message(code) + ")"};
}

}  // namespace detail

/// The largest file that `read_file` accepts where it is not told less, bytes. The limit protects
/// the memory from a device or a wrong file.
inline constexpr std::size_t kLargestFile = std::size_t(1) << 28;

/// Returns the bytes of a file. Allocates. Fails when: the file is missing, is a folder, cannot be
/// read, or is larger than `most` bytes.
inline Result<std::string> read_file(const std::string& path, std::size_t most = kLargestFile) {
  errno = 0;
  const std::unique_ptr<std::FILE, detail::FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return detail::file_error(path, "cannot be opened", errno);
  std::string text;
  std::string block(std::size_t(1) << 16, '\0');
  while (true) {
    errno = 0;
    const std::size_t count = std::fread(block.data(), 1, block.size(), file.get());
    text.append(block, 0, count);
    if (text.size() > most)
      return Error{path + ": is larger than " + std::to_string(most >> 20) + " MiB"};
    if (std::ferror(file.get()) != 0) return detail::file_error(path, "cannot be read", errno);
    if (count < block.size()) return text;
  }
}

/// Writes `content` to a file and replaces what was there. Returns the number of bytes. Fails when:
/// the folder is missing or not writable, or the disk is full.
inline Result<std::size_t> write_file(const std::string& path, std::string_view content) {
  errno = 0;
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) return detail::file_error(path, "cannot be written", errno);
  const bool written =
      content.empty() || std::fwrite(content.data(), 1, content.size(), file) == content.size();
  const int code = errno;
  const bool closed =
      std::fclose(file) == 0;  // a failure to write the last block may show only here
  if (!written || !closed)
    return detail::file_error(path, "cannot be written", written ? errno : code);
  return content.size();
}

}  // namespace clothctl::inline CLOTHCTL_ABI
