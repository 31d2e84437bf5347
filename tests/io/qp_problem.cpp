// Programs as files describe them: the empty program, shifts between frames, crossed bounds, and
// sizes that are too large.

#include "clothctl/io/qp_problem.hpp"

#include <string>
#include <utility>

#include "support/catch.hpp"

using clothctl::first_crossed_bound;
using clothctl::Index;
using clothctl::kLargestQpSide;
using clothctl::QpProblem;
using clothctl::QpSequenceFrame;
using clothctl::detail::validate_qp_size;
using Vector = Eigen::VectorXd;

namespace {

/// A frame of three unknowns and two rows, with all bounds 0 and 1.
QpSequenceFrame frame() {
  return {Vector::Zero(3), Vector::Zero(2), Vector::Ones(2), Vector::Zero(3), Vector::Ones(3), {}};
}

QpProblem sized(Index n, Index m, Index shift = 0) {
  QpProblem problem;
  problem.g.setZero(n);
  problem.rl.setZero(m);
  problem.shift = shift;
  return problem;
}

}  // namespace

TEST_CASE("a default program is empty", "[qp_problem]") {
  const QpProblem problem;
  CHECK(problem.n() == 0);
  CHECK(problem.m() == 0);
  CHECK(problem.r == 0);
  CHECK_FALSE(problem.maximise);
  CHECK(problem.shift == 0);
  CHECK(problem.row_shift() == 0);
  CHECK(problem.frames.empty());
  CHECK(problem.reference.status.empty());
  CHECK_FALSE(problem.reference.objective.has_value());
  CHECK_FALSE(problem.reference.unique.has_value());
  for (const Vector* v :
       {&problem.reference.x, &problem.reference.y, &problem.reference.z, &problem.reference.ray,
        &problem.reference.farkas_y, &problem.reference.farkas_z})
    CHECK(v->size() == 0);
  CHECK(first_crossed_bound(problem) == -1);
  const clothctl::QpSolution solution;
  CHECK(solution.n == 0);
  CHECK(solution.m == 0);
  CHECK(solution.frames.empty());
  const clothctl::detail::QpEntry entry;
  CHECK(entry.row == 0);
  CHECK(entry.column == 0);
  CHECK(entry.value == 0);
  CHECK(entry.line == 0);
}

TEST_CASE("unknowns are counted by the gradient, and rows by their lower bounds", "[qp_problem]") {
  CHECK(sized(5, 3).n() == 5);
  CHECK(sized(5, 3).m() == 3);
  CHECK(sized(5, 0).m() == 0);
}

TEST_CASE("rows shift by as many stages as unknowns do", "[qp_problem]") {
  CHECK(sized(12, 8, 3).row_shift() == 2);   // four stages of three unknowns and two rows
  CHECK(sized(12, 24, 3).row_shift() == 6);  // more rows than unknowns
  CHECK(sized(12, 8, 12).row_shift() == 8);  // all of them
  CHECK(sized(12, 8, 0).row_shift() == 0);   // no shift
  CHECK(sized(12, 0, 3).row_shift() == 0);   // no rows
  CHECK(sized(2, 1, 1).row_shift() == 0);    // half a row: rounded down
  CHECK(sized(10, 7, 4).row_shift() == 2);   // 2.8
  CHECK(sized(0, 4, 3).row_shift() == 0);    // no unknowns
  CHECK(sized(kLargestQpSide, kLargestQpSide, kLargestQpSide - 1).row_shift() ==
        kLargestQpSide - 1);
}

TEST_CASE("the first lower bound above its upper bound is found, unknowns before rows",
          "[qp_problem]") {
  CHECK(first_crossed_bound(frame()) == -1);
  for (Index k = 0; k < 5; ++k) {
    QpSequenceFrame crossed = frame();
    (k < 3 ? crossed.lb[k] : crossed.rl[k - 3]) = 1 + 1e-15;
    CHECK(first_crossed_bound(crossed) == k);
    // A later crossed bound changes nothing, an earlier one does.
    crossed.ru[1] = -1;
    CHECK(first_crossed_bound(crossed) == k);
    crossed.ub[0] = -1;
    CHECK(first_crossed_bound(crossed) == 0);
  }
}

TEST_CASE("equal bounds and missing bounds do not cross", "[qp_problem]") {
  const double infinity = clothctl::scalar_traits<double>::infinity();
  QpSequenceFrame open = frame();
  open.lb = open.ub;
  open.rl = open.ru;
  CHECK(first_crossed_bound(open) == -1);
  open.lb.setConstant(-infinity);
  open.rl.setConstant(-infinity);
  CHECK(first_crossed_bound(open) == -1);
  open.ub.setConstant(infinity);
  open.ru.setConstant(infinity);
  CHECK(first_crossed_bound(open) == -1);
  open.ru[0] = -infinity;
  CHECK(first_crossed_bound(open) == -1);  // both -inf
  open.rl[1] = infinity;
  open.ru[1] = 0;
  CHECK(first_crossed_bound(open) == 4);
}

TEST_CASE("frames of a sequence are checked one by one, separately from the base", "[qp_problem]") {
  QpProblem problem;
  static_cast<QpSequenceFrame&>(problem) = frame();
  problem.frames = {frame(), frame()};
  problem.frames[1].ub[2] = -1;
  CHECK(first_crossed_bound(problem) == -1);
  CHECK(first_crossed_bound(problem.frames[0]) == -1);
  CHECK(first_crossed_bound(problem.frames[1]) == 2);
}

TEST_CASE("sizes are limited by the sides and by the sum of the entries of H and A",
          "[qp_problem]") {
  using Size = std::pair<Index, Index>;
  for (const auto& [n, m] : {Size(0, 0), Size(1, 0), Size(1, kLargestQpSide), Size(8192, 0),
                             Size(5792, 5792), Size(2927, 20000)})
    CHECK(validate_qp_size(n, m).empty());
  CHECK(validate_qp_size(8192, 1) ==
        "8192 unknowns and 1 rows are too many: at most 20000 of each and 67108864 entries in H "
        "and A");
  for (const auto& [n, m] :
       {Size(8193, 0), Size(5793, 5793), Size(2928, 20000), Size(20000, 0), Size(20001, 0),
        Size(1, 20001), Size(0, 20001), Size(Index(1) << 40, 0), Size(1, Index(1) << 40)}) {
    const std::string wrong = validate_qp_size(n, m);
    INFO(wrong);
    CHECK(wrong.rfind(
              std::to_string(n) + " unknowns and " + std::to_string(m) + " rows are too many: ",
              0) == 0);
  }
  // A product of sides must not wrap to a small number.
  CHECK_FALSE(validate_qp_size(Index(1) << 32, Index(1) << 32).empty());
}
