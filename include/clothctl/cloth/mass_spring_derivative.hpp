#pragma once

// The derivative of a converged step of a mass-spring sheet with respect to the state at its start
// and to the positions p of the driven vertices at its end. On the free rows the step solves
//
//   M (v⁺ - v) + h α M v⁺ - h f(x⁺) + h D(x) v⁺ = h f_outer,      x⁺ = x + h v⁺
//
// (symbols: mass_spring.hpp). On the driven rows x⁺ = p and v⁺ = (p - x)/h. So
//
//   A δv⁺ = M δv - h K w - h D δv⁺_driven - h G δx,       A = (1 + h α) M + h D + h² K
//   w = δx on free rows, δp on driven ones;    G δx = δ(D(x)) v⁺
//
// on the free rows, with the exact K at x⁺, the part under compression included. For a damper d
// along n between a and b of distance l, with u = v⁺_a - v⁺_b and P = I - n nᵀ,
//
//   G = (d/l) ( (n·u) P + n (P u)ᵀ )
//
// `push` applies this derivative, `pull` its transpose. Both are exact for a step that has
// converged, but for
//
// - hinges that are folded at rest: K has only their Gauss-Newton part;
// - steps after which A with the exact K is not definite, as at the moment of a buckle: K has then
//   less of its compression part (as in Newton's method), `Step::compression` says how much;
// - springs whose ends coincide, and velocities that `limit_energy` scales down.
//
// Air is refused: its matrices depend on the state, which is not derived here.

#include <cassert>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Linearises converged steps of one model, each in a memory of its own. Needs Newton's method
/// without air. It holds the memory of its solves, so each thread needs an object of its own.
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
    BlockSymmetric<Scalar> stiffness;
    Points<Scalar> direction, turn;  // n and (d/l) P u of each spring
    VectorX<Scalar> rate;            // (d/l) n·u
    Scalar dt = Scalar(0);
  };

  /// Copies what it needs of a model whose `driven` vertices are moved in every step. Allocates.
  /// Fails when the model is not integrated by Newton's method, solves by conjugate gradients or
  /// has air, or a driven vertex is pinned, off the mesh or driven twice.
  static Result<MassSpringDerivative> create(const MassSpring<Scalar>& model,
                                             std::vector<int> driven);

  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }
  /// Returns the driven vertices.
  const std::vector<int>& driven() const { return driven_; }

  /// Linearises the step of `dt` (s) that led from `before` to `after`. Allocates when `step` is
  /// new. `compression`: the largest share of the compression part in K, from 0 to 1. Less than 1
  /// is not exact, but smooths over the moments at which a sheet buckles. Returns false when a
  /// state has another size or is not finite, `dt` is not positive, or no step matrix is definite;
  /// `step` must then not be used. Complexity: one factorisation.
  [[nodiscard]] bool linearise(const ClothState<Scalar>& before, const ClothState<Scalar>& after,
                               Scalar dt, Step& step, Scalar compression = Scalar(1));

  /// Replaces changes of the state before a step, `dx` (m) and `dv` (m/s), by those after it, for
  /// changes `dp` of the driven positions (3×driven, m). `dx` and `dv`: 1×3n, coordinate c of
  /// vertex i in column 3i+c. Never allocates. Fails when a size is wrong (assert).
  /// Complexity: two solves with a triangular factor.
  void push(Step& step, const Points<Scalar>& dp, Row& dx, Row& dv);

  /// The transpose: replaces the derivatives `gx` and `gv` of a function of the state after a step
  /// by those with respect to the state before it, and writes those with respect to the driven
  /// positions to `gp`. Sizes as in `push`. Never allocates.
  void pull(Step& step, Row& gx, Row& gv, Points<Scalar>& gp);

 private:
  MassSpringDerivative(const MassSpring<Scalar>& model, std::vector<int> driven);

  bool is_held(Index i) const { return held_[static_cast<std::size_t>(i)] != 0; }
  /// Makes A and its factor with a share of the compression part.
  bool factorize(const ClothState<Scalar>& after, Scalar compression, Step& step);
  /// Keeps the dampers of a step.
  void keep_dampers(const ClothState<Scalar>& before, const ClothState<Scalar>& after, Step& step);
  /// Solves A z = z on the free rows; held ones are zero.
  void solve(Step& step, Row& z);
  /// Calls `function(spring, index)` for each spring with a damper.
  template <class Function>
  void each_damper(const Function& function) const;
  /// Adds `force` to the first end of a spring, and its opposite to the other.
  static void add_pair(const Spring<Scalar>& s, const detail::Triple<Scalar>& force, Row& out) {
    detail::set_point(out, s.a, detail::point(out, s.a) + force);
    detail::set_point(out, s.b, detail::point(out, s.b) - force);
  }

  SpringNetwork<Scalar> network_;
  Scalar drag_;
  std::vector<int> driven_;
  std::vector<unsigned char> held_;
  detail::SpringPattern<Scalar> pattern_;
  BlockCholesky<Scalar> factor_;
  BlockSymmetric<Scalar> matrix_;
  Row work_, product_, drive_, damped_;
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
  return MassSpringDerivative(model, std::move(driven));
}

