#pragma once

// How a sheet whose step can carry vertices (CarriedVertices) answers to pads in a world.
//
// Such a step moves light vertices by many small corrections. If the vertices between pads were
// free in it, they would give way as their neighbours do, and the sheet would tear away from its
// grip step by step. So each patch that pads hold (grip_patches.hpp) is a rigid body of the mass m
// of its vertices. In a step of h:
//
//   1. The sheet's step carries it with the velocity u: that of the pads where they stick, else its
//      own velocity v. The rest of the sheet pulls at it with the impulse -R.
//   2. The impulses p of the pads are found together with all else that they touch. With a share M
//      of the mass of the rest, the patch answers as
//
//        (m + M) (v⁺ - u) = m (v - u) + h m g + h f - R + p
//
//      and likewise to moments, with (m + M)/m times its inertia. f: forces of the input.
//   3. The patch moves with v⁺ for h, and the rest gets the momentum M (v⁺ - u).
//
// M foresees by how much more the rest would pull at a patch that does not move as it was carried.
// Without it, pads of the stiffness k and a taut sheet disturb each other, the more the longer they
// touch, where k h² < M. With it a patch that slides takes the sheet along. Half of the mass of the
// connected part of the sheet is divided equally among the patches on it, the other half as their
// Σ |R_i|. A patch that slides moves with the pads along the normal: what pokes a sheet does not
// have to push all of it at once. Linear momentum is kept to rounding, but for air, drag and
// attachments at the patch itself, which are left out. Reference: Badia, Nobile, Vergara,
// Fluid-structure partitioned procedures based on Robin transmission conditions, 2008.

#include <cmath>
#include <concepts>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "clothctl/cloth/carried_vertices.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/sim/detail/grip_patches.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A model whose step can carry vertices.
template <class Model>
concept CarryingModel = requires(const Model& model, typename Model::Workspace& ws) {
  { ws.carried } -> std::convertible_to<CarriedVertices<typename Model::Scalar>>;
  { ws.inverse_mass } -> std::convertible_to<VectorX<typename Model::Scalar>>;
  { model.settings().gravity } -> std::convertible_to<Vector3<typename Model::Scalar>>;
};

/// The answer of such a sheet. Its functions are those of SheetSide.
template <class Model>
class CarryingSide {
 public:
  using Scalar = typename Model::Scalar;
  using Workspace = typename Model::Workspace;

  std::string create(const Model& model, Index capacity) {
    const std::size_t room = static_cast<std::size_t>(capacity);
    point_.assign(static_cast<std::size_t>(model.vertex_count()), -1);
    touched_.reserve(room);
    grip_.reserve(room, model.vertex_count());
    bodies_.reserve(room);
    neighbours_ = VertexNeighbours<Scalar>(model.network());
    parts_.assign(static_cast<std::size_t>(neighbours_.part_count()), {});
    start_ = velocity_ = Points<Scalar>::Constant(3, capacity, Scalar(0));
    return {};
  }
  const VertexNeighbours<Scalar>* neighbours() const { return &neighbours_; }
  void carry(const GripPatches<Scalar>& grip, const ClothState<Scalar>& state, Workspace& ws);
  void hold(VectorX<Scalar>& inverse_masses) const {
    for (const int v : grip_.vertices()) inverse_masses[v] = Scalar(0);
  }
  void release(const Model& model, const ClothInput<Scalar>& input, const Scalar& dt,
               const Workspace& ws);
  StepStatus attach(std::span<const int> vertices, ClothState<Scalar>& state, Workspace& ws,
                    const VectorX<Scalar>& inverse_masses);
  int point(int vertex) const { return point_[static_cast<std::size_t>(vertex)]; }
  ImpulseResponseRef<Scalar> side() { return ImpulseResponseRef<Scalar>(*this); }
  /// `lies`: the sheet touches obstacles, which moves of places would not see.
  void take(const Scalar& dt, bool lies, const Workspace& ws);

