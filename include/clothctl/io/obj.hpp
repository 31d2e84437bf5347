#pragma once

// Triangle meshes as Wavefront OBJ text: `v x y z` is a vertex in space, `vt x y` a point of the
// flat pattern, `f` a face of references v, v/vt, v/vt/vn or v//vn. Indices start at 1; a negative
// one counts back from the last line of its kind. In files of this library both v and vt are in m.
//
// The reader accepts LF and CRLF, comments, lines continued by a backslash, faces of any number of
// corners, and skips normals, groups, materials, lines and points. A face of more than three
// corners is divided by cutting off ears in its plane (Newell's normal), the roundest ear first, so
// that concave faces keep their shape. Errors are one line `file:line: what is wrong`. The writer
// uses the fewest digits that read back as the same doubles.

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/mesh/pattern_mesh.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The largest number of corners that a face may have in a file.
inline constexpr std::size_t kObjLargestFace = 1000;

namespace detail {

/// Divides polygons into triangles.
class PolygonDivider {
 public:
  /// Appends the triangles of a polygon as positions 0 … n-1 of its corners. `corners` are in m.
  void divide(std::span<const Vector3<double>> corners, std::vector<std::array<int, 3>>& out) {
    flatten(corners);
    left_.resize(corners.size());
    for (std::size_t i = 0; i < left_.size(); ++i) left_[i] = static_cast<int>(i);
    while (left_.size() > 3) {
      const std::size_t ear = best_ear();
      out.push_back(triangle(ear));
      left_.erase(left_.begin() + static_cast<std::ptrdiff_t>(ear));
    }
    out.push_back(triangle(1));
  }

 private:
  using Flat = std::array<double, 2>;

  /// Projects the corners along the largest component of the polygon's normal.
  void flatten(std::span<const Vector3<double>> corners) {
    Vector3<double> normal = Vector3<double>::Zero();
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Vector3<double> p = corners[i] - corners[0],
                            q = corners[(i + 1) % corners.size()] - corners[0];
      normal += Vector3<double>(p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2],
                                p[0] * q[1] - p[1] * q[0]);
    }
    Index axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    const Index u = (axis + 1) % 3, w = (axis + 2) % 3;
    flat_.clear();
    for (const Vector3<double>& p : corners) {
      const Vector3<double> d = p - corners[0];
      flat_.push_back(normal[axis] < 0 ? Flat{d[w], d[u]} : Flat{d[u], d[w]});
    }
  }

  std::array<int, 3> triangle(std::size_t i) const {
    const std::size_t n = left_.size();
    return {left_[(i + n - 1) % n], left_[i], left_[(i + 1) % n]};
  }

  static double cross(const Flat& a, const Flat& b, const Flat& c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  }
  const Flat& at(int i) const { return flat_[static_cast<std::size_t>(i)]; }

  /// Returns the corner whose triangle is inside the polygon and roundest, or 0 if there is none.
  std::size_t best_ear() const {
    std::size_t best = 0;
    double most = -1;
    for (std::size_t i = 0; i < left_.size(); ++i) {
      const std::array<int, 3> t = triangle(i);
      const Flat &a = at(t[0]), &b = at(t[1]), &c = at(t[2]);
      const double doubled = cross(a, b, c);
      double squares = 0;
      for (const auto& [p, q] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)})
        squares += (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]);
      const double round = squares > 0 ? doubled / squares : 0;
      if (round > most && doubled > 0 && is_empty(t)) {
        most = round;
        best = i;
      }
    }
    return best;
  }

  bool is_empty(const std::array<int, 3>& t) const {
    const Flat &a = at(t[0]), &b = at(t[1]), &c = at(t[2]);
    for (const int v : left_) {
      if (v == t[0] || v == t[1] || v == t[2]) continue;
      const Flat& p = at(v);
      if (!(cross(a, b, p) < 0) && !(cross(b, c, p) < 0) && !(cross(c, a, p) < 0)) return false;
    }
    return true;
  }

  std::vector<Flat> flat_;
  std::vector<int> left_;
};

/// Reads one OBJ text.
class ObjReader {
 public:
  ObjReader(std::string_view text, std::string name) : text_(text), name_(std::move(name)) {}

