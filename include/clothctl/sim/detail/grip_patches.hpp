#pragma once

// The parts of a sheet that pads hold. Contacts whose triangles share vertices hold one *patch*:
// all vertices of these triangles, but for those that are prescribed.

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A contact of a pad with a sheet.
template <RealScalar Scalar>
struct GripContact {
  /// The vertices that it touches.
  std::array<int, 3> vertex{-1, -1, -1};
  /// Whether it stuck in the last step, and the normal impulse then, N s.
  bool sticks = false;
  Scalar impulse = Scalar(0);
  /// Motion of the pad: its point x moves with velocity + spin × x; m/s and rad/s.
  Vector3<Scalar> velocity = Vector3<Scalar>::Constant(Scalar(0)),
                  spin = Vector3<Scalar>::Constant(Scalar(0));
};

/// A part of a sheet that pads hold.
template <RealScalar Scalar>
struct GripPatch {
  /// Its vertices, as places in the list of all.
  std::size_t begin = 0, end = 0;
  /// Whether pads slide on it with half of their force or more.
  bool slides = true;
  /// Mean motion of the pads, as in GripContact.
  Vector3<Scalar> velocity = Vector3<Scalar>::Constant(Scalar(0)),
                  spin = Vector3<Scalar>::Constant(Scalar(0));
};

/// All patches of a sheet.
template <RealScalar Scalar>
class GripPatches {
 public:
  /// Makes room for a number of vertices. Allocates.
  void reserve(std::size_t count) {
    vertices_.reserve(count);
    patches_.reserve(count);
    owner_.reserve(count);
  }
  const std::vector<int>& vertices() const { return vertices_; }
  const std::vector<GripPatch<Scalar>>& patches() const { return patches_; }
  void clear() {
    vertices_.clear();
    patches_.clear();
  }
  /// Copies; never allocates where there is room.
  void assign(const GripPatches& other) {
    vertices_.assign(other.vertices_.begin(), other.vertices_.end());
    patches_.assign(other.patches_.begin(), other.patches_.end());
  }
  /// Lists the patches that contacts hold; `prescribed(v)` says of a vertex that nothing moves it.
  /// Never allocates where there is room.
  template <class Prescribed>
  void find(std::span<const GripContact<Scalar>> contacts, Prescribed prescribed);

 private:
  /// A vertex, and the number of the first one that belongs together with it.
  struct Owner {
    int vertex;
    std::size_t first;
  };
  std::size_t place(int v) const {
    std::size_t i = 0;
    while (i < owner_.size() && owner_[i].vertex != v) ++i;
    return i;
  }
  bool holds(const GripContact<Scalar>& c, std::size_t first) const {
    return std::any_of(c.vertex.begin(), c.vertex.end(), [&](int v) {
      const std::size_t i = place(v);
      return i < owner_.size() && owner_[i].first == first;
    });
  }
  void join(std::size_t a, std::size_t b) {
    const std::size_t low = (std::min)(a, b), high = (std::max)(a, b);
    for (Owner& one : owner_) {
      if (one.first == high) one.first = low;
    }
  }

  std::vector<int> vertices_;
  std::vector<GripPatch<Scalar>> patches_;
  std::vector<Owner> owner_;
};

template <RealScalar Scalar>
template <class Prescribed>
void GripPatches<Scalar>::find(std::span<const GripContact<Scalar>> contacts,
                               Prescribed prescribed) {
  clear();
  owner_.clear();
  for (const GripContact<Scalar>& c : contacts) {
    std::size_t before = owner_.capacity();  // no vertex of this contact yet
    for (const int v : c.vertex) {
      if (v < 0 || prescribed(v)) continue;
      const std::size_t i = place(v);
      if (i == owner_.size()) owner_.push_back({v, i});
      if (before < owner_.size()) join(owner_[before].first, owner_[i].first);
      before = i;
    }
  }
  for (std::size_t first = 0; first < owner_.size(); ++first) {
    if (owner_[first].first != first) continue;
    GripPatch<Scalar> made;
    made.begin = vertices_.size();
    for (const Owner& one : owner_) {
      if (one.first == first) vertices_.push_back(one.vertex);
    }
    made.end = vertices_.size();
    Scalar count = Scalar(0), sticks = Scalar(0), slides = Scalar(0);
    for (const GripContact<Scalar>& c : contacts) {
      if (!holds(c, first)) continue;
      (c.sticks ? sticks : slides) += c.impulse;
      made.velocity += c.velocity;
      made.spin += c.spin;
      count = count + Scalar(1);
    }
    made.velocity /= count;
    made.spin /= count;
    made.slides = !(slides < sticks);
    patches_.push_back(made);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
