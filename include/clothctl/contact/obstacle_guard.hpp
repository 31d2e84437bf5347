#pragma once

// Keeps a sheet from passing through thin obstacles, after a step of any model that went from x to
// y. A model moves the points of contact that were listed at the start of the step; where a needle
// or the rim of a plate slides on to another place within it, nothing holds. Here every triangle
// is followed on its way, and if the obstacle, which is convex, comes between, y is mended:
//
//   p_i(t) = x_i + t r_i,   r_i = Rᵀ(y_i - c - h v) + c - x_i,   0 <= t <= 1
//
// is its way as seen from the obstacle, with the rotation R about c and the velocity v of the
// obstacle in the step h; they follow from the velocities of its surface at eight places.
//
//   1. Impacts are found by collision/triangle_sweep.hpp.
//   2. The closest point at the impact then keeps n·Σ w_i p_i(1) >= a quarter of the thickness, by
//      impulses along R n (Gauss-Seidel over all impacts so far). Search and sweeps alternate.
//   3. What still passes after `kRounds` goes with the obstacle: r_i = 0, and so does its velocity.
//
// Only obstacles that are thin next to the way and the thickness need this; in others a point that
// is too deep still knows the way out. A triangle that starts inside goes no deeper.

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/collision/triangle_sweep.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/math/rotation.hpp"

#include <Eigen/LU>

namespace clothctl::inline CLOTHCTL_ABI {

/// What a guard did.
struct ObstacleGuardReport {
  /// Impacts, vertices that went with an obstacle, and triangles that pass all the same since
  /// their vertices are held or there was no room.
  int impacts = 0, zones = 0, left = 0;
};

/// Keeps one sheet out of thin obstacles. `create` allocates; nothing else does.
template <RealScalar S>
class ObstacleGuard {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The obstacles of a step.
  using Obstacles = std::span<const ColliderRef<Scalar>>;

  /// Makes a guard for a sheet of `vertices` with these triangles, whose vertices must be on it.
  /// Allocates.
  static ObstacleGuard create(Index vertices, const std::vector<std::array<int, 3>>& triangles) {
    ObstacleGuard guard;
    guard.triangles_ = triangles;
    const std::size_t n = static_cast<std::size_t>(vertices);
    guard.near_.resize(n);
    guard.mark_.assign(n, 0);
    guard.y_.setZero(3, vertices);
    guard.inverse_.setZero(vertices);
    guard.impacts_.reserve(2 * n + 256);
    return guard;
  }

  /// Mends the end of a step of `dt` s from the positions `x` (3×n, m), whose contacts with
  /// `obstacles` were listed for it. Changes positions and velocities of `state`, and adds the
  /// impulses to the contacts. `inverse_mass` (n, 1/kg) is 0 for vertices whose motion is
  /// prescribed. A state of another size stays as it is.
  ObstacleGuardReport resolve(Obstacles obstacles, const Points<Scalar>& x,
                              const VectorX<Scalar>& inverse_mass, const Scalar& dt,
                              ObstacleContacts<Scalar>& contacts, ClothState<Scalar>& state);

 private:
  using Vec = Vector3<Scalar>;
  static constexpr int kRounds = 12, kZoneRounds = 24, kSweeps = 30;

  /// How an obstacle moves in the step.
  struct Motion {
    Matrix3<Scalar> R;
    /// c, c + h v.
    Vec centre, moved;

    Vec back(const Vec& y) const { return R.transpose() * Vec(y - moved) + centre; }
    Vec along(const Vec& x) const { return R * Vec(x - centre) + moved; }
  };

