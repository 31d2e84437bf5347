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

#include <Eigen/Geometry>  // cross
#include <Eigen/LU>        // determinant

#include "clothctl/config.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>

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

  /// Returns the rotation closest in meaning to an accepted R: R itself where it is orthonormal to
  /// rounding, else the rotation with the same x axis and the same x-y plane.
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

  /// FNV-1a over structure and numbers; of number types that are not built in, over structure
  /// alone.
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

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/robot/detail/kinematic_tree_builder_impl.hpp"
