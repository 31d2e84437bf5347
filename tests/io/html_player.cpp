// The player page: its data decode to what was recorded, any text stays text, and errors are
// reported.

#include "clothctl/io/html_player.hpp"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "io/script_text.hpp"
#include "support/catch.hpp"

using clothctl::Index;
using clothctl::PlayerRecorder;
using clothctl::PlayerScene;
using clothctl::Points;

namespace {

constexpr Index kVertices = 12;
constexpr int kFrames = 7;

PlayerScene small_scene() {
  PlayerScene scene;
  scene.title = "A sheet";
  scene.triangles = {{0, 1, 2}, {2, 1, 11}};
  scene.segments = {{3, 4}};
  scene.feature_names = {"L", "R"};
  return scene;
}

Points<double> cloud(int frame, Index count, double scale) {
  Points<double> points(3, count);
  for (Index j = 0; j < count; ++j) {
    const double a = static_cast<double>(j) + 0.31 * frame;
    points.col(j) =
        scale * Eigen::Vector3d(std::sin(a), 0.5 * std::cos(2 * a), 1 + std::sin(3 * a));
  }
  return points;
}

PlayerRecorder small_recording(PlayerScene scene = small_scene()) {
  PlayerRecorder recorder(std::move(scene), kVertices, 2, 3);
  for (int f = 0; f < kFrames; ++f) {
    recorder.add_frame(cloud(f, kVertices, 1), cloud(f, 2, 0.5), cloud(f + 1, 2, 0.5),
                       cloud(f, 3, 0.2), cloud(f, 3, 4));
  }
  return recorder;
}

// Returns the text between `<script … id="name">` and `</script>`.
std::string element(const std::string& page, const std::string& name) {
  const std::string head = " id=\"" + name + "\">";
  const std::size_t begin = page.find(head);
  REQUIRE(begin != std::string::npos);
  const std::size_t end = page.find("</script>", begin);
  REQUIRE(end != std::string::npos);
  return page.substr(begin + head.size(), end - begin - head.size());
}

std::vector<std::uint8_t> data(const std::string& page, const std::string& name) {
  const auto bytes = clothctl::detail::decode_base64(element(page, "data-" + name));
  REQUIRE(bytes.has_value());
  return *bytes;
}

std::vector<std::uint32_t> words(const std::vector<std::uint8_t>& bytes) {
  REQUIRE(bytes.size() % 4 == 0);
  std::vector<std::uint32_t> out;
  for (std::size_t i = 0; i < bytes.size(); i += 4) {
    out.push_back(std::uint32_t(bytes[i]) | std::uint32_t(bytes[i + 1]) << 8 |
                  std::uint32_t(bytes[i + 2]) << 16 | std::uint32_t(bytes[i + 3]) << 24);
  }
  return out;
}

// Returns the three numbers of `"key":[a,b,c]`.
Eigen::Vector3d triple(const std::string& json, const std::string& key) {
  const std::size_t at = json.find("\"" + key + "\":[");
  REQUIRE(at != std::string::npos);
  Eigen::Vector3d out;
  const char* text = json.c_str() + at + key.size() + 4;
  for (Index c = 0; c < 3; ++c) {
    char* end = nullptr;
    out[c] = std::strtod(text, &end);
    text = end + 1;
  }
  return out;
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos;
       at = text.find(part, at + part.size()))
    ++found;
  return found;
}

Points<double> none() { return Points<double>(3, 0); }

}  // namespace

TEST_CASE("vertices decode to the recorded positions within half a quantisation step",
          "[html_player]") {
  const std::string page = *small_recording().page();
  const std::string json = element(page, "scene");
  const Eigen::Vector3d low = triple(json, "low"), size = triple(json, "size");
  const std::vector<std::uint8_t> bytes = data(page, "positions");
  REQUIRE(bytes.size() == static_cast<std::size_t>(kFrames * kVertices * 6));
  double largest = 0;
  std::size_t at = 0;
  for (int f = 0; f < kFrames; ++f) {
    const Points<double> positions = cloud(f, kVertices, 1);
    for (Index j = 0; j < kVertices; ++j) {
      for (Index c = 0; c < 3; ++c, at += 2) {
        const double step = bytes[at] + 256.0 * bytes[at + 1];
        const double error = std::abs(low[c] + size[c] * step / 65535 - positions(c, j));
        CHECK(error <= size[c] / 131070 + 1e-6);
        largest = std::max(largest, error);
      }
    }
  }
  CHECK(largest < 1e-4);  // 0.1 mm for scenes of metres
  CHECK(largest > 0);
}

