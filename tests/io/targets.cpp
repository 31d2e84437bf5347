// Target curves: both forms of files, the recorded ones, and every refusal.

#include "clothctl/io/targets.hpp"

#include <filesystem>
#include <limits>
#include <string>

#include "support/catch.hpp"
#include "support/shared_data.hpp"

using clothctl::read_target_pair;
using clothctl::read_targets;
using clothctl::Result;
using clothctl::TargetCurves;

namespace {

// A temporary file, which is removed at the end of its scope.
class TemporaryFile {
 public:
  TemporaryFile(const std::string& name, const std::string& content)
      : path_((std::filesystem::temp_directory_path() / ("clothctl_targets_" + name)).string()) {
    REQUIRE(clothctl::write_file(path_, content).has_value());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() { std::filesystem::remove(path_); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// Returns the error for a file with this content, with "f" instead of its path.
std::string refusal(const std::string& content) {
  const TemporaryFile file("refused.csv", content);
  const Result<TargetCurves> curves = read_targets(file.path());
  if (curves) return "accepted";
  REQUIRE(curves.error().rfind(file.path(), 0) == 0);
  return "f" + curves.error().substr(file.path().size());
}

const std::string kHeader = "t,Lx,Ly,Lz,Rx,Ry,Rz\n";

}  // namespace

TEST_CASE("one file with a header gives a curve for each feature", "[targets]") {
  const TemporaryFile file("good.csv", kHeader + "0,1,2,3,4,5,6\r\n0.5,7,8,9,10,11,12\n");
  const Result<TargetCurves> curves = read_targets(file.path());
  REQUIRE(curves.has_value());
  CHECK(curves->names == std::vector<std::string>{"L", "R"});
  CHECK(curves->times == Eigen::Vector2d(0, 0.5));
  REQUIRE(curves->features.size() == 2);
  CHECK(curves->features[0].col(1) == Eigen::Vector3d(7, 8, 9));
  CHECK(curves->features[1].col(0) == Eigen::Vector3d(4, 5, 6));
}

TEST_CASE("the header may name any number of features", "[targets]") {
  const TemporaryFile one("one.csv", "t,ballx,bally,ballz\n-1,1,2,3\n1,4,5,6\n");
  const Result<TargetCurves> ball = read_targets(one.path());
  REQUIRE(ball.has_value());
  CHECK(ball->names == std::vector<std::string>{"ball"});
  CHECK(ball->features[0].col(1) == Eigen::Vector3d(4, 5, 6));
  const TemporaryFile three(
      "three.csv", "t,ax,ay,az,bx,by,bz,cx,cy,cz\n0,1,2,3,4,5,6,7,8,9\n1,1,2,3,4,5,6,7,8,9\n");
  CHECK(read_targets(three.path())->features.size() == 3);
}

TEST_CASE("bad headers are refused", "[targets]") {
  const std::string expected = ", expected t,Lx,Ly,Lz,Rx,Ry,Rz or the like";
  CHECK(refusal("time,Lx,Ly,Lz\n0,1,2,3\n1,1,2,3\n") ==
        "f:1: header starts with 'time'" + expected);
  CHECK(refusal("0,1,2,3\n1,1,2,3\n") == "f:1: header starts with '0'" + expected);
  CHECK(refusal("t\n0\n1\n") == "f:1: header has 1 columns" + expected);
  CHECK(refusal("t,Lx,Ly\n0,1,2\n1,1,2\n") == "f:1: header has 3 columns" + expected);
  CHECK(refusal("t,Lx,Lz,Ly\n0,1,2,3\n1,1,2,3\n") == "f:1: header has 'Lz'" + expected);
  CHECK(refusal("t,Lx,Ry,Lz\n0,1,2,3\n1,1,2,3\n") == "f:1: header has 'Ry' after 'Lx'" + expected);
  CHECK(refusal("t,Lx,Ly,Lz,Lx,Ly,Lz\n0,1,2,3,1,2,3\n1,1,2,3,1,2,3\n") ==
        "f:1: header has 'Lx' twice");
  CHECK(refusal("t,,,\n0,1,2,3\n1,1,2,3\n") == "f:1: header has ''" + expected);
}

TEST_CASE("tables with inconsistent parts are refused", "[targets]") {
  using clothctl::CsvTable;
  using clothctl::targets_from_table;
  CsvTable good;
  good.name = "f";
  good.header = {"t", "Lx", "Ly", "Lz"};
  good.values = (Eigen::Matrix<double, 2, 4>() << 0, 1, 2, 3, 1, 4, 5, 6).finished();
  good.lines = {2, 3};
  REQUIRE(targets_from_table(good).has_value());

  const std::string expected = ", expected t,Lx,Ly,Lz,Rx,Ry,Rz or the like";
  CsvTable table = good;
  table.header.clear();
  CHECK(targets_from_table(table).error() == "f:1: no header" + expected);
  CHECK(targets_from_table(CsvTable()).error() == ":1: no header" + expected);
  const Result<CsvTable> bare =
      clothctl::parse_csv("0,1,2,3\n1,4,5,6\n", "f", clothctl::CsvHeader::Absent);
  CHECK(targets_from_table(*bare).error() == "f:1: no header" + expected);
  table = good;
  table.values.conservativeResize(2, 3);
  CHECK(targets_from_table(table).error() == "f:1: header has 4 columns, but the rows have 3");
  table = good;
  table.header.insert(table.header.end(), {"Rx", "Ry", "Rz"});
  CHECK(targets_from_table(table).error() == "f:1: header has 7 columns, but the rows have 4");
  table = good;
  table.values.resize(0, 4);
  table.lines.clear();
  CHECK(targets_from_table(table).error() == "f:1: no row after the header");
  for (const std::size_t lines : {std::size_t(0), std::size_t(1), std::size_t(3)}) {
    table = good;
    table.lines.resize(lines, 9);
    CHECK(targets_from_table(table).error() ==
          "f:1: 2 rows, but the lines of " + std::to_string(lines));
  }
}

TEST_CASE("bad rows are refused with file, line and value", "[targets]") {
  CHECK(refusal("") == "f:1: the file is empty");
  CHECK(refusal(kHeader) == "f:1: no row after the header");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\n") == "f:2: expected at least 2 rows, found 1");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\n1,1,2,3,4\n") == "f:3: expected 7 values, found 5");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\n1,1,2,3,4,5,6,7\n") == "f:3: expected 7 values, found 8");
  CHECK(refusal(kHeader + "0,1,2,nan,4,5,6\n1,1,2,3,4,5,6\n") ==
        "f:2: column 'Lz': 'nan' is not finite");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\ninf,1,2,3,4,5,6\n") ==
        "f:3: column 't': 'inf' is not finite");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\n1,1,2,3,4,up,6\n") ==
        "f:3: column 'Ry': 'up' is not a number");
  CHECK(refusal(kHeader + "0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n0.5,1,2,3,4,5,6\n") ==
        "f:4: time 0.5 does not come after 1");
  CHECK(refusal(kHeader + "0.25,1,2,3,4,5,6\n0.25,1,2,3,4,5,6\n") ==
        "f:3: time 0.25 does not come after 0.25");
  CHECK(read_targets("no_such.csv").error().rfind("no_such.csv: cannot be opened", 0) == 0);
}

