#include "clothctl/grasp/grasp_types.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("settings of a grasp name the first bad value", "[grasp]") {
  const auto message = [](auto change) {
    GraspSettings<double> s;
    change(s);
    return s.validate();
  };
  CHECK(message([](auto&) {}) == "");
  const double inf = std::numeric_limits<double>::infinity();
  CHECK(message([](auto& s) { s.closing_speed = 0; }) ==
        "closing_speed is 0, must be finite and positive");
  CHECK(message([&](auto& s) { s.stiffness = inf; }) ==
        "stiffness is inf, must be finite and positive");
  CHECK(message([](auto& s) { s.turn_speed = -1; }) ==
        "turn_speed is -1, must be finite and positive");
  CHECK(message([](auto& s) { s.margin = -1; }) == "margin is -1, must be finite and not negative");
  CHECK(message([](auto& s) { s.firm_contacts = 0; }) == "firm_contacts is 0, must be at least 1");
  CHECK(message([](auto& s) { s.firm_steps = 0; }) == "firm_steps is 0, must be at least 1");
  CHECK(message([](auto& s) { s.approach_speed = 11; }) ==
        "approach_speed is 11, must be at most that of the fingertips, 10");
  CHECK(message([](auto& s) { s.fingertips.max_iterations = 0; }) ==
        "max_iterations is 0, must be at least 1");
}

TEST_CASE("phases and faults have names, and only failures have words", "[grasp]") {
  CHECK(to_string(GraspPhase::Approach) == "approach");
  CHECK(to_string(GraspFault::NotFirm) == "not_firm");
  GraspReport<double> report;
  report.fault = GraspFault::Lost;
  CHECK(describe_fault(report, "finger 1 (index)") == "");
  report.phase = GraspPhase::Failed;
  CHECK(describe_fault(report, "finger 1 (index)") == "finger 1 (index) lost the sheet");
  report.fault = GraspFault::NotFirm;
  report.mean_force = 0.5;
  report.wanted_force = 3;
  CHECK(describe_fault(report, "the hand") ==
        "the hand was not firm and at rest for long enough, at 0.5 N of 3 N");
  report.finger = 1;
  report.finger_force = 0.25;
  report.finger_contacts = 2;
  CHECK(describe_fault(report, "finger 1 (index)") ==
        "finger 1 (index) did not hold firmly in time: 0.25 N of 3 N, 2 contacts stick");
  report.slides = true;  // another finger
  CHECK(describe_fault(report, "finger 1 (index)").ends_with("2 contacts stick"));
  report.finger_slides = true;
  CHECK(describe_fault(report, "finger 1 (index)") ==
        "finger 1 (index) did not hold firmly in time: 0.25 N of 3 N, 2 contacts stick, and it "
        "slides");
}
