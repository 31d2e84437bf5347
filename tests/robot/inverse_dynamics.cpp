#include "clothctl/robot/inverse_dynamics.hpp"

#include <Eigen/Dense>

#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// Potential and kinetic energy from the motion of the masses, without the matrices of dynamics.
struct Energy {
  double potential = 0, kinetic = 0;
};

Energy energy_of(const KinematicTree<double>& tree, const VectorX<double>& q,
                 const VectorX<double>& qd) {
  Energy energy;
  BodyPoses<double> body_poses(tree);
  forward_kinematics<double>(tree, q, body_poses);
  MatrixX<double> J(6, tree.nv());
  for (int link = 0; link < static_cast<int>(tree.links().size()); ++link) {
    const int b = tree.links()[static_cast<std::size_t>(link)].body;
    bool first = b >= 0;
    for (int other = 0; other < link; ++other)
      first = first && tree.links()[static_cast<std::size_t>(other)].body != b;
    if (!first) continue;  // once for each body
    const Inertia<double>& inertia = tree.bodies()[static_cast<std::size_t>(b)].inertia;
    const BodyPose<double>& place = body_poses.poses[static_cast<std::size_t>(b)];
    const Vector3<double> c = place.p + place.R * inertia.com;
    point_jacobian<double>(tree, body_poses, link, c, J);
    const VectorX<double> twist = J * qd;
    const Vector3<double> w = place.R.transpose() * twist.tail<3>();
    energy.potential -= inertia.mass * standard_gravity<double>().dot(c);
    energy.kinetic +=
        0.5 * inertia.mass * twist.head<3>().squaredNorm() + 0.5 * w.dot(inertia.about_com * w);
  }
  return energy;
}

}  // namespace

