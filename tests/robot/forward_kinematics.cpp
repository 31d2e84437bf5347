#include "clothctl/robot/forward_kinematics.hpp"

#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// The pose of a link by definition: one joint after another, with Rodrigues' formula.
Pose<double> by_definition(const KinematicTree<double>& tree, const VectorX<double>& q, int link) {
  const Link<double>& frame = tree.links()[static_cast<std::size_t>(link)];
  Pose<double> pose = frame.placement;
  for (int b = frame.body; b >= 0;) {
    const Body<double>& body = tree.bodies()[static_cast<std::size_t>(b)];
    Pose<double> moved;
    const double value = body.ratio * q[body.position] + body.offset;
    if (body.type == JointType::Revolute)
      moved.R = Eigen::AngleAxisd(value, Vector3<double>::UnitZ()).toRotationMatrix();
    if (body.type == JointType::Prismatic) moved.p = value * Vector3<double>::UnitZ();
    if (body.type == JointType::Free) {
      moved.p = q.segment<3>(body.position);
      moved.R = Eigen::Quaterniond(q[body.position + 3], q[body.position + 4], q[body.position + 5],
                                   q[body.position + 6])
                    .toRotationMatrix();
    }
    pose = body.placement * (moved * pose);
    b = body.parent;
  }
  return pose;
}

}  // namespace

TEST_CASE("link poses match the definition", "[robot]") {
  RobotDraws draws(1);
  for (int trial = 0; trial < 20; ++trial) {
    const KinematicTree<double> tree = draws.tree<double>(12, trial % 2 == 0, trial % 3 == 0);
    BodyPoses<double> body_poses(tree);
    const VectorX<double> q = draws.positions<double>(tree);
    const long before = clothctl_test::allocations();
    forward_kinematics<double>(tree, q, body_poses);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    for (int link = 0; link < static_cast<int>(tree.links().size()); ++link) {
      const Pose<double> pose = link_pose(tree, body_poses, link),
                         wanted = by_definition(tree, q, link);
      CHECK((pose.p - wanted.p).norm() < 1e-13);
      CHECK((pose.R - wanted.R).norm() < 1e-13);
    }
  }
}

TEST_CASE("a Jacobian is the derivative of a point's position and of a link's rotation",
          "[robot]") {
  RobotDraws draws(2);
  for (int trial = 0; trial < 10; ++trial) {
    const KinematicTree<double> tree = draws.tree<double>(12, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    BodyPoses<double> body_poses(tree);
    const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(n);
    VectorX<double> moved(q.size());
    MatrixX<double> J(6, n);
    for (int link = 0; link < static_cast<int>(tree.links().size()); ++link) {
      forward_kinematics<double>(tree, q, body_poses);
      const Pose<double> here = link_pose(tree, body_poses, link);
      const Vector3<double> local = draws.vector();
      point_jacobian<double>(tree, body_poses, link, here * local, J);
      const double h = 1e-6;
      Pose<double> ends[2];
      for (int side = 0; side < 2; ++side) {
        tree.advance(q, (side == 0 ? -h : h) * qd, moved);
        forward_kinematics<double>(tree, moved, body_poses);
        ends[side] = link_pose(tree, body_poses, link);
      }
      const Vector3<double> velocity = (ends[1] * local - ends[0] * local) / (2 * h);
      const Matrix3<double> spin = (ends[1].R - ends[0].R) / (2 * h) * here.R.transpose();
      const Vector3<double> turning(spin(2, 1), spin(0, 2), spin(1, 0));
      const VectorX<double> twist = J * qd;
      CHECK((twist.head<3>() - velocity).norm() < 1e-7 * (1 + velocity.norm()));
      CHECK((twist.tail<3>() - turning).norm() < 1e-7 * (1 + turning.norm()));
    }
  }
}

TEST_CASE(
    "a quaternion of another length gives the same rotation, and NaN affects the bodies below it "
    "only",
    "[robot]") {
  RobotDraws draws(3);
  const KinematicTree<double> tree = draws.tree<double>(9, true, false);
  BodyPoses<double> body_poses(tree), scaled(tree);
  VectorX<double> q = draws.positions<double>(tree);
  forward_kinematics<double>(tree, q, body_poses);
  const Body<double>& free = tree.bodies()[0];
  REQUIRE(free.type == JointType::Free);
  q.segment<4>(free.position + 3) *= 3.0;
  forward_kinematics<double>(tree, q, scaled);
  for (std::size_t i = 0; i < tree.bodies().size(); ++i)
    CHECK((scaled.poses[i].R - body_poses.poses[i].R).norm() < 1e-13);
  const int last = static_cast<int>(tree.bodies().size()) - 1;
  q[tree.bodies()[static_cast<std::size_t>(last)].position] = std::nan("");
  forward_kinematics<double>(tree, q, scaled);
  CHECK_FALSE((all_finite(scaled.poses.back().R) && all_finite(scaled.poses.back().p)));
  CHECK(all_finite(scaled.poses.front().R));
}

TEST_CASE("poses of another tree, vectors of a wrong size and links that do not exist are refused",
          "[robot]") {
  RobotDraws draws(41);
  const KinematicTree<double> small = draws.tree<double>(3, false, false),
                              large = draws.tree<double>(20, true, true);
  BodyPoses<double> poses(small), others(large);
  const VectorX<double> q = small.neutral();
  CHECK(forward_kinematics<double>(small, q, poses) == TreeStatus::Done);
  CHECK(forward_kinematics<double>(large, large.neutral(), poses) == TreeStatus::OtherTree);
  CHECK(forward_kinematics<double>(small, large.neutral(), poses) == TreeStatus::WrongSize);
  const Vector3<double> x = Vector3<double>::Zero();
  MatrixX<double> J(6, small.nv()), J3(3, small.nv()), wide(6, 99);
  const int links = static_cast<int>(small.links().size());
  CHECK(point_jacobian<double>(small, poses, 1, x, J) == TreeStatus::Done);
  CHECK(point_jacobian<double>(small, others, 1, x, J) == TreeStatus::OtherTree);
  CHECK(point_jacobian<double>(small, poses, 1, x, wide) == TreeStatus::WrongSize);
  CHECK(position_jacobian<double>(small, poses, 1, x, 1.0, J) == TreeStatus::WrongSize);
  for (const int link : {-1, links, 1 << 30}) {
    CHECK(point_jacobian<double>(small, poses, link, x, J) == TreeStatus::NoLink);
    CHECK(position_jacobian<double>(small, poses, link, x, 1.0, J3) == TreeStatus::NoLink);
    CHECK(link_jacobian<double>(small, poses, link, J) == TreeStatus::NoLink);
    CHECK_FALSE(all_finite(link_pose(small, poses, link).p));
  }
  CHECK_FALSE(all_finite(link_pose(large, poses, 1).R));
  CHECK(to_string(TreeStatus::Done) == "done");
  CHECK(to_string(TreeStatus::WrongSize) == "wrong_size");
  CHECK(to_string(TreeStatus::OtherTree) == "other_tree");
  CHECK(to_string(TreeStatus::NoLink) == "no_link");
}
