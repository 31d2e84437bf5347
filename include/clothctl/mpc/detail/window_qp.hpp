#pragma once

// The QP of a window in the unknowns u of grip_basis.hpp: raw inputs r_k = B u_k + r0, δ = r - ū:
//
//   ½ δᵀH δ + gᵀδ + effort(r)   ->   ½ uᵀ(BᵀH B + ridge) u + (Bᵀ(g - H (ū - r0)))ᵀ u
//   bounds:         lb <= u <= ub
//   grip limits:    Σ s_i d_i - a <= limit    for each finger and frame (s: normal shares)
//   hard patches:   N y_k = 0                 3 · non-affine modes a frame ([Bai 2016], eq. 3)
//
// Without hard patch rows, the QP with only bounds is solved first; the row solver follows only
// when that solution exceeds a grip limit. With hard patch rows, the row solver is used at once. If
// a grip limit makes the patch rows infeasible, they are relaxed by an exact L1 penalty.

#include <algorithm>
#include <cmath>
#include <concepts>
#include <utility>
#include <vector>

#include "clothctl/mpc/detail/condense.hpp"
#include "clothctl/mpc/detail/hand_motion.hpp"
#include "clothctl/mpc/detail/input_splines.hpp"
#include "clothctl/mpc/detail/relaxed_qp.hpp"
#include "clothctl/mpc/detail/term_stack.hpp"
#include "clothctl/mpc/detail/window_limits.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"
#include "clothctl/mpc/plan_types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Assembles and solves the QP of one window. All memory is made by `reserve`.
template <RealScalar Scalar, ContactModel<Scalar> Contact, BoxQpSolver<Scalar> BoxSolver,
          QpSolver<Scalar> RowSolver>
requires std::constructible_from<BoxSolver> && std::movable<BoxSolver> &&
    std::constructible_from<RowSolver> && std::movable<RowSolver>
class WindowQp {
 public:
  using Problem = WindowProblem<Scalar, Contact>;
  using Basis = GripBasis<Scalar, Contact>;
  using FingerColumns = typename Basis::FingerColumns;

  /// Makes room for a problem. Allocates.
  void reserve(const Problem& problem) {
    const QpSettings<Scalar>& settings = problem.settings.qp;
    const Index p = problem.basis.unknowns(), horizon = problem.settings.horizon,
                raw = problem.basis.inputs() * horizon;
    splines_.reserve(problem.settings, p);
    unknowns_ = p * splines_.count();
    if constexpr (std::constructible_from<BoxSolver, QpSettings<Scalar>>)
      box_ = BoxSolver(settings);
    if constexpr (std::constructible_from<RowSolver, QpSettings<Scalar>>) {
      rows_ = RowSolver(settings);
      relaxed_.solver = RowSolver(settings);
    }
    raw_hessian_.setZero(raw, raw);
    raw_gradient_.setZero(raw);
    hessian_.setZero(unknowns_, unknowns_);
    for (VectorX<Scalar>* v : {&gradient_, &lower_, &upper_}) v->setZero(unknowns_);
    solution_.setZero(p * horizon);
    column_.setZero(problem.basis.inputs());
    block_.setZero(p, p);
    half_.setZero(p, problem.basis.inputs());
    transposed_ = half_;
    input_ = column_;
    qp_solver_traits<BoxSolver>::reserve(box_, unknowns_);
    resize_result(box_result_, unknowns_, 0);
    if (problem.settings.input == GripInput::Force) reserve_rows(problem);
  }

  /// Makes room for a problem with other grips, the unknowns of whose frames are `map` times those
  /// of the last problem: the next solve starts from the last solution, where there is one.
  /// Allocates.
  void carry(const Problem& problem, const MatrixX<Scalar>& map) {
    const VectorX<Scalar> last = start_.size() > 0 ? start_ : solution_;
    const bool known = start_.size() > 0 || solved_;
    const Index p = map.rows(), q = map.cols();
    reset();
    reserve(problem);
    if (!known || splines_.used()) return;
    start_.setZero(unknowns_);
    for (Index k = 0; k < problem.settings.horizon; ++k)
      start_.segment(k * p, p).noalias() = map * last.segment(k * q, q);
  }

