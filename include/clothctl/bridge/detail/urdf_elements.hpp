#pragma once

// Reads the elements of URDF: links with their inertia, and joints. The element <origin> gives the
// pose of a joint's frame in its parent link, or of a link's inertia in the link:
//
//   T = Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)
//
// An inertia tensor I given in axes with rotation R is R I Rᵀ in the link's axes.

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "clothctl/bridge/detail/urdf_xml.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/math/symmetric_eigen.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The URDF reader refuses robots with more links than this.
inline constexpr std::size_t kLargestUrdfLinks = 10000;

namespace detail {

/// A link as it is in the file.
template <RealScalar Scalar>
struct LinkEntry {
  std::string name;
  std::optional<Inertia<Scalar>> inertia;
  int line = 0, inertial_line = 0;
  int mover = -1;  // index of the joint that moves it
};

/// A joint as it is in the file.
template <RealScalar Scalar>
struct JointEntry {
  Joint<Scalar> joint;
  int line = 0, parent_line = 0, child_line = 0, mimic_line = 0;
  Scalar damping = Scalar(0), friction = Scalar(0);
};

/// Reads links and joints one by one. It does not check that the links and joints to which a joint
/// refers exist.
template <RealScalar Scalar>
class ElementReader : public XmlReader {
 public:
  using XmlReader::XmlReader;

 protected:
  bool read_link(const XmlElement& e) {
    LinkEntry<Scalar> entry;
    entry.line = entry.inertial_line = e.GetLineNum();
    if (!word(e, "name", entry.name)) return false;
    enter("link", entry.name);
    if (links_.size() == kLargestUrdfLinks)
      return fail_in(entry.line, "more than " + std::to_string(links_.size()) + " links");
    const auto [known, fresh] = link_names_.emplace(entry.name, static_cast<int>(links_.size()));
    if (!fresh)
      return fail_in(entry.line,
                     "occurs twice, first in line " + std::to_string(link(known->second).line));
    warn_of_unknown(e, {"inertial", "visual", "collision", "contact", "sensor"});
    const XmlElement* inertial = nullptr;
    if (!find(e, "inertial", inertial)) return false;
    if (inertial != nullptr) {
      entry.inertial_line = inertial->GetLineNum();
      if (!read_inertia(*inertial, entry.inertia.emplace())) return false;
    }
    links_.push_back(std::move(entry));
    return true;
  }

  bool read_joint(const XmlElement& e) {
    JointEntry<Scalar> entry;
    Joint<Scalar>& j = entry.joint;
    entry.line = e.GetLineNum();
    if (!word(e, "name", j.name)) return false;
    enter("joint", j.name);
    const auto [known, fresh] = joint_names_.emplace(j.name, static_cast<int>(joints_.size()));
    if (!fresh)
      return fail_in(entry.line,
                     "occurs twice, first in line " + std::to_string(joint(known->second).line));
    std::string type;
    if (!word(e, "type", type) || !read_type(e, type, j.type)) return false;
    warn_of_unknown(e, {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic",
                        "calibration", "safety_controller"});
    const XmlElement *parent = nullptr, *child = nullptr, *mimic = nullptr;
    if (!read_origin(e, j.origin) || !need(e, "parent", parent) ||
        !word(*parent, "link", j.parent) || !need(e, "child", child) ||
        !word(*child, "link", j.child) || !find(e, "mimic", mimic))
      return false;
    entry.parent_line = parent->GetLineNum();
    entry.child_line = child->GetLineNum();
    if (mimic != nullptr) {
      entry.mimic_line = mimic->GetLineNum();
      if (!word(*mimic, "joint", j.leader) || !number_if_given(*mimic, "multiplier", j.ratio) ||
          !number_if_given(*mimic, "offset", j.offset))
        return false;
    }
    if (j.type == JointType::Revolute || j.type == JointType::Prismatic) {
      const XmlElement* axis = nullptr;
      if (!find(e, "axis", axis) || (axis != nullptr && !triple(*axis, "xyz", j.axis)))
        return false;
      if (!read_limits(e, type == "continuous", j.limits) || !read_dynamics(e, entry)) return false;
    }
    joints_.push_back(std::move(entry));
    return true;
  }

  static int lookup(const std::unordered_map<std::string, int>& names, const std::string& name) {
    const auto found = names.find(name);
    return found == names.end() ? -1 : found->second;
  }
  /// Returns the index of the link of that name, or -1.
  int find_link(const std::string& name) const { return lookup(link_names_, name); }
  /// Returns the index of the joint of that name, or -1.
  int find_joint(const std::string& name) const { return lookup(joint_names_, name); }
  LinkEntry<Scalar>& link(int k) { return links_[static_cast<std::size_t>(k)]; }
  JointEntry<Scalar>& joint(int k) { return joints_[static_cast<std::size_t>(k)]; }

  std::vector<LinkEntry<Scalar>> links_;
  std::vector<JointEntry<Scalar>> joints_;

 private:
  bool read_inertia(const XmlElement& e, Inertia<Scalar>& inertia) {
    Pose<Scalar> pose;
    const XmlElement *mass = nullptr, *tensor = nullptr;
    if (!read_origin(e, pose) || !need(e, "mass", mass) || !need(e, "inertia", tensor))
      return false;
    Matrix3<Scalar> moments;
    if (!number(*mass, "value", inertia.mass) || !number(*tensor, "ixx", moments(0, 0)) ||
        !number(*tensor, "ixy", moments(0, 1)) || !number(*tensor, "ixz", moments(0, 2)) ||
        !number(*tensor, "iyy", moments(1, 1)) || !number(*tensor, "iyz", moments(1, 2)) ||
        !number(*tensor, "izz", moments(2, 2)))
      return false;
    moments(1, 0) = moments(0, 1);
    moments(2, 0) = moments(0, 2);
    moments(2, 1) = moments(1, 2);
    check_tensor(*tensor, moments);
    inertia.com = pose.p;
    inertia.about_com.noalias() = pose.R * moments * pose.R.transpose();
    return true;
  }

