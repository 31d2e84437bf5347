#include "support/hand_momentum.hpp"

#include <algorithm>

namespace program {

using Vec = clothctl::Vector3<double>;
using Vector = clothctl::VectorX<double>;
using Traits = clothctl::articulated_traits<clothctl::KinematicTree<double>>;

bool base_slides(const clothctl::KinematicTree<double>& tree) {
  if (tree.nv() < 3) return false;
  clothctl::Matrix3<double> R = clothctl::Matrix3<double>::Identity();
  for (int k = 0; k < 3; ++k) {
    const auto& body = tree.bodies()[static_cast<std::size_t>(k)];
    R *= body.placement.R;
    if (body.type != clothctl::JointType::Prismatic || !(R(k, 2) > 1 - 1e-12)) return false;
  }
  return true;
}

double momentum_residual(clothctl::World<double>& world, const clothctl::HandInWorld& parts,
                         const clothctl::KinematicTree<double>& tree,
                         const clothctl::HandState<double>& before, double dt) {
  // The base slides along x, y and z: its rows of M a + C + g are forces, and those that its joints
  // and the sheet do not exert are missing.
  const clothctl::HandState<double>& now = world.hand(parts.hand);
  const Vector change = (now.velocities - before.velocities) / dt;
  const Vector& torques = world.torques(parts.hand);
  Vector needed = Vector::Zero(torques.size());
  auto work = Traits::make_workspace(tree);
  Traits::forward_kinematics(tree, before.positions, work);
  Traits::inverse_dynamics(tree, before.velocities, change, work, needed);
  Vec on_sheet = Vec::Zero();
  double size = 1;  // N
  const auto add = [&](const Vec& impulse) {
    on_sheet += impulse / dt;
    size = std::max(size, impulse.norm() / dt);
  };
  for (const int pad : {parts.pads[0], parts.pads[1]}) {
    for (const auto& c : world.pad_contacts(pad)) add(c.impulse);
  }
  for (const auto& c : world.contacts(0)) {
    const auto end = parts.shapes.end();
    if (std::find(parts.shapes.begin(), end, c.obstacle) != end) add(c.impulse);
  }
  const Vec missing = (needed - torques).head<3>() + on_sheet;
  return missing.norm() / size;
}

}  // namespace program
