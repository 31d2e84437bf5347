#pragma once

// The interface of both units to main.cpp, which does not include the library.

#include <Eigen/Core>
#include <vector>

/// A result of a unit; equal in both units up to rounding.
struct Figure {
  const char* name;
  double value;
  double tolerance;  ///< of the difference between the units, relative to the larger value or 1
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
