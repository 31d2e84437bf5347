#include <proxsuite/proxqp/dense/dense.hpp>

#include "solver.hpp"

namespace versus {

namespace {

namespace prox = proxsuite::proxqp;

/// Dense backend, tolerance 1e-8 with a check of the duality gap. Warm frames start from the last
/// result. The preconditioner is computed for every frame: if it is kept, version 0.7.2 calls wrong
/// answers of problems with bounds only solved.
class Proxqp final : public Solver {
 public:
  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    rows_.take(problem);
    linear_ = problem.H.isZero(0.0);
    boxed_ = (problem.first.lb.array() > -1e20).any() || (problem.first.ub.array() < 1e20).any();
    return true;
  }

  void setup() override {
    solver_ = std::make_unique<prox::dense::QP<double>>(
        problem_->n(), rows_.A_equal.rows(), rows_.A_other.rows(), boxed_,
        linear_ ? prox::HessianType::Zero : prox::HessianType::Dense);
    solver_->settings.eps_abs = 1e-8;
    solver_->settings.eps_rel = 1e-9;
    solver_->settings.check_duality_gap = true;
    solver_->settings.eps_duality_gap_abs = 1e-8;
    solver_->settings.eps_duality_gap_rel = 1e-9;
    fresh_ = true;
  }

  Verdict solve(const Vectors& v, Start) override {
    b_ = v.rl(rows_.equal);
    low_ = clip(v.rl(rows_.other), 1e20);
    high_ = clip(v.ru(rows_.other), 1e20);
    lb_ = clip(v.lb, 1e20);
    ub_ = clip(v.ub, 1e20);
    using proxsuite::nullopt;
    using View = prox::dense::VecRef<double>;
    proxsuite::optional<View> b, low, high, lb, ub;
    if (!rows_.equal.empty()) b.emplace(b_);
    if (!rows_.other.empty()) {
      low.emplace(low_);
      high.emplace(high_);
    }
    if (boxed_) {
      lb.emplace(lb_);
      ub.emplace(ub_);
    }
    if (fresh_) {
      proxsuite::optional<prox::dense::MatRef<double>> A, C;
      if (!rows_.equal.empty()) A.emplace(rows_.A_equal);
      if (!rows_.other.empty()) C.emplace(rows_.A_other);
      if (boxed_) {
        solver_->init(problem_->H, v.g, A, b, C, low, high, lb, ub);
      } else {
        solver_->init(problem_->H, v.g, A, b, C, low, high);
      }
    } else {
      if (boxed_) {
        solver_->update(nullopt, v.g, nullopt, b, nullopt, low, high, lb, ub, true);
      } else {
        solver_->update(nullopt, v.g, nullopt, b, nullopt, low, high, true);
      }
    }
    if (!fresh_)
      solver_->settings.initial_guess = prox::InitialGuessStatus::WARM_START_WITH_PREVIOUS_RESULT;
    fresh_ = false;
    solver_->solve();
    switch (solver_->results.info.status) {
      case prox::QPSolverOutput::PROXQP_SOLVED: return Verdict::Solved;
      case prox::QPSolverOutput::PROXQP_PRIMAL_INFEASIBLE: return Verdict::Infeasible;
      case prox::QPSolverOutput::PROXQP_DUAL_INFEASIBLE: return Verdict::Unbounded;
      default: return Verdict::Stopped;
    }
  }

  void read(Answer& answer) override {
    const auto& r = solver_->results;
    const Index others = rows_.A_other.rows();
    answer.x = r.x;
    answer.y.setZero(problem_->m());
    answer.y(rows_.equal) = -r.y;
    answer.y(rows_.other) = -r.z.head(others);
    answer.z.setZero(problem_->n());
    if (boxed_) answer.z = -r.z.tail(problem_->n());
  }

 private:
  const Problem* problem_ = nullptr;
  RowSplit rows_;
  Vector b_, low_, high_, lb_, ub_;
  std::unique_ptr<prox::dense::QP<double>> solver_;
  bool boxed_ = false, linear_ = false, fresh_ = true;
};

}  // namespace

Entry proxqp_entry() {
  return {"proxqp", VERSUS_PROXQP_VERSION, {Start::Kept}, [](double) -> std::unique_ptr<Solver> {
            return std::make_unique<Proxqp>();
          }};
}

}  // namespace versus
