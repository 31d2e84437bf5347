#pragma once

// The QP of a window in the unknowns u of grip_basis.hpp, raw inputs r_k = B u_k, δ = r - ū:
//
//   ½ δᵀH δ + gᵀδ + effort(r)   ->   ½ uᵀ(BᵀH B + ridge) u + (Bᵀ(g - H ū))ᵀ u,     lower <= u <= upper
//   grip limits:   Σ d_i / √(1+μ²) <= limit                       a finger and frame
//   hard patches:  N y_k = 0  (paper 000, eq. 3)                  3 · non-affine modes a frame
//
// The box QP is tried first. Grip limits of whole fingers go to the row solver only in frames where the box solution breaks
// one; hard patch rows always. Rows that cannot be met (a grip limit stands against them) are relaxed by an exact L1 penalty.

#include <algorithm>
#include <cmath>
#include <concepts>
#include <utility>
#include <vector>

#include "clothctl/concepts/qp_solver.hpp"
#include "clothctl/mpc/condense.hpp"
#include "clothctl/mpc/held_patches.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl {

/// Assembles and solves the QP of one window. All memory is made by `reserve`.
template <RealScalar Scalar, BoxQpSolver<Scalar> BoxSolver, QpSolver<Scalar> RowSolver>
requires std::constructible_from<BoxSolver> && std::movable<BoxSolver> && std::constructible_from<RowSolver> &&
    std::movable<RowSolver>
class WindowQp {
 public:
  /// Makes room. Allocates.
  void reserve(const PlannerSettings<Scalar>& settings, const GripBasis<Scalar>& basis,
               const std::vector<HeldPatch<Scalar>>& patches) {
    const Index horizon = settings.horizon, raw = basis.inputs() * horizon;
    unknowns_ = basis.unknowns() * horizon;
    if constexpr (std::constructible_from<BoxSolver, QpSettings<Scalar>>) box_ = BoxSolver(settings.qp);
    if constexpr (std::constructible_from<RowSolver, QpSettings<Scalar>>) {
      rows_ = RowSolver(settings.qp);
      relaxed_.solver = RowSolver(settings.qp);
    }
    raw_hessian_.setZero(raw, raw);
    raw_gradient_.setZero(raw);
    hessian_.setZero(unknowns_, unknowns_);
    for (VectorX<Scalar>* p : {&gradient_, &lower_, &upper_, &solution_}) p->setZero(unknowns_);
    column_.setZero(basis.inputs());
    qp_solver_traits<BoxSolver>::reserve(box_, unknowns_);
    resize(box_result_, unknowns_, 0);
    if (settings.input != GripInput::Force) return;
    Index fingers = 0, hard = 0;
    std::size_t longest = 0;
    for (const Grip<Scalar>& g : basis.grips()) fingers += static_cast<Index>(g.fingers.size());
    for (const HeldPatch<Scalar>& p : patches) {
      if (settings.patch == PatchMode::Hard) hard += 3 * (p.modes.count() - 1);
      longest = (std::max)(longest, p.slots.size());
    }
    limits_a_frame_ = fingers;
    patch_rows_a_frame_ = hard;
    const Index rows = (fingers + hard) * horizon;
    point_.reserve(longest);
    row_matrix_.setZero(rows, unknowns_);
    row_lower_.setZero(rows);
    row_upper_.setZero(rows);
    qp_solver_traits<RowSolver>::reserve(rows_, unknowns_, rows);
    resize(row_result_, unknowns_, rows);
    if (hard > 0) relaxed_.reserve(unknowns_, rows, hard * horizon);
  }

  /// The unknowns of frame `k` of the last solution.
  auto frame(Index k, Index unknowns) const { return solution_.segment(k * unknowns, unknowns); }

