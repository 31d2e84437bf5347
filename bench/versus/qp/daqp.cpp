#include <daqp/api.h>
#include <daqp/utils.h>

#include <utility>

#include "solver.hpp"

namespace versus {

namespace {

/// Single solves use `daqp_quadprog` with its default settings; sequences keep a workspace.
class Daqp final : public Solver {
 public:
  explicit Daqp(double seconds) {
    daqp_default_settings(&settings_);
    settings_.time_limit = seconds;
  }
  Daqp(const Daqp&) = delete;
  Daqp& operator=(const Daqp&) = delete;
  ~Daqp() override {
    if (!open_) return;
    work_.settings = nullptr;
    free_daqp_workspace(&work_);
    free_daqp_ldp(&work_);
  }

  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    H_ = problem.H;
    A_ = problem.A;
    const Index n = problem.n(), m = problem.m();
    lower_.resize(n + m);
    upper_.resize(n + m);
    x_.setZero(n);
    lambda_.setZero(n + m);
    sense_.assign(static_cast<std::size_t>(n + m), 0);
    return true;
  }

  void setup() override {
    const Index n = problem_->n(), m = problem_->m();
    qp_.n = static_cast<int>(n);
    qp_.ms = static_cast<int>(n);
    qp_.m = static_cast<int>(n + m);
    qp_.H = H_.data();
    qp_.A = A_.data();
    qp_.blower = lower_.data();
    qp_.bupper = upper_.data();
    qp_.sense = sense_.data();
    result_.x = x_.data();
    result_.lam = lambda_.data();
  }

  Verdict solve(const Vectors& v, Start start) override {
    const Index n = problem_->n();
    g_ = v.g;
    qp_.f = g_.data();
    lower_.head(n) = v.lb;
    upper_.head(n) = v.ub;
    lower_.tail(problem_->m()) = v.rl;
    upper_.tail(problem_->m()) = v.ru;
    lower_ = lower_.cwiseMax(-1e30);
    upper_ = upper_.cwiseMin(1e30);
    result_.exitflag = 0;
    given_set_ = start == Start::Shifted || start == Start::Kept;
    if (start == Start::Single || start == Start::First) sense_.assign(sense_.size(), 0);
    if (start == Start::Single) {
      daqp_quadprog(&result_, &qp_, &settings_);
      return verdict();
    }
    if (start == Start::First) {
      work_.settings = &settings_;
      const int flag = setup_daqp(&qp_, &work_, nullptr);
      if (flag < 0) {
        result_.exitflag = flag;
        return verdict();
      }
      open_ = true;
    } else {
      int mask = DAQP_UPDATE_v | DAQP_UPDATE_d;
      // A kept working set treats equal bounds as equalities for ever, so it is passed again when
      // bounds become equal or differ again.
      if (start == Start::Shifted || equalities_moved()) {
        choose_working_set(start == Start::Shifted ? problem_->shift : 0,
                           start == Start::Shifted ? problem_->row_shift : 0);
        mask |= DAQP_UPDATE_sense;
      }
      int flag = daqp_update_ldp(mask, &work_, &qp_);
      if (flag < 0) {
        sense_.assign(sense_.size(), 0);
        flag = daqp_update_ldp(mask | DAQP_UPDATE_sense, &work_, &qp_);
      }
      if (flag < 0) {
        result_.exitflag = flag;
        return verdict();
      }
    }
    daqp_solve(&result_, &work_);
    return verdict();
  }

  void read(Answer& answer) override {
    answer.x = x_;
    answer.z = -lambda_.head(problem_->n());
    answer.y = -lambda_.tail(problem_->m());
  }

 private:
  int& sense(Index i) { return sense_[static_cast<std::size_t>(i)]; }
  bool equal(Index i) const {
    return upper_[i] - lower_[i] < settings_.zero_tol;
  }  // then the solver marks it itself

  Verdict verdict() const {
    switch (result_.exitflag) {
      case DAQP_EXIT_OPTIMAL: return Verdict::Solved;
      case DAQP_EXIT_INFEASIBLE: return Verdict::Infeasible;
      case DAQP_EXIT_OVERDETERMINED_INITIAL:
        return given_set_ ? Verdict::Stopped : Verdict::Infeasible;
      case DAQP_EXIT_UNBOUNDED: return Verdict::Unbounded;
      default: return Verdict::Stopped;
    }
  }

  bool equalities_moved() const {
    for (Index i = 0; i < lower_.size(); ++i) {
      if (equal(i) != ((work_.sense[i] & DAQP_IMMUTABLE) != 0)) return true;
    }
    return false;
  }

  /// Writes the last working set, shifted by the given numbers of unknowns and rows, to `sense_`.
  void choose_working_set(Index shift, Index row_shift) {
    const Index n = problem_->n(), all = lower_.size();
    Index room = n;
    for (Index i = 0; i < all; ++i) {
      sense(i) = 0;
      if (equal(i)) --room;
    }
    for (Index i = 0; i < all; ++i) {
      if (equal(i)) continue;
      const Index end = i < n ? n : all;
      const Index move = i < n ? shift : row_shift;
      const int old = work_.sense[i + move < end ? i + move : i];
      if ((old & DAQP_ACTIVE) == 0 || room <= 0) continue;
      const bool low = (old & DAQP_LOWER) != 0;
      if (low ? lower_[i] <= -1e30 : upper_[i] >= 1e30) continue;
      sense(i) = DAQP_ACTIVE + (low ? DAQP_LOWER : 0);
      --room;
    }
  }

  const Problem* problem_ = nullptr;
  RowMatrix H_, A_;
  Vector g_, lower_, upper_, x_, lambda_;
  std::vector<int> sense_;
  DAQPSettings settings_{};
  DAQPProblem qp_{};
  DAQPWorkspace work_{};
  DAQPResult result_{};
  bool open_ = false, given_set_ = false;
};

}  // namespace

Entry daqp_entry() {
  return {
      "daqp",
      VERSUS_DAQP_VERSION,
      {Start::Shifted, Start::Kept},
      [](double seconds) -> std::unique_ptr<Solver> { return std::make_unique<Daqp>(seconds); }};
}

}  // namespace versus