  /// Returns true when the QPs of a frame have used up its iterations: it starts no further one.
  static bool spent(const Problem& problem, const PlanResult<Scalar>& result) {
    const int most = problem.settings.qp.max_iterations;
    return most > 0 && most <= result.qp_iterations;
  }

  /// The unknowns of frame `k` of the last solution.
  auto frame(Index k, Index unknowns) const { return solution_.segment(k * unknowns, unknowns); }

  /// Moves the warm start one frame on. Control points of splines stay where they are in the
  /// window.
  void shift(Index unknowns) {
    if (splines_.used()) return;
    for (Index i = 0; i + unknowns < start_.size(); ++i) start_[i] = start_[i + unknowns];
    if constexpr (requires { qp_solver_traits<BoxSolver>::shift(box_, unknowns); }) {
      qp_solver_traits<BoxSolver>::shift(box_, unknowns);
    }
    if constexpr (requires { qp_solver_traits<RowSolver>::shift(rows_, unknowns, unknowns); }) {
      qp_solver_traits<RowSolver>::shift(rows_, unknowns, limits_a_frame_ + patch_rows_a_frame_);
    }
  }
  /// Forgets warm starts.
  void reset() {
    start_.resize(0);
    solved_ = false;
    if constexpr (requires { qp_solver_traits<BoxSolver>::reset(box_); })
      qp_solver_traits<BoxSolver>::reset(box_);
    if constexpr (requires { qp_solver_traits<RowSolver>::reset(rows_); })
      qp_solver_traits<RowSolver>::reset(rows_);
  }

  /// Builds H, g and bounds at positions `x` (3×n) from the stacked cost and that of the limits
  /// about the plan of the predicted window. Never allocates.
  void assemble(const Problem& problem, const TermStack<Scalar>& stack,
                WindowLimits<Scalar>& limits, const PointsView<Scalar>& x) {
    condense<Scalar>(stack.blocks(), stack.residual(), raw_hessian_, raw_gradient_);
    if (stack.has_features())
      condense_jacobian(stack.feature_response(), stack.feature_residual(), raw_hessian_,
                        raw_gradient_);
    limits.add(problem, raw_hessian_, raw_gradient_);
    add_effort(problem);
    map_gradient(problem);
    map_hessian(problem);
    set_bounds(problem, x);
    splines_.contract(hessian_, gradient_, lower_, upper_);
  }

  /// Solves and returns Planned, Suboptimal, Relaxed or Failed. Sets qp_status and used_rows of
  /// `result`, and adds to its qp_iterations. Never allocates.
  PlanStatus solve(const Problem& problem, PlanResult<Scalar>& result) {
    const PlanStatus status = solve_problem(problem, result);
    start_.resize(0);  // the solvers remember from here
    solved_ = status != PlanStatus::Failed;
    return status;
  }

 private:
  using BoxResult = typename qp_solver_traits<BoxSolver>::result_type;
  using RowResult = typename qp_solver_traits<RowSolver>::result_type;
  using View = Eigen::Ref<const VectorX<Scalar>>;

  PlanStatus solve_problem(const Problem& problem, PlanResult<Scalar>& result) {
    const bool force = problem.settings.input == GripInput::Force;
    bool hard = false;
    if (force && patch_rows_a_frame_ > 0) {
      for (const HeldPatch<Scalar>& p : problem.patches)
        hard = hard || p.affine.non_affine_count() > 0;
    }
    result.used_rows = false;
    if (!hard) {
      const PlanStatus status = solve_box(result);
      if (force && status != PlanStatus::Failed) remove_negatives();
      if (status == PlanStatus::Failed || !force || limits_hold(problem)) return status;
    }
    result.used_rows = true;
    const PlanStatus status = solve_rows(problem, hard, result);
    if (status != PlanStatus::Failed) keep_limits(problem);
    return status;
  }

  void reserve_rows(const Problem& problem) {
    Index hard = 0;
    std::size_t longest = 0;
    for (const HeldPatch<Scalar>& p : problem.patches) {
      if (problem.settings.patch == PatchMode::Hard) hard += 3 * (p.affine.count() - 1);
      longest = (std::max)(longest, p.held_slots.size());
    }
    limits_a_frame_ = static_cast<Index>(problem.basis.fingers().size());
    patch_rows_a_frame_ = hard;
    const Index horizon = problem.settings.horizon, rows = (limits_a_frame_ + hard) * horizon;
    point_.reserve(longest);
    row_matrix_.setZero(rows, unknowns_);
    row_lower_.setZero(rows);
    row_upper_.setZero(rows);
    qp_solver_traits<RowSolver>::reserve(rows_, unknowns_, rows);
    resize_result(row_result_, unknowns_, rows);
    if (hard > 0) relaxed_.reserve(unknowns_, rows, hard * horizon);
  }

