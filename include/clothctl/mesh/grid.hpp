#pragma once

// A rectangular sheet as a grid of vertices, hanging from its top edge.
//
//   x(row, col) = (width (col/(cols-1) - ½), 0, -height (1 - row/(rows-1)))
//
// Row 0 is the bottom, row rows-1 the top (z = 0). Column 0 is the left side (x = -width/2). Every
// cell is divided into two triangles, counter-clockwise seen from -y. The direction of the dividing
// diagonal alternates like the colours of a chessboard. So the mesh of a sheet with an even number
// of cells in a row is symmetric about x = 0, and wind along y does not turn the sheet.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A rectangular sheet of rows × cols vertices.
template <RealScalar Scalar>
struct GridMesh {
  /// Number of vertices from bottom to top.
  int rows = 0;
  /// Number of vertices from left to right.
  int cols = 0;
  /// Extent along x, m.
  Scalar width = Scalar(0);
  /// Extent along z, m.
  Scalar height = Scalar(0);
  /// Vertex positions, 3×(rows*cols), m.
  Points<Scalar> positions;
  /// Two triangles for each cell, 2 (rows-1) (cols-1) in all, counter-clockwise seen from -y.
  std::vector<std::array<int, 3>> triangles;

  /// Returns the index of the vertex in a row (0 = bottom) and a column (0 = left).
  int vertex(int row, int col) const { return row * cols + col; }
  /// Returns the distance between neighbouring vertices in a row, m.
  Scalar column_spacing() const { return width / Scalar(static_cast<double>(cols - 1)); }
  /// Returns the distance between neighbouring vertices in a column, m.
  Scalar row_spacing() const { return height / Scalar(static_cast<double>(rows - 1)); }
};

/// Makes a sheet of rows × cols vertices in the x-z plane with its top edge at z = 0. `width` and
/// `height` are in m. 65×65 gives 4225 vertices and 8192 triangles. Allocates. Complexity:
/// O(rows*cols). Fails when: rows or cols is below 2, rows*cols exceeds 10^8, or width or height is
/// not positive and finite.
template <RealScalar Scalar>
Result<GridMesh<Scalar>> make_grid(int rows, int cols, Scalar width, Scalar height) {
  if (rows < 2) return Error{"grid needs at least 2 rows, got " + std::to_string(rows)};
  if (cols < 2) return Error{"grid needs at least 2 columns, got " + std::to_string(cols)};
  if (static_cast<std::int64_t>(rows) * cols > 100000000)
    return Error{"grid of " + std::to_string(rows) + " rows and " + std::to_string(cols) +
                 " columns is too large"};
  if (!is_finite(width) || !(Scalar(0) < width))
    return Error{"grid width must be positive, got " + number_text(width)};
  if (!is_finite(height) || !(Scalar(0) < height))
    return Error{"grid height must be positive, got " + number_text(height)};

  GridMesh<Scalar> mesh;
  mesh.rows = rows;
  mesh.cols = cols;
  mesh.width = width;
  mesh.height = height;
  mesh.positions.resize(3, static_cast<Index>(rows) * cols);
  for (int row = 0; row < rows; ++row) {
    const double above = static_cast<double>(rows - 1 - row) / static_cast<double>(rows - 1);
    for (int col = 0; col < cols; ++col) {
      const double right =
          static_cast<double>(2 * col - (cols - 1)) / static_cast<double>(2 * (cols - 1));
      const Index v = mesh.vertex(row, col);
      mesh.positions(0, v) = width * Scalar(right);
      mesh.positions(1, v) = Scalar(0);
      mesh.positions(2, v) = row == rows - 1 ? Scalar(0) : Scalar(0) - height * Scalar(above);
    }
  }
  mesh.triangles.reserve(2 * static_cast<std::size_t>(rows - 1) *
                         static_cast<std::size_t>(cols - 1));
  for (int row = 0; row + 1 < rows; ++row) {
    for (int col = 0; col + 1 < cols; ++col) {
      const int a = mesh.vertex(row, col), b = mesh.vertex(row, col + 1);
      const int c = mesh.vertex(row + 1, col + 1), d = mesh.vertex(row + 1, col);
      if ((row + col) % 2 == 0) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, c, d});
      }
    }
  }
  return mesh;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(Result<GridMesh<double>> make_grid<double>(int, int, double, double));

}  // namespace clothctl::inline CLOTHCTL_ABI
