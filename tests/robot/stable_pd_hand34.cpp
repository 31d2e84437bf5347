// Stable PD on the 34-DoF hand: tracking, energy, torque limits, and the limit of stability.

#include <cmath>

#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// The hand, its controller, and a symplectic simulator that only receives torques.
struct HandLoop {
  using Traits = articulated_traits<KinematicTree<double>>;
  KinematicTree<double> tree = hand34<double>();
  Index n = tree.nv();
  StablePdSettings<double> settings;
  StablePd<KinematicTree<double>> controller;
  KinematicTreeWorkspace<double> work{tree};
  VectorX<double> q = hand34_home(tree), qd = VectorX<double>::Zero(n), target = q,
                  target_velocity = qd, torques = qd, qdd = qd;
  int saturated = 0;

  explicit HandLoop(double step, double kp = 800, double kd = 100, PdForm form = PdForm::Stable)
      : settings(chosen(n, step, kp, kd, form)),
        controller(StablePd<KinematicTree<double>>::create(tree, settings).value()) {}

  static StablePdSettings<double> chosen(Index n, double step, double kp, double kd, PdForm form) {
    StablePdSettings<double> settings = StablePdSettings<double>::uniform(n, kp, kd);
    settings.dt = step;
    settings.form = form;
    return settings;
  }
  void step() {
    const PdReport report = controller.solve(tree, q, qd, target, target_velocity,
                                             VectorX<double>(), work, torques, qdd);
    REQUIRE(report.status == PdStatus::Solved);
    saturated += report.saturated;
    REQUIRE(Traits::forward_dynamics(tree, qd, torques, VectorX<double>::Zero(n), work, qdd) < 0);
    qd += settings.dt * qdd;
    tree.advance(q, settings.dt * qd, q);
  }
  double largest() const { return std::max(q.cwiseAbs().maxCoeff(), qd.cwiseAbs().maxCoeff()); }
  double energy() {
    MassMatrixWorkspace<double> memory(tree);
    MatrixX<double> M(n, n);
    forward_kinematics<double>(tree, q, work.body_poses);
    mass_matrix<double>(tree, work.body_poses, memory, M);
    return 0.5 * qd.dot(M * qd) + 0.5 * (target - q).dot(settings.kp.cwiseProduct(target - q));
  }
  Vector3<double> place_of(const char* link, const VectorX<double>& at) {
    forward_kinematics<double>(tree, at, work.body_poses);
    return link_pose(tree, work.body_poses, tree.find_link(link)).p;
  }
};

}  // namespace

TEST_CASE("at 50 to 1000 Hz and 0.3 m/s no fingertip of the hand lags by a millimetre", "[robot]") {
  for (const double rate : {50.0, 100.0, 250.0, 1000.0}) {
    CAPTURE(rate);
    HandLoop hand(1.0 / rate);
    const VectorX<double> home = hand.q;
    const double h = hand.settings.dt, speed = 0.3, start = 0.5;
    double worst = 0;
    for (int k = 1; k * h <= 2.5; ++k) {
      // From rest to 0.3 m/s along x in half a second, while the fingers open and close once a
      // second.
      const double t = k * h, ramp = std::min(t / start, 1.0), fade = ramp * ramp * (3 - 2 * ramp);
      const VectorX<double> before = hand.target;
      hand.target = home;
      hand.target[0] += t < start ? 0.5 * speed * t * ramp : speed * (t - 0.5 * start);
      for (Index i = 8; i < hand.n; ++i) {
        const double middle = 0.5 * (hand.tree.lower()[i] + hand.tree.upper()[i]);
        const double swing = 0.3 * (hand.tree.upper()[i] - hand.tree.lower()[i]);
        hand.target[i] += fade * (middle - home[i] + swing * std::sin(2 * M_PI * t));
      }
      hand.target_velocity = (hand.target - before) / h;
      hand.step();
      if (t < 1.5) continue;  // the initial error has decayed; kd/kp is 1/8 s
      for (const FingerTip<double>& tip : hand34_tips<double>()) {
        const Vector3<double> wanted = hand.place_of(tip.link.c_str(), hand.target);
        worst = std::max(worst, (hand.place_of(tip.link.c_str(), hand.q) - wanted).norm());
      }
    }
    CHECK(worst <= 1e-3);
    CHECK(worst > 0);
    CHECK(hand.saturated == 0);

    // The paper's form, without feed-forward, lags by kd/kp times the speed and sags by weight/kp.
    HandLoop paper(h);
    StablePdSettings<double> printed = StablePdSettings<double>::paper(paper.n);
    printed.dt = h;
    paper.controller = StablePd<KinematicTree<double>>::create(paper.tree, printed).value();
    for (int k = 1; k * h <= 2.5; ++k) {
      paper.target[0] = home[0] + speed * k * h;
      paper.step();
    }
    CHECK(paper.target[0] - paper.q[0] == Approx(speed * 100 / 800).epsilon(1e-3));
    double weight = 0;
    for (const Body<double>& body : paper.tree.bodies()) {
      if (body.velocity >= 2) weight += 9.81 * body.inertia.mass;
    }
    CHECK(home[2] - paper.q[2] == Approx(weight / 800).epsilon(1e-3));
  }
}

