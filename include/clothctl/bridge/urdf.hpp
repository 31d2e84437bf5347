#pragma once

// Reads robots from URDF, the XML format of ROS for links and joints. It reads links with their
// inertia, and joints with origin, axis, limits, dynamics and mimic. It ignores shapes, materials,
// transmissions and extensions. If several joints share a coordinate, its damping d and friction f
// are the sums over these joints:
//
//   d = Σ ratio² d_joint,   f = Σ |ratio| f_joint
//
// Needs tinyxml2 (link with -ltinyxml2).

#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/bridge/detail/urdf_elements.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A joint that follows another one: q = ratio · q_leader + offset.
template <RealScalar Scalar>
struct UrdfCoupling {
  /// Name of the joint that follows.
  std::string joint;
  /// Name of the joint that it follows.
  std::string leader;
  /// Ratio of the joint's position to the leader's.
  Scalar ratio = Scalar(1);
  /// Position of the joint where the leader's is zero (m or rad).
  Scalar offset = Scalar(0);
};

/// Facts about a robot that its URDF file does not hold.
template <RealScalar Scalar>
struct UrdfOptions {
  /// Joints that follow others, in addition to those with an element <mimic>: for instance the
  /// joints of a finger that one tendon pulls.
  std::vector<UrdfCoupling<Scalar>> couplings;

  /// Adds a coupling. Allocates.
  UrdfOptions& couple(std::string joint, std::string leader, Scalar ratio = Scalar(1),
                      Scalar offset = Scalar(0)) {
    couplings.push_back({std::move(joint), std::move(leader), ratio, offset});
    return *this;
  }
};

/// A robot from a URDF file.
template <RealScalar Scalar>
struct UrdfModel {
  /// Bodies, links and limits. Joints are in depth-first order, children of a link in file order.
  KinematicTree<Scalar> tree;
  /// Name of the robot.
  std::string name;
  /// Viscous damping of each velocity coordinate (nv; N s/m or N m s/rad). A joint that follows
  /// another adds ratio² times its own damping to the coordinate of its leader.
  VectorX<Scalar> damping;
  /// Coulomb friction of each velocity coordinate (nv; N or N m). A joint that follows another adds
  /// |ratio| times its own friction to the coordinate of its leader.
  VectorX<Scalar> friction;
  /// Mass of all links, including those that do not move (kg).
  Scalar mass = Scalar(0);
  /// Names of the moving links that have no inertia in the file; they count as massless.
  std::vector<std::string> weightless_links;
  /// Warnings: unusual contents that were read nevertheless. One line each, with file, line and
  /// element.
  std::vector<std::string> warnings;
};

namespace detail {

/// Reads a robot and builds its tree.
template <RealScalar Scalar>
class UrdfParser : public ElementReader<Scalar> {
  using Base = ElementReader<Scalar>;
  using Base::enter, Base::fail, Base::fail_in, Base::find_joint, Base::find_link, Base::joint,
      Base::joints_, Base::leave, Base::link, Base::links_, Base::root, Base::warn;

 public:
  using Base::Base;

  bool parse(std::string_view text, const UrdfOptions<Scalar>& options) {
    if (!this->load(text)) return false;
    if (const char* name = root().Attribute("name"); name != nullptr) {
      model.name = name;
    } else {
      warn(root().GetLineNum(), "<robot> has no name");
    }
    this->warn_of_unknown(
        root(), {"link", "joint", "material", "transmission", "gazebo", "sensor", "ros2_control"});
    for (const XmlElement* e = root().FirstChildElement(); e != nullptr;
         e = e->NextSiblingElement()) {
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
        if (find_joint(name) < 0)
          return fail(root().GetLineNum(), what + "there is no joint " + quote(name));
      }
      JointEntry<Scalar>& entry = joint(follower);
      Joint<Scalar>& j = entry.joint;
      if (!j.leader.empty())
        return fail(entry.line, what + "the joint already follows " + quote(j.leader));
      j.leader = c.leader;
      j.ratio = c.ratio;
      j.offset = c.offset;
      entry.mimic_line = entry.line;
    }
    return true;
  }

