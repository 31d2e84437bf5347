#include "clothctl/robot/stable_pd.hpp"

#include <cmath>

#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace other_engine {

// A robot of twelve joints. In each solve, one more joint exceeds its torque limit.
struct Cascade {
  Index limits = 12;  // number of limits that the robot gives
};

}  // namespace other_engine

template <>
struct clothctl::articulated_traits<other_engine::Cascade> {
  using Model = other_engine::Cascade;
  using scalar_type = double;
  using workspace_type = int;
  using View = Eigen::Ref<const VectorX<double>>;
  using Out = Eigen::Ref<VectorX<double>>;
  static int make_workspace(const Model&) { return 0; }
  static Index nq(const Model&) { return 12; }
  static Index nv(const Model&) { return 12; }
  static VectorX<double> lower(const Model&) { return VectorX<double>::Constant(12, -9.0); }
  static VectorX<double> upper(const Model& m) { return VectorX<double>::Constant(m.limits, 9.0); }
  static VectorX<double> effort_limits(const Model& m) {
    return VectorX<double>::Constant(m.limits, 2.0);
  }
  static void advance(const Model&, const View& q, const View& step, Out out) { out = q + step; }
  static void difference(const Model&, const View& from, const View& to, Out out) {
    out = to - from;
  }
  static void forward_kinematics(const Model&, const View&, int&) {}
  static void frame_pose(const Model&, const int&, int, Matrix3<double>& R, Vector3<double>& p) {
    R.setIdentity();
    p.setZero();
  }
  static void point_jacobian(const Model&, const int&, int, const Vector3<double>&,
                             Eigen::Ref<MatrixX<double>> J) {
    J.setZero();
  }
  static void inverse_dynamics(const Model&, const View&, const View&, int&, Out out) {
    out.setZero();
  }
  static Index forward_dynamics(const Model&, const View&, const View&, const View& diagonal, int&,
                                Out qdd) {
    qdd.setZero();
    Index held = 0;
    while (held < 11 && diagonal[held] == 0.0) ++held;
    qdd[held] = -1e6;
    return -1;
  }
};

namespace {

/// A slider, with or without mass.
KinematicTree<double> slider(double mass, double effort = 1e9) {
  KinematicTreeBuilder<double> builder;
  Inertia<double> inertia;
  inertia.mass = mass;
  Joint<double> joint;
  joint.name = "lift";
  joint.type = JointType::Prismatic;
  joint.parent = "world";
  joint.child = "carriage";
  joint.axis << 0.0, 0.0, 1.0;
  joint.limits.effort = effort;
  return builder.add_link("world").add_link("carriage", inertia).add_joint(joint).build().value();
}

/// A robot, its controller and an independent symplectic simulator.
struct Loop {
  using Controller = StablePd<KinematicTree<double>>;
  KinematicTree<double> tree;
  StablePdSettings<double> settings;
  Controller controller;
  KinematicTreeWorkspace<double> work;
  VectorX<double> q, qd, torques, qdd, target, target_velocity;
  int saturated = 0;

  Loop(KinematicTree<double> robot, const StablePdSettings<double>& chosen)
      : tree(std::move(robot)),
        settings(chosen),
        controller(Controller::create(tree, settings).value()),
        work(tree) {
    const Index n = tree.nv();
    q = target = tree.neutral();
    qd = torques = qdd = target_velocity = VectorX<double>::Zero(n);
  }
  PdStatus step() {
    const PdReport report = controller.solve(tree, q, qd, target, target_velocity,
                                             VectorX<double>(), work, torques, qdd);
    saturated = report.saturated;
    if (report.status != PdStatus::Solved) return report.status;
    qd += settings.dt * qdd;
    tree.advance(q, settings.dt * qd, q);
    return report.status;
  }
  double largest() const { return std::max(q.cwiseAbs().maxCoeff(), qd.cwiseAbs().maxCoeff()); }
};

}  // namespace