  Result<PatternMesh> read() {
    if (text_.substr(0, 3) == "\xef\xbb\xbf") text_.remove_prefix(3);
    while (next_line()) {
      if (words_.empty()) continue;
      if (std::string wrong = read_line(); !wrong.empty())
        return Error{at_line(name_, line_) + wrong};
    }
    if (triangles_.empty())
      return Error{at_line(name_, (std::max)(line_, Index(1))) + "the file has no faces"};
    PatternMesh mesh;
    mesh.positions.resize(3, static_cast<Index>(positions_.size()));
    for (std::size_t v = 0; v < positions_.size(); ++v)
      mesh.positions.col(static_cast<Index>(v)) = positions_[v];
    mesh.triangles = std::move(triangles_);
    if (bare_faces_ == 0) {
      mesh.pattern =
          Eigen::Map<const FlatPoints>(pattern_.data(), 2, static_cast<Index>(pattern_.size() / 2));
      mesh.pattern_triangles = std::move(pattern_triangles_);
    }
    return mesh;
  }

 private:
  /// Splits the next line, with those that continue it, into words without its comment. Returns
  /// false at the end.
  bool next_line() {
    words_.clear();
    if (text_.empty()) return false;
    line_ += pending_lines_ + 1;
    pending_lines_ = 0;
    while (!text_.empty()) {
      const std::size_t end = text_.find('\n');
      std::string_view line = text_.substr(0, end);
      text_.remove_prefix(end == std::string_view::npos ? text_.size() : end + 1);
      line = trimmed(line.substr(0, line.find('#')));
      const bool more = line.ends_with('\\');
      if (more) line.remove_suffix(1);
      while (!(line = trimmed(line)).empty()) {
        const std::size_t word = (std::min)(line.find_first_of(kSpaces), line.size());
        words_.push_back(line.substr(0, word));
        line.remove_prefix(word);
      }
      if (!more) break;
      ++pending_lines_;
    }
    return true;
  }

  std::string read_line() {
    const std::string_view key = words_[0];
    if (key == "v") return read_vertex();
    if (key == "vt") return read_pattern_point();
    if (key == "f") return read_face();
    constexpr std::array<std::string_view, 18> skipped{
        "vn",    "vp",       "o",        "g",   "s",          "l",
        "p",     "usemtl",   "mtllib",   "mg",  "usemap",     "maplib",
        "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj"};
    for (const std::string_view known : skipped) {
      if (key == known) return {};
    }
    return in_quotes(key) + " is no keyword of a mesh";
  }

  /// Parses the words after the keyword into `numbers_`; `least` to `most` of them.
  std::string read_numbers(std::size_t least, std::size_t most) {
    if (words_.size() - 1 < least || words_.size() - 1 > most)
      return in_quotes(words_[0]) + " needs " + std::to_string(least) + " to " +
             std::to_string(most) + " numbers, found " + std::to_string(words_.size() - 1);
    for (std::size_t i = 1; i < words_.size(); ++i) {
      if (std::string wrong = parse_number(words_[i], numbers_[i - 1]); !wrong.empty())
        return wrong;
    }
    return {};
  }

  std::string read_vertex() {
    // A fourth number is a weight; three more are a colour.
    if (std::string wrong = read_numbers(3, 7); !wrong.empty()) return wrong;
    positions_.emplace_back(numbers_[0], numbers_[1], numbers_[2]);
    return {};
  }

  std::string read_pattern_point() {
    numbers_[1] = 0;
    if (std::string wrong = read_numbers(1, 3); !wrong.empty()) return wrong;
    pattern_.insert(pattern_.end(), {numbers_[0], numbers_[1]});
    return {};
  }

  /// Parses one index of `what` from the front of `text`, up to a slash or the end.
  static std::string read_index(std::string_view& text, std::size_t count, const char* what,
                                int& index) {
    const std::string_view digits = text.substr(0, text.find('/'));
    long long value = 0;
    const auto end = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (end.ec != std::errc() || end.ptr != digits.data() + digits.size())
      return in_quotes(digits) + " is not an index of a " + what;
    const long long all = static_cast<long long>(count);
    if (value == 0 || value > all || value < -all)
      return "index " + std::to_string(value) + " is off the " + std::to_string(count) + " " +
             what +
             (count == 1       ? ""
              : what[0] == 'v' ? " lines so far"
                               : "s so far");
    index = static_cast<int>(value > 0 ? value - 1 : all + value);
    text.remove_prefix(digits.size());
    return {};
  }

  std::string read_corner(std::string_view word, bool& has_pattern) {
    int v = 0, t = -1;
    if (std::string wrong = read_index(word, positions_.size(), "vertex", v); !wrong.empty())
      return wrong;
    if (!word.empty()) word.remove_prefix(1);
    if (!word.empty() && word[0] != '/') {
      if (std::string wrong = read_index(word, pattern_.size() / 2, "texture point", t);
          !wrong.empty())
        return wrong;
    }
    has_pattern = has_pattern && t >= 0;
    for (const int other : face_) {
      if (other == v) return "face holds vertex " + std::to_string(v + 1) + " twice";
    }
    face_.push_back(v);
    face_pattern_.push_back(t);
    return {};
  }