TEST_CASE(
    "without gravity and with a fixed target, the hand's energy does not grow over a tenth of a "
    "second",
    "[robot]") {
  RobotDraws draws(71);
  for (const double rate : {50.0, 100.0, 250.0, 1000.0}) {
    for (int trial = 0; trial < 4; ++trial) {
      CAPTURE(rate, trial);
      HandLoop hand(1.0 / rate);
      hand.work.gravity.setZero();
      for (Index i = 0; i < hand.n; ++i) {
        const double share = 0.5 + 0.4 * std::tanh(draws.normal());
        hand.q[i] = hand.tree.lower()[i] + share * (hand.tree.upper()[i] - hand.tree.lower()[i]);
      }
      hand.qd = draws.entries<double>(hand.n);
      const int window = static_cast<int>(std::lround(0.1 * rate));
      const double first = hand.energy();
      double last = first;
      for (int k = 0; k < 20; ++k) {
        for (int i = 0; i < window; ++i) hand.step();
        const double now = hand.energy();
        CHECK(now <= last * (1 + 1e-9));
        last = now;
      }
      CHECK(last < 1e-6 * first);
    }
  }
}

TEST_CASE("torque limits are active in a firm grip without divergence", "[robot]") {
  for (const double rate : {50.0, 1000.0}) {
    CAPTURE(rate);
    HandLoop hand(1.0 / rate, 32000, 1600);
    for (Index i = 8; i < hand.n; ++i) hand.target[i] = hand.tree.upper()[i];
    hand.target[0] += 1.0;
    for (int k = 0; k < static_cast<int>(3 * rate); ++k) {
      hand.step();
      for (Index i = 0; i < hand.n; ++i)
        CHECK(std::abs(hand.torques[i]) <= hand.tree.effort_limits()[i]);
      REQUIRE(hand.largest() < 1e3);
    }
    CHECK(hand.saturated > 2);
    CHECK((hand.q - hand.target).cwiseAbs().maxCoeff() < 0.01);
  }
}

TEST_CASE(
    "the hand is stable or unstable as the bound for light joints predicts, and unstable_at warns",
    "[robot]") {
  const double h = 0.02, kp = 800;
  for (const double share :
       {1.40, 1.60}) {  // kd/(kp h); the bound for almost massless finger joints is 1.5
    CAPTURE(share);
    HandLoop hand(h, kp, share * kp * h);
    hand.settings.limit_torques = false;
    hand.controller = StablePd<KinematicTree<double>>::create(hand.tree, hand.settings).value();
    const bool warned = !hand.controller.unstable_at(hand.tree, hand.q, hand.work).value().empty();
    CHECK(warned == (share < 1.5));
    hand.q[12] += 0.1;
    for (int k = 0; k < 400 && hand.largest() < 1e3; ++k) hand.step();
    CHECK((hand.qd.cwiseAbs().maxCoeff() < 1e-3) == (share > 1.5));

    HandLoop implicit(h, kp, 0.5 * kp * h, PdForm::Implicit);
    implicit.q[12] += 0.1;
    for (int k = 0; k < 400; ++k) implicit.step();
    CHECK(implicit.qd.cwiseAbs().maxCoeff() < 1e-3);
  }
}
