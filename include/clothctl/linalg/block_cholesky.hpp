#pragma once

// Sparse Cholesky factorisation A = L Lᵀ of a symmetric positive definite matrix of 3×3 blocks,
// multifrontal.
//
// An elimination tree groups the vertices into nodes. The pivots of a node couple only to vertices
// of its subtree and of its ancestors. The nodes are eliminated from the leaves to the root. Each
// node assembles a dense front from its rows of A and the Schur complements of its children,
// eliminates its pivots, and passes its own Schur complement to its parent (dense_kernels.hpp). The
// memory positions of all entries are computed once (front_layout.hpp), and all memory is allocated
// then. A numeric factorisation only adds and multiplies. Reference: J. W. H. Liu, The multifrontal
// method for sparse matrix solution: theory and practice, SIAM Review 34 (1992).

#include <algorithm>
#include <cassert>
#include <span>

#include "clothctl/linalg/detail/front_layout.hpp"
#include "clothctl/linalg/detail/inverse_block.hpp"
#include "clothctl/linalg/detail/solve_kernels.hpp"
#include "clothctl/linalg/elimination_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The Cholesky factor of a BlockSymmetric. Allocates all memory at construction. Each thread needs
/// its own object.
template <RealScalar Scalar>
class BlockCholesky {
 public:
  /// The memory of `inverse_block`.
  using InverseBlockMemory = detail::InverseBlockMemory<Scalar>;

  /// The factor of a matrix without rows.
  BlockCholesky() = default;

  /// Analyses a pattern for an order of elimination (linalg/nested_dissection.hpp makes one).
  /// Allocates. Complexity: O(s log s), where s is the number of rows in all fronts plus the number
  /// of pairs. Fails when: the tree is not valid for the pattern (assert).
  BlockCholesky(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree)
      : layout_(pattern, tree, kAlign) {
    factor_.setZero(layout_.factor_size);
    front_.setZero(layout_.largest_front + kAlign);
    updates_.setZero(layout_.update_size + kAlign);
    scratch_.setZero(layout_.most_pivots * kMaxGroup);
  }

