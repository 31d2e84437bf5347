#include "clothctl/sim/pad_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_impulses.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;

namespace {

using Vec = Vector3<double>;

/// Four samples on a radius of 5 mm, with the outward normal y.
std::vector<PadSample<double>> four_samples() {
  std::vector<PadSample<double>> out;
  for (const double a : {0.25, 0.75, 1.25, 1.75}) {
    const double angle = a * std::acos(-1.0);
    out.push_back({0.005 * Vec(std::cos(angle), 0, std::sin(angle)), Vec(0, 1, 0)});
  }
  return out;
}

/// A flat sheet in y = 0, and its contact finder.
struct Sheet {
  GridMesh<double> grid;
  SpringNetwork<double> network;
  SheetContactFinder<double> finder;

  explicit Sheet(int n)
      : grid(make_grid<double>(n, n, 0.5, 0.5).value()),
        network(sheet_network(grid, Material<double>{}).value()),
        finder(
            SheetContactFinder<double>::create(network.rest_positions, network.triangles).value()) {
  }
};

/// The place of a sample's contact on the sheet, m.
Vec place_of(const ContactSample<double>& c, const Points<double>& x) {
  Vec out = Vec::Zero();
  for (std::size_t k = 0; k < 3; ++k)
    out += c.a.weight[static_cast<Index>(k)] * x.col(c.a.point[k]);
  return out;
}

/// The place at rest of the sheet's point that a line through `at` along y meets; `at` is at most
/// 2 cm away.
Vec material_point(Sheet& sheet, const Vec& at, const Points<double>& x) {
  PadSettings<double> settings;
  settings.reach = 0.02;
  auto probe = PadContacts<double>::create({{at, Vec(0, 1, 0)}}, sheet.network.triangles,
                                           sheet.finder, 0, 1, settings)
                   .value();
  sheet.finder.update(x);
  const bool found =
      probe.update({}, sheet.finder) == QueryStatus::Answered && probe.contacts().size() == 1;
  return found ? place_of(probe.contacts()[0], sheet.network.rest_positions)
               : Vec::Constant(std::nan(""));
}

/// Two pads that pinch a corner of a hanging sheet, 15 mm from its sides.
struct Pinch {
  int n = 17;
  double force = 3.3, friction = 0.6, dt = 0.02;
  double amplitude = 0, twist = 0;  // of 2 Hz along x, m; about y, rad/s
  Integration integration = Integration::LinearlyImplicit;

  struct Outcome {
    double slip = 0;       // of the material point between the pads, from where it was at 0.3 s, m
    double slid = 0;       // the longest way of the sheet under a sample, m
    double stretched = 0;  // largest of the pulp's spring, m
    double fall = 0;       // of the sheet's corner beside the pads, m
    double ratio = 0;      // of tangential to normal impulses, least of the last 10 steps
    bool solved = true;
  };

