#pragma once

// How a set of grips goes on from an earlier one, when fingers let vertices go and take others.
//
// A grip goes on from the earlier grip that shares most vertices with it; if none does, from that
// of its own index, unless another grip goes on from that. The fingers of a grip go on by index.
// The forces that the earlier fingers j = (finger, vertex) were planned to exert pass to the new
// ones i = (finger, vertex):
//
//   f_i = Σ_j W_ij f_j,     W_ij >= 0,   Σ_i W_ij = 1
//
// so the planned force of every grip that goes on is kept, and with it the load that is carried. Of
// a finger that goes on with M vertices, K of which it held before, a force on one of the K keeps
// K/M of itself and gives 1/M to each new vertex; a force on a vertex that it let go gives 1/M to
// each of the M. The forces of a finger that is gone are shared out equally in its grip, those of a
// grip that is gone among all.

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/mpc/detail/grip_basis.hpp"
#include "clothctl/mpc/detail/rigid_motion.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What passes from the grips of one basis to those of another. Both must outlive it.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
class GripChange {
 public:
  using Basis = GripBasis<Scalar, Contact>;
  using FingerColumns = typename Basis::FingerColumns;
  using Problem = WindowProblem<Scalar, Contact>;

  /// Compares two bases of one sheet, whose vertices are at `x` (3×n, m). Allocates.
  GripChange(const Basis& before, const Basis& after, const PointsView<Scalar>& x)
      : before_(before), after_(after), x_(x) {
    find_grips();
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      for (std::size_t j = after.held().grip_begin(g); j < after.held().grip_begin(g + 1); ++j)
        slots_.push_back(grips_[g] < 0 ? -1 : slot_before(grips_[g], after.held().vertices()[j]));
    }
    weights_.setZero(after.force_count(), before.force_count());
    for (const FingerColumns& last : before.fingers()) weigh(last);
    unknowns_.setZero(after.unknowns(), before.unknowns());
    if (after.input() == GripInput::Pose) {
      map_poses();
    } else {
      for (const FingerColumns& now : after.fingers()) map_coefficients(now);
    }
  }

  /// The earlier grip that grip `g` goes on from, or -1.
  int grip(std::size_t g) const { return grips_[g]; }
  /// The earlier slot of the vertex in slot `j`, or -1 when its grip did not hold it.
  Index slot(std::size_t j) const { return slots_[j]; }
  /// W, force count × earlier force count; empty for poses.
  const MatrixX<Scalar>& weights() const { return weights_; }
  /// The map from earlier unknowns of a frame to those that they go on as, unknowns × earlier
  /// unknowns. Coefficients go as the forces of their vertices do, poses turn about new centroids.
  const MatrixX<Scalar>& unknowns() const { return unknowns_; }

  /// Returns by how much the centroid of grip `g`, which goes on, jumps because it holds other
  /// vertices, m.
  Vector3<Scalar> jump(std::size_t g) const {
    return after_.held().centroid(x_, g) -
           before_.held().centroid(x_, static_cast<std::size_t>(grips_[g]));
  }

  /// Carries velocities of held vertices, 3·held × K, over. A vertex that stays keeps its own, one
  /// that joins a grip moves with it as in a rigid body, and a new grip goes on with the mean
  /// velocity of its vertices; `measured`: velocities of the sheet, 3×n, m/s.
  void carry_velocities(const MatrixX<Scalar>& last, const PointsView<Scalar>& measured,
                        MatrixX<Scalar>& out) const {
    for (Index k = 0; k < out.cols(); ++k) {
      for (std::size_t g = 0; g < grips_.size(); ++g) {
        const RigidVelocity<Scalar> body = velocity(g, last, k, measured);
        for (std::size_t j = after_.held().grip_begin(g); j < after_.held().grip_begin(g + 1);
             ++j) {
          const Vector3<Scalar> place = x_.col(after_.held().vertices()[j]);
          if (slots_[j] < 0) {
            out.template block<3, 1>(3 * static_cast<Index>(j), k) = body.at(place);
          } else {
            out.template block<3, 1>(3 * static_cast<Index>(j), k) =
                last.template block<3, 1>(3 * slots_[j], k);
          }
        }
      }
    }
  }

  /// Carries what the next frame needs of the last one from problem to problem, but for planned
  /// forces: path and planned velocities, the applied input, measured velocities (`measured`, 3×n,
  /// m/s), outer forces and supports. A vertex that was not held had no input.
  void carry_request(const Problem& before, const PointsView<Scalar>& measured,
                     Problem& after) const {
    const WindowRequest<Scalar>& last = before.request;
    WindowRequest<Scalar>& request = after.request;
    request.outer_force = last.outer_force;
    request.supports = last.supports;
    request.has_path = last.has_path;
    request.has_applied = last.has_applied;
    carry_velocities(last.path, measured, request.path);
    if (after.settings.input == GripInput::Pose)
      carry_velocities(last.plan, measured, request.plan);
    for (std::size_t j = 0; j < slots_.size(); ++j) {
      const Vector3<Scalar> v = measured.col(request.held[j]);
      after.motion.last_velocity.col(static_cast<Index>(j)) = v;
      auto applied = request.applied.template segment<3>(3 * static_cast<Index>(j));
      if (slots_[j] >= 0) {
        applied = last.applied.template segment<3>(3 * slots_[j]);
      } else if (after.settings.input == GripInput::Pose) {
        applied = v;
      }
    }
  }

 private:
  static Scalar number(Index count) { return Scalar(static_cast<double>(count)); }
  static Index size(const FingerColumns& f) { return static_cast<Index>(f.held_slots.size()); }
  static int vertex(const Basis& basis, const FingerColumns& f, Index j) {
    return basis.held()
        .vertices()[static_cast<std::size_t>(f.held_slots[static_cast<std::size_t>(j)])];
  }
  /// Returns the place of a vertex among those of a finger, or -1.
  static Index find(const Basis& basis, const FingerColumns& f, int v) {
    for (Index j = 0; j < size(f); ++j) {
      if (vertex(basis, f, j) == v) return j;
    }
    return -1;
  }
  static const FingerColumns* find(const Basis& basis, int grip, int finger) {
    for (const FingerColumns& f : basis.fingers()) {
      if (f.grip == grip && f.finger == finger) return &f;
    }
    return nullptr;
  }

  /// Returns the slot of vertex `v` in the earlier grip `g`, or -1.
  Index slot_before(int g, int v) const {
    const HeldVertices<Scalar>& held = before_.held();
    const std::size_t i = static_cast<std::size_t>(g);
    for (std::size_t j = held.grip_begin(i); j < held.grip_begin(i + 1); ++j) {
      if (held.vertices()[j] == v) return static_cast<Index>(j);
    }
    return -1;
  }

  void find_grips() {
    const HeldVertices<Scalar>& held = after_.held();
    const int count = static_cast<int>(before_.held().grip_count());
    grips_.assign(held.grip_count(), -1);
    const auto free = [this](int last) {
      return std::find(grips_.begin(), grips_.end(), last) == grips_.end();
    };
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      Index most = 0;
      int found = -1;
      for (int last = 0; last < count; ++last) {
        Index shared = 0;
        for (std::size_t j = held.grip_begin(g); j < held.grip_begin(g + 1); ++j)
          shared += slot_before(last, held.vertices()[j]) < 0 ? 0 : 1;
        if (shared <= most || !free(last)) continue;
        most = shared;
        found = last;
      }
      grips_[g] = found;
    }
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      const int same = static_cast<int>(g);
      if (grips_[g] < 0 && same < count && free(same)) grips_[g] = same;
    }
  }

  /// Fills the columns of W that belong to a finger of the earlier set.
  void weigh(const FingerColumns& last) {
    const auto found = std::find(grips_.begin(), grips_.end(), last.grip);
    const int g = found == grips_.end() ? -1 : static_cast<int>(found - grips_.begin());
    const FingerColumns* now = g < 0 ? nullptr : find(after_, g, last.finger);
    if (now == nullptr) {
      share_out(last, g);
      return;
    }
    Index kept = 0;
    for (Index i = 0; i < size(*now); ++i)
      kept += find(before_, last, vertex(after_, *now, i)) < 0 ? 0 : 1;
    const Scalar all = number(size(*now));
    for (Index j = 0; j < size(last); ++j) {
      const Index stays = find(after_, *now, vertex(before_, last, j));
      for (Index i = 0; i < size(*now); ++i) {
        Scalar& weight = weights_(now->first_force + i, last.first_force + j);
        if (i == stays) {
          weight = number(kept) / all;
        } else if (stays < 0 || find(before_, last, vertex(after_, *now, i)) < 0) {
          weight = Scalar(1) / all;
        }
      }
    }
  }

  /// Shares the forces of a finger that is gone out in grip `g`, or among all when that is -1.
  void share_out(const FingerColumns& last, int g) {
    Index first = 0, count = 0;
    for (const FingerColumns& f : after_.fingers()) {
      if (g >= 0 && f.grip != g) continue;
      if (count == 0) first = f.first_force;
      count += size(f);
    }
    weights_.block(first, last.first_force, count, size(last))
        .setConstant(Scalar(1) / number(count));
  }

  /// Fills the rows of the map that belong to the coefficients of finger `now`. Those of generators
  /// on the same vertices correspond in order.
  void map_coefficients(const FingerColumns& now) {
    const int g = grips_[static_cast<std::size_t>(now.grip)];
    const FingerColumns* last = g < 0 ? nullptr : find(before_, g, now.finger);
    if (last == nullptr) return;
    for (Index i = 0; i < now.count; ++i) {
      const auto [rows, order] = support(after_, now, i);
      for (Index j = 0; j < last->count; ++j) {
        const auto [columns, other] = support(before_, *last, j);
        if (order != other) continue;
        unknowns_(now.column + i, last->column + j) =
            weights_
                .block(now.first_force + rows.first, last->first_force + columns.first, rows.second,
                       columns.second)
                .sum() /
            number(columns.second);
      }
    }
  }

  /// Returns the support of generator `i` of a finger, and how many earlier ones have the same.
  static std::pair<RowRange, int> support(const Basis& basis, const FingerColumns& f, Index i) {
    using Traits = contact_traits<Contact>;
    const Contact& contact = basis.finger(f).contact;
    const RowRange own = Traits::support(contact, size(f), i);
    int order = 0;
    for (Index j = 0; j < i; ++j) order += Traits::support(contact, size(f), j) == own ? 1 : 0;
    return {own, order};
  }

  void map_poses() {
    for (std::size_t g = 0; g < grips_.size(); ++g) {
      if (grips_[g] < 0) continue;
      const std::size_t last = static_cast<std::size_t>(grips_[g]);
      const auto [row, rows] = PoseBasis<Scalar>::columns(after_.held(), g);
      const auto [column, columns] = PoseBasis<Scalar>::columns(before_.held(), last);
      unknowns_.template block<3, 3>(row, column).setIdentity();
      if (columns == 6) {
        const Vector3<Scalar> arm = -jump(g);
        unknowns_.template block<3, 3>(row, column + 3) = cross_matrix<Scalar>(arm);
        if (rows == 6) unknowns_.template block<3, 3>(row + 3, column + 3).setIdentity();
      }
    }
  }

  /// The rigid motion of grip `g` in frame `k`.
  RigidVelocity<Scalar> velocity(std::size_t g, const MatrixX<Scalar>& last, Index k,
                                 const PointsView<Scalar>& measured) const {
    if (grips_[g] < 0) {
      const Vector3<Scalar> zero = Vector3<Scalar>::Zero();
      return {zero, after_.held().centroid(measured, g), zero};
    }
    const HeldVertices<Scalar>& held = before_.held();
    const std::size_t from = static_cast<std::size_t>(grips_[g]), begin = held.grip_begin(from);
    const Index count = static_cast<Index>(held.grip_size(from));
    Points<Scalar> places(3, count), velocities(3, count);
    for (Index j = 0; j < count; ++j) {
      const Index at = static_cast<Index>(begin) + j;
      places.col(j) = x_.col(held.vertices()[static_cast<std::size_t>(at)]);
      velocities.col(j) = last.template block<3, 1>(3 * at, k);
    }
    return fit_rigid_velocity<Scalar>(places, velocities);
  }

  const Basis& before_;
  const Basis& after_;
  Points<Scalar> x_;
  std::vector<int> grips_;
  std::vector<Index> slots_;
  MatrixX<Scalar> weights_, unknowns_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