TEST_CASE("a foreign robot whose limits have a wrong size is refused", "[robot]") {
  const other_engine::Cascade robot{11};
  const auto made =
      StablePd<other_engine::Cascade>::create(robot, StablePdSettings<double>::uniform(12));
  REQUIRE_FALSE(made);
  CHECK(made.error() == "the robot gives 11 effort limits for 12 velocities");
  InverseKinematics<other_engine::Cascade> ik(robot, 1);
  VectorX<double> q = VectorX<double>::Zero(12);
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(0, Vector3<double>::Zero(), Vector3<double>::Ones())};
  const auto report = ik.solve(robot, tasks, VectorX<double>(), q);
  CHECK(report.status == IkStatus::InvalidInput);
  CHECK(report.message == "the robot's limits differ in their sizes");
}

TEST_CASE(
    "the torque is that of spring and damper at the end of the step and causes the acceleration",
    "[robot]") {
  RobotDraws draws(19);
  for (const PdForm form : {PdForm::Stable, PdForm::Implicit}) {
    for (int trial = 0; trial < 20; ++trial) {
      KinematicTree<double> tree = draws.tree<double>(10, trial % 2 == 0, trial % 3 == 0);
      const Index n = tree.nv();
      StablePdSettings<double> settings;
      settings.kp = 800 * draws.entries<double>(n).cwiseAbs();
      settings.kd = 100 * draws.entries<double>(n).cwiseAbs();
      settings.form = form;
      Loop loop(tree, settings);
      loop.q = draws.positions<double>(tree);
      loop.target = draws.positions<double>(tree);
      loop.qd = draws.entries<double>(n);
      loop.target_velocity = draws.entries<double>(n);
      const VectorX<double> external = draws.entries<double>(n);
      const long before = clothctl_test::allocations();
      const PdReport report =
          loop.controller.solve(tree, loop.q, loop.qd, loop.target, loop.target_velocity, external,
                                loop.work, loop.torques, loop.qdd);
      const long taken = clothctl_test::allocations() - before;
      if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
      CHECK(report.status == PdStatus::Solved);
      const double h = settings.dt;
      VectorX<double> error(n), held(n), needed(n);
      tree.difference(loop.q, loop.target, error);
      const VectorX<double> zero = VectorX<double>::Zero(n);
      articulated_traits<KinematicTree<double>>::inverse_dynamics(tree, zero, zero, loop.work,
                                                                  held);
      articulated_traits<KinematicTree<double>>::inverse_dynamics(tree, loop.qd, loop.qdd,
                                                                  loop.work, needed);
      VectorX<double> wanted =
          settings.kp.cwiseProduct(error - h * loop.qd) -
          settings.kd.cwiseProduct(loop.qd + h * loop.qdd - loop.target_velocity) + held;
      if (form == PdForm::Implicit) wanted -= settings.kp.cwiseProduct(h * h * loop.qdd);
      CHECK((loop.torques - wanted).norm() <= 1e-10 * wanted.norm());
      CHECK((loop.torques + external - needed).norm() <= 1e-10 * needed.norm());
    }
  }
}

TEST_CASE("one joint is stable if kd > 1.5 kp h - 2 m/h, and always when implicit", "[robot]") {
  const double kp = 800, h = 0.02;
  for (const double share : {0.05, 0.1, 0.5}) {  // of kp h²
    const double mass = share * kp * h * h, bound = least_damping<double>(kp, h, mass);
    CHECK(bound == Approx(kp * h * (1.5 - 2 * share)));
    for (const double kd : {0.99 * bound, 1.01 * bound}) {
      StablePdSettings<double> settings = StablePdSettings<double>::uniform(1, kp, kd);
      Loop loop(slider(mass), settings);
      loop.q[0] = 0.01;
      for (int k = 0; k < 4000 && loop.largest() < 1e6; ++k) CHECK(loop.step() == PdStatus::Solved);
      CHECK((loop.largest() < 1e-6) == (kd > bound));
      CHECK(loop.controller.unstable_at(loop.tree, loop.tree.neutral(), loop.work).value().size() ==
            (kd > bound ? 0u : 1u));
      settings.form = PdForm::Implicit;
      settings.kd *= 0.1;
      Loop implicit(slider(mass), settings);
      implicit.q[0] = 0.01;
      for (int k = 0; k < 4000; ++k) CHECK(implicit.step() == PdStatus::Solved);
      CHECK(implicit.largest() < 1e-6);
    }
  }
}

