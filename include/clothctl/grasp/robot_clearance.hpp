#pragma once

// How far a robot at positions q is from obstacles and from itself. The robot is a set of capsules
// on its frames. The distance d of a collider is 1-Lipschitz, so that along a capsule's axis of
// length l, with the value m in the middle of a part of length s,
//
//   d >= m - s/2        on that part
//
// Parts are halved until none can be more than a tolerance below the least value found: any
// collider will do, and what is returned is a lower bound that is at most the tolerance too small.
// Obstacles that rest may be in the way; what moves is not planned for.
//
// `joint_reach` bounds how far a point of the robot moves per unit of each joint, in any pose. With
// it, a clearance at q says that a whole neighbourhood of q is free (joint_path_planner.hpp).

#include <cassert>
#include <concepts>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/concepts/collider.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// A capsule on a frame of a robot: all points within `radius` of a segment.
template <RealScalar Scalar>
struct LinkCapsule {
  /// The frame; of a KinematicTree, the number of a link.
  int frame = 0;
  /// One end of the segment, in the frame, m.
  Vector3<Scalar> from = Vector3<Scalar>::Constant(Scalar(0));
  /// The other end. A ball has both at the same point.
  Vector3<Scalar> to = Vector3<Scalar>::Constant(Scalar(0));
  /// Radius, m.
  Scalar radius = Scalar(0);
};

/// What of a robot is closest to something.
template <RealScalar Scalar>
struct ClosestPart {
  /// Its distance, m, as RobotClearance returns it; infinite where there is nothing to be near.
  Scalar distance = scalar_traits<Scalar>::infinity();
  /// The capsule; -1 for none.
  int capsule = -1;
  /// The obstacle that it is close to, or -1.
  int obstacle = -1;
  /// The other capsule that it is close to, or -1.
  int other = -1;
};

namespace detail {

/// Returns the vector to x from the closest point of the segment from a to b, m.
template <RealScalar Scalar>
Vector3<Scalar> offset_from_segment(const Vector3<Scalar>& a, const Vector3<Scalar>& b,
                                    const Vector3<Scalar>& x) {
  const Vector3<Scalar> along = b - a;
  const Scalar square = along.squaredNorm();
  Scalar share = Scalar(0) < square ? Scalar((x - a).dot(along) / square) : Scalar(0);
  if (share < Scalar(0)) share = Scalar(0);
  if (Scalar(1) < share) share = Scalar(1);
  return Vector3<Scalar>(x - a - share * along);
}

/// Returns an empty string, or what is wrong with the capsules on a model.
template <class Model, RealScalar Scalar>
std::string find_bad_capsule(const Model& model, std::span<const LinkCapsule<Scalar>> capsules) {
  for (std::size_t i = 0; i < capsules.size(); ++i) {
    const LinkCapsule<Scalar>& c = capsules[i];
    const std::string name = "capsule " + std::to_string(i);
    if (!has_frame(model, c.frame))
      return name + " is on frame " + std::to_string(c.frame) + ", which does not exist";
    if (!all_finite(c.from) || !all_finite(c.to)) return name + " has an end that is not finite";
    if (!is_finite(c.radius) || c.radius < Scalar(0))
      return name + " has the radius " + number_text(c.radius) +
             " m, must be finite and not negative";
  }
  return {};
}

}  // namespace detail

/// The clearance of a robot of any model of ArticulatedModel.
template <class Model, RealScalar S = double>
requires ArticulatedModel<Model, S>
class RobotClearance {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Makes the clearance of a robot, which must outlive this. `tolerance` (m): see above. Pairs of
  /// capsules on one frame are not looked at. Allocates. Fails when: a capsule's frame does not
  /// exist or a number is not valid, or the tolerance is not positive.
  static Result<RobotClearance> create(const Model& model,
                                       std::vector<LinkCapsule<Scalar>> capsules,
                                       const Scalar& tolerance = Scalar(2e-4));

  /// Sets the obstacles, which must stay. Allocates.
  void set_obstacles(std::span<const ColliderRef<Scalar>> obstacles) {
    obstacles_.assign(obstacles.begin(), obstacles.end());
  }
  /// From now on leaves out pairs of capsules that are at most `distance` (m) apart at positions q
  /// (nq): those of neighbouring bones, which always touch. Returns how many are left. Allocates.
  std::size_t ignore_pairs(const VectorX<Scalar>& q, const Scalar& distance);

  /// Returns a lower bound of the distance (m) at positions q (nq): negative where something
  /// overlaps, NaN where q is not finite or of another size, or an obstacle did not answer. Never
  /// allocates.
  Scalar operator()(const VectorX<Scalar>& q) { return closest(q).distance; }
  /// The same, with what is closest. Complexity: O(capsules (obstacles + capsules)).
  ClosestPart<Scalar> closest(const VectorX<Scalar>& q);

