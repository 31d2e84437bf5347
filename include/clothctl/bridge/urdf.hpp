#pragma once

// Robots from URDF, the XML format of ROS for links and joints. Read are links with their inertia and joints with origin,
// axis, limits, dynamics and mimic; shapes, materials, transmissions and extensions are not. Coordinates that lead others carry
// the damping and friction of all,
//
//   d = Σ ratio² d_joint,   f = Σ |ratio| f_joint
//
// Needs tinyxml2 (link with -ltinyxml2).

#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/bridge/urdf_elements.hpp"
#include "clothctl/robot/tree_builder.hpp"

namespace clothctl::robot {

/// A joint that follows another: q = ratio · q_leader + offset.
template <RealScalar Scalar>
struct UrdfCoupling {
  /// The joint that follows.
  std::string joint;
  /// The joint that leads.
  std::string leader;
  /// Ratio to the leader.
  Scalar ratio = Scalar(1);
  /// Offset to the leader (m or rad).
  Scalar offset = Scalar(0);
};

/// What is known of a robot beside its URDF.
template <RealScalar Scalar>
struct UrdfOptions {
  /// Joints that follow others as <mimic> would say, such as fingers pulled by one tendon.
  std::vector<UrdfCoupling<Scalar>> couplings;

  /// Adds a coupling. Allocates.
  UrdfOptions& couple(std::string joint, std::string leader, Scalar ratio = Scalar(1), Scalar offset = Scalar(0)) {
    couplings.push_back({std::move(joint), std::move(leader), ratio, offset});
    return *this;
  }
};

/// What a URDF file holds.
template <RealScalar Scalar>
struct UrdfModel {
  /// Bodies, links and limits; joints in depth-first order, below a link as in the file.
  Tree<Scalar> tree;
  /// The robot's name.
  std::string name;
  /// Viscous damping of each velocity (N s/m or N m s/rad); joints that follow add ratio² times theirs.
  VectorX<Scalar> damping;
  /// Coulomb friction of each velocity (N or N m); joints that follow add |ratio| times theirs.
  VectorX<Scalar> friction;
  /// Mass of all links, those that do not move too (kg).
  Scalar mass = Scalar(0);
  /// Links that move and were given no inertia: they weigh nothing.
  std::vector<std::string> weightless_links;
  /// What is odd in the file but was read, one line each, with file, line and element.
  std::vector<std::string> warnings;
};

namespace urdf_detail {

/// Reads a robot and makes a tree of it.
template <RealScalar Scalar>
class UrdfParser : public ElementReader<Scalar> {
  using Base = ElementReader<Scalar>;
  using Base::enter, Base::fail, Base::fail_in, Base::find_joint, Base::find_link, Base::joint, Base::joints_, Base::leave,
      Base::link, Base::links_, Base::root, Base::warn;

 public:
  using Base::Base;

  bool parse(std::string_view text, const UrdfOptions<Scalar>& options) {
    if (!this->load(text)) return false;
    if (const char* name = root().Attribute("name"); name != nullptr) {
      model.name = name;
    } else {
      warn(root().GetLineNum(), "<robot> has no name");
    }
    this->warn_of_strangers(root(), {"link", "joint", "material", "transmission", "gazebo", "sensor", "ros2_control"});
    for (const XmlElement* e = root().FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      leave();
      if (Base::named(*e, "link") && !this->read_link(*e)) return false;
      if (Base::named(*e, "joint") && !this->read_joint(*e)) return false;
    }
    leave();
    if (!couple(options) || !connected() || !build()) return false;
    model.warnings = std::move(this->warnings);
    return true;
  }

  UrdfModel<Scalar> model;

 private:
  bool couple(const UrdfOptions<Scalar>& options) {
    for (const UrdfCoupling<Scalar>& c : options.couplings) {
      const std::string what = "coupling of " + quote(c.joint) + " to " + quote(c.leader) + ": ";
      const int follower = find_joint(c.joint);
      for (const std::string& name : {c.joint, c.leader}) {
        if (find_joint(name) < 0) return fail(root().GetLineNum(), what + "there is no joint " + quote(name));
      }
      JointEntry<Scalar>& entry = joint(follower);
      Joint<Scalar>& j = entry.joint;
      if (!j.leader.empty()) return fail(entry.line, what + "the joint follows " + quote(j.leader) + " already");
      j.leader = c.leader;
      j.ratio = c.ratio;
      j.offset = c.offset;
      entry.mimic_line = entry.line;
    }
    return true;
  }

  /// Checks what joints name, and that one link is the root.
  bool connected() {
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const JointEntry<Scalar>& entry = joints_[k];
      const Joint<Scalar>& j = entry.joint;
      enter("joint", j.name);
      if (find_link(j.parent) < 0) return fail_in(entry.parent_line, "<parent>: there is no link " + quote(j.parent));
      const int child = find_link(j.child);
      if (child < 0) return fail_in(entry.child_line, "<child>: there is no link " + quote(j.child));
      if (!j.leader.empty() && find_joint(j.leader) < 0)
        return fail_in(entry.mimic_line, "<mimic>: there is no joint " + quote(j.leader));
      int& mover = link(child).mover;
      if (mover >= 0) {
        const std::string other = quote(joint(mover).joint.name);
        return fail_in(entry.child_line, "<child>: link " + quote(j.child) + " is moved by joint " + other + " already");
      }
      mover = static_cast<int>(k);
    }
    leave();
    const LinkEntry<Scalar>* first = nullptr;
    for (const LinkEntry<Scalar>& entry : links_) {
      if (entry.mover >= 0) continue;
      if (first != nullptr) {
        return fail(entry.line, "link " + quote(entry.name) + ": no joint moves it, and none moves link " + quote(first->name) +
                                    " in line " + std::to_string(first->line) + ": a robot has one root");
      }
      first = &entry;
    }
    if (first != nullptr || links_.empty()) return true;
    int place = 0;  // every link has a joint above it: as many steps up as there are links end in a loop
    for (std::size_t k = 0; k < links_.size(); ++k) place = find_link(joint(link(place).mover).joint.parent);
    const JointEntry<Scalar>& entry = joint(link(place).mover);
    return fail(entry.line, "joint " + quote(entry.joint.name) + " is part of a loop");
  }

