#pragma once

// A contact model joins ContactModel by one specialisation of contact_traits: a ribbed rubber pad,
// which grips well across its ribs and poorly along them. Per vertex, with normal n and directions
// t1 along and t2 across the ribs,
//
//   |f·t1| / μ1 + |f·t2| / μ2 <= f·n,      generators   n ± μ1 t1,   n ± μ2 t2
//
// The four generators span exactly this cone, so nothing is lost as with a round one.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <Eigen/Geometry>

#include "clothctl/concepts/contact_model.hpp"

namespace gripper {

/// The maker's data sheet.
struct RibbedPad {
  double along = 0.3, across = 0.9;        // friction coefficients μ1, μ2
  Eigen::Vector3d ribs = {1.0, 0.0, 0.0};  // direction of the ribs in the world

  /// The directions along and across the ribs that are tangents of a sheet with normal n.
  std::pair<Eigen::Vector3d, Eigen::Vector3d> tangents(const Eigen::Vector3d& n) const {
    Eigen::Vector3d t1 = ribs - ribs.dot(n) * n;
    if (t1.norm() < 1e-6) t1 = n.unitOrthogonal();  // the ribs point into the sheet
    t1.normalize();
    return {t1, n.cross(t1)};
  }
};

}  // namespace gripper

/// All that clothctl asks of a contact: a finger on m vertices transmits f = G d with d >= 0.
template <>
struct clothctl::contact_traits<gripper::RibbedPad> {
  using Pad = gripper::RibbedPad;
  using View = PointsView<double>;
  /// Four generators a vertex.
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
  /// The normal force of one unit of a coefficient.
  static double normal_share(const Pad&, Index, Index) { return 1.0; }
  /// The coefficient that reaches the limit on the normal force alone.
  static double upper_bound(const Pad&, Index, Index, double max_normal_force) {
    return max_normal_force;
  }
  /// By how much forces (3×m) violate the law or the limit, N; infinity for what is not finite.
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
  /// Empty, or what is wrong with the data sheet.
  static std::string validate(const Pad& pad) {
    if (pad.along > 0 && pad.across > 0 && pad.ribs.norm() > 0) return {};
    return "a ribbed pad without friction or direction";
  }
};
