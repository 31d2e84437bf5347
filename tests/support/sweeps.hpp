#pragma once

// Helpers of the tests of position-based sheets: random numbers, an irregular sheet, and sweeps
// over constraints one after the other in plain scalar code.

#include <array>
#include <cmath>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl_test {

/// Uniform random numbers, the same with every standard library.
class Numbers {
 public:
  explicit Numbers(unsigned seed) : bits_(seed) {}
  /// Returns a number between `low` and `high`.
  double operator()(double low, double high) {
    return low + (high - low) * (static_cast<double>(bits_()) / 4294967296.0);
  }
  /// Returns 0 … count-1.
  int below(int count) { return static_cast<int>(bits_() % static_cast<unsigned>(count)); }
  /// Shuffles a list.
  template <class Item>
  void shuffle(std::vector<Item>& list) {
    for (std::size_t i = list.size(); i > 1; --i)
      std::swap(list[i - 1], list[static_cast<std::size_t>(below(static_cast<int>(i)))]);
  }

 private:
  std::mt19937 bits_;
};

/// A point and its inverse mass.
struct PlainPoint {
  clothctl::Vector3<double> at = clothctl::Vector3<double>::Zero();
  double w = 1.0;
};

/// An edge in plain code.
struct PlainEdge {
  std::size_t a = 0, b = 0;
  double rest = 1.0, relaxation = 1.0, stiffness = 0.0, damping = 0.0;
  double multiplier = 0.0;
};

/// Moves both ends to the rest length, as far as the relaxation says.
inline void project_rigid(const PlainEdge& edge, std::vector<PlainPoint>& points) {
  PlainPoint &a = points[edge.a], &b = points[edge.b];
  if (!(0.0 < a.w + b.w)) return;
  const clothctl::Vector3<double> d = b.at - a.at;
  const clothctl::Vector3<double> move =
      edge.relaxation * (d.norm() - edge.rest) / (a.w + b.w) * d.normalized();
  a.at += a.w * move;
  b.at -= b.w * move;
}

/// One XPBD visit with substep h; `start` holds the points at the start of the substep.
inline void project_compliant(PlainEdge& edge, double h, const std::vector<PlainPoint>& start,
                              std::vector<PlainPoint>& points) {
  PlainPoint &a = points[edge.a], &b = points[edge.b];
  const clothctl::Vector3<double> n = (b.at - a.at).normalized();
  const double k = h * h * edge.stiffness, c = h * edge.damping;
  const double length = (b.at - a.at).norm();
  const double advance = length - n.dot(start[edge.b].at - start[edge.a].at);
  const double change =
      -(k * (length - edge.rest) + edge.multiplier + c * advance) / ((k + c) * (a.w + b.w) + 1.0);
  edge.multiplier += change;
  a.at -= a.w * change * n;
  b.at += b.w * change * n;
}

/// Σ m x and Σ m x × v of points with positive inverse masses.
template <class Displacements>
std::array<clothctl::Vector3<double>, 2> momenta(const std::vector<PlainPoint>& points,
                                                 const Displacements& moved) {
  std::array<clothctl::Vector3<double>, 2> sum{clothctl::Vector3<double>::Zero(),
                                               clothctl::Vector3<double>::Zero()};
  for (std::size_t i = 0; i < points.size(); ++i) {
    const clothctl::Vector3<double> d = moved[i];
    const clothctl::Vector3<double>& x = points[i].at;
    sum[0] += d / points[i].w;
    sum[1] += clothctl::Vector3<double>(x[1] * d[2] - x[2] * d[1], x[2] * d[0] - x[0] * d[2],
                                        x[0] * d[1] - x[1] * d[0]) /
              points[i].w;
  }
  return sum;
}

/// A flat sheet of triangles without structure.
struct TriangleSheet {
  clothctl::Points<double> positions;
  std::vector<std::array<int, 3>> triangles;
};

/// Makes a rectangle in the x-y plane of rows × cols vertices about `spacing` (m) apart. Inner
/// vertices are displaced at random by up to `jitter` of the spacing, each cell is divided along
/// its shorter diagonal, and the numbering is shuffled.
inline TriangleSheet irregular_sheet(int rows, int cols, double spacing, double jitter,
                                     unsigned seed) {
  Numbers random(seed);
  std::vector<int> number;
  for (int v = 0; v < rows * cols; ++v) number.push_back(v);
  random.shuffle(number);
  const auto at = [&](int row, int col) {
    return number[static_cast<std::size_t>(row * cols + col)];
  };
  TriangleSheet sheet;
  sheet.positions.setZero(3, rows * cols);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const double dx = random(-jitter, jitter), dy = random(-jitter, jitter);
      const double x = col + (col > 0 && col + 1 < cols ? dx : 0.0),
                   y = row + (row > 0 && row + 1 < rows ? dy : 0.0);
      sheet.positions.col(at(row, col)) << spacing * x, spacing * y, 0.0;
    }
  }
  for (int row = 0; row + 1 < rows; ++row) {
    for (int col = 0; col + 1 < cols; ++col) {
      const int a = at(row, col), b = at(row, col + 1), c = at(row + 1, col + 1),
                d = at(row + 1, col);
      const auto distance = [&](int p, int q) {
        return (sheet.positions.col(p) - sheet.positions.col(q)).norm();
      };
      if (distance(a, c) < distance(b, d)) {
        sheet.triangles.push_back({a, b, c});
        sheet.triangles.push_back({a, c, d});
      } else {
        sheet.triangles.push_back({a, b, d});
        sheet.triangles.push_back({b, c, d});
      }
    }
  }
  return sheet;
}

}  // namespace clothctl_test
