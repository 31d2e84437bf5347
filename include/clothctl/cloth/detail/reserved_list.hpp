#pragma once

// A list whose copies have its capacity. Workspaces hold lists that are filled anew in every step;
// the copy of a std::vector would allocate there.

#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A std::vector whose copies have at least its capacity. Copying allocates.
template <class T>
class ReservedList : public std::vector<T> {
 public:
  using std::vector<T>::vector;
  ReservedList() = default;
  ReservedList(const ReservedList& other) : std::vector<T>() { *this = other; }
  ReservedList(ReservedList&&) noexcept = default;
  ReservedList& operator=(const ReservedList& other) {
    if (this == &other) return *this;
    this->reserve(other.capacity());
    this->assign(other.begin(), other.end());
    return *this;
  }
  ReservedList& operator=(ReservedList&&) noexcept = default;
  ~ReservedList() = default;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
