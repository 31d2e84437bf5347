#pragma once

// The unknowns of a planner that plans contact forces: coefficients d >= 0 of the generators of
// each finger's contact model (concepts/contact_model.hpp),
//
//   r = B d + r0
//
// r holds the forces on the held vertices, three coordinates each; the index of a held vertex in r
// is its slot. r0 is the force at d = 0: the largest pull of an adhesive finger, zero otherwise.
//
// Reference: [Bai 2016], eq. 1-2.

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/mpc/detail/held_vertices.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// First row and number of rows that a column of B may have entries in.
using RowRange = std::pair<Index, Index>;

/// Lays out and fills the columns of B for contact forces.
template <RealScalar Scalar, ContactModel<Scalar> Contact>
class ForceBasis {
 public:
  using Traits = contact_traits<Contact>;

  /// Where the coefficients of a finger stand among the unknowns.
  struct FingerColumns {
    /// Index of the grip, and of the finger within it.
    int grip, finger;
    /// First column and number of columns.
    Index column, count;
    /// Index of its first entry in the list of finger forces, where it has one for each vertex.
    Index first_force;
    /// The slots of its vertices, in the finger's order.
    std::vector<Index> held_slots;
  };

  /// Lays out the columns of all fingers and appends their row ranges to `columns`. Allocates.
  void reserve(const std::vector<Grip<Scalar, Contact>>& grips, const HeldVertices<Scalar>& held,
               const std::vector<std::array<int, 3>>& triangles, std::vector<RowRange>& columns) {
    Index most_vertices = 0, most_columns = 0;
    for (std::size_t g = 0; g < grips.size(); ++g) {
      for (std::size_t f = 0; f < grips[g].fingers.size(); ++f) {
        FingerColumns made{static_cast<int>(g),
                           static_cast<int>(f),
                           static_cast<Index>(columns.size()),
                           0,
                           force_count_,
                           {}};
        for (int v : grips[g].fingers[f].vertices)
          made.held_slots.push_back(static_cast<Index>(held.slot(g, v)));
        const Contact& contact = grips[g].fingers[f].contact;
        const Index m = static_cast<Index>(made.held_slots.size());
        made.count = Traits::generators(contact, m);
        for (Index i = 0; i < made.count; ++i)
          columns.push_back(rows_of(made, Traits::support(contact, m, i)));
        force_count_ += m;
        most_vertices = (std::max)(most_vertices, m);
        most_columns = (std::max)(most_columns, made.count);
        fingers_.push_back(std::move(made));
      }
    }
    find_triangles(held, triangles);
    normals_.setZero(3, force_count_);
    points_.setZero(3, most_vertices);
    generators_.setZero(3 * most_vertices, most_columns);
  }

  /// The fingers.
  const std::vector<FingerColumns>& fingers() const { return fingers_; }
  /// Number of finger forces: one for each vertex of each finger.
  Index force_count() const { return force_count_; }
  /// Contact normals, 3 × force_count.
  const Points<Scalar>& normals() const { return normals_; }

  /// Fills B (inputs × unknowns) and r0 (inputs) at positions `x` (3×n). Never allocates.
  void update(const std::vector<Grip<Scalar, Contact>>& grips, const HeldVertices<Scalar>& held,
              const std::vector<std::array<int, 3>>& triangles, const PointsView<Scalar>& x,
              MatrixX<Scalar>& B, VectorX<Scalar>& offset) {
    offset.setZero();
    for (const FingerColumns& columns : fingers_) {
      const Grip<Scalar, Contact>& grip = grips[static_cast<std::size_t>(columns.grip)];
      const Finger<Scalar, Contact>& finger =
          grip.fingers[static_cast<std::size_t>(columns.finger)];
      const Index m = static_cast<Index>(columns.held_slots.size());
      for (Index j = 0; j < m; ++j) {
        const std::size_t slot =
            static_cast<std::size_t>(columns.held_slots[static_cast<std::size_t>(j)]);
        const Vector3<Scalar> front =
            vertex_normal<Scalar>(x, triangles, around_[slot], grip.fallback_normal);
        normals_.col(columns.first_force + j) = finger.side * front;
        points_.col(j) = x.col(held.vertices()[slot]);
      }
      Traits::fill(finger.contact, points_.leftCols(m), normals_.middleCols(columns.first_force, m),
                   generators_.topLeftCorner(3 * m, columns.count));
      scatter(columns, finger.contact, B);
      add_adhesion(columns, finger.contact, offset);
    }
  }

  /// Writes the upper bounds of one frame's coefficients. Never allocates.
  void upper_bounds(const std::vector<Grip<Scalar, Contact>>& grips,
                    Eigen::Ref<VectorX<Scalar>> upper) const {
    for (const FingerColumns& columns : fingers_) {
      const Finger<Scalar, Contact>& f = finger(grips, columns);
      const Index m = static_cast<Index>(columns.held_slots.size());
      for (Index i = 0; i < columns.count; ++i)
        upper[columns.column + i] = Traits::upper_bound(f.contact, m, i, f.max_normal_force);
    }
  }

