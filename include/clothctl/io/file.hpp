#pragma once

// Whole files, read and written in one go, with an error of one line that names the file and the reason.

#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>

#include "clothctl/core/result.hpp"

namespace clothctl {

namespace io_detail {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

inline Error file_error(const std::string& path, const char* what, int code) {
  return Error{path + ": " + what + " (" + std::generic_category().message(code) + ")"};
}

}  // namespace io_detail

/// Files larger than this many bytes are refused by `read_file`, so that a device or a wrong file cannot eat the memory.
inline constexpr std::size_t kLargestFile = std::size_t(1) << 28;

/// Reads a whole file as bytes. Allocates.
/// Fails when: the file is missing, is a folder, cannot be read, or is larger than `kLargestFile`.
inline Result<std::string> read_file(const std::string& path) {
  errno = 0;
  const std::unique_ptr<std::FILE, io_detail::FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return io_detail::file_error(path, "cannot be opened", errno);
  std::string text;
  std::string block(std::size_t(1) << 16, '\0');
  while (true) {
    errno = 0;
    const std::size_t count = std::fread(block.data(), 1, block.size(), file.get());
    text.append(block, 0, count);
    if (text.size() > kLargestFile) return Error{path + ": is larger than " + std::to_string(kLargestFile >> 20) + " MiB"};
    if (std::ferror(file.get()) != 0) return io_detail::file_error(path, "cannot be read", errno);
    if (count < block.size()) return text;
  }
}

/// Writes `content` as the whole file, replacing what was there; answers with the number of bytes.
/// Fails when: the folder is missing or not writable, or the disk is full.
inline Result<std::size_t> write_file(const std::string& path, std::string_view content) {
  errno = 0;
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) return io_detail::file_error(path, "cannot be written", errno);
  const bool written = content.empty() || std::fwrite(content.data(), 1, content.size(), file) == content.size();
  const int code = errno;
  const bool closed = std::fclose(file) == 0;  // the last block may fail only here
  if (!written || !closed) return io_detail::file_error(path, "cannot be written", written ? errno : code);
  return content.size();
}

}  // namespace clothctl