TEST_CASE("a pair of files without headers gives left and right at evenly spaced times",
          "[targets]") {
  const TemporaryFile left("left.csv", "1,2,3\n4,5,6\n7,8,9"),
      right("right.csv", "0,0,1\r\n0,0,2\r\n0,0,3\r\n");
  const Result<TargetCurves> curves = read_target_pair(left.path(), right.path(), 0.25);
  REQUIRE(curves.has_value());
  CHECK(curves->names == std::vector<std::string>{"L", "R"});
  CHECK(curves->times == Eigen::Vector3d(0, 0.25, 0.5));
  CHECK(curves->features[0].col(2) == Eigen::Vector3d(7, 8, 9));
  CHECK(curves->features[1].row(2) == Eigen::RowVector3d(1, 2, 3));
}

TEST_CASE("bad pairs of files are refused", "[targets]") {
  const TemporaryFile two("two.csv", "1,2,3\n4,5,6\n"), three("three.csv", "1,2,3\n4,5,6\n7,8,9\n"),
      one("one_row.csv", "1,2,3\n"), wide("wide.csv", "1,2,3,4\n1,2,3,4\n"),
      named("named.csv", "x,y,z\n1,2,3\n4,5,6\n");
  CHECK(read_target_pair(two.path(), three.path(), 0.02).error() ==
        three.path() + ":3: expected 2 rows as in " + two.path() + ", found 3");
  CHECK(read_target_pair(three.path(), two.path(), 0.02).error() ==
        two.path() + ":2: expected 3 rows as in " + three.path() + ", found 2");
  CHECK(read_target_pair(one.path(), one.path(), 0.02).error() ==
        one.path() + ":1: expected at least 2 rows, found 1");
  CHECK(read_target_pair(two.path(), wide.path(), 0.02).error() ==
        wide.path() + ":1: expected 3 values, found 4");
  CHECK(read_target_pair(named.path(), two.path(), 0.02).error() ==
        named.path() + ":1: column 1: 'x' is not a number");
  CHECK(read_target_pair(two.path(), "no_such.csv", 0.02)
            .error()
            .rfind("no_such.csv: cannot be opened", 0) == 0);
  CHECK(read_target_pair(two.path(), two.path(), 0).error() ==
        "dt is 0, expected a positive number of seconds");
  CHECK(read_target_pair(two.path(), two.path(), -0.02).error() ==
        "dt is -0.02, expected a positive number of seconds");
  CHECK(!read_target_pair(two.path(), two.path(), std::numeric_limits<double>::quiet_NaN())
             .has_value());
  CHECK(!read_target_pair(two.path(), two.path(), std::numeric_limits<double>::infinity())
             .has_value());
  CHECK(read_target_pair(three.path(), three.path(), 1.7e308).error() ==
        "dt is 1.7e+308, too large for 3 rows");
}

