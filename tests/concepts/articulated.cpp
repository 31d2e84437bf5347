#include "clothctl/concepts/articulated.hpp"

#include <cmath>

#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "laws/articulated_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Another engine's robot, which keeps its state in itself: a planar arm of two massless rods, 1 m
// long, with a mass of 1 kg at the end of each.
struct Arm {
  double angle[2] = {0, 0};
};
struct Pose2 {
  double x, y, turn;
};
inline Pose2 end_of(const Arm& arm, int rod) {
  Pose2 pose{0, 0, 0};
  for (int k = 0; k <= rod; ++k) {
    pose.turn += arm.angle[k];
    pose.x += std::cos(pose.turn);
    pose.y += std::sin(pose.turn);
  }
  return pose;
}

}  // namespace other_engine

template <>
struct clothctl::articulated_traits<other_engine::Arm> {
  using scalar_type = double;
  using workspace_type = other_engine::Arm;
  using Arm = other_engine::Arm;
  using V = Eigen::Ref<const VectorX<double>>;
  using Out = Eigen::Ref<VectorX<double>>;

  static Arm make_workspace(const Arm& arm) { return arm; }
  static Index nq(const Arm&) { return 2; }
  static Index nv(const Arm&) { return 2; }
  static VectorX<double> lower(const Arm&) { return VectorX<double>::Constant(2, -3.0); }
  static VectorX<double> upper(const Arm&) { return VectorX<double>::Constant(2, 3.0); }
  static VectorX<double> effort_limits(const Arm&) { return VectorX<double>::Constant(2, 100.0); }
  static void advance(const Arm&, const V& q, const V& step, Out out) { out = q + step; }
  static void difference(const Arm&, const V& from, const V& to, Out out) { out = to - from; }
  static void forward_kinematics(const Arm&, const V& q, Arm& work) {
    work.angle[0] = q[0];
    work.angle[1] = q[1];
  }
  static void frame_pose(const Arm&, const Arm& work, int rod, Matrix3<double>& R,
                         Vector3<double>& p) {
    const other_engine::Pose2 pose = end_of(work, rod);
    R << std::cos(pose.turn), -std::sin(pose.turn), 0, std::sin(pose.turn), std::cos(pose.turn), 0,
        0, 0, 1;
    p << pose.x, pose.y, 0;
  }
  static void point_jacobian(const Arm&, const Arm& work, int rod, const Vector3<double>& x,
                             Eigen::Ref<MatrixX<double>> J) {
    J.setZero();
    for (int k = 0; k <= rod; ++k) {
      const other_engine::Pose2 base = k == 0 ? other_engine::Pose2{0, 0, 0} : end_of(work, k - 1);
      J(0, k) = base.y - x[1];
      J(1, k) = x[0] - base.x;
      J(5, k) = 1;
    }
  }
  static Eigen::Matrix2d mass(const Arm& work) {
    MatrixX<double> J(6, 2);
    Eigen::Matrix2d M = Eigen::Matrix2d::Zero();
    for (int rod = 0; rod < 2; ++rod) {
      const other_engine::Pose2 end = end_of(work, rod);
      point_jacobian(work, work, rod, Vector3<double>(end.x, end.y, 0), J);
      M += J.topRows(3).transpose() * J.topRows(3);
    }
    return M;
  }
  static Eigen::Vector2d bias(const Arm& work,
                              const V& qd) {  // centrifugal and Coriolis, no gravity
    const double s = std::sin(work.angle[1]);
    return {-s * qd[1] * (2 * qd[0] + qd[1]), s * qd[0] * qd[0]};
  }
  static void inverse_dynamics(const Arm&, const V& qd, const V& qdd, Arm& work, Out torques) {
    torques = mass(work) * qdd + bias(work, qd);
  }
  static Index forward_dynamics(const Arm&, const V& qd, const V& torques, const V& diagonal,
                                Arm& work, Out qdd) {
    Eigen::Matrix2d M = mass(work);
    M.diagonal() += diagonal;
    qdd = M.inverse() * (torques - bias(work, qd));
    return -1;
  }
};

// The same arm with every optional hook. It counts the calls of position_jacobian.
namespace other_engine {

struct HookedArm : Arm {
  mutable int calls = 0;
  int number = 0;
};
struct HookedState : Arm {
  int number = 0;
};

}  // namespace other_engine

template <>
struct clothctl::articulated_traits<other_engine::HookedArm>
    : clothctl::articulated_traits<other_engine::Arm> {
  using workspace_type = other_engine::HookedState;
  using HookedArm = other_engine::HookedArm;
  static workspace_type make_workspace(const HookedArm& arm) {
    workspace_type state;
    state.number = arm.number;
    return state;
  }
  static int frames(const HookedArm&) { return 2; }
  static void position_jacobian(const HookedArm& arm, const workspace_type& work, int rod,
                                const Vector3<double>& x, const double& factor,
                                Eigen::Ref<MatrixX<double>> J) {
    ++arm.calls;
    MatrixX<double> twist(6, 2);
    point_jacobian(arm, work, rod, x, twist);
    J = factor * twist.topRows(3);
  }
  static bool workspace_fits(const HookedArm& arm, const workspace_type& work) {
    return arm.number == work.number;
  }
};

