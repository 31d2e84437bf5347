#pragma once

// Contacts with obstacles inside an implicit step of a mass-spring sheet. Contact c acts at the
// point Σ w_i x_i of up to three vertices, with the unit normal n, the gap g at the start of the
// step h, the velocity u = Σ w_i v_i - u_s relative to the surface at the end of it, and the force
// f⁰ that it had in the last step:
//
//   f_n = max(0, f⁰_n - k (g + h u_n))
//   t   = f⁰_t - k_t h u_t,    f_t = t  if |t| <= μ f_n  (it sticks),  else  μ f_n t/|t|  (it
//   slips)
//
// k = κ m/h², with m the mass of the point, κ = 60 (400 inside edges and triangles), and k_t = k/4.
// f⁰_t is the friction of the last step: a spring from where it stuck, so that a contact which
// sticks does not creep. Along the normal, a share β = 0.1 of what the penalty adds is carried
// over, f⁰_n + β (f_n - f⁰_n), so that the depth vanishes as a contact lasts, at any load. Carrying
// all of it over (the method of multipliers, β = 1) is unstable where a point has to stop a mass M
// of the sheet above κ m/β: the depth x then obeys M x''' + k (h x'' + x' + β x/h) = 0. Larger
// penalties take more rounds.
//
// With the share γ = 1 (sticks) or μ f_n/|t| (slips) the forces of closed contacts are linear in v,
//
//   f = f⁰_n n - k g n + γ f⁰_t - h K u,      K = k n nᵀ + γ k_t (I - n nᵀ)
//
// so that a step is (A + h² Σ WᵀK W) v = b + h Σ Wᵀ f(0): blocks that couple the vertices of a
// triangle, which springs couple already. Solving and finding the states and shares again alternate
// (rounds) until the forces no longer change.
//
// The first states are those at the velocities of the start: where a sheet rests, they are those of
// the end, too. (A free fall would close all that is within g h² of an obstacle, to be opened round
// by round.)
//
// Newton's method takes the energy f_n²/(2k) along the normal, and across it Huber's function of t
// with the bound μ f_n frozen at the last iterate. Reference: Alart and Curnier, 1991.

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/cloth/detail/factor_changes.hpp"
#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/linalg/block_symmetric.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A contact within a step.
template <RealScalar Scalar>
struct ContactSpring {
  /// n, f⁰ (N), velocity of the surface (m/s), force of the last solve (N).
  Triple<Scalar> normal, held_force, surface, force;
  /// Its part h² K of the step matrix, and of the one that was factored.
  Matrix3<Scalar> block, factored;
  /// 1/m, 1/kg.
  Scalar lightness;
  /// Normal force of the last step, N.
  Scalar expected;
  /// g without the part that a step may not push out, and all of it, m; k, N/m; μ; γ; the bound
  /// μ f_n of Newton's method, N.
  Scalar gap, true_gap, stiffness, friction, share, bound;
  /// Whether it is closed, and whether it sticks.
  bool closed, sticks;
};

/// Memory of the contacts of a step.
template <RealScalar Scalar>
using ContactSpringList = ReservedList<ContactSpring<Scalar>>;

/// The contacts of one step of a sheet.
template <RealScalar S>
class ContactSprings {
 public:
  /// The scalar type.
  using Scalar = S;
  using Vec = Triple<Scalar>;
  using Contact = ObstacleContact<Scalar>;
  using Spring = ContactSpring<Scalar>;

  /// κ of vertices and of points inside edges and triangles, and k_t as a share of k. The latter
  /// points are on sharp obstacles, which few of them keep from piercing the sheet.
  static constexpr double kPenalty = 60, kSharpPenalty = 400, kShare = 0.25;
  /// β.
  static constexpr double kCarry = 0.1;

  /// Refers to the contacts of a step of `h` s of a sheet with these masses, and to memory with
  /// room for them.
  /// `held`: 1 for vertices whose motion is prescribed.
  ContactSprings(ObstacleContacts<Scalar>& contacts, ContactSpringList<Scalar>& memory,
                 const VectorX<Scalar>& mass, const std::vector<unsigned char>& held,
                 const Scalar& h)
      : contacts_(contacts.contacts()), springs_(memory), h_(h) {
    springs_.clear();
    for (const Contact& c : contacts_) springs_.push_back(make(c, mass, held, contacts.settings()));
  }

