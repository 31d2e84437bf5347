#pragma once

// The derivative of a converged step of a mass-spring sheet with respect to the state at its start
// and to the positions p of the driven vertices at its end. On the free rows the step solves
//
//   M (v⁺ - v) + h α M v⁺ - h f(x⁺) + h D(x) v⁺ + h C v⁺ = h f_outer,      x⁺ = x + h v⁺
//
// (symbols: mass_spring.hpp). On the driven rows x⁺ = p and v⁺ = (p - x)/h. With
// A = (1 + h α) M + h (D + C) + h² K and K at x⁺, the part under compression included,
//
//   A δv⁺ = M δv + (1/h + α) M δx - A w/h + (D + C - h G) δx     on the free rows, with the free
//   w = δx on free rows, δp on driven ones;    G δx = δ(D(x)) v⁺     columns of A on the left
//
// For a damper d along n between a and b of distance l, with u = v⁺_a - v⁺_b and P = I - n nᵀ,
//
//   G = (d/l) ( (n·u) P + n (P u)ᵀ )
//
// `push` applies this derivative, `pull` its transpose, to several changes at once. Both are exact
// for a step that has converged, but for
//
// - hinges that are folded at rest: K has only their Gauss-Newton part;
// - steps after which A with the exact K is not definite, as at the moment of a buckle: K has then
//   less of its compression part (as in Newton's method), `Step::compression` says how much;
// - springs whose ends coincide, and velocities that `limit_energy` scales down;
// - air: its matrices C depend on the state, which is not derived here. `create` refuses it;
// - rollouts (MassSpringRollout::make_derivative): what carries vertices is a constant force, and
//   bending may have the blocks of neighbours alone.

#include <array>
#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/spring_batches.hpp"
#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// What the derivative needs of a model whose steps it derives.
template <RealScalar Scalar>
struct DerivedModel {
  SpringNetwork<Scalar> network;
  Scalar drag = Scalar(0);
  AirSettings<Scalar> air;
  std::vector<int> pinned;
  /// Pattern of the step matrix, its springs, and the order of its elimination.
  SpringPattern<Scalar> pattern;
  SpringBatches<Scalar> springs;
  EliminationTree tree;
};

}  // namespace detail

/// Linearises converged steps of one model. Each thread needs a memory and steps of its own.
template <RealScalar S>
class MassSpringDerivative {
 public:
  /// The scalar type.
  using Scalar = S;
  /// Changes of positions or velocities, or derivatives with respect to them.
  using Row = Lanes<Scalar, 1>;

  /// The derivative of one step; about as large as a factor of the step matrix.
  struct Step {
    /// Share of the exact compression part in K: 1, or less where the matrix was not definite.
    Scalar compression = Scalar(1);

   private:
    friend class MassSpringDerivative;
    VectorX<Scalar> factor;
    BlockSymmetric<Scalar> matrix;  // A
    detail::DamperTerms<Scalar> dampers;
    std::vector<Matrix3<Scalar>> air;
    Scalar dt = Scalar(0);
  };

  /// Scratch memory for kLanes changes side by side, made by `make_memory`.
  template <int kLanes>
  struct Memory {
   private:
    friend class MassSpringDerivative;
    BlockCholesky<Scalar> factor;
    Lanes<Scalar, kLanes> work, product;
    Points<Scalar> air_force;
  };

  /// Copies what it needs of a model whose `driven` vertices are moved in every step. Allocates.
  /// Fails when the model is not integrated by Newton's method, solves by conjugate gradients or
  /// has air, or a driven vertex is pinned, off the mesh or driven twice.
  static Result<MassSpringDerivative> create(const MassSpring<Scalar>& model,
                                             std::vector<int> driven);

  /// The derivative for another model of the library. Allocates. Fails when a vertex is off the
  /// mesh (assert).
  MassSpringDerivative(detail::DerivedModel<Scalar> model, std::vector<int> driven);

  /// Returns the number of vertices.
  Index vertex_count() const { return model_.network.vertex_count(); }
  /// Returns the driven vertices.
  const std::vector<int>& driven() const { return driven_; }

  /// Makes scratch memory. Allocates.
  template <int kLanes = 1>
  Memory<kLanes> make_memory() const;

  /// Makes a step that `linearise` then fills without allocating. Allocates.
  template <int kLanes>
  Step make_step(Memory<kLanes>& memory) const;

