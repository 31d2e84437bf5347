// Distances, stretch and crossings of a sheet.

#include "judge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace versus {

namespace {

using Point = std::array<double, 3>;

/// A point is sampled at multiples of this share of a triangle's corners.
constexpr int kParts = 4;

Point at(const std::vector<double>& positions, int v) {
  const double* p = positions.data() + 3 * v;
  return {p[0], p[1], p[2]};
}

Point minus(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

double length(const Point& a) { return std::hypot(a[0], a[1], a[2]); }

/// Six times the volume of a tetrahedron, with a sign.
double volume(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Point u = minus(b, a), v = minus(c, a), w = minus(d, a);
  return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
         u[2] * (v[0] * w[1] - v[1] * w[0]);
}

struct Box {
  Point low, high;

  bool meets(const Box& other) const {
    for (std::size_t c = 0; c < 3; ++c) {
      if (high[c] < other.low[c] || other.high[c] < low[c]) return false;
    }
    return true;
  }
};

template <std::size_t N>
Box box_of(const std::array<Point, N>& points) {
  Box box{points[0], points[0]};
  for (const Point& p : points) {
    for (std::size_t c = 0; c < 3; ++c) {
      box.low[c] = std::min(box.low[c], p[c]);
      box.high[c] = std::max(box.high[c], p[c]);
    }
  }
  return box;
}

bool pierces(const std::array<Point, 2>& e, const std::array<Point, 3>& t) {
  const double above = volume(t[0], t[1], t[2], e[0]), below = volume(t[0], t[1], t[2], e[1]);
  if (!(above * below < 0)) return false;
  const double a = volume(e[0], e[1], t[0], t[1]), b = volume(e[0], e[1], t[1], t[2]),
               c = volume(e[0], e[1], t[2], t[0]);
  return (a > 0 && b > 0 && c > 0) || (a < 0 && b < 0 && c < 0);
}

}  // namespace

double distance(const Obstacle& obstacle, const double* point) {
  if (!obstacle.box) return std::hypot(point[0], point[1], point[2]) - obstacle.size;
  double outside = 0, inside = -std::numeric_limits<double>::infinity();
  for (int c = 0; c < 3; ++c) {
    const double over = std::abs(point[c]) - obstacle.size;
    inside = std::max(inside, over);
    if (over > 0) outside += over * over;
  }
  return inside < 0 ? inside : std::sqrt(outside);
}

Clearance clearance(const Scene& scene, const std::vector<double>& positions) {
  Clearance least{std::numeric_limits<double>::infinity(), 0};
  for (int v = 0; v < scene.n(); ++v)
    least.vertices = std::min(least.vertices, distance(scene.obstacle, positions.data() + 3 * v));
  least.points = least.vertices;
  for (const auto& t : scene.triangles) {
    const Point a = at(positions, t[0]), b = at(positions, t[1]), c = at(positions, t[2]);
    for (int i = 0; i <= kParts; ++i) {
      for (int j = 0; i + j <= kParts; ++j) {
        const double u = static_cast<double>(i) / kParts, v = static_cast<double>(j) / kParts;
        Point p;
        for (std::size_t k = 0; k < 3; ++k) p[k] = (1 - u - v) * a[k] + u * b[k] + v * c[k];
        least.points = std::min(least.points, distance(scene.obstacle, p.data()));
      }
    }
  }
  return least;
}

double stretch(const Scene& scene, const std::vector<double>& positions) {
  double most = -1;
  for (const Edge& e : scene.edges) {
    const double rest = length(minus(at(scene.positions, e.b), at(scene.positions, e.a)));
    most = std::max(most, length(minus(at(positions, e.b), at(positions, e.a))) / rest - 1);
  }
  return most;
}

int crossings(const Scene& scene, const std::vector<double>& positions) {
  struct Face {
    std::array<Point, 3> corners;
    Box box;
    std::array<int, 3> vertex;
  };
  std::vector<Face> faces;
  for (const auto& t : scene.triangles) {
    const std::array<Point, 3> corners{at(positions, t[0]), at(positions, t[1]),
                                       at(positions, t[2])};
    faces.push_back({corners, box_of(corners), t});
  }
  int count = 0;
  for (const Edge& e : scene.edges) {
    const std::array<Point, 2> ends{at(positions, e.a), at(positions, e.b)};
    const Box box = box_of(ends);
    for (const Face& f : faces) {
      if (!box.meets(f.box)) continue;
      if (std::any_of(f.vertex.begin(), f.vertex.end(),
                      [&](int v) { return v == e.a || v == e.b; }))
        continue;
      if (pierces(ends, f.corners)) ++count;
    }
  }
  return count;
}

}  // namespace versus