  /// Moves the warm start one frame on.
  void shift(Index unknowns) {
    if constexpr (requires { qp_solver_traits<BoxSolver>::shift(box_, unknowns); }) {
      qp_solver_traits<BoxSolver>::shift(box_, unknowns);
    }
    if constexpr (requires { qp_solver_traits<RowSolver>::shift(rows_, unknowns, unknowns); }) {
      qp_solver_traits<RowSolver>::shift(rows_, unknowns, limits_a_frame_ + patch_rows_a_frame_);
    }
  }
  /// Forgets warm starts.
  void reset() {
    if constexpr (requires { qp_solver_traits<BoxSolver>::reset(box_); }) qp_solver_traits<BoxSolver>::reset(box_);
    if constexpr (requires { qp_solver_traits<RowSolver>::reset(rows_); }) qp_solver_traits<RowSolver>::reset(rows_);
  }

  /// Builds H, g and bounds from the stacked cost about the plan of `window`. Never allocates.
  void assemble(const TermStack<Scalar>& stack, const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis,
                const PlannerSettings<Scalar>& settings, const Vector3<Scalar>& reference, const PointsView<Scalar>& x) {
    const PlannerWeights<Scalar>& w = settings.weights;
    const Index m = basis.inputs(), horizon = settings.horizon, p = basis.unknowns();
    const bool force = settings.input == GripInput::Force;
    condense<Scalar>(stack.blocks(), stack.residual(), raw_hessian_, raw_gradient_);
    for (Index k = 0; k < horizon; ++k) {
      for (Index i = 0; i < m; ++i) {
        const Index row = k * m + i;
        const Scalar effort = force ? w.force : w.velocity * basis.vertex_share(i / 3);
        raw_hessian_(row, row) += effort;
        raw_gradient_[row] += effort * (window.plan(i, k) - reference[i % 3]);
      }
    }
    for (Index k = 0; k < horizon; ++k) {  // g - H ū, then Bᵀ of it
      column_ = raw_gradient_.segment(k * m, m);
      for (Index j = 0; j < horizon; ++j) column_.noalias() -= raw_hessian_.block(k * m, j * m, m, m) * window.plan.col(j);
      for (Index c = 0; c < p; ++c) gradient_[k * p + c] = dot(basis, c, column_);
    }
    for (Index l = 0; l < horizon; ++l) {
      for (Index d = 0; d < p; ++d) {
        const std::pair<Index, Index> wide = basis.rows(d);
        for (Index j = l; j < horizon; ++j) {
          column_.noalias() = raw_hessian_.block(j * m, l * m + wide.first, m, wide.second) *
                              basis.matrix().col(d).segment(wide.first, wide.second);
          for (Index c = 0; c < p; ++c) {
            const Scalar value = dot(basis, c, column_);
            hessian_(j * p + c, l * p + d) = value;
            hessian_(l * p + d, j * p + c) = value;
          }
        }
      }
    }
    const Scalar ridge = force ? w.cone : Scalar(1e-3) * w.velocity;  // a turn about a line of vertices moves nothing
    for (Index i = 0; i < unknowns_; ++i) hessian_(i, i) += ridge;
    basis.bounds(x, settings.max_step, settings.dt, lower_.head(p), upper_.head(p));
    for (Index k = 1; k < horizon; ++k) {
      lower_.segment(k * p, p) = lower_.head(p);
      upper_.segment(k * p, p) = upper_.head(p);
    }
  }

