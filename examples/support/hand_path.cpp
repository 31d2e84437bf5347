#include "support/hand_path.hpp"

#include <algorithm>
#include <cmath>

#include "support/hand_figures.hpp"

namespace program {

using clothctl::Body;
using clothctl::Index;
using clothctl::JointType;
using clothctl::KinematicTree;
using Vec = Eigen::Vector3d;

HandPath::HandPath(const KinematicTree<double>& tree, const Eigen::VectorXd& home, bool hold)
    : tree_(tree), home_(home), hold_(hold) {
  // From rest to full speed, then around a loop of two long and two short sides with rounded
  // corners, and slightly up and down.
  constexpr double v = kSpeed;
  const auto go = [this](double duration, const Vec& velocity) {
    const Key& last = keys_.back();
    keys_.push_back(
        {last.time + duration, last.place + 0.5 * duration * (last.velocity + velocity), velocity});
  };
  const Vec rest = Vec::Zero(), along(v, 0, 0), across(0, 0.8 * v, 0.6 * v),
            down(0, -0.8 * v, -0.6 * v);
  keys_.push_back({0, Vec(-0.24, -0.12, -0.06), rest});
  go(1.0, along);
  for (const auto& [duration, velocity] :
       {std::pair(0.6, along), std::pair(1.1, across), std::pair(0.2, across),
        std::pair(1.1, Vec(-along)), std::pair(0.6, Vec(-along)), std::pair(1.1, down),
        std::pair(0.2, down), std::pair(1.1, along)})
    go(duration, velocity);

  clothctl::BodyPoses<double> body_poses(tree);
  clothctl::forward_kinematics<double>(tree, home, body_poses);
  axes_.assign(tree.bodies().size(), Vec::Zero());
  int fingers = 0;
  for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
    const Body<double>& body = tree.bodies()[i];
    if (body.type == JointType::Free || body.follows) continue;
    const double low = tree.lower()[body.position], high = tree.upper()[body.position],
                 range = high - low;
    const bool base = body.parent < 0 || axes_[static_cast<std::size_t>(body.parent)].norm() > 0;
    if (body.type == JointType::Prismatic) {
      if (base && range > 0.8) axes_[i] = body_poses.poses[i].R.col(2);
      slides_ = slides_ || axes_[i].norm() > 0;
      continue;
    }
    if (!(range < 6)) continue;
    // Joints that bend mainly one way close; those that bend both ways swing a little. Each finger
    // has its own phase.
    if (body.parent >= 0 &&
        tree.bodies()[static_cast<std::size_t>(body.parent)].subtree_end > body.subtree_end)
      ++fingers;
    const double room = high - home[body.position];
    const bool bends = high > 2 * std::abs(low) && range < 2.5;
    const double amount = bends ? 0.45 * room : std::min(0.12, 0.5 * room);
    oscillations_.push_back({body.position, body.velocity, amount, 2.0 + 0.2 * (fingers % 4)});
  }
}

double HandPath::wrapped(double t) const {
  const double begin = keys_[1].time, round = keys_.back().time - begin;
  return t < begin ? t : begin + std::fmod(t - begin, round);
}

bool HandPath::is_straight(double t0, double t1) const {
  const double a = wrapped(t0), b = wrapped(t1);
  for (std::size_t k = 1; k < keys_.size(); ++k) {
    const Key &from = keys_[k - 1], &to = keys_[k];
    if (from.time <= a && a <= b && b <= to.time)
      return slides_ && !hold_ && (from.velocity - to.velocity).norm() < 1e-12;
  }
  return false;
}

void HandPath::at(double t, Eigen::VectorXd& q, Eigen::VectorXd& qd) const {
  q = home_;
  qd.setZero(tree_.nv());
  if (hold_) return;
  const double now = wrapped(t);
  std::size_t k = 1;
  while (k + 1 < keys_.size() && keys_[k].time < now) ++k;
  const Key &from = keys_[k - 1], &to = keys_[k];
  const double T = to.time - from.time, s = std::clamp((now - from.time) / T, 0.0, 1.0);
  const Vec change = to.velocity - from.velocity;
  const Vec place = from.place + from.velocity * (s * T) + change * (T * s * s * s * (1 - 0.5 * s));
  const Vec velocity = from.velocity + change * (s * s * (3 - 2 * s));
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (!(axes_[i].norm() > 0)) continue;
    const Body<double>& body = tree_.bodies()[i];
    q[body.position] = std::clamp(q[body.position] + axes_[i].dot(place),
                                  tree_.lower()[body.position], tree_.upper()[body.position]);
    qd[body.velocity] = axes_[i].dot(velocity);
  }
  for (const Oscillation& oscillation : oscillations_) {
    // Back and forth, at rest at both ends.
    const double phase = std::fmod(t, oscillation.period) / (0.5 * oscillation.period);
    const bool back = phase > 1;
    q[oscillation.position] +=
        oscillation.amount * (back ? 1 - smooth_share(phase - 1) : smooth_share(phase));
    qd[oscillation.velocity] = (back ? -1 : 1) * oscillation.amount *
                               smooth_speed(back ? phase - 1 : phase) / (0.5 * oscillation.period);
  }
}

}  // namespace program
