// The contact solver: known solutions (inclines, collisions, springs, a grip), Coulomb's law on
// random problems by a check of its own, memory of where contacts stuck, and what is refused.

#include "clothctl/contact/contact_solver.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "clothctl/contact/impulse_responses.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/pinch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::DenseSide;
using clothctl_test::make_pinch_problem;
using clothctl_test::Numbers;
using clothctl_test::Pinch;
using clothctl_test::PinchSettings;

namespace {

template <class S>
using Contacts = std::vector<ContactSample<S>>;

/// Returns the velocity of a contact's place.
template <class S>
Vector3<S> place_velocity(const ContactPlace<S>& place, const std::vector<VectorX<S>>& u) {
  Vector3<S> v = Vector3<S>::Zero();
  if (place.side < 0) return v;
  for (std::size_t k = 0; k < 3 && place.point[k] >= 0; ++k)
    v += place.weight[static_cast<Index>(k)] *
         u[static_cast<std::size_t>(place.side)].template segment<3>(3 * place.point[k]);
  return v;
}

/// How far contacts are from Coulomb's law, from their impulses and the velocities u of the sides
/// after those impulses. `before` are the contacts as they were given to the solver.
template <class S>
struct Violation {
  S cone = S(0), dual = S(0), work = S(0);
};
template <class S>
Violation<S> coulomb_violation(const Contacts<S>& before, const Contacts<S>& after, S h,
                               const std::vector<VectorX<S>>& u) {
  Violation<S> worst;
  for (std::size_t i = 0; i < after.size(); ++i) {
    const ContactSample<S>& c = before[i];
    const Vector3<S> n = c.normal.normalized(), p = after[i].impulse;
    const Vector3<S> v = place_velocity(c.a, u) - place_velocity(c.b, u) - c.drift;
    const S p_n = p.dot(n), soft = h + c.compliance * c.damping;
    const S soft_t = h + c.tangential_compliance * c.damping;
    const Vector3<S> p_t = p - p_n * n, s = c.offset - c.offset.dot(n) * n;
    const S v_n = v.dot(n) + c.compliance * p_n / (h * soft) + c.gap / soft;
    const Vector3<S> v_t =
        v - v.dot(n) * n + c.tangential_compliance / (h * soft_t) * p_t + s / soft_t;
    const S lifted = v_n + c.friction * v_t.norm();
    worst.cone = std::max(worst.cone, p_t.norm() - c.friction * p_n);
    worst.cone = std::max(worst.cone, -p_n);
    worst.dual = std::max(worst.dual, c.friction * v_t.norm() - lifted);
    worst.work = std::max(worst.work, std::abs(lifted * p_n + v_t.dot(p_t)));
  }
  return worst;
}

/// Applies the impulses of a pinch and returns the violation.
template <class S>
Violation<S> pinch_violation(const Pinch<S>& before, Pinch<S>& after) {
  ContactSolver<S> solver;
  solver.reserve(static_cast<Index>(after.contacts.size()), 64);
  CHECK(solver.apply(after.contacts, after.sheet, after.lower, after.upper) ==
        ContactStatus::Solved);
  return coulomb_violation<S>(before.contacts, after.contacts, before.dt,
                              {after.sheet.u, after.lower.u, after.upper.u});
}

template <class S>
ContactReport<S> solve(Pinch<S>& pinch) {
  ContactSolver<S> solver;
  solver.reserve(static_cast<Index>(pinch.contacts.size()), 64);
  return solver.solve(pinch.contacts, pinch.dt, pinch.sheet, pinch.lower, pinch.upper);
}

/// A cube of 1 kg, 10 cm wide, on an incline through the origin, on four soft corners.
class Block {
 public:
  Block(double angle, double friction, double compliance) : angle_(angle) {
    const Matrix3<double> inertia = 1.0 / 600 * Matrix3<double>::Identity();
    RigidMotion<double> start;
    start.position[2] = 0.05 - compliance * 9.81 * std::cos(angle) / 4;
    body_ = RigidBodyResponse<double>::create(1, inertia, start).value();
    solver_.reserve(4, 4);
    contacts_.resize(4);
    for (int i = 0; i < 4; ++i) {
      ContactSample<double>& c = contacts_[static_cast<std::size_t>(i)];
      c.a.side = 0;
      c.a.point[0] = i;
      c.friction = friction;
      c.compliance = c.tangential_compliance = compliance;
    }
  }
  /// A step of 0.01 s. The incline is level; gravity is turned instead.
  ContactReport<double> step(bool remember = true) {
    const double h = 0.01;
    RigidMotion<double> m = body_.motion();
    m.velocity += h * 9.81 * Vector3<double>(std::sin(angle_), 0, -std::cos(angle_));
    m.angular_velocity += 600 * h * torque;
    REQUIRE(body_.set_motion(m).empty());
    Points<double> x(3, 4);
    for (int i = 0; i < 4; ++i) {
      const Vector3<double> arm(i % 2 == 0 ? -0.05 : 0.05, i < 2 ? -0.05 : 0.05, -0.05);
      x.col(i) = m.position + m.R_world_body * arm;
      contacts_[static_cast<std::size_t>(i)].gap = x(2, i);
      if (!remember) contacts_[static_cast<std::size_t>(i)].offset.setZero();
    }
    REQUIRE(body_.set_points(x) == QueryStatus::Answered);
    const ContactReport<double> report = solver_.solve(contacts_, h, body_);
    REQUIRE(solver_.apply(contacts_, body_) == ContactStatus::Solved);
    m = body_.motion();
    m.position += h * m.velocity;
    m.R_world_body = rotation_exp<double>(Vector3<double>(h * m.angular_velocity)) * m.R_world_body;
    REQUIRE(body_.set_motion(m).empty());
    return report;
  }
  const RigidMotion<double>& motion() const { return body_.motion(); }
  Contacts<double>& contacts() { return contacts_; }
  Vector3<double> torque = Vector3<double>::Zero();  // on the block, N m

