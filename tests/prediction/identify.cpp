// Identification from recorded motion: planted parameters come back, position-based cloth is found
// to have less tension than its elongation tells, and bad input is refused.

#include "clothctl/prediction/identify.hpp"

#include <array>
#include <cmath>
#include <limits>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/cloth/settle.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;

namespace {

using Precise = LinearisedPredictor<MassSpringResponse<double>, double>;

/// A sheet of the springs of `sheet`, with all stiffness and dampers times `factor`.
MassSpring<double> planted(const HangingSheet& sheet, double factor, double drag) {
  SpringNetwork<double> network = sheet.network;
  for (Spring<double>& s : network.springs) {
    s.stiffness *= factor;
    s.damping *= factor;
  }
  MassSpringSettings<double> settings;
  settings.drag = drag;
  settings.limit_energy = false;
  return MassSpring<double>::create(network, settings).value();
}

template <class Model>
MotionRecord<double> recorded(Model model, const HangingSheet& sheet, Index frames) {
  ModelPlant<Model> plant(std::move(model));
  plant.set_state(sheet.state);
  ExcitationSettings<double> settings;
  settings.frames = frames;
  return record_motion<ModelPlant<Model>, double>(
             plant, {{sheet.upper_left()}, {sheet.upper_right()}}, settings)
      .value();
}

PointFeatures<double> lower_corners(const HangingSheet& sheet) {
  PointFeatures<double> features;
  features.add_point(sheet.lower_left());
  features.add_point(sheet.lower_right());
  return features;
}

FitSettings<double> short_fit(Index horizon) {
  FitSettings<double> settings;
  settings.horizon = horizon;
  settings.skipped = 2;
  return settings;
}

}  // namespace

TEST_CASE("planted stiffness and drag come back from the motion of the corners", "[prediction]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 40);
  const MotionRecord<double> record = recorded(planted(sheet, 0.6, 0.8), sheet, 40);
  const auto make = [&](const VectorX<double>& theta) {
    return Precise(MassSpringResponse<double>(planted(sheet, std::exp(theta[0]), theta[1])));
  };
  FitSettings<double> settings = short_fit(1);  // windows of a frame are predicted exactly
  settings.prior = 0;
  settings.difference = 1e-4;
  settings.rounds = 20;
  const PredictorFit<double> fit =
      fit_predictor<double>(make, {{0, -2, 1}, {0.1, 0, 3}}, record, lower_corners(sheet), settings)
          .value();
  CHECK(std::exp(fit.parameters[0]) == Approx(0.6).epsilon(1e-3));
  CHECK(fit.parameters[1] == Approx(0.8).epsilon(1e-2));
  CHECK(fit.error < 1e-3 * fit.first_error);
  Precise exact = make(VectorX<double>::Map(std::array{std::log(0.6), 0.8}.data(), 2));
  CHECK(window_error(exact, record, lower_corners(sheet), settings).value() < 1e-9);
}

TEST_CASE("what the record does not tell stays at its start", "[prediction]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 40);
  const MotionRecord<double> record = recorded(planted(sheet, 1, 0.2), sheet, 20);
  const auto make = [&](const VectorX<double>&) {
    return Precise(MassSpringResponse<double>(planted(sheet, 0.7, 0.2)));
  };
  const PredictorFit<double> fit =
      fit_predictor<double>(make, {{0.3, -1, 1}}, record, lower_corners(sheet), short_fit(3))
          .value();
  CHECK(fit.parameters[0] == 0.3);
  CHECK(fit.error == fit.first_error);
}

TEST_CASE("position-based cloth has less tension than its elongation tells", "[prediction]") {
  HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const auto model = [&](double drag) {
    PositionBasedSettings<double> settings;
    settings.drag = drag;
    return PositionBased<double>::create(sheet.network, settings).value();
  };
  ModelPlant<PositionBased<double>> plant(model(4));
  plant.set_state(sheet.state);
  REQUIRE(settle(plant, {sheet.upper_left(), sheet.upper_right()}, 0.02, 1.0).advanced);
  sheet.state = {plant.positions(), plant.velocities()};
  const MotionRecord<double> record = recorded(model(0.2), sheet, 60);
  const MassSpring<double> springs = planted(sheet, 1, 0.2);
  const auto find = [&] {
    return identify_response<double>(springs, record, lower_corners(sheet), short_fit(15)).value();
  };
  const IdentifiedResponse<double> found = find();
  CHECK(found.response.scale.geometric < 0.5f);
  CHECK(0.5 < found.predictor.measured_force);
  CHECK(found.error < 0.7 * found.nominal_error);
  CHECK(found.predictor.validate() == "");
  const IdentifiedResponse<double> again = find();
  CHECK(found.error == again.error);
  CHECK(found.response.scale.geometric == again.response.scale.geometric);
}

TEST_CASE("bad records, features and settings are refused", "[prediction]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 10);
  const MassSpring<double> model = planted(sheet, 1, 0.2);
  const MotionRecord<double> good = recorded(model, sheet, 20);
  const auto message = [&](const MotionRecord<double>& record,
                           const PointFeatures<double>& features,
                           const FitSettings<double>& settings) {
    const auto result = identify_response<double>(model, record, features, settings);
    return result ? std::string() : result.error();
  };
  const auto of = [&](const MotionRecord<double>& r) {
    return message(r, lower_corners(sheet), short_fit(3));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(of(good) == "");
  MotionRecord<double> bad = good;
  bad.positions[3](1, 2) = nan;
  CHECK(of(bad) == "frame 3 of the record is not finite");
  bad = good;
  bad.velocities.pop_back();
  CHECK(of(bad) == "the record has 21 positions and 20 velocities");
  bad = good;
  bad.held = {99};
  CHECK(of(bad) == "the record holds vertex 99, off a mesh of 25 vertices");
  bad = good;
  bad.dt = nan;
  CHECK(of(bad).find("the frame of the record is") == 0);
  CHECK(of({}) == "the frame of the record is 0, must be positive");
  bad = good;
  for (Points<double>& x : bad.positions) x = good.positions[0];
  CHECK(of(bad) == "the features do not move in the record");
  for (Points<double>& x : bad.positions) x = Points<double>::Zero(3, 4);
  CHECK(of(bad) == "the record has 4 vertices, the model 25");
  CHECK(message(good, {}, short_fit(3)) == "there are no features");
  CHECK(message(good, lower_corners(sheet), short_fit(20)) ==
        "the record has 20 frames, must have more than 22");
  FitSettings<double> settings = short_fit(3);
  settings.prior = nan;
  CHECK(message(good, lower_corners(sheet), settings).find("prior is") == 0);
  const auto make = [&](const VectorX<double>&) {
    return Precise(MassSpringResponse<double>(model));
  };
  const auto start = [&](const FitParameter<double>& p) {
    return fit_predictor<double>(make, {p}, good, lower_corners(sheet), short_fit(3)).has_value();
  };
  CHECK(start({0, -1, 1}));
  CHECK(!start({2, -1, 1}));
  CHECK(!start({nan, -1, 1}));
  CHECK(!start({0, 0, 0.01}));
}