TEST_CASE("recorded target files are read", "[targets]") {
  const std::string folder = clothctl_test::shared_path("data/trajectories");
  if (folder.empty()) {
    WARN("the shared data is not here: recorded targets are not read");
    return;
  }
  for (const std::string kind : {"known", "fast", "random"}) {
    for (int i = 1; i <= 5; ++i) {
      const Result<TargetCurves> curves =
          read_targets(folder + "/splines/" + kind + "_" + std::to_string(i) + ".csv");
      REQUIRE(curves.has_value());
      CHECK(curves->times.size() == 251);
      CHECK(curves->times[250] == Approx(5.0));
      CHECK(curves->features.size() == 2);
      CHECK(curves->features[0].col(0) == Eigen::Vector3d(-0.247624, -0.017417, -0.500068));
    }
  }
  const int rows[] = {699, 699, 300, 300, 699, 700, 1150, 900};
  for (int i = 1; i <= 8; ++i) {
    const std::string stem = folder + "/iri/ref_" + std::to_string(i);
    const Result<TargetCurves> curves = read_target_pair(stem + "L.csv", stem + "R.csv", 0.02);
    REQUIRE(curves.has_value());
    CHECK(curves->times.size() == rows[i - 1]);
    CHECK((curves->features[0].col(0) - curves->features[1].col(0)).norm() ==
          Approx(0.3).margin(0.003));
  }
  CHECK(!read_targets(folder + "/iri/ref_1L.csv").has_value());
  CHECK(!read_targets(folder + "/splines/initial_pose_17x17.csv").has_value());
}
