#pragma once

// A recorded motion as one web page that opens from disk, without network or other files: the mesh in space, target and actual
// curves, arrows at the grips, an error plot and a table of figures.
//
// Coordinates of vertices are stored as 16-bit steps of the bounding box of the whole motion, per axis c
//
//   q_c = round(65535 (x_c - low_c) / size_c),    |x_c - decoded_c| ≤ size_c / 131070,
//
// 0.008 mm for a box of one metre: 6 bytes a vertex and frame, 8 after base64. Features and arrows stay 32-bit floats.

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
#include "clothctl/io/base64.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/player_control_script.hpp"
#include "clothctl/io/player_data_script.hpp"
#include "clothctl/io/player_markup.hpp"
#include "clothctl/io/player_plot_script.hpp"
#include "clothctl/io/player_render_script.hpp"
#include "clothctl/io/player_scene.hpp"
#include "clothctl/io/player_style.hpp"
#include "clothctl/io/player_text.hpp"
#include "clothctl/io/player_view_script.hpp"

namespace clothctl {

/// Gathers the frames of a motion and writes them as a player page.
///
/// Recording allocates; it belongs into a program's loop, not into a step.
class PlayerRecorder {
 public:
  /// Starts a recording of `vertex_count` vertices, `feature_count` features and `arrow_count` arrows a frame.
  PlayerRecorder(PlayerScene scene, Index vertex_count, Index feature_count, Index arrow_count)
      : scene_(std::move(scene)), vertices_(vertex_count), features_(feature_count), arrows_(arrow_count) {}

  /// The scene; figures and texts may be set until the page is written.
  PlayerScene& scene() { return scene_; }
  /// The scene.
  const PlayerScene& scene() const { return scene_; }
  /// Number of frames so far.
  Index frame_count() const { return frames_; }
  /// Makes room for a number of frames. Allocates: 12 bytes a vertex and frame.
  void reserve(Index frames) { positions_.reserve(static_cast<std::size_t>(frames * vertices_ * 3)); }

  /// Appends a frame: `positions` of the vertices (3×vertex_count, m), of the features and their targets (3×feature_count, m),
  /// tails and vectors of the arrows (3×arrow_count; m and the scene's arrow unit). Allocates.
  /// A vertex with a coordinate that is not finite or beyond ±1e6 m is held where it was last (at first: the origin); features
  /// and arrows that are not finite are left out of the picture. A wrong number of columns is reported by `page` and `write`.
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
      for (Index c = 0; c < 3; ++c) held = held || !is_finite(positions(c, j)) || std::abs(positions(c, j)) > 1e6;
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

  /// The whole page as text. Allocates. Complexity: O(frames · vertices).
  /// Fails when: there is no frame, a frame had a wrong number of columns, dt is not positive, or an index is off the mesh.
  Result<std::string> page() const {
    if (std::string wrong = find_mistake(); !wrong.empty()) return Error{std::move(wrong)};
    std::array<float, 3> low{}, size{};
    bounding_box(low, size);
    std::string text = io_detail::kPlayerHead;
    io_detail::append_html(scene_.title, text);
    text.append("</title>\n<style>").append(io_detail::kPlayerStyle).append(io_detail::kPlayerStyleNarrow);
    text.append("</style>\n</head>\n<body>").append(io_detail::kPlayerBody);
    text.append("<script type=\"application/json\" id=\"scene\">");
    append_scene(low, size, text);
    text.append("</script>\n");
    append_data("positions", quantised(low, size), text);
    append_data("triangles", index_bytes(scene_.triangles), text);
    append_data("segments", index_bytes(scene_.segments), text);
    append_data("actual", float_bytes(actual_), text);
    append_data("target", float_bytes(target_), text);
    append_data("origins", float_bytes(origins_), text);
    append_data("vectors", float_bytes(vectors_), text);
    text.append("<script>\n(() => {\n'use strict';\n").append(io_detail::kPlayerDataScript);
    text.append(io_detail::kPlayerShaders).append(io_detail::kPlayerGeometryScript).append(io_detail::kPlayerRenderScript);
    text.append(io_detail::kPlayerPlotScript).append(io_detail::kPlayerControlScript);
    text.append("})();\n</script>\n</body>\n</html>\n");
    return text;
  }

