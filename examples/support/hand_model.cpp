#include "support/hand_model.hpp"

#include "clothctl/robot/hand34.hpp"
#include "support/hand_base.hpp"
#include "support/hand_pinch.hpp"

namespace program {

using Vec = clothctl::Vector3<double>;

namespace {

/// A box of this mass and these sides around `centre`.
clothctl::Inertia<double> box(double mass, const Vec& sides, const Vec& centre) {
  clothctl::Inertia<double> out;
  out.mass = mass;
  out.com = centre;
  const Vec s = sides.cwiseAbs2() * (mass / 12);
  out.about_com.diagonal() = Vec(s[1] + s[2], s[0] + s[2], s[0] + s[1]);
  return out;
}

}  // namespace

HandModel make_hand34() {
  HandModel out;
  out.tree = clothctl::hand34<double>();
  out.geometry = clothctl::hand34_geometry(out.tree);
  out.home = clothctl::hand34_home(out.tree);
  out.control = clothctl::StablePdSettings<double>::uniform(out.tree.nv());
  out.pinch_at = [](const HandModel::Tree& tree, const GraspPlace& at) {
    return clothctl::hand34_pinch_at<double>(tree, at.place, at.press, at.approach);
  };
  return out;
}

HandModel make_gripper() {
  // The jaws hang down and close along x, the left one from -x.
  constexpr double kOpen = 0.045, kLong = 0.12, kRadius = 0.015;  // m
  clothctl::KinematicTreeBuilder<double> builder;
  builder.add_link("palm", box(0.5, Vec(0.12, 0.05, 0.06), Vec::Zero()));
  add_base(builder, "palm");
  for (const double side : {-1.0, 1.0}) {
    clothctl::Joint<double> joint;
    joint.name = side < 0 ? "left" : "right";
    joint.type = clothctl::JointType::Prismatic;
    joint.parent = "palm";
    joint.child = joint.name + "_jaw";
    joint.origin.p = Vec(side * kOpen, 0, 0);
    joint.axis = Vec(-side, 0, 0);
    joint.limits = {0, kOpen - 0.5 * kRadius, 1, 100};
    if (side > 0) joint.leader = "left";
    const Vec sides(0.02, 0.02, kLong);
    builder.add_link(joint.child, box(0.05, sides, Vec(0, 0, -0.5 * kLong))).add_joint(joint);
  }
  HandModel out;
  out.tree = builder.build().value();
  const int palm = out.tree.find_link("palm");
  out.geometry.capsules.push_back({palm, Vec(-0.05, 0, 0), Vec(0.05, 0, 0), 0.025});
  for (const double side : {-1.0, 1.0}) {
    const std::string name = side < 0 ? "left" : "right";
    const int jaw = out.tree.find_link(name + "_jaw");
    // A ball that stands out from its shaft pinches at a point, as fingertips do.
    const Vec ball(0, 0, -kLong), back(side * 0.012, 0, 0);
    out.geometry.capsules.push_back({jaw, back, ball + back, 6e-3});
    out.geometry.capsules.push_back({jaw, ball, ball, kRadius});
    const Vec inward(-side, 0, 0);
    out.geometry.fingers.push_back({name, jaw, ball + kRadius * inward, inward, kRadius});
  }
  out.home = out.tree.neutral();
  out.control = clothctl::StablePdSettings<double>::uniform(out.tree.nv());
  const clothctl::Index motor = out.tree.nv() - 1;  // a slider: a spring of N/m, not of N m/rad
  out.control.kp[motor] = 2e4;
  out.control.kd[motor] = 1000;
  out.approach_speed = 0.2;
  const Pinch pinch = find_pinch(out.tree, out.geometry, out.home);
  out.pinch_at = [pinch, fingers = out.geometry.fingers](const HandModel::Tree& tree,
                                                         const GraspPlace& at) {
    return pinch_at(tree, fingers, pinch, at);
  };
  return out;
}

}  // namespace program
