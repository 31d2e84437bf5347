#include <osqp.h>

#include <cmath>

#include "solver.hpp"

namespace versus {

namespace {

/// Tolerances of 1e-7, polishing on, and practically no iteration limit. With its defaults (1e-3)
/// no answer would pass.
class Osqp final : public Solver {
 public:
  explicit Osqp(double seconds) : seconds_(seconds) {}
  Osqp(const Osqp&) = delete;
  Osqp& operator=(const Osqp&) = delete;
  ~Osqp() override { release(); }

  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    const Index n = problem.n(), m = problem.m();
    Matrix stacked(m + n, n);
    stacked << problem.A, Matrix::Identity(n, n);
    P_.take(problem.H.triangularView<Eigen::Upper>());
    A_.take(stacked);
    return true;
  }

  void setup() override {}

  Verdict solve(const Vectors& v, Start start) override {
    const Index n = problem_->n(), m = problem_->m();
    l_.resize(m + n);
    u_.resize(m + n);
    l_ << v.rl, v.lb;
    u_ << v.ru, v.ub;
    l_ = l_.cwiseMax(-OSQP_INFTY);
    u_ = u_.cwiseMin(OSQP_INFTY);
    if ((l_.array() > u_.array()).any())
      return Verdict::Refused;  // the solver's own reaction, with a printed message
    if (start == Start::Single || start == Start::First || solver_ == nullptr) {
      release();
      OSQPSettings* settings = OSQPSettings_new();
      settings->verbose = 0;
      settings->eps_abs = 1e-7;
      settings->eps_rel = 1e-7;
      settings->max_iter = 1000000;
      settings->polishing = 1;
      settings->time_limit = seconds_;
      OSQPCscMatrix P{}, A{};
      P_.view(P);
      A_.view(A);
      const OSQPInt error =
          osqp_setup(&solver_, &P, v.g.data(), &A, l_.data(), u_.data(), m + n, n, settings);
      OSQPSettings_free(settings);
      if (error != 0) {
        release();
        return error == OSQP_DATA_VALIDATION_ERROR ? Verdict::Refused : Verdict::Stopped;
      }
    } else if (osqp_update_data_vec(solver_, v.g.data(), l_.data(), u_.data()) != 0) {
      return Verdict::Refused;
    }
    if (osqp_solve(solver_) != 0) return Verdict::Stopped;
    switch (solver_->info->status_val) {
      case OSQP_SOLVED: return Verdict::Solved;
      case OSQP_SOLVED_INACCURATE: return Verdict::Inaccurate;
      case OSQP_PRIMAL_INFEASIBLE: return Verdict::Infeasible;
      case OSQP_DUAL_INFEASIBLE: return Verdict::Unbounded;
      default: return Verdict::Stopped;
    }
  }

  void read(Answer& answer) override {
    const Index n = problem_->n(), m = problem_->m();
    if (solver_ == nullptr) return;
    answer.x = Eigen::Map<const Vector>(solver_->solution->x, n);
    answer.y = -Eigen::Map<const Vector>(solver_->solution->y, m);
    answer.z = -Eigen::Map<const Vector>(solver_->solution->y + m, n);
  }

 private:
  /// A compressed-column matrix that owns its arrays.
  struct Sparse {
    std::vector<OSQPFloat> value;
    std::vector<OSQPInt> row, begin;
    OSQPInt rows = 0, cols = 0;

    void take(const Matrix& dense) {
      rows = dense.rows();
      cols = dense.cols();
      begin.assign(1, 0);
      for (Index j = 0; j < dense.cols(); ++j) {
        for (Index i = 0; i < dense.rows(); ++i) {
          if (!(std::abs(dense(i, j)) > 0.0)) continue;
          value.push_back(dense(i, j));
          row.push_back(i);
        }
        begin.push_back(static_cast<OSQPInt>(value.size()));
      }
    }
    void view(OSQPCscMatrix& matrix) {
      OSQPCscMatrix_set_data(&matrix, rows, cols, static_cast<OSQPInt>(value.size()), value.data(),
                             row.data(), begin.data());
    }
  };

  void release() {
    if (solver_ != nullptr) osqp_cleanup(solver_);
    solver_ = nullptr;
  }

  const Problem* problem_ = nullptr;
  Sparse P_, A_;
  Vector l_, u_;
  OSQPSolver* solver_ = nullptr;
  double seconds_;
};

}  // namespace

Entry osqp_entry() {
  return {"osqp", osqp_version(), {Start::Kept}, [](double seconds) -> std::unique_ptr<Solver> {
            return std::make_unique<Osqp>(seconds);
          }};
}

}  // namespace versus