using namespace clothctl;
using other_engine::Arm;
using other_engine::HookedArm;

static_assert(ArticulatedDynamics<Arm> && ArticulatedDynamics<HookedArm>);
static_assert(!ArticulatedModel<int>);
static_assert(!ArticulatedDynamics<std::string>);

TEST_CASE("another engine's arm works in inverse kinematics and stable PD through the trait alone",
          "[concepts]") {
  const Arm arm;
  InverseKinematics<Arm> ik(arm, 1);
  VectorX<double> goal(2), q(2), qd = VectorX<double>::Zero(2), torques(2), qdd(2);
  goal << 0.4, 1.1;
  Arm there{{goal[0], goal[1]}};
  const other_engine::Pose2 end = end_of(there, 1);
  q << 0.1, 0.3;
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(1, Vector3<double>::Zero(), Vector3<double>(end.x, end.y, 0))};
  const IkReport<double> report = ik.solve(arm, tasks, VectorX<double>(), q);
  CHECK(report.status == IkStatus::Reached);
  CHECK((q - goal).norm() < 1e-3);

  auto settings = StablePdSettings<double>::uniform(2);
  StablePd<Arm> pd = StablePd<Arm>::create(arm, settings).value();
  Arm work = arm;
  VectorX<double> at = VectorX<double>::Zero(2);
  for (int k = 0; k < 500; ++k) {
    REQUIRE(
        pd.solve(arm, at, qd, q, VectorX<double>(), VectorX<double>(), work, torques, qdd).status ==
        PdStatus::Solved);
    qd += settings.dt * qdd;
    at += settings.dt * qd;
  }
  CHECK((at - q).norm() < 1e-6);
}

TEST_CASE("another engine's arm obeys the laws of robots", "[concepts]") {
  VectorX<double> q(2), other(2), qd(2), qdd(2);
  q << 0.4, -1.1;
  other << -2.0, 0.7;
  qd << 0.5, -0.8;
  qdd << 1.0, 2.0;
  clothctl_test::check_articulated_laws(Arm(), q, other, qd, 2, 1e-13);
  clothctl_test::check_articulated_dynamics_laws(Arm(), q, qd, qdd, 1e-12);
}

TEST_CASE("inverse kinematics gives the same result with and without the optional hooks",
          "[concepts]") {
  const Arm plain;
  HookedArm hooked;
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(1, Vector3<double>::Zero(), Vector3<double>(0.9, 1.2, 0))};
  VectorX<double> q(2), q_hooked(2);
  q << 0.1, 0.3;
  q_hooked = q;
  InverseKinematics<Arm> ik(plain, 1);
  InverseKinematics<HookedArm> ik_hooked(hooked, 1);
  const IkReport<double> report = ik.solve(plain, tasks, VectorX<double>(), q);
  CHECK(ik_hooked.solve(hooked, tasks, VectorX<double>(), q_hooked).iterations ==
        report.iterations);
  CHECK(q == q_hooked);
  CHECK(hooked.calls > 0);
}

TEST_CASE("a robot with the hook `frames` refuses a frame that does not exist", "[concepts]") {
  HookedArm arm;
  InverseKinematics<HookedArm> ik(arm, 1);
  InverseKinematics<Arm> plain(arm, 1);
  const Vector3<double> here = Vector3<double>::Zero();
  VectorX<double> q = VectorX<double>::Zero(2);
  for (const int frame : {-1, 2, 1 << 30}) {
    const std::vector<IkTask<double>> tasks = {IkTask<double>::position(frame, here, here)};
    CHECK(ik.solve(arm, tasks, VectorX<double>(), q).message == "a task's frame does not exist");
  }
  const std::vector<IkTask<double>> negative = {IkTask<double>::position(-1, here, here)};
  CHECK(plain.solve(arm, negative, VectorX<double>(), q).message ==
        "a task's frame does not exist");
}

TEST_CASE("a robot with the hook `workspace_fits` refuses another robot's workspace",
          "[concepts]") {
  HookedArm arm, other;
  other.number = 7;
  StablePd<HookedArm> pd =
      StablePd<HookedArm>::create(arm, StablePdSettings<double>::uniform(2)).value();
  auto own = articulated_traits<HookedArm>::make_workspace(arm),
       foreign = articulated_traits<HookedArm>::make_workspace(other);
  const VectorX<double> rest = VectorX<double>::Zero(2), none;
  VectorX<double> torques = rest, qdd = rest;
  CHECK(pd.solve(arm, rest, rest, rest, none, none, own, torques, qdd).status == PdStatus::Solved);
  CHECK(pd.solve(arm, rest, rest, rest, none, none, foreign, torques, qdd).status ==
        PdStatus::OtherWorkspace);
  InverseKinematics<HookedArm> ik(arm, 1);
  VectorX<double> q = rest;
  CHECK(ik.solve(other, {}, none, q).message ==
        "the robot is not the one that memory was made for");
}
