#include "support/hand_base.hpp"

#include "clothctl/core/number_text.hpp"
#include "clothctl/math/rotation.hpp"

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
  const Vec turn = clothctl::roll_pitch_yaw_from_rotation<double>(origin.R);
  const Vec& p = origin.p;
  return out + between("base_to_hand", "fixed", parent, child) +
         "<origin xyz=" + quoted(p[0], p[1], p[2]) + " rpy=" + quoted(turn[0], turn[1], turn[2]) +
         "/></joint>";
}

}  // namespace program
