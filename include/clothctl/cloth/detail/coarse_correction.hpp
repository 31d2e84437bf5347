#pragma once

// The coarse part of a two-level preconditioner: corrections that are smooth across the sheet.
//
//   z += W A_c⁻¹ Wᵀ r,       A_c = Wᵀ A W
//
// Coarse vertices lie about four edges apart on the surface (dart throwing). Row i of W has the
// weights of the coarse vertices near vertex i: w = (1 - d/R)³ (1 + 3 d/R) by the distance d along
// the sides of triangles, divided by their sum. So layers of cloth keep corrections of their own,
// and bodies without triangles have none. The corrections are displacements: W acts on each of the
// three coordinates alike, and A_c is a matrix of 3×3 blocks like A, with a complete factor. An
// incomplete factor corrects what varies from edge to edge, and this what varies slowly, which
// costs conjugate gradients most of their iterations: stiff cloth passes a pull on from one end to
// the other within a step. Reference: Smith, Bjørstad and Gropp, Domain Decomposition (1996),
// chapter 2 (additive coarse correction).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/level_input.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/linalg/block_cholesky.hpp"
#include "clothctl/linalg/nested_dissection.hpp"
#include "clothctl/network/spring_network.hpp"
#include "clothctl/network/surface_distance.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the springs of a network along sides of its triangles with their rest lengths, m.
/// Allocates.
template <RealScalar Scalar>
std::vector<SurfaceEdge<>> surface_sides(const SpringNetwork<Scalar>& network) {
  std::vector<std::pair<int, int>> sides;
  for (const std::array<int, 3>& t : network.triangles) {
    for (std::size_t c = 0; c < 3; ++c) {
      const int a = t[c], b = t[(c + 1) % 3];
      sides.push_back({(std::min)(a, b), (std::max)(a, b)});
    }
  }
  std::sort(sides.begin(), sides.end());
  std::vector<SurfaceEdge<>> out;
  for (const Spring<Scalar>& s : network.springs) {
    const std::pair<int, int> ends{(std::min)(s.a, s.b), (std::max)(s.a, s.b)};
    if (std::binary_search(sides.begin(), sides.end(), ends))
      out.push_back({s.a, s.b, static_cast<double>(s.rest_length)});
  }
  return out;
}

/// The coarse correction of matrices of one pattern.
template <RealScalar Scalar>
class CoarseCorrection {
 public:
  /// Without coarse vertices: corrects nothing.
  CoarseCorrection() = default;

  /// Chooses the coarse vertices of a body, and makes the memory of factors. `sides`: those of its
  /// triangles (surface_sides); `places`: of the vertices, 3×n, m, for the order of elimination
  /// alone. Bodies of less than 200 vertices have no coarse vertices, nor have bodies of many small
  /// pieces, nor those whose A_c would be hardly smaller than A. Allocates. Complexity: O(n log n).
  CoarseCorrection(const BlockSymmetric<Scalar>& pattern, const std::vector<SurfaceEdge<>>& sides,
                   const Points<double>& places);

  /// Number of coarse vertices.
  Index size() const { return coarse_.rows(); }
  /// Number of scalars in the factor of A_c.
  Index factor_entries() const { return factor_.factor_entries(); }

  /// Factorises A_c of a matrix of the pattern without the rows and columns of the vertices with
  /// held[i] ≠ 0. Returns false when A_c is not positive definite; then `add` corrects nothing.
  /// Never allocates.
  bool factorize(const BlockSymmetric<Scalar>& matrix, std::span<const unsigned char> held);

  /// Adds W A_c⁻¹ Wᵀ r to z (1×3n each). Entries of held vertices are neither read nor changed.
  /// Never allocates.
  void add(const Lanes<Scalar, 1>& r, Lanes<Scalar, 1>& z);

 private:
  static constexpr double kSpacing = 3.5;        // of coarse vertices, in sides of triangles
  static constexpr double kReach = 1.8;          // R above, in spacings
  static constexpr double kMost = 4000.0;        // coarse vertices of a large sheet, about
  static constexpr std::size_t kWeights = 12;    // of a vertex; more lie near only at knots
  static constexpr std::size_t kRowBlocks = 24;  // of the factor of A_c, a vertex of the body

  struct Weight {
    int vertex;
    Scalar share;
  };
  std::span<const Weight> weights(Index i) const {
    const std::size_t begin = begin_[static_cast<std::size_t>(i)];
    return {weight_.data() + begin, begin_[static_cast<std::size_t>(i) + 1] - begin};
  }
  /// Chooses coarse vertices, which it returns, and fills begin_, weight_ and place_.
  std::vector<int> set_weights(Index rows, const std::vector<SurfaceEdge<>>& sides);
  /// Sets the first `column_count_` of columns_ to the coarse vertices of row i of T (factorize),
  /// and place_ to their places.
  void find_columns(const BlockSymmetric<Scalar>& matrix, Index i);
  /// Empties the columns again.
  void forget_columns();