TEST_CASE("features, arrows and indices are stored exactly", "[html_player]") {
  const std::string page = *small_recording().page();
  const std::vector<std::uint32_t> actual = words(data(page, "actual")),
                                   target = words(data(page, "target")),
                                   vectors = words(data(page, "vectors"));
  REQUIRE(actual.size() == kFrames * 6);
  REQUIRE(target.size() == kFrames * 6);
  REQUIRE(vectors.size() == kFrames * 9);
  CHECK(std::bit_cast<float>(actual[6 * 4 + 1]) == static_cast<float>(cloud(4, 2, 0.5)(1, 0)));
  CHECK(std::bit_cast<float>(target[6 * 4 + 5]) == static_cast<float>(cloud(5, 2, 0.5)(2, 1)));
  CHECK(std::bit_cast<float>(vectors[9 * 2 + 3]) == static_cast<float>(cloud(2, 3, 4)(0, 1)));
  CHECK(words(data(page, "triangles")) == std::vector<std::uint32_t>{0, 1, 2, 2, 1, 11});
  CHECK(words(data(page, "segments")) == std::vector<std::uint32_t>{3, 4});
  const std::string json = element(page, "scene");
  CHECK(json.find("\"frames\":7,\"vertices\":12,\"arrows\":3") != std::string::npos);
  CHECK(json.find("\"features\":[\"L\",\"R\"]") != std::string::npos);
}

TEST_CASE("the page is complete", "[html_player]") {
  const std::string page = *small_recording().page();
  CHECK(page.rfind("<!doctype html>", 0) == 0);
  CHECK(page.find("</html>\n") == page.size() - 8);
  CHECK(count(page, "<script") == count(page, "</script>"));
  CHECK(count(page, "<script") == 10);
  CHECK(page.find("<title>A sheet</title>") != std::string::npos);
  CHECK(count(page, clothctl_test::all_scripts()) == 1);
}

TEST_CASE("text with markup stays text", "[html_player]") {
  PlayerScene scene = small_scene();
  const std::string hostile = "</script><script>alert(1)</script><!-- \" ' & \xff";
  scene.title = scene.subtitle = scene.mesh_name = scene.arrow_name = scene.arrow_unit = hostile;
  scene.feature_names = {hostile, hostile};
  scene.figures = {{hostile, hostile}};
  const std::string page = *small_recording(std::move(scene)).page();
  CHECK(page.find("alert(1)</script>") == std::string::npos);
  CHECK(page.find("<!-- ") == std::string::npos);
  CHECK(count(page, "<script") == 10);
  CHECK(page.find("<title>&lt;/script&gt;") != std::string::npos);
  CHECK(page.find('\xff') == std::string::npos);
}

TEST_CASE("figures may be set after the recording", "[html_player]") {
  PlayerRecorder recorder = small_recording();
  recorder.scene().figures.push_back({"Mean error", "7.5 mm"});
  CHECK(element(*recorder.page(), "scene").find("\"figures\":[[\"Mean error\",\"7.5 mm\"]]") !=
        std::string::npos);
}

TEST_CASE("marks are stored with the frames that they begin at", "[html_player]") {
  CHECK(element(*small_recording().page(), "scene").find("\"marks\":[]") != std::string::npos);
  PlayerRecorder recorder(PlayerScene{}, 0, 0, 0);
  for (int f = 0; f < 3; ++f) {
    recorder.mark("close");  // the same again is no other mark
    recorder.add_frame(none(), none(), none(), none(), none());
  }
  recorder.mark("hold </script>\"");
  recorder.add_frame(none(), none(), none(), none(), none());
  const std::string page = *recorder.page(), json = element(page, "scene");
  CHECK(json.find("\"marks\":[[0,\"close\"],[3,\"hold ") != std::string::npos);
  CHECK(count(page, "<script") == count(page, "</script>"));
}

TEST_CASE("a vertex that is not finite stays where it was", "[html_player]") {
  PlayerRecorder recorder(PlayerScene{}, 2, 0, 0);
  Points<double> x(3, 2);
  x << 0, 1, 0, 1, 0, 1;
  recorder.add_frame(x, none(), none(), none(), none());
  x(0, 1) = std::numeric_limits<double>::quiet_NaN();
  x(1, 1) = std::numeric_limits<double>::infinity();
  x(2, 1) = -1e30;
  recorder.add_frame(x, none(), none(), none(), none());
  const std::vector<std::uint8_t> bytes = data(*recorder.page(), "positions");
  REQUIRE(bytes.size() == 24);
  for (std::size_t i = 0; i < 12; ++i) CHECK(bytes[12 + i] == bytes[i]);
  CHECK(triple(element(*recorder.page(), "scene"), "size") == Eigen::Vector3d(1, 1, 1));
}

