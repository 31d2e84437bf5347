#pragma once

// The contacts of a step take over what those of the last step remember: the impulse, from which
// the solver starts, and the way of the tangential spring. A point is the same as an earlier one of
// its pair if it is the same feature, or else if it is close by. Each earlier point is used once.

#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/collision/body_contacts.hpp"
#include "clothctl/sim/detail/rigid_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The pairs of a contact list are in ascending order of A, and for the same A of B: bodies first,
/// then obstacles.
inline bool pair_before(const std::pair<int, int>& p, const std::pair<int, int>& q) {
  if (p.first != q.first) return p.first < q.first;
  const bool body_p = p.second >= 0, body_q = q.second >= 0;
  if (body_p != body_q) return body_p;
  return body_p ? p.second < q.second : p.second > q.second;
}

/// Walks along the contacts of the last step, pair by pair.
template <RealScalar Scalar>
class ContactMemory {
 public:
  using Contact = RigidContact<Scalar>;

  /// Starts with the contacts of the last step.
  void start(const std::vector<Contact>& old) {
    old_ = &old;
    used_.assign(old.size(), 0);
    at_ = 0;
  }
  void reserve(std::size_t contacts) { used_.reserve(contacts); }

  /// Goes on to the pair (a, b), which comes after all pairs before. Calls `skipped(contact)` for
  /// the contacts in between.
  template <class Skipped>
  void go_to(int a, int b, const Skipped& skipped) {
    for (; at_ < old_->size() && pair_before(key(at_), {a, b}); ++at_) skipped((*old_)[at_]);
    end_ = at_;
    while (end_ < old_->size() && key(end_) == std::pair<int, int>(a, b)) ++end_;
  }
  /// Gives `contacts`, the new ones of the pair, their memory, and leaves the old ones behind.
  /// Points count as close within `reach` (m).
  void remember(Contact* contacts, int count, const Scalar& reach) {
    for (const bool by_feature : {true, false}) {
      for (int i = 0; i < count; ++i) {
        Contact& c = contacts[i];
        if (c.age >= 0) continue;  // it has its memory
        const std::size_t found = find(c, by_feature, reach);
        if (found == end_) continue;
        const Contact& from = (*old_)[found];
        used_[found] = 1;
        c.age = from.age + 1;
        c.sample.impulse = from.sample.impulse;
        c.sample.offset = from.sample.offset;
        c.sample.compliance = from.sample.compliance;
      }
    }
    for (int i = 0; i < count; ++i) {
      if (contacts[i].age < 0) contacts[i].age = 0;
    }
    at_ = end_;
  }

 private:
  std::pair<int, int> key(std::size_t i) const { return {(*old_)[i].a, (*old_)[i].b}; }
  std::size_t find(const Contact& c, bool by_feature, const Scalar& reach) const {
    std::size_t best = end_;
    Scalar nearest = reach * reach;
    for (std::size_t k = at_; k < end_; ++k) {
      if (used_[k] != 0) continue;
      const Contact& from = (*old_)[k];
      if (by_feature) {
        if (from.feature == c.feature) return k;
        continue;
      }
      const Scalar square = (from.position - c.position).squaredNorm();
      if (!(square < nearest)) continue;
      nearest = square;
      best = k;
    }
    return best;
  }

  const std::vector<Contact>* old_ = nullptr;
  std::vector<char> used_;
  std::size_t at_ = 0, end_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