TEST_CASE("joints that are only jointly underdamped are named", "[robot]") {
  // Two carriages side by side do not interact, so the lighter one decides. If one rides on the
  // other, they move together with less inertia than each has alone.
  KinematicTreeBuilder<double> builder;
  builder.add_link("world");
  for (int k = 0; k < 2; ++k) {
    Inertia<double> inertia;
    inertia.mass = k == 0 ? 0.01 : 1.0;
    Joint<double> joint;
    joint.name = "slide" + std::to_string(k);
    joint.type = JointType::Prismatic;
    joint.parent = k == 0 ? "world" : "part0";
    joint.child = "part" + std::to_string(k);
    joint.axis << 1.0, 0.0, 0.0;
    builder.add_link(joint.child, inertia).add_joint(joint);
  }
  const KinematicTree<double> tree = builder.build().value();
  const double kp = 800, h = 0.02;
  int between = 0;
  for (double kd = 22.9; kd < 24.2; kd += 0.1) {
    CAPTURE(kd);
    Loop loop(tree, StablePdSettings<double>::uniform(2, kp, kd));
    const bool warned =
        !loop.controller.unstable_at(tree, loop.tree.neutral(), loop.work).value().empty();
    // M = [1.01 1; 1 1]: the least eigenvalue decides.
    const double least = 0.5 * (2.01 - std::sqrt(0.01 * 0.01 + 4.0));
    CHECK(warned == (kd < 1.5 * kp * h - 2 * least / h));
    loop.q << 1e-3, -1e-3;
    for (int k = 0; k < 20000 && loop.largest() < 1e3; ++k)
      REQUIRE(loop.step() == PdStatus::Solved);
    CHECK((loop.largest() < 1e-4) == !warned);
    if (warned && kd > 1.5 * kp * h - 2 * 0.01 / h) ++between;  // not visible from each joint alone
  }
  CHECK(between > 0);
}

TEST_CASE("with feed-forward there is no steady error; the paper's form sags and lags as computed",
          "[robot]") {
  const double v = 0.3, h = 0.02, mass = 0.5;
  for (const bool paper : {false, true}) {
    Loop loop(slider(mass),
              paper ? StablePdSettings<double>::paper(1) : StablePdSettings<double>::uniform(1));
    for (int k = 0; k < 1000; ++k) CHECK(loop.step() == PdStatus::Solved);
    CHECK(loop.q[0] == Approx(paper ? -mass * 9.81 / 800 : 0.0).margin(1e-9));
    loop.target_velocity[0] = v;
    for (int k = 0; k < 1000; ++k) {
      loop.target[0] += h * v;
      CHECK(loop.step() == PdStatus::Solved);
    }
    const double lag = loop.target[0] - loop.q[0] - (paper ? mass * 9.81 / 800 : 0.0);
    CHECK(lag == Approx(paper ? (100.0 / 800) * v : 0.0).margin(1e-9));
  }
}