  /// Linearises the step of `dt` (s) that led from `before` to `after`. Allocates when `step` is
  /// new. `compression`: the largest share of the compression part in K, from 0 to 1. Less than 1
  /// is not exact, but smooths over the moments at which a sheet buckles. `wind`: velocity of the
  /// air, m/s. Returns false when a state has another size or is not finite, `dt` is not positive,
  /// or no step matrix is definite; `step` must then not be used. Complexity: one factorisation, up
  /// to four where the exact matrix is not definite.
  template <int kLanes>
  [[nodiscard]] bool linearise(const ClothState<Scalar>& before, const ClothState<Scalar>& after,
                               Scalar dt, Step& step, Memory<kLanes>& memory,
                               Scalar compression = Scalar(1),
                               const Vector3<Scalar>& wind = Vector3<Scalar>::Zero()) const;

  /// Replaces changes of the state before a step, `dx` (m) and `dv` (m/s), by those after it, for
  /// changes `dp` of the driven positions (kLanes×3·driven, m). `dx` and `dv`: kLanes×3n,
  /// coordinate c of vertex i in column 3i+c. Never allocates. Fails when a size is wrong or `step`
  /// was not linearised (assert).
  /// Complexity: two solves with a triangular factor.
  template <int kLanes>
  void push(Step& step, Memory<kLanes>& memory, const Lanes<Scalar, kLanes>& dp,
            Lanes<Scalar, kLanes>& dx, Lanes<Scalar, kLanes>& dv) const;

  /// The transpose: replaces the derivatives `gx` and `gv` of functions of the state after a step
  /// by those with respect to the state before it, and writes those with respect to the driven
  /// positions to `gp`. Sizes as in `push`. Never allocates.
  template <int kLanes>
  void pull(Step& step, Memory<kLanes>& memory, Lanes<Scalar, kLanes>& gx,
            Lanes<Scalar, kLanes>& gv, Lanes<Scalar, kLanes>& gp) const;

 private:
  bool is_held(Index i) const { return held_[static_cast<std::size_t>(i)] != 0; }
  /// Makes A and its factor with a share of the compression part.
  bool factorize(const ClothState<Scalar>& after, Scalar compression, Step& step,
                 BlockCholesky<Scalar>& factor) const;
  /// Solves A z = z on the free rows; held ones are zero.
  template <int kLanes>
  void solve(Step& step, BlockCholesky<Scalar>& factor, Lanes<Scalar, kLanes>& z) const;
  /// Adds (D + C - h G) x to `out`, or its transpose.
  template <bool kTransposed, int kLanes>
  void add_damping(const Step& step, const Lanes<Scalar, kLanes>& x,
                   Lanes<Scalar, kLanes>& out) const;

  detail::DerivedModel<Scalar> model_;
  std::vector<int> driven_;
  std::vector<unsigned char> held_;
};

template <RealScalar S>
auto MassSpringDerivative<S>::create(const MassSpring<Scalar>& model, std::vector<int> driven)
    -> Result<MassSpringDerivative> {
  if (model.settings().integration != Integration::Newton)
    return Error{"the model's integration is not Newton; only converged steps have a derivative"};
  if (model.settings().linear_solver != LinearSolver::Factor)
    return Error{"the model solves by conjugate gradients; its derivative needs factors"};
  if (model.settings().air.enabled()) return Error{"the model has air, which is not derived"};
  std::string problem = detail::find_bad_vertex(driven, model.vertex_count(), true, "held vertex");
  for (const int v : model.settings().pinned) {
    for (const int d : driven) {
      if (problem.empty() && v == d) problem = "held vertex " + std::to_string(d) + " is pinned";
    }
  }
  if (!problem.empty()) return Error{problem};
  const SpringNetwork<Scalar>& network = model.network();
  detail::DerivedModel<Scalar> derived;
  derived.network = network;
  derived.drag = model.settings().drag;
  derived.pinned = model.settings().pinned;
  derived.pattern = detail::SpringPattern<Scalar>(network, detail::BendingBlocks::All, false);
  derived.springs = detail::SpringBatches<Scalar>(network, derived.pattern.matrix(),
                                                  [](const Spring<Scalar>&) { return Scalar(1); });
  derived.tree = nested_dissection<Scalar>(derived.pattern.matrix(), network.rest_positions);
  return MassSpringDerivative(std::move(derived), std::move(driven));
}