  /// Solves; answers Planned, Suboptimal, Relaxed or Failed and fills the QP part of `result`; iterations are
  /// added to those it holds. Never allocates.
  PlanStatus solve(const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis,
                   const std::vector<HeldPatch<Scalar>>& patches, const PlannerSettings<Scalar>& settings,
                   PlanResult<Scalar>& result) {
    const bool force = settings.input == GripInput::Force;
    bool hard = false;
    if (force && patch_rows_a_frame_ > 0) {
      for (const HeldPatch<Scalar>& p : patches) hard = hard || p.modes.non_affine_count() > 0;
    }
    result.used_rows = false;
    if (!hard) {
      const View g(gradient_), lower(lower_), upper(upper_);
      result.qp_status = qp_solver_traits<BoxSolver>::set_hessian(box_, hessian_);
      if (result.qp_status != QpStatus::Solved) return PlanStatus::Failed;
      result.qp_status = qp_solver_traits<BoxSolver>::solve(box_, g, lower, upper, box_result_);
      result.qp_iterations += iterations(box_result_);
      const PlanStatus status = take<BoxSolver>(box_result_, result.qp_status);
      if (status == PlanStatus::Failed || !force || limits_hold(basis, settings.horizon)) return status;
    }
    result.used_rows = true;
    fill_rows(request, window, basis, patches);
    const View rl(row_lower_), ru(row_upper_);
    result.qp_status = solve_with(rows_, hessian_, row_matrix_, gradient_, lower_, upper_, rl, ru, row_result_);
    result.qp_iterations += iterations(row_result_);
    PlanStatus status = PlanStatus::Relaxed;
    if (hard && result.qp_status == QpStatus::PrimalInfeasible) {
      relaxed_.fill(hessian_, row_matrix_, gradient_, lower_, upper_, row_lower_, row_upper_, limits_a_frame_,
                    patch_rows_a_frame_);
      result.qp_status = solve_with(relaxed_.solver, relaxed_.hessian, relaxed_.rows, relaxed_.gradient, relaxed_.lower,
                                    relaxed_.upper, rl, ru, relaxed_.result);
      result.qp_iterations += iterations(relaxed_.result);
      if (take<RowSolver>(relaxed_.result, result.qp_status) == PlanStatus::Failed) return PlanStatus::Failed;
    } else {
      status = take<RowSolver>(row_result_, result.qp_status);
      if (status == PlanStatus::Failed) return status;
    }
    keep_limits(basis, settings.horizon);
    return status;
  }

 private:
  using BoxResult = typename qp_solver_traits<BoxSolver>::result_type;
  using RowResult = typename qp_solver_traits<RowSolver>::result_type;

  static PlanStatus plan_status(QpStatus status) {
    if (status == QpStatus::Solved) return PlanStatus::Planned;
    if (status == QpStatus::SolvedInaccurate || status == QpStatus::IterationLimit || status == QpStatus::TimeLimit)
      return PlanStatus::Suboptimal;
    return PlanStatus::Failed;
  }

  template <class AnyResult>
  static int iterations(const AnyResult& result) {
    if constexpr (requires { result.iterations; }) return static_cast<int>(result.iterations);
    return 0;
  }

  /// Column c of B times a vector of raw inputs.
  static Scalar dot(const GripBasis<Scalar>& basis, Index c, const VectorX<Scalar>& raw) {
    const std::pair<Index, Index> rows = basis.rows(c);
    return basis.matrix().col(c).segment(rows.first, rows.second).dot(raw.segment(rows.first, rows.second));
  }

  /// What one coefficient of a finger adds to its normal force.
  static Scalar normal_share(const Finger<Scalar>& f) {
    using std::sqrt;
    return Scalar(1) / sqrt(Scalar(1) + f.friction * f.friction);
  }

  using View = Eigen::Ref<const VectorX<Scalar>>;

  template <class AnyVector>
  QpStatus solve_with(RowSolver& solver, const MatrixX<Scalar>& hessian, const MatrixX<Scalar>& rows, const AnyVector& gradient,
                      const AnyVector& lower, const AnyVector& upper, const View& row_lower, const View& row_upper,
                      RowResult& result) {
    using Traits = qp_solver_traits<RowSolver>;
    QpStatus status = Traits::set_hessian(solver, hessian);
    if (status == QpStatus::Solved) status = Traits::set_rows(solver, rows);
    if (status != QpStatus::Solved) return status;
    return Traits::solve(solver, View(gradient), View(lower), View(upper), row_lower, row_upper, result);
  }

