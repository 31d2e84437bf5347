#include "clothctl/grasp/rectify.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Vec = Vector3<double>;
const VectorX<double> kNoWeights;

Points<double> noise(unsigned seed, Index n, double size) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, size);
  return Points<double>::NullaryExpr(3, n, [&] { return normal(random); });
}

/// A patch of 9 mm on a fingertip, nearly flat.
Points<double> patch() {
  Points<double> p = noise(1, 8, 0.004);
  p.row(2) *= 0.05;
  p.colwise() += Vec(0.02, 0, -0.007);
  return p;
}

Points<double> moved(const Matrix3<double>& R, const Vec& t, const Points<double>& p) {
  Points<double> out = R * p;
  out.colwise() += t;
  return out;
}

}  // namespace

TEST_CASE("a rigid plan gives its pose, with no residual", "[grasp]") {
  const Matrix3<double> R = rotation_exp<double>(Vec(0.3, -0.2, 0.5));
  const Vec t(0.1, -0.3, 0.4);
  const Points<double> local = patch();
  const auto target = rectify<double>(local, moved(R, t, local), kNoWeights,
                                      rotation_exp<double>(Vec(0.2, -0.2, 0.4)));
  CHECK(target.status == RectifyStatus::Pose);
  CHECK((target.R_world_frame - R).norm() < 1e-9);
  CHECK((target.position - t).norm() < 1e-11);
  CHECK(target.rms_residual < 1e-12);
  CHECK_FALSE(target.unrigid);
  CHECK((target.at(local.col(3)) - R * local.col(3) - t).norm() < 1e-11);
}

TEST_CASE("of an unrigid plan the centroid is kept, and the residual is the least", "[grasp]") {
  const Matrix3<double> R = rotation_exp<double>(Vec(0.1, 0.4, -0.3));
  const Points<double> local = patch(),
                       planned = moved(R, Vec(0.1, 0, 0), local) + noise(2, 8, 1e-3);
  VectorX<double> weights(8);
  weights << 1, 2, 0.5, 1, 0, 3, 1, 1;
  const auto target = rectify<double>(local, planned, weights, R);
  REQUIRE(target.found());
  const Vec centre = planned * weights / weights.sum();
  CHECK((target.at(local * weights / weights.sum()) - centre).norm() < 1e-12);
  CHECK((target.centroid - centre).norm() < 1e-15);
  const auto cost = [&](const Matrix3<double>& turn, const Vec& at) {
    double sum = 0;
    for (Index j = 0; j < 8; ++j)
      sum += weights[j] * (planned.col(j) - turn * local.col(j) - at).squaredNorm();
    return sum;
  };
  const double best = cost(target.R_world_frame, target.position);
  CHECK(std::sqrt(best / weights.sum()) == Approx(target.rms_residual).epsilon(1e-9));
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Points<double> by = noise(10 + seed, 2, 1e-3);
    CHECK(best <= cost(rotation_exp<double>(Vec(by.col(0))) * target.R_world_frame,
                       target.position + 0.01 * by.col(1)));
  }
  CHECK(target.unrigid);  // 1 mm of noise on a patch of 5 mm
}

TEST_CASE("a turn that points do not determine is that of the segment now", "[grasp]") {
  const Matrix3<double> now = rotation_exp<double>(Vec(0.4, 0.1, -0.6));
  Points<double> local(3, 3);
  local << 0, 0.004, 0.008, 0, 0, 0, 0.001, 0.001, 0.001;
  const Vec by(0.05, 0.02, 0);
  SECTION("points on a line that moves without turning") {
    const auto target = rectify<double>(local, moved(now, by, local), kNoWeights, now);
    CHECK(target.status == RectifyStatus::FreeTurn);
    CHECK((target.R_world_frame - now).norm() < 1e-9);
    CHECK(std::abs(target.free_axis.dot(now.col(0))) == Approx(1));
  }
  SECTION("a line that turns: the shortest turn there") {
    const Matrix3<double> R = rotation_exp<double>(Vec(0.3 * now.col(1))) * now;
    const auto target = rectify<double>(local, moved(R, by, local), kNoWeights, now);
    CHECK(target.status == RectifyStatus::FreeTurn);
    CHECK((target.R_world_frame - R).norm() < 1e-8);
  }
  SECTION("two points") {
    const Points<double> two = local.leftCols(2);
    const auto target = rectify<double>(two, moved(now, by, two), kNoWeights, now);
    CHECK(target.status == RectifyStatus::FreeTurn);
    CHECK((target.R_world_frame - now).norm() < 1e-9);
  }
  SECTION("one point") {
    const Points<double> one = local.leftCols(1);
    const auto target = rectify<double>(one, moved(now, by, one), kNoWeights, now);
    CHECK(target.status == RectifyStatus::Place);
    CHECK((target.R_world_frame - now).norm() < 1e-12);
    CHECK((target.at(one.col(0)) - now * one.col(0) - by).norm() < 1e-12);
    CHECK_FALSE(target.unrigid);
  }
  SECTION("no point, or none with weight") {
    CHECK(rectify<double>(Points<double>(3, 0), Points<double>(3, 0), kNoWeights, now).status ==
          RectifyStatus::NoPoints);
    CHECK(rectify<double>(local, local, VectorX<double>::Zero(3), now).status ==
          RectifyStatus::NoPoints);
  }
}