 private:
  double angle_;
  RigidBodyResponse<double> body_ =
      RigidBodyResponse<double>::create(1, Matrix3<double>::Identity()).value();
  ContactSolver<double> solver_;
  Contacts<double> contacts_;
};

}  // namespace

TEST_CASE("a block on an incline slips exactly above the angle of friction", "[contact]") {
  const double mu = 0.4;
  for (const double compliance : {1e-5, 1e-4}) {
    CAPTURE(compliance);
    Block stuck(std::atan(0.999 * mu), mu, compliance);
    // While the springs take up the load it slides, and is slowed by a thousandth of μ g only.
    for (int k = 0; k < 1000; ++k) REQUIRE(stuck.step().status == ContactStatus::Solved);
    const double way = stuck.motion().position[0];
    ContactReport<double> last;
    for (int k = 0; k < 100; ++k) last = stuck.step();
    CHECK(last.stick == 4);
    CHECK(std::abs(stuck.motion().position[0] - way) < 1e-9);  // no creep
    const double angle = std::atan(1.001 * mu);
    Block sliding(angle, mu, compliance);
    for (int k = 0; k < 100; ++k) REQUIRE(sliding.step().status == ContactStatus::Solved);
    const double speed = sliding.motion().velocity[0];
    for (int k = 0; k < 100; ++k) last = sliding.step();
    CHECK(last.slip == 4);
    const double gain = sliding.motion().velocity[0] - speed;
    CHECK(gain == Approx(9.81 * (std::sin(angle) - mu * std::cos(angle))).epsilon(1e-6));
  }
}

TEST_CASE("without its memory a soft contact creeps", "[contact]") {
  Block block(std::atan(0.2), 0.4, 1e-4);
  for (int k = 0; k < 100; ++k) REQUIRE(block.step(false).status == ContactStatus::Solved);
  const double way = block.motion().position[0];
  for (int k = 0; k < 100; ++k) REQUIRE(block.step(false).stick == 4);
  // Each step the springs yield by what carries the load: 100 · 9.81 sin θ c / 4.
  CHECK(block.motion().position[0] - way ==
        Approx(100 * 9.81 * std::sin(std::atan(0.2)) * 1e-4 / 4).epsilon(1e-3));
}

TEST_CASE("a slipping contact carries exactly what friction allows", "[contact]") {
  Block block(std::atan(0.5), 0.4, 1e-4);
  for (int k = 0; k < 100; ++k) REQUIRE(block.step().status == ContactStatus::Solved);
  for (const ContactSample<double>& c : block.contacts()) {
    REQUIRE(c.state == ContactState::Slip);
    const double force = c.impulse[2] / 0.01;
    CHECK(c.offset.norm() == Approx(0.4 * force * 1e-4).epsilon(1e-9));
    CHECK(c.offset[2] == 0.0);
  }
}