  /// Keeps the unknowns of a result; Failed when its status is no solution or it is not finite.
  template <class Solver>
  PlanStatus take(const typename qp_solver_traits<Solver>::result_type& result, QpStatus qp_status) {
    const PlanStatus status = plan_status(qp_status);
    if (status == PlanStatus::Failed) return status;
    const View x(qp_solver_traits<Solver>::solution(result));
    if (x.size() < unknowns_ || !all_finite(x)) return PlanStatus::Failed;
    solution_ = x.head(unknowns_);
    return status;
  }

  /// Sizes a result beforehand where its type can be.
  template <class AnyResult>
  static void resize(AnyResult& result, Index unknowns, Index rows) {
    if constexpr (requires { result.resize(unknowns, rows); }) result.resize(unknowns, rows);
  }

  /// Calls `function(finger, sum)` for every finger and frame; `sum` is that of its coefficients.
  template <class Function>
  void for_each_finger(const GripBasis<Scalar>& basis, Index horizon, Function&& function) const {
    for (Index k = 0; k < horizon; ++k) {
      for (std::size_t g = 0; g < basis.grips().size(); ++g) {
        for (std::size_t f = 0; f < basis.grips()[g].fingers.size(); ++f) {
          const Finger<Scalar>& finger = basis.grips()[g].fingers[f];
          Scalar sum = Scalar(0);
          for (const typename GripBasis<Scalar>::Contact& c : basis.contacts()) {
            if (c.grip != static_cast<int>(g) || c.finger != static_cast<int>(f)) continue;
            sum += solution_.segment(k * basis.unknowns() + c.column, finger.generators).sum();
          }
          function(k, static_cast<int>(g), static_cast<int>(f), finger, sum);
        }
      }
    }
  }

  /// Whether every finger of every frame keeps its limit.
  bool limits_hold(const GripBasis<Scalar>& basis, Index horizon) const {
    bool hold = true;
    for_each_finger(basis, horizon, [&](Index, int, int, const Finger<Scalar>& finger, const Scalar& sum) {
      if (finger.limit < sum * normal_share(finger)) hold = false;
    });
    return hold;
  }

  /// Takes what a row solver leaves over the limits, or below zero, off the coefficients: the cone still holds.
  void keep_limits(const GripBasis<Scalar>& basis, Index horizon) {
    for (Index i = 0; i < unknowns_; ++i) {
      if (solution_[i] < Scalar(0)) solution_[i] = Scalar(0);
    }
    for_each_finger(basis, horizon, [&](Index k, int grip, int finger_index, const Finger<Scalar>& finger, const Scalar& sum) {
      const Scalar normal = sum * normal_share(finger);
      if (!(finger.limit < normal)) return;
      for (const typename GripBasis<Scalar>::Contact& c : basis.contacts()) {
        if (c.grip == grip && c.finger == finger_index)
          solution_.segment(k * basis.unknowns() + c.column, finger.generators) *= finger.limit / normal;
      }
    });
  }

