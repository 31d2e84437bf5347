#pragma once

// Checks links and joints and builds a tree of them. Links that fixed joints connect become one
// body, whose mass, centre of mass and inertia tensor are
//
//   m = Σ m_k,   c = Σ m_k c_k / m,   I = Σ R_k I_k R_kᵀ + m_k (|d_k|² 1 - d_k d_kᵀ)
//
// with d_k = c_k - c and R_k the rotation from link k to the body. Bodies are in depth-first order
// and their joints get coordinates in that order. A joint that follows another shares its
// coordinate.

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "clothctl/config.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// Collects links and joints, in any order, and builds a tree of them.
template <RealScalar Scalar>
class KinematicTreeBuilder {
 public:
  /// A link as it was added.
  struct LinkEntry {
    /// Name of the link.
    std::string name;
    /// Inertia, or nothing for a link without mass.
    std::optional<Inertia<Scalar>> inertia;
  };

  /// Adds a link. A link without inertia has no mass. The one link that no joint moves is the
  /// world. Allocates.
  KinematicTreeBuilder& add_link(std::string name,
                                 std::optional<Inertia<Scalar>> inertia = std::nullopt);
  /// Adds a joint. Allocates.
  KinematicTreeBuilder& add_joint(Joint<Scalar> joint);

  /// Returns the links added so far, in order.
  const std::vector<LinkEntry>& links() const { return links_; }
  /// Returns the joints added so far, in order.
  const std::vector<Joint<Scalar>>& joints() const { return joints_; }

  /// Builds the tree. Allocates. Complexity: O(links + joints), and O(joints) more for each joint
  /// that follows another. Fails when:
  ///
  /// * a name is empty or given twice, or a joint names a link or leader that does not exist
  /// * two joints move the same link, links form a loop, or links are not connected
  /// * a number other than a limit is not finite, or numbers overflow
  /// * a mass or a moment of inertia is negative, an inertia tensor is not symmetric, or an entry
  ///   off its diagonal is larger than any body can have
  /// * an origin's R is not a rotation, an axis is zero, limits are crossed
  /// * leaders follow each other in a circle, or a ratio to a leader is zero
  ///
  /// The error names the item and the value.
  Result<KinematicTree<Scalar>> build() const;

 private:
  using Names = std::unordered_map<std::string, int>;

  static int find(const Names& names, const std::string& name) {
    const auto found = names.find(name);
    return found == names.end() ? -1 : found->second;
  }
  int find_link(const std::string& name) const { return find(link_index_, name); }
  int find_joint(const std::string& name) const { return find(joint_index_, name); }

  std::string check_links() const;

  static std::string check_inertia(const Inertia<Scalar>& inertia);

  std::string check_joint(const Joint<Scalar>& joint) const;

  std::string check_limits(const Joint<Scalar>& joint) const;

  /// Fills the tree's bodies and links, parents first.
  std::string arrange(KinematicTree<Scalar>& tree) const;

  /// Adds a link to the tree: to its parent's body where the joint is fixed, else to a new body.
  void attach(KinematicTree<Scalar>& tree, const Joint<Scalar>& joint, int child) const;

  /// Returns a rotation for an accepted R: R itself where it is orthonormal up to rounding, else
  /// the rotation with the same x axis and the same x-y plane.
  static Matrix3<Scalar> orthonormal(const Matrix3<Scalar>& R);

  /// Returns a rotation whose z axis is along `axis`: the identity where the axis is z.
  static Matrix3<Scalar> with_z_along(const Vector3<Scalar>& axis);

  /// Adds the inertia `part`, given in a frame with pose `pose`, to a body's inertia.
  static void merge(const Inertia<Scalar>& part, const Pose<Scalar>& pose, Inertia<Scalar>& body);

  /// Gives coordinates to joints, and limits to coordinates.
  std::string number(KinematicTree<Scalar>& tree) const;

  /// Returns a joint's position limit as a limit of its coordinate.
  static Scalar bound(const Scalar& limit, const Body<Scalar>& body) {
    if (is_unbounded(limit)) return body.ratio < Scalar(0) ? Scalar(-limit) : limit;
    return (limit - body.offset) / body.ratio;
  }

  const Joint<Scalar>& joint_of(const Body<Scalar>& body) const {
    return joints_[static_cast<std::size_t>(find_joint(body.name))];
  }

