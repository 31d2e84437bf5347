#include "clothctl/config.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "solver.hpp"

namespace versus {

namespace {

Verdict verdict(clothctl::QpStatus status) {
  switch (status) {
    case clothctl::QpStatus::Solved: return Verdict::Solved;
    case clothctl::QpStatus::SolvedInaccurate: return Verdict::Inaccurate;
    case clothctl::QpStatus::PrimalInfeasible: return Verdict::Infeasible;
    case clothctl::QpStatus::DualInfeasible: return Verdict::Unbounded;
    case clothctl::QpStatus::NonConvex:
    case clothctl::QpStatus::InvalidData: return Verdict::Refused;
    default: return Verdict::Stopped;
  }
}

/// BoxActiveSet if there are no rows, else ActiveSet.
class Ours final : public Solver {
 public:
  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    return true;
  }

  void setup() override {
    const Problem& p = *problem_;
    if (p.m() == 0) {
      box_.reserve(p.n());
      ready_ = box_.set_hessian(p.H) == clothctl::QpStatus::Solved;
    } else {
      general_.reserve(p.n(), p.m());
      ready_ = general_.set_hessian(p.H) == clothctl::QpStatus::Solved &&
               general_.set_rows(p.A) == clothctl::QpStatus::Solved;
    }
  }

  Verdict solve(const Vectors& v, Start start) override {
    if (!ready_) return Verdict::Refused;
    if (problem_->m() == 0) {
      if (start == Start::Shifted) box_.shift(problem_->shift);
      return verdict(box_.solve(v.g, v.lb, v.ub, result_));
    }
    if (start == Start::Shifted) general_.shift(problem_->shift, problem_->row_shift);
    return verdict(general_.solve(v.g, v.lb, v.ub, v.rl, v.ru, result_));
  }

  void read(Answer& answer) override {
    answer.x = result_.x;
    answer.y = result_.row_multipliers;
    answer.z = result_.bound_multipliers;
  }

 private:
  const Problem* problem_ = nullptr;
  clothctl::BoxActiveSet<double> box_;
  clothctl::ActiveSet<double> general_;
  clothctl::QpResult<double> result_;
  bool ready_ = false;
};

}  // namespace

Entry clothctl_entry() {
  return {"clothctl",
          CLOTHCTL_VERSION_STRING,
          {Start::Shifted, Start::Kept},
          [](double) -> std::unique_ptr<Solver> { return std::make_unique<Ours>(); }};
}

}  // namespace versus
