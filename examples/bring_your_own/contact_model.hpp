#pragma once

// A contact model joins ContactModel by one specialisation of contact_traits: a ribbed rubber pad
// with high friction across its ribs and low friction along them. At a vertex with normal n,
// direction t1 along the ribs and t2 across them,
//
//   |f·t1| / μ1 + |f·t2| / μ2 <= f·n,      generators   n ± μ1 t1,   n ± μ2 t2
//
// The four generators span exactly this cone, so no friction is lost as with a round cone.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <Eigen/Geometry>

#include "clothctl/concepts/contact_model.hpp"

namespace gripper {

/// The data of a pad.
struct RibbedPad {
  double along = 0.3, across = 0.9;        // friction coefficients μ1, μ2
  Eigen::Vector3d ribs = {1.0, 0.0, 0.0};  // direction of the ribs in the world

  /// Returns the tangents along and across the ribs for a sheet with normal n.
  std::pair<Eigen::Vector3d, Eigen::Vector3d> tangents(const Eigen::Vector3d& n) const {
    Eigen::Vector3d t1 = ribs - ribs.dot(n) * n;
    if (t1.norm() < 1e-6) t1 = n.unitOrthogonal();  // the ribs are parallel to the normal
    t1.normalize();
    return {t1, n.cross(t1)};
  }
};

}  // namespace gripper

/// Everything that clothctl needs from a contact: a finger on m vertices transmits f = G d with d
/// >= 0.
template <>
struct clothctl::contact_traits<gripper::RibbedPad> {
  using Pad = gripper::RibbedPad;
  using View = PointsView<double>;
  /// Four generators for each vertex.
  static Index generators(const Pad&, Index vertices) { return 4 * vertices; }
  /// Generator i acts on one vertex, i / 4.
  static std::pair<Index, Index> support(const Pad&, Index, Index i) { return {i / 4, 1}; }
  /// G, 3m × 4m, at vertices with unit normals (3×m). Zero outside of each generator's support.
  static void fill(const Pad& pad, const View&, const View& normals,
                   Eigen::Ref<MatrixX<double>> G) {
    G.setZero();
    for (Index j = 0; j < normals.cols(); ++j) {
      const Vector3<double> n = normals.col(j);
      const auto [t1, t2] = pad.tangents(n);
      G.block<3, 1>(3 * j, 4 * j) = n + pad.along * t1;
      G.block<3, 1>(3 * j, 4 * j + 1) = n - pad.along * t1;
      G.block<3, 1>(3 * j, 4 * j + 2) = n + pad.across * t2;
      G.block<3, 1>(3 * j, 4 * j + 3) = n - pad.across * t2;
    }
  }
  /// Returns the normal force of one unit of a coefficient.
  static double normal_share(const Pad&, Index, Index) { return 1.0; }
  /// Returns the coefficient that alone reaches the limit on the normal force.
  static double upper_bound(const Pad&, Index, Index, double max_normal_force) {
    return max_normal_force;
  }
  /// Returns by how much forces (3×m) violate the law or the limit, N; infinity if a number is not
  /// finite.
  static double violation(const Pad& pad, const View&, const View& normals, const View& forces,
                          double max_normal_force) {
    double worst = 0, total = 0;
    for (Index j = 0; j < forces.cols(); ++j) {
      const Vector3<double> n = normals.col(j), f = forces.col(j);
      const auto [t1, t2] = pad.tangents(n);
      const double used = std::abs(f.dot(t1)) / pad.along + std::abs(f.dot(t2)) / pad.across;
      total += f.dot(n);
      worst = std::max({worst, pad.along * (used - f.dot(n)), -f.dot(n)});
      if (!is_finite(used) || !is_finite(total)) return scalar_traits<double>::infinity();
    }
    if (!is_finite(max_normal_force)) return scalar_traits<double>::infinity();
    return std::max(worst, total - max_normal_force);
  }
  /// Returns an empty string, or what is wrong with the data.
  static std::string validate(const Pad& pad) {
    if (pad.along > 0 && pad.across > 0 && pad.ribs.norm() > 0) return {};
    return "a ribbed pad without friction or direction";
  }
};
