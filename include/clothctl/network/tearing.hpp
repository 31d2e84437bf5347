#pragma once

// Tears a network where springs are strained too far. With l the length of a spring and l0 its rest
// length, a spring of a kind with the limit s breaks when
//
//   (l - l0) / l0 > s.
//
// A broken spring on a sheet splits a vertex: the plane through one of its ends, normal to the
// spring in the rest shape, divides the triangles around that end; each side keeps its own copy of
// the vertex (mesh_editor.hpp), and the spring goes with its side. So no cloth is lost, and a tear
// runs from vertex to vertex across the tension. The end is the one whose broken springs are
// overloaded most in sum; if all its triangles are on one side, it is the other end. Seams and
// springs that resist bending do not hold the surface together: they are removed. So is a spring
// with an end on no triangle, as in a rope.
//
// Each step looks for broken springs, which does not allocate; the network changes between steps:
//
//   TornSprings<double> torn;
//   torn.reserve_splits(64);
//   …  model.step(state, input, dt, workspace);
//   if (find_torn(model.network(), state.positions, limits, torn) > 0) {
//     const auto tear = apply_topology_changes(model.network(), torn);
//     state = remap_state(state, tear->change.remap);   // then a new model of tear->change.network
//   }

#include <algorithm>
#include <array>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/mesh/surface_cut.hpp"
#include "clothctl/network/network_change.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The strains at which springs break, by their kind. 0 or unbounded: never. The defaults never
/// tear.
template <RealScalar Scalar>
struct TearSettings {
  /// Limit of the edges of a mesh and the threads of a grid.
  Scalar structural = Scalar(0);
  /// Limit of the diagonals of the cells.
  Scalar shear = Scalar(0);
  /// Limit of springs that resist bending.
  Scalar bend = Scalar(0);
  /// Limit of seams.
  Scalar seam = Scalar(0);

  /// Returns the limit of a kind of springs.
  const Scalar& limit(SpringKind kind) const {
    switch (kind) {
      case SpringKind::Shear: return shear;
      case SpringKind::Bend: return bend;
      case SpringKind::Seam: return seam;
      default: return structural;
    }
  }

  /// Returns an empty string when no limit is NaN or negative, else a line that names the first bad
  /// one. Allocates.
  std::string validate() const {
    const std::array<std::pair<const char*, const Scalar*>, 4> limits{
        {{"structural", &structural}, {"shear", &shear}, {"bend", &bend}, {"seam", &seam}}};
    for (const auto& [name, limit] : limits) {
      if ((!is_finite(*limit) && !is_unbounded(*limit)) || *limit < Scalar(0))
        return std::string("tear limit ") + name + " must not be negative, got " +
               number_text(*limit);
    }
    return {};
  }
};

/// A broken spring.
template <RealScalar Scalar>
struct TornSpring {
  /// Its index in the network.
  int spring = 0;
  /// Its strain divided by its limit, above 1.
  Scalar overload = Scalar(0);
};

/// The broken springs of a step, the most overloaded first. Holds at most as many as were reserved.
template <RealScalar Scalar>
class TornSprings {
 public:
  /// Makes room for the `most` most overloaded springs of a step. A negative number counts as 0.
  /// Allocates.
  void reserve_splits(Index most) {
    most_ = static_cast<std::size_t>((std::max)(most, Index(0)));
    springs_.clear();
    springs_.reserve(most_);
  }
  /// Returns the broken springs.
  const std::vector<TornSpring<Scalar>>& springs() const { return springs_; }
  /// Returns their number.
  Index count() const { return static_cast<Index>(springs_.size()); }
  /// Forgets all.
  void clear() { springs_.clear(); }

  /// Adds a spring, in place of the least overloaded one when there is no room. Never allocates.
  void add(const TornSpring<Scalar>& spring) {
    if (most_ == 0) return;
    if (springs_.size() == most_) {
      if (!before(spring, springs_.front())) return;
      std::pop_heap(springs_.begin(), springs_.end(), before);
      springs_.pop_back();
    }
    springs_.push_back(spring);
    std::push_heap(springs_.begin(), springs_.end(), before);
  }
  /// Puts the most overloaded first, after the last `add`. Never allocates.
  void sort() { std::sort(springs_.begin(), springs_.end(), before); }

 private:
  static bool before(const TornSpring<Scalar>& a, const TornSpring<Scalar>& b) {
    if (b.overload < a.overload) return true;
    return !(a.overload < b.overload) && a.spring < b.spring;
  }

  std::size_t most_ = 0;
  std::vector<TornSpring<Scalar>> springs_;
};

/// Writes to `torn` the springs of a network that break at vertex positions `x` (3×n, m) and
/// returns their number, at most the number that was reserved. There are none when `x` has another
/// number of vertices; a spring with an end that is not finite does not break. Never allocates.
/// Complexity: O(springs).
template <RealScalar Scalar>
Index find_torn(const SpringNetwork<Scalar>& network, const Points<Scalar>& x,
                const TearSettings<Scalar>& settings, TornSprings<Scalar>& torn) {
  using std::sqrt;
  torn.clear();
  if (x.cols() != network.vertex_count()) return 0;
  for (std::size_t s = 0; s < network.springs.size(); ++s) {
    const Spring<Scalar>& spring = network.springs[s];
    const Scalar limit = settings.limit(spring.kind);
    if (!is_finite(limit) || !(Scalar(0) < limit)) continue;
    const Scalar squared = (x.col(spring.b) - x.col(spring.a)).squaredNorm();
    if (!is_finite(squared)) continue;
    const Scalar longest = (Scalar(1) + limit) * spring.rest_length;
    if (!(longest * longest < squared)) continue;
    const Scalar strain = (sqrt(squared) - spring.rest_length) / spring.rest_length;
    torn.add({static_cast<int>(s), Scalar(strain / limit)});
  }
  torn.sort();
  return torn.count();
}

