// How the planner compares what it predicted with what it measures.

#include "clothctl/mpc/detail/agreement.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Two features at the vertices 0 and 2 of three.
struct Compared {
  PointFeatures<double> features;
  detail::PredictionAgreement<double> agreement;
  PlanResult<double> result;
  Points<double> x = Points<double>::Random(3, 3);

  Compared() {
    features.add_point(0);
    features.add_point(2);
    agreement.reserve(2);
  }
  void measure(bool has_prediction) { agreement.measure(features, x, has_prediction, result); }

  // Predicts that the features will be where they are, moved by `offset`; later frames elsewhere.
  void predict(const Vector3<double>& offset) {
    MatrixX<double> predicted = MatrixX<double>::Constant(6, 4, 1e3);
    predicted.col(0).head<3>() = x.col(0) + offset;
    predicted.col(0).tail<3>() = x.col(2) + offset;
    agreement.predict(predicted);
  }
  void move(const Vector3<double>& offset) { x.colwise() += offset; }
};

}  // namespace

TEST_CASE("a plant that does what was predicted agrees in full", "[mpc]") {
  Compared c;
  c.measure(false);
  CHECK(c.result.prediction_error == 0.0);
  CHECK(c.result.agreement == 1.0);
  CHECK(c.agreement.measured().col(1) == c.x.col(2));
  const Vector3<double> step(0.03, 0.0, 0.04);
  c.predict(step);
  c.move(step);
  c.measure(true);
  CHECK(c.result.prediction_error <= 1e-15);
  CHECK(c.result.agreement >= 1.0 - 1e-12);
}

TEST_CASE("agreement is what the error leaves of the features' motion", "[mpc]") {
  Compared c;
  c.measure(false);
  c.predict({0.03, 0.0, 0.0});
  c.move({0.04, 0.0, 0.0});
  c.measure(true);
  CHECK(c.result.prediction_error == Approx(0.01));
  CHECK(c.result.agreement == Approx(0.75));
  c.predict({0.03, 0.0, 0.0});
  c.move({-0.01, 0.0, 0.0});  // the other way: four times its own motion wrong
  c.measure(true);
  CHECK(c.result.prediction_error == Approx(0.04));
  CHECK(c.result.agreement == 0.0);
}

TEST_CASE("a sheet that hardly moves is measured against a millimetre", "[mpc]") {
  Compared c;
  c.measure(false);
  c.predict({0.0, 0.0, 0.0});
  c.move({0.0, 2e-4, 0.0});
  c.measure(true);
  CHECK(c.result.agreement == Approx(0.8));
}

TEST_CASE("without a prediction nothing is compared, and measuring does not allocate", "[mpc]") {
  Compared c;
  c.measure(false);
  c.predict({9.0, 0.0, 0.0});
  c.measure(false);
  CHECK(c.result.prediction_error == 0.0);
  CHECK(c.result.agreement == 1.0);
  const MatrixX<double> predicted = MatrixX<double>::Zero(6, 4);
  const long before = clothctl_test::allocations();
  c.agreement.predict(predicted);
  c.measure(true);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(c.result.prediction_error > 0.1);
}