  /// A point of the sheet that must stay on its side of a plane: R n·Σ w_i y_i >= level.
  struct Impact {
    SheetContact<Scalar> point;
    int obstacle;
    Motion motion;
    Vec normal;
    Scalar level;
    /// Multiplier along the normal, kg m.
    Scalar pressed;
    /// Whether it is a vertex that goes with the obstacle.
    bool carried;
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  /// Looks for impacts with an obstacle or its parts, and adds them. Returns their number.
  int search(const ColliderRef<Scalar>& part, int obstacle, const Points<Scalar>& x);
  int search_triangle(const ColliderRef<Scalar>& part, int obstacle, const Motion& motion,
                      const std::array<int, 3>& t, const Points<Scalar>& x);
  /// Returns the motion of an obstacle near a sheet in `own`.
  Motion motion_of(const ColliderRef<Scalar>& part, const BoundingBox<Scalar>& own) const;
  static BoundingBox<Scalar> box_of(const Points<Scalar>& x);
  /// Asks about a vertex once in a search.
  const SurfacePoint<Scalar>& answer_at(const ColliderRef<Scalar>& part, int v,
                                        const Points<Scalar>& x) {
    if (mark_[at(v)] != now_) {
      mark_[at(v)] = now_;
      near_[at(v)] = surface_point_at<Scalar>(part, x.col(v));
    }
    return near_[at(v)];
  }
  void sweep();
  /// Lets the vertices of the impacts from `first` on go with their obstacles.
  void carry(std::size_t first, const Points<Scalar>& x, ObstacleGuardReport& report);
  /// Writes positions and velocities, and adds the impulses to the contacts.
  void store(const Points<Scalar>& x, const VectorX<Scalar>& inverse_mass,
             ObstacleContacts<Scalar>& contacts, ClothState<Scalar>& state) const;