  /// The capsules.
  std::span<const LinkCapsule<Scalar>> capsules() const { return capsules_; }
  /// Where the ends of capsule i were in the last query, m.
  std::pair<Vector3<Scalar>, Vector3<Scalar>> ends(int i) const {
    assert(0 <= i && static_cast<std::size_t>(i) < capsules_.size());
    return {from_.col(i), to_.col(i)};
  }

 private:
  using Traits = articulated_traits<Model>;
  using Vec = Vector3<Scalar>;

  RobotClearance(const Model& model, std::vector<LinkCapsule<Scalar>> capsules,
                 const Scalar& tolerance)
      : model_(&model),
        work_(Traits::make_workspace(model)),
        capsules_(std::move(capsules)),
        tolerance_(tolerance) {
    from_ = to_ = Points<Scalar>::Constant(3, static_cast<Index>(capsules_.size()), Scalar(0));
    for (std::size_t i = 0; i < capsules_.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (capsules_[i].frame != capsules_[j].frame)
          pairs_.emplace_back(static_cast<int>(i), static_cast<int>(j));
      }
    }
  }

  bool move_to(const VectorX<Scalar>& q);
  /// Lowers `best` to a lower bound of distance(x) - radius over the axis of a capsule, if that is
  /// below it. Returns whether it was; a NaN stays in `best`.
  template <class Distance>
  bool lower(int capsule, Distance distance, Scalar& best) const;
  /// Distance of a point from the surface of a capsule.
  Scalar from_capsule(int i, const Vec& x) const {
    const Vec offset = detail::offset_from_segment<Scalar>(from_.col(i), to_.col(i), x);
    return length(offset) - capsules_[static_cast<std::size_t>(i)].radius;
  }
  static Scalar length(const Vec& x) {
    using std::sqrt;
    return sqrt(x.squaredNorm());
  }
  static Scalar nan() {
    if constexpr (std::floating_point<Scalar>) {
      return std::numeric_limits<Scalar>::quiet_NaN();
    } else {
      return scalar_traits<Scalar>::infinity() - scalar_traits<Scalar>::infinity();
    }
  }

  static bool is_nan(const Scalar& x) { return !is_finite(x) && !is_unbounded(x); }

  const Model* model_;
  typename Traits::workspace_type work_;
  std::vector<LinkCapsule<Scalar>> capsules_;
  std::vector<std::pair<int, int>> pairs_;
  std::vector<ColliderRef<Scalar>> obstacles_;
  Points<Scalar> from_, to_;
  VectorX<Scalar> answer_ = VectorX<Scalar>::Constant(1, Scalar(0));
  Scalar tolerance_;
};

template <class Model, RealScalar S>
requires ArticulatedModel<Model, S>
auto RobotClearance<Model, S>::create(const Model& model, std::vector<LinkCapsule<Scalar>> capsules,
                                      const Scalar& tolerance) -> Result<RobotClearance> {
  const std::span<const LinkCapsule<Scalar>> list(capsules);
  if (const std::string bad = detail::find_bad_capsule<Model, Scalar>(model, list); !bad.empty())
    return Error{bad};
  if (!is_finite(tolerance) || !(Scalar(0) < tolerance))
    return Error{"the tolerance is " + number_text(tolerance) + " m, must be finite and positive"};
  return RobotClearance(model, std::move(capsules), tolerance);
}

template <class Model, RealScalar S>
requires ArticulatedModel<Model, S>
bool RobotClearance<Model, S>::move_to(const VectorX<Scalar>& q) {
  if (q.size() != Traits::nq(*model_) || !all_finite(q)) return false;
  Traits::forward_kinematics(*model_, q, work_);
  Matrix3<Scalar> R;
  Vec p;
  for (std::size_t i = 0; i < capsules_.size(); ++i) {
    Traits::frame_pose(*model_, work_, capsules_[i].frame, R, p);
    from_.col(static_cast<Index>(i)) = p + R * capsules_[i].from;
    to_.col(static_cast<Index>(i)) = p + R * capsules_[i].to;
  }
  return true;
}

template <class Model, RealScalar S>
requires ArticulatedModel<Model, S>
template <class Distance>
bool RobotClearance<Model, S>::lower(int capsule, Distance distance, Scalar& best) const {
  const Scalar half(0.5);
  const Vec a = from_.col(capsule), along = to_.col(capsule) - a;
  const Scalar size = length(along), radius = capsules_[static_cast<std::size_t>(capsule)].radius;
  bool lowered = false;
  // Parts still to look at; each halving leaves one behind, and a part of 2⁻⁶⁰ of the axis is none.
  struct Part {
    Scalar from, to;
  };
  constexpr std::size_t kDeepest = 64;
  Part open[kDeepest];
  std::size_t count = 0;
  open[count++] = {Scalar(0), Scalar(1)};
  while (0 < count) {
    const Part part = open[--count];
    const Scalar middle = half * (part.from + part.to), reach = half * (part.to - part.from) * size;
    const Scalar there = distance(Vec(a + middle * along)) - radius;
    if (is_nan(there)) {
      best = there;
      return true;
    }
    const Scalar bound = there - reach;
    if (!(bound < best)) continue;
    if (reach <= tolerance_ || kDeepest < count + 2) {
      best = bound;
      lowered = true;
      continue;
    }
    // Where the middle is low, the bound of both halves falls soon.
    open[count++] = {part.from, middle};
    open[count++] = {middle, part.to};
  }
  return lowered;
}

