#include "support/hand_pinch.hpp"

#include <limits>
#include <random>

#include "clothctl/grasp/grasp_poses.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "support/options.hpp"

namespace program {

using clothctl::Index;
using Tree = HandModel::Tree;
using Vec = clothctl::Vector3<double>;
using Mat = clothctl::Matrix3<double>;
using Vector = clothctl::VectorX<double>;
using Geometry = clothctl::HandGeometry<double>;
using Pad = clothctl::FingerPad<double>;

namespace {

int body_of(const Tree& tree, int link) {
  return tree.links()[static_cast<std::size_t>(link)].body;
}

/// x along the first vector, z against the second as far as that is across it.
Mat axes_of(const Vec& x, const Vec& down) {
  Mat out;
  out.col(0) = x.normalized();
  Vec z = out.col(0).dot(down) * out.col(0) - down;
  if (z.norm() < 1e-6) z = Vec(out.col(0)).unitOrthogonal();
  out.col(2) = z.normalized();
  out.col(1) = out.col(2).cross(out.col(0));
  return out;
}

clothctl::BodyPoses<double> poses_at(const Tree& tree, const Vector& q) {
  clothctl::BodyPoses<double> out(tree);
  (void)clothctl::forward_kinematics(tree, q, out);
  return out;
}

Vec tip(const Tree& tree, const clothctl::BodyPoses<double>& poses, const Pad& pad) {
  return link_pose(tree, poses, pad.frame) * pad.centre();
}

/// The middle of what is on the palm: the last body that carries both fingers.
Vec middle_of_palm(const Tree& tree, const Geometry& geometry,
                   const clothctl::BodyPoses<double>& poses) {
  const std::vector<bool> carriers = find_carriers(tree, geometry);
  int palm = -1;
  for (std::size_t b = 0; b < carriers.size(); ++b) {
    if (carriers[b]) palm = static_cast<int>(b);
  }
  Vec sum = Vec::Zero();
  int count = 0;
  for (const auto& c : geometry.capsules) {
    if (body_of(tree, c.frame) != palm) continue;
    sum += link_pose(tree, poses, c.frame) * Vec(0.5 * (c.from + c.to));
    ++count;
  }
  if (count > 0) return sum / count;
  return palm < 0 ? sum : link_pose(tree, poses, geometry.fingers[0].frame).p;
}

}  // namespace

std::vector<bool> find_carriers(const Tree& tree, const Geometry& geometry) {
  const auto& bodies = tree.bodies();
  std::vector<bool> first(bodies.size(), false), both(bodies.size(), false);
  const auto up = [&](int finger, auto&& visit) {
    int b = body_of(tree, geometry.fingers[static_cast<std::size_t>(finger)].frame);
    for (; b >= 0; b = bodies[static_cast<std::size_t>(b)].parent)
      visit(static_cast<std::size_t>(b));
  };
  up(0, [&](std::size_t b) { first[b] = true; });
  up(1, [&](std::size_t b) { both[b] = first[b]; });
  return both;
}

Pinch make_pinch_of(const Tree& tree, const Geometry& geometry, const Vector& posture,
                    const Vector& home) {
  const std::vector<bool> carriers = find_carriers(tree, geometry);
  const auto& bodies = tree.bodies();
  Pinch out;
  out.positions = tree.neutral();
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (carriers[b]) out.positions[bodies[b].position] = home[bodies[b].position];
  }
  for (const std::size_t k : {0u, 1u}) {
    int b = body_of(tree, geometry.fingers[k].frame);
    for (; b >= 0; b = bodies[static_cast<std::size_t>(b)].parent) {
      const Index i = bodies[static_cast<std::size_t>(b)].position;
      if (!carriers[static_cast<std::size_t>(b)]) out.positions[i] = posture[i];
    }
  }
  (void)clothctl::hand34_place_base<double>(tree, Mat::Identity(), Vec::Zero(), out.positions);
  const auto poses = poses_at(tree, out.positions);
  const Vec a = tip(tree, poses, geometry.fingers[0]), b = tip(tree, poses, geometry.fingers[1]);
  out.centre = 0.5 * (a + b);
  out.axes = axes_of(b - a, out.centre - middle_of_palm(tree, geometry, poses));
  return out;
}

Pinch find_pinch(const Tree& tree, const Geometry& geometry, const Vector& home) {
  const std::vector<Pad> fingers(geometry.fingers.begin(), geometry.fingers.begin() + 2);
  const auto poses = poses_at(tree, home);
  const Vec a = tip(tree, poses, fingers[0]), b = tip(tree, poses, fingers[1]);
  const Vec middle = 0.5 * (a + b), press = (b - a).normalized();
  const std::vector<clothctl::GraspContact<double>> contacts{{middle, press}, {middle, -press}};
  const auto found = clothctl::find_grasp_poses<Tree, double>(tree, fingers, contacts, home, home);
  if (found.status != clothctl::GraspPoseStatus::Found)
    refuse("the hand finds no pinch of " + fingers[0].name + " and " + fingers[1].name + ": " +
           found.message);
  return make_pinch_of(tree, geometry, found.touch, home);
}

Mat pinch_axes(const GraspPlace& at) { return axes_of(at.press, at.approach); }

Vector pinch_at(const Tree& tree, const std::vector<Pad>& fingers, const Pinch& pinch,
                const GraspPlace& at) {
  Vector q = pinch.positions;
  const Mat R = pinch_axes(at) * pinch.axes.transpose();
  const Vec t = at.place - R * pinch.centre;
  if (clothctl::hand34_place_base<double>(tree, R, t, q))
    return q.cwiseMax(tree.lower()).cwiseMin(tree.upper());
  const auto poses = poses_at(tree, q);
  std::vector<clothctl::IkTask<double>> tasks;
  for (const std::size_t k : {0u, 1u}) {
    const clothctl::Pose<double> now = link_pose(tree, poses, fingers[k].frame);
    tasks.push_back(
        clothctl::IkTask<double>::position(fingers[k].frame, Vec::Zero(), R * now.p + t));
    tasks.push_back(clothctl::IkTask<double>::orientation(fingers[k].frame, R * now.R));
  }
  std::mt19937_64 random(1);
  const auto uniform = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  clothctl::InverseKinematics<Tree, double> ik(tree, static_cast<int>(tasks.size()));
  (void)ik.solve(tree, tasks, pinch.positions, q, 20, uniform);
  return q;
}

double pinch_effort(const HandModel& hand, const GraspPlace& at) {
  using Dynamics = clothctl::articulated_traits<Tree>;
  const Vector q = hand.pinch_at(hand.tree, at);
  auto work = Dynamics::make_workspace(hand.tree);
  Dynamics::forward_kinematics(hand.tree, q, work);
  const auto poses = poses_at(hand.tree, q);
  const Vec a = tip(hand.tree, poses, hand.geometry.fingers[0]);
  const Vec b = tip(hand.tree, poses, hand.geometry.fingers[1]);
  const bool there =
      (0.5 * (a + b) - at.place).norm() < 1e-3 && 0.999 < (b - a).normalized().dot(at.press);
  if (!there) return std::numeric_limits<double>::infinity();
  const Vector still = Vector::Zero(hand.tree.nv());
  Vector torques = still;
  Dynamics::inverse_dynamics(hand.tree, still, still, work, torques);
  return torques.cwiseAbs().cwiseQuotient(hand.tree.effort_limits()).maxCoeff();
}

}  // namespace program