  /// The rows of all frames, frame by frame: a grip limit for each finger, then the non-affine modes of the patches. Modes that
  /// a patch has less than it might (its vertices span more dimensions) leave rows without entries and bounds.
  void fill_rows(const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis,
                 const std::vector<HeldPatch<Scalar>>& patches) {
    const Index a_frame = limits_a_frame_ + patch_rows_a_frame_;
    row_matrix_.setZero();
    row_lower_.setConstant(-scalar_traits<Scalar>::infinity());
    row_upper_.setConstant(scalar_traits<Scalar>::infinity());
    for (Index k = 0; k < request.horizon; ++k) {
      Index row = k * a_frame;
      for (std::size_t g = 0; g < basis.grips().size(); ++g) {
        for (std::size_t f = 0; f < basis.grips()[g].fingers.size(); ++f, ++row) {
          const Finger<Scalar>& finger = basis.grips()[g].fingers[f];
          for (const typename GripBasis<Scalar>::Contact& c : basis.contacts()) {
            if (c.grip != static_cast<int>(g) || c.finger != static_cast<int>(f)) continue;
            row_matrix_.row(row).segment(k * basis.unknowns() + c.column, finger.generators).setConstant(normal_share(finger));
          }
          row_upper_[row] = finger.limit;
        }
      }
      if (patch_rows_a_frame_ == 0) continue;
      for (const HeldPatch<Scalar>& patch : patches) {
        for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
          take_non_affine(patch, i, request.held_outputs, point_);
          for (Index c = 0; c < 3; ++c, ++row) fill_patch_row(row, k, c, window, basis);
        }
      }
    }
  }

  /// Coordinate c of the mode in point_ stays zero in frame k.
  void fill_patch_row(Index row, Index k, Index c, const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis) {
    const Index m = basis.inputs(), p = basis.unknowns();
    Scalar offset = Scalar(0);
    for (const OutputTerm<Scalar>& t : point_) offset -= t.weight * window.free(3 * t.output + c, k);
    for (Index j = 0; j <= k; ++j) {
      column_.setZero();
      for (const OutputTerm<Scalar>& t : point_) {
        column_ += t.weight * window.impulse.row(3 * t.output + c).segment((k - j) * m, m).transpose();
      }
      offset += column_.dot(window.plan.col(j));
      for (Index d = 0; d < p; ++d) row_matrix_(row, j * p + d) = dot(basis, d, column_);
    }
    row_lower_[row] = offset;
    row_upper_[row] = offset;
  }

  /// The QP with slack on the patch rows, A u + s⁺ - s⁻, and a penalty on s above the multipliers of the rows.
  struct RelaxedQp {
    RowSolver solver;
    RowResult result;
    MatrixX<Scalar> hessian, rows;
    VectorX<Scalar> gradient, lower, upper;

    void reserve(Index unknowns, Index row_count, Index slack) {
      const Index n = unknowns + 2 * slack;
      hessian.setZero(n, n);
      rows.setZero(row_count, n);
      for (VectorX<Scalar>* v : {&gradient, &lower, &upper}) v->setZero(n);
      qp_solver_traits<RowSolver>::reserve(solver, n, row_count);
      resize(result, n, row_count);
    }

    void fill(const MatrixX<Scalar>& h, const MatrixX<Scalar>& a, const VectorX<Scalar>& g, const VectorX<Scalar>& lb,
              const VectorX<Scalar>& ub, const VectorX<Scalar>& rl, const VectorX<Scalar>& ru, Index limits, Index patch_rows) {
      const Index n = h.rows(), slack = (gradient.size() - n) / 2;
      Scalar size = Scalar(1);
      for (Index i = 0; i < n; ++i) {
        if (size < h(i, i)) size = h(i, i);
      }
      hessian.topLeftCorner(n, n) = h;
      rows.leftCols(n) = a;
      gradient.head(n) = g;
      gradient.tail(2 * slack).setConstant(Scalar(1e3) * size);
      lower.head(n) = lb;
      upper.head(n) = ub;
      for (Index row = 0, i = 0; row < a.rows(); ++row) {
        if (row % (limits + patch_rows) < limits) continue;
        rows(row, n + i) = Scalar(1);
        rows(row, n + slack + i) = Scalar(-1);
        const bool used = !is_unbounded(rl[row]) || !is_unbounded(ru[row]);
        upper[n + i] = upper[n + slack + i] = used ? scalar_traits<Scalar>::infinity() : Scalar(0);
        ++i;
      }
    }
  };

  BoxSolver box_;
  RowSolver rows_;
  BoxResult box_result_;
  RowResult row_result_;
  RelaxedQp relaxed_;
  MatrixX<Scalar> raw_hessian_, hessian_, row_matrix_;
  VectorX<Scalar> raw_gradient_, gradient_, lower_, upper_, solution_, column_, row_lower_, row_upper_;
  std::vector<OutputTerm<Scalar>> point_;
  Index unknowns_ = 0, limits_a_frame_ = 0, patch_rows_a_frame_ = 0;
};

}  // namespace clothctl