template <RealScalar S>
MassSpringDerivative<S>::MassSpringDerivative(const MassSpring<Scalar>& model,
                                              std::vector<int> driven)
    : network_(model.network()),
      drag_(model.settings().drag),
      driven_(std::move(driven)),
      pattern_(network_, detail::BendingBlocks::All, false) {
  factor_ = BlockCholesky<Scalar>(
      pattern_.matrix(), nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions));
  matrix_ = pattern_.matrix();
  held_.assign(static_cast<std::size_t>(vertex_count()), 0);
  for (const int v : model.settings().pinned) held_[static_cast<std::size_t>(v)] = 1;
  for (const int v : driven_) held_[static_cast<std::size_t>(v)] = 1;
  work_.setZero(1, 3 * vertex_count());
  product_ = drive_ = damped_ = work_;
}

template <RealScalar S>
bool MassSpringDerivative<S>::linearise(const ClothState<Scalar>& before,
                                        const ClothState<Scalar>& after, Scalar dt, Step& step,
                                        Scalar compression) {
  for (const ClothState<Scalar>* state : {&before, &after}) {
    for (const Points<Scalar>* p : {&state->positions, &state->velocities}) {
      if (p->cols() != vertex_count() || !all_finite(*p)) return false;
    }
  }
  if (!is_finite(dt) || !(Scalar(0) < dt)) return false;
  if (step.stiffness.rows() != vertex_count()) step.stiffness = pattern_.matrix();
  step.dt = dt;
  keep_dampers(before, after, step);
  for (const double share : {1.0, 0.5, 0.25, 0.0}) {
    if (factorize(after, Scalar(share) * compression, step)) return true;
  }
  return false;
}

template <RealScalar S>
bool MassSpringDerivative<S>::factorize(const ClothState<Scalar>& after, Scalar compression,
                                        Step& step) {
  StiffnessScale<Scalar> scale;
  scale.compression = step.compression = compression;
  step.stiffness.set_zero();
  pattern_.add_springs(network_, after.positions, scale, Scalar(1), step.stiffness);
  pattern_.add_bending(network_, after.positions, Scalar(1), step.stiffness);
  matrix_.set_zero();
  pattern_.add_frozen(network_, step.direction, {}, step.dt, matrix_);
  matrix_.add_scaled(step.stiffness, step.dt * step.dt);
  const Scalar inertia = Scalar(1) + step.dt * drag_;
  for (Index i = 0; i < vertex_count(); ++i)
    detail::add_to_diagonal(matrix_.diagonal(i), Scalar(inertia * network_.mass[i]));
  const bool definite = factor_.factorize(matrix_, held_);
  factor_.exchange(step.factor);
  return definite;
}

template <RealScalar S>
void MassSpringDerivative<S>::keep_dampers(const ClothState<Scalar>& before,
                                           const ClothState<Scalar>& after, Step& step) {
  using std::sqrt;
  using Triple = detail::Triple<Scalar>;
  const Index count = static_cast<Index>(network_.springs.size());
  step.direction.resize(3, count);
  step.turn.setZero(3, count);
  step.rate.setZero(count);
  detail::spring_directions<Scalar>(network_, before.positions, step.direction);
  for (Index e = 0; e < count; ++e) {
    const Spring<Scalar>& s = network_.springs[static_cast<std::size_t>(e)];
    const Triple d = detail::column(before.positions, s.a) - detail::column(before.positions, s.b);
    const Scalar squared = detail::squared_norm(d);
    if (!(Scalar(0) < s.damping) || !(detail::shortest_squared(s) < squared)) continue;
    const Triple n = detail::column(step.direction, e);
    const Triple u = detail::column(after.velocities, s.a) - detail::column(after.velocities, s.b);
    const Scalar along = detail::dot(n, u), factor = s.damping / sqrt(squared);
    detail::set_column(step.turn, e, (u - n * along) * factor);
    step.rate[e] = factor * along;
  }
}