  std::string read_face() {
    const std::size_t n = words_.size() - 1;
    if (n < 3) return "a face needs at least 3 corners, found " + std::to_string(n);
    if (n > kObjLargestFace)
      return "a face of " + std::to_string(n) + " corners is too large, at most " +
             std::to_string(kObjLargestFace) + " are read";
    face_.clear();
    face_pattern_.clear();
    bool has_pattern = true;
    for (std::size_t i = 1; i <= n; ++i) {
      if (std::string wrong = read_corner(words_[i], has_pattern); !wrong.empty()) return wrong;
    }
    corners_.clear();
    for (const int v : face_) corners_.push_back(positions_[static_cast<std::size_t>(v)]);
    pieces_.clear();
    divider_.divide(corners_, pieces_);
    for (const std::array<int, 3>& piece : pieces_) {
      const auto pick = [&piece](const std::vector<int>& from) {
        return std::array<int, 3>{from[static_cast<std::size_t>(piece[0])],
                                  from[static_cast<std::size_t>(piece[1])],
                                  from[static_cast<std::size_t>(piece[2])]};
      };
      triangles_.push_back(pick(face_));
      if (has_pattern) pattern_triangles_.push_back(pick(face_pattern_));
    }
    bare_faces_ += has_pattern ? 0 : 1;
    return {};
  }

  std::string_view text_;
  std::string name_;
  Index line_ = 0, pending_lines_ = 0;
  std::vector<std::string_view> words_;
  std::array<double, 7> numbers_{};
  std::vector<Vector3<double>> positions_;
  std::vector<double> pattern_;
  std::vector<std::array<int, 3>> triangles_, pattern_triangles_;
  std::size_t bare_faces_ = 0;  // faces without texture points
  std::vector<int> face_, face_pattern_;
  std::vector<Vector3<double>> corners_;
  std::vector<std::array<int, 3>> pieces_;
  PolygonDivider divider_;
};

}  // namespace detail

/// Parses a mesh from OBJ text. `name` is the name of the file in messages. The mesh has a pattern
/// if all faces have texture points. Vertices without a face stay, so that the indices are those of
/// the file less one. Allocates. Complexity: O(length), and O(corners²) for a large face. Fails
/// when: a keyword is unknown, a number or index is wrong, a face has fewer than 3 or more than
/// `kObjLargestFace` corners or a vertex twice or refers to a vertex that comes later, or there is
/// no face.
template <class = void>
Result<PatternMesh> parse_obj(std::string_view text, const std::string& name) {
  return detail::ObjReader(text, name).read();
}

/// Reads a mesh from a file with `parse_obj`. Allocates. Fails when: the file cannot be read, or
/// `parse_obj` fails.
template <class = void>
Result<PatternMesh> read_obj(const std::string& path) {
  const Result<std::string> text = read_file(path);
  if (!text) return Error{text.error()};
  return parse_obj(*text, path);
}

/// Returns a mesh as OBJ text. `parse_obj` reads the same mesh back to the last bit. Allocates.
/// Fails when: `mesh.validate()` finds a fault, or a triangle has a vertex twice.
template <class = void>
Result<std::string> obj_text(const PatternMesh& mesh) {
  if (std::string wrong = mesh.validate(); !wrong.empty()) return Error{std::move(wrong)};
  std::string text;
  const auto add = [&text](char before, auto value) {
    std::array<char, 32> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    text += before;
    text.append(digits.data(), end.ptr);
  };
  const auto add_points = [&](const char* key, const auto& points) {
    for (Index v = 0; v < points.cols(); ++v) {
      text += key;
      for (Index c = 0; c < points.rows(); ++c) add(' ', double(points(c, v)));
      text += '\n';
    }
  };
  add_points("v", mesh.positions);
  if (mesh.has_pattern()) add_points("vt", mesh.pattern);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::array<int, 3>& corner = mesh.triangles[t];
    text += 'f';
    for (std::size_t i = 0; i < 3; ++i) {
      if (corner[i] == corner[(i + 1) % 3])
        return Error{"triangle " + std::to_string(t) + " holds vertex " +
                     std::to_string(corner[i]) + " twice"};
      add(' ', corner[i] + 1);
      if (mesh.has_pattern()) add('/', mesh.pattern_triangles[t][i] + 1);
    }
    text += '\n';
  }
  return text;
}

/// Writes a mesh to a file and returns the number of bytes. Allocates. Fails when: `obj_text`
/// fails, or the file cannot be written.
inline Result<std::size_t> write_obj(const std::string& path, const PatternMesh& mesh) {
  const Result<std::string> text = obj_text(mesh);
  if (!text) return Error{path + ": " + text.error()};
  return write_file(path, *text);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