  bool build() {
    TreeBuilder<Scalar> builder;
    for (const LinkEntry<Scalar>& entry : links_) builder.add_link(entry.name, entry.inertia);
    for (const JointEntry<Scalar>& entry : joints_) builder.add_joint(entry.joint);
    Result<Tree<Scalar>> tree = builder.build();
    if (!tree) return fail(line_of(tree.error()), tree.error());
    model.tree = std::move(tree).value();
    std::vector<Scalar> carried;
    model.damping.setConstant(model.tree.velocities(), Scalar(0));
    model.friction.setConstant(model.tree.velocities(), Scalar(0));
    for (const Body<Scalar>& body : model.tree.bodies()) {
      using std::abs;
      const JointEntry<Scalar>& entry = joint(find_joint(body.name));
      if (body.type != JointType::Free) {
        model.damping[body.velocity] += body.ratio * body.ratio * entry.damping;
        model.friction[body.velocity] += abs(body.ratio) * entry.friction;
      }
      const Inertia<Scalar>& inertia = body.inertia;
      if (!is_finite(inertia.mass) || !all_finite(inertia.com) || !all_finite(inertia.about_com) ||
          !all_finite(body.placement.p) || !is_finite(body.ratio) || !is_finite(body.offset))
        return fail(entry.line, "joint " + quote(body.name) + ": numbers overflow");
      carried.push_back(inertia.mass);
    }
    for (const Link<Scalar>& frame : model.tree.links()) {
      if (!all_finite(frame.placement.p)) return fail(root().GetLineNum(), "link " + quote(frame.name) + ": numbers overflow");
      if (frame.body >= 0 && !frame.has_inertia) model.weightless_links.push_back(frame.name);
    }
    if (!all_finite(model.damping) || !all_finite(model.friction) || !all_finite(model.tree.neutral()))
      return fail(root().GetLineNum(), "<robot>: limits, damping or friction of joints that follow overflow");
    for (const LinkEntry<Scalar>& entry : links_) {
      if (entry.inertia) model.mass += entry.inertia->mass;
    }
    if (!is_finite(model.mass)) return fail(root().GetLineNum(), "<robot>: masses overflow");
    warn_of_weightless(carried);
    return true;
  }

  /// Warns of joints that carry no mass at all; `carried` holds the mass of each body.
  void warn_of_weightless(std::vector<Scalar>& carried) {
    const std::vector<Body<Scalar>>& bodies = model.tree.bodies();
    for (std::size_t k = bodies.size(); k-- > 0;) {
      if (bodies[k].parent >= 0) carried[static_cast<std::size_t>(bodies[k].parent)] += carried[k];
    }
    for (std::size_t k = 0; k < bodies.size(); ++k) {
      if (carried[k] > Scalar(0)) continue;
      warn(joint(find_joint(bodies[k].name)).line, "joint " + quote(bodies[k].name) + ": what it moves has no mass");
    }
  }

  /// The line of what a message of the builder begins with.
  int line_of(std::string_view message) const {
    const auto begins = [message](const std::string& kind, const std::string& name) {
      return message.substr(0, kind.size() + name.size() + 3) == kind + " \"" + name + "\"";
    };
    for (const JointEntry<Scalar>& entry : joints_) {
      if (begins("joint", entry.joint.name)) return entry.line;
    }
    for (const LinkEntry<Scalar>& entry : links_) {
      if (begins("link", entry.name)) return entry.inertial_line;
    }
    return root().GetLineNum();
  }
};

}  // namespace urdf_detail

/// Parses a robot from URDF text; `name` stands for the file in messages. Joints of type revolute, continuous, prismatic, fixed
/// and floating are read; <limit> may be missing (a warning tells). Allocates. Complexity: O(length), and O(joints) more for
/// each joint that follows.
/// Fails when: the text is not XML, is xacro, or is no <robot>; an element or attribute that must be there is missing, or one
/// is there twice; a name is given twice; a joint names a link or leader that does not exist, is planar, or of an unknown type;
/// links form a loop or have two roots; a number is not finite, negative where it must not be, or one too many or few; an axis
/// is zero, limits are crossed; or there are more than `kLargestUrdfLinks` links or 16 MiB. The error names file, line, element
/// and value.
template <RealScalar Scalar = double>
Result<UrdfModel<Scalar>> parse_urdf(std::string_view text, const std::string& name, const UrdfOptions<Scalar>& options = {}) {
  urdf_detail::UrdfParser<Scalar> parser(name);
  if (!parser.parse(text, options)) return Error{parser.error()};
  return std::move(parser.model);
}

/// Reads a robot from a URDF file; see `parse_urdf`. Allocates.
/// Fails when: the file cannot be read, or as `parse_urdf` does.
template <RealScalar Scalar = double>
Result<UrdfModel<Scalar>> read_urdf(const std::string& path, const UrdfOptions<Scalar>& options = {}) {
  const Result<std::string> text = urdf_detail::read_text(path);
  if (!text) return Error{text.error()};
  return parse_urdf<Scalar>(*text, path, options);
}

}  // namespace clothctl::robot
