#include <eiquadprog/eiquadprog-fast.hpp>

#include "solver.hpp"

namespace versus {

namespace {

/// Needs H > 0, and takes bounds as rows of a dense matrix. It has no warm start, so every frame
/// starts cold. (Its path for a given inverse factor is not used: in version 1.2.9 it starts from
/// the negative of the unconstrained minimiser.)
class Eiquadprog final : public Solver {
 public:
  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    split(problem.first);
    return is_positive_definite(problem.H);
  }

  void setup() override {
    const auto size = [](Index k) { return static_cast<std::size_t>(k); };
    solver_.reset(size(problem_->n()), size(equal_.rows()), size(inside_.rows()));
    solver_.setMaxIter(1000000);
  }

  Verdict solve(const Vectors& v, Start) override {
    using Status = eiquadprog::solvers::EiquadprogFast_status;
    if (pattern_changed(v)) {
      split(v);
      solver_.reset(static_cast<std::size_t>(problem_->n()),
                    static_cast<std::size_t>(equal_.rows()),
                    static_cast<std::size_t>(inside_.rows()));
    }
    for (std::size_t k = 0; k < equals_.size(); ++k)
      offset_equal_[static_cast<Index>(k)] = -value(v, equals_[k], true);
    for (std::size_t k = 0; k < sides_.size(); ++k) {
      const double bound = value(v, sides_[k].index, sides_[k].lower);
      offset_[static_cast<Index>(k)] = sides_[k].lower ? -bound : bound;
    }
    x_.resize(problem_->n());
    switch (solver_.solve_quadprog(problem_->H, v.g, equal_, offset_equal_, inside_, offset_, x_)) {
      case Status::EIQUADPROG_FAST_OPTIMAL: return Verdict::Solved;
      case Status::EIQUADPROG_FAST_INFEASIBLE: return Verdict::Infeasible;
      case Status::EIQUADPROG_FAST_UNBOUNDED:
        return Verdict::Infeasible;  // the dual is unbounded, since H > 0
      default: return Verdict::Stopped;
    }
  }

  void read(Answer& answer) override {
    answer.x = x_;
    answer.y.setZero(problem_->m());
    answer.z.setZero(problem_->n());
    const Vector& u = solver_.getLagrangeMultipliers();
    const Eigen::VectorXi& active = solver_.getActiveSet();
    for (Index k = 0; k < static_cast<Index>(solver_.getActiveSetSize()); ++k) {
      const int a = active[k];
      if (a < 0) {
        multiplier(answer, equals_[static_cast<std::size_t>(-a - 1)]) += u[k];
      } else {
        const Side& side = sides_[static_cast<std::size_t>(a)];
        multiplier(answer, side.index) += side.lower ? u[k] : -u[k];
      }
    }
  }

 private:
  /// One side of a bound (index < n) or row (index - n).
  struct Side {
    Index index;
    bool lower;
  };

  double value(const Vectors& v, Index i, bool lower) const {
    const Index n = problem_->n();
    if (i < n) return lower ? v.lb[i] : v.ub[i];
    return lower ? v.rl[i - n] : v.ru[i - n];
  }
  double& multiplier(Answer& answer, Index i) const {
    return i < problem_->n() ? answer.z[i] : answer.y[i - problem_->n()];
  }

  void list(const Vectors& v, std::vector<Index>& equals, std::vector<Side>& sides) const {
    for (Index i = 0; i < problem_->n() + problem_->m(); ++i) {
      const double low = value(v, i, true), high = value(v, i, false);
      if (low == high) {
        equals.push_back(i);
        continue;
      }
      if (low > -1e20) sides.push_back({i, true});
      if (high < 1e20) sides.push_back({i, false});
    }
  }

  bool pattern_changed(const Vectors& v) const {
    std::size_t e = 0, s = 0;
    for (Index i = 0; i < problem_->n() + problem_->m(); ++i) {
      const double low = value(v, i, true), high = value(v, i, false);
      if (low == high) {
        if (e >= equals_.size() || equals_[e++] != i) return true;
        continue;
      }
      if (low > -1e20 && (s >= sides_.size() || sides_[s].index != i || !sides_[s++].lower))
        return true;
      if (high < 1e20 && (s >= sides_.size() || sides_[s].index != i || sides_[s++].lower))
        return true;
    }
    return e != equals_.size() || s != sides_.size();
  }

  void split(const Vectors& v) {
    equals_.clear();
    sides_.clear();
    list(v, equals_, sides_);
    const Index n = problem_->n();
    const auto normal = [&](Index i) -> Vector {
      if (i < n) return Vector::Unit(n, i);
      return problem_->A.row(i - n).transpose();
    };
    equal_.resize(static_cast<Index>(equals_.size()), n);
    inside_.resize(static_cast<Index>(sides_.size()), n);
    for (Index k = 0; k < equal_.rows(); ++k)
      equal_.row(k) = normal(equals_[static_cast<std::size_t>(k)]);
    for (Index k = 0; k < inside_.rows(); ++k) {
      const Side& side = sides_[static_cast<std::size_t>(k)];
      inside_.row(k) = side.lower ? normal(side.index) : Vector(-normal(side.index));
    }
    offset_equal_.resize(equal_.rows());
    offset_.resize(inside_.rows());
  }

  const Problem* problem_ = nullptr;
  std::vector<Index> equals_;
  std::vector<Side> sides_;
  Matrix equal_, inside_;
  Vector offset_equal_, offset_, x_;
  eiquadprog::solvers::EiquadprogFast solver_;
};

}  // namespace

Entry eiquadprog_entry() {
  return {"eiquadprog",
          VERSUS_EIQUADPROG_VERSION,
          {Start::Kept},
          [](double) -> std::unique_ptr<Solver> { return std::make_unique<Eiquadprog>(); }};
}

}  // namespace versus
