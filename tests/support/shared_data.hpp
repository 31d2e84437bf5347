#pragma once

// Finds the reference data in the folder beside the project, which may be missing. A test that
// needs a missing file prints a message and returns.

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

namespace clothctl_test {

/// Returns the path of `relative` in the shared folder, which is $CLOTHCTL_SHARED or else
/// `../shared` as seen from the project's root. Returns "" if the path does not exist.
inline std::string shared_path(const std::string& relative) {
  std::string root;
  if (const char* set = std::getenv("CLOTHCTL_SHARED"); set != nullptr && *set != '\0') {
    root = set;
  } else {
#ifdef CLOTHCTL_SOURCE_DIR
    root = CLOTHCTL_SOURCE_DIR;  // with operator+ here, g++ 12 warns wrongly (-Wrestrict)
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