  /// The touched vertices as points of a side (concept ImpulseResponse).
  Index point_count() const { return static_cast<Index>(touched_.size()); }
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    for (std::size_t i = 0; i < touched_.size(); ++i)
      u.template segment<3>(3 * static_cast<Index>(i)) = velocity(touched_[i]);
  }
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const;
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p);

 private:
  using Vec = Vector3<Scalar>;
  /// A touched vertex. On a patch: its number, and the way from the centre, m. Else: the velocity,
  /// m/s, and the inverse mass, 1/kg.
  struct Touched {
    int vertex, body;
    Vec arm, velocity;
    Scalar inverse_mass;
  };
  /// A connected part of the sheet: the mass of what is not held, kg; the patches on it, the sum of
  /// the magnitudes of their R, N s, and the momentum that is left for the rest.
  struct Part {
    Scalar mass = Scalar(0), load = Scalar(0), patches = Scalar(0);
    Vec left = Vec::Constant(Scalar(0));
  };
  /// A patch with M: its answer, centre, motion, and the velocity u of its centre.
  struct Body {
    std::size_t part;
    Scalar following, inverse_mass;
    Matrix3<Scalar> inverse_inertia;
    Vec centre, velocity, spin, carried;
  };
  static Vec zero() { return Vec::Constant(Scalar(0)); }
  static Matrix3<Scalar> skew(const Vec& a) {
    Matrix3<Scalar> out = Matrix3<Scalar>::Constant(Scalar(0));
    out(0, 1) = Scalar(0) - a[2];
    out(0, 2) = a[1];
    out(1, 0) = a[2];
    out(1, 2) = Scalar(0) - a[0];
    out(2, 0) = Scalar(0) - a[1];
    out(2, 1) = a[0];
    return out;
  }
  Vec velocity(const Touched& t) const {
    if (t.body < 0) return t.velocity;
    const Body& b = bodies_[static_cast<std::size_t>(t.body)];
    return b.velocity + b.spin.cross(t.arm);
  }
  std::size_t part_of(const GripPatch<Scalar>& patch) const {
    return static_cast<std::size_t>(neighbours_.part(grip_.vertices()[patch.begin]));
  }
  /// Σ |R_i| of a patch, N s.
  static Scalar load_of(const GripPatch<Scalar>& patch, const Workspace& ws) {
    using std::sqrt;
    Scalar sum = Scalar(0);
    for (std::size_t i = patch.begin; i < patch.end; ++i)
      sum = sum + sqrt(ws.carried.impulses.col(static_cast<Index>(i)).squaredNorm());
    return sum;
  }
  Body make_body(const GripPatch<Scalar>& patch, const Model& model,
                 const ClothInput<Scalar>& input, const Scalar& dt, const Workspace& ws) const;

  std::vector<Touched> touched_;
  std::vector<int> point_;
  GripPatches<Scalar> grip_;
  Points<Scalar> start_, velocity_;  // of the vertices in grip_ at the start of the step
  std::vector<Body> bodies_;         // of the patches in grip_
  VertexNeighbours<Scalar> neighbours_;
  std::vector<Part> parts_;
  ClothState<Scalar>* state_ = nullptr;
};

template <class Model>
void CarryingSide<Model>::carry(const GripPatches<Scalar>& grip, const ClothState<Scalar>& state,
                                Workspace& ws) {
  grip_.assign(grip);
  ws.carried.vertices.assign(grip.vertices().begin(), grip.vertices().end());
  for (const GripPatch<Scalar>& patch : grip_.patches()) {
    for (std::size_t i = patch.begin; i < patch.end; ++i) {
      const Index k = static_cast<Index>(i), v = grip_.vertices()[i];
      start_.col(k) = state.positions.col(v);
      velocity_.col(k) = state.velocities.col(v);
      const Vec own = velocity_.col(k),
                pads = patch.velocity + patch.spin.cross(Vec(start_.col(k)));
      const Scalar pressing = patch.axis.dot(pads - own);
      const bool pressed = patch.opposed || Scalar(0) < pressing;
      const Vec sliding = pressed ? Vec(own + pressing * patch.axis) : own;
      ws.carried.velocities.col(k) = patch.slides ? sliding : pads;
    }
  }
}

