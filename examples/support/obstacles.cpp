#include "support/obstacles.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>
#include <system_error>
#include <utility>

#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/io/obj.hpp"
#include "support/inputs.hpp"

namespace program {

namespace {

/// Triangles as lists of corners.
class Drawing {
 public:
  void triangle(const Vec& a, const Vec& b, const Vec& c) {
    for (const Vec& p : {a, b, c}) corners_.push_back(p);
  }
  void quad(const Vec& a, const Vec& b, const Vec& c, const Vec& d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }
  /// A surface about the axis from `a` to `b`: rings of (way along the axis from `a`, radius).
  void turned(const Vec& a, const Vec& axis, const std::vector<std::array<double, 2>>& rings) {
    Vec t1, t2;
    clothctl::tangent_frame<double>(axis, t1, t2);
    constexpr int kSides = 48;
    const auto at = [&](std::size_t ring, int side) {
      const double angle = 2 * std::numbers::pi * side / kSides;
      return Vec(a + rings[ring][0] * axis +
                 rings[ring][1] * (std::cos(angle) * t1 + std::sin(angle) * t2));
    };
    for (std::size_t r = 0; r + 1 < rings.size(); ++r) {
      for (int s = 0; s < kSides; ++s) quad(at(r, s), at(r, s + 1), at(r + 1, s + 1), at(r + 1, s));
    }
  }
  /// A capsule; a ball where both ends are the same.
  void capsule(const Vec& a, const Vec& b, double radius) {
    const double length = (b - a).norm();
    const Vec axis = length > 0 ? Vec((b - a) / length) : Vec(0, 0, 1);
    std::vector<std::array<double, 2>> rings;
    constexpr int kRings = 12;
    for (int end = 0; end < 2; ++end) {
      for (int i = 0; i <= kRings; ++i) {
        const double angle = 0.5 * std::numbers::pi * (end == 0 ? i - kRings : i) / kRings;
        rings.push_back({end * length + radius * std::sin(angle), radius * std::cos(angle)});
      }
    }
    turned(a, axis, rings);
  }
  void box(const Vec& middle, const Vec& half) {
    for (int c = 0; c < 3; ++c) {
      for (const double side : {-1.0, 1.0}) {
        Vec out = Vec::Zero(), u = Vec::Zero(), v = Vec::Zero();
        out[c] = side * half[c];
        u[(c + 1) % 3] = half[(c + 1) % 3];
        v[(c + 2) % 3] = side * half[(c + 2) % 3];
        const Vec m = middle + out;
        quad(m - u - v, m + u - v, m + u + v, m - u + v);
      }
    }
  }
  Points corners() const {
    Points out(3, static_cast<Index>(corners_.size()));
    for (std::size_t i = 0; i < corners_.size(); ++i) out.col(static_cast<Index>(i)) = corners_[i];
    return out;
  }

 private:
  std::vector<Vec> corners_;
};

/// Returns the numbers behind "KIND:".
std::vector<double> read_numbers(const std::string& text, std::size_t count) {
  std::vector<double> out;
  std::string_view rest = std::string_view(text).substr(text.find(':') + 1);
  bool good = true;
  while (good && out.size() < count) {
    double value = 0;
    const auto read = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    good = read.ec == std::errc() && std::abs(value) <= 1000;
    rest.remove_prefix(static_cast<std::size_t>(read.ptr - rest.data()));
    out.push_back(value);
    if (out.size() < count) good = good && rest.starts_with(",");
    if (good && out.size() < count) rest.remove_prefix(1);
  }
  if (!good || !rest.empty())
    refuse("--obstacle: " + clothctl::quoted_text(text) + ", expected " + std::to_string(count) +
           " numbers within ±1000 behind the colon");
  return out;
}

Vec vec(const std::vector<double>& n, std::size_t at) { return Vec(n[at], n[at + 1], n[at + 2]); }

/// Makes and adds one obstacle.
class Builder {
 public:
  Builder(double friction, clothctl::World<double>& world, Drawing& drawing)
      : friction_(friction), world_(world), drawing_(drawing) {}

  void add(const std::string& text) {
    const std::string kind = text.substr(0, text.find(':'));
    if (kind == "sphere") {
      const std::vector<double> n = read_numbers(text, 4);
      put(text, clothctl::SphereCollider<double>::create(vec(n, 0), n[3]));
      drawing_.capsule(vec(n, 0), vec(n, 0), n[3]);
    } else if (kind == "box") {
      const std::vector<double> n = read_numbers(text, 6);
      put(text, clothctl::BoxCollider<double>::create(vec(n, 0), Vec(0.5 * vec(n, 3))));
      drawing_.box(vec(n, 0), 0.5 * vec(n, 3));
    } else if (kind == "capsule") {
      const std::vector<double> n = read_numbers(text, 7);
      put(text, clothctl::CapsuleCollider<double>::create(vec(n, 0), vec(n, 3), n[6]));
      drawing_.capsule(vec(n, 0), vec(n, 3), n[6]);
    } else if (kind == "cylinder") {
      const std::vector<double> n = read_numbers(text, 7);
      put(text, clothctl::CylinderCollider<double>::create(vec(n, 0), vec(n, 3), n[6]));
      const double length = (vec(n, 3) - vec(n, 0)).norm();
      drawing_.turned(vec(n, 0), (vec(n, 3) - vec(n, 0)) / length,
                      {{0, 0}, {0, n[6]}, {length, n[6]}, {length, 0}});
    } else if (kind == "floor") {
      const std::vector<double> n = read_numbers(text, 1);
      put(text, clothctl::PlaneCollider<double>::create(Vec(0, 0, n[0]), Vec(0, 0, 1)));
    } else if (text.ends_with(".obj")) {
      add_mesh(text);
    } else {
      refuse("--obstacle: " + clothctl::quoted_text(text) +
             " is none of sphere:, box:, capsule:, cylinder:, floor: and FILE.obj");
    }
  }

 private:
  template <class C>
  void put(const std::string& text, clothctl::Result<C> collider) {
    if (!collider) refuse("--obstacle: " + clothctl::quoted_text(text) + ": " + collider.error());
    must(world_.add_obstacle(std::move(collider).value(), {}, {friction_, 0}));
  }
  void add_mesh(const std::string& file) {
    const clothctl::PatternMesh mesh = must(clothctl::read_obj(file));
    put(file, clothctl::MeshCollider<double>::create(mesh.positions, mesh.triangles));
    for (const std::array<int, 3>& t : mesh.triangles) {
      drawing_.triangle(mesh.positions.col(t[0]), mesh.positions.col(t[1]),
                        mesh.positions.col(t[2]));
    }
  }

  double friction_;
  clothctl::World<double>& world_;
  Drawing& drawing_;
};

}  // namespace

Points add_obstacles(const std::vector<std::string>& texts, double friction,
                     clothctl::World<double>& world) {
  Drawing drawing;
  Builder builder(friction, world, drawing);
  for (const std::string& text : texts) builder.add(text);
  return drawing.corners();
}

}  // namespace program
