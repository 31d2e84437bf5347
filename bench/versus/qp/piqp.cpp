#include <piqp/piqp.hpp>

#include "solver.hpp"

namespace versus {

namespace {

/// Dense backend, default settings. Warm frames reuse the set-up; an interior point method cannot
/// reuse more.
class Piqp final : public Solver {
 public:
  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    rows_.take(problem);
    return true;
  }

  void setup() override { fresh_ = true; }

  Verdict solve(const Vectors& v, Start) override {
    b_ = v.rl(rows_.equal);
    low_ = v.rl(rows_.other);
    high_ = v.ru(rows_.other);
    piqp::optional<piqp::CMatRef<double>> A, G;
    piqp::optional<piqp::CVecRef<double>> b, low, high;
    if (!rows_.equal.empty()) {
      A.emplace(rows_.A_equal);
      b.emplace(b_);
    }
    if (!rows_.other.empty()) {
      G.emplace(rows_.A_other);
      low.emplace(low_);
      high.emplace(high_);
    }
    const piqp::CVecRef<double> g(v.g), lb(v.lb), ub(v.ub);
    if (fresh_) {
      solver_.setup(problem_->H, g, A, b, G, low, high, lb, ub);
    } else {
      solver_.update(piqp::nullopt, g, piqp::nullopt, b, piqp::nullopt, low, high, lb, ub);
    }
    fresh_ = false;
    switch (solver_.solve()) {
      case piqp::PIQP_SOLVED: return Verdict::Solved;
      case piqp::PIQP_PRIMAL_INFEASIBLE: return Verdict::Infeasible;
      case piqp::PIQP_DUAL_INFEASIBLE: return Verdict::Unbounded;
      case piqp::PIQP_INVALID_SETTINGS: return Verdict::Refused;
      default: return Verdict::Stopped;
    }
  }

  void read(Answer& answer) override {
    const auto& r = solver_.result();
    answer.x = r.x;
    answer.z = r.z_bl - r.z_bu;
    answer.y.setZero(problem_->m());
    answer.y(rows_.equal) = -r.y;
    answer.y(rows_.other) = r.z_l - r.z_u;
  }

 private:
  const Problem* problem_ = nullptr;
  RowSplit rows_;
  Vector b_, low_, high_;
  piqp::DenseSolver<double> solver_;
  bool fresh_ = true;
};

}  // namespace

Entry piqp_entry() {
  return {"piqp", VERSUS_PIQP_VERSION, {Start::Kept}, [](double) -> std::unique_ptr<Solver> {
            return std::make_unique<Piqp>();
          }};
}

}  // namespace versus