TEST_CASE("torque limits hold without divergence where clipping diverges", "[robot]") {
  RobotDraws draws(20);
  KinematicTreeBuilder<double> builder;
  builder.add_link("world");
  for (int k = 0; k < 6; ++k) {
    Inertia<double> inertia;
    inertia.mass = 0.05;
    inertia.com << 0.02, 0.0, 0.0;
    inertia.about_com = 1e-6 * Matrix3<double>::Identity();
    Joint<double> joint;
    joint.name = "j" + std::to_string(k);
    joint.parent = k == 0 ? "world" : "l" + std::to_string(k - 1);
    joint.child = "l" + std::to_string(k);
    joint.axis = Vector3<double>::Unit(k % 3);
    joint.origin.p << 0.04, 0.0, 0.0;
    joint.limits.effort = 5.0;
    builder.add_link(joint.child, inertia).add_joint(joint);
  }
  Loop loop(builder.build().value(), StablePdSettings<double>::uniform(6, 8000, 400));
  loop.target.setConstant(1.5);
  int saturated = 0;
  for (int k = 0; k < 500; ++k) {
    REQUIRE(loop.step() == PdStatus::Solved);
    CHECK(loop.torques.cwiseAbs().maxCoeff() <= 5.0);
    saturated += loop.saturated;
  }
  CHECK(saturated > 0);
  CHECK((loop.q - loop.target).norm() < 1e-3);
}

TEST_CASE("further torques of the motors are within the torque limits", "[robot]") {
  const double mass = 2;
  KinematicTreeBuilder<double> builder;
  Inertia<double> inertia;
  inertia.mass = mass;
  Joint<double> joint;
  joint.name = "along";
  joint.parent = "world";
  joint.child = "block";
  joint.type = JointType::Prismatic;
  joint.axis = Vector3<double>::UnitX();
  joint.limits.effort = 5;
  builder.add_link("world").add_link("block", inertia).add_joint(joint);
  Loop loop(builder.build().value(), StablePdSettings<double>::uniform(1, 0, 10));
  const VectorX<double> none;
  const auto solve = [&](double feed) {
    return loop.controller.solve(loop.tree, loop.q, loop.qd, loop.target, loop.target_velocity,
                                 none, loop.work, loop.torques, loop.qdd,
                                 VectorX<double>::Constant(1, feed));
  };
  // (m + h kd) a = τ: the damper takes its part of it.
  const double h = loop.controller.settings().dt;
  CHECK(solve(3).saturated == 0);
  CHECK(loop.qdd[0] == Approx(3 / (mass + h * 10)).epsilon(1e-12));
  CHECK(loop.torques[0] == Approx(mass * loop.qdd[0]).epsilon(1e-12));
  CHECK(solve(-80).saturated == 1);
  CHECK(loop.torques[0] == -5);
  CHECK(loop.qdd[0] == Approx(-5 / mass).epsilon(1e-12));
  CHECK(solve(std::nan("")).status == PdStatus::InvalidInput);
  CHECK(loop.torques[0] == -5);
  CHECK(loop.controller
            .solve(loop.tree, loop.q, loop.qd, loop.target, loop.target_velocity, none, loop.work,
                   loop.torques, loop.qdd, VectorX<double>::Zero(2))
            .status == PdStatus::WrongSize);
}