/// What a tear did.
template <RealScalar Scalar>
struct Tear {
  /// The torn network and its remap.
  NetworkChange<Scalar> change;
  /// Number of vertices that were split.
  int split_vertices = 0;
  /// Number of springs that were removed: seams, bend springs, springs of ropes.
  int removed_springs = 0;
  /// Number of springs that cannot be torn: all triangles at both ends are on one side.
  int whole_springs = 0;
};

namespace detail {

/// Marks the tears of broken springs in the mesh of a network.
template <RealScalar Scalar>
class TearMarker {
 public:
  TearMarker(const SpringNetwork<Scalar>& network, const TornSprings<Scalar>& torn,
             MeshEditor<Scalar>& editor)
      : network_(network),
        torn_(torn),
        editor_(editor),
        load_(static_cast<std::size_t>(network.vertex_count()), Scalar(0)),
        used_(load_.size(), false) {}

  /// Fills the counts of `tear` and the list of springs to remove.
  void run(Tear<Scalar>& tear, std::vector<int>& removed) {
    for (const TornSpring<Scalar>& t : torn_.springs()) {
      const Spring<Scalar>& spring = network_.springs[static_cast<std::size_t>(t.spring)];
      load_[static_cast<std::size_t>(spring.a)] += t.overload;
      load_[static_cast<std::size_t>(spring.b)] += t.overload;
    }
    for (const TornSpring<Scalar>& t : torn_.springs()) {
      const Spring<Scalar>& spring = network_.springs[static_cast<std::size_t>(t.spring)];
      const bool on_sheet = !editor_.around(spring.a).empty() && !editor_.around(spring.b).empty();
      if (!on_sheet || spring.kind == SpringKind::Seam || spring.kind == SpringKind::Bend) {
        removed.push_back(t.spring);
      } else if (!used(spring.a) && !used(spring.b) && !split(spring)) {
        ++tear.whole_springs;
      }
    }
    tear.removed_springs = static_cast<int>(removed.size());
  }

 private:
  bool used(int v) const { return used_[static_cast<std::size_t>(v)]; }

  bool split(const Spring<Scalar>& spring) {
    const Vector3<Scalar> normal =
        network_.rest_positions.col(spring.b) - network_.rest_positions.col(spring.a);
    const Scalar at_a = load_[static_cast<std::size_t>(spring.a)],
                 at_b = load_[static_cast<std::size_t>(spring.b)];
    const bool b_first = at_a < at_b;
    for (const int v : {b_first ? spring.b : spring.a, b_first ? spring.a : spring.b}) {
      if (editor_.mark_across(v, normal) == 0) continue;
      used_[static_cast<std::size_t>(v)] = true;
      return true;
    }
    return false;
  }

  const SpringNetwork<Scalar>& network_;
  const TornSprings<Scalar>& torn_;
  MeshEditor<Scalar>& editor_;
  std::vector<Scalar> load_;
  std::vector<bool> used_;
};

}  // namespace detail

/// Tears a network at the broken springs that `find_torn` found in it. Springs at a vertex that is
/// split already are left alone; if they are still overloaded, the next step finds them. Allocates.
/// Complexity: O(n log n). Fails when: `change_network` fails, or a spring is not one of the
/// network.
template <RealScalar Scalar>
Result<Tear<Scalar>> apply_topology_changes(const SpringNetwork<Scalar>& network,
                                            const TornSprings<Scalar>& torn) {
  for (const TornSpring<Scalar>& t : torn.springs()) {
    if (t.spring < 0 || t.spring >= static_cast<int>(network.springs.size()))
      return Error{"torn spring " + std::to_string(t.spring) + " is not one of " +
                   std::to_string(network.springs.size()) + " springs"};
  }
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  Result<MeshEditor<Scalar>> editor =
      MeshEditor<Scalar>::create(network.rest_positions, network.triangles);
  if (!editor) return Error{editor.error()};
  Tear<Scalar> tear;
  std::vector<int> removed;
  detail::TearMarker<Scalar>(network, torn, editor.value()).run(tear, removed);
  tear.split_vertices = editor.value().open_marked();
  Result<NetworkChange<Scalar>> change = change_network(network, editor.value().change(), removed);
  if (!change) return Error{change.error()};
  tear.change = std::move(change).value();
  return tear;
}

/// Cuts a network along a polyline (3×k, m) that was drawn on its surface at vertex positions `x`
/// (3×n, m): the current ones, or `network.rest_positions`. Allocates. Fails when: `cut_surface` or
/// `change_network` fails, or `x` has another number of vertices.
template <RealScalar Scalar>
Result<NetworkChange<Scalar>> cut_network(
    const SpringNetwork<Scalar>& network, const std::type_identity_t<PointsView<Scalar>>& x,
    const std::type_identity_t<PointsView<Scalar>>& polyline,
    const std::type_identity_t<CutSettings<Scalar>>& settings) {
  if (x.cols() != network.vertex_count())
    return Error{std::to_string(x.cols()) + " positions for " +
                 std::to_string(network.vertex_count()) + " vertices of the network"};
  Result<SurfaceCut<Scalar>> cut = cut_surface<Scalar>(x, network.triangles, polyline, settings);
  if (!cut) return Error{cut.error()};
  return change_network(network, std::move(cut.value().change));
}

}  // namespace clothctl::inline CLOTHCTL_ABI