  Outcome run(double seconds) const {
    Outcome outcome;
    Sheet sheet(n);
    MassSpringSettings<double> settings;
    settings.integration = integration;
    settings.limit_energy = false;
    settings.drag = 0.5;
    const auto model = MassSpring<double>::create(sheet.network, settings).value();
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    const int corner = sheet.grid.vertex(n - 1, 0);
    const Vec inside = state.positions.col(corner) + Vec(0.015, 0, -0.015);
    PadSettings<double> pulp;
    pulp.friction = friction;
    std::vector<PadContacts<double>> pads;
    std::vector<KinematicResponse<double>> bodies(2, KinematicResponse<double>(4));
    for (int k = 0; k < 2; ++k)
      pads.push_back(PadContacts<double>::create(four_samples(), sheet.network.triangles,
                                                 sheet.finder, 0, 1 + k, pulp)
                         .value());
    auto response = MassSpringImpulses<double>::create(model, 24).value();
    ContactSolver<double> solver;
    solver.reserve(8, 24);
    std::vector<int> touched;
    touched.reserve(24);
    std::vector<ContactSample<double>> contacts(8);
    Vec first = Vec::Zero();
    const double omega = 4 * std::acos(-1.0), overlap = force / pulp.stiffness;
    const int steps = static_cast<int>(std::lround(seconds / dt));
    for (int step = 0; step < steps; ++step) {
      const double t = step * dt;
      touched.clear();
      for (std::size_t k = 0; k < 2; ++k) {
        const double side = k == 0 ? 1 : -1;
        RigidMotion<double> motion;
        motion.R_world_body = rotation_exp<double>(Vec(0, twist * t, 0));
        if (side < 0) motion.R_world_body *= rotation_exp<double>(Vec(0, 0, std::acos(-1.0)));
        const double x = amplitude * (1 - std::cos(omega * t));
        motion.position = inside + Vec(x, side * overlap, 0);
        motion.velocity[0] = (amplitude * (1 - std::cos(omega * (t + dt))) - x) / dt;
        motion.angular_velocity = Vec(0, twist, 0);
        sheet.finder.update(state.positions);
        if (pads[k].update(motion, sheet.finder) != QueryStatus::Answered) outcome.solved = false;
        outcome.solved = outcome.solved && bodies[k].set_motion(motion).empty() &&
                         bodies[k].set_points(pads[k].places()) == QueryStatus::Answered;
        pads[k].add_touched(touched);
      }
      const Vec between = material_point(
          sheet, inside + Vec(bodies[0].motion().position[0] - inside[0], 0, 0), state.positions);
      if (t < 0.3) first = between;
      outcome.slip = std::max(outcome.slip, (between - first).norm());
      if (!model.step(state, {}, dt, ws).advanced ||
          response.attach(touched, state, ws) != StepStatus::Converged) {
        outcome.solved = false;
        return outcome;
      }
      std::size_t count = 0;
      for (PadContacts<double>& pad : pads) {
        pad.number([&](int v) { return response.point(v); });
        for (const ContactSample<double>& c : pad.contacts()) contacts[count++] = c;
      }
      const std::span<ContactSample<double>> all(contacts.data(), count);
      const auto report = solver.solve(all, dt, response, bodies[0], bodies[1]);
      outcome.solved = outcome.solved && report.status == ContactStatus::Solved;
      if (solver.apply(all, response, bodies[0], bodies[1]) != ContactStatus::Solved)
        outcome.solved = false;
      count = 0;
      double tangential = 0, normal = 0;
      for (PadContacts<double>& pad : pads) {
        for (ContactSample<double>& c : pad.contacts()) {
          c = contacts[count++];
          outcome.stretched = std::max(outcome.stretched, c.offset.norm());
          const double lift = c.impulse.dot(c.normal);
          normal += lift;
          tangential += (c.impulse - lift * c.normal).norm();
        }
        pad.keep();
        for (std::size_t i = 0; i < 4; ++i) outcome.slid = std::max(outcome.slid, pad.slid(i));
      }
      const double ratio = tangential / std::max(normal, 1e-30);
      if (step == steps - 10) outcome.ratio = ratio;
      if (step > steps - 10) outcome.ratio = std::min(outcome.ratio, ratio);
    }
    outcome.fall = sheet.network.rest_positions(2, corner) - state.positions(2, corner);
    return outcome;
  }
};

}  // namespace

TEST_CASE("a pad finds the points of the sheet in front of its samples", "[sim]") {
  Sheet sheet(5);
  auto pad =
      PadContacts<double>::create(four_samples(), sheet.network.triangles, sheet.finder, 0, 1)
          .value();
  const Points<double>& x = sheet.network.rest_positions;
  RigidMotion<double> motion;
  for (const double gap : {-0.0019, 0.0, 0.0019}) {
    motion.position = Vec(x.row(0).mean() + 0.03, -gap, x.row(2).mean() + 0.02);
    REQUIRE(pad.update(motion, sheet.finder) == QueryStatus::Answered);
    REQUIRE(pad.contacts().size() == 4);
    for (std::size_t i = 0; i < 4; ++i) {
      const ContactSample<double>& c = pad.contacts()[i];
      CHECK(std::abs(c.gap - gap) < 1e-15);
      const Vec below = place_of(c, x) - motion.position - four_samples()[i].position;
      CHECK((below - Vec(0, gap, 0)).norm() < 1e-15);
      CHECK(std::abs(c.a.weight.sum() - 1) < 1e-15);
      CHECK(c.compliance == 4 / 2000.0);
      CHECK(pad.touches(i));
    }
    std::vector<int> touched{pad.contacts()[0].a.point[0]};
    pad.add_touched(touched);
    std::vector<int> once = touched;
    std::sort(once.begin(), once.end());
    CHECK(std::adjacent_find(once.begin(), once.end()) == once.end());
    for (const ContactSample<double>& c : pad.contacts()) {
      for (const int v : c.a.point) CHECK(std::count(touched.begin(), touched.end(), v) == 1);
    }
  }
}

