#include <qpOASES.hpp>

#include "solver.hpp"

namespace versus {

namespace {

/// The "reliable" options; warm frames are hot starts.
class QpOases final : public Solver {
 public:
  explicit QpOases(double seconds) : seconds_(seconds) {}

  bool prepare(const Problem& problem) override {
    problem_ = &problem;
    H_ = problem.H;
    A_ = problem.A;
    return true;
  }

  void setup() override {
    qpOASES::Options options;
    options.setToReliable();
    options.printLevel = qpOASES::PL_NONE;
    const auto n = static_cast<qpOASES::int_t>(problem_->n());
    const auto m = static_cast<qpOASES::int_t>(problem_->m());
    if (m == 0) {
      box_ = std::make_unique<qpOASES::QProblemB>(n);
      box_->setOptions(options);
    } else {
      general_ = std::make_unique<qpOASES::QProblem>(n, m);
      general_->setOptions(options);
    }
  }

  Verdict solve(const Vectors& v, Start start) override {
    lb_ = clip(v.lb, 1e20);
    ub_ = clip(v.ub, 1e20);
    rl_ = clip(v.rl, 1e20);
    ru_ = clip(v.ru, 1e20);
    const bool first = start == Start::Single || start == Start::First || !good_;
    qpOASES::int_t rounds = 1000000;
    qpOASES::real_t seconds = seconds_;
    qpOASES::returnValue value = qpOASES::SUCCESSFUL_RETURN;
    if (!good_ && start != Start::Single && start != Start::First) setup();
    if (box_) {
      value = first ? box_->init(H_.data(), v.g.data(), lb_.data(), ub_.data(), rounds, &seconds)
                    : box_->hotstart(v.g.data(), lb_.data(), ub_.data(), rounds, &seconds);
    } else {
      value = first ? general_->init(H_.data(), v.g.data(), A_.data(), lb_.data(), ub_.data(),
                                     rl_.data(), ru_.data(), rounds, &seconds)
                    : general_->hotstart(v.g.data(), lb_.data(), ub_.data(), rl_.data(), ru_.data(),
                                         rounds, &seconds);
    }
    good_ = value == qpOASES::SUCCESSFUL_RETURN;
    switch (qpOASES::getSimpleStatus(value)) {
      case 0: return Verdict::Solved;
      case -2: return Verdict::Infeasible;
      case -3: return Verdict::Unbounded;
      default: return Verdict::Stopped;
    }
  }

  void read(Answer& answer) override {
    const Index n = problem_->n(), m = problem_->m();
    Vector dual = Vector::Zero(n + m);
    answer.x.setZero(n);
    if (box_) {
      box_->getPrimalSolution(answer.x.data());
      box_->getDualSolution(dual.data());
    } else {
      general_->getPrimalSolution(answer.x.data());
      general_->getDualSolution(dual.data());
    }
    answer.z = dual.head(n);
    answer.y = dual.tail(m);
  }

 private:
  const Problem* problem_ = nullptr;
  RowMatrix H_, A_;
  Vector lb_, ub_, rl_, ru_;
  std::unique_ptr<qpOASES::QProblemB> box_;
  std::unique_ptr<qpOASES::QProblem> general_;
  double seconds_;
  bool good_ = false;
};

}  // namespace

Entry qpoases_entry() {
  return {
      "qpoases",
      VERSUS_QPOASES_VERSION,
      {Start::Kept},
      [](double seconds) -> std::unique_ptr<Solver> { return std::make_unique<QpOases>(seconds); }};
}

}  // namespace versus