  /// Sets states and shares by the velocities `v` (3×n, m/s) and the forces of the last step.
  void predict(const Points<Scalar>& v) {
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      Spring& s = springs_[i];
      classify(s, relative(i, v));
      // What the last step found is a better guess of the normal force than these velocities.
      const Scalar known = s.expected;
      if (!s.closed || s.sticks || !(Scalar(0) < known)) continue;
      const Scalar across = norm(tangential(s, s.held_force));
      const Scalar limit = s.friction * known;
      const bool stuck = across < Scalar(0.999) * limit;
      s.share = stuck ? Scalar(1) : s.share;
      s.sticks = stuck;
    }
  }

  /// Takes the forces of a solve that gave the velocities, and then sets states and shares by
  /// these. With `opens`, none closes.
  void update(const Points<Scalar>& v, bool opens = false) {
    force_change_ = velocity_change_ = Scalar(0);
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      Spring& s = springs_[i];
      const Vec u = relative(i, v);
      s.force = linear_force(s, u);
      const bool may_close = s.closed || !opens;
      classify(s, u);
      s.closed = s.closed && may_close;
      if (!(Scalar(0) < s.stiffness)) continue;
      const Scalar by = norm(linear_force(s, u) - s.force);
      const Scalar speed = by * h_ * s.lightness;
      if (force_change_ < by) force_change_ = by;
      if (velocity_change_ < speed) velocity_change_ = speed;
    }
    ++rounds_;
  }

  /// Sets sticking or slipping and shares by the velocities; what is closed stays closed.
  void update_friction(const Points<Scalar>& v) {
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      Spring& s = springs_[i];
      if (!s.closed) continue;
      classify(s, relative(i, v));
      s.closed = true;
    }
  }

  /// Takes the forces at the velocities that the present states give.
  void take(const Points<Scalar>& v) {
    for (std::size_t i = 0; i < springs_.size(); ++i)
      springs_[i].force = linear_force(springs_[i], relative(i, v));
  }

  /// Adds h² Σ WᵀK W to a step matrix without contacts.
  void add_blocks(BlockSymmetric<Scalar>& matrix) {
    for (Spring& s : springs_) s.block.setZero();
    replace_blocks(matrix);
  }

  /// Replaces what the step matrix has of the contacts by h² Σ WᵀK W at the present states.
  void replace_blocks(BlockSymmetric<Scalar>& matrix) {
    for (std::size_t i = 0; i < springs_.size(); ++i) replace_block_of(i, matrix);
  }

  /// Remembers that the step matrix is factored as it is now.
  void note_factor() {
    for (Spring& s : springs_) s.factored = s.block;
  }

  /// Lists how the step matrix differs from the one that was factored. Returns false, and lists
  /// none, where there are too many changes, or the matrix has no room for one.
  bool list_changes(const BlockSymmetric<Scalar>& matrix, FactorChanges<Scalar>& changes) const {
    changes.clear();
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      const Matrix3<Scalar> block = springs_[i].block - springs_[i].factored;
      if ((block.array() == Scalar(0)).all()) continue;
      const SheetContact<Scalar>& p = contacts_[i].point;
      if (changes.full() || !couples(matrix, p.vertex)) {
        changes.clear();
        return false;
      }
      changes.add({p.vertex, p.weight, block});
    }
    return true;
  }

  /// Calls add(vertex, Wᵀ f(0)), N, for the vertices of all closed contacts.
  template <class Add>
  void for_each_constant_force(Add add) const {
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      if (!springs_[i].closed) continue;
      const Vec f = linear_force(springs_[i], springs_[i].surface * Scalar(-1));
      for_each_vertex(i, [&](int vertex, const Scalar& w) { add(vertex, f * w); });
    }
  }

  /// Calls add(vertex, Wᵀ f), N, for the vertices of all contacts, with the forces of the last
  /// solve.
  template <class Add>
  void for_each_force(Add add) const {
    for (std::size_t i = 0; i < springs_.size(); ++i)
      for_each_vertex(i, [&](int vertex, const Scalar& w) { add(vertex, springs_[i].force * w); });
  }

  /// Sets states and shares, and freezes the bounds of friction, at an iterate of Newton's method.
  /// Takes the forces there.
  void freeze(const Points<Scalar>& v) {
    ++rounds_;
    force_change_ = velocity_change_ = Scalar(0);
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      Spring& s = springs_[i];
      const Vec u = relative(i, v), before = s.force;
      classify(s, u);
      s.bound = s.closed ? s.friction * normal_force(s, u) : Scalar(0);
      s.force = linear_force(s, u);
      if (!(Scalar(0) < s.stiffness)) continue;
      const Scalar by = norm(s.force - before), speed = by * h_ * s.lightness;
      if (force_change_ < by) force_change_ = by;
      if (velocity_change_ < speed) velocity_change_ = speed;
    }
  }

  /// Returns the energy of the contacts at `v`, J, with frozen bounds. Adds its gradient to
  /// `gradient` (3×n, N s).
  Scalar add_energy(const Points<Scalar>& v, Points<Scalar>& gradient) const {
    Scalar energy = Scalar(0);
    const Scalar half = Scalar(0.5);
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      const Spring& s = springs_[i];
      if (!(Scalar(0) < s.stiffness)) continue;
      const Vec u = relative(i, v);
      const Scalar f_n = normal_force(s, u);
      Vec f{Scalar(0), Scalar(0), Scalar(0)};
      if (Scalar(0) < f_n) {
        f = s.normal * f_n;
        energy += half * f_n * f_n / s.stiffness;
      }
      const Vec t = tangential(s, trial(s, u));
      const Scalar size = norm(t);
      if (size < s.bound) {
        f = f + t;
        energy += half * size * size / (Scalar(kShare) * s.stiffness);
      } else if (Scalar(0) < s.bound) {
        f = f + t * (s.bound / size);
        energy += s.bound * (size - half * s.bound) / (Scalar(kShare) * s.stiffness);
      }
      for_each_vertex(i, [&](int vertex, const Scalar& w) {
        subtract_from_column(gradient, vertex, f * (h_ * w));
      });
    }
    return energy;
  }

  /// Writes impulses and states of the last solve, which gave the velocities `v`, to the contacts
  /// and to their report.
  void store(const Points<Scalar>& v, ObstacleContactReport<Scalar>& report) {
    report = {};
    report.rounds = rounds_;
    report.force_residual = force_change_;
    report.velocity_residual = velocity_change_;
    for (std::size_t i = 0; i < springs_.size(); ++i) {
      const Spring& s = springs_[i];
      Contact& c = contacts_[i];
      const Scalar gap = s.true_gap + h_ * dot(relative(i, v), s.normal);
      if (gap < -report.penetration) report.penetration = -gap;
      const Vec p = s.force * h_;
      c.impulse = Vector3<Scalar>(p.x, p.y, p.z);
      const Scalar from = dot(s.held_force, s.normal);
      c.carried = from + Scalar(kCarry) * (dot(s.force, s.normal) - from);
      if (!(Scalar(0) < squared_norm(s.force))) {
        c.state = ContactState::Open;
        c.carried = Scalar(0);
        c.age = 0;
        continue;
      }
      c.state = s.sticks ? ContactState::Stick : ContactState::Slip;
      ++c.age;
      ++report.closed;
      if (!s.sticks) ++report.slipping;
    }
  }

 private:
  Spring make(const Contact& c, const VectorX<Scalar>& mass, const std::vector<unsigned char>& held,
              const ObstacleContactSettings<Scalar>& settings) const;

  static Scalar norm(const Vec& a) {
    using std::sqrt;
    return sqrt(squared_norm(a));
  }
  static Vec tangential(const Spring& s, const Vec& a) { return a - s.normal * dot(a, s.normal); }

  template <class Function>
  void for_each_vertex(std::size_t i, Function function) const {
    const SheetContact<Scalar>& p = contacts_[i].point;
    for (std::size_t k = 0; k < 3 && p.vertex[k] >= 0; ++k)
      function(p.vertex[k], p.weight[static_cast<Index>(k)]);
  }
  Vec relative(std::size_t i, const Points<Scalar>& v) const {
    Vec u = springs_[i].surface * Scalar(-1);
    for_each_vertex(i, [&](int vertex, const Scalar& w) { u = u + column(v, vertex) * w; });
    return u;
  }
  /// f⁰ - k h u - k g n, whatever the signs.
  Vec trial(const Spring& s, const Vec& u) const {
    const Scalar u_n = dot(u, s.normal), k = s.stiffness, across = Scalar(kShare) * k;
    return s.held_force - (u - s.normal * u_n) * (across * h_) -
           s.normal * (k * (s.gap + h_ * u_n));
  }
  Scalar normal_force(const Spring& s, const Vec& u) const { return dot(trial(s, u), s.normal); }
  Vec linear_force(const Spring& s, const Vec& u) const {
    if (!s.closed) return {Scalar(0), Scalar(0), Scalar(0)};
    const Vec f = trial(s, u);
    const Vec along = s.normal * dot(f, s.normal);
    return along + (f - along) * s.share;
  }
  void classify(Spring& s, const Vec& u) const {
    const Vec f = trial(s, u);
    const Scalar f_n = dot(f, s.normal);
    s.closed = Scalar(0) < f_n;
    s.share = Scalar(1);
    s.sticks = s.closed;
    if (!s.closed) return;
    const Scalar size = norm(f - s.normal * f_n), limit = s.friction * f_n;
    if (!(limit < size)) return;
    s.sticks = false;
    s.share = limit / size;
  }
  /// Whether springs couple all vertices of a contact.
  static bool couples(const BlockSymmetric<Scalar>& matrix, const std::array<int, 3>& vertex) {
    for (std::size_t a = 0; a < 3 && vertex[a] >= 0; ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        if (matrix.find(vertex[a], vertex[b]) < 0) return false;
      }
    }
    return true;
  }
  Matrix3<Scalar> block_of(const Spring& s) const;
  void replace_block_of(std::size_t i, BlockSymmetric<Scalar>& matrix);

  std::span<Contact> contacts_;
  ContactSpringList<Scalar>& springs_;
  Scalar h_;
  int rounds_ = 0;
  Scalar force_change_ = Scalar(0), velocity_change_ = Scalar(0);
};