  /// Factorises a matrix of the analysed pattern. Vertices with held[i] ≠ 0 get the rows and
  /// columns of the identity. `held` is empty or has one entry for each vertex; it may change from
  /// call to call. Returns false when an entry of the free part is not finite or a pivot is not
  /// positive; the factor must then not be used. No allocation.
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix,
                               std::span<const unsigned char> held = {}) {
    assert(matrix.rows() == layout_.rows && matrix.lower_count() == layout_.lower_count);
    assert(held.empty() || static_cast<Index>(held.size()) == layout_.rows);
    for (const detail::Front& front : layout_.fronts) {
      Scalar* f = front_.data();
      Scalar* u = updates_.data() + front.update;
      const bool leaf = front.child_begin == front.child_end;
      std::fill_n(f, front.ld * front.pivots, Scalar(0));
      if (!assemble(front, matrix, held)) return false;
      if (!leaf) {
        for (Index j = 0; j < front.border; ++j)
          std::fill(u + j * front.ldu + j, u + (j + 1) * front.ldu, Scalar(0));
      }
      for (int c = front.child_begin; c < front.child_end; ++c)
        add_child(layout_.children[static_cast<std::size_t>(c)], front);
      if (!detail::eliminate_front(f, front.ld, front.pivots, front.border, u, front.ldu, leaf))
        return false;
      detail::pack_front(f, front.ld, front.pivots, front.border, factor_.data() + front.factor);
    }
    return true;
  }

  /// Solves A X = B in place for kLanes right-hand sides: kLanes×3n, column 3i+c is coordinate c of
  /// vertex i. Entries of held vertices do not change. No allocation. Complexity: two multiply-adds
  /// for each factor entry and right-hand side.
  template <int kLanes>
  void solve(Lanes<Scalar, kLanes>& x) {
    assert(x.cols() == 3 * layout_.rows);
    constexpr int kGroup = lane_group(kLanes);
    for (auto front = layout_.fronts.begin(); front != layout_.fronts.end(); ++front) {
      for (int lane = 0; lane < kLanes; lane += kGroup)
        forward<kLanes, kGroup>(*front, x.data(), lane);
    }
    for (auto front = layout_.fronts.rbegin(); front != layout_.fronts.rend(); ++front) {
      for (int lane = 0; lane < kLanes; lane += kGroup)
        backward<kLanes, kGroup>(*front, x.data(), lane);
    }
  }

  /// Exchanges the factor for `values`, one that an earlier call of this or an object of the same
  /// pattern and tree has given, or a vector without entries. So one object serves many factors,
  /// which need no more memory than their entries; before `solve`, put one in. Allocates only for
  /// a vector without entries.
  void exchange(VectorX<Scalar>& values) {
    if (values.size() == 0) values.setZero(layout_.factor_size);
    assert(values.size() == layout_.factor_size);
    factor_.swap(values);
  }

  /// Makes room for `inverse_block` of up to `count` vertices, each time. Allocates.
  InverseBlockMemory make_inverse_block_memory(Index count) const {
    return InverseBlockMemory(layout_.rows, static_cast<Index>(layout_.fronts.size()), count);
  }

  /// Writes the rows and columns of A⁻¹ that belong to `vertices` (m of them, each once): out is
  /// 3m×3m, row 3i+c is coordinate c of vertex i of the list. A held vertex has the identity. With
  /// L the factor and E the 3m unit vectors, out = (L⁻¹E)ᵀ(L⁻¹E). Row k of L⁻¹E is zero unless the
  /// front of k is on the way from the front of a listed vertex to the root, so only those fronts
  /// are visited. Returns false, and writes nothing, when the memory is another factor's or too
  /// small, a vertex is off the matrix, or `out` has another size. No allocation. Complexity: m
  /// multiply-adds for each entry of those fronts, and m² for each of their rows.
  bool inverse_block(std::span<const int> vertices, InverseBlockMemory& memory,
                     Eigen::Ref<MatrixX<Scalar>> out);

  /// Number of scalars in the factor.
  Index factor_entries() const {
    Index count = 0;
    for (const detail::Front& front : layout_.fronts) {
      count += front.pivots * (front.pivots + 1) / 2 + front.pivots * front.border;
    }
    return count;
  }

 private:
  static constexpr int kAlign = detail::padded_lanes<Scalar>();
  static constexpr int kMaxGroup = 16;

  /// Number of right-hand sides that a front handles together; it leaves enough registers for about
  /// twelve rows.
  static constexpr int lane_group(int lanes) {
    const int most =
        (std::min)(kMaxGroup, detail::native_lanes<Scalar>() * (detail::kManyRegisters ? 2 : 1));
    int group = 1;
    while (group < lanes && group < most) group *= 2;
    return group;
  }

  /// Copies the matrix blocks of a front into its pivot columns; held vertices get the identity.
  /// Returns false when a diagonal block has an entry above its diagonal that is not finite. The
  /// elimination does not read these entries; all other entries affect a pivot, which is checked.
  bool assemble(const detail::Front& front, const BlockSymmetric<Scalar>& matrix,
                std::span<const unsigned char> held) {
    const Index ld = front.ld;
    for (int e = front.entry_begin; e < front.entry_end; ++e) {
      const detail::FrontEntry& entry = layout_.entries[static_cast<std::size_t>(e)];
      Scalar* f = front_.data() + entry.target;
      const auto is_held = [&](int vertex) { return held[static_cast<std::size_t>(vertex)] != 0; };
      if (!held.empty() && (is_held(entry.row) || is_held(entry.column))) {
        if (entry.slot < 0) f[0] = f[ld + 1] = f[2 * ld + 2] = Scalar(1);
        continue;
      }
      const Matrix3<Scalar>& block =
          entry.slot < 0 ? matrix.diagonal(entry.row) : matrix.lower(entry.slot);
      if (entry.slot < 0 &&
          !(is_finite(block(0, 1)) && is_finite(block(0, 2)) && is_finite(block(1, 2))))
        return false;
      for (Index c = 0; c < 3; ++c) {
        for (Index r = 0; r < 3; ++r) f[c * ld + r] = entry.transposed ? block(c, r) : block(r, c);
      }
    }
    return true;
  }

  /// Adds the lower triangle of the update matrix of a child to the front, column by column.
  void add_child(const detail::FrontChild& child, const detail::Front& front) {
    const detail::Front& from = layout_.fronts[static_cast<std::size_t>(child.front)];
    const detail::FrontRun* runs = layout_.runs.data();
    for (int q = child.run_begin; q < child.run_end; ++q) {
      const bool pivot = runs[q].target < front.pivots;
      const Index ld = pivot ? front.ld : front.ldu;
      const Index shift = pivot ? 0 : front.pivots;
      Scalar* columns = pivot ? front_.data() : updates_.data() + front.update;
      for (Index t = 0; t < runs[q].length; ++t) {
        const Scalar* source = updates_.data() + from.update + (runs[q].source + t) * from.ldu;
        Scalar* target = columns + (runs[q].target + t - shift) * ld;
        detail::add_run(target + (runs[q].target + t - shift), source + runs[q].source + t,
                        runs[q].length - t);
        for (int p = q + 1; p < child.run_end; ++p) {
          detail::add_run(target + (runs[p].target - shift), source + runs[p].source,
                          runs[p].length);
        }
      }
    }
  }

  /// Reads the group of lanes that begins at `lane`. Lanes after the last right-hand side become
  /// zero.
  template <int kLanes, int kGroup>
  static CLOTHCTL_KERNEL void load_lanes(const Scalar* from, int lane,
                                         detail::Pack<Scalar, kGroup>& row) {
    if constexpr (kLanes % kGroup == 0) {
      row.load(from);
    } else {
      Scalar values[kGroup];
      for (int l = 0; l < kGroup; ++l) values[l] = lane + l < kLanes ? from[l] : Scalar(0);
      row.load(values);
    }
  }

  /// Writes the group of lanes that begins at `lane`, except lanes after the last right-hand side.
  template <int kLanes, int kGroup>
  static CLOTHCTL_KERNEL void store_lanes(Scalar* to, int lane,
                                          const detail::Pack<Scalar, kGroup>& row) {
    if constexpr (kLanes % kGroup == 0) {
      row.store(to);
    } else {
      Scalar values[kGroup];
      row.store(values);
      for (int l = 0; l < kGroup && lane + l < kLanes; ++l) to[l] = values[l];
    }
  }

  /// Copies the pivot rows of a front from the right-hand sides to the scratch rows.
  template <int kLanes, int kGroup>
  CLOTHCTL_KERNEL void gather(const detail::Front& front, const int* vertices, const Scalar* x,
                              int lane) {
    Scalar* to = scratch_.data();
    for (Index v = 0; v < front.pivots / 3; ++v) {
      const Scalar* from = x + 3 * kLanes * static_cast<Index>(vertices[v]) + lane;
      for (Index c = 0; c < 3; ++c, from += kLanes, to += kGroup) {
        detail::Pack<Scalar, kGroup> values;
        load_lanes<kLanes, kGroup>(from, lane, values);
        values.store(to);
      }
    }
  }

  /// Copies the pivot rows of a front from the scratch rows back to the right-hand sides.
  template <int kLanes, int kGroup>
  CLOTHCTL_KERNEL void scatter(const detail::Front& front, const int* vertices, Scalar* x,
                               int lane) const {
    const Scalar* from = scratch_.data();
    for (Index v = 0; v < front.pivots / 3; ++v) {
      Scalar* to = x + 3 * kLanes * static_cast<Index>(vertices[v]) + lane;
      for (Index c = 0; c < 3; ++c, to += kLanes, from += kGroup) {
        detail::Pack<Scalar, kGroup> values;
        values.load(from);
        store_lanes<kLanes, kGroup>(to, lane, values);
      }
    }
  }

  template <int kLanes, int kGroup>
  void forward(const detail::Front& front, Scalar* x, int lane) {
    const int* vertices = layout_.vertices.data() + front.vertex_begin;
    const int* border = vertices + front.pivots / 3;
    gather<kLanes, kGroup>(front, vertices, x, lane);
    detail::solve_front_forward<kGroup>(
        factor_.data() + front.factor, front.pivots, front.border, scratch_.data(),
        [&]<int kRows>(Index first, const detail::RowBlock<Scalar, kRows, kGroup>& products)
            CLOTHCTL_KERNEL_LAMBDA {
              const int* vertex = border + first / 3;
              if constexpr (kGroup == 1) {
                Scalar values[kRows];
                products.store(values);
                for (int i = 0; i < kRows; ++i) {
                  Scalar& to = x[(3 * static_cast<Index>(vertex[i / 3]) + i % 3) * kLanes + lane];
                  to = to - values[i];
                }
              } else {
                detail::unroll<kRows>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
                  Scalar* to = x + (3 * static_cast<Index>(vertex[i / 3]) + i % 3) * kLanes + lane;
                  detail::Pack<Scalar, kGroup> row;
                  load_lanes<kLanes, kGroup>(to, lane, row);
                  row.subtract(products.row[i]);
                  store_lanes<kLanes, kGroup>(to, lane, row);
                });
              }
            });
    scatter<kLanes, kGroup>(front, vertices, x, lane);
  }

  template <int kLanes, int kGroup>
  void backward(const detail::Front& front, Scalar* x, int lane) {
    const int* vertices = layout_.vertices.data() + front.vertex_begin;
    const int* border = vertices + front.pivots / 3;
    gather<kLanes, kGroup>(front, vertices, x, lane);
    detail::solve_front_backward<kGroup>(
        factor_.data() + front.factor, front.pivots, front.border, scratch_.data(),
        [&]<int kRows>(Index first, detail::RowBlock<Scalar, kRows, kGroup>& rows)
            CLOTHCTL_KERNEL_LAMBDA {
              const int* vertex = border + first / 3;
              if constexpr (kGroup == 1) {
                Scalar values[kRows];
                for (int i = 0; i < kRows; ++i)
                  values[i] = x[(3 * static_cast<Index>(vertex[i / 3]) + i % 3) * kLanes + lane];
                rows.load(values);
              } else {
                detail::unroll<kRows>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
                  const Scalar* from =
                      x + (3 * static_cast<Index>(vertex[i / 3]) + i % 3) * kLanes + lane;
                  load_lanes<kLanes, kGroup>(from, lane, rows.row[i]);
                });
              }
            });
    scatter<kLanes, kGroup>(front, vertices, x, lane);
  }

  /// Solves L Z = E for one group of lanes on the fronts of the memory's list, and adds the rows of
  /// Z to the memory.
  void forward_unit_vectors(std::span<const int> vertices, Index first, InverseBlockMemory& memory);

  detail::FrontLayout layout_;
  VectorX<Scalar> factor_;   // packed columns of all fronts
  VectorX<Scalar> front_;    // pivot columns of the present front
  VectorX<Scalar> updates_;  // update matrices that the parents have not yet assembled
  VectorX<Scalar> scratch_;  // right-hand sides of the present pivots
};

