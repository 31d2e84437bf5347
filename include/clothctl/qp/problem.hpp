#pragma once

// The quadratic program that all solvers of this folder solve, their settings and their result:
//
//   min ½ xᵀHx + gᵀx   subject to   rl ≤ A x ≤ ru,  lb ≤ x ≤ ub
//
// H is symmetric positive semidefinite (n×n), A is m×n. An absent bound is infinite. The
// multipliers y of the rows and z of the bounds satisfy
//
//   H x + g = Aᵀ y + z
//
// A multiplier is ≥ 0 at a lower bound, ≤ 0 at an upper bound, and 0 between the bounds. Where the
// two bounds are equal it may have either sign.

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string_view>
#include <vector>

#include "clothctl/core/status.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The position of an unknown or a row between its bounds. An active set holds one for each
/// unknown and each row.
enum class QpSide : signed char {
  /// At its lower bound, or fixed.
  Lower = -1,
  /// Free: not at a bound.
  Between = 0,
  /// At its upper bound.
  Upper = 1
};

/// Tolerances and budget of a QP solve. Tolerances hold for the caller's own (unscaled) data,
/// relative to problem magnitude as in `kkt_residuals`.
template <RealScalar Scalar>
struct QpSettings {
  /// Spacing of the scalar at one, to the power 9/16: 1.6e-9 in double, 1.3e-4 in float.
  static Scalar default_tolerance() {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    return half * sqrt(sqrt(sqrt(half)));
  }
  /// Limit on the largest entry of |Hx + g - Aᵀy - z| divided by max(1, |Hx|, |g|).
  Scalar stationarity_tolerance = default_tolerance();
  /// Limit on the largest violation of a bound or row divided by max(1, |Ax|, |x|).
  Scalar feasibility_tolerance = default_tolerance();
  /// Limit on Σ |multiplier| · slack divided by max(1, |objective|).
  Scalar complementarity_tolerance = default_tolerance();
  /// Limit on the rounds of a solve, each of which changes the active set; 0 means 10 (n + m + 1).
  int max_iterations = 0;
  /// Time limit of a solve, s, measured by `clock`, which is read at the start and after each
  /// round; 0 means no limit.
  double time_limit = 0;
  /// The caller's clock: seconds since any fixed moment. Needed when there is a time limit.
  double (*clock)(void* context) = nullptr;
  /// The argument that `clock` gets.
  void* clock_context = nullptr;

  /// True when a solve that ends as PrimalInfeasible goes on to the closest feasible point: x then
  /// minimises the objective among the points of the least Σ s² with rl ≤ A x + s ≤ ru, lb ≤ x ≤
  /// ub, and the shifts s are in the result. Only for ActiveSet. Scaling a row changes its weight
  /// in Σ s².
  bool closest_point = false;

  /// Checks the values. Returns an empty text, or a static one that names the first bad value.
  std::string_view validate() const {
    const auto bad = [](const Scalar& t) { return !is_finite(t) || !(Scalar(0) < t); };
    if (bad(stationarity_tolerance)) return "stationarity_tolerance is not a positive number";
    if (bad(feasibility_tolerance)) return "feasibility_tolerance is not a positive number";
    if (bad(complementarity_tolerance)) return "complementarity_tolerance is not a positive number";
    if (max_iterations < 0) return "max_iterations is negative";
    if (!is_finite(time_limit) || time_limit < 0) return "time_limit is negative or not finite";
    if (time_limit > 0 && clock == nullptr) return "time_limit is set without a clock";
    return {};
  }
};

/// The result of a QP solve. Its vectors allocate when the problem's size changes, never between
/// solves of one size.
template <RealScalar Scalar>
struct QpResult {
  /// The minimiser, n entries. With IterationLimit and TimeLimit it is the best iterate, which is
  /// within its bounds but may violate rows by as much as `feasibility` says. With InvalidData it
  /// is zero. Before the first solve it is empty.
  VectorX<Scalar> x;
  /// Multipliers z of the bounds, n. With PrimalInfeasible: the bound part of the Farkas pair (see
  /// row_multipliers).
  VectorX<Scalar> bound_multipliers;
  /// Multipliers y of the rows, m. With PrimalInfeasible: Aᵀy + z = 0 while the largest value of
  /// yᵀr + zᵀx over all r in [rl, ru], x in [lb, ub] is negative, which no feasible point allows.
  VectorX<Scalar> row_multipliers;
  /// With DualInfeasible: a direction d (n) along which the objective falls without limit and no
  /// bound is ever met; else zero.
  VectorX<Scalar> ray;
  /// With PrimalInfeasible and QpSettings::closest_point: the smallest shifts s (m) with which Ax +
  /// s satisfies the row bounds; else zero.
  VectorX<Scalar> row_shifts;
  /// The active set of the bounds (n), which `warm_start` accepts. All Between if the problem is
  /// infeasible or unbounded.
  std::vector<QpSide> bound_sides;
  /// The active set of the rows (m): rows with a nonzero multiplier and equalities are active.
  std::vector<QpSide> row_sides;
  /// How the solve ended.
  QpStatus status = QpStatus::InvalidData;
  /// Rounds in which the active set changed; 0 when the active set of a warm start was already
  /// optimal.
  int iterations = 0;
  /// Relative stationarity residual of the caller's data.
  Scalar stationarity = Scalar(0);
  /// Relative feasibility residual of the caller's data.
  Scalar feasibility = Scalar(0);
  /// Relative complementarity residual of the caller's data.
  Scalar complementarity = Scalar(0);
  /// ½ xᵀHx + gᵀx.
  Scalar objective = Scalar(0);
  /// With InvalidData: what was refused; with QpSettings::closest_point: why x or the shifts are
  /// not the minimisers (static text); else empty.
  const char* message = "";
  /// With InvalidData: index of the first refused entry (column-major in a matrix), or -1.
  Index invalid_index = -1;

