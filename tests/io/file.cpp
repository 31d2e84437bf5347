// Whole files: a round trip of any bytes, and messages of errors.

#include "clothctl/io/file.hpp"

#include <filesystem>
#include <string>

#include "support/catch.hpp"

TEST_CASE("a written file reads back the same", "[file]") {
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_file_roundtrip").string();
  for (const std::size_t size :
       {std::size_t(0), std::size_t(1), std::size_t(65536), std::size_t(200001)}) {
    std::string content(size, '\0');
    for (std::size_t i = 0; i < size; ++i) content[i] = static_cast<char>(i * 7 % 256);
    const auto written = clothctl::write_file(path, content);
    REQUIRE(written.has_value());
    CHECK(*written == size);
    const auto read = clothctl::read_file(path);
    REQUIRE(read.has_value());
    CHECK(*read == content);
  }
  std::filesystem::remove(path);
}

TEST_CASE("a file above the limit is refused, one at it is read", "[file]") {
  const std::string path =
      (std::filesystem::temp_directory_path() / "clothctl_file_limit").string();
  const std::size_t limit = std::size_t(1) << 20;
  REQUIRE(clothctl::write_file(path, std::string(limit, 'x')).has_value());
  CHECK(clothctl::read_file(path, limit).value().size() == limit);
  REQUIRE(clothctl::write_file(path, std::string(limit + 1, 'x')).has_value());
  CHECK(clothctl::read_file(path, limit).error() == path + ": is larger than 1 MiB");
  std::filesystem::remove(path);
}

TEST_CASE("errors of files name the file", "[file]") {
  const std::string folder = std::filesystem::temp_directory_path().string();
  CHECK(clothctl::read_file(folder + "/clothctl_nowhere")
            .error()
            .rfind(folder + "/clothctl_nowhere: cannot be opened", 0) == 0);
  CHECK(!clothctl::read_file(folder).has_value());
  CHECK(clothctl::write_file(folder, "x").error().rfind(folder + ": cannot be written", 0) == 0);
  CHECK(!clothctl::write_file(folder + "/clothctl_nowhere/x", "x").has_value());
  if (std::filesystem::exists("/dev/full"))
    CHECK(!clothctl::write_file("/dev/full", "x").has_value());
}
