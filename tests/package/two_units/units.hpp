#pragma once

// What both units offer to main.cpp, which sees nothing of the library.

#include <Eigen/Core>
#include <vector>

/// What a unit computed; the same in both but for rounding.
struct Figure {
  const char* name;
  double value;
  double tolerance;  ///< of a difference between two units, relative to the larger value or 1
};

/// Containers that one unit fills, another grows and a third frees.
struct Passed {
  Eigen::MatrixXd matrix;
  Eigen::Matrix4f block;
  std::vector<Eigen::VectorXd> vectors;
  std::vector<Eigen::Vector4d> points;
};

namespace plain {
std::vector<Figure> figures();
void fill(Passed& passed);
double grow(Passed& passed);
}  // namespace plain

namespace wide {
std::vector<Figure> figures();
void fill(Passed& passed);
double grow(Passed& passed);
}  // namespace wide