  std::vector<std::size_t> begin_{0};
  std::vector<Weight> weight_;
  BlockSymmetric<Scalar> coarse_;
  BlockCholesky<Scalar> factor_;
  std::vector<unsigned char> held_, coarse_held_;
  Lanes<Scalar, 1> right_;
  /// A row of T (factorize): its coarse vertices, the place of each coarse vertex among these or
  /// -1, and its blocks.
  std::vector<int> columns_, place_;
  std::size_t column_count_ = 0;
  std::vector<Matrix3<Scalar>> row_;
  bool usable_ = false;
};

template <RealScalar Scalar>
CoarseCorrection<Scalar>::CoarseCorrection(const BlockSymmetric<Scalar>& pattern,
                                           const std::vector<SurfaceEdge<>>& sides,
                                           const Points<double>& places) {
  if (pattern.rows() < 200) return;
  const std::vector<int> chosen = set_weights(pattern.rows(), sides);
  if (chosen.empty()) return;
  std::vector<std::pair<int, int>> pairs;
  std::size_t longest = 0, most = 4000000;
  for (Index i = 0; i < pattern.rows(); ++i) {
    find_columns(pattern, i);
    for (const Weight& w : weights(i)) {
      for (std::size_t c = 0; c < column_count_; ++c) pairs.push_back({w.vertex, columns_[c]});
    }
    longest = (std::max)(longest, column_count_);
    forget_columns();
    if (pairs.size() < most) continue;
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    most = (std::max)(most, 2 * pairs.size());
  }
  const Index count = static_cast<Index>(chosen.size());
  Points<Scalar> coarse_places(3, count);
  for (Index c = 0; c < count; ++c)
    coarse_places.col(c) = places.col(chosen[static_cast<std::size_t>(c)]).template cast<Scalar>();
  row_.resize(longest);
  coarse_ = BlockSymmetric<Scalar>(count, std::move(pairs));
  factor_ = BlockCholesky<Scalar>(coarse_, nested_dissection<Scalar>(coarse_, coarse_places));
  if (static_cast<Index>(9 * kRowBlocks) * pattern.rows() < factor_.factor_entries()) {
    *this = CoarseCorrection();
    return;
  }
  held_.assign(static_cast<std::size_t>(pattern.rows()), 0);
  coarse_held_.assign(place_.size(), 0);
  right_.setZero(1, 3 * count);
}

template <RealScalar Scalar>
void CoarseCorrection<Scalar>::find_columns(const BlockSymmetric<Scalar>& matrix, Index i) {
  const auto take = [&](Index j) {
    for (const Weight& w : weights(j)) {
      int& place = place_[static_cast<std::size_t>(w.vertex)];
      if (0 <= place) continue;
      place = static_cast<int>(column_count_);
      columns_[column_count_++] = w.vertex;
    }
  };
  take(i);
  for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) take(matrix.column(s));
}

template <RealScalar Scalar>
void CoarseCorrection<Scalar>::forget_columns() {
  for (std::size_t c = 0; c < column_count_; ++c)
    place_[static_cast<std::size_t>(columns_[c])] = -1;
  column_count_ = 0;
}

template <RealScalar Scalar>
std::vector<int> CoarseCorrection<Scalar>::set_weights(Index rows,
                                                       const std::vector<SurfaceEdge<>>& sides) {
  const std::size_t n = static_cast<std::size_t>(rows);
  std::vector<unsigned char> on_surface(n, 0);
  double mean = 0.0, positive = 0.0;
  for (const SurfaceEdge<>& side : sides) {
    for (int v : {side.a, side.b}) on_surface[static_cast<std::size_t>(v)] = 1;
    mean += side.length;
    if (0.0 < side.length) positive += 1.0;
  }
  std::vector<int> chosen;
  if (!(0.0 < positive)) return chosen;
  mean /= positive;
  // Coarse vertices that are at least a distance s apart cover a surface by 0.7 / s² an area.
  const double count = static_cast<double>(n);
  double spacing = mean * (std::max)(kSpacing, std::sqrt(0.7 * count / kMost));
  SurfaceDistance surface(static_cast<int>(n), sides, {});
  const std::vector<int> order = level_order(std::vector<int>(n, 0), 0);
  std::vector<std::vector<std::pair<double, int>>> shares;
  for (int trial = 0; trial < 8; ++trial) {
    chosen.clear();
    shares.assign(n, {});
    std::vector<unsigned char> covered(n, 0);
    const double reach = kReach * spacing;
    for (int v : order) {
      const std::size_t from = static_cast<std::size_t>(v);
      if (covered[from] != 0 || on_surface[from] == 0) continue;
      const int c = static_cast<int>(chosen.size());
      chosen.push_back(v);
      surface.spread(v, reach, [&](int u, double d) {
        const std::size_t at = static_cast<std::size_t>(u);
        if (d <= spacing) covered[at] = 1;
        const double t = d / reach;
        const double share = (1.0 - t) * (1.0 - t) * (1.0 - t) * (1.0 + 3.0 * t);
        if (0.0 < share) shares[at].push_back({-share, c});
      });
    }
    if (static_cast<double>(chosen.size()) < (std::min)(count / 3.0, 2.0 * kMost)) break;
    chosen.clear();
    spacing *= 2.0;  // as with many small pieces
  }
  if (chosen.empty()) return chosen;
  for (auto& list : shares) {
    std::sort(list.begin(), list.end());
    list.resize((std::min)(list.size(), kWeights));
    double total = 0.0;
    for (const auto& [share, c] : list) total += share;
    for (const auto& [share, c] : list) weight_.push_back({c, Scalar(share / total)});
    begin_.push_back(weight_.size());
  }
  place_.assign(chosen.size(), -1);
  columns_.assign(chosen.size(), 0);
  return chosen;
}

