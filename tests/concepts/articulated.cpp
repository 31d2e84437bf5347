#include "clothctl/concepts/articulated.hpp"

#include <cmath>

#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "laws/articulated_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// A planar arm of two unit rods with unit masses at their ends, from an engine that keeps its state in the robot.
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
  static Index positions(const Arm&) { return 2; }
  static Index velocities(const Arm&) { return 2; }
  static VectorX<double> lower(const Arm&) { return VectorX<double>::Constant(2, -3.0); }
  static VectorX<double> upper(const Arm&) { return VectorX<double>::Constant(2, 3.0); }
  static VectorX<double> effort_limits(const Arm&) { return VectorX<double>::Constant(2, 100.0); }
  static void advance(const Arm&, const V& q, const V& step, Out out) { out = q + step; }
  static void difference(const Arm&, const V& from, const V& to, Out out) { out = to - from; }
  static void place(const Arm&, const V& q, Arm& work) {
    work.angle[0] = q[0];
    work.angle[1] = q[1];
  }
  static void frame_pose(const Arm&, const Arm& work, int rod, Matrix3<double>& R, Vector3<double>& p) {
    const other_engine::Pose2 pose = end_of(work, rod);
    R << std::cos(pose.turn), -std::sin(pose.turn), 0, std::sin(pose.turn), std::cos(pose.turn), 0, 0, 0, 1;
    p << pose.x, pose.y, 0;
  }
  static void point_jacobian(const Arm&, const Arm& work, int rod, const Vector3<double>& x, Eigen::Ref<MatrixX<double>> J) {
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
  static Eigen::Vector2d bias(const Arm& work, const V& qd) {  // centrifugal and Coriolis, no gravity
    const double s = std::sin(work.angle[1]);
    return {-s * qd[1] * (2 * qd[0] + qd[1]), s * qd[0] * qd[0]};
  }
  static void inverse_dynamics(const Arm&, const V& qd, const V& qdd, Arm& work, Out torques) {
    torques = mass(work) * qdd + bias(work, qd);
  }
  static Index forward_dynamics(const Arm&, const V& qd, const V& torques, const V& diagonal, Arm& work, Out qdd) {
    Eigen::Matrix2d M = mass(work);
    M.diagonal() += diagonal;
    qdd = M.inverse() * (torques - bias(work, qd));
    return -1;
  }
};

using namespace clothctl;
using other_engine::Arm;

static_assert(ArticulatedDynamics<Arm>);
static_assert(!ArticulatedModel<int>);
static_assert(!ArticulatedDynamics<std::string>);

TEST_CASE("another engine's arm reaches and is driven through the trait alone", "[concepts]") {
  const Arm arm;
  robot::InverseKinematics<Arm> ik(arm, 1);
  VectorX<double> goal(2), q(2), qd = VectorX<double>::Zero(2), torques(2), qdd(2);
  goal << 0.4, 1.1;
  Arm there{{goal[0], goal[1]}};
  const other_engine::Pose2 end = end_of(there, 1);
  q << 0.1, 0.3;
  const std::vector<robot::IkTask<double>> tasks = {
      robot::IkTask<double>::position(1, Vector3<double>::Zero(), Vector3<double>(end.x, end.y, 0))};
  const robot::IkReport<double> report = ik.solve(arm, tasks, VectorX<double>(), q);
  CHECK(report.status == robot::IkStatus::Reached);
  CHECK((q - goal).norm() < 1e-3);

  auto settings = robot::StablePdSettings<double>::uniform(2);
  robot::StablePd<Arm> pd = robot::StablePd<Arm>::make(arm, settings).value();
  Arm work = arm;
  VectorX<double> at = VectorX<double>::Zero(2);
  for (int k = 0; k < 500; ++k) {
    REQUIRE(pd.solve(arm, at, qd, q, VectorX<double>(), VectorX<double>(), work, torques, qdd).status ==
            robot::PdStatus::Solved);
    qd += settings.step * qdd;
    at += settings.step * qd;
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
