#include "baseline.hpp"
#include "contender.hpp"

namespace planner_bench {

namespace {

class Paper final : public Contender {
 public:
  Paper(const Scene& scene, Index horizon, Factor factor, versus::Entry solver)
      : Contender(factor == Factor::Eigen ? "paper, Eigen's factor" : "paper, our factor", true,
                  true),
        baseline_(scene, horizon, factor),
        entry_(std::move(solver)) {}

  bool plan(const Frame& frame, Phases& times) override {
    times = {};
    if (!baseline_.form(frame, times)) return false;
    const versus::Problem& problem = baseline_.problem();
    const std::unique_ptr<versus::Solver> solver = entry_.make(60.0);
    if (!solver->prepare(problem)) return false;
    versus::Verdict verdict;
    {
      const Stopwatch watch(times.qp);
      solver->setup();
      verdict = solver->solve(problem.first, versus::Start::Single);
    }
    times.total = times.linearise + times.response + times.stack + times.qp;
    if (verdict != versus::Verdict::Solved) return false;
    versus::Answer answer;
    solver->read(answer);
    d = answer.x;
    z = answer.z;
    first = baseline_.first_input(d);
    return true;
  }

  const versus::Problem* problem() const override { return &baseline_.problem(); }

 private:
  PaperBaseline baseline_;
  versus::Entry entry_;
};

}  // namespace

std::unique_ptr<Contender> make_baseline(const Scene& scene, Index horizon, Factor factor,
                                         const versus::Entry& solver) {
  return std::make_unique<Paper>(scene, horizon, factor, solver);
}

}  // namespace planner_bench
