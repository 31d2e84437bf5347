#include "sheets.hpp"

#include <cmath>
#include <random>

namespace versus {

namespace {

constexpr double kSize = 1, kDensity = 0.2, kJitter = 0.3;

/// A number in [0, 1), the same everywhere.
double uniform(std::mt19937& engine) { return static_cast<double>(engine()) / 4294967296.0; }

double area(const Sheet& sheet, const std::array<int, 3>& t) {
  const auto at = [&](int corner, int c) {
    return sheet.positions[static_cast<std::size_t>(3 * t[static_cast<std::size_t>(corner)] + c)];
  };
  return 0.5 * ((at(1, 0) - at(0, 0)) * (at(2, 1) - at(0, 1)) -
                (at(2, 0) - at(0, 0)) * (at(1, 1) - at(0, 1)));
}

void add_edge(Sheet& sheet, int a, int b, bool diagonal) {
  double square = 0;
  for (int c = 0; c < 3; ++c) {
    const double d = sheet.positions[static_cast<std::size_t>(3 * b + c)] -
                     sheet.positions[static_cast<std::size_t>(3 * a + c)];
    square += d * d;
  }
  sheet.edges.push_back({a, b, static_cast<float>(std::sqrt(square)), diagonal});
}

/// Adds edges and triangles. `rising(cell)` says whether a cell's diagonal starts at its first
/// vertex.
template <class Rising>
void connect(Sheet& sheet, const Rising& rising) {
  const int n = sheet.side;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const int i = row * n + column;
      const bool right = column + 1 < n, down = row + 1 < n;
      if (right) add_edge(sheet, i, i + 1, false);
      if (down) add_edge(sheet, i, i + n, false);
      if (!right || !down) continue;
      if (rising(row * (n - 1) + column)) {
        add_edge(sheet, i, i + n + 1, true);
        sheet.triangles.push_back({i, i + 1, i + n + 1});
        sheet.triangles.push_back({i, i + n + 1, i + n});
      } else {
        add_edge(sheet, i + 1, i + n, true);
        sheet.triangles.push_back({i, i + 1, i + n});
        sheet.triangles.push_back({i + 1, i + n + 1, i + n});
      }
    }
  }
}

/// Vertices in rows. Vertex (0, 0) is at the origin; columns run along x.
Sheet flat(int side, const char* mesh) {
  Sheet sheet;
  sheet.mesh = mesh;
  sheet.side = side;
  sheet.pinned = {0, side - 1};
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      for (const double x : {kSize * column / (side - 1), kSize * row / (side - 1), 0.0})
        sheet.positions.push_back(x);
    }
  }
  sheet.mass.assign(static_cast<std::size_t>(side * side), 0.0);
  return sheet;
}

}  // namespace

Sheet grid_sheet(int side) {
  Sheet sheet = flat(side, "grid");
  connect(sheet, [](int) { return true; });
  const double cell = kDensity * kSize * kSize / ((side - 1) * (side - 1));
  for (int row = 0; row + 1 < side; ++row) {
    for (int column = 0; column + 1 < side; ++column) {
      for (const int k : {0, 1, side, side + 1})
        sheet.mass[static_cast<std::size_t>(row * side + column + k)] += cell / 4;
    }
  }
  return sheet;
}

Sheet irregular_sheet(int side, unsigned seed) {
  Sheet sheet = flat(side, "irregular");
  std::mt19937 engine(seed);
  const double reach = kJitter * kSize / (side - 1);
  for (int i = 0; i < sheet.n(); ++i) {
    const int row = i / side, column = i % side;
    const double x = reach * (2 * uniform(engine) - 1), y = reach * (2 * uniform(engine) - 1);
    const bool free_x = column > 0 && column + 1 < side, free_y = row > 0 && row + 1 < side;
    if (free_x) sheet.positions[static_cast<std::size_t>(3 * i)] += x;
    if (free_y) sheet.positions[static_cast<std::size_t>(3 * i + 1)] += y;
  }
  connect(sheet, [&](int) { return uniform(engine) < 0.5; });
  for (const std::array<int, 3>& t : sheet.triangles) {
    for (const int i : t) sheet.mass[static_cast<std::size_t>(i)] += kDensity * area(sheet, t) / 3;
  }
  return sheet;
}

}  // namespace versus