TEST_CASE("samples on a ring resist torsion and rolling up to the limits of the ring",
          "[contact]") {
  const double mu = 0.4, torsion = mu * 9.81 * 0.05 * std::sqrt(2.0), rolling = 9.81 * 0.05;
  for (const double share : {0.99, 1.01}) {
    CAPTURE(share);
    Block turned(0, mu, 1e-5);
    turned.torque[2] = share * torsion;
    for (int k = 0; k < 100; ++k) REQUIRE(turned.step().status == ContactStatus::Solved);
    const double before = turned.motion().angular_velocity[2];
    for (int k = 0; k < 20; ++k) REQUIRE(turned.step().status == ContactStatus::Solved);
    const double gain = turned.motion().angular_velocity[2] - before;
    CHECK(gain == Approx(share < 1 ? 0 : 0.2 * 600 * 0.01 * torsion).epsilon(1e-3).margin(1e-9));
  }
  for (const double share : {0.97, 1.03}) {
    CAPTURE(share);
    Block rolled(0, mu, 1e-5);
    rolled.torque[0] = share * rolling;
    for (int k = 0; k < 20; ++k) REQUIRE(rolled.step().status == ContactStatus::Solved);
    const double tilt = rolled.motion().R_world_body(2, 1);
    CHECK((share < 1 ? tilt < 0.002 : tilt > 0.02));
  }
}

TEMPLATE_TEST_CASE("a particle on a rigid incline obeys Coulomb's law", "[contact]", float,
                   double) {
  using S = TestType;
  const S mu = S(0.5), h = S(0.01);
  for (const double share : {0.9, 0.99, 1.01, 1.5}) {
    const S angle = std::atan(mu * S(share));
    Points<S> v(3, 1);
    v.col(0) = h * S(9.81) * Vector3<S>(std::sin(angle), S(0), -std::cos(angle));
    ParticleResponse<S> particle;
    const VectorX<S> inverse = VectorX<S>::Constant(1, S(4));
    const std::array<int, 1> only{0};
    REQUIRE(particle.gather(only, inverse, v) == QueryStatus::Answered);
    Contacts<S> contacts(1);
    contacts[0].a.side = 0;
    contacts[0].a.point[0] = 0;
    contacts[0].friction = mu;
    ContactSolver<S> solver;
    solver.reserve(1, 1);
    REQUIRE(solver.solve(contacts, h, particle).status == ContactStatus::Solved);
    REQUIRE(solver.apply(contacts, particle) == ContactStatus::Solved);
    REQUIRE(particle.scatter(only, v) == QueryStatus::Answered);
    const S expected = share < 1 ? S(0) : h * S(9.81) * (std::sin(angle) - mu * std::cos(angle));
    const S tolerance = S(4) * scalar_traits<S>::epsilon();
    CHECK(std::abs(v(0, 0) - expected) <= tolerance);
    CHECK(std::abs(v(2, 0)) <= tolerance);
    CHECK((contacts[0].state == ContactState::Stick) == (share < 1));
  }
}

TEST_CASE("a belt carries a particle along", "[contact]") {
  Points<double> v = Points<double>::Zero(3, 1);
  Contacts<double> contacts(1);
  contacts[0].a.side = 0;
  contacts[0].a.point[0] = 0;
  contacts[0].friction = 0.3;
  contacts[0].drift = {0.5, 0, 0};
  ContactSolver<double> solver;
  solver.reserve(1, 1);
  ParticleResponse<double> particle(1);
  const VectorX<double> inverse = VectorX<double>::Constant(1, 2.0);
  const std::array<int, 1> only{0};
  for (int k = 0; k < 40; ++k) {
    v(2, 0) -= 0.0981;
    REQUIRE(particle.gather(only, inverse, v) == QueryStatus::Answered);
    REQUIRE(solver.solve(contacts, 0.01, particle).status == ContactStatus::Solved);
    REQUIRE(solver.apply(contacts, particle) == ContactStatus::Solved);
    REQUIRE(particle.scatter(only, v) == QueryStatus::Answered);
    CHECK(v(0, 0) == Approx(std::min(0.5, (k + 1) * 0.3 * 0.0981)).epsilon(1e-9));
  }
}