TEST_CASE("gains are validated, and refused states change nothing", "[robot]") {
  const KinematicTree<double> tree = slider(1.0);
  StablePdSettings<double> settings = StablePdSettings<double>::uniform(2);
  CHECK(StablePd<KinematicTree<double>>::create(tree, settings).error() ==
        "kp has 2 entries for 1 coordinates");
  settings = StablePdSettings<double>::uniform(1, 800, -1);
  CHECK(StablePd<KinematicTree<double>>::create(tree, settings).error() ==
        "kd of coordinate 0 is negative or not finite: -1");
  settings = StablePdSettings<double>::uniform(1);
  settings.dt = 0;
  CHECK(StablePd<KinematicTree<double>>::create(tree, settings).error() ==
        "dt is not a positive time: 0");
  const VectorX<double> rest = VectorX<double>::Zero(1);
  const KinematicTree<double> light = slider(0.001);
  CHECK(StablePd<KinematicTree<double>>::create(light, StablePdSettings<double>::uniform(1), rest));
  CHECK(StablePd<KinematicTree<double>>::create(light,
                                                StablePdSettings<double>::uniform(1, 800, 20), rest)
            .error() ==
        "kd of coordinate 0 is too low for its kp and the time step: 20 (coordinates with that "
        "fault: 1)");
  CHECK(StablePd<KinematicTree<double>>::create(light, StablePdSettings<double>::uniform(1),
                                                VectorX<double>::Zero(2))
            .error() == "q has 2 entries, the robot has 1 positions");
  Loop loop(slider(1.0), StablePdSettings<double>::uniform(1));
  loop.torques[0] = 7.0;
  loop.target[0] = std::nan("");
  CHECK(loop.step() == PdStatus::InvalidInput);
  CHECK(loop.torques[0] == 7.0);
  for (VectorX<double>* bad :
       {&loop.q, &loop.qd, &loop.target, &loop.target_velocity, &loop.torques, &loop.qdd}) {
    loop.target[0] = 0.0;
    const VectorX<double> kept = *bad;
    bad->setZero(3);
    CHECK(loop.step() == PdStatus::WrongSize);
    *bad = kept;
  }
  for (VectorX<double>* bad : {&loop.q, &loop.qd, &loop.target_velocity}) {
    loop.target[0] = 0.0;
    const double kept = (*bad)[0];
    (*bad)[0] = std::nan("");
    loop.qdd[0] = 5.0;
    CHECK(loop.step() == PdStatus::InvalidInput);
    CHECK(loop.qdd[0] == 5.0);
    (*bad)[0] = kept;
  }
  Loop feather(slider(0.0), StablePdSettings<double>::uniform(1, 800, 0));
  CHECK(feather.step() == PdStatus::NoInertia);
  loop.target[0] = 0.1;
  CHECK(loop.step() == PdStatus::Solved);
}

TEST_CASE("joints that reach their limits in every round are clipped to them", "[robot]") {
  const other_engine::Cascade robot;
  auto pd = StablePd<other_engine::Cascade>::create(robot, StablePdSettings<double>::uniform(12));
  REQUIRE(pd);
  const VectorX<double> rest = VectorX<double>::Zero(12), none;
  VectorX<double> torques = rest, qdd = rest;
  int work = 0;
  const PdReport report = pd->solve(robot, rest, rest, rest, none, none, work, torques, qdd);
  CHECK(report.status == PdStatus::Clipped);
  CHECK(report.solves == 9);
  CHECK(report.saturated == 9);
  CHECK(torques.head(9) == VectorX<double>::Constant(9, 2.0));
  CHECK(torques.cwiseAbs().maxCoeff() <= 2.0);
  CHECK(to_string(PdStatus::Clipped) == "clipped");
}

TEST_CASE("a workspace of another robot is refused, and so is another robot", "[robot]") {
  RobotDraws draws(46);
  const KinematicTree<double> tree = draws.tree<double>(8, false, false),
                              other = draws.tree<double>(8, true, false);
  Loop loop(tree, StablePdSettings<double>::uniform(tree.nv()));
  KinematicTreeWorkspace<double> foreign(other);
  const VectorX<double> none;
  CHECK(loop.controller
            .solve(tree, loop.q, loop.qd, loop.target, none, none, foreign, loop.torques, loop.qdd)
            .status == PdStatus::OtherWorkspace);
  CHECK(loop.controller
            .solve(other, loop.q, loop.qd, loop.target, none, none, foreign, loop.torques, loop.qdd)
            .status == PdStatus::WrongSize);
  CHECK(loop.controller.unstable_at(tree, loop.q, foreign).error() ==
        "the workspace was made for another robot");
  CHECK(loop.controller.unstable_at(tree, VectorX<double>::Zero(99), loop.work).error() ==
        "q or the robot is not of the size that the controller was made for");
  CHECK(to_string(PdStatus::OtherWorkspace) == "other_workspace");
}
