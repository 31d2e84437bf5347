#include "support/hand_base.hpp"

#include <cmath>

#include "clothctl/core/number_text.hpp"

namespace program {

using Vec = clothctl::Vector3<double>;

void add_base(clothctl::KinematicTreeBuilder<double>& builder, const std::string& child,
              const clothctl::Pose<double>& origin) {
  std::string parent = "ground";
  builder.add_link(parent);
  for (const BaseJoint& part : kBaseJoints) {
    clothctl::Inertia<double> body;
    body.mass = kBaseMass;
    body.about_com.diagonal().setConstant(kBaseMoment);
    clothctl::Joint<double> joint;
    joint.name = part.name;
    joint.type = part.type;
    joint.parent = parent;
    joint.child = parent = part.name + std::string("_part");
    joint.axis = Vec::Unit(part.axis);
    joint.limits.lower = -part.limit;
    joint.limits.upper = part.limit;
    joint.limits.effort = part.effort;
    builder.add_link(parent, body).add_joint(joint);
  }
  clothctl::Joint<double> last;
  last.name = "base_to_hand";
  last.type = clothctl::JointType::Fixed;
  last.parent = parent;
  last.child = child;
  last.origin = origin;
  builder.add_joint(last);
}

std::string base_urdf(const std::string& child, const clothctl::Pose<double>& origin, bool moves) {
  const auto quoted = [](double a, double b, double c) {
    return '"' + clothctl::number_text(a) + ' ' + clothctl::number_text(b) + ' ' +
           clothctl::number_text(c) + '"';
  };
  const auto number = [](double a) { return '"' + clothctl::number_text(a) + '"'; };
  const auto between = [](const std::string& name, const std::string& type, const std::string& from,
                          const std::string& to) {
    return "<joint name=\"" + name + "\" type=\"" + type + "\"><parent link=\"" + from +
           "\"/><child link=\"" + to + "\"/>";
  };
  std::string parent = "ground", out = "<link name=\"ground\"/>";
  for (const BaseJoint& part : kBaseJoints) {
    if (!moves) break;
    const std::string link = part.name + std::string("_part"), moment = number(kBaseMoment);
    const Vec axis = Vec::Unit(part.axis);
    out += "<link name=\"" + link + "\"><inertial><mass value=" + number(kBaseMass) +
           "/><inertia ixx=" + moment + " iyy=" + moment + " izz=" + moment +
           " ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>";
    out += between(part.name, std::string(to_string(part.type)), parent, link) +
           "<axis xyz=" + quoted(axis[0], axis[1], axis[2]) +
           "/><limit velocity=\"100\" lower=" + number(-part.limit) +
           " upper=" + number(part.limit) + " effort=" + number(part.effort) + "/></joint>";
    parent = link;
  }
  // R = Rz Ry Rx. Where Ry is a quarter turn, Rz is none.
  const clothctl::Matrix3<double>& R = origin.R;
  const bool locked = std::hypot(R(0, 0), R(1, 0)) < 1e-9;
  const double yaw = locked ? 0 : std::atan2(R(1, 0), R(0, 0));
  const double pitch = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  const double roll = locked ? std::atan2(-R(1, 2), R(1, 1)) : std::atan2(R(2, 1), R(2, 2));
  const Vec& p = origin.p;
  return out + between("base_to_hand", "fixed", parent, child) +
         "<origin xyz=" + quoted(p[0], p[1], p[2]) + " rpy=" + quoted(roll, pitch, yaw) +
         "/></joint>";
}

}  // namespace program