TEST_CASE("two bodies that collide keep their momentum, and friction adds no energy", "[contact]") {
  Numbers random(21);
  ContactSolver<double> solver;
  solver.reserve(4, 4);
  double drift = 0, turn = 0, gain = -1;
  int solved = 0, slipped = 0;
  const int runs = clothctl_test::trials(200, 2000, 40);
  for (int k = 0; k < runs; ++k) {
    const auto vector = [&](double size) {
      return Vector3<double>(random(-size, size), random(-size, size), random(-size, size));
    };
    const auto body = [&](double up) {
      Matrix3<double> G;
      for (Index i = 0; i < 3; ++i) G.col(i) = vector(0.05);
      const Matrix3<double> spread = G * G.transpose() + 1e-4 * Matrix3<double>::Identity();
      RigidMotion<double> m;
      m.R_world_body = rotation_exp<double>(vector(2));
      m.position = vector(0.02) + Vector3<double>(0, 0, up);
      m.velocity = vector(1) - Vector3<double>(0, 0, 20 * up);
      m.angular_velocity = vector(3);
      const Matrix3<double> inertia = spread.trace() * Matrix3<double>::Identity() - spread;
      return RigidBodyResponse<double>::create(random(0.1, 10), inertia, m).value();
    };
    RigidBodyResponse<double> a = body(0.05), b = body(-0.05);
    const int c = 1 + random.below(4);
    Points<double> x(3, c);
    Contacts<double> contacts(static_cast<std::size_t>(c));
    const bool rigid = k % 2 == 0;
    for (int i = 0; i < c; ++i) {
      x.col(i) << random(-0.05, 0.05), random(-0.05, 0.05), 0;
      ContactSample<double>& contact = contacts[static_cast<std::size_t>(i)];
      contact.a = {0, {i, -1, -1}, {1, 0, 0}};
      contact.b = {1, {i, -1, -1}, {1, 0, 0}};
      contact.normal = (0.2 * vector(1) + Vector3<double>(0, 0, 1)).normalized();
      contact.friction = random(0, 1);
      if (!rigid) contact.compliance = contact.tangential_compliance = random(1e-6, 1e-3);
    }
    REQUIRE(a.set_points(x) == QueryStatus::Answered);
    REQUIRE(b.set_points(x) == QueryStatus::Answered);
    const auto state = [&](Vector3<double>& P, Vector3<double>& L) {
      P.setZero();
      L.setZero();
      double E = 0;
      for (const RigidBodyResponse<double>* side : {&a, &b}) {
        const RigidMotion<double>& m = side->motion();
        const Vector3<double> p = side->mass() * m.velocity;
        const Vector3<double> spin =
            m.R_world_body * side->inertia() * m.R_world_body.transpose() * m.angular_velocity;
        P += p;
        L += m.position.cross(p) + spin;
        E += 0.5 * p.dot(m.velocity) + 0.5 * spin.dot(m.angular_velocity);
      }
      return E;
    };
    Vector3<double> P, L, P_after, L_after;
    const double E = state(P, L);
    const ContactReport<double> report = solver.solve(contacts, 0.01, a, b);
    if (report.status == ContactStatus::Solved) ++solved;
    slipped += report.slip;
    REQUIRE(solver.apply(contacts, a, b) == ContactStatus::Solved);
    const double E_after = state(P_after, L_after);
    drift = std::max(drift, (P_after - P).norm());
    turn = std::max(turn, (L_after - L).norm());
    gain = std::max(gain, (E_after - E) / E);
  }
  CHECK(solved == runs);
  CHECK(slipped > runs / 4);
  CHECK(drift < 1e-13);  // momenta are up to about 20 N s
  CHECK(turn < 1e-13);
  CHECK(gain < 1e-9);
}

TEST_CASE("a soft contact is a spring and a damper", "[contact]") {
  // Between bodies that nothing moves: force = overlap / compliance, and c v for the damper.
  KinematicResponse<double> pad(1), table(1);
  RigidMotion<double> m;
  const Points<double> origin = Points<double>::Zero(3, 1);
  REQUIRE(pad.set_points(origin) == QueryStatus::Answered);
  REQUIRE(table.set_points(origin) == QueryStatus::Answered);
  Contacts<double> contacts(1);
  ContactSample<double>& c = contacts[0];
  c.a = {0, {0, -1, -1}, {1, 0, 0}};
  c.b = {1, {0, -1, -1}, {1, 0, 0}};
  c.compliance = c.tangential_compliance = 1 / 2000.0;
  c.friction = 0.5;
  ContactSolver<double> solver;
  solver.reserve(1, 1);
  const double h = 0.02;
  const auto force = [&]() -> Vector3<double> {
    REQUIRE(solver.solve(contacts, h, pad, table).status == ContactStatus::Solved);
    return c.impulse / h;
  };
  c.gap = -0.0025;
  CHECK((force() - Vector3<double>(0, 0, 5)).norm() < 1e-12);
  c.offset = {0.0005, 0, 0.3};  // along the normal it means nothing
  CHECK((force() - Vector3<double>(-1, 0, 5)).norm() < 1e-12);
  CHECK((c.offset - Vector3<double>(0.0005, 0, 0)).norm() < 1e-15);
  c.offset = {0.004, 0, 0};  // 8 N: more than friction carries
  CHECK((force() - Vector3<double>(-2.5, 0, 5)).norm() < 1e-12);
  CHECK((c.offset - Vector3<double>(0.00125, 0, 0)).norm() < 1e-15);
  c.offset.setZero();
  c.damping = 10;
  m.velocity = {0, 0, -0.1};
  REQUIRE(pad.set_motion(m).empty());
  // At the end of the step the overlap is 4.5 mm: 9 N and 1 N.
  CHECK((force() - Vector3<double>(0, 0, 10)).norm() < 1e-12);
  c.gap = 0.001;  // closes during the step
  CHECK((force() - Vector3<double>(0, 0, 3)).norm() < 1e-12);
  c.gap = 0.003;  // does not
  CHECK(force() == Vector3<double>::Zero());
  CHECK(c.state == ContactState::Open);
}

