#pragma once

// How the unknowns u of the QP act on the held vertices: raw inputs r = B u + r0, with the same B
// and r0 in every frame of the window. The columns of B are those of contact forces
// (force_basis.hpp) or of grip poses (pose_basis.hpp, r0 = 0).

#include <array>
#include <utility>
#include <vector>

#include "clothctl/mpc/detail/force_basis.hpp"
#include "clothctl/mpc/detail/pose_basis.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the fingers of `a` hold the same vertices as those of `b`, with generators on
/// the same vertices.
template <RealScalar Scalar, class Contact>
bool same_layout(const std::vector<Grip<Scalar, Contact>>& a,
                 const std::vector<Grip<Scalar, Contact>>& b) {
  using Traits = contact_traits<Contact>;
  if (a.size() != b.size()) return false;
  for (std::size_t g = 0; g < a.size(); ++g) {
    if (a[g].fingers.size() != b[g].fingers.size()) return false;
    for (std::size_t f = 0; f < a[g].fingers.size(); ++f) {
      const Finger<Scalar, Contact>&p = a[g].fingers[f], &q = b[g].fingers[f];
      const Index m = static_cast<Index>(p.vertices.size());
      const Index count = Traits::generators(p.contact, m);
      if (p.vertices != q.vertices || Traits::generators(q.contact, m) != count) return false;
      for (Index i = 0; i < count; ++i) {
        if (Traits::support(p.contact, m, i) != Traits::support(q.contact, m, i)) return false;
      }
    }
  }
  return true;
}

/// The map from unknowns to raw inputs, rebuilt in each frame without allocation.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
class GripBasis {
 public:
  using Grips = std::vector<Grip<Scalar, Contact>>;
  using FingerColumns = typename ForceBasis<Scalar, Contact>::FingerColumns;

  /// Lays out the unknowns for `grips` on a mesh with `triangles`. Allocates.
  GripBasis(Grips grips, std::vector<std::array<int, 3>> triangles, GripInput input)
      : grips_(std::move(grips)), triangles_(std::move(triangles)), input_(input) {
    for (const Grip<Scalar, Contact>& grip : grips_) held_.add_grip(grip.vertices());
    if (input_ == GripInput::Pose) {
      PoseBasis<Scalar>::reserve(held_, columns_);
    } else {
      forces_.reserve(grips_, held_, triangles_, columns_);
    }
    matrix_.setZero(3 * static_cast<Index>(held_.vertices().size()),
                    static_cast<Index>(columns_.size()));
    offset_.setZero(matrix_.rows());
  }

  /// Takes grips that differ only in limits, friction and sides. Returns false and changes nothing
  /// when they need another layout. Never allocates when it returns false.
  bool replace(const Grips& grips) {
    if (!same_layout(grips_, grips)) return false;
    grips_ = grips;
    return true;
  }

  /// What the unknowns are.
  GripInput input() const { return input_; }
  /// The grips.
  const Grips& grips() const { return grips_; }
  /// The held vertices.
  const HeldVertices<Scalar>& held() const { return held_; }
  /// The fingers and their columns; empty for poses.
  const std::vector<FingerColumns>& fingers() const { return forces_.fingers(); }
  /// Returns the finger that `columns` belong to.
  const Finger<Scalar, Contact>& finger(const FingerColumns& columns) const {
    return forces_.finger(grips_, columns);
  }
  /// Number of finger forces: one for each vertex of each finger; 0 for poses.
  Index force_count() const { return forces_.force_count(); }
  /// Number of unknowns of a frame.
  Index unknowns() const { return matrix_.cols(); }
  /// Number of raw inputs of a frame, three for each held vertex.
  Index inputs() const { return matrix_.rows(); }
  /// B, inputs × unknowns.
  const MatrixX<Scalar>& matrix() const { return matrix_; }
  /// r0, inputs.
  const VectorX<Scalar>& offset() const { return offset_; }
  /// First row and number of rows that column `c` of B may have entries in.
  const RowRange& rows(Index c) const { return columns_[static_cast<std::size_t>(c)]; }

  /// Rebuilds B and r0 at positions `x` (3×n). Never allocates.
  void update(const PointsView<Scalar>& x) {
    if (input_ == GripInput::Pose) {
      PoseBasis<Scalar>::update(held_, x, matrix_);
    } else {
      forces_.update(grips_, held_, triangles_, x, matrix_, offset_);
    }
  }

  /// Writes the bounds of one frame's unknowns at positions `x`. For poses they follow from
  /// `max_step` (m) and `dt` (s), for forces from the contact models. Never allocates.
  void bounds(const PointsView<Scalar>& x, Scalar max_step, Scalar dt,
              Eigen::Ref<VectorX<Scalar>> lower, Eigen::Ref<VectorX<Scalar>> upper) const {
    if (input_ == GripInput::Pose) {
      PoseBasis<Scalar>::upper_bounds(held_, x, max_step, dt, upper);
      lower = -upper;
    } else {
      forces_.upper_bounds(grips_, upper);
      lower.setZero();
    }
  }

  /// Writes the finger forces of one frame's coefficients `d`. Never allocates.
  void finger_forces(const Eigen::Ref<const VectorX<Scalar>>& d,
                     std::vector<FingerForce<Scalar>>& out) const {
    forces_.finger_forces(grips_, held_, matrix_, d, out);
  }

  /// Returns the normal force of a finger with one frame's coefficients `d`, N.
  Scalar normal_force(const FingerColumns& columns,
                      const Eigen::Ref<const VectorX<Scalar>>& d) const {
    return forces_.normal_force(grips_, columns, d);
  }
  /// Returns the normal force that a unit of coefficient `i` of a finger adds.
  Scalar normal_share(const FingerColumns& columns, Index i) const {
    return contact_traits<Contact>::normal_share(finger(columns).contact,
                                                 static_cast<Index>(columns.held_slots.size()), i);
  }
  /// Returns the adhesion of a finger, N.
  Scalar adhesion(const FingerColumns& columns) const {
    const Index m = static_cast<Index>(columns.held_slots.size());
    return Scalar(static_cast<double>(m)) *
           ForceBasis<Scalar, Contact>::adhesion(finger(columns).contact, m);
  }
  /// Returns the largest sum of normal shares times coefficients of a finger: the limit of its
  /// normal force, and its adhesion, N.
  Scalar most_pressed(const FingerColumns& columns) const {
    return finger(columns).max_normal_force + adhesion(columns);
  }
  /// Makes one frame's coefficients `d`, which a solver leaves slightly off, obey the contact law:
  /// negative ones become zero, those of a finger beyond its limit are scaled down to it. Never
  /// allocates.
  void keep_limits(Eigen::Ref<VectorX<Scalar>> d) const {
    for (Index i = 0; i < d.size(); ++i) {
      if (d[i] < Scalar(0)) d[i] = Scalar(0);
    }
    for (const FingerColumns& columns : fingers()) {
      const Scalar pressed = normal_force(columns, d) + adhesion(columns);
      const Scalar limit = most_pressed(columns);
      if (limit < pressed) d.segment(columns.column, columns.count) *= limit / pressed;
    }
  }

 private:
  Grips grips_;
  std::vector<std::array<int, 3>> triangles_;
  GripInput input_;
  HeldVertices<Scalar> held_;
  ForceBasis<Scalar, Contact> forces_;
  std::vector<RowRange> columns_;
  MatrixX<Scalar> matrix_;
  VectorX<Scalar> offset_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