  void add_effort(const Problem& problem) {
    const PlannerWeights<Scalar>& w = problem.settings.weights;
    const bool force = problem.settings.input == GripInput::Force;
    const Index m = problem.basis.inputs();
    for (Index k = 0; k < problem.settings.horizon; ++k) {
      for (Index i = 0; i < m; ++i) {
        const Index row = k * m + i;
        const Scalar effort =
            force ? w.force : w.velocity * problem.basis.held().vertex_share(i / 3);
        raw_hessian_(row, row) += effort;
        raw_gradient_[row] += effort * (problem.response.plan(i, k) - problem.force_share[i % 3]);
      }
    }
  }

  /// Bounds of the unknowns of all frames.
  void set_bounds(const Problem& problem, const PointsView<Scalar>& x) {
    const PlannerSettings<Scalar>& settings = problem.settings;
    const Index p = problem.basis.unknowns();
    VectorX<Scalar>&lower = splines_.lower(lower_), &upper = splines_.upper(upper_);
    problem.basis.bounds(x, settings.max_step, settings.dt, lower.head(p), upper.head(p));
    for (Index k = 1; k < settings.horizon; ++k) {
      lower.segment(k * p, p) = lower.head(p);
      upper.segment(k * p, p) = upper.head(p);
    }
    if (limits_pose_changes(settings)) narrow_pose_bounds(problem, lower, upper);
  }

  /// Bᵀ (g - H (ū - r0)).
  void map_gradient(const Problem& problem) {
    VectorX<Scalar>& gradient = splines_.gradient(gradient_);
    const Basis& basis = problem.basis;
    const Index m = basis.inputs(), p = basis.unknowns(), horizon = problem.settings.horizon;
    for (Index k = 0; k < horizon; ++k) {
      column_ = raw_gradient_.segment(k * m, m);
      for (Index j = 0; j < horizon; ++j) {
        input_ = problem.response.plan.col(j) - basis.offset();
        column_.noalias() -= raw_hessian_.block(k * m, j * m, m, m) * input_;
      }
      for (Index c = 0; c < p; ++c) gradient[k * p + c] = dot(basis, c, column_);
    }
  }

  /// Bᵀ H B, and a ridge.
  void map_hessian(const Problem& problem) {
    const Basis& basis = problem.basis;
    const PlannerSettings<Scalar>& settings = problem.settings;
    const Index m = basis.inputs(), p = basis.unknowns(), horizon = settings.horizon;
    MatrixX<Scalar>& hessian = splines_.hessian(hessian_);
    transposed_ = basis.matrix().transpose();
    for (Index l = 0; l < horizon; ++l) {
      for (Index j = l; j < horizon; ++j) {
        for (Index s = 0; s < m; ++s) {
          const Scalar* raw = &raw_hessian_.coeffRef(j * m, l * m + s);
          for (Index d = 0; d < p;) d = map_column(basis, raw, d, s);
        }
        for (Index d = 0; d < p; ++d) {
          const RowRange rows = basis.rows(d);
          block_.col(d).setZero();
          for (Index r = rows.first; r < rows.first + rows.second; ++r)
            block_.col(d) += basis.matrix()(r, d) * half_.col(r);
        }
        if (l == j) block_.template triangularView<Eigen::StrictlyUpper>() = block_.transpose();
        hessian.block(j * p, l * p, p, p) = block_;
        if (l < j) hessian.block(l * p, j * p, p, p) = block_.transpose();
      }
    }
    const bool force = settings.input == GripInput::Force;
    // A rotation about a line of vertices moves nothing, so poses need a ridge too.
    const Scalar ridge = force ? settings.weights.cone : Scalar(1e-3) * settings.weights.velocity;
    hessian.diagonal().array() += ridge;
  }