TEMPLATE_TEST_CASE("random pinches obey Coulomb's law", "[contact]", float, double) {
  using S = TestType;
  const bool exact = std::numeric_limits<S>::digits > 30;
  const S slack = exact ? S(1) : S(1e5);
  for (const int count : {4, 8, 30}) {
    for (const double stiffness : {2000.0, 0.0}) {
      if (stiffness == 0 && count == 30) continue;  // rigid: see the next test
      for (const double squeeze : {0.24, 0.03}) {
        CAPTURE(count, stiffness, squeeze);
        int solved = 0;
        Violation<S> worst;
        ContactReport<S> last;
        const int runs = clothctl_test::trials(20, 500, 5);
        for (int k = 0; k < runs; ++k) {
          PinchSettings settings;
          settings.contacts = count;
          settings.stiffness = stiffness;
          settings.squeeze = squeeze;
          const Pinch<S> before = make_pinch_problem<S>(settings, static_cast<unsigned>(k));
          Pinch<S> after = before;
          last = solve(after);
          if (last.status == ContactStatus::Solved) ++solved;
          const Violation<S> v = pinch_violation<S>(before, after);
          worst.cone = std::max(worst.cone, v.cone);
          if (last.status != ContactStatus::Solved) continue;
          if (exact) CHECK(last.force_residual <= 1e-9);
          worst.dual = std::max(worst.dual, v.dual);
          worst.work = std::max(worst.work, v.work);
        }
        // Rigid contacts may have more equations than the sides have freedoms.
        CHECK(solved >= (stiffness > 0 ? runs : runs - runs / 10));
        CHECK(worst.cone <= S(1e-9) * slack);
        CHECK(worst.dual <= S(1e-8) * slack);
        CHECK(worst.work <= S(1e-9) * slack);
      }
    }
  }
}

TEST_CASE("a solve that did not converge says so", "[contact]") {
  int failed = 0;
  for (unsigned k = 0; k < 5; ++k) {
    PinchSettings settings;
    settings.contacts = 30;
    settings.stiffness = 0;  // 90 equations for less than 40 freedoms
    const Pinch<double> before = make_pinch_problem<double>(settings, k);
    Pinch<double> after = before;
    const ContactReport<double> report = solve(after);
    const Violation<double> v = pinch_violation<double>(before, after);
    CHECK(v.cone <= 1e-9);
    for (const ContactSample<double>& c : after.contacts) CHECK(all_finite(c.impulse));
    if (report.status == ContactStatus::Solved) {
      CHECK((v.dual <= 1e-8 && v.work <= 1e-9));
    } else {
      ++failed;
      CHECK(report.status == ContactStatus::NotConverged);
      CHECK((report.force_residual > 1e-9 || report.velocity_residual > 1e-9));
    }
  }
  CHECK(failed > 0);
  // With no steps at all.
  PinchSettings settings;
  Pinch<double> pinch = make_pinch_problem<double>(settings, 1);
  ContactSolverSettings<double> none;
  none.first_sweeps = none.newton_steps = none.rounds = 0;
  ContactSolver<double> solver(none);
  solver.reserve(8, 64);
  const ContactReport<double> report =
      solver.solve(pinch.contacts, pinch.dt, pinch.sheet, pinch.lower, pinch.upper);
  CHECK(report.status == ContactStatus::NotConverged);
  CHECK(report.velocity_residual > 1e-3);
}

