#pragma once

// Two trees of free motions in joint space, one from the start and one from the goal, that grow
// until they meet (RRT-Connect). In each iteration one tree is extended by a step from its nearest
// node towards a random posture. The other tree then goes straight towards the new node as far as
// it gets. The trees change places after each iteration. Distances are ways (motion_check.hpp).
//
// Reference: Kuffner, LaValle, RRT-Connect: an efficient approach to single-query path planning,
// ICRA 2000, figs. 2 and 5.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/grasp/detail/motion_check.hpp"
#include "clothctl/grasp/detail/split_mix.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A tree of postures. Each node but the first has a parent.
template <RealScalar Scalar>
class JointTree {
 public:
  /// Makes a tree of one node, number 0. Allocates.
  explicit JointTree(Posture<Scalar> root) { add(std::move(root), 0); }

  /// Adds a node and returns its number. Allocates at times.
  std::size_t add(Posture<Scalar> posture, std::size_t parent) {
    nodes_.push_back(std::move(posture));
    parents_.push_back(parent);
    return nodes_.size() - 1;
  }
  /// Returns the number of the node with the least way to q, the first of several. Complexity:
  /// O(nodes · joints).
  std::size_t nearest(const VectorX<Scalar>& q, const VectorX<Scalar>& reach) const {
    std::size_t best = 0;
    Scalar least = joint_way(nodes_[0].q, q, reach);
    for (std::size_t k = 1; k < nodes_.size(); ++k) {
      const Scalar way = joint_way(nodes_[k].q, q, reach);
      if (!(way < least)) continue;
      best = k;
      least = way;
    }
    return best;
  }
  /// A node.
  const Posture<Scalar>& operator[](std::size_t node) const { return nodes_[node]; }
  /// The number of nodes.
  std::size_t size() const { return nodes_.size(); }
  /// Returns the nodes from `node` to the first. Allocates.
  std::vector<Posture<Scalar>> branch(std::size_t node) const {
    std::vector<Posture<Scalar>> out(1, nodes_[node]);
    for (; node != 0; node = parents_[node]) out.push_back(nodes_[parents_[node]]);
    return out;
  }

 private:
  std::vector<Posture<Scalar>> nodes_;
  std::vector<std::size_t> parents_;
};

/// The box in which postures lie.
template <RealScalar Scalar>
struct JointBox {
  /// Least and largest position of each joint (m or rad, finite).
  VectorX<Scalar> lower, upper;

  /// Moves q into the box. Complexity: O(joints).
  void clamp(VectorX<Scalar>& q) const {
    for (Index i = 0; i < q.size(); ++i) {
      if (q[i] < lower[i]) q[i] = lower[i];
      if (upper[i] < q[i]) q[i] = upper[i];
    }
  }
  /// Writes a uniformly random posture.
  void draw(SplitMix& random, VectorX<Scalar>& q) const {
    for (Index i = 0; i < q.size(); ++i)
      q[i] = lower[i] + random.uniform<Scalar>() * (upper[i] - lower[i]);
    clamp(q);
  }
};

/// The two trees. Refers to the motions and to the box.
template <RealScalar Scalar, class Clearance>
class JointTrees {
 public:
  /// Makes the trees of a free start and a free goal, which grow by `step` (m, > 0) at most.
  JointTrees(MotionCheck<Scalar, Clearance>& motions, const JointBox<Scalar>& box,
             const Scalar& step, Posture<Scalar> from, Posture<Scalar> to)
      : check_(motions),
        box_(box),
        step_(step),
        trees_{JointTree<Scalar>(std::move(from)), JointTree<Scalar>(std::move(to))} {}

  /// Grows the trees until they meet, for at most `most` iterations, which it counts. Returns the
  /// path from start to goal; none where they did not meet or a clearance was NaN. Allocates.
  std::vector<Posture<Scalar>> connect(SplitMix& random, int most, int& iterations) {
    VectorX<Scalar> target = trees_[0][0].q;
    for (iterations = 0; iterations < most && !check_.broken();) {
      const std::size_t side = static_cast<std::size_t>(iterations % 2);
      ++iterations;
      box_.draw(random, target);
      const std::size_t closest = trees_[side].nearest(target, check_.reach());
      const Extension made = extend(side, closest, target);
      if (made.kind == Growth::Trapped) continue;
      const VectorX<Scalar> meeting = trees_[side][made.node].q;
      const std::size_t other = 1 - side;
      Extension last{Growth::Advanced, trees_[other].nearest(meeting, check_.reach())};
      while (last.kind == Growth::Advanced) last = extend(other, last.node, meeting);
      if (last.kind != Growth::Reached) continue;
      return side == 0 ? join(made.node, last.node) : join(last.node, made.node);
    }
    return {};
  }

 private:
  enum class Growth { Trapped, Advanced, Reached };
  /// What an extension did, and the node that it made.
  struct Extension {
    Growth kind;
    std::size_t node;
  };

  /// Extends the tree of a side by a step from a node towards `target`.
  Extension extend(std::size_t side, std::size_t node, const VectorX<Scalar>& target) {
    const VectorX<Scalar>& q = trees_[side][node].q;
    if (q == target) return {Growth::Reached, node};
    const Scalar way = check_.way(q, target);
    const bool all = !(step_ < way);
    VectorX<Scalar> next = target;
    if (!all) {
      next = q + (step_ / way) * (target - q);
      box_.clamp(next);
      // A step below the rounding of positions leads nowhere.
      if (!(check_.way(next, target) < way)) return {Growth::Trapped, node};
    }
    const Posture<Scalar> made = check_.posture(std::move(next));
    // Motions are checked in the direction of the path, so that a check of the path repeats them.
    const bool free = side == 0 ? check_.is_free(trees_[side][node], made)
                                : check_.is_free(made, trees_[side][node]);
    if (!free) return {Growth::Trapped, node};
    return {all ? Growth::Reached : Growth::Advanced, trees_[side].add(made, node)};
  }
  /// Returns the path through two nodes at the same place, of both trees.
  std::vector<Posture<Scalar>> join(std::size_t from_start, std::size_t from_goal) const {
    std::vector<Posture<Scalar>> path = trees_[0].branch(from_start);
    std::reverse(path.begin(), path.end());
    std::vector<Posture<Scalar>> rest = trees_[1].branch(from_goal);
    path.insert(path.end(), rest.begin() + 1, rest.end());
    return path;
  }

  MotionCheck<Scalar, Clearance>& check_;
  const JointBox<Scalar>& box_;
  Scalar step_;
  std::array<JointTree<Scalar>, 2> trees_;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