  /// Writes the entries from `d` on of column `s` of half_ that share their rows of B, for the
  /// column `raw` of a block of H. Returns the first entry after them.
  Index map_column(const Basis& basis, const Scalar* raw, Index d, Index s) {
    const RowRange rows = basis.rows(d);
    Index end = d + 1;
    while (end < basis.unknowns() && basis.rows(end) == rows) ++end;
    const auto add = [&](auto half, const auto& part) {
      half = raw[rows.first] * part(rows.first);
      for (Index r = rows.first + 1; r < rows.first + rows.second; ++r) half += raw[r] * part(r);
      return half;
    };
    if (end - d == 6) {  // a rigid grip: its six sums stay in registers
      using Six = Eigen::Matrix<Scalar, 6, 1>;
      half_.col(s).template segment<6>(d) =
          add(Six(), [&](Index r) { return transposed_.col(r).template segment<6>(d); });
    } else {
      add(half_.col(s).segment(d, end - d),
          [&](Index r) { return transposed_.col(r).segment(d, end - d); });
    }
    return end;
  }

  /// Solves the QP with only bounds.
  PlanStatus solve_box(PlanResult<Scalar>& result) {
    using Traits = qp_solver_traits<BoxSolver>;
    result.qp_status = Traits::set_hessian(box_, hessian_);
    if (result.qp_status != QpStatus::Solved) return PlanStatus::Failed;
    if (start_.size() > 0) start_from(box_, start_);
    result.qp_status =
        Traits::solve(box_, View(gradient_), View(lower_), View(upper_), box_result_);
    result.qp_iterations += iterations_of(box_result_);
    return take<BoxSolver>(box_result_, result.qp_status);
  }

  /// Solves the QP with rows. If hard patch rows are infeasible, solves the relaxed QP.
  PlanStatus solve_rows(const Problem& problem, bool hard, PlanResult<Scalar>& result) {
    fill_rows(problem);
    result.qp_status = solve_with_rows(rows_, hessian_, row_matrix_, gradient_, lower_, upper_,
                                       row_lower_, row_upper_, row_result_, start_);
    result.qp_iterations += iterations_of(row_result_);
    if (!hard || result.qp_status != QpStatus::PrimalInfeasible)
      return take<RowSolver>(row_result_, result.qp_status);
    relaxed_.fill(hessian_, row_matrix_, gradient_, lower_, upper_, row_lower_, row_upper_,
                  limits_a_frame_, patch_rows_a_frame_);
    result.qp_status =
        solve_with_rows(relaxed_.solver, relaxed_.hessian, relaxed_.rows, relaxed_.gradient,
                        relaxed_.lower, relaxed_.upper, row_lower_, row_upper_, relaxed_.result);
    result.qp_iterations += iterations_of(relaxed_.result);
    const bool failed = take<RowSolver>(relaxed_.result, result.qp_status) == PlanStatus::Failed;
    return failed ? PlanStatus::Failed : PlanStatus::Relaxed;
  }

  static PlanStatus plan_status(QpStatus status) {
    if (status == QpStatus::Solved) return PlanStatus::Planned;
    if (status == QpStatus::SolvedInaccurate || status == QpStatus::IterationLimit ||
        status == QpStatus::TimeLimit)
      return PlanStatus::Suboptimal;
    return PlanStatus::Failed;
  }

  /// Column c of B times a vector of raw inputs.
  static Scalar dot(const Basis& basis, Index c, const VectorX<Scalar>& raw) {
    const RowRange rows = basis.rows(c);
    return basis.matrix()
        .col(c)
        .segment(rows.first, rows.second)
        .dot(raw.segment(rows.first, rows.second));
  }

  /// Stores the unknowns of a result. Returns Failed when there is no solution or it is not finite.
  template <QpSolverBase<Scalar> Solver>
  PlanStatus take(const typename qp_solver_traits<Solver>::result_type& result,
                  QpStatus qp_status) {
    const PlanStatus status = plan_status(qp_status);
    if (status == PlanStatus::Failed) return status;
    const View x(qp_solver_traits<Solver>::solution(result));
    if (x.size() < unknowns_ || !all_finite(x)) return PlanStatus::Failed;
    if (splines_.used()) {
      splines_.expand(x.head(unknowns_), solution_);
    } else {
      solution_ = x.head(unknowns_);
    }
    return status;
  }