TEST_CASE("a block on eight rigid contacts is held", "[contact]") {
  // Of 24 impulses only 6 combinations matter: D is singular.
  const Matrix3<double> inertia = 1.0 / 600 * Matrix3<double>::Identity();
  RigidMotion<double> m;
  m.position[2] = 0.05;
  m.velocity = {0.02, 0, -0.0981};
  RigidBodyResponse<double> body = RigidBodyResponse<double>::create(1, inertia, m).value();
  Points<double> x(3, 8);
  Contacts<double> contacts(8);
  for (int i = 0; i < 8; ++i) {
    x.col(i) << 0.05 * std::cos(0.785398 * i), 0.05 * std::sin(0.785398 * i), 0;
    contacts[static_cast<std::size_t>(i)].a = {0, {i, -1, -1}, {1, 0, 0}};
    contacts[static_cast<std::size_t>(i)].friction = 0.5;
  }
  REQUIRE(body.set_points(x) == QueryStatus::Answered);
  const Contacts<double> before = contacts;
  ContactSolver<double> solver;
  solver.reserve(8, 8);
  const ContactReport<double> report = solver.solve(contacts, 0.01, body);
  CHECK(report.status == ContactStatus::Solved);
  REQUIRE(solver.apply(contacts, body) == ContactStatus::Solved);
  CHECK(body.motion().velocity.norm() < 1e-9);
  CHECK(body.motion().angular_velocity.norm() < 1e-7);
  VectorX<double> u(24);
  body.velocities(u);
  const Violation<double> v = coulomb_violation<double>(before, contacts, 0.01, {u});
  CHECK((v.cone < 1e-12 && v.dual < 1e-8 && v.work < 1e-9));
}

TEST_CASE("the force of a grip is that of a dense solution", "[contact]") {
  // With much friction all contacts stick, and the impulses solve a linear system.
  PinchSettings settings;
  settings.contacts = 8;
  settings.friction = 20;
  settings.motion = 0.01;
  Pinch<double> pinch = make_pinch_problem<double>(settings, 3);
  for (ContactSample<double>& c : pinch.contacts) c.gap = 0;
  const Pinch<double> before = pinch;
  const ContactReport<double> report = solve(pinch);
  REQUIRE(report.status == ContactStatus::Solved);
  REQUIRE(report.stick == 8);
  // World axes: λ = -(B W Bᵀ + C)⁻¹ (B u + s).
  Eigen::MatrixXd D = Eigen::MatrixXd::Zero(24, 24);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(24);
  const DenseSide<double>* sides[] = {&before.sheet, &before.lower, &before.upper};
  for (int s = 0; s < 3; ++s) {
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(24, sides[s]->u.size());
    for (Index i = 0; i < 8; ++i) {
      for (const double sign : {1.0, -1.0}) {
        const ContactSample<double>& c = before.contacts[static_cast<std::size_t>(i)];
        const ContactPlace<double>& place = sign > 0 ? c.a : c.b;
        if (place.side != s) continue;
        for (std::size_t k = 0; k < 3 && place.point[k] >= 0; ++k)
          B.block<3, 3>(3 * i, 3 * place.point[k]) +=
              sign * place.weight[static_cast<Index>(k)] * Matrix3<double>::Identity();
      }
    }
    D += B * sides[s]->W * B.transpose();
    b += B * sides[s]->u;
  }
  const double h = before.dt;
  for (Index i = 0; i < 8; ++i) {
    const ContactSample<double>& c = before.contacts[static_cast<std::size_t>(i)];
    const double soft = h + c.compliance * c.damping;
    D.block<3, 3>(3 * i, 3 * i) += c.compliance / (h * soft) * Matrix3<double>::Identity();
    b.segment<3>(3 * i) += (c.offset - c.offset.dot(c.normal) * c.normal) / soft;
  }
  const Eigen::VectorXd lambda = D.ldlt().solve(-b);
  double grip = 0, dense = 0;
  for (Index i = 0; i < 8; ++i) {
    const ContactSample<double>& c = pinch.contacts[static_cast<std::size_t>(i)];
    CHECK((c.impulse - lambda.segment<3>(3 * i)).norm() < 1e-10);
    if (i >= 4) continue;
    grip += c.impulse[2] / h;
    dense += lambda[3 * i + 2] / h;
  }
  CHECK(grip == Approx(dense).epsilon(1e-9));
  CHECK(grip > 1.0);
}