template <RealScalar S>
MassSpringDerivative<S>::MassSpringDerivative(detail::DerivedModel<Scalar> model,
                                              std::vector<int> driven)
    : model_(std::move(model)), driven_(std::move(driven)) {
  held_.assign(static_cast<std::size_t>(vertex_count()), 0);
  for ([[maybe_unused]] const int v : driven_) assert(0 <= v && v < vertex_count());
  for (const int v : model_.pinned) held_[static_cast<std::size_t>(v)] = 1;
  for (const int v : driven_) held_[static_cast<std::size_t>(v)] = 1;
}

template <RealScalar S>
template <int kLanes>
auto MassSpringDerivative<S>::make_memory() const -> Memory<kLanes> {
  Memory<kLanes> memory;
  memory.factor = BlockCholesky<Scalar>(model_.pattern.matrix(), model_.tree);
  memory.work.setZero(kLanes, 3 * vertex_count());
  memory.product = memory.work;
  memory.air_force.setZero(3, vertex_count());
  return memory;
}

template <RealScalar S>
template <int kLanes>
auto MassSpringDerivative<S>::make_step(Memory<kLanes>& memory) const -> Step {
  Step step;
  step.matrix = model_.pattern.matrix();
  const Points<Scalar>& x = model_.network.rest_positions;
  model_.springs.write_dampers(x, x, Scalar(1), step.dampers);
  if (model_.air.enabled())
    step.air.assign(model_.network.triangles.size(), Matrix3<Scalar>::Zero());
  memory.factor.exchange(step.factor);
  return step;
}

template <RealScalar S>
template <int kLanes>
bool MassSpringDerivative<S>::linearise(const ClothState<Scalar>& before,
                                        const ClothState<Scalar>& after, Scalar dt, Step& step,
                                        Memory<kLanes>& memory, Scalar compression,
                                        const Vector3<Scalar>& wind) const {
  for (const ClothState<Scalar>* state : {&before, &after}) {
    for (const Points<Scalar>* p : {&state->positions, &state->velocities}) {
      if (p->cols() != vertex_count() || !all_finite(*p)) return false;
    }
  }
  if (!is_finite(dt) || !(Scalar(0) < dt)) return false;
  if (step.matrix.rows() != vertex_count()) step.matrix = model_.pattern.matrix();
  step.dt = dt;
  model_.springs.write_dampers(before.positions, after.velocities, dt, step.dampers);
  if (model_.air.enabled()) {
    memory.air_force.setZero();
    step.air.resize(model_.network.triangles.size(), Matrix3<Scalar>::Zero());
    detail::freeze_air<Scalar>(model_.network, before.positions, before.velocities, wind,
                               model_.air, step.air, memory.air_force);
  }
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    if (factorize(after, Scalar(share) * compression, step, memory.factor)) return true;
  }
  return false;
}

template <RealScalar S>
bool MassSpringDerivative<S>::factorize(const ClothState<Scalar>& after, Scalar compression,
                                        Step& step, BlockCholesky<Scalar>& factor) const {
  step.compression = compression;
  step.matrix.set_zero();
  const Scalar inertia = Scalar(1) + step.dt * model_.drag;
  for (Index i = 0; i < vertex_count(); ++i)
    detail::add_to_diagonal(step.matrix.diagonal(i), Scalar(inertia * model_.network.mass[i]));
  model_.springs.add_matrix(after.positions, step.dampers.n, step.dt, compression, step.matrix);
  model_.pattern.add_bending(model_.network, after.positions, step.dt * step.dt, step.matrix);
  model_.pattern.add_air(model_.network, step.air, step.dt, step.matrix);
  const bool definite = factor.factorize(step.matrix, held_);
  factor.exchange(step.factor);
  return definite;
}

template <RealScalar S>
template <int kLanes>
void MassSpringDerivative<S>::solve(Step& step, BlockCholesky<Scalar>& factor,
                                    Lanes<Scalar, kLanes>& z) const {
  for (Index i = 0; i < vertex_count(); ++i) {
    if (is_held(i)) z.template middleCols<3>(3 * i).setZero();
  }
  factor.exchange(step.factor);
  factor.template solve<kLanes>(z);
  factor.exchange(step.factor);
}