template <class Model, RealScalar S>
requires ArticulatedModel<Model, S>
auto RobotClearance<Model, S>::closest(const VectorX<Scalar>& q) -> ClosestPart<Scalar> {
  ClosestPart<Scalar> out;
  if (!move_to(q)) {
    out.distance = nan();
    return out;
  }
  for (std::size_t o = 0; o < obstacles_.size(); ++o) {
    const ColliderRef<Scalar>& obstacle = obstacles_[o];
    const auto distance = [&](const Vec& x) {
      const Eigen::Map<const Points<Scalar>> point(x.data(), 3, 1);
      return obstacle.distance(point, answer_) == QueryStatus::Answered ? answer_[0] : nan();
    };
    for (std::size_t i = 0; i < capsules_.size(); ++i) {
      if (!lower(static_cast<int>(i), distance, out.distance)) continue;
      out.capsule = static_cast<int>(i);
      out.obstacle = static_cast<int>(o);
      if (is_nan(out.distance)) return out;
    }
  }
  for (const auto& [i, j] : pairs_) {
    const int other = j;
    if (!lower(
            i, [&](const Vec& x) { return from_capsule(other, x); }, out.distance))
      continue;
    out.capsule = i;
    out.other = j;
    out.obstacle = -1;
  }
  return out;
}

template <class Model, RealScalar S>
requires ArticulatedModel<Model, S> std::size_t RobotClearance<Model, S>::ignore_pairs(
    const VectorX<Scalar>& q, const Scalar& distance) {
  if (!move_to(q)) return pairs_.size();
  std::erase_if(pairs_, [&](const std::pair<int, int>& pair) {
    Scalar best = scalar_traits<Scalar>::infinity();
    (void)lower(
        pair.first, [&](const Vec& x) { return from_capsule(pair.second, x); }, best);
    return !(distance < best);
  });
  return pairs_.size();
}

/// Returns for each coordinate (nv) how far a point of the capsules moves at most per unit of it,
/// in any pose within the limits: 1 for a prismatic joint, else the longest way (m) from the joint
/// to the end of a capsule. Joints that follow a leader count for the leader. Allocates. Fails
/// when: a joint is free, or a prismatic joint below another has no limits, or a capsule is not
/// valid.
template <RealScalar Scalar>
Result<VectorX<Scalar>> joint_reach(const KinematicTree<Scalar>& tree,
                                    std::span<const LinkCapsule<Scalar>> capsules) {
  using std::abs;
  using std::sqrt;
  if (const std::string bad =
          detail::find_bad_capsule<KinematicTree<Scalar>, Scalar>(tree, capsules);
      !bad.empty())
    return Error{bad};
  const auto length = [](const Vector3<Scalar>& x) -> Scalar { return sqrt(x.squaredNorm()); };
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  // From the origin of each body to the farthest point below it; negative where there is none.
  std::vector<Scalar> below(bodies.size(), Scalar(-1));
  const auto lengthen = [&](int body, const Scalar& way) {
    if (body >= 0 && below[static_cast<std::size_t>(body)] < way)
      below[static_cast<std::size_t>(body)] = way;
  };
  for (const LinkCapsule<Scalar>& c : capsules) {
    const Link<Scalar>& link = tree.links()[static_cast<std::size_t>(c.frame)];
    for (const Vector3<Scalar>& end : {c.from, c.to})
      lengthen(link.body, length(link.placement * end) + c.radius);
  }
  VectorX<Scalar> reach = VectorX<Scalar>::Constant(tree.nv(), Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    if (body.type == JointType::Free) return Error{"joint " + body.name + " is free"};
    if (below[i] < Scalar(0)) continue;
    const bool slides = body.type == JointType::Prismatic;
    const Scalar ratio = abs(body.ratio);
    reach[body.velocity] += ratio * (slides ? Scalar(1) : below[i]);
    if (body.parent < 0) continue;
    Scalar way = length(body.placement.p) + below[i];
    if (slides) {
      const Scalar low = abs(body.ratio * tree.lower()[body.position] + body.offset);
      const Scalar high = abs(body.ratio * tree.upper()[body.position] + body.offset);
      way += low < high ? high : low;
      if (!is_finite(way) || is_unbounded(way))
        return Error{"joint " + body.name + " slides without limits below another joint"};
    }
    lengthen(body.parent, way);
  }
  return reach;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class RobotClearance<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