  std::vector<std::array<int, 3>> triangles_;
  std::vector<SurfacePoint<Scalar>> near_;
  std::vector<int> mark_;
  int now_ = 0;
  std::vector<Impact> impacts_;
  Points<Scalar> y_;
  VectorX<Scalar> inverse_;
  Scalar h_ = Scalar(0), thickness_ = Scalar(0);
};

template <RealScalar S>
ObstacleGuardReport ObstacleGuard<S>::resolve(Obstacles obstacles, const Points<Scalar>& x,
                                              const VectorX<Scalar>& inverse_mass, const Scalar& dt,
                                              ObstacleContacts<Scalar>& contacts,
                                              ClothState<Scalar>& state) {
  ObstacleGuardReport report;
  if (contacts.contacts().empty() || x.cols() != y_.cols() || state.positions.cols() != y_.cols() ||
      inverse_mass.size() != y_.cols())
    return report;
  h_ = dt;
  thickness_ = contacts.settings().thickness;
  y_ = state.positions;
  inverse_ = inverse_mass;
  impacts_.clear();
  for (int round = 0; round < kRounds + kZoneRounds; ++round) {
    const std::size_t first = impacts_.size();
    int found = 0;
    // Contacts are listed obstacle by obstacle.
    int last = -1;
    for (const ObstacleContact<Scalar>& c : contacts.contacts()) {
      if (c.obstacle == last) continue;
      last = c.obstacle;
      found += search(obstacles[at(last)], last, x);
    }
    report.left = found;
    if (found == 0) break;
    report.impacts += found;
    if (kRounds <= round) carry(first, x, report);
    sweep();
  }
  if (impacts_.empty()) return report;
  store(x, inverse_mass, contacts, state);
  return report;
}

template <RealScalar S>
int ObstacleGuard<S>::search(const ColliderRef<Scalar>& part, int obstacle,
                             const Points<Scalar>& x) {
  const Index parts = part.part_count();
  int found = 0;
  for (Index i = 0; i < parts; ++i) found += search(part.part(i), obstacle, x);
  if (parts > 0 || !part.is_convex()) return found;
  ++now_;
  const BoundingBox<Scalar> box = part.bounds(h_).grown(thickness_);
  BoundingBox<Scalar> sheet = box_of(x);
  sheet.include(box_of(y_));
  if (!box.overlaps(sheet)) return found;
  const Motion motion = motion_of(part, sheet);
  for (const std::array<int, 3>& t : triangles_) {
    BoundingBox<Scalar> own{x.col(t[0]), x.col(t[0])};
    for (const int v : t) {
      own.include(x.col(v));
      own.include(y_.col(v));
    }
    if (box.overlaps(own)) found += search_triangle(part, obstacle, motion, t, x);
  }
  return found;
}

template <RealScalar S>
BoundingBox<S> ObstacleGuard<S>::box_of(const Points<Scalar>& x) {
  BoundingBox<Scalar> box{x.col(0), x.col(0)};
  for (Index v = 1; v < x.cols(); ++v) box.include(x.col(v));
  return box;
}

template <RealScalar S>
auto ObstacleGuard<S>::motion_of(const ColliderRef<Scalar>& part,
                                 const BoundingBox<Scalar>& own) const -> Motion {
  BoundingBox<Scalar> box = part.bounds(Scalar(0));
  const BoundingBox<Scalar> room = own.grown(Scalar(1));
  for (int i = 0; i < 3; ++i) {  // an obstacle may be endless
    if (box.lower[i] < room.lower[i]) box.lower[i] = room.lower[i];
    if (room.upper[i] < box.upper[i]) box.upper[i] = room.upper[i];
  }
  std::array<SurfacePoint<Scalar>, 8> there;
  Vec centre = Vec::Constant(Scalar(0)), velocity = centre, turn = centre;
  for (std::size_t k = 0; k < 8; ++k) {
    there[k] = surface_point_at<Scalar>(part, Vec((k & 1U) != 0 ? box.upper[0] : box.lower[0],
                                                  (k & 2U) != 0 ? box.upper[1] : box.lower[1],
                                                  (k & 4U) != 0 ? box.upper[2] : box.lower[2]));
    centre += Scalar(0.125) * there[k].point;
    velocity += Scalar(0.125) * there[k].velocity;
  }
  // Least squares: Σ d×(w×d) = Σ d×e. A turn about the line that all places are on has no effect.
  Matrix3<Scalar> matrix = Matrix3<Scalar>::Constant(Scalar(0));
  Scalar size(0);
  for (const SurfacePoint<Scalar>& q : there) {
    const Vec d = q.point - centre;
    const Scalar square = d.squaredNorm();
    turn += d.cross(Vec(q.velocity - velocity));
    matrix -= d * d.transpose();
    for (int i = 0; i < 3; ++i) matrix(i, i) += square;
    size += square;
  }
  Motion out{Matrix3<Scalar>::Identity(), centre, centre + h_ * velocity};
  if (!(Scalar(0) < turn.squaredNorm())) return out;
  for (int i = 0; i < 3; ++i) matrix(i, i) += Scalar(1e-6) * size;
  turn = matrix.inverse() * turn;
  out.R = rotation_exp<Scalar>(Vec(h_ * turn));
  return out;
}

template <RealScalar S>
int ObstacleGuard<S>::search_triangle(const ColliderRef<Scalar>& part, int obstacle,
                                      const Motion& motion, const std::array<int, 3>& t,
                                      const Points<Scalar>& x) {
  std::array<Vec, 3> p, r;
  for (std::size_t k = 0; k < 3; ++k) {
    p[k] = x.col(t[k]);
    r[k] = motion.back(y_.col(t[k])) - p[k];
  }
  const std::array<SurfacePoint<Scalar>, 3> corner{
      answer_at(part, t[0], x), answer_at(part, t[1], x), answer_at(part, t[2], x)};
  const TriangleSweep<Scalar> sweep(part, thickness_);
  TriangleImpact<Scalar> met;
  if (!sweep.find(p, r, corner, met)) return 0;
  if (impacts_.size() == impacts_.capacity()) return 1;
  Impact impact{};
  impact.point.vertex = t;
  impact.point.weight = met.weight;
  impact.obstacle = obstacle;
  impact.pressed = Scalar(0);
  impact.carried = false;
  impact.point.position.setZero();
  for (std::size_t k = 0; k < 3; ++k)
    impact.point.position += impact.point.weight[static_cast<Index>(k)] * p[k];
  SurfacePoint<Scalar>& surface = impact.point.surface;
  surface = surface_point_at<Scalar>(part, met.foot);
  surface.point = met.foot;
  surface.normal = met.normal;
  surface.distance = met.normal.dot(Vec(impact.point.position - met.foot));
  impact.motion = motion;
  impact.normal = motion.R * met.normal;
  impact.level = impact.normal.dot(motion.along(met.foot)) + met.target;
  impacts_.push_back(impact);
  return 1;
}

template <RealScalar S>
void ObstacleGuard<S>::sweep() {
  for (int pass = 0; pass < kSweeps; ++pass) {
    Scalar largest(0);
    for (Impact& impact : impacts_) {
      const SheetContact<Scalar>& c = impact.point;
      Scalar lightness(0), height(0);
      for (std::size_t k = 0; k < 3 && c.vertex[k] >= 0; ++k) {
        const Scalar& w = c.weight[static_cast<Index>(k)];
        lightness += w * w * inverse_[c.vertex[k]];
        height += w * impact.normal.dot(Vec(y_.col(c.vertex[k])));
      }
      if (!(Scalar(0) < lightness)) continue;
      Scalar pressed = impact.pressed + (impact.level - height) / lightness;
      if (pressed < Scalar(0)) pressed = Scalar(0);
      const Scalar by = pressed - impact.pressed;
      impact.pressed = pressed;
      for (std::size_t k = 0; k < 3 && c.vertex[k] >= 0; ++k) {
        const Scalar& w = c.weight[static_cast<Index>(k)];
        y_.col(c.vertex[k]) += (by * w * inverse_[c.vertex[k]]) * impact.normal;
      }
      const Scalar moved = (by < Scalar(0) ? Scalar(-by) : by) * lightness;
      if (largest < moved) largest = moved;
    }
    if (!(Scalar(0.01) * thickness_ < largest)) return;
  }
}

template <RealScalar S>
void ObstacleGuard<S>::carry(std::size_t first, const Points<Scalar>& x,
                             ObstacleGuardReport& report) {
  const std::size_t last = impacts_.size();
  for (std::size_t i = first; i < last; ++i) {
    const Impact impact = impacts_[i];
    for (const int v : impact.point.vertex) {
      if (!(Scalar(0) < inverse_[v]) || impacts_.size() == impacts_.capacity()) continue;
      Impact held = impact;
      held.point.vertex = {v, -1, -1};
      held.point.weight = Vec(Scalar(1), Scalar(0), Scalar(0));
      held.point.position = x.col(v);
      held.pressed = Scalar(0);  // what it receives is told by where it ends
      held.carried = true;
      y_.col(v) = impact.motion.along(x.col(v));
      inverse_[v] = Scalar(0);
      impacts_.push_back(held);
      ++report.zones;
    }
  }
}

template <RealScalar S>
void ObstacleGuard<S>::store(const Points<Scalar>& x, const VectorX<Scalar>& inverse_mass,
                             ObstacleContacts<Scalar>& contacts, ClothState<Scalar>& state) const {
  const auto change = [&](int v) -> Vec {
    // A model's velocity at the end of a step need not be its displacement by the step.
    const bool carried = Scalar(0) < inverse_mass[v] && !(Scalar(0) < inverse_[v]);
    if (carried) return Vec(y_.col(v) - x.col(v)) / h_ - state.velocities.col(v);
    return Vec(y_.col(v) - state.positions.col(v)) / h_;
  };
  for (const Impact& impact : impacts_) {
    Vec impulse = (impact.pressed / h_) * impact.normal;
    if (impact.carried) {
      // What changed its velocity, less its share of the impulses along normals.
      const int v = impact.point.vertex[0];
      impulse = change(v) / inverse_mass[v];
      for (const Impact& other : impacts_) {
        for (std::size_t k = 0; k < 3; ++k) {
          if (other.point.vertex[k] != v) continue;
          const Scalar& w = other.point.weight[static_cast<Index>(k)];
          impulse -= (w * other.pressed / h_) * other.normal;
        }
      }
    }
    if (Scalar(0) < impulse.squaredNorm()) contacts.add(impact.point, impact.obstacle, impulse);
  }
  for (Index v = 0; v < y_.cols(); ++v) {
    const Vec by = change(static_cast<int>(v));
    if (!(Scalar(0) < by.squaredNorm())) continue;
    state.positions.col(v) = y_.col(v);
    state.velocities.col(v) += by;
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class ObstacleGuard<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