  /// Writes the page to a file; answers with its number of bytes. Allocates.
  /// Fails when: as `page`, or the file cannot be written.
  Result<std::size_t> write(const std::string& path) const {
    const Result<std::string> text = page();
    if (!text) return Error{path + ": " + text.error()};
    return write_file(path, *text);
  }

 private:
  void expect(Index found, Index wanted, const char* what) {
    if (found == wanted || !mistake_.empty()) return;
    mistake_ = "frame " + std::to_string(frames_) + ": expected " + std::to_string(wanted) + " " + what + ", found " +
               std::to_string(found);
  }

  std::string find_mistake() const {
    if (!mistake_.empty()) return mistake_;
    if (frames_ == 0) return "no frame was recorded";
    if (!is_finite(scene_.dt) || !(scene_.dt > 0)) return "dt is " + number_text(scene_.dt) + ", expected a positive number";
    if (std::string wrong = bad_index(scene_.triangles, "triangle"); !wrong.empty()) return wrong;
    return bad_index(scene_.segments, "segment");
  }

  template <class Cells>
  std::string bad_index(const Cells& cells, const char* what) const {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      for (const int v : cells[i]) {
        if (v >= 0 && v < vertices_) continue;
        return std::string(what) + " " + std::to_string(i) + ": vertex " + std::to_string(v) + " is off the mesh of " +
               std::to_string(vertices_) + " vertices";
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

  std::vector<std::uint8_t> quantised(const std::array<float, 3>& low, const std::array<float, 3>& size) const {
    std::vector<std::uint8_t> bytes;
    bytes.reserve(positions_.size() * 2);
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      const std::size_t c = i % 3;
      const double share = size[c] > 0 ? (double(positions_[i]) - double(low[c])) / double(size[c]) : 0.0;
      const auto step = static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * 65535.0));
      bytes.push_back(static_cast<std::uint8_t>(step & 255u));
      bytes.push_back(static_cast<std::uint8_t>(step >> 8));
    }
    return bytes;
  }

  static void append_word(std::uint32_t word, std::vector<std::uint8_t>& bytes) {
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>((word >> shift) & 255u));
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

  static void append_data(const char* name, const std::vector<std::uint8_t>& bytes, std::string& text) {
    text.append("<script type=\"application/octet-stream\" id=\"data-").append(name).append("\">");
    append_base64(bytes, text);
    text.append("</script>\n");
  }

  void append_scene(const std::array<float, 3>& low, const std::array<float, 3>& size, std::string& text) const {
    const auto triple = [&text](const char* key, const std::array<float, 3>& v) {
      text.append(key);
      for (std::size_t c = 0; c < 3; ++c) text.append(c == 0 ? "[" : ",").append(number_text(double(v[c])));
      text.append("]");
    };
    const auto words = [&text](const char* key, const std::string& value) {
      text.append(key);
      io_detail::append_json(value, text);
    };
    words("{\"title\":", scene_.title);
    words(",\"subtitle\":", scene_.subtitle);
    text.append(",\"dt\":").append(number_text(scene_.dt)).append(",\"frames\":").append(std::to_string(frames_));
    text.append(",\"vertices\":").append(std::to_string(vertices_)).append(",\"arrows\":").append(std::to_string(arrows_));
    text.append(",\"scored\":").append(std::to_string(scene_.scored_frames));
    triple(",\"low\":", low);
    triple(",\"size\":", size);
    words(",\"meshName\":", scene_.mesh_name);
    words(",\"arrowName\":", scene_.arrow_name);
    words(",\"arrowUnit\":", scene_.arrow_unit);
    text.append(",\"features\":[");
    for (std::size_t k = 0; k < static_cast<std::size_t>(features_); ++k) {
      words(k == 0 ? "" : ",", k < scene_.feature_names.size() ? scene_.feature_names[k] : std::string());
    }
    text.append("],\"figures\":[");
    for (std::size_t i = 0; i < scene_.figures.size(); ++i) {
      words(i == 0 ? "[" : ",[", scene_.figures[i].first);
      words(",", scene_.figures[i].second);
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
  std::vector<float> positions_;
  std::vector<float> actual_;
  std::vector<float> target_;
  std::vector<float> origins_;
  std::vector<float> vectors_;
};

}  // namespace clothctl