template <RealScalar Scalar>
bool BlockCholesky<Scalar>::inverse_block(std::span<const int> vertices, InverseBlockMemory& memory,
                                          Eigen::Ref<MatrixX<Scalar>> out) {
  const Index columns = 3 * static_cast<Index>(vertices.size());
  if (out.rows() != columns || out.cols() != columns) return false;
  if (!memory.fits(layout_.rows, static_cast<Index>(layout_.fronts.size()), columns / 3))
    return false;
  for (const int v : vertices) {
    if (v < 0 || v >= layout_.rows) return false;
  }
  memory.start(vertices, layout_);
  for (Index first = 0; first < columns; first += kMaxGroup)
    forward_unit_vectors(vertices, first, memory);
  memory.write_products(columns, out);
  return true;
}

template <RealScalar Scalar>
void BlockCholesky<Scalar>::forward_unit_vectors(std::span<const int> vertices, Index first,
                                                 InverseBlockMemory& memory) {
  constexpr int kGroup = lane_group(kMaxGroup);
  memory.load_unit_vectors(vertices, first, layout_);
  for (const int k : memory.fronts()) {
    for (int lane = 0; lane < kMaxGroup; lane += kGroup)
      forward<kMaxGroup, kGroup>(layout_.fronts[static_cast<std::size_t>(k)], memory.rows(), lane);
  }
  memory.keep_rows(first, layout_);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