TEST_CASE("the solver starts from the last impulses", "[contact]") {
  for (unsigned k = 0; k < 10; ++k) {
    PinchSettings settings;
    settings.contacts = 14;
    const Pinch<double> start = make_pinch_problem<double>(settings, k);
    Pinch<double> cold = start;
    REQUIRE(solve(cold).status == ContactStatus::Solved);
    Pinch<double> warm = start;
    for (std::size_t i = 0; i < 14; ++i) warm.contacts[i].impulse = cold.contacts[i].impulse;
    ContactReport<double> report = solve(warm);
    CHECK(report.status == ContactStatus::Solved);
    CHECK(report.newton_steps <= 2);
    // The samples may be listed in another order: the impulses moved with them.
    Pinch<double> turned = start;
    for (std::size_t i = 0; i < 14; ++i) {
      turned.contacts[i] = start.contacts[13 - i];
      turned.contacts[i].impulse = cold.contacts[13 - i].impulse;
    }
    report = solve(turned);
    CHECK(report.newton_steps <= 2);
    // One step later nearly the same.
    Pinch<double> next = start;
    next.sheet.u *= 1.01;
    for (std::size_t i = 0; i < 14; ++i) next.contacts[i].impulse = cold.contacts[i].impulse;
    CHECK(solve(next).newton_steps <= 4);
  }
}

TEST_CASE("a side may touch itself", "[contact]") {
  // Two particles of one side, one above the other.
  Points<double> v(3, 2);
  v << 0.1, 0, 0, 0, -1, 0.5;
  ParticleResponse<double> particles;
  const VectorX<double> inverse = (VectorX<double>(2) << 1.0, 3.0).finished();
  const std::array<int, 2> both{0, 1};
  REQUIRE(particles.gather(both, inverse, v) == QueryStatus::Answered);
  Contacts<double> contacts(1);
  contacts[0].a = {0, {0, -1, -1}, {1, 0, 0}};
  contacts[0].b = {0, {1, -1, -1}, {1, 0, 0}};
  contacts[0].friction = 1;
  ContactSolver<double> solver;
  solver.reserve(1, 2);
  REQUIRE(solver.solve(contacts, 0.01, particles).status == ContactStatus::Solved);
  REQUIRE(solver.apply(contacts, particles) == ContactStatus::Solved);
  REQUIRE(particles.scatter(both, v) == QueryStatus::Answered);
  CHECK((v.col(0) - v.col(1)).norm() < 1e-14);
  CHECK(v(2, 0) == Approx((-3 + 0.5) / 4));
}

TEST_CASE("bad input is refused and changes nothing", "[contact]") {
  PinchSettings settings;
  settings.contacts = 4;
  const Pinch<double> good = make_pinch_problem<double>(settings, 1);
  ContactSolver<double> solver;
  solver.reserve(4, 9);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [&](Pinch<double> pinch, double dt, ContactStatus status, Index contact) {
    pinch.contacts[0].impulse[2] = 0.25;
    const Pinch<double> kept = pinch;
    const ContactReport<double> report =
        solver.solve(pinch.contacts, dt, pinch.sheet, pinch.lower, pinch.upper);
    CHECK(report.status == status);
    CHECK(report.contact == contact);
    bool same = pinch.sheet.u.size() == kept.sheet.u.size();
    for (std::size_t i = 0; i < pinch.contacts.size(); ++i)
      same = same && std::memcmp(&pinch.contacts[i].impulse, &kept.contacts[i].impulse,
                                 sizeof kept.contacts[i].impulse) == 0;
    CHECK(same);
  };
  const auto spoil = [&](auto change, ContactStatus status, Index contact) {
    Pinch<double> pinch = good;
    change(pinch);
    refused(pinch, 0.02, status, contact);
  };
  using P = Pinch<double>;
  const ContactStatus invalid = ContactStatus::InvalidInput, size = ContactStatus::WrongSize;
  spoil([&](P& p) { p.contacts[2].gap = nan; }, invalid, 2);
  spoil([&](P& p) { p.contacts[1].normal = {0, nan, 1}; }, invalid, 1);
  spoil([&](P& p) { p.contacts[1].normal = {0, 0, 2}; }, invalid, 1);
  spoil([&](P& p) { p.contacts[3].friction = -0.1; }, invalid, 3);
  spoil([&](P& p) { p.contacts[3].friction = std::numeric_limits<double>::infinity(); }, invalid,
        3);
  spoil([&](P& p) { p.contacts[3].compliance = nan; }, invalid, 3);
  spoil([&](P& p) { p.contacts[3].impulse[0] = nan; }, invalid, 3);
  spoil([&](P& p) { p.contacts[3].offset[0] = nan; }, invalid, 3);
  spoil([&](P& p) { p.contacts[3].drift[0] = nan; }, invalid, 3);
  spoil([&](P& p) { p.contacts[2].a.weight[0] = nan; }, invalid, 2);
  spoil([&](P& p) { p.sheet.u[0] = nan; }, invalid, -1);
  spoil([&](P& p) { p.lower.W(0, 0) = nan; }, invalid, -1);
  spoil([&](P& p) { p.contacts[2].a.side = 3; }, size, 2);
  spoil([&](P& p) { p.contacts[2].b.side = -2; }, size, 2);
  spoil([&](P& p) { p.contacts[2].a.point[1] = 9; }, size, 2);
  spoil([&](P& p) { p.contacts[2].a.point[1] = -1; }, size, 2);  // a gap in the list
  spoil([&](P& p) { p.contacts.resize(5, p.contacts[0]); }, size, -1);
  refused(good, nan, invalid, -1);
  refused(good, 0, invalid, -1);
  spoil(
      [&](P& p) {
        p.contacts[1].a.side = p.contacts[1].b.side = -1;
        p.contacts[1].compliance = 0;
      },
      ContactStatus::Immovable, 1);
  P pinch = good;
  pinch.contacts[0].impulse[0] = nan;
  const VectorX<double> u = pinch.sheet.u;
  CHECK(solver.apply(pinch.contacts, pinch.sheet, pinch.lower, pinch.upper) == invalid);
  CHECK(pinch.sheet.u == u);
  ContactSolverSettings<double> bad;
  bad.force_tolerance = nan;
  CHECK(bad.validate().find("force tolerance") != std::string::npos);
  bad = {};
  bad.rounds = -1;
  CHECK_FALSE(bad.validate().empty());
  ContactSolver<double> unset(bad);
  unset.reserve(4, 9);
  pinch = good;
  CHECK(unset.solve(pinch.contacts, 0.02, pinch.sheet, pinch.lower, pinch.upper).status == invalid);
  Contacts<double> none;
  CHECK(solver.solve(none, 0.02, pinch.sheet).status == ContactStatus::Solved);
}

