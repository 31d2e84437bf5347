// Holds the caller's problem: refuses bad data by name and index, copies H symmetric, and keeps its
// data when it refuses.

#include "clothctl/qp/detail/problem_data.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
struct Problem {
  MatrixX<S> H = MatrixX<S>::Identity(3, 3), A = MatrixX<S>::Constant(2, 3, S(1));
  VectorX<S> g = VectorX<S>::Constant(3, S(0.5)), lb = VectorX<S>::Constant(3, S(-1)),
             ub = VectorX<S>::Constant(3, S(1)), rl = VectorX<S>::Constant(2, S(-2)),
             ru = VectorX<S>::Constant(2, S(2));
  detail::ProblemData<S> data;
  QpResult<S> result;

  Problem() {
    data.reserve(4, 3);
    REQUIRE(data.validate_hessian(H) == QpStatus::Solved);
    CHECK(data.take(H));
    REQUIRE(data.validate_rows(A) == QpStatus::Solved);
    CHECK(data.take_rows(A));
  }
  bool load(const char* fault = "") { return data.load(fault, g, lb, ub, rl, ru, result); }
  std::string refused() const {
    return std::string(result.message) + " " + std::to_string(result.invalid_index);
  }
};

}  // namespace

TEMPLATE_TEST_CASE("a good problem is stored, with open bounds replaced", "[qp]", float, double) {
  using S = TestType;
  Problem<S> p;
  p.ub[1] = std::numeric_limits<S>::infinity();
  p.rl[0] = S(-1e30);
  REQUIRE(p.load());
  CHECK(p.data.n() == 3);
  CHECK(p.data.m() == 2);
  CHECK(MatrixX<S>(p.data.H()) == p.H);
  CHECK(MatrixX<S>(p.data.A()) == p.A);
  CHECK(p.data.g().head(3) == p.g);
  CHECK(p.data.lo().head(3) == p.lb);
  CHECK(p.data.hi()[0] == S(1));
  CHECK_FALSE(detail::has_bound(p.data.hi()[1]));
  CHECK_FALSE(detail::has_bound(p.data.rl()[0]));
  CHECK(p.data.ru().head(2) == p.ru);
  CHECK(p.result.x.size() == 3);
  CHECK(p.result.row_multipliers.size() == 2);
}

TEMPLATE_TEST_CASE("asymmetry within rounding is averaged", "[qp]", float, double) {
  using S = TestType;
  Problem<S> p;
  p.H(0, 1) = S(0.25);
  p.H(1, 0) = S(0.25) + S(2) * scalar_traits<S>::epsilon() * S(0.25);
  REQUIRE(p.data.validate_hessian(p.H) == QpStatus::Solved);
  CHECK_FALSE(p.data.take(p.H));
  CHECK(p.data.H()(0, 1) == p.data.H()(1, 0));
  CHECK(p.data.m() == 2);  // the rows stay
}

TEMPLATE_TEST_CASE("a refusal names its reason and leaves the stored data unchanged", "[qp]", float,
                   double) {
  using S = TestType;
  const S nan = std::numeric_limits<S>::quiet_NaN();
  Problem<S> p;
  REQUIRE(p.load());
  const auto same = [&] {
    const Problem<S> fresh;
    return MatrixX<S>(p.data.H()) == fresh.H && MatrixX<S>(p.data.A()) == fresh.A &&
           p.data.g().head(3) == fresh.g && p.data.lo().head(3) == fresh.lb &&
           p.data.hi().head(3) == fresh.ub && p.data.rl().head(2) == fresh.rl &&
           p.data.ru().head(2) == fresh.ru;
  };
  MatrixX<S> bad = p.H;
  bad(2, 1) = nan;
  CHECK(p.data.validate_hessian(bad) == QpStatus::InvalidData);
  CHECK(p.data.refusal().index == 5);
  CHECK(p.data.validate_hessian(-p.H) == QpStatus::NonConvex);
  detail::ProblemData<S> empty;
  empty.reserve(3, 3);
  CHECK(empty.validate_rows(MatrixX<S>::Zero(2, 2)) == QpStatus::InvalidData);
  CHECK(std::string(empty.refusal().message) == "no Hessian was set");
  CHECK(p.data.validate_rows(MatrixX<S>::Zero(2, 2)) == QpStatus::InvalidData);
  CHECK(std::string(p.data.refusal().message) == "rows differ in length from the Hessian");
  MatrixX<S> row = p.A;
  row(1, 2) = nan;
  CHECK(p.data.validate_rows(row) == QpStatus::InvalidData);
  CHECK(p.data.refusal().index == 5);
  CHECK(same());

  const auto refusal = [&](auto&& spoil, const char* fault = "") {
    Problem<S> q;
    spoil(q);
    p.g = q.g;
    p.lb = q.lb;
    p.ub = q.ub;
    p.rl = q.rl;
    p.ru = q.ru;
    CHECK_FALSE(p.load(fault));
    CHECK(p.result.status == QpStatus::InvalidData);
    CHECK(same());
    return p.refused();
  };
  CHECK(refusal([](Problem<S>&) {}, "a bad setting") == "a bad setting -1");
  CHECK(refusal([&](Problem<S>& q) { q.g[2] = nan; }) == "gradient entry is not finite 2");
  CHECK(refusal([&](Problem<S>& q) { q.g.resize(2); }) ==
        "gradient differs in size from the Hessian -1");
  CHECK(refusal([&](Problem<S>& q) { q.ub.resize(4); }) ==
        "upper bounds differ in size from the Hessian -1");
  CHECK(refusal([&](Problem<S>& q) { q.ru.resize(1); }) ==
        "upper row bounds differ in size from the rows -1");
  CHECK(refusal([&](Problem<S>& q) { q.lb[1] = S(2); }) == "lower bound is above the upper one 1");
  CHECK(refusal([&](Problem<S>& q) { q.rl[1] = nan; }) == "lower row bound is NaN 1");
}

