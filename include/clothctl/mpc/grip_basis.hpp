#pragma once

// How the unknowns of the QP move the held vertices: raw inputs r = B u, the same B in every frame of the window.
//
//   Force:  u = d >= 0, one coefficient for each (finger, vertex, generator);  r_j = Σ d_i s_i       (paper 000, eq. 1-2)
//
//   Pose:   u = (v, ω) of each grip;  r_j = v + ω × (x_j - c);  ω only where the grip holds several vertices
//
// Held vertices are ordered grip by grip, so a column of B touches a contiguous run of rows.

#include <cmath>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/contact/grip.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl {

/// The force of one finger on one vertex, as planned and sent.
template <RealScalar Scalar>
struct FingerForce {
  /// The grip.
  int grip = 0;
  /// The finger within the grip.
  int finger = 0;
  /// The vertex.
  int vertex = 0;
  /// Contact normal that the cone stood on, unit.
  Vector3<Scalar> normal = Vector3<Scalar>::Zero();
  /// Force on the sheet, N.
  Vector3<Scalar> force = Vector3<Scalar>::Zero();
};

/// The map from unknowns to raw inputs, rebuilt each frame without allocation.
template <RealScalar Scalar>
class GripBasis {
 public:
  /// Lays out unknowns for `grips` on a mesh with `triangles`. Allocates.
  GripBasis(std::vector<Grip<Scalar>> grips, const std::vector<std::array<int, 3>>& triangles, GripInput input)
      : grips_(std::move(grips)), triangles_(triangles), input_(input) {
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      grip_begin_.push_back(held_.size());
      for (int v : grips_[g].vertices()) {
        held_.push_back(v);
        grip_of_.push_back(static_cast<int>(g));
        around_.emplace_back();
        for (std::size_t t = 0; t < triangles_.size(); ++t) {
          if (triangles_[t][0] == v || triangles_[t][1] == v || triangles_[t][2] == v)
            around_.back().push_back(static_cast<int>(t));
        }
      }
    }
    grip_begin_.push_back(held_.size());
    if (input_ == GripInput::Pose) {
      for (std::size_t g = 0; g < grips_.size(); ++g) {
        const Index count = static_cast<Index>(grip_begin_[g + 1] - grip_begin_[g]);
        const Index poses = count > 1 ? 6 : 3;
        for (Index i = 0; i < poses; ++i) columns_.push_back({3 * static_cast<Index>(grip_begin_[g]), 3 * count});
      }
    } else {
      for (std::size_t g = 0; g < grips_.size(); ++g) {
        for (std::size_t f = 0; f < grips_[g].fingers.size(); ++f) {
          for (int v : grips_[g].fingers[f].vertices) {
            std::size_t slot = grip_begin_[g];
            while (held_[slot] != v) ++slot;
            contacts_.push_back(
                {static_cast<int>(g), static_cast<int>(f), static_cast<Index>(slot), static_cast<Index>(columns_.size())});
            for (int i = 0; i < grips_[g].fingers[f].generators; ++i) columns_.push_back({3 * static_cast<Index>(slot), 3});
          }
        }
      }
      normals_.setZero(3, static_cast<Index>(contacts_.size()));
    }
    matrix_.setZero(3 * static_cast<Index>(held_.size()), static_cast<Index>(columns_.size()));
  }

  /// A friction contact of one finger at one vertex: where its coefficients stand among the unknowns.
  struct Contact {
    /// The grip.
    int grip;
    /// The finger within the grip.
    int finger;
    /// Index of the vertex among the held ones.
    Index slot;
    /// First of its unknowns.
    Index column;
  };

  /// The grips.
  const std::vector<Grip<Scalar>>& grips() const { return grips_; }
  /// The held vertices, grip by grip.
  const std::vector<int>& held() const { return held_; }
  /// First held index of grip `g`; that of grip g+1 ends it.
  std::size_t grip_begin(std::size_t g) const { return grip_begin_[g]; }
  /// The friction contacts; empty for poses.
  const std::vector<Contact>& contacts() const { return contacts_; }
  /// Unknowns of a frame.
  Index unknowns() const { return matrix_.cols(); }
  /// Raw inputs of a frame, three for each held vertex.
  Index inputs() const { return matrix_.rows(); }
  /// B, inputs × unknowns.
  const MatrixX<Scalar>& matrix() const { return matrix_; }
  /// First row and number of rows that column `c` of B touches.
  std::pair<Index, Index> rows(Index c) const { return columns_[static_cast<std::size_t>(c)]; }
  /// The finger of a contact.
  const Finger<Scalar>& finger(const Contact& contact) const {
    return grips_[static_cast<std::size_t>(contact.grip)].fingers[static_cast<std::size_t>(contact.finger)];
  }

  /// Rebuilds B about positions `x` (3×n). Never allocates.
  void update(const PointsView<Scalar>& x) {
    if (input_ == GripInput::Pose) {
      Index column = 0;
      for (std::size_t g = 0; g < grips_.size(); ++g) {
        const Vector3<Scalar> c = centroid(x, g);
        const bool turns = grip_begin_[g + 1] - grip_begin_[g] > 1;
        for (std::size_t j = grip_begin_[g]; j < grip_begin_[g + 1]; ++j) {
          const Index row = 3 * static_cast<Index>(j);
          matrix_.template block<3, 3>(row, column).setIdentity();
          if (!turns) continue;
          const Vector3<Scalar> r = x.col(held_[j]) - c;
          const Scalar zero = Scalar(0);
          matrix_.template block<3, 3>(row, column + 3) << zero, r[2], -r[1], -r[2], zero, r[0], r[1], -r[0], zero;  // ω × r
        }
        column += turns ? 6 : 3;
      }
      return;
    }
    for (std::size_t i = 0; i < contacts_.size(); ++i) {
      const Contact& contact = contacts_[i];
      const Finger<Scalar>& f = finger(contact);
      const Vector3<Scalar> front = vertex_normal<Scalar>(x, triangles_, around_[static_cast<std::size_t>(contact.slot)],
                                                          grips_[static_cast<std::size_t>(contact.grip)].fallback_normal);
      normals_.col(static_cast<Index>(i)) = f.side * front;
      friction_generators<Scalar>(f.side * front, f.friction, matrix_.block(3 * contact.slot, contact.column, 3, f.generators));
    }
  }

  /// Centroid of grip `g` at positions `x`.
  Vector3<Scalar> centroid(const PointsView<Scalar>& x, std::size_t g) const {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (std::size_t j = grip_begin_[g]; j < grip_begin_[g + 1]; ++j) sum += x.col(held_[j]);
    return sum / Scalar(static_cast<double>(grip_begin_[g + 1] - grip_begin_[g]));
  }

  /// One over the number of vertices of the grip that holds the `slot`-th held vertex.
  Scalar vertex_share(Index slot) const {
    const std::size_t g = static_cast<std::size_t>(grip_of_[static_cast<std::size_t>(slot)]);
    return Scalar(1) / Scalar(static_cast<double>(grip_begin_[g + 1] - grip_begin_[g]));
  }

  /// Largest distance of a held vertex of grip `g` from its centroid, m.
  Scalar radius(const PointsView<Scalar>& x, std::size_t g) const {
    using std::sqrt;
    const Vector3<Scalar> c = centroid(x, g);
    Scalar largest = Scalar(0);
    for (std::size_t j = grip_begin_[g]; j < grip_begin_[g + 1]; ++j) {
      const Scalar distance = (x.col(held_[j]) - c).squaredNorm();
      if (largest < distance) largest = distance;
    }
    return sqrt(largest);
  }

  /// Bounds of one frame's unknowns: coefficients in [0, limit √(1+μ²)]; poses: the centroid moves at most `max_step` along
  /// each axis, and turning moves no held vertex further than that along any axis (|ω×r|_i <= √2 |ω|_∞ |r|). Never allocates.
  void bounds(const PointsView<Scalar>& x, Scalar max_step, Scalar dt, Eigen::Ref<VectorX<Scalar>> lower,
              Eigen::Ref<VectorX<Scalar>> upper) const {
    using std::sqrt;
    if (input_ == GripInput::Force) {
      lower.setZero();
      for (const Contact& contact : contacts_) {
        const Finger<Scalar>& f = finger(contact);
        upper.segment(contact.column, f.generators).setConstant(f.limit * sqrt(Scalar(1) + f.friction * f.friction));
      }
      return;
    }
    Index column = 0;
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      upper.segment(column, 3).setConstant(max_step / dt);
      column += 3;
      if (grip_begin_[g + 1] - grip_begin_[g] > 1) {
        const Scalar size = radius(x, g);
        upper.segment(column, 3).setConstant(Scalar(0) < size ? max_step / (dt * size * sqrt(Scalar(2))) : Scalar(0));
        column += 3;
      }
    }
    lower = -upper;
  }

  /// The finger forces of a frame's coefficients `d` into `out` (as many as contacts). Never allocates.
  void finger_forces(const Eigen::Ref<const VectorX<Scalar>>& d, std::vector<FingerForce<Scalar>>& out) const {
    for (std::size_t i = 0; i < contacts_.size(); ++i) {
      const Contact& contact = contacts_[i];
      FingerForce<Scalar>& f = out[i];
      f.grip = contact.grip;
      f.finger = contact.finger;
      f.vertex = held_[static_cast<std::size_t>(contact.slot)];
      f.normal = normals_.col(static_cast<Index>(i));
      f.force.setZero();
      for (Index k = 0; k < finger(contact).generators; ++k) {
        f.force += matrix_.template block<3, 1>(3 * contact.slot, contact.column + k) * d[contact.column + k];
      }
    }
  }

 private:
  std::vector<Grip<Scalar>> grips_;
  std::vector<std::array<int, 3>> triangles_;
  GripInput input_;
  std::vector<int> held_, grip_of_;
  std::vector<std::size_t> grip_begin_;
  std::vector<std::vector<int>> around_;
  std::vector<Contact> contacts_;
  std::vector<std::pair<Index, Index>> columns_;
  Points<Scalar> normals_;
  MatrixX<Scalar> matrix_;
};

}  // namespace clothctl