template <RealScalar S>
auto ContactSprings<S>::make(const Contact& c, const VectorX<Scalar>& mass,
                             const std::vector<unsigned char>& held,
                             const ObstacleContactSettings<Scalar>& settings) const -> Spring {
  const Scalar zero = Scalar(0);
  Spring s;
  s.normal = triple<Scalar>(c.point.surface.normal);
  s.surface = triple<Scalar>(c.point.surface.velocity);
  s.friction = c.point.surface.friction;
  s.true_gap = s.gap = c.point.surface.distance + c.point.slack - settings.thickness;
  const Scalar deepest = zero - settings.push_out_speed * h_;
  if (s.gap < deepest) s.gap = deepest;
  Scalar inverse = zero, most = zero;
  const SheetContact<Scalar>& p = c.point;
  for (std::size_t k = 0; k < 3 && p.vertex[k] >= 0; ++k) {
    if (held[static_cast<std::size_t>(p.vertex[k])] != 0) continue;
    const Scalar w = p.weight[static_cast<Index>(k)], answer = w / mass[p.vertex[k]];
    inverse += w * answer;
    if (most < answer) most = answer;
  }
  // Where all vertices are held, or the free ones would have to move more than four times as far as
  // the point, no force is right: it has none.
  const bool moves = zero < inverse && !(Scalar(4) * inverse < most);
  if (!moves) inverse = Scalar(1) / mass[p.vertex[0]];
  const Vec before = triple<Scalar>(c.impulse) * (Scalar(1) / h_);
  const Scalar along = dot(before, s.normal);
  const Scalar penalty = Scalar(p.vertex[1] < 0 ? kPenalty : kSharpPenalty);
  s.stiffness = moves ? Scalar(penalty / (inverse * h_ * h_)) : zero;
  // The normal turns from step to step; what would pull is dropped.
  s.held_force = Vec{zero, zero, zero};
  if (moves && zero < along)
    s.held_force = before + s.normal * ((zero < c.carried ? c.carried : zero) - along);
  s.expected = along;
  s.force = Vec{zero, zero, zero};
  s.block.setZero();
  s.factored.setZero();
  s.lightness = inverse;
  s.share = Scalar(1);
  s.bound = zero;
  s.closed = moves && zero < along;
  s.sticks = c.state == ContactState::Stick;
  return s;
}