TEST_CASE("a closed sample keeps its point until the sheet is away", "[sim]") {
  Sheet sheet(5);
  PadSettings<double> settings;
  settings.reach = 0.005;
  settings.release = 0.002;
  auto pad = PadContacts<double>::create(four_samples(), sheet.network.triangles, sheet.finder, 0,
                                         1, settings)
                 .value();
  const Points<double>& x = sheet.network.rest_positions;
  RigidMotion<double> motion;
  const auto at = [&](double dx, double gap) {
    motion.position = Vec(x.row(0).mean() + 0.03 + dx, -gap, x.row(2).mean() + 0.02);
    REQUIRE(pad.update(motion, sheet.finder) == QueryStatus::Answered);
    return pad.contacts().size();
  };
  const auto end_step = [&](ContactState state, const Vec& offset) {
    for (ContactSample<double>& c : pad.contacts()) {
      c.state = state;
      c.offset = offset;
    }
    pad.keep();
  };
  CHECK(at(0, 0.006) == 0);
  CHECK(at(0, 0.004) == 4);
  REQUIRE(at(0, 0.001) == 4);
  const Vec first = place_of(pad.contacts()[0], x);
  end_step(ContactState::Stick, Vec(0.002, 0, 0));
  CHECK(at(0.003, 0.001) == 4);  // moved along: the same material point, the offset from places
  CHECK((place_of(pad.contacts()[0], x) - first).norm() < 1e-15);
  CHECK((pad.contacts()[0].offset - Vec(-0.003, 0, 0)).norm() < 1e-15);
  CHECK((Vec(pad.places().col(0)) - first).norm() < 1e-15);
  CHECK(pad.slid(0) == 0);
  end_step(ContactState::Slip, Vec(-0.001, 0, 0));
  CHECK(at(0.003, 0.001) == 4);  // slid: the point that the offset names
  CHECK((place_of(pad.contacts()[0], x) - first - Vec(0.002, 0, 0)).norm() < 1e-15);
  CHECK(std::abs(pad.slid(0) - 0.002) < 1e-15);
  end_step(ContactState::Stick, Vec(-0.001, 0, 0));
  CHECK(at(0.003, 0.0025) == 4);  // lifted: a new point in front of the sample
  CHECK((place_of(pad.contacts()[0], x) - first - Vec(0.003, 0, 0)).norm() < 1e-15);
  CHECK(pad.contacts()[0].offset == Vec::Zero());
  CHECK(pad.slid(0) == 0);
  end_step(ContactState::Open, Vec::Zero());
  CHECK(at(1.0, 0.0) == 0);  // beside the sheet
}

TEST_CASE("two soft pads hold a corner of a sheet that is shaken and turned", "[sim]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    for (const double dt : {0.02, 0.01}) {
      if (clothctl_test::kSanitized && dt == 0.01) continue;
      Pinch pinch;
      pinch.integration = integration;
      pinch.dt = dt;
      pinch.amplitude = 0.08;
      const Pinch::Outcome shaken = pinch.run(2.0);
      CHECK(shaken.solved);
      CAPTURE(shaken.slid, dt);
      CHECK(shaken.slip < 1e-3);
      CHECK(shaken.stretched > 1e-5);
      CHECK(shaken.ratio < pinch.friction);
      CHECK(shaken.fall < 2e-3);
    }
  }
  Pinch turned;
  turned.twist = 0.5;
  const Pinch::Outcome held = turned.run(2.0);
  CHECK(held.solved);
  CHECK(held.slip < 1e-3);
}

TEST_CASE("a held sheet does not creep", "[sim]") {
  if (clothctl_test::kSanitized) return;  // long, and the code of the test before
  Pinch pinch;
  const Pinch::Outcome early = pinch.run(10.0), late = pinch.run(30.0);
  CAPTURE(early.slid, early.slip);
  CHECK(late.slip < 1e-3);
  CHECK(late.slid - early.slid < 1e-6);
  CHECK(late.solved);
}

TEST_CASE("a sheet slides out between pads that press too little", "[sim]") {
  Pinch pinch;
  pinch.force = 0.15;  // the weight needs 0.41 N
  pinch.dt = 0.002;
  const Pinch::Outcome lost = pinch.run(0.05);
  CHECK(lost.solved);
  CHECK(lost.fall > 0.002);
  CHECK(std::abs(lost.ratio / pinch.friction - 1.0) < 0.01);
}

