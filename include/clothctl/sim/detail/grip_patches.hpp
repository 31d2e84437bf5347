#pragma once

// The parts of a sheet that pads hold. Contacts whose triangles share vertices or are joined by an
// edge hold one *patch*: all vertices of these triangles. There is no patch where one would be next
// to a vertex that is pinned or driven, or where a vertex of it lies on an obstacle: what holds the
// sheet there as well acts in the sheet's own step.

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/network/spring_network.hpp"

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
  /// Unit normal of the pad, to the sheet.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
};

/// Which vertices of a sheet are joined: by springs, other than those of bending, or by a side of a
/// triangle.
template <RealScalar Scalar>
class VertexNeighbours {
 public:
  VertexNeighbours() = default;
  /// Allocates.
  explicit VertexNeighbours(const SpringNetwork<Scalar>& network);
  /// The neighbours of a vertex.
  std::span<const int> of(int v) const {
    const std::size_t begin = begin_[static_cast<std::size_t>(v)],
                      end = begin_[static_cast<std::size_t>(v) + 1];
    return {list_.data() + begin, end - begin};
  }
  /// The number of the connected part of the sheet that a vertex is on, and that of all parts.
  int part(int v) const { return part_[static_cast<std::size_t>(v)]; }
  int part_count() const { return part_count_; }

 private:
  std::vector<std::size_t> begin_{0};
  std::vector<int> list_, part_;
  int part_count_ = 0;
};