template <class Model>
auto CarryingSide<Model>::make_body(const GripPatch<Scalar>& patch, const Model& model,
                                    const ClothInput<Scalar>& input, const Scalar& dt,
                                    const Workspace& ws) const -> Body {
  Body b{part_of(patch), Scalar(0), Scalar(0), Matrix3<Scalar>::Identity(),
         zero(),         zero(),    zero(),    zero()};
  const auto for_each = [&](auto visit) {
    for (std::size_t i = patch.begin; i < patch.end; ++i) {
      const int v = grip_.vertices()[i];
      const Index k = static_cast<Index>(i);
      visit(v, model.network().mass[v], Vec(start_.col(k)), Vec(ws.carried.velocities.col(k)), k);
    }
  };
  Scalar mass = Scalar(0);
  for_each([&](int, const Scalar& m, const Vec& x, const Vec& u, Index) {
    mass = mass + m;
    b.centre += m * x;
    b.carried += m * u;
  });
  b.centre /= mass;
  b.carried /= mass;
  // A radius of a millimetre more, so that no patch is without inertia.
  Matrix3<Scalar> inertia = Matrix3<Scalar>::Identity() * (Scalar(1e-6) * mass);
  Vec impulse = zero(), moment = zero(), carried_moment = zero();
  for_each([&](int v, const Scalar& m, const Vec& x, const Vec& u, Index k) {
    const Vec arm = x - b.centre;
    const Matrix3<Scalar> cross = skew(arm);
    inertia -= m * (cross * cross);
    carried_moment += m * arm.cross(u);
    Vec by =
        m * (velocity_.col(k) - u) + dt * m * model.settings().gravity - ws.carried.impulses.col(k);
    for (std::size_t f = 0; f < input.force_vertices.size(); ++f) {
      if (input.force_vertices[f] == v) by += dt * input.forces.col(static_cast<Index>(f));
    }
    impulse += by;
    moment += arm.cross(by);
  });
  Matrix3<Scalar> inverse = Matrix3<Scalar>::Identity() / (Scalar(1e-6) * mass);
  (void)invert_inertia<Scalar>(inertia, inverse);  // else rounding of masses alone
  const Part& part = parts_[b.part];
  const Scalar half = Scalar(0.5) / part.patches;
  b.following = part.mass * (Scalar(0) < part.load
                                 ? Scalar(half + Scalar(0.5) * load_of(patch, ws) / part.load)
                                 : Scalar(half + half));
  b.inverse_mass = Scalar(1) / (mass + b.following);
  b.inverse_inertia = inverse * (mass * b.inverse_mass);
  b.velocity = b.carried + b.inverse_mass * impulse;
  b.spin = inverse * carried_moment + b.inverse_inertia * moment;
  return b;
}

template <class Model>
void CarryingSide<Model>::release(const Model& model, const ClothInput<Scalar>& input,
                                  const Scalar& dt, const Workspace& ws) {
  bodies_.clear();
  if (grip_.patches().empty()) return;
  parts_.assign(parts_.size(), {});
  for (Index v = 0; v < model.vertex_count(); ++v) {
    if (Scalar(0) < ws.inverse_mass[v])
      parts_[static_cast<std::size_t>(neighbours_.part(static_cast<int>(v)))].mass +=
          model.network().mass[v];
  }
  for (const GripPatch<Scalar>& patch : grip_.patches()) {
    Part& part = parts_[part_of(patch)];
    part.load = part.load + load_of(patch, ws);
    part.patches = part.patches + Scalar(1);
  }
  for (const GripPatch<Scalar>& patch : grip_.patches())
    bodies_.push_back(make_body(patch, model, input, dt, ws));
}