  /// Warns of an inertia tensor that no body can have: one whose principal moments a ≤ b ≤ c
  /// violate a ≥ 0 or a + b ≥ c.
  void check_tensor(const XmlElement& e, const Matrix3<Scalar>& inertia) {
    const Scalar size = inertia.cwiseAbs().maxCoeff();
    if (!(size > Scalar(0))) return;
    const Matrix3<Scalar> unit = inertia / size;
    Vector3<Scalar> moments = symmetric_eigen<Scalar>(unit).values;
    std::sort(moments.data(), moments.data() + 3);
    const Scalar loose = Scalar(1) / Scalar(1000);  // tensors are often given with few digits
    if (moments[0] > -loose && moments[0] + moments[1] > moments[2] - loose) return;
    std::string text;
    for (int k = 0; k < 3; ++k)
      text += (k == 0 ? "" : ", ") + number_text(Scalar(moments[k] * size));
    warn(e.GetLineNum(),
         owner() + "<inertia> is not that of a body: its principal moments are " + text);
  }

  bool read_origin(const XmlElement& parent, Pose<Scalar>& pose) {
    const XmlElement* e = nullptr;
    if (!find(parent, "origin", e)) return false;
    if (e == nullptr) return true;
    for (const tinyxml2::XMLAttribute* a = e->FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string_view name = a->Name();
      if (name != "xyz" && name != "rpy")
        return bad(*a, *e, "is not supported: only xyz and rpy are");
    }
    Vector3<Scalar> rpy = Vector3<Scalar>::Constant(Scalar(0));
    if (!triple_if_given(*e, "xyz", pose.p) || !triple_if_given(*e, "rpy", rpy)) return false;
    pose.R = rotation_from_roll_pitch_yaw<Scalar>(rpy[0], rpy[1], rpy[2]);
    return true;
  }

  bool read_type(const XmlElement& e, const std::string& type, JointType& out) {
    if (type == "revolute" || type == "continuous") {
      out = JointType::Revolute;
    } else if (type == "prismatic") {
      out = JointType::Prismatic;
    } else if (type == "fixed") {
      out = JointType::Fixed;
    } else if (type == "floating") {
      out = JointType::Free;
    } else {
      return bad(*e.FindAttribute("type"), e,
                 type == "planar"
                     ? "is not supported: two prismatic joints and a revolute one do the same"
                     : "is unknown, expected revolute, continuous, prismatic, fixed or floating");
    }
    return true;
  }

  bool read_limits(const XmlElement& parent, bool endless, JointLimits<Scalar>& limits) {
    const XmlElement* e = nullptr;
    if (!find(parent, "limit", e)) return false;
    if (e == nullptr) {
      if (!endless) warn(parent.GetLineNum(), owner() + "has no <limit>: it moves without limits");
      return true;
    }
    Scalar lower(0), upper(0);  // URDF's defaults
    if (!number_if_given(*e, "lower", lower) || !number_if_given(*e, "upper", upper) ||
        !number_if_given(*e, "effort", limits.effort) ||
        !number_if_given(*e, "velocity", limits.velocity))
      return false;
    for (const char* attribute : {"effort", "velocity"}) {
      if (e->FindAttribute(attribute) == nullptr) {
        warn(e->GetLineNum(), owner() + "<limit> has no " + attribute + ": it is unlimited");
      } else if (const Scalar& limit = attribute[0] == 'e' ? limits.effort : limits.velocity;
                 !(limit > Scalar(0))) {
        if (limit < Scalar(0)) return bad(*e->FindAttribute(attribute), *e, "is negative");
        warn(e->GetLineNum(), owner() + "<limit> " + attribute + " is zero");
      }
    }
    if (endless) return true;
    if (e->FindAttribute("lower") == nullptr && e->FindAttribute("upper") == nullptr)
      warn(e->GetLineNum(),
           owner() + "<limit> has neither lower nor upper: both are 0 by the format's rule");
    if (upper < lower) {
      return fail_in(e->GetLineNum(), "<limit> lower " + number_text(lower) + " is above upper " +
                                          number_text(upper));
    }
    const Scalar zero(0);  // values beyond 1e20 mean "no limit", if they have the right sign
    if (is_unbounded(lower) && lower > zero)
      return bad(*e->FindAttribute("lower"), *e, "is no lower bound");
    if (is_unbounded(upper) && upper < zero)
      return bad(*e->FindAttribute("upper"), *e, "is no upper bound");
    limits.lower = lower;
    limits.upper = upper;
    return true;
  }

  bool read_dynamics(const XmlElement& parent, JointEntry<Scalar>& entry) {
    const XmlElement* e = nullptr;
    if (!find(parent, "dynamics", e)) return false;
    if (e == nullptr) return true;
    if (!number_if_given(*e, "damping", entry.damping) ||
        !number_if_given(*e, "friction", entry.friction))
      return false;
    if (entry.damping < Scalar(0)) return bad(*e->FindAttribute("damping"), *e, "is negative");
    return !(entry.friction < Scalar(0)) || bad(*e->FindAttribute("friction"), *e, "is negative");
  }

  std::unordered_map<std::string, int> link_names_, joint_names_;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
