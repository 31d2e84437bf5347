#include "clothctl/robot/kinematic_tree_model.hpp"

#include "laws/articulated_laws.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(ArticulatedModel<KinematicTree<double>>);
static_assert(ArticulatedDynamics<KinematicTree<double>>);
static_assert(ArticulatedDynamics<KinematicTree<float>, float>);
static_assert(!ArticulatedModel<KinematicTree<double>, float>);

TEST_CASE("the trait gives the tree's own results and names the coordinate without inertia",
          "[robot]") {
  using Traits = articulated_traits<KinematicTree<double>>;
  RobotDraws draws(13);
  const KinematicTree<double> tree = draws.tree<double>(10, true, false);
  const Index n = Traits::nv(tree);
  auto work = Traits::make_workspace(tree);
  const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(n),
                        qdd = draws.entries<double>(n);
  VectorX<double> torques(n), answer(n);
  Traits::forward_kinematics(tree, q, work);
  Traits::inverse_dynamics(tree, qd, qdd, work, torques);
  CHECK(Traits::forward_dynamics(tree, qd, torques, VectorX<double>::Zero(n), work, answer) == -1);
  CHECK((answer - qdd).norm() < 1e-10 * qdd.norm());
  work.gravity.setZero();
  VectorX<double> weightless(n);
  const VectorX<double> rest = VectorX<double>::Zero(n);
  Traits::inverse_dynamics(tree, rest, rest, work, weightless);
  CHECK(weightless.norm() == 0.0);
  Matrix3<double> R;
  Vector3<double> p;
  Traits::frame_pose(tree, work, 3, R, p);
  CHECK((link_pose(tree, work.body_poses, 3).p - p).norm() == 0.0);

  KinematicTreeBuilder<double> builder;
  Joint<double> joint;
  joint.name = "loose";
  joint.parent = "world";
  joint.child = "feather";
  const KinematicTree<double> feather =
      builder.add_link("world").add_link("feather").add_joint(joint).build().value();
  auto small = Traits::make_workspace(feather);
  VectorX<double> one = VectorX<double>::Zero(1);
  Traits::forward_kinematics(feather, one, small);
  VectorX<double> none = one;
  CHECK(Traits::forward_dynamics(feather, one, one, one, small, none) == 0);
}

TEMPLATE_TEST_CASE("trees of every kind of joint obey the laws of robots", "[robot]", float,
                   double) {
  using S = TestType;
  RobotDraws draws(14);
  for (int trial = 0; trial < 8; ++trial) {
    CAPTURE(trial);
    const KinematicTree<S> tree = draws.tree<S>(9, trial % 2 == 0, trial % 4 >= 2);
    const VectorX<S> q = draws.positions(tree), other = draws.positions(tree);
    const VectorX<S> qd = draws.entries<S>(tree.nv(), 0.3), qdd = draws.entries<S>(tree.nv());
    const S tolerance = std::is_same_v<S, float> ? S(2e-5) : S(1e-12);
    check_articulated_laws(tree, q, other, qd, static_cast<int>(tree.links().size()), tolerance);
    check_articulated_dynamics_laws(tree, q, qd, qdd, tolerance);
  }
}