TEST_CASE("solves repeat their bits and do not allocate", "[contact]") {
  PinchSettings settings;
  settings.contacts = 30;
  Pinch<double> first = make_pinch_problem<double>(settings, 7), again = first;
  ContactSolver<double> solver;
  solver.reserve(30, 15);
  const long before = clothctl_test::allocations();
  const ContactReport<double> one =
      solver.solve(first.contacts, first.dt, first.sheet, first.lower, first.upper);
  const ContactReport<double> two =
      solver.solve(again.contacts, again.dt, again.sheet, again.lower, again.upper);
  const ContactStatus applied = solver.apply(first.contacts, first.sheet, first.lower, first.upper);
  const long made = clothctl_test::allocations() - before;
  CHECK(applied == ContactStatus::Solved);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(one.newton_steps == two.newton_steps);
  CHECK(one.force_residual == two.force_residual);
  for (std::size_t i = 0; i < 30; ++i) {
    CHECK(first.contacts[i].impulse == again.contacts[i].impulse);
    CHECK(first.contacts[i].offset == again.contacts[i].offset);
  }
}

TEST_CASE("the statuses of a contact solve have names", "[contact]") {
  CHECK(to_string(ContactStatus::Solved) == "solved");
  CHECK(to_string(ContactStatus::NotConverged) == "not_converged");
  CHECK(to_string(ContactStatus::InvalidInput) == "invalid_input");
  CHECK(to_string(ContactStatus::WrongSize) == "wrong_size");
  CHECK(to_string(ContactStatus::Immovable) == "immovable");
}

TEST_CASE("a damped contact that slipped and stops pulls back along the spring", "[contact]") {
  // A kinematic body slides at 1 m/s on a pad of 2000 N/m and 10 N s/m, μ 0.5, 5 N, and stops.
  for (const double h : {0.02, 0.001}) {
    std::vector<ContactSample<double>> contacts(1);
    ContactSample<double>& c = contacts[0];
    c.a.side = 0;
    c.a.point = {0, -1, -1};
    c.friction = 0.5;
    c.compliance = c.tangential_compliance = 1.0 / 2000;
    c.damping = 10;
    c.gap = -0.0025;
    KinematicResponse<double> body(1);
    REQUIRE(body.set_points(Points<double>::Zero(3, 1)) == QueryStatus::Answered);
    ContactSolver<double> solver;
    solver.reserve(1, 1);
    RigidMotion<double> motion;
    for (const double speed : {1.0, 0.0}) {
      motion.velocity = Vector3<double>(speed, 0, 0);
      REQUIRE(body.set_motion(motion).empty());
      for (double t = 0; t < 0.2; t += h)
        REQUIRE(solver.solve(contacts, h, body).status == ContactStatus::Solved);
      CAPTURE(h, speed);
      // At the limit of friction, 2.5 N, and after the stop as the spring is left.
      CHECK(std::abs(c.offset[0] - 0.00125) < 1e-9);
      CHECK(std::abs(c.impulse[0] / h + 2.5) < 1e-6);
    }
  }
}
