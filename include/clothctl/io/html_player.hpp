#pragma once

// Writes a recorded motion as one web page that opens from disk without network or other files. It
// shows the mesh in space, target and actual curves of the features, arrows at the grips, an error
// plot and a table of figures.
//
// The page stores vertex coordinates x_c on axis c as 16-bit integers q_c, relative to the bounding
// box (low, size) of the whole motion:
//
//   q_c = round(65535 (x_c - low_c) / size_c),    |x_c - decoded_c| ≤ size_c / 131070
//
// The error is 0.008 mm for a box of one metre. A vertex takes 6 bytes in each frame, 8 after
// base64. Features and arrows are stored as 32-bit floats.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/detail/base64.hpp"
#include "clothctl/io/detail/player_control_script.hpp"
#include "clothctl/io/detail/player_data_script.hpp"
#include "clothctl/io/detail/player_markup.hpp"
#include "clothctl/io/detail/player_plot_script.hpp"
#include "clothctl/io/detail/player_render_script.hpp"
#include "clothctl/io/detail/player_style.hpp"
#include "clothctl/io/detail/player_text.hpp"
#include "clothctl/io/detail/player_view_script.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/player_scene.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Collects the frames of a motion and writes them as a player page. Recording allocates, so call
/// it in the loop of a program, not in a step. After a wrong argument, `page` and `write` fail with
/// a line that names the first one.
class PlayerRecorder {
 public:
  /// Starts a recording whose frames have `vertex_count` vertices, `feature_count` features and
  /// `arrow_count` arrows.
  PlayerRecorder(PlayerScene scene, Index vertex_count, Index feature_count, Index arrow_count)
      : scene_(std::move(scene)),
        vertices_(vertex_count),
        features_(feature_count),
        arrows_(arrow_count) {}

  /// Returns the scene. Its texts and figures may change until the page is written.
  PlayerScene& scene() { return scene_; }
  /// Returns the scene.
  const PlayerScene& scene() const { return scene_; }
  /// Names what happens from the next frame on, until the next mark: the page shows it in the view
  /// and marks the frame in the plot. The text of the last mark again changes nothing, so it may be
  /// called in each frame. Marks without a frame after them are not shown. Allocates.
  void mark(const std::string& text) {
    if (marks_.empty() || marks_.back().second != text) marks_.emplace_back(frames_, text);
  }
  /// Returns the number of frames so far.
  Index frame_count() const { return frames_; }
  /// Reserves the memory of the vertices in `frames` frames: 12 bytes for each vertex and frame. A
  /// negative number, or one whose memory exceeds 2^40 bytes, is a wrong argument.
  void reserve(Index frames) {
    constexpr Index kMost = (Index(1) << 40) / 12;
    if (frames < 0 || (vertices_ > 0 && frames > kMost / vertices_)) {
      if (mistake_.empty())
        mistake_ = "reserve: a number of frames cannot be " + std::to_string(frames);
      return;
    }
    if (vertices_ > 0) positions_.reserve(static_cast<std::size_t>(frames * vertices_ * 3));
  }

  /// Appends a frame: `positions` of the vertices (3×vertex_count, m), positions of the features
  /// and of their targets (3×feature_count each, m), origins (3×arrow_count, m) and vectors
  /// (3×arrow_count, in the arrow unit of the scene) of the arrows. If a coordinate of a vertex is
  /// not finite or beyond ±1e6 m, the vertex stays where it was in the previous frame (in the first
  /// frame: at the origin). The page does not draw features and arrows that are not finite.
  /// Allocates.
  void add_frame(const PointsView<double>& positions, const PointsView<double>& actual_features,
                 const PointsView<double>& target_features, const PointsView<double>& arrow_origins,
                 const PointsView<double>& arrow_vectors) {
    expect(positions.cols(), vertices_, "positions");
    expect(actual_features.cols(), features_, "actual features");
    expect(target_features.cols(), features_, "target features");
    expect(arrow_origins.cols(), arrows_, "arrow origins");
    expect(arrow_vectors.cols(), arrows_, "arrow vectors");
    if (!mistake_.empty()) return;
    const std::size_t row = static_cast<std::size_t>(vertices_) * 3;
    for (Index j = 0; j < vertices_; ++j) {
      bool held = false;
      for (Index c = 0; c < 3; ++c)
        held = held || !is_finite(positions(c, j)) || std::abs(positions(c, j)) > 1e6;
      for (Index c = 0; c < 3; ++c) {
        const float last = held && frames_ > 0 ? positions_[positions_.size() - row] : 0.0f;
        positions_.push_back(held ? last : static_cast<float>(positions(c, j)));
      }
    }
    append(actual_features, actual_);
    append(target_features, target_);
    append(arrow_origins, origins_);
    append(arrow_vectors, vectors_);
    ++frames_;
  }