TEST_CASE("without a Hessian nothing loads; a new size drops the rows; new rows keep the Hessian",
          "[qp]") {
  detail::ProblemData<double> data;
  data.reserve(2, 1);
  QpResult<double> result;
  const VectorX<double> none;
  CHECK_FALSE(data.load("", none, none, none, none, none, result));
  CHECK(std::string(result.message) == "no Hessian was set");
  MatrixX<double> spoilt = MatrixX<double>::Identity(2, 2);
  spoilt(1, 1) = -1.0;
  REQUIRE(data.validate_hessian(spoilt) == QpStatus::NonConvex);
  CHECK_FALSE(data.load("", none, none, none, none, none, result));
  CHECK(result.status == QpStatus::NonConvex);  // the reason why there is no Hessian
  CHECK(std::string(result.message) == "Hessian has a negative diagonal entry");
  CHECK(result.invalid_index == 3);
  data.reserve(2, 1);
  CHECK_FALSE(data.load("", none, none, none, none, none, result));
  CHECK(std::string(result.message) == "no Hessian was set");
  Problem<double> p;
  p.data.reserve_rows(7);
  CHECK(p.data.m() == 0);
  CHECK(p.data.capacity_m() == 7);
  CHECK(MatrixX<double>(p.data.H()) == p.H);
  REQUIRE(p.data.validate_rows(p.A) == QpStatus::Solved);
  CHECK(p.data.take_rows(p.A));
  const MatrixX<double> small = MatrixX<double>::Identity(2, 2);
  REQUIRE(p.data.validate_hessian(small) == QpStatus::Solved);
  CHECK(p.data.take(small));
  CHECK(p.data.m() == 0);
  p.data.reserve(5, 5);
  CHECK(p.data.n() == 0);
}

TEST_CASE("loading resets the result of the last solve", "[qp]") {
  Problem<double> p;
  p.result.iterations = 9;
  p.result.stationarity = p.result.feasibility = p.result.complementarity = p.result.objective =
      4.0;
  p.result.message = "old";
  p.result.invalid_index = 2;
  REQUIRE(p.load());
  CHECK(p.result.iterations == 0);
  CHECK((p.result.stationarity == 0.0 && p.result.feasibility == 0.0 &&
         p.result.complementarity == 0.0));
  CHECK(p.result.objective == 0.0);
  CHECK(p.refused() == " -1");
}

TEST_CASE("storing data within the reserved size does not allocate", "[qp]") {
  if (!clothctl_test::allocation_counting_works()) return;
  Problem<double> p;
  REQUIRE(p.load());
  const long before = clothctl_test::allocations();
  bool good = p.data.validate_hessian(p.H) == QpStatus::Solved;
  good = !p.data.take(p.H) && p.data.validate_rows(p.A) == QpStatus::Solved &&
         !p.data.take_rows(p.A) && p.load() && good;
  const long made = clothctl_test::allocations() - before;
  CHECK(good);
  CHECK(made == 0);
}

TEST_CASE("a load reports whether it repeats the last one", "[qp]") {
  Problem<double> p;
  REQUIRE(p.load());
  CHECK_FALSE(p.data.repeated());
  REQUIRE(p.load());
  CHECK(p.data.repeated());
  for (VectorX<double>* v : {&p.g, &p.lb, &p.ub, &p.rl, &p.ru}) {
    (*v)[1] += 0.25;
    REQUIRE(p.load());
    CHECK_FALSE(p.data.repeated());
    REQUIRE(p.load());
    CHECK(p.data.repeated());
  }
  p.g[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(p.load());
  p.g[0] = 0.5;
  REQUIRE(p.load());
  CHECK(p.data.repeated());
  p.data.take(p.H);
  REQUIRE(p.load());
  CHECK_FALSE(p.data.repeated());
  p.data.take_rows(p.A);
  REQUIRE(p.load());
  CHECK_FALSE(p.data.repeated());
}