TEST_CASE("a pad refuses bad data and names the item", "[sim]") {
  Sheet sheet(3);
  const auto error = [&](auto spoil) {
    std::vector<PadSample<double>> samples = four_samples();
    PadSettings<double> settings;
    int side = 0;
    spoil(samples, settings, side);
    const auto made = PadContacts<double>::create(samples, sheet.network.triangles, sheet.finder,
                                                  side, 1, settings);
    return made ? std::string("accepted") : made.error();
  };
  using Samples = std::vector<PadSample<double>>;
  using Set = PadSettings<double>;
  CHECK(error([](Samples&, Set&, int&) {}) == "accepted");
  CHECK(error([](Samples& s, Set&, int&) { s.clear(); }) == "the pad has no samples");
  CHECK(error([](Samples& s, Set&, int&) { s[2].position[0] = std::nan(""); }) ==
        "the pad has in sample 2 the position with the coordinate 0 = nan, must be finite");
  CHECK(error([](Samples& s, Set&, int&) { s[3].normal[2] = std::nan(""); }) ==
        "the pad has in sample 3 the normal with the coordinate 2 = nan, must be finite");
  CHECK(error([](Samples& s, Set&, int&) { s[1].normal *= 2; }) ==
        "the pad has in sample 1 a normal of length 2, must be 1");
  CHECK(error([](Samples&, Set& s, int&) { s.stiffness = 0; }) ==
        "the pad has the stiffness 0, must be finite and positive");
  CHECK(error([](Samples&, Set& s, int&) { s.stiffness = 1e300; }) ==
        "the pad has the stiffness 1e+300, must be finite and positive, at most 1e20");
  CHECK(error([](Samples&, Set& s, int&) { s.friction = -0.5; }) ==
        "the pad has the friction coefficient -0.5, must be finite and not negative");
  CHECK(error([](Samples&, Set& s, int&) { s.release = std::nan(""); }) ==
        "the pad has the release nan, must be finite and not negative");
  CHECK(error([](Samples&, Set& s, int&) { s.release = 1; }) == "accepted");
  CHECK(error([](Samples&, Set&, int& side) { side = -1; }) ==
        "the pad has a side with a negative number");
  const auto triangles_error = [&](auto spoil) {
    std::vector<std::array<int, 3>> triangles = sheet.network.triangles;
    spoil(triangles);
    return PadContacts<double>::create(four_samples(), triangles, sheet.finder, 0, 1).error();
  };
  CHECK(triangles_error([](auto& t) { t.pop_back(); }) ==
        "the pad gets 7 triangles, its finder has 8");
  CHECK(triangles_error([](auto& t) { t[3][1] = -1; }) ==
        "triangle 3 holds vertex -1 off the sheet of the finder");
  CHECK(triangles_error([](auto& t) { t[0][0] = 9; }) ==
        "triangle 0 holds vertex 9 off the sheet of the finder");
  auto pad =
      PadContacts<double>::create(four_samples(), sheet.network.triangles, sheet.finder, 0, 1)
          .value();
  RigidMotion<double> motion;
  Sheet other(4);
  CHECK(pad.update(motion, other.finder) == QueryStatus::InvalidArgument);
  motion.position[1] = std::nan("");
  CHECK(pad.update(motion, sheet.finder) == QueryStatus::InvalidArgument);
  motion.position[1] = 0;
  motion.R_world_body.setZero();
  CHECK(pad.update(motion, sheet.finder) == QueryStatus::InvalidArgument);
}