template <RealScalar Scalar>
VertexNeighbours<Scalar>::VertexNeighbours(const SpringNetwork<Scalar>& network) {
  std::vector<std::pair<int, int>> pairs;
  const auto add = [&](int a, int b) {
    pairs.push_back({a, b});
    pairs.push_back({b, a});
  };
  for (const Spring<Scalar>& s : network.springs) {
    if (s.kind != SpringKind::Bend) add(s.a, s.b);
  }
  for (const std::array<int, 3>& t : network.triangles) {
    for (std::size_t k = 0; k < 3; ++k) add(t[k], t[(k + 1) % 3]);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  const std::size_t n = static_cast<std::size_t>(network.vertex_count());
  begin_.assign(n + 1, 0);
  for (const auto& pair : pairs) {
    ++begin_[static_cast<std::size_t>(pair.first) + 1];
    list_.push_back(pair.second);
  }
  for (std::size_t v = 0; v < n; ++v) begin_[v + 1] += begin_[v];
  part_.assign(n, -1);
  std::vector<int> open;
  for (std::size_t v = 0; v < n; ++v) {
    if (part_[v] >= 0) continue;
    part_[v] = part_count_;
    open.push_back(static_cast<int>(v));
    while (!open.empty()) {
      const int next = open.back();
      open.pop_back();
      for (const int other : of(next)) {
        if (part(other) >= 0) continue;
        part_[static_cast<std::size_t>(other)] = part_count_;
        open.push_back(other);
      }
    }
    ++part_count_;
  }
}

/// A part of a sheet that pads hold.
template <RealScalar Scalar>
struct GripPatch {
  /// Its vertices, as places in the list of all.
  std::size_t begin = 0, end = 0;
  /// Whether pads slide on it with half of their force or more.
  bool slides = true;
  /// Mean motion of the pads, as in GripContact, weighted by their force.
  Vector3<Scalar> velocity = Vector3<Scalar>::Constant(Scalar(0)),
                  spin = Vector3<Scalar>::Constant(Scalar(0));
  /// Normal of the pad that presses most, to the sheet, and whether others press against it.
  Vector3<Scalar> axis = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  bool opposed = false;
};

/// All patches of a sheet.
template <RealScalar Scalar>
class GripPatches {
 public:
  /// Makes room for `count` vertices in patches, of a sheet of `vertex_count`. Allocates.
  void reserve(std::size_t count, Index vertex_count) {
    vertices_.reserve(count);
    patches_.reserve(count);
    owner_.reserve(count);
    slot_.assign(static_cast<std::size_t>(vertex_count), -1);
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
  /// Finds the patches that contacts hold. `prescribed(v)` says of a vertex that it is pinned or
  /// driven, `lies(v)` that it touches an obstacle. Never allocates where there is room.
  template <class Prescribed, class Lies>
  void find(std::span<const GripContact<Scalar>> contacts,
            const VertexNeighbours<Scalar>& neighbours, Prescribed prescribed, Lies lies);

 private:
  /// A vertex, and the place of the first one that belongs together with it.
  struct Owner {
    int vertex;
    std::size_t first;
  };
  int& slot(int v) { return slot_[static_cast<std::size_t>(v)]; }
  bool holds(const GripContact<Scalar>& c, std::size_t first) {
    return std::any_of(c.vertex.begin(), c.vertex.end(), [&](int v) {
      return 0 <= v && 0 <= slot(v) && owner_[static_cast<std::size_t>(slot(v))].first == first;
    });
  }
  void join(int a, int b) {
    const std::size_t one = owner_[static_cast<std::size_t>(a)].first,
                      other = owner_[static_cast<std::size_t>(b)].first;
    for (Owner& owner : owner_) {
      if (owner.first == (std::max)(one, other)) owner.first = (std::min)(one, other);
    }
  }
  /// Sets how the contacts of a patch move and press.
  void set_motion(std::span<const GripContact<Scalar>> contacts, std::size_t first,
                  GripPatch<Scalar>& patch);

  std::vector<int> vertices_, slot_;  // slot_: place of a vertex in owner_, or -1
  std::vector<GripPatch<Scalar>> patches_;
  std::vector<Owner> owner_;
};

template <RealScalar Scalar>
void GripPatches<Scalar>::set_motion(std::span<const GripContact<Scalar>> contacts,
                                     std::size_t first, GripPatch<Scalar>& patch) {
  Scalar sum = Scalar(0), sticks = Scalar(0), largest = Scalar(-1), count = Scalar(0);
  for (const GripContact<Scalar>& c : contacts) {
    if (!holds(c, first)) continue;
    sum = sum + c.impulse;
    count = count + Scalar(1);
    if (c.sticks) sticks = sticks + c.impulse;
    if (!(largest < c.impulse)) continue;
    largest = c.impulse;
    patch.axis = c.normal;
  }
  patch.slides = !(sum < Scalar(2) * sticks);
  for (const GripContact<Scalar>& c : contacts) {
    if (!holds(c, first)) continue;
    const Scalar weight = Scalar(0) < sum ? Scalar(c.impulse / sum) : Scalar(Scalar(1) / count);
    patch.velocity += weight * c.velocity;
    patch.spin += weight * c.spin;
    patch.opposed = patch.opposed || c.normal.dot(patch.axis) < Scalar(-0.5);
  }
}

template <RealScalar Scalar>
template <class Prescribed, class Lies>
void GripPatches<Scalar>::find(std::span<const GripContact<Scalar>> contacts,
                               const VertexNeighbours<Scalar>& neighbours, Prescribed prescribed,
                               Lies lies) {
  clear();
  owner_.clear();
  for (const GripContact<Scalar>& c : contacts) {
    int before = -1;
    for (const int v : c.vertex) {
      if (v < 0 || prescribed(v)) continue;
      if (slot(v) < 0) {
        slot(v) = static_cast<int>(owner_.size());
        owner_.push_back({v, owner_.size()});
      }
      if (0 <= before) join(slot(before), slot(v));
      before = v;
    }
  }
  for (std::size_t i = 0; i < owner_.size(); ++i) {
    for (const int v : neighbours.of(owner_[i].vertex)) {
      if (0 <= slot(v)) join(static_cast<int>(i), slot(v));
    }
  }
  const auto is_held_otherwise = [&](int v) {
    const std::span<const int> around = neighbours.of(v);
    return lies(v) || std::any_of(around.begin(), around.end(), prescribed);
  };
  for (std::size_t first = 0; first < owner_.size(); ++first) {
    if (owner_[first].first != first) continue;
    const auto of_patch = [&](const Owner& one) { return one.first == first; };
    if (std::any_of(owner_.begin(), owner_.end(), [&](const Owner& one) {
          return of_patch(one) && is_held_otherwise(one.vertex);
        }))
      continue;
    GripPatch<Scalar> made;
    made.begin = vertices_.size();
    for (const Owner& one : owner_) {
      if (of_patch(one)) vertices_.push_back(one.vertex);
    }
    made.end = vertices_.size();
    set_motion(contacts, first, made);
    patches_.push_back(made);
  }
  for (const Owner& one : owner_) slot(one.vertex) = -1;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
