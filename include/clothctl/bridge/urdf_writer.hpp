#pragma once

// Writes robots as URDF text. The rotation of an origin is written as roll, pitch and yaw, R =
// Rz(yaw) Ry(pitch) Rx(roll):
//
//   yaw = atan2(R10, R00),   S = Rz(-yaw) R = Ry(pitch) Rx(roll)
//   pitch = atan2(-R20, S00),   roll = atan2(-S12, S11)
//
// Roll is computed from S and not from R, so that it is right at pitch = ±π/2 too. There yaw is
// arbitrary and roll compensates for it. Needs no library; urdf.hpp reads the text.

#include <cmath>
#include <optional>
#include <string>
#include <string_view>

#include "clothctl/config.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Writes elements line by line.
template <RealScalar Scalar>
class UrdfWriter {
 public:
  std::string text;

  void link(const std::string& name, const std::optional<Inertia<Scalar>>& inertia) {
    text += "  <link";
    attribute("name", escaped(name));
    if (!inertia) {
      text += "/>\n";
      return;
    }
    text += ">\n    <inertial>\n";
    origin("      ", inertia->com, Matrix3<Scalar>::Identity());
    text += "      <mass";
    attribute("value", number(inertia->mass));
    text += "/>\n      <inertia";
    const Matrix3<Scalar>& moments = inertia->about_com;
    const char* const names[3][3] = {{"ixx", "ixy", "ixz"}, {"", "iyy", "iyz"}, {"", "", "izz"}};
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) attribute(names[i][j], number(moments(i, j)));
    }
    text += "/>\n    </inertial>\n  </link>\n";
  }

  void joint(const Joint<Scalar>& joint) {
    const bool moves = joint.type == JointType::Revolute || joint.type == JointType::Prismatic;
    const JointLimits<Scalar>& limits = joint.limits;
    const bool endless = joint.type == JointType::Revolute && is_unbounded(limits.lower) &&
                         is_unbounded(limits.upper);
    text += "  <joint";
    attribute("name", escaped(joint.name));
    attribute("type", endless                         ? "continuous"
                      : joint.type == JointType::Free ? "floating"
                                                      : std::string(to_string(joint.type)));
    text += ">\n";
    origin("    ", joint.origin.p, joint.origin.R);
    text += "    <parent";
    attribute("link", escaped(joint.parent));
    text += "/>\n    <child";
    attribute("link", escaped(joint.child));
    text += "/>\n";
    if (moves) {
      text += "    <axis";
      attribute("xyz", triple(joint.axis));
      text += "/>\n    <limit";
      if (!endless) {
        attribute("lower", bound(limits.lower));
        attribute("upper", bound(limits.upper));
      }
      attribute("effort", bound(limits.effort));
      attribute("velocity", bound(limits.velocity));
      text += "/>\n";
    }
    if (moves && !joint.leader.empty()) {
      text += "    <mimic";
      attribute("joint", escaped(joint.leader));
      attribute("multiplier", number(joint.ratio));
      attribute("offset", number(joint.offset));
      text += "/>\n";
    }
    text += "  </joint>\n";
  }

  /// Returns a name as the value of an attribute. Control characters become numeric references,
  /// since readers turn tabs and line breaks into blanks.
  static std::string escaped(std::string_view name) {
    std::string out;
    for (const char c : name) {
      switch (c) {
        case '&': out += "&amp;"; break;
        case '<': out += "&lt;"; break;
        case '>': out += "&gt;"; break;
        case '"': out += "&quot;"; break;
        case '\'': out += "&apos;"; break;
        default:
          if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
            out += "&#" + std::to_string(static_cast<int>(c)) + ";";
          } else {
            out += c;
          }
      }
    }
    return out;
  }

  /// Returns roll, pitch and yaw of a rotation.
  static Vector3<Scalar> angles_of(const Matrix3<Scalar>& R) {
    using std::atan2;
    using std::cos;
    using std::sin;
    const Scalar yaw = neat(atan2(R(1, 0), R(0, 0))), c = cos(yaw), s = sin(yaw);
    const Scalar pitch = atan2(Scalar(-R(2, 0)), Scalar(c * R(0, 0) + s * R(1, 0)));
    const Scalar roll = atan2(Scalar(s * R(0, 2) - c * R(1, 2)), Scalar(c * R(1, 1) - s * R(0, 1)));
    return {neat(roll), neat(pitch), yaw};
  }

 private:
  void attribute(const char* name, const std::string& value) {
    text += ' ';
    text += name;
    text += "=\"" + value + '"';
  }

  void origin(const char* indent, const Vector3<Scalar>& p, const Matrix3<Scalar>& R) {
    const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0)), rpy = angles_of(R);
    if (p == zero && rpy == zero) return;
    text += indent;
    text += "<origin";
    attribute("xyz", triple(p));
    if (rpy != zero) attribute("rpy", triple(rpy));
    text += "/>\n";
  }

  static std::string triple(const Vector3<Scalar>& v) {
    return number(v[0]) + " " + number(v[1]) + " " + number(v[2]);
  }

  static std::string number(const Scalar& value) {
    return value < Scalar(0) || value > Scalar(0) || !is_finite(value) ? number_text(value) : "0";
  }

  static std::string bound(const Scalar& limit) {
    if (is_unbounded(limit)) return limit < Scalar(0) ? "-1e30" : "1e30";
    return number(limit);
  }

  /// Returns the angle, rounded to few digits if that changes it by no more than a few rounding
  /// errors. So an angle that was typed with few digits is written with the same digits.
  static Scalar neat(const Scalar& angle) {
    using std::abs;
    using std::round;
    Scalar scale(1);
    while (scale * scalar_traits<Scalar>::epsilon() < Scalar(1e-4)) scale *= Scalar(10);
    const Scalar rounded = round(angle * scale) / scale;
    return abs(rounded - angle) < Scalar(4) * scalar_traits<Scalar>::epsilon() ? rounded : angle;
  }
};

}  // namespace detail

/// Returns the links and joints of a robot as URDF text, in their order. A reader gets the same
/// robot: rotations differ by a few roundings, all other numbers are exact.
///
/// * A revolute joint without position limits becomes `continuous`, a free joint `floating`.
/// * Where URDF requires a limit and the robot has none, ±1e30 is written, which `read_urdf` reads
///   as "no limit".
/// * The upper triangle of an inertia tensor is written.
/// * Names must be UTF-8 without zero bytes. Other control characters are written as numeric
///   references, which not every reader accepts. `read_urdf` refuses names with `${` or `$(`, which
///   belong to xacro.
///
/// A robot that does not build gives a text that `read_urdf` refuses. Allocates. Complexity:
/// O(links + joints).
template <RealScalar Scalar>
std::string urdf_text(const KinematicTreeBuilder<Scalar>& robot, const std::string& name) {
  detail::UrdfWriter<Scalar> writer;
  writer.text =
      "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<robot name=\"" + writer.escaped(name) + "\">\n";
  for (const typename KinematicTreeBuilder<Scalar>::LinkEntry& link : robot.links())
    writer.link(link.name, link.inertia);
  for (const Joint<Scalar>& joint : robot.joints()) writer.joint(joint);
  return writer.text + "</robot>\n";
}

}  // namespace clothctl::inline CLOTHCTL_ABI