  /// Returns the page as text. Allocates. Complexity: O(frames · vertices). Fails when: there is no
  /// frame, an argument of a call was wrong, dt is not positive, or an index is off the mesh.
  Result<std::string> page() const {
    if (std::string wrong = find_mistake(); !wrong.empty()) return Error{std::move(wrong)};
    std::array<float, 3> low{}, size{};
    bounding_box(low, size);
    std::string text = detail::kPlayerHead;
    detail::append_html(scene_.title, text);
    text.append("</title>\n<style>")
        .append(detail::kPlayerStyle)
        .append(detail::kPlayerStyleNarrow);
    text.append("</style>\n</head>\n<body>").append(detail::kPlayerBody);
    text.append("<script type=\"application/json\" id=\"scene\">");
    append_scene(low, size, text);
    text.append("</script>\n");
    append_data("positions", quantised(low, size), text);
    append_data("triangles", index_bytes(scene_.triangles), text);
    append_data("segments", index_bytes(scene_.segments), text);
    std::vector<float> solids;
    append(scene_.solids, solids);
    append_data("solids", float_bytes(solids), text);
    append_data("actual", float_bytes(actual_), text);
    append_data("target", float_bytes(target_), text);
    append_data("origins", float_bytes(origins_), text);
    append_data("vectors", float_bytes(vectors_), text);
    text.append("<script>\n(() => {\n'use strict';\n").append(detail::kPlayerDataScript);
    text.append(detail::kPlayerShaders)
        .append(detail::kPlayerGeometryScript)
        .append(detail::kPlayerRenderScript);
    text.append(detail::kPlayerPlotScript).append(detail::kPlayerControlScript);
    text.append("})();\n</script>\n</body>\n</html>\n");
    return text;
  }

  /// Writes the page to a file and returns the number of bytes. Allocates. Fails when: `page`
  /// fails, or the file cannot be written.
  Result<std::size_t> write(const std::string& path) const {
    const Result<std::string> text = page();
    if (!text) return Error{path + ": " + text.error()};
    return write_file(path, *text);
  }

 private:
  void expect(Index found, Index wanted, const char* what) {
    if (found == wanted || !mistake_.empty()) return;
    mistake_ = "frame " + std::to_string(frames_) + ": expected " + std::to_string(wanted) + " " +
               what + ", found " + std::to_string(found);
  }

  std::string find_mistake() const {
    if (!mistake_.empty()) return mistake_;
    if (frames_ == 0) return "no frame was recorded";
    if (!is_finite(scene_.dt) || !(scene_.dt > 0))
      return "dt is " + number_text(scene_.dt) + ", expected a positive number";
    if (std::string wrong = bad_index(scene_.triangles, "triangle"); !wrong.empty()) return wrong;
    if (scene_.solids.cols() % 3 != 0 || !all_finite(scene_.solids))
      return "the solids have " + std::to_string(scene_.solids.cols()) +
             " corners, expected three finite ones a triangle";
    return bad_index(scene_.segments, "segment");
  }

