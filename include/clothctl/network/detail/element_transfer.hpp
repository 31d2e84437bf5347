#pragma once

// Moves the triangle elements of a network to a changed mesh. An element over a triangle of the
// mesh goes to the parts of the triangle: with the edges D = B⁻¹ of the element at rest and the
// weights of a part's corners in the triangle, the part is at rest as it lies in the element. Its
// moduli stay. An element over a triangle that did not change keeps its numbers; one that is on no
// triangle of the mesh stays with the first copies of its vertices.

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the part of an element that lies under a new triangle. `corner[j]`: which corner of the
/// old triangle the j-th corner of the element is; `weights`: of the new triangle's corners in the
/// old triangle. False: the part is too thin for an element.
template <RealScalar Scalar>
std::pair<bool, TriangleElement<Scalar>> element_part(const TriangleElement<Scalar>& element,
                                                      const std::array<std::size_t, 3>& corner,
                                                      const CornerWeights<Scalar>& weights,
                                                      const std::array<int, 3>& triangle) {
  TriangleElement<Scalar> part = element;
  if (is_whole(weights)) {
    for (std::size_t j = 0; j < 3; ++j) part.vertex[j] = triangle[corner[j]];
    return {true, part};
  }
  const auto& b = element.rest_inverse;
  const Scalar det = element_determinant<Scalar>(b);
  DenseMatrix<Scalar, 2, 2> rest, edges;
  rest(0, 0) = b(1, 1) / det;
  rest(0, 1) = -b(0, 1) / det;
  rest(1, 0) = -b(1, 0) / det;
  rest(1, 1) = b(0, 0) / det;
  const auto place = [&](std::size_t i, Index c) {
    return weights[i][corner[1]] * rest(c, 0) + weights[i][corner[2]] * rest(c, 1);
  };
  part.vertex = triangle;
  for (std::size_t i = 1; i < 3; ++i) {
    for (Index c = 0; c < 2; ++c) edges(c, static_cast<Index>(i) - 1) = place(i, c) - place(0, c);
  }
  if (element_determinant<Scalar>(edges) < Scalar(0)) {  // the element goes round the other way
    std::swap(part.vertex[1], part.vertex[2]);
    for (Index c = 0; c < 2; ++c) std::swap(edges(c, 0), edges(c, 1));
  }
  return {part.set_rest(edges), part};
}

/// Returns the elements of a network after a change of its mesh, in their order. Allocates.
/// Complexity: O(n log n).
template <RealScalar Scalar>
std::vector<TriangleElement<Scalar>> move_elements(const SpringNetwork<Scalar>& network,
                                                   const MeshChange<Scalar>& change) {
  std::vector<TriangleElement<Scalar>> out;
  if (network.elements.empty()) return out;
  const auto sorted = [](std::array<int, 3> v) {
    std::sort(v.begin(), v.end());
    return v;
  };
  std::map<std::array<int, 3>, int> triangle_of;
  for (std::size_t t = 0; t < network.triangles.size(); ++t)
    triangle_of.emplace(sorted(network.triangles[t]), static_cast<int>(t));
  for (const TriangleElement<Scalar>& element : network.elements) {
    const auto found = triangle_of.find(sorted(element.vertex));
    if (found == triangle_of.end()) {
      TriangleElement<Scalar> moved = element;
      for (int& v : moved.vertex) v = change.remap.first_copy(v);
      const auto& v = moved.vertex;
      if (v[0] != v[1] && v[1] != v[2] && v[2] != v[0]) out.push_back(moved);
      continue;
    }
    const std::array<int, 3>& old = network.triangles[static_cast<std::size_t>(found->second)];
    std::array<std::size_t, 3> corner{};
    for (std::size_t j = 0; j < 3; ++j) {
      const auto at = std::find(old.begin(), old.end(), element.vertex[j]);
      corner[j] = static_cast<std::size_t>(at - old.begin());
    }
    for (const int child : change.remap.children(found->second)) {
      const auto [good, part] = element_part(element, corner, change.remap.corners(child),
                                             change.triangles[static_cast<std::size_t>(child)]);
      if (good) out.push_back(part);
    }
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