template <RealScalar S>
void MassSpringDerivative<S>::solve(Step& step, Row& z) {
  for (Index i = 0; i < vertex_count(); ++i) {
    if (is_held(i)) detail::set_point(z, i, {Scalar(0), Scalar(0), Scalar(0)});
  }
  factor_.exchange(step.factor);
  factor_.template solve<1>(z);
  factor_.exchange(step.factor);
}

template <RealScalar S>
template <class Function>
void MassSpringDerivative<S>::each_damper(const Function& function) const {
  for (std::size_t e = 0; e < network_.springs.size(); ++e) {
    const Spring<Scalar>& s = network_.springs[e];
    if (Scalar(0) < s.damping) function(s, static_cast<Index>(e));
  }
}

template <RealScalar S>
void MassSpringDerivative<S>::push(Step& step, const Points<Scalar>& dp, Row& dx, Row& dv) {
  using Triple = detail::Triple<Scalar>;
  assert(dx.cols() == 3 * vertex_count() && dv.cols() == 3 * vertex_count());
  assert(dp.cols() == static_cast<Index>(driven_.size()));
  const Scalar h = step.dt;
  work_ = dx;
  drive_.setZero();
  for (std::size_t j = 0; j < driven_.size(); ++j) {
    const Triple p = detail::column(dp, static_cast<Index>(j));
    detail::set_point(work_, driven_[j], p);
    detail::set_point(drive_, driven_[j], (p - detail::point(dx, driven_[j])) / h);
  }
  step.stiffness.multiply(work_, product_);
  each_damper([&](const Spring<Scalar>& s, Index e) {
    const Triple n = detail::column(step.direction, e), turn = detail::column(step.turn, e);
    const Triple d = detail::point(dx, s.a) - detail::point(dx, s.b);
    const Triple u = detail::point(drive_, s.a) - detail::point(drive_, s.b);
    const Scalar along = detail::dot(turn, d) + s.damping * detail::dot(n, u);
    add_pair(s, (d - n * detail::dot(n, d)) * step.rate[e] + n * along, product_);
  });
  for (Index i = 0; i < vertex_count(); ++i) {
    const Triple push = detail::point(dv, i) * network_.mass[i];
    detail::set_point(work_, i, push - detail::point(product_, i) * h);
  }
  solve(step, work_);
  dv = work_ + drive_;
  dx += h * dv;
  for (std::size_t j = 0; j < driven_.size(); ++j)
    detail::set_point(dx, driven_[j], detail::column(dp, static_cast<Index>(j)));
}

template <RealScalar S>
void MassSpringDerivative<S>::pull(Step& step, Row& gx, Row& gv, Points<Scalar>& gp) {
  using Triple = detail::Triple<Scalar>;
  assert(gx.cols() == 3 * vertex_count() && gv.cols() == 3 * vertex_count());
  const Scalar h = step.dt;
  const Triple none{Scalar(0), Scalar(0), Scalar(0)};
  work_ = gv + h * gx;
  solve(step, work_);
  step.stiffness.multiply(work_, product_);
  damped_.setZero();
  drive_.setZero();
  each_damper([&](const Spring<Scalar>& s, Index e) {
    const Triple n = detail::column(step.direction, e), turn = detail::column(step.turn, e);
    const Triple z = detail::point(work_, s.a) - detail::point(work_, s.b);
    const Scalar along = detail::dot(n, z);
    add_pair(s, (z - n * along) * step.rate[e] + turn * along, damped_);
    add_pair(s, n * (s.damping * along), drive_);
  });
  gp.resize(3, static_cast<Index>(driven_.size()));
  for (std::size_t j = 0; j < driven_.size(); ++j) {
    const int i = driven_[j];
    const Triple rate = detail::point(gv, i) / h - detail::point(drive_, i);
    detail::set_column(gp, static_cast<Index>(j),
                       detail::point(gx, i) + rate - detail::point(product_, i) * h);
    detail::set_point(gx, i, none - rate - detail::point(damped_, i) * h);
    detail::set_point(gv, i, none);
  }
  for (Index i = 0; i < vertex_count(); ++i) {
    if (is_held(i)) continue;
    const Triple force = detail::point(product_, i) + detail::point(damped_, i);
    detail::set_point(gx, i, detail::point(gx, i) - force * h);
    detail::set_point(gv, i, detail::point(work_, i) * network_.mass[i]);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
