#include "support/options.hpp"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace program {

void refuse(const std::string& reason) {
  std::fprintf(stderr, "error: %s\n", reason.c_str());
  std::exit(2);
}

void make_folder(const std::string& out) {
  if (out.empty()) return;
  std::error_code failure;
  std::filesystem::create_directories(out, failure);
  if (failure) refuse("--out: " + out + ": " + failure.message());
}

}  // namespace program