template <RealScalar S>
auto ContactSprings<S>::block_of(const Spring& s) const -> Matrix3<Scalar> {
  if (!s.closed) return Matrix3<Scalar>::Zero();
  const Scalar k = h_ * h_ * s.stiffness, across = Scalar(kShare) * k * s.share;
  Matrix3<Scalar> block = outer_product(s.normal, s.normal * (k - across));
  add_to_diagonal(block, across);
  return block;
}

template <RealScalar S>
void ContactSprings<S>::replace_block_of(std::size_t i, BlockSymmetric<Scalar>& matrix) {
  Spring& s = springs_[i];
  const Matrix3<Scalar> wanted = block_of(s), block = wanted - s.block;
  if ((block.array() == Scalar(0)).all()) return;
  s.block = wanted;
  const SheetContact<Scalar>& p = contacts_[i].point;
  const auto weight = [&](std::size_t a) { return p.weight[static_cast<Index>(a)]; };
  for (std::size_t a = 0; a < 3 && p.vertex[a] >= 0; ++a) {
    add_block<Scalar>(matrix.diagonal(p.vertex[a]), block * (weight(a) * weight(a)));
    for (std::size_t b = 0; b < a; ++b) {
      const Matrix3<Scalar> product = block * (weight(a) * weight(b));
      const int slot = matrix.find(p.vertex[a], p.vertex[b]);
      if (slot >= 0) {
        add_block<Scalar>(matrix.lower(slot), product);
        continue;
      }
      // No spring couples the two: a larger diagonal takes the place of the coupling.
      add_block<Scalar>(matrix.diagonal(p.vertex[a]), product);
      add_block<Scalar>(matrix.diagonal(p.vertex[b]), product);
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