  /// Checks that the links and leaders to which joints refer exist, that no two joints move the
  /// same link, and that exactly one link is the root (none if there are no links).
  bool connected() {
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const JointEntry<Scalar>& entry = joints_[k];
      const Joint<Scalar>& j = entry.joint;
      enter("joint", j.name);
      if (find_link(j.parent) < 0)
        return fail_in(entry.parent_line, "<parent>: there is no link " + quote(j.parent));
      const int child = find_link(j.child);
      if (child < 0)
        return fail_in(entry.child_line, "<child>: there is no link " + quote(j.child));
      if (!j.leader.empty() && find_joint(j.leader) < 0)
        return fail_in(entry.mimic_line, "<mimic>: there is no joint " + quote(j.leader));
      int& mover = link(child).mover;
      if (mover >= 0) {
        const std::string other = quote(joint(mover).joint.name);
        return fail_in(entry.child_line,
                       "<child>: link " + quote(j.child) + " is already moved by joint " + other);
      }
      mover = static_cast<int>(k);
    }
    leave();
    const LinkEntry<Scalar>* first = nullptr;
    for (const LinkEntry<Scalar>& entry : links_) {
      if (entry.mover >= 0) continue;
      if (first != nullptr) {
        return fail(entry.line, "link " + quote(entry.name) +
                                    ": no joint moves it, and none moves link " +
                                    quote(first->name) + " in line " + std::to_string(first->line) +
                                    ": a robot has one root");
      }
      first = &entry;
    }
    if (first != nullptr || links_.empty()) return true;
    // Every link has a parent, so going up as many times as there are links ends in a loop.
    int place = 0;
    for (std::size_t k = 0; k < links_.size(); ++k)
      place = find_link(joint(link(place).mover).joint.parent);
    const JointEntry<Scalar>& entry = joint(link(place).mover);
    return fail(entry.line, "joint " + quote(entry.joint.name) + " is part of a loop");
  }

  bool build() {
    KinematicTreeBuilder<Scalar> builder;
    for (const LinkEntry<Scalar>& entry : links_) builder.add_link(entry.name, entry.inertia);
    for (const JointEntry<Scalar>& entry : joints_) builder.add_joint(entry.joint);
    Result<KinematicTree<Scalar>> tree = builder.build();
    if (!tree) return fail(line_of(tree.error()), tree.error());
    model.tree = std::move(tree).value();
    std::vector<Scalar> carried;
    model.damping.setConstant(model.tree.nv(), Scalar(0));
    model.friction.setConstant(model.tree.nv(), Scalar(0));
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
      if (!all_finite(frame.placement.p))
        return fail(root().GetLineNum(), "link " + quote(frame.name) + ": numbers overflow");
      if (frame.body >= 0 && !frame.has_inertia) model.weightless_links.push_back(frame.name);
    }
    if (!all_finite(model.damping) || !all_finite(model.friction) ||
        !all_finite(model.tree.neutral()))
      return fail(root().GetLineNum(),
                  "<robot>: limits, damping or friction of joints that follow overflow");
    for (const LinkEntry<Scalar>& entry : links_) {
      if (entry.inertia) model.mass += entry.inertia->mass;
    }
    if (!is_finite(model.mass)) return fail(root().GetLineNum(), "<robot>: masses overflow");
    warn_of_weightless(carried);
    return true;
  }

  /// Warns of joints that move no mass. `carried`: on entry the mass of each body, on return the
  /// mass of each body together with all bodies below it (kg).
  void warn_of_weightless(std::vector<Scalar>& carried) {
    const std::vector<Body<Scalar>>& bodies = model.tree.bodies();
    for (std::size_t k = bodies.size(); k-- > 0;) {
      if (bodies[k].parent >= 0) carried[static_cast<std::size_t>(bodies[k].parent)] += carried[k];
    }
    for (std::size_t k = 0; k < bodies.size(); ++k) {
      if (carried[k] > Scalar(0)) continue;
      warn(joint(find_joint(bodies[k].name)).line,
           "joint " + quote(bodies[k].name) + ": the links it moves have no mass");
    }
  }

  /// Returns the line in the file of the joint or link that an error of the builder names first.
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

}  // namespace detail

/// Parses a robot from URDF text. Messages call the file `name`. Joints may be revolute,
/// continuous, prismatic, fixed or floating. A missing <limit> gives a warning. Allocates.
/// Complexity: O(length), and O(joints) more for each joint that follows another. Fails when:
///
/// * the text is not XML, contains xacro, or its root element is not <robot>
/// * a required element or attribute is missing, an element occurs twice, or two links or joints
///   have the same name
/// * a joint names a link or leader that does not exist, or its type is planar or unknown
/// * links form a loop or have two roots
/// * a number is not finite, is negative where it must not be, or an attribute holds too few or too
///   many numbers
/// * an axis is zero, limits are crossed, or an inertia tensor is far from that of any body
/// * the text is longer than 16 MiB or has more than `kLargestUrdfLinks` links
///
/// The error names file, line, element and value.
template <RealScalar Scalar = double>
Result<UrdfModel<Scalar>> parse_urdf(std::string_view text, const std::string& name,
                                     const UrdfOptions<Scalar>& options = {}) {
  detail::UrdfParser<Scalar> parser(name);
  if (!parser.parse(text, options)) return Error{parser.error()};
  return std::move(parser.model);
}

/// Reads a robot from a URDF file; see `parse_urdf`. Allocates. Fails when: the file cannot be
/// read, or `parse_urdf` fails.
template <RealScalar Scalar = double>
Result<UrdfModel<Scalar>> read_urdf(const std::string& path,
                                    const UrdfOptions<Scalar>& options = {}) {
  const Result<std::string> text = read_file(path, detail::kLargestUrdf);
  if (!text) return Error{text.error()};
  return parse_urdf<Scalar>(*text, path, options);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