template <RealScalar Scalar>
bool CoarseCorrection<Scalar>::factorize(const BlockSymmetric<Scalar>& matrix,
                                         std::span<const unsigned char> held) {
  using std::sqrt;
  usable_ = false;
  if (size() == 0) return true;
  // A = T' + T'ᵀ with half the diagonal blocks of A in T', so A_c = WᵀT + (WᵀT)ᵀ with T = T' W.
  coarse_.set_zero();
  std::fill(coarse_held_.begin(), coarse_held_.end(), static_cast<unsigned char>(1));
  std::copy(held.begin(), held.end(), held_.begin());
  const auto is_held = [&](Index i) { return held[static_cast<std::size_t>(i)] != 0; };
  for (Index i = 0; i < matrix.rows(); ++i) {
    if (is_held(i)) continue;
    find_columns(matrix, i);
    std::fill_n(row_.begin(), column_count_, Matrix3<Scalar>::Zero());
    const auto add = [&](Index j, const Matrix3<Scalar>& block, const Scalar& factor) {
      for (const Weight& w : weights(j)) {
        const int place = place_[static_cast<std::size_t>(w.vertex)];
        row_[static_cast<std::size_t>(place)] += (factor * w.share) * block;
      }
    };
    add(i, matrix.diagonal(i), Scalar(0.5));
    for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s)
      if (!is_held(matrix.column(s))) add(matrix.column(s), matrix.lower(s), Scalar(1));
    for (const Weight& w : weights(i)) {
      coarse_held_[static_cast<std::size_t>(w.vertex)] = 0;
      for (std::size_t c = 0; c < column_count_; ++c) {
        const int p = w.vertex, q = columns_[c];
        if (p == q) {
          coarse_.diagonal(p) += w.share * (row_[c] + row_[c].transpose());
        } else if (q < p) {
          coarse_.lower(coarse_.find(p, q)) += w.share * row_[c];
        } else {
          coarse_.lower(coarse_.find(p, q)) += w.share * row_[c].transpose();
        }
      }
    }
    forget_columns();
  }
  // Columns of W may be dependent when few vertices are free. Then a null vector of A_c has no
  // part in Wᵀ r, and this keeps the factor finite.
  for (Index c = 0; c < size(); ++c)
    coarse_.diagonal(c) *= Scalar(1) + sqrt(scalar_traits<Scalar>::epsilon());
  usable_ = factor_.factorize(coarse_, coarse_held_);
  return usable_;
}

template <RealScalar Scalar>
void CoarseCorrection<Scalar>::add(const Lanes<Scalar, 1>& r, Lanes<Scalar, 1>& z) {
  if (!usable_) return;
  right_.setZero();
  const Index n = static_cast<Index>(begin_.size()) - 1;
  const auto is_held = [&](Index i) { return held_[static_cast<std::size_t>(i)] != 0; };
  for (Index i = 0; i < n; ++i) {
    if (is_held(i)) continue;
    const Triple<Scalar> value = point(r, i);
    for (const Weight& w : weights(i))
      set_point(right_, w.vertex, point(right_, w.vertex) + value * w.share);
  }
  factor_.template solve<1>(right_);
  for (Index i = 0; i < n; ++i) {
    if (is_held(i)) continue;
    Triple<Scalar> sum{Scalar(0), Scalar(0), Scalar(0)};
    for (const Weight& w : weights(i)) sum = sum + point(right_, w.vertex) * w.share;
    set_point(z, i, point(z, i) + sum);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