  /// Writes the finger forces (`force_count` entries) that the coefficients `d` of one planning
  /// frame cause. Never allocates.
  void finger_forces(const std::vector<Grip<Scalar, Contact>>& grips,
                     const HeldVertices<Scalar>& held, const MatrixX<Scalar>& B,
                     const Eigen::Ref<const VectorX<Scalar>>& d,
                     std::vector<FingerForce<Scalar>>& out) const {
    for (const FingerColumns& columns : fingers_) {
      const Contact& contact = finger(grips, columns).contact;
      const Index m = static_cast<Index>(columns.held_slots.size());
      for (Index j = 0; j < m; ++j) {
        const Index slot = columns.held_slots[static_cast<std::size_t>(j)];
        FingerForce<Scalar>& f = out[static_cast<std::size_t>(columns.first_force + j)];
        f.grip = columns.grip;
        f.finger = columns.finger;
        f.vertex = held.vertices()[static_cast<std::size_t>(slot)];
        f.normal = normals_.col(columns.first_force + j);
        f.force = -adhesion(contact, m) * f.normal;
        for (Index i = 0; i < columns.count; ++i) {
          const std::pair<Index, Index> range = Traits::support(contact, m, i);
          if (j < range.first || range.first + range.second <= j) continue;
          f.force += B.template block<3, 1>(3 * slot, columns.column + i) * d[columns.column + i];
        }
      }
    }
  }

  /// Returns the normal force of a finger with one frame's coefficients `d`, N.
  Scalar normal_force(const std::vector<Grip<Scalar, Contact>>& grips, const FingerColumns& columns,
                      const Eigen::Ref<const VectorX<Scalar>>& d) const {
    const Contact& contact = finger(grips, columns).contact;
    const Index m = static_cast<Index>(columns.held_slots.size());
    Scalar sum(0);
    for (Index i = 0; i < columns.count; ++i)
      sum += Traits::normal_share(contact, m, i) * d[columns.column + i];
    return sum - adhesion(contact, m) * Scalar(static_cast<double>(m));
  }

  /// Returns the finger that `columns` belong to.
  static const Finger<Scalar, Contact>& finger(const std::vector<Grip<Scalar, Contact>>& grips,
                                               const FingerColumns& columns) {
    return grips[static_cast<std::size_t>(columns.grip)]
        .fingers[static_cast<std::size_t>(columns.finger)];
  }

  /// Returns the adhesion that each of the `vertices` of a finger carries, N.
  static Scalar adhesion(const Contact& contact, Index vertices) {
    if constexpr (requires { Traits::adhesion(contact); })
      return Traits::adhesion(contact) / Scalar(static_cast<double>(vertices));
    return Scalar(0);
  }

 private:
  /// Returns the rows of B from the first to the last slot that a generator acts on.
  static RowRange rows_of(const FingerColumns& columns, const std::pair<Index, Index>& support) {
    const auto begin = columns.held_slots.begin() + support.first;
    const auto [low, high] = std::minmax_element(begin, begin + support.second);
    return {3 * *low, 3 * (*high - *low + 1)};
  }

  void find_triangles(const HeldVertices<Scalar>& held,
                      const std::vector<std::array<int, 3>>& triangles) {
    around_.resize(held.vertices().size());
    for (std::size_t slot = 0; slot < around_.size(); ++slot) {
      const int v = held.vertices()[slot];
      for (std::size_t t = 0; t < triangles.size(); ++t) {
        if (triangles[t][0] == v || triangles[t][1] == v || triangles[t][2] == v)
          around_[slot].push_back(static_cast<int>(t));
      }
    }
  }

  void scatter(const FingerColumns& columns, const Contact& contact, MatrixX<Scalar>& B) const {
    const Index m = static_cast<Index>(columns.held_slots.size());
    for (Index i = 0; i < columns.count; ++i) {
      const std::pair<Index, Index> range = Traits::support(contact, m, i);
      for (Index j = range.first; j < range.first + range.second; ++j) {
        const Index row = 3 * columns.held_slots[static_cast<std::size_t>(j)];
        for (Index c = 0; c < 3; ++c) B(row + c, columns.column + i) = generators_(3 * j + c, i);
      }
    }
  }

  void add_adhesion(const FingerColumns& columns, const Contact& contact,
                    VectorX<Scalar>& offset) const {
    const Scalar pull = adhesion(contact, static_cast<Index>(columns.held_slots.size()));
    if (!(Scalar(0) < pull)) return;
    for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
      for (Index c = 0; c < 3; ++c)
        offset[3 * columns.held_slots[j] + c] -=
            pull * normals_(c, columns.first_force + static_cast<Index>(j));
    }
  }

  std::vector<FingerColumns> fingers_;
  std::vector<std::vector<int>> around_;  // triangles around each slot
  Points<Scalar> normals_, points_;
  MatrixX<Scalar> generators_;
  Index force_count_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
