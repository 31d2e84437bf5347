#pragma once

// Islands: the bodies that impulses connect, through contacts and joints. What no impulse moves
// connects nothing. Islands are numbered by their first bodies, and list bodies, contacts and
// joints in ascending order, so that the result does not depend on how they were found.

#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Items sorted by the island that they belong to.
class IslandLists {
 public:
  void reserve(std::size_t items, std::size_t islands) {
    items_.reserve(items);
    start_.reserve(islands + 2);
  }
  /// Sorts the items 0 to count - 1; `island(i)` is the island of item i, -1 for none.
  template <class IslandOf>
  void build(int count, int islands, const IslandOf& island) {
    start_.assign(static_cast<std::size_t>(islands) + 1, 0);
    for (int i = 0; i < count; ++i) {
      if (island(i) >= 0) ++start_[static_cast<std::size_t>(island(i)) + 1];
    }
    for (std::size_t k = 1; k < start_.size(); ++k) start_[k] += start_[k - 1];
    items_.resize(static_cast<std::size_t>(start_.back()));
    start_.push_back(0);  // room for the shift below
    for (std::size_t k = start_.size() - 1; k > 0; --k) start_[k] = start_[k - 1];
    start_[0] = 0;
    for (int i = 0; i < count; ++i) {
      if (island(i) < 0) continue;
      int& next = start_[static_cast<std::size_t>(island(i)) + 1];
      items_[static_cast<std::size_t>(next++)] = i;
    }
    start_.pop_back();
  }
  /// The items of an island, ascending.
  std::span<const int> of(int island) const {
    const std::size_t k = static_cast<std::size_t>(island);
    const std::size_t first = static_cast<std::size_t>(start_[k]);
    return std::span<const int>(items_).subspan(first,
                                                static_cast<std::size_t>(start_[k + 1]) - first);
  }

 private:
  std::vector<int> items_, start_;
};

/// Finds islands.
class RigidIslands {
 public:
  /// Makes room. Allocates.
  void reserve(std::size_t bodies, std::size_t contacts, std::size_t joints) {
    parent_.reserve(bodies);
    number_.reserve(bodies);
    bodies_.reserve(bodies, bodies);
    contacts_.reserve(contacts, bodies);
    joints_.reserve(joints, bodies);
  }
  /// Starts with `bodies` bodies, each for itself.
  void clear(int bodies) {
    parent_.resize(static_cast<std::size_t>(bodies));
    for (int i = 0; i < bodies; ++i) parent_[static_cast<std::size_t>(i)] = i;
  }
  /// Joins the islands of two bodies that move.
  void join(int i, int j) {
    i = root(i);
    j = root(j);
    if (i < j) parent_[static_cast<std::size_t>(j)] = i;
    if (j < i) parent_[static_cast<std::size_t>(i)] = j;
  }
  /// The first body of the island of a body.
  int root(int i) {
    while (parent_[static_cast<std::size_t>(i)] != i) {
      int& up = parent_[static_cast<std::size_t>(i)];
      up = parent_[static_cast<std::size_t>(up)];
      i = up;
    }
    return i;
  }
  /// Numbers the islands of the bodies that `moves(i)`, and sorts contacts and joints: a function
  /// each returns a body of contact or joint i that moves, or -1 for one of no island.
  template <class Moves, class OfContact, class OfJoint>
  void build(const Moves& moves, int contacts, const OfContact& of_contact, int joints,
             const OfJoint& of_joint) {
    const int n = static_cast<int>(parent_.size());
    number_.assign(parent_.size(), -1);
    count_ = 0;
    for (int i = 0; i < n; ++i) {
      if (moves(i) && root(i) == i) number_[static_cast<std::size_t>(i)] = count_++;
    }
    const auto island = [&](int i) {
      return i < 0 || !moves(i) ? -1 : number_[static_cast<std::size_t>(root(i))];
    };
    bodies_.build(n, count_, island);
    contacts_.build(contacts, count_, [&](int i) { return island(of_contact(i)); });
    joints_.build(joints, count_, [&](int i) { return island(of_joint(i)); });
  }
  int count() const { return count_; }
  std::span<const int> bodies(int island) const { return bodies_.of(island); }
  std::span<const int> contacts(int island) const { return contacts_.of(island); }
  std::span<const int> joints(int island) const { return joints_.of(island); }

 private:
  std::vector<int> parent_, number_;
  IslandLists bodies_, contacts_, joints_;
  int count_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