template <RealScalar S>
template <bool kTransposed, int kLanes>
void MassSpringDerivative<S>::add_damping(const Step& step, const Lanes<Scalar, kLanes>& x,
                                          Lanes<Scalar, kLanes>& out) const {
  model_.springs.template add_dampers<kTransposed, kLanes>(step.dampers, x, out);
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < step.air.size(); ++e) {  // each C is symmetric
    const std::array<int, 3>& t = model_.network.triangles[e];
    Eigen::Matrix<Scalar, kLanes, 3> mean = Eigen::Matrix<Scalar, kLanes, 3>::Zero();
    for (const int v : t) mean += third * x.template middleCols<3>(3 * v);
    const Eigen::Matrix<Scalar, kLanes, 3> push = third * mean.lazyProduct(step.air[e]);
    for (const int v : t) out.template middleCols<3>(3 * v) += push;
  }
}

template <RealScalar S>
template <int kLanes>
void MassSpringDerivative<S>::push(Step& step, Memory<kLanes>& memory,
                                   const Lanes<Scalar, kLanes>& dp, Lanes<Scalar, kLanes>& dx,
                                   Lanes<Scalar, kLanes>& dv) const {
  assert(dx.cols() == 3 * vertex_count() && dv.cols() == 3 * vertex_count());
  assert(dp.cols() == 3 * static_cast<Index>(driven_.size()) && Scalar(0) < step.dt);
  const Scalar h = step.dt, inertia = Scalar(1) / h + model_.drag;
  Lanes<Scalar, kLanes>&w = memory.work, &rhs = memory.product;
  w = dx;
  for (std::size_t j = 0; j < driven_.size(); ++j)
    w.template middleCols<3>(3 * driven_[j]) = dp.template middleCols<3>(3 * static_cast<Index>(j));
  step.matrix.template multiply<kLanes>(w, rhs);
  rhs *= Scalar(-1) / h;
  add_damping<false, kLanes>(step, dx, rhs);
  for (Index i = 0; i < vertex_count(); ++i)
    rhs.template middleCols<3>(3 * i) +=
        model_.network.mass[i] *
        (dv.template middleCols<3>(3 * i) + inertia * dx.template middleCols<3>(3 * i));
  solve<kLanes>(step, memory.factor, rhs);
  for (std::size_t j = 0; j < driven_.size(); ++j) {
    const Index d = 3 * driven_[j];
    rhs.template middleCols<3>(d) =
        (w.template middleCols<3>(d) - dx.template middleCols<3>(d)) / h;
  }
  dv = rhs;
  dx += h * dv;
  for (const int d : driven_) dx.template middleCols<3>(3 * d) = w.template middleCols<3>(3 * d);
}

template <RealScalar S>
template <int kLanes>
void MassSpringDerivative<S>::pull(Step& step, Memory<kLanes>& memory, Lanes<Scalar, kLanes>& gx,
                                   Lanes<Scalar, kLanes>& gv, Lanes<Scalar, kLanes>& gp) const {
  assert(gx.cols() == 3 * vertex_count() && gv.cols() == 3 * vertex_count());
  assert(gp.cols() == 3 * static_cast<Index>(driven_.size()) && Scalar(0) < step.dt);
  const Scalar h = step.dt, inertia = Scalar(1) / h + model_.drag;
  Lanes<Scalar, kLanes>&z = memory.work, &product = memory.product;
  z = gv + h * gx;
  solve<kLanes>(step, memory.factor, z);
  step.matrix.template multiply<kLanes>(z, product);
  for (std::size_t j = 0; j < driven_.size(); ++j) {
    const Index d = 3 * driven_[j];
    gp.template middleCols<3>(3 * static_cast<Index>(j)) =
        gx.template middleCols<3>(d) +
        (gv.template middleCols<3>(d) - product.template middleCols<3>(d)) / h;
    gx.template middleCols<3>(d) = gv.template middleCols<3>(d) / (Scalar(0) - h);
    product.template middleCols<3>(d).setZero();
  }
  gx -= product / h;
  add_damping<true, kLanes>(step, z, gx);
  for (Index i = 0; i < vertex_count(); ++i) {
    const Scalar mass = model_.network.mass[i];
    gx.template middleCols<3>(3 * i) += (inertia * mass) * z.template middleCols<3>(3 * i);
    gv.template middleCols<3>(3 * i) = mass * z.template middleCols<3>(3 * i);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