  /// Returns the FNV-1a hash of structure and numbers; for scalars that are not built-in
  /// floating-point types, of the structure only.
  static std::uint64_t fingerprint(const std::vector<Body<Scalar>>& bodies);

  static Scalar sqrt_epsilon() {
    using std::sqrt;
    return sqrt(scalar_traits<Scalar>::epsilon());
  }

  static std::string text(const Scalar& value) { return number_text(value); }

  std::vector<LinkEntry> links_;
  std::vector<Joint<Scalar>> joints_;
  Names link_index_, joint_index_;
};

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::add_link(std::string name,
                                            std::optional<Inertia<Scalar>> inertia)
    -> KinematicTreeBuilder& {
  link_index_.emplace(name, static_cast<int>(links_.size()));
  links_.push_back({std::move(name), std::move(inertia)});
  return *this;
}

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::add_joint(Joint<Scalar> joint) -> KinematicTreeBuilder& {
  joint_index_.emplace(joint.name, static_cast<int>(joints_.size()));
  joints_.push_back(std::move(joint));
  return *this;
}

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::build() const -> Result<KinematicTree<Scalar>> {
  if (std::string fault = check_links(); !fault.empty()) return Error{std::move(fault)};
  for (const Joint<Scalar>& joint : joints_) {
    if (std::string fault = check_joint(joint); !fault.empty()) {
      return Error{"joint \"" + joint.name + "\": " + std::move(fault)};
    }
  }
  KinematicTree<Scalar> tree;
  if (std::string fault = arrange(tree); !fault.empty()) return Error{std::move(fault)};
  if (std::string fault = number(tree); !fault.empty()) return Error{std::move(fault)};
  for (const Body<Scalar>& body : tree.bodies_) {
    const bool fits = all_finite(body.placement.p) && is_finite(body.inertia.mass) &&
                      all_finite(body.inertia.com) && all_finite(body.inertia.about_com) &&
                      is_finite(body.ratio) && is_finite(body.offset);
    if (!fits) return Error{"joint \"" + body.name + "\": numbers overflow"};
  }
  tree.fingerprint_ = fingerprint(tree.bodies_);
  return tree;
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::check_links() const {
  if (links_.empty()) return "the robot has no links";
  for (std::size_t k = 0; k < links_.size(); ++k) {
    const LinkEntry& link = links_[k];
    if (link.name.empty()) return "link " + std::to_string(k) + " has no name";
    if (find_link(link.name) != static_cast<int>(k))
      return "link \"" + link.name + "\" occurs twice";
    if (!link.inertia) continue;
    if (std::string fault = check_inertia(*link.inertia); !fault.empty())
      return "link \"" + link.name + "\": " + fault;
  }
  return {};
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::check_inertia(const Inertia<Scalar>& inertia) {
  using std::abs;
  const Matrix3<Scalar>& moments = inertia.about_com;
  if (!is_finite(inertia.mass)) return "mass is not finite";
  if (inertia.mass < Scalar(0)) return "mass is negative: " + text(inertia.mass);
  if (!all_finite(inertia.com)) return "centre of mass is not finite";
  if (!all_finite(moments)) return "inertia tensor is not finite";
  const Scalar uneven = (moments - moments.transpose()).cwiseAbs().maxCoeff();
  if (uneven > sqrt_epsilon() * moments.cwiseAbs().maxCoeff())
    return "inertia tensor is not symmetric";
  for (int i = 0; i < 3; ++i) {
    if (moments(i, i) < Scalar(0)) return "moment of inertia is negative: " + text(moments(i, i));
  }
  // A body has |I_ij| ≤ (I_ii + I_jj)/2. Twice that leaves room for files with few digits.
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    if (abs(moments(i, j)) > moments(i, i) + moments(j, j)) {
      return std::string("inertia tensor is not that of a body: entry ") + "xyz"[(std::min)(i, j)] +
             "xyz"[(std::max)(i, j)] + " is " + text(moments(i, j)) +
             ", the moments beside it are " + text(moments(i, i)) + " and " + text(moments(j, j));
    }
  }
  return {};
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::check_joint(const Joint<Scalar>& joint) const {
  if (joint.name.empty()) return "it has no name";
  if (&joints_[static_cast<std::size_t>(find_joint(joint.name))] != &joint)
    return "it occurs twice";
  if (find_link(joint.parent) < 0)
    return "there is no link \"" + joint.parent + "\" to be its parent";
  if (find_link(joint.child) < 0) return "there is no link \"" + joint.child + "\" to be its child";
  if (!all_finite(joint.origin.p) || !all_finite(joint.origin.R)) return "its origin is not finite";
  if (!is_rotation<Scalar>(joint.origin.R, Scalar(64) * sqrt_epsilon()))
    return "its origin's R is not a rotation";
  if (joint.type == JointType::Fixed || joint.type == JointType::Free) {
    return joint.leader.empty()
               ? std::string()
               : "a " + std::string(to_string(joint.type)) + " joint cannot follow another";
  }
  if (!all_finite(joint.axis)) return "its axis is not finite";
  if (!(joint.axis.cwiseAbs().maxCoeff() > Scalar(0))) return "its axis is zero";
  return check_limits(joint);
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::check_limits(const Joint<Scalar>& joint) const {
  const JointLimits<Scalar>& limits = joint.limits;
  for (const Scalar* v : {&limits.lower, &limits.upper, &limits.velocity, &limits.effort}) {
    if (!is_finite(*v) && !is_unbounded(*v)) return "a limit is not a number";
  }
  if (is_unbounded(limits.lower) && limits.lower > Scalar(0))
    return "its lower limit is beyond every position";
  if (is_unbounded(limits.upper) && limits.upper < Scalar(0))
    return "its upper limit is beyond every position";
  if (limits.upper < limits.lower)
    return "limits are crossed: " + text(limits.lower) + " .. " + text(limits.upper);
  if (limits.velocity < Scalar(0)) return "velocity limit is negative: " + text(limits.velocity);
  if (limits.effort < Scalar(0)) return "effort limit is negative: " + text(limits.effort);
  if (joint.leader.empty()) return {};
  const int leader = find_joint(joint.leader);
  if (leader < 0) return "there is no joint \"" + joint.leader + "\" for it to follow";
  const JointType type = joints_[static_cast<std::size_t>(leader)].type;
  if (type == JointType::Fixed || type == JointType::Free)
    return "it cannot follow a " + std::string(to_string(type)) + " joint";
  if (!is_finite(joint.ratio) || !is_finite(joint.offset))
    return "ratio or offset to its leader is not finite";
  if (!(joint.ratio < Scalar(0)) && !(joint.ratio > Scalar(0)))
    return "its ratio to its leader is zero";
  return {};
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::arrange(KinematicTree<Scalar>& tree) const {
  std::vector<int> mover(links_.size(), -1);
  std::vector<std::vector<int>> children(links_.size());
  for (std::size_t k = 0; k < joints_.size(); ++k) {
    const Joint<Scalar>& joint = joints_[k];
    int& first = mover[static_cast<std::size_t>(find_link(joint.child))];
    if (first >= 0) {
      return "joint \"" + joint.name + "\": link \"" + joint.child +
             "\" is already moved by joint \"" + joints_[static_cast<std::size_t>(first)].name +
             "\"";
    }
    first = static_cast<int>(k);
    children[static_cast<std::size_t>(find_link(joint.parent))].push_back(find_link(joint.child));
  }
  int root = -1;
  for (std::size_t k = 0; k < links_.size(); ++k) {
    if (mover[k] >= 0) continue;
    if (root >= 0) {
      return "links \"" + links_[static_cast<std::size_t>(root)].name + "\" and \"" +
             links_[k].name + "\" are not connected";
    }
    root = static_cast<int>(k);
  }
  if (root < 0) return "joints form a loop: every link is moved by one";
  tree.links_.resize(links_.size());
  for (std::size_t k = 0; k < links_.size(); ++k) {
    tree.links_[k].name = links_[k].name;
    tree.links_[k].has_inertia = links_[k].inertia.has_value();
  }
  std::vector<char> placed(links_.size(), 0);
  std::vector<int> waiting{root};  // depth first, children in the order of the joints
  while (!waiting.empty()) {
    const int link = waiting.back();
    waiting.pop_back();
    placed[static_cast<std::size_t>(link)] = 1;
    const int joint = mover[static_cast<std::size_t>(link)];
    if (joint >= 0) attach(tree, joints_[static_cast<std::size_t>(joint)], link);
    const std::vector<int>& below = children[static_cast<std::size_t>(link)];
    waiting.insert(waiting.end(), below.rbegin(), below.rend());
  }
  for (std::size_t k = 0; k < links_.size(); ++k) {
    if (placed[k] == 0)
      return "joint \"" + joints_[static_cast<std::size_t>(mover[k])].name + "\" is part of a loop";
  }
  for (std::size_t k = tree.bodies_.size(); k-- > 0;) {
    Body<Scalar>& body = tree.bodies_[k];
    body.subtree_end = (std::max)(body.subtree_end, static_cast<int>(k) + 1);
    if (body.parent < 0) continue;
    int& end = tree.bodies_[static_cast<std::size_t>(body.parent)].subtree_end;
    end = (std::max)(end, body.subtree_end);
  }
  return {};
}

template <RealScalar Scalar>
void KinematicTreeBuilder<Scalar>::attach(KinematicTree<Scalar>& tree, const Joint<Scalar>& joint,
                                          int child) const {
  const Link<Scalar>& parent = tree.links_[static_cast<std::size_t>(find_link(joint.parent))];
  Link<Scalar>& link = tree.links_[static_cast<std::size_t>(child)];
  const Pose<Scalar> place =
      parent.placement * Pose<Scalar>{orthonormal(joint.origin.R), joint.origin.p};
  if (joint.type == JointType::Fixed) {
    link.body = parent.body;
    link.placement = place;
  } else {
    Pose<Scalar> turned;
    if (joint.type != JointType::Free) turned.R = with_z_along(joint.axis);
    Body<Scalar> body;
    body.name = joint.name;
    body.parent = parent.body;
    body.type = joint.type;
    body.placement = place * turned;
    link.body = static_cast<int>(tree.bodies_.size());
    link.placement = turned.inverse();
    tree.bodies_.push_back(std::move(body));
  }
  const std::optional<Inertia<Scalar>>& inertia = links_[static_cast<std::size_t>(child)].inertia;
  if (inertia && link.body >= 0)
    merge(*inertia, link.placement, tree.bodies_[static_cast<std::size_t>(link.body)].inertia);
}

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::orthonormal(const Matrix3<Scalar>& R) -> Matrix3<Scalar> {
  const Matrix3<Scalar> square = R.transpose() * R - Matrix3<Scalar>::Identity();
  if (!(square.cwiseAbs().maxCoeff() > Scalar(16) * scalar_traits<Scalar>::epsilon())) return R;
  Matrix3<Scalar> exact;
  exact.col(0) = R.col(0).normalized();
  exact.col(2) = exact.col(0).cross(R.col(1)).normalized();
  exact.col(1) = exact.col(2).cross(exact.col(0));
  return exact;
}

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::with_z_along(const Vector3<Scalar>& axis) -> Matrix3<Scalar> {
  using std::abs;
  const Vector3<Scalar> z = (axis / axis.cwiseAbs().maxCoeff()).normalized();
  const Scalar zero(0);
  if (!(abs(z[0]) > zero) && !(abs(z[1]) > zero) && z[2] > zero) return Matrix3<Scalar>::Identity();
  int least = 0;
  for (int k = 1; k < 3; ++k) {
    if (abs(z[k]) < abs(z[least])) least = k;
  }
  Vector3<Scalar> side = Vector3<Scalar>::Constant(zero);
  side[least] = Scalar(1);
  Matrix3<Scalar> R;
  R.col(2) = z;
  R.col(0) = side.cross(z).normalized();
  R.col(1) = z.cross(R.col(0));
  return R;
}

template <RealScalar Scalar>
void KinematicTreeBuilder<Scalar>::merge(const Inertia<Scalar>& part, const Pose<Scalar>& pose,
                                         Inertia<Scalar>& body) {
  const Scalar mass = body.mass + part.mass;
  const Vector3<Scalar> com = pose * part.com;
  const Vector3<Scalar> apart = com - body.com;
  const Scalar reduced = mass > Scalar(0) ? Scalar(body.mass * part.mass / mass) : Scalar(0);
  body.about_com += pose.R * part.about_com * pose.R.transpose();
  body.about_com +=
      reduced * (apart.squaredNorm() * Matrix3<Scalar>::Identity() - apart * apart.transpose());
  if (mass > Scalar(0)) body.com += (part.mass / mass) * apart;
  body.mass = mass;
}

template <RealScalar Scalar>
std::string KinematicTreeBuilder<Scalar>::number(KinematicTree<Scalar>& tree) const {
  std::vector<Body<Scalar>>& bodies = tree.bodies_;
  for (Body<Scalar>& body : bodies) {
    const Joint<Scalar>& joint = joint_of(body);
    if (!joint.leader.empty()) continue;
    body.position = tree.positions_;
    body.velocity = tree.velocities_;
    tree.positions_ += body.type == JointType::Free ? 7 : 1;
    tree.velocities_ += body.type == JointType::Free ? 6 : 1;
  }
  const Scalar none = scalar_traits<Scalar>::infinity();
  tree.lower_.setConstant(tree.positions_, -none);
  tree.upper_.setConstant(tree.positions_, none);
  tree.velocity_limits_.setConstant(tree.velocities_, none);
  tree.effort_limits_.setConstant(tree.velocities_, none);
  for (Body<Scalar>& body : bodies) {
    const Joint<Scalar>* joint = &joint_of(body);
    for (std::size_t hops = 0; !joint->leader.empty(); ++hops) {
      if (hops == joints_.size())
        return "joint \"" + body.name + "\": its leaders follow each other in a circle";
      body.offset += body.ratio * joint->offset;
      body.ratio *= joint->ratio;
      if (!is_finite(body.ratio) || !is_finite(body.offset) ||
          (!(body.ratio < Scalar(0)) && !(body.ratio > Scalar(0)))) {
        return "joint \"" + body.name + "\": ratios to its leaders multiply to " + text(body.ratio);
      }
      joint = &joints_[static_cast<std::size_t>(find_joint(joint->leader))];
      body.follows = tree.coupled_ = true;
    }
    if (body.follows) {
      const Body<Scalar>& leader = bodies[static_cast<std::size_t>(tree.find_joint(joint->name))];
      body.position = leader.position;
      body.velocity = leader.velocity;
    } else if (body.type != JointType::Free) {
      tree.velocity_limits_[body.velocity] = joint->limits.velocity;
      tree.effort_limits_[body.velocity] = joint->limits.effort;
    }
    if (body.type == JointType::Free) continue;
    const JointLimits<Scalar>& limits = joint_of(body).limits;
    const Scalar one = bound(limits.lower, body), other = bound(limits.upper, body);
    for (const auto& [own, given] :
         {std::pair{one, limits.lower}, std::pair{other, limits.upper}}) {
      if (!is_finite(own) && !is_unbounded(given))
        return "joint \"" + body.name + "\": numbers overflow";
    }
    Scalar &lower = tree.lower_[body.position], &upper = tree.upper_[body.position];
    lower = (std::max)(lower, (std::min)(one, other));
    upper = (std::min)(upper, (std::max)(one, other));
    if (upper < lower)
      return "joint \"" + body.name + "\": its limits and its leader's have no position in common";
  }
  return {};
}

template <RealScalar Scalar>
auto KinematicTreeBuilder<Scalar>::fingerprint(const std::vector<Body<Scalar>>& bodies)
    -> std::uint64_t {
  std::uint64_t hash = 0xcbf29ce484222325u;
  const auto mix = [&hash](std::uint64_t word) {
    for (int k = 0; k < 64; k += 8) hash = (hash ^ ((word >> k) & 0xffu)) * 0x100000001b3u;
  };
  const auto mix_numbers = [&](const Scalar* values, int count) {
    if constexpr (std::floating_point<Scalar>) {
      for (int k = 0; k < count; ++k)
        mix(std::bit_cast<std::uint64_t>(static_cast<double>(values[k])));
    }
  };
  for (const Body<Scalar>& body : bodies) {
    mix(static_cast<std::uint64_t>(body.parent));
    mix(static_cast<std::uint64_t>(body.type));
    mix(static_cast<std::uint64_t>(body.velocity));
    mix_numbers(&body.ratio, 1);
    mix_numbers(&body.offset, 1);
    mix_numbers(body.placement.R.data(), 9);
    mix_numbers(body.placement.p.data(), 3);
    mix_numbers(&body.inertia.mass, 1);
    mix_numbers(body.inertia.com.data(), 3);
    mix_numbers(body.inertia.about_com.data(), 9);
  }
  return hash;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class KinematicTreeBuilder<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