  template <class Cells>
  std::string bad_index(const Cells& cells, const char* what) const {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      for (const int v : cells[i]) {
        if (v >= 0 && v < vertices_) continue;
        return std::string(what) + " " + std::to_string(i) + ": vertex " + std::to_string(v) +
               " is off the mesh of " + std::to_string(vertices_) + " vertices";
      }
    }
    return {};
  }

  static void append(const PointsView<double>& points, std::vector<float>& out) {
    for (Index j = 0; j < points.cols(); ++j) {
      for (Index c = 0; c < 3; ++c) out.push_back(static_cast<float>(points(c, j)));
    }
  }

  void bounding_box(std::array<float, 3>& low, std::array<float, 3>& size) const {
    for (std::size_t c = 0; c < 3 && !positions_.empty(); ++c) {
      float least = positions_[c], most = positions_[c];
      for (std::size_t i = c; i < positions_.size(); i += 3) {
        least = (std::min)(least, positions_[i]);
        most = (std::max)(most, positions_[i]);
      }
      low[c] = least;
      size[c] = most - least;
    }
  }

  std::vector<std::uint8_t> quantised(const std::array<float, 3>& low,
                                      const std::array<float, 3>& size) const {
    std::vector<std::uint8_t> bytes;
    bytes.reserve(positions_.size() * 2);
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      const std::size_t c = i % 3;
      const double share =
          size[c] > 0 ? (double(positions_[i]) - double(low[c])) / double(size[c]) : 0.0;
      const auto step =
          static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * 65535.0));
      bytes.push_back(static_cast<std::uint8_t>(step & 255u));
      bytes.push_back(static_cast<std::uint8_t>(step >> 8));
    }
    return bytes;
  }

  static void append_word(std::uint32_t word, std::vector<std::uint8_t>& bytes) {
    for (int shift = 0; shift < 32; shift += 8)
      bytes.push_back(static_cast<std::uint8_t>((word >> shift) & 255u));
  }

  template <class Cells>
  static std::vector<std::uint8_t> index_bytes(const Cells& cells) {
    std::vector<std::uint8_t> bytes;
    for (const auto& cell : cells) {
      for (const int v : cell) append_word(static_cast<std::uint32_t>(v), bytes);
    }
    return bytes;
  }

  static std::vector<std::uint8_t> float_bytes(const std::vector<float>& values) {
    std::vector<std::uint8_t> bytes;
    bytes.reserve(values.size() * 4);
    for (const float value : values) append_word(std::bit_cast<std::uint32_t>(value), bytes);
    return bytes;
  }

  static void append_data(const char* name, const std::vector<std::uint8_t>& bytes,
                          std::string& text) {
    text.append("<script type=\"application/octet-stream\" id=\"data-").append(name).append("\">");
    detail::append_base64(bytes, text);
    text.append("</script>\n");
  }

  void append_scene(const std::array<float, 3>& low, const std::array<float, 3>& size,
                    std::string& text) const {
    const auto triple = [&text](const char* key, const std::array<float, 3>& v) {
      text.append(key);
      for (std::size_t c = 0; c < 3; ++c)
        text.append(c == 0 ? "[" : ",").append(number_text(double(v[c])));
      text.append("]");
    };
    const auto words = [&text](const char* key, const std::string& value) {
      text.append(key);
      detail::append_json(value, text);
    };
    words("{\"title\":", scene_.title);
    words(",\"subtitle\":", scene_.subtitle);
    text.append(",\"dt\":")
        .append(number_text(scene_.dt))
        .append(",\"frames\":")
        .append(std::to_string(frames_));
    text.append(",\"vertices\":")
        .append(std::to_string(vertices_))
        .append(",\"arrows\":")
        .append(std::to_string(arrows_));
    text.append(",\"scored\":").append(std::to_string(scene_.scored_frames));
    triple(",\"low\":", low);
    triple(",\"size\":", size);
    words(",\"meshName\":", scene_.mesh_name);
    words(",\"arrowName\":", scene_.arrow_name);
    words(",\"arrowUnit\":", scene_.arrow_unit);
    text.append(",\"features\":[");
    for (std::size_t k = 0; k < static_cast<std::size_t>(features_); ++k) {
      words(k == 0 ? "" : ",",
            k < scene_.feature_names.size() ? scene_.feature_names[k] : std::string());
    }
    text.append("],\"figures\":[");
    for (std::size_t i = 0; i < scene_.figures.size(); ++i) {
      words(i == 0 ? "[" : ",[", scene_.figures[i].first);
      words(",", scene_.figures[i].second);
      text.append("]");
    }
    text.append("],\"marks\":[");
    for (std::size_t i = 0; i < marks_.size(); ++i) {
      text.append(i == 0 ? "[" : ",[").append(std::to_string(marks_[i].first));
      words(",", marks_[i].second);
      text.append("]");
    }
    text.append("]}");
  }

  PlayerScene scene_;
  Index vertices_ = 0;
  Index features_ = 0;
  Index arrows_ = 0;
  Index frames_ = 0;
  std::string mistake_;
  std::vector<std::pair<Index, std::string>> marks_;
  std::vector<float> positions_;
  std::vector<float> actual_;
  std::vector<float> target_;
  std::vector<float> origins_;
  std::vector<float> vectors_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
