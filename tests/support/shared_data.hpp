#pragma once

// Finds the reference data that lies beside the project. It is not part of it: a test that wants a
// file says so with a message and returns where the folder is missing.

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

namespace clothctl_test {

/// The path of `relative` in the shared folder: $CLOTHCTL_SHARED, else `../shared` seen from the
/// project's root. Returns "" where it does not exist.
inline std::string shared_path(const std::string& relative) {
  std::string root;
  if (const char* set = std::getenv("CLOTHCTL_SHARED"); set != nullptr && *set != '\0') {
    root = set;
  } else {
#ifdef CLOTHCTL_SOURCE_DIR
    root = CLOTHCTL_SOURCE_DIR;  // appended in place: g++ 12 misreads operator+ here (-Wrestrict)
    root.append("/../shared");
#else
    return {};
#endif
  }
  const std::filesystem::path path = std::filesystem::path(root) / relative;
  std::error_code error;
  return std::filesystem::exists(path, error) ? path.string() : std::string();
}

}  // namespace clothctl_test