TEST_CASE("noise on a narrow patch does not turn the segment about it", "[grasp]") {
  // 20 mm long, 0.02 mm wide: fitted, 10 um of noise would turn it by 20 degrees.
  Points<double> local = Points<double>::Zero(3, 12);
  for (Index j = 0; j < 12; ++j) local.col(j) = Vec(0.02 * double(j) / 11, j % 2 ? 1e-5 : -1e-5, 0);
  const Matrix3<double> now = rotation_exp<double>(Vec(0.1, 0.2, 0.3));
  const Points<double> planned = moved(now, Vec(0.1, 0, 0), local) + noise(4, 12, 1e-5);
  const auto target = rectify<double>(local, planned, kNoWeights, now);
  CHECK(target.status == RectifyStatus::FreeTurn);
  CHECK(rotation_log<double>(target.R_world_frame * now.transpose()).norm() < 0.01);
}

TEST_CASE("bad input is named, and the segment keeps its rotation", "[grasp]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Points<double> local = patch();
  const Matrix3<double> now = rotation_exp<double>(Vec(0.1, 0.2, 0.3));
  Points<double> broken = local;
  broken(1, 3) = nan;
  const auto refused = [&](const SegmentTarget<double>& target) {
    return target.status == RectifyStatus::InvalidInput && !target.message.empty() &&
           !target.found();
  };
  CHECK(refused(rectify<double>(broken, local, kNoWeights, now)));
  CHECK(refused(rectify<double>(local, broken, kNoWeights, now)));
  CHECK(refused(rectify<double>(local, local.leftCols(3), kNoWeights, now)));
  CHECK(refused(rectify<double>(local, local, VectorX<double>::Constant(8, -1.0), now)));
  CHECK(refused(rectify<double>(local, local, kNoWeights, Matrix3<double>(nan * now))));
  CHECK(refused(rectify<double>(local, local, kNoWeights, Matrix3<double>::Zero())));
  RectifySettings<double> settings;
  settings.unrigid_share = 0;
  CHECK(refused(rectify<double>(local, local, kNoWeights, now, settings)));
  CHECK(rectify<double>(broken, local, kNoWeights, now).R_world_frame == now);
}

TEST_CASE("tasks of a target bring a finger there", "[grasp]") {
  using Robot = articulated_traits<KinematicTree<double>>;
  const auto tree = hand34<double>();
  auto work = Robot::make_workspace(tree);
  const VectorX<double> start = hand34_home(tree);
  const int frame = tree.find_link("index_distal");
  Matrix3<double> R;
  Vec p;
  Robot::forward_kinematics(tree, start, work);
  Robot::frame_pose(tree, work, frame, R, p);
  const Matrix3<double> turned = rotation_exp<double>(Vec(0.05, -0.1, 0.08)) * R;
  const Vec there = p + Vec(0.01, 0.005, 0.01);
  InverseKinematics<KinematicTree<double>> ik(tree, 8, {});
  for (const Index count : {Index(8), Index(2), Index(1)}) {
    const Points<double> local = patch().leftCols(count);
    const auto target = rectify<double>(local, moved(turned, there, local), kNoWeights, R);
    for (const SegmentTasks kind : {SegmentTasks::Points, SegmentTasks::Pose}) {
      std::vector<IkTask<double>> tasks;
      add_segment_tasks<double>(target, frame, local, kind, tasks);
      CHECK(tasks.size() == std::size_t(kind == SegmentTasks::Points ? count : count > 1 ? 2 : 1));
      VectorX<double> q = start;
      REQUIRE(ik.solve(tree, tasks, start, q).status == IkStatus::Reached);
      Robot::forward_kinematics(tree, q, work);
      Matrix3<double> R_end;
      Vec p_end;
      Robot::frame_pose(tree, work, frame, R_end, p_end);
      CHECK((moved(R_end, p_end, local) - moved(turned, there, local)).cwiseAbs().maxCoeff() <
            3e-4);
    }
  }
  std::vector<IkTask<double>> none;
  add_segment_tasks<double>({}, frame, patch(), SegmentTasks::Pose, none);
  CHECK(none.empty());
}

TEST_CASE("rectification never allocates", "[grasp]") {
  const Points<double> local = patch();
  const Matrix3<double> now = Matrix3<double>::Identity();
  const long before = clothctl_test::allocations();
  const auto target = rectify<double>(local, local, kNoWeights, now);
  const long allocated = clothctl_test::allocations() - before;
  REQUIRE(target.found());
  if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
}