TEST_CASE("a pad and a sheet that turn together do not load the springs across", "[sim]") {
  // Both kinematic: the sheet's points have no mobility, and the pad overlaps by 1.65 mm.
  for (const double h : {0.02, 0.002}) {
    Sheet sheet(5);
    const Points<double> flat = sheet.network.rest_positions;
    auto pad =
        PadContacts<double>::create(four_samples(), sheet.network.triangles, sheet.finder, 0, 1)
            .value();
    ParticleResponse<double> particles(25);
    KinematicResponse<double> body(4);
    ContactSolver<double> solver;
    solver.reserve(4, 25);
    std::vector<int> all(25);
    for (int v = 0; v < 25; ++v) all[static_cast<std::size_t>(v)] = v;
    const Vec axis(0.6, 0, 0.8), middle = flat.rowwise().mean();
    const Eigen::VectorXd held = Eigen::VectorXd::Zero(25);
    for (double t = 0; t < 1; t += h) {
      const Matrix3<double> R = rotation_exp<double>(Vec(1.5 * t * axis));
      const Points<double> x = (R * (flat.colwise() - middle)).colwise() + middle;
      RigidMotion<double> motion;
      motion.R_world_body = R;
      motion.position = middle + R * Vec(0.03, 0.00165, 0.02);
      motion.angular_velocity = 1.5 * axis;
      const Vec arm = motion.position - middle;
      motion.velocity = motion.angular_velocity.cross(arm);
      Points<double> v(3, 25);
      for (Index i = 0; i < 25; ++i) {
        const Vec from = x.col(i) - middle;
        v.col(i) = motion.angular_velocity.cross(from);
      }
      REQUIRE(sheet.finder.update(x) == QueryStatus::Answered);
      REQUIRE(pad.update(motion, sheet.finder) == QueryStatus::Answered);
      REQUIRE(pad.contacts().size() == 4);
      REQUIRE(body.set_motion(motion).empty());
      REQUIRE(body.set_points(pad.places()) == QueryStatus::Answered);
      REQUIRE(particles.gather(all, held, v) == QueryStatus::Answered);
      REQUIRE(solver.solve(pad.contacts(), h, particles, body).status == ContactStatus::Solved);
      for (const ContactSample<double>& c : pad.contacts()) {
        const double lift = c.impulse.dot(c.normal);
        CHECK(std::abs(lift / h - 0.825) < 1e-9);  // a quarter of 2000 N/m · 1.65 mm
        CHECK((c.impulse - lift * c.normal).norm() < 1e-9 * lift);
        CHECK(c.state == ContactState::Stick);
      }
      pad.keep();
    }
    for (std::size_t i = 0; i < 4; ++i) CHECK(pad.slid(i) == 0);
  }
}

TEST_CASE("a pad touches the layer that it meets first", "[sim]") {
  // Two layers: the triangles of two grids, 1 mm apart.
  const auto grid = make_grid<double>(3, 3, 0.1, 0.1).value();
  const std::vector<std::array<int, 3>> one =
      sheet_network(grid, Material<double>{}).value().triangles;
  Points<double> x(3, 18);
  x << grid.positions, grid.positions;
  x.row(1).tail(9).array() += 1e-3;
  std::vector<std::array<int, 3>> triangles = one;
  for (const std::array<int, 3>& t : one) triangles.push_back({t[0] + 9, t[1] + 9, t[2] + 9});
  auto finder = SheetContactFinder<double>::create(x, triangles).value();
  auto pad = PadContacts<double>::create(four_samples(), triangles, finder, 0, 1).value();
  RigidMotion<double> motion;
  motion.position = Vec(x.row(0).mean() + 0.013, 1.6e-3, x.row(2).mean() + 0.011);
  REQUIRE(pad.update(motion, finder) == QueryStatus::Answered);
  REQUIRE(pad.contacts().size() == 4);
  for (ContactSample<double>& c : pad.contacts()) {
    CHECK(std::abs(c.gap + 1.6e-3) < 1e-15);
    c.state = ContactState::Slip;
    c.offset = Vec(1e-4, 0, 0);
  }
  pad.keep();
  REQUIRE(pad.update(motion, finder) == QueryStatus::Answered);  // slides within the same layer
  REQUIRE(pad.contacts().size() == 4);
  for (const ContactSample<double>& c : pad.contacts()) CHECK(std::abs(c.gap + 1.6e-3) < 1e-15);
}

TEST_CASE("finding the contacts of a pad does not allocate", "[sim]") {
  Sheet sheet(9);
  auto pad =
      PadContacts<double>::create(four_samples(), sheet.network.triangles, sheet.finder, 0, 1)
          .value();
  const Points<double>& x = sheet.network.rest_positions;
  RigidMotion<double> motion;
  std::vector<int> touched;
  touched.reserve(12);
  const long before = allocations();
  for (const double gap : {0.01, 0.001, 0.01, -0.001}) {
    motion.position = Vec(x.row(0).mean(), -gap, x.row(2).mean());
    if (pad.update(motion, sheet.finder) != QueryStatus::Answered) break;
    touched.clear();
    pad.add_touched(touched);
    pad.keep();
  }
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == before);
  CHECK(touched.size() >= 3);
}