  /// Sizes the vectors for n unknowns and m rows and zeroes them. Allocates when a size changes.
  void resize(Index n, Index m) {
    x.setZero(n);
    bound_multipliers.setZero(n);
    row_multipliers.setZero(m);
    ray.setZero(n);
    row_shifts.setZero(m);
    bound_sides.assign(static_cast<std::size_t>(n), QpSide::Between);
    row_sides.assign(static_cast<std::size_t>(m), QpSide::Between);
  }
};

/// What a QP solver refused when it was given a size or a matrix, and where.
struct QpRefusal {
  /// Solved when nothing was refused, else InvalidData or NonConvex.
  QpStatus status = QpStatus::Solved;
  /// What was refused (static text), or empty.
  const char* message = "";
  /// Index of the refused entry (column-major), or -1.
  Index index = -1;
};

namespace detail {

/// Stands for "no bound" inside solvers: finite, so that comparisons hold under -ffast-math, and
/// beyond what a real bound (at most 1e20) becomes under scaling by 2^±60.
template <RealScalar Scalar>
Scalar no_bound() {
  return Scalar(2e38);
}

/// Bounds beyond ± this value count as infinite, so a point with an entry beyond it is no solution.
template <RealScalar Scalar>
Scalar largest_bound() {
  return Scalar(1e20);
}

/// Which bound was refused, and why. The texts are for bounds of unknowns and of rows.
struct BoundRefusal {
  /// Index of the refused pair, or -1 when all pairs are valid.
  Index index = -1;
  /// What is wrong with the bounds of an unknown.
  const char* bound = "";
  /// What is wrong with the bounds of a row.
  const char* row = "";
};

/// Copies bounds, replacing unbounded values by ±no_bound. Returns the first pair that it refuses:
/// a NaN, lower above upper, or an infinity on the wrong side.
template <RealScalar Scalar>
BoundRefusal load_bounds(const Eigen::Ref<const VectorX<Scalar>>& lower,
                         const Eigen::Ref<const VectorX<Scalar>>& upper,
                         Eigen::Ref<VectorX<Scalar>> lo, Eigen::Ref<VectorX<Scalar>> hi) {
  const Scalar big = no_bound<Scalar>();
  for (Index i = 0; i < lower.size(); ++i) {
    const Scalar l = lower[i];
    const Scalar u = upper[i];
    const bool l_open = is_unbounded(l);
    const bool u_open = is_unbounded(u);
    if (!l_open && !is_finite(l)) return {i, "lower bound is NaN", "lower row bound is NaN"};
    if (!u_open && !is_finite(u)) return {i, "upper bound is NaN", "upper row bound is NaN"};
    if (l_open && l > Scalar(0))
      return {i, "lower bound is +infinite", "lower row bound is +infinite"};
    if (u_open && u < Scalar(0))
      return {i, "upper bound is -infinite", "upper row bound is -infinite"};
    lo[i] = l_open ? -big : l;
    hi[i] = u_open ? big : u;
    if (lo[i] > hi[i])
      return {i, "lower bound is above the upper one", "lower row bound is above the upper one"};
  }
  return {};
}

/// Returns true when a loaded bound, scaled or not, stands for a finite bound of the caller.
template <RealScalar Scalar>
bool has_bound(const Scalar& bound) {
  return bound < Scalar(1.5e38) && bound > Scalar(-1.5e38);
}

/// Returns the bound multiplier of an unknown at x with gradient entry q: the part of q that its
/// loaded bounds can balance.
template <RealScalar Scalar>
Scalar bound_multiplier(const Scalar& q, const Scalar& x, const Scalar& lo, const Scalar& hi) {
  if (!(lo < hi)) return q;
  if (!(x > lo)) return (std::max)(Scalar(0), q);
  if (!(x < hi)) return (std::min)(Scalar(0), q);
  return Scalar(0);
}

/// Returns x, moved to a bound that it violates by at most `slack`.
template <RealScalar Scalar>
Scalar snap(const Scalar& x, const Scalar& lo, const Scalar& hi, const Scalar& slack) {
  if (x < lo) return lo - x <= slack ? lo : x;
  return x > hi && x - hi <= slack ? hi : x;
}

/// Returns true when every value is a side.
inline bool are_sides(std::span<const QpSide> sides) {
  return std::all_of(sides.begin(), sides.end(), [](QpSide s) {
    return s == QpSide::Lower || s == QpSide::Between || s == QpSide::Upper;
  });
}

/// Returns true when the finite H is equal to its transpose.
template <RealScalar Scalar>
bool equals_transpose(const Eigen::Ref<const MatrixX<Scalar>>& H) {
  constexpr Index kTile = 16;  // reads whole lines of cache in both directions
  const Index n = H.rows();
  for (Index first = 0; first < n; first += kTile) {
    for (Index top = first; top < n; top += kTile) {
      bool equal = true;
      for (Index j = first; j < (std::min)(first + kTile, n); ++j) {
        for (Index i = top; i < (std::min)(top + kTile, n); ++i)
          equal &= H(i, j) == H(j, i);  // without branches it is vectorised
      }
      if (!equal) return false;
    }
  }
  return true;
}

/// Returns true when every entry of a finite H obeys h_ij² <= h_ii h_jj, as far as products tell
/// that neither overflow nor underflow; false says nothing.
template <RealScalar Scalar>
bool within_diagonal(const Eigen::Ref<const MatrixX<Scalar>>& H) {
  constexpr Index kTile = 64;
  const Scalar least = Scalar(1e-30), most = Scalar(1e30);
  const Index n = H.rows();
  std::array<Scalar, kTile> diagonal{};
  for (Index top = 0; top < n; top += kTile) {
    const Index rows = (std::min)(kTile, n - top);
    for (Index i = 0; i < rows; ++i) diagonal[static_cast<std::size_t>(i)] = H(top + i, top + i);
    for (Index j = 0; j < top + rows; ++j) {
      const Scalar own = H(j, j);
      const Scalar* column = &H.coeffRef(top, j);
      bool within = Scalar(0) < own;
      for (Index i = 0; i < rows; ++i) {
        const Scalar h = column[i], product = own * diagonal[static_cast<std::size_t>(i)];
        within &= least < product;  // without branches it is vectorised
        within &= product < most;
        within &= h * h <= product;
      }
      if (!within) return false;
    }
  }
  return true;
}

/// Looks for the first entry that shows that H is not the Hessian of a convex program: not finite,
/// not symmetric (beyond the rounding of a product JᵀJ), a negative diagonal entry, or h_ij² > h_ii
/// h_jj. Never allocates. Complexity: O(n²).
template <RealScalar Scalar>
QpRefusal validate_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H) {
  using std::abs;
  using std::sqrt;
  const Index n = H.rows();
  constexpr QpStatus bad = QpStatus::InvalidData;
  if (n == 0) return {bad, "Hessian is empty", -1};
  if (H.cols() != n) return {bad, "Hessian is not square", -1};
  Scalar largest(0);
  for (Index j = 0; j < n; ++j) {
    bool finite = true;
    for (Index i = 0; i < n; ++i) finite &= is_finite(H(i, j));  // vectorised, too
    for (Index i = 0; i < n && !finite; ++i) {
      if (!is_finite(H(i, j))) return {bad, "Hessian entry is not finite", i + j * n};
    }
    largest = (std::max)(largest, H(j, j));
  }
  const Scalar rounding = scalar_traits<Scalar>::epsilon() * static_cast<Scalar>(n);
  const Scalar asymmetry =
      Scalar(8) * scalar_traits<Scalar>::epsilon() * sqrt(static_cast<Scalar>(n));
  const bool symmetric = equals_transpose<Scalar>(H);
  for (Index j = 0; !symmetric && j < n; ++j) {
    for (Index i = j + 1; i < n; ++i) {
      const Scalar gap = abs(H(i, j) - H(j, i));
      if (!(gap > Scalar(0))) continue;
      const Scalar size = abs(H(i, j)) + abs(H(j, i)) + sqrt(abs(H(i, i))) * sqrt(abs(H(j, j)));
      if (gap > asymmetry * size) return {bad, "Hessian is not symmetric", i + j * n};
    }
  }
  if (within_diagonal<Scalar>(H)) return {};
  for (Index j = 0; j < n; ++j) {
    const Scalar own = H(j, j);
    if (own < Scalar(0))
      return {QpStatus::NonConvex, "Hessian has a negative diagonal entry", j + j * n};
    for (Index i = j + 1; i < n; ++i) {
      const Scalar h = abs(H(i, j));
      if (!(h > Scalar(0)) || H(i, i) < Scalar(0)) continue;
      const Scalar product =
          own * H(i, i);  // spares the roots where it neither overflows nor underflows
      if (product > Scalar(1e-30) && product < Scalar(1e30) && !(h * h > product)) continue;
      const Scalar most = sqrt(own) * sqrt(H(i, i));
      if (h > (Scalar(1) + Scalar(16) * rounding) * most && h > Scalar(4) * rounding * largest) {
        return {QpStatus::NonConvex, "Hessian entry is larger than its diagonal entries allow",
                i + j * n};
      }
    }
  }
  return {};
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
