#include "clothctl/robot/forward_dynamics.hpp"

#include <Eigen/Dense>

#include "clothctl/robot/kinematic_tree_model.hpp"
#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEMPLATE_TEST_CASE("forward dynamics inverts inverse dynamics with and without a diagonal",
                   "[robot]", float, double) {
  using S = TestType;
  RobotDraws draws(4);
  const double loose = sizeof(S) == sizeof(float) ? 2e-2 : 1e-10;
  for (int trial = 0; trial < 60; ++trial) {
    const KinematicTree<S> tree = draws.tree<S>(12, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    BodyPoses<S> body_poses(tree);
    InverseDynamicsWorkspace<S> inverse(tree);
    ForwardDynamicsWorkspace<S> work(tree);
    forward_kinematics<S>(tree, draws.positions<S>(tree), body_poses);
    const VectorX<S> qd = draws.entries<S>(n), qdd = draws.entries<S>(n),
                     diagonal = draws.entries<S>(n).cwiseAbs();
    VectorX<S> torques(n), answer(n);
    inverse_dynamics<S>(tree, body_poses, qd, qdd, standard_gravity<S>(), inverse, torques);
    const long before = clothctl_test::allocations();
    DynamicsReport report = forward_dynamics<S>(tree, body_poses, qd, torques, VectorX<S>(),
                                                standard_gravity<S>(), work, answer);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(report.status == DynamicsStatus::Solved);
    CHECK(static_cast<double>((answer - qdd).norm()) <= loose * static_cast<double>(qdd.norm()));
    torques += diagonal.cwiseProduct(qdd);
    report = forward_dynamics<S>(tree, body_poses, qd, torques, diagonal, standard_gravity<S>(),
                                 work, answer);
    CHECK(report.status == DynamicsStatus::Solved);
    CHECK(static_cast<double>((answer - qdd).norm()) <= loose * static_cast<double>(qdd.norm()));
  }
}

TEST_CASE("a free body falls, and rotates by Euler's equation", "[robot]") {
  RobotDraws draws(5);
  KinematicTreeBuilder<double> builder;
  const Inertia<double> inertia = draws.inertia<double>();
  Joint<double> joint;
  joint.name = "free";
  joint.type = JointType::Free;
  joint.parent = "world";
  joint.child = "body";
  builder.add_link("world").add_link("body", inertia).add_joint(joint);
  const KinematicTree<double> tree = builder.build().value();
  REQUIRE(tree.nq() == 7);
  REQUIRE(tree.nv() == 6);
  BodyPoses<double> body_poses(tree);
  ForwardDynamicsWorkspace<double> work(tree);
  const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(6);
  VectorX<double> qdd(6);
  forward_kinematics<double>(tree, q, body_poses);
  const Matrix3<double> R = body_poses.poses[0].R;
  REQUIRE(forward_dynamics<double>(tree, body_poses, qd, VectorX<double>::Zero(6),
                                   VectorX<double>(), standard_gravity<double>(), work, qdd)
              .status == DynamicsStatus::Solved);
  const Vector3<double> w = qd.tail<3>(), alpha = qdd.tail<3>(), c = R * inertia.com;
  const Matrix3<double> I = R * inertia.about_com * R.transpose();
  CHECK((I * alpha + w.cross(I * w)).norm() < 1e-12);  // no moment about the centre
  CHECK((qdd.head<3>() + alpha.cross(c) + w.cross(w.cross(c)) - standard_gravity<double>()).norm() <
        1e-12);  // it falls freely
}

TEST_CASE(
    "a coordinate without inertia is named, and values that are not finite have their own status",
    "[robot]") {
  for (const bool coupled : {false, true}) {
    KinematicTreeBuilder<double> builder;
    builder.add_link("world");
    for (int k = 0; k < 3; ++k) {
      Inertia<double> inertia;
      inertia.mass = 1.0;
      inertia.com << 0.1, 0.0, 0.0;
      inertia.about_com = Matrix3<double>::Identity();
      if (k == 2) {
        builder.add_link("link2");
      } else {
        builder.add_link("link" + std::to_string(k), inertia);
      }
      Joint<double> joint;
      joint.name = "joint" + std::to_string(k);
      joint.parent = k == 0 ? "world" : "link" + std::to_string(k - 1);
      joint.child = "link" + std::to_string(k);
      if (coupled && k == 1) joint.leader = "joint0";
      builder.add_joint(joint);
    }
    const KinematicTree<double> tree = builder.build().value();
    const Index n = tree.nv();
    BodyPoses<double> body_poses(tree);
    ForwardDynamicsWorkspace<double> work(tree);
    forward_kinematics<double>(tree, tree.neutral(), body_poses);
    const Vector3<double> gravity = standard_gravity<double>();
    VectorX<double> zero = VectorX<double>::Zero(n), answer(n), diagonal = zero;
    DynamicsReport report = forward_dynamics<double>(tree, body_poses, zero, zero,
                                                     VectorX<double>(), gravity, work, answer);
    CHECK(report.status == DynamicsStatus::NoInertia);
    CHECK(report.body == 2);
    diagonal[n - 1] = 0.5;
    CHECK(forward_dynamics<double>(tree, body_poses, zero, zero, diagonal, gravity, work, answer)
              .status == DynamicsStatus::Solved);
    VectorX<double> bad = zero;
    bad[0] = std::nan("");
    CHECK(forward_dynamics<double>(tree, body_poses, bad, zero, diagonal, gravity, work, answer)
              .status == DynamicsStatus::InvalidInput);
    CHECK(forward_dynamics<double>(tree, body_poses, zero, bad, diagonal, gravity, work, answer)
              .status == DynamicsStatus::InvalidInput);
    CHECK(forward_dynamics<double>(tree, body_poses, zero, zero, diagonal, gravity, work, answer)
              .status == DynamicsStatus::Solved);
  }
}

TEST_CASE("a joint that moves no inertia of its own is named whatever its axis", "[robot]") {
  RobotDraws draws(95);
  int solved = 0;
  for (int trial = 0; trial < 200; ++trial) {
    // Two joints on one axis with no mass between them; or a point mass on the axis of its joint.
    const bool twins = trial % 2 == 0;
    const Vector3<double> axis = draws.vector().normalized();
    KinematicTreeBuilder<double> builder;
    builder.add_link("world");
    builder.add_link(
        "first", twins ? std::nullopt : std::optional<Inertia<double>>(draws.inertia<double>()));
    Inertia<double> end = draws.inertia<double>();
    if (!twins) {
      end.about_com.setZero();
      end.com = 0.3 * axis;
    }
    builder.add_link("second", end);
    for (int k = 0; k < 2; ++k) {
      Joint<double> joint;
      joint.name = "joint" + std::to_string(k);
      joint.parent = k == 0 ? "world" : "first";
      joint.child = k == 0 ? "first" : "second";
      joint.axis = twins || k == 1 ? axis : Vector3<double>(draws.vector());
      if (!twins) joint.origin.p = draws.vector();
      builder.add_joint(joint);
    }
    const KinematicTree<double> tree = builder.build().value();
    KinematicTreeWorkspace<double> work(tree);
    const VectorX<double> none, rest = VectorX<double>::Zero(2), q = draws.entries<double>(2),
                                push = draws.entries<double>(2);
    VectorX<double> qdd(2);
    forward_kinematics<double>(tree, q, work.body_poses);
    const DynamicsReport report = forward_dynamics<double>(
        tree, work.body_poses, rest, push, none, standard_gravity<double>(), work.forward, qdd);
    solved += report.status == DynamicsStatus::Solved ? 1 : 0;
    const VectorX<double> trace = VectorX<double>::Constant(2, 1e-6);
    CHECK(forward_dynamics<double>(tree, work.body_poses, rest, push, trace,
                                   standard_gravity<double>(), work.forward, qdd)
              .status == DynamicsStatus::Solved);
  }
  CHECK(solved == 0);
}

TEST_CASE("forward dynamics refuses workspaces of another tree and vectors of a wrong size",
          "[robot]") {
  RobotDraws draws(43);
  const KinematicTree<double> tree = draws.tree<double>(8, true, false);
  const Index n = tree.nv();
  BodyPoses<double> poses(tree);
  forward_kinematics<double>(tree, tree.neutral(), poses);
  ForwardDynamicsWorkspace<double> work(tree);
  const VectorX<double> rest = VectorX<double>::Zero(n), none,
                        longer = VectorX<double>::Zero(n + 2);
  VectorX<double> qdd = rest;
  const Vector3<double> gravity = standard_gravity<double>();
  const auto status = [&](const BodyPoses<double>& p, const VectorX<double>& qd,
                          const VectorX<double>& diagonal, ForwardDynamicsWorkspace<double>& w) {
    return forward_dynamics<double>(tree, p, qd, rest, diagonal, gravity, w, qdd).status;
  };
  CHECK(status(poses, rest, none, work) == DynamicsStatus::Solved);
  CHECK(status(poses, longer, none, work) == DynamicsStatus::WrongSize);
  CHECK(status(poses, rest, longer, work) == DynamicsStatus::WrongSize);
  for (int trial = 0; trial < 10; ++trial) {  // the same number of bodies, other branches
    const KinematicTree<double> other = draws.tree<double>(8, trial % 2 == 0, trial % 3 == 0);
    ForwardDynamicsWorkspace<double> foreign(other);
    CHECK(status(poses, rest, none, foreign) == DynamicsStatus::OtherTree);
  }
  const BodyPoses<double> fewer(draws.tree<double>(3, false, false));
  CHECK(status(fewer, rest, none, work) == DynamicsStatus::OtherTree);
  CHECK(to_string(DynamicsStatus::WrongSize) == "wrong_size");
  CHECK(to_string(DynamicsStatus::OtherTree) == "other_tree");
}