TEST_CASE("one bad coordinate makes the whole vertex stay", "[html_player]") {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), -std::numeric_limits<double>::infinity(), 2e6}) {
    for (Index broken = 0; broken < 3; ++broken) {
      PlayerRecorder recorder(PlayerScene{}, 2, 0, 0);
      Points<double> x(3, 2);
      x << 0, 8, 0, 8, 0, 8;
      recorder.add_frame(x, none(), none(), none(), none());
      x.col(0) << 1, 5, 2;
      x(broken, 0) = bad;
      recorder.add_frame(x, none(), none(), none(), none());
      x.col(0) << 1, 5, 2;
      recorder.add_frame(x, none(), none(), none(), none());
      const std::vector<std::uint8_t> bytes = data(*recorder.page(), "positions");
      REQUIRE(bytes.size() == 36);
      for (std::size_t i = 0; i < 12; ++i) CHECK(bytes[12 + i] == bytes[i]);
      CHECK(bytes[25] == 32);  // when it is finite again, it moves: 1/8 of the way is 8192 = 32·256
      // In the first frame there is no earlier position.
      PlayerRecorder first(PlayerScene{}, 2, 0, 0);
      x(broken, 0) = bad;
      first.add_frame(x, none(), none(), none(), none());
      const std::vector<std::uint8_t> origin = data(*first.page(), "positions");
      for (std::size_t i = 0; i < 6; ++i) CHECK(origin[i] == 0);
    }
  }
}

TEST_CASE("flat and empty scenes are written", "[html_player]") {
  PlayerRecorder flat(PlayerScene{}, 1, 0, 0);
  flat.add_frame(Eigen::Vector3d(1, 2, 3), none(), none(), none(), none());
  CHECK(data(*flat.page(), "positions") == std::vector<std::uint8_t>(6, 0));
  PlayerRecorder empty(PlayerScene{}, 0, 0, 0);
  empty.add_frame(none(), none(), none(), none(), none());
  CHECK(empty.page().has_value());
}

TEST_CASE("the recorder's errors name the index", "[html_player]") {
  PlayerRecorder silent(PlayerScene{}, 1, 0, 0);
  CHECK(silent.page().error() == "no frame was recorded");

  PlayerRecorder wrong = small_recording();
  wrong.add_frame(cloud(0, 5, 1), cloud(0, 2, 1), cloud(0, 2, 1), cloud(0, 3, 1), cloud(0, 3, 1));
  CHECK(wrong.page().error() == "frame 7: expected 12 positions, found 5");

  PlayerScene off = small_scene();
  off.triangles.push_back({0, 1, 12});
  CHECK(small_recording(off).page().error() ==
        "triangle 2: vertex 12 is off the mesh of 12 vertices");
  off = small_scene();
  off.segments[0][0] = -1;
  CHECK(small_recording(off).page().error() ==
        "segment 0: vertex -1 is off the mesh of 12 vertices");
  off = small_scene();
  off.dt = 0;
  CHECK(small_recording(off).page().error() == "dt is 0, expected a positive number");
  off.dt = std::numeric_limits<double>::quiet_NaN();
  CHECK(!small_recording(off).page().has_value());
}

TEST_CASE("write writes the page to a file or returns the reason", "[html_player]") {
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const std::string path = (folder / "clothctl_player.html").string();
  const PlayerRecorder recorder = small_recording();
  const auto written = recorder.write(path);
  REQUIRE(written.has_value());
  CHECK(*written == std::filesystem::file_size(path));
  CHECK(*clothctl::read_file(path) == *recorder.page());
  std::filesystem::remove(path);
  const std::string nowhere = (folder / "clothctl_no_such_folder" / "player.html").string();
  CHECK(recorder.write(nowhere).error().rfind(nowhere + ": cannot be written", 0) == 0);
}

TEST_CASE("the size of the page is within its budget", "[html_player]") {
  PlayerRecorder recorder(PlayerScene{}, 33 * 33, 2, 2);
  recorder.reserve(300);
  for (int f = 0; f < 300; ++f)
    recorder.add_frame(cloud(f, 33 * 33, 1), cloud(f, 2, 1), cloud(f, 2, 1), cloud(f, 2, 1),
                       cloud(f, 2, 1));
  CHECK(recorder.page()->size() <
        2'800'000);  // 33·33·300 vertices of 6 bytes, plus a third for base64
}

TEST_CASE("a negative or too large number of frames to reserve is reported", "[io]") {
  using namespace clothctl;
  for (const Index bad : {Index(-1), (std::numeric_limits<Index>::max)()}) {
    PlayerRecorder player(PlayerScene(), 4, 0, 0);
    player.reserve(bad);
    const Points<double> four = Points<double>::Zero(3, 4), none(3, 0);
    player.add_frame(four, none, none, none, none);
    const Result<std::string> page = player.page();
    REQUIRE_FALSE(page.has_value());
    CHECK(page.error() == "reserve: a number of frames cannot be " + std::to_string(bad));
  }
  PlayerRecorder player(PlayerScene(), 4, 0, 0);
  player.reserve(0);
  player.reserve(3);
  const Points<double> four = Points<double>::Zero(3, 4), none(3, 0);
  player.add_frame(four, none, none, none, none);
  CHECK(player.page().has_value());
}