  /// Returns true when every finger of every frame keeps its limit.
  bool limits_hold(const Problem& problem) const {
    const Basis& basis = problem.basis;
    for (Index k = 0; k < problem.settings.horizon; ++k) {
      for (const FingerColumns& columns : basis.fingers()) {
        const Scalar normal = basis.normal_force(columns, frame(k, basis.unknowns()));
        if (basis.finger(columns).max_normal_force < normal) return false;
      }
    }
    return true;
  }

  /// Sets coefficients of generators that a solver leaves below zero to zero: a finger only
  /// presses.
  void remove_negatives() {
    for (Index i = 0; i < unknowns_; ++i) {
      if (solution_[i] < Scalar(0)) solution_[i] = Scalar(0);
    }
  }

  /// Makes coefficients that a row solver leaves slightly off obey the contact law.
  void keep_limits(const Problem& problem) {
    const Index p = problem.basis.unknowns();
    for (Index k = 0; k < problem.settings.horizon; ++k)
      problem.basis.keep_limits(solution_.segment(k * p, p));
  }

  /// Fills the rows of all frames, frame by frame: a limit of the normal force for each finger,
  /// then the non-affine modes of the patches. Each patch has rows for the largest possible number
  /// of modes. Where its vertices span a plane rather than a line, more of its motion is affine,
  /// fewer modes remain, and the unused rows stay empty and unbounded.
  void fill_rows(const Problem& problem) {
    const Basis& basis = problem.basis;
    const Index a_frame = limits_a_frame_ + patch_rows_a_frame_;
    row_matrix_.setZero();
    row_lower_.setConstant(-scalar_traits<Scalar>::infinity());
    row_upper_.setConstant(scalar_traits<Scalar>::infinity());
    for (Index k = 0; k < problem.settings.horizon; ++k) {
      Index row = k * a_frame;
      for (const FingerColumns& columns : basis.fingers()) {
        const Index first = k * basis.unknowns() + columns.column;
        for (Index i = 0; i < columns.count; ++i)
          row_matrix_(row, first + i) = basis.normal_share(columns, i);
        row_upper_[row] = basis.most_pressed(columns);
        ++row;
      }
      if (patch_rows_a_frame_ == 0) continue;
      for (const HeldPatch<Scalar>& patch : problem.patches) {
        for (Index i = 0; i < patch.affine.non_affine_count(); ++i) {
          take_non_affine(patch, i, problem.request.held_outputs, point_);
          for (Index c = 0; c < 3; ++c, ++row) fill_patch_row(row, k, c, problem);
        }
      }
    }
  }

  /// Fills the row that keeps coordinate c of the mode in point_ at zero in frame k.
  void fill_patch_row(Index row, Index k, Index c, const Problem& problem) {
    const Basis& basis = problem.basis;
    const WindowResponse<Scalar>& window = problem.response;
    const Index m = basis.inputs(), p = basis.unknowns();
    Scalar offset = Scalar(0);
    for (const OutputTerm<Scalar>& t : point_)
      offset -= t.weight * window.free_response(3 * t.output + c, k);
    for (Index j = 0; j <= k; ++j) {
      column_.setZero();
      for (const OutputTerm<Scalar>& t : point_) {
        column_ +=
            t.weight *
            window.impulse_response.row(3 * t.output + c).segment((k - j) * m, m).transpose();
      }
      offset += column_.dot(window.plan.col(j) - basis.offset());
      for (Index d = 0; d < p; ++d) row_matrix_(row, j * p + d) = dot(basis, d, column_);
    }
    row_lower_[row] = offset;
    row_upper_[row] = offset;
  }

  InputSplines<Scalar> splines_;
  BoxSolver box_;
  RowSolver rows_;
  BoxResult box_result_;
  RowResult row_result_;
  RelaxedQp<Scalar, RowSolver> relaxed_;
  MatrixX<Scalar> raw_hessian_, hessian_, row_matrix_;
  MatrixX<Scalar> transposed_, half_, block_;  // of a pair of frames: Bᵀ, Bᵀ H, Bᵀ H B
  VectorX<Scalar> raw_gradient_, gradient_, lower_, upper_, solution_, column_, input_, row_lower_,
      row_upper_, start_;
  std::vector<OutputTerm<Scalar>> point_;
  Index unknowns_ = 0, limits_a_frame_ = 0, patch_rows_a_frame_ = 0;
  bool solved_ = false;  // solution_ is that of the last frame
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