template <class Model>
StepStatus CarryingSide<Model>::attach(std::span<const int> vertices, ClothState<Scalar>& state,
                                       Workspace&, const VectorX<Scalar>& inverse_masses) {
  for (const Touched& t : touched_) point_[static_cast<std::size_t>(t.vertex)] = -1;
  touched_.clear();
  for (const int v : vertices) {
    point_[static_cast<std::size_t>(v)] = static_cast<int>(touched_.size());
    touched_.push_back({v, -1, zero(), state.velocities.col(v), inverse_masses[v]});
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    for (std::size_t i = grip_.patches()[k].begin; i < grip_.patches()[k].end; ++i) {
      const int at = point(grip_.vertices()[i]);
      if (at < 0) continue;
      Touched& t = touched_[static_cast<std::size_t>(at)];
      t.body = static_cast<int>(k);
      t.arm = start_.col(static_cast<Index>(i)) - bodies_[k].centre;
    }
  }
  state_ = &state;
  return StepStatus::Converged;
}

template <class Model>
void CarryingSide<Model>::add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
  for (std::size_t i = 0; i < touched_.size(); ++i) {
    const Touched& a = touched_[i];
    const Index row = 3 * static_cast<Index>(i);
    if (a.body < 0) {
      for (Index c = 0; c < 3; ++c) W(row + c, row + c) += a.inverse_mass;
      continue;
    }
    const Body& body = bodies_[static_cast<std::size_t>(a.body)];
    const Matrix3<Scalar> turned = skew(a.arm) * body.inverse_inertia;
    for (std::size_t j = 0; j < touched_.size(); ++j) {
      if (touched_[j].body != a.body) continue;
      Matrix3<Scalar> block = Scalar(-1) * (turned * skew(touched_[j].arm));
      for (Index c = 0; c < 3; ++c) block(c, c) += body.inverse_mass;
      W.template block<3, 3>(row, 3 * static_cast<Index>(j)) += block;
    }
  }
}

template <class Model>
void CarryingSide<Model>::apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
  for (std::size_t i = 0; i < touched_.size(); ++i) {
    Touched& t = touched_[i];
    const Vec impulse = p.template segment<3>(3 * static_cast<Index>(i));
    if (t.body < 0) {
      t.velocity += t.inverse_mass * impulse;
      continue;
    }
    Body& b = bodies_[static_cast<std::size_t>(t.body)];
    b.velocity += b.inverse_mass * impulse;
    b.spin += b.inverse_inertia * t.arm.cross(impulse);
  }
}

template <class Model>
void CarryingSide<Model>::take(const Scalar& dt, bool lies, const Workspace& ws) {
  for (const Touched& t : touched_) {
    if (0 <= t.body) continue;
    state_->positions.col(t.vertex) += dt * (t.velocity - state_->velocities.col(t.vertex));
    state_->velocities.col(t.vertex) = t.velocity;
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    const Body& b = bodies_[k];
    parts_[b.part].left += b.following * (b.velocity - b.carried);
    const Matrix3<Scalar> turn = rotation_exp<Scalar>(Vec(dt * b.spin));
    for (std::size_t i = grip_.patches()[k].begin; i < grip_.patches()[k].end; ++i) {
      const int v = grip_.vertices()[i];
      const Vec arm = turn * (start_.col(static_cast<Index>(i)) - b.centre);
      state_->positions.col(v) = b.centre + dt * b.velocity + arm;
      state_->velocities.col(v) = b.velocity + b.spin.cross(arm);
    }
  }
  if (bodies_.empty()) return;
  for (Index v = 0; v < state_->positions.cols(); ++v) {
    if (!(Scalar(0) < ws.inverse_mass[v])) continue;
    const Part& part = parts_[static_cast<std::size_t>(neighbours_.part(static_cast<int>(v)))];
    const Vec by = part.left / part.mass;
    state_->velocities.col(v) += by;
    if (!lies) state_->positions.col(v) += dt * by;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