TEST_CASE(
    "gravity torques are the derivative of the potential, and power is the derivative of energy",
    "[robot]") {
  RobotDraws draws(7);
  for (int trial = 0; trial < 30; ++trial) {
    const KinematicTree<double> tree = draws.tree<double>(12, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    BodyPoses<double> body_poses(tree);
    InverseDynamicsWorkspace<double> work(tree);
    const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(n),
                          qdd = draws.entries<double>(n);
    VectorX<double> torques(n), held(n), ahead(q.size()), behind(q.size());
    const VectorX<double> zero = VectorX<double>::Zero(n);
    forward_kinematics<double>(tree, q, body_poses);
    inverse_dynamics<double>(tree, body_poses, zero, zero, standard_gravity<double>(), work, held);
    const long before = clothctl_test::allocations();
    inverse_dynamics<double>(tree, body_poses, qd, qdd, standard_gravity<double>(), work, torques);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    const double h = 1e-6;
    const VectorX<double> bend = 0.5 * h * h * qdd;
    tree.advance(q, h * qd + bend, ahead);
    tree.advance(q, -h * qd + bend, behind);
    const Energy after = energy_of(tree, ahead, qd + h * qdd),
                 earlier = energy_of(tree, behind, qd - h * qdd);
    CHECK((after.potential - earlier.potential) / (2 * h) ==
          Approx(held.dot(qd)).epsilon(1e-6).margin(1e-6));
    CHECK((after.kinetic - earlier.kinetic) / (2 * h) ==
          Approx((torques - held).dot(qd)).epsilon(1e-6).margin(1e-6));
  }
}

TEST_CASE(
    "the force on a vertical slider is its weight, and the torque on a pendulum weight times lever "
    "arm",
    "[robot]") {
  KinematicTreeBuilder<double> builder;
  Inertia<double> inertia;
  inertia.mass = 2.0;
  inertia.com << 0.5, 0.0, 0.0;
  Joint<double> lift;
  lift.name = "lift";
  lift.type = JointType::Prismatic;
  lift.parent = "world";
  lift.child = "carriage";
  lift.axis << 0.0, 0.0, 1.0;
  Joint<double> pendulum;
  pendulum.name = "pendulum";
  pendulum.parent = "carriage";
  pendulum.child = "arm";
  pendulum.axis << 0.0, 1.0, 0.0;
  builder.add_link("world")
      .add_link("carriage")
      .add_link("arm", inertia)
      .add_joint(lift)
      .add_joint(pendulum);
  const KinematicTree<double> tree = builder.build().value();
  BodyPoses<double> body_poses(tree);
  InverseDynamicsWorkspace<double> work(tree);
  forward_kinematics<double>(tree, tree.neutral(), body_poses);
  VectorX<double> torques(2);
  const VectorX<double> zero = VectorX<double>::Zero(2);
  inverse_dynamics<double>(tree, body_poses, zero, zero, standard_gravity<double>(), work, torques);
  CHECK(torques[0] == Approx(2.0 * 9.81));
  CHECK(torques[1] == Approx(-2.0 * 9.81 * 0.5));  // rotation about y lowers points along x
}

TEST_CASE("the mass matrix maps accelerations to torques and is symmetric and definite",
          "[robot]") {
  RobotDraws draws(6);
  for (int trial = 0; trial < 40; ++trial) {
    const KinematicTree<double> tree = draws.tree<double>(12, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    BodyPoses<double> body_poses(tree);
    InverseDynamicsWorkspace<double> inverse(tree);
    MassMatrixWorkspace<double> work(tree);
    forward_kinematics<double>(tree, draws.positions<double>(tree), body_poses);
    MatrixX<double> M(n, n);
    const long before = clothctl_test::allocations();
    mass_matrix<double>(tree, body_poses, work, M);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK((M - M.transpose()).norm() <= 1e-14 * M.norm());
    CHECK(M.llt().info() == Eigen::Success);
    VectorX<double> zero = VectorX<double>::Zero(n), column(n);
    for (Index k = 0; k < n; ++k) {
      const VectorX<double> unit = VectorX<double>::Unit(n, k);
      inverse_dynamics<double>(tree, body_poses, zero, unit, Vector3<double>(zero.head<3>()),
                               inverse, column);
      CHECK((M.col(k) - column).norm() <= 1e-13 * M.norm());
    }
  }
}

TEST_CASE("inverse dynamics and mass matrix refuse workspaces of another tree and wrong sizes",
          "[robot]") {
  RobotDraws draws(42);
  const KinematicTree<double> tree = draws.tree<double>(6, false, false),
                              other = draws.tree<double>(6, true, false);
  const Index n = tree.nv();
  BodyPoses<double> poses(tree), other_poses(draws.tree<double>(9, false, false));
  InverseDynamicsWorkspace<double> work(tree), other_work(other);
  MassMatrixWorkspace<double> mass_work(tree), other_mass(other);
  REQUIRE(forward_kinematics<double>(tree, tree.neutral(), poses) == TreeStatus::Done);
  const VectorX<double> rest = VectorX<double>::Zero(n), longer = VectorX<double>::Zero(n + 1);
  const Vector3<double> gravity = standard_gravity<double>();
  VectorX<double> torques = rest;
  MatrixX<double> M(n, n), wide(n, n + 1);
  CHECK(inverse_dynamics<double>(tree, poses, rest, rest, gravity, work, torques) ==
        TreeStatus::Done);
  CHECK(inverse_dynamics<double>(tree, poses, rest, rest, gravity, other_work, torques) ==
        TreeStatus::OtherTree);
  CHECK(inverse_dynamics<double>(tree, other_poses, rest, rest, gravity, work, torques) ==
        TreeStatus::OtherTree);
  CHECK(inverse_dynamics<double>(tree, poses, longer, rest, gravity, work, torques) ==
        TreeStatus::WrongSize);
  CHECK(mass_matrix<double>(tree, poses, mass_work, M) == TreeStatus::Done);
  CHECK(mass_matrix<double>(tree, poses, other_mass, M) == TreeStatus::OtherTree);
  CHECK(mass_matrix<double>(tree, poses, mass_work, wide) == TreeStatus::WrongSize);
  const KinematicTree<double> copy = tree;  // a copy is the same tree
  CHECK(inverse_dynamics<double>(copy, poses, rest, rest, gravity, work, torques) ==
        TreeStatus::Done);
}
