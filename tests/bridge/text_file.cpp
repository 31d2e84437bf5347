// Whole files, for what bridges parse.

#include "clothctl/bridge/detail/text_file.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a file is read as it is, and one that is too long is cut behind its limit", "[bridge]") {
  const auto path = std::filesystem::temp_directory_path() / "clothctl_text_file_test";
  std::string written(100000, 'x');
  written[5] = '\0';
  written[7] = '\r';
  std::ofstream(path, std::ios::binary) << written;
  CHECK(detail::read_text_file(path.string(), 100000).value() == written);
  const std::string cut = detail::read_text_file(path.string(), 20000).value();
  CHECK(cut.size() > 20000);
  CHECK(cut.size() < written.size());
  CHECK(written.compare(0, cut.size(), cut) == 0);
  std::ofstream(path, std::ios::binary).close();
  CHECK(detail::read_text_file(path.string(), 10).value().empty());
  std::filesystem::remove(path);
}

TEST_CASE("a file that cannot be read says why", "[bridge]") {
  const auto missing = detail::read_text_file("no/such/file", 10);
  REQUIRE_FALSE(missing);
  CHECK(missing.error().find("no/such/file: cannot be opened (") == 0);
  const auto folder = detail::read_text_file(std::filesystem::temp_directory_path().string(), 10);
  REQUIRE_FALSE(folder);
  CHECK(folder.error().find(": cannot be ") != std::string::npos);
}
