#pragma once

// The pairs of features of a sheet that are near each other, kept from search to search. A search
// asks for pairs that are, or come during a motion from x to y, closer than a limit T. The list
// has, for a reference r, a way A and a way b_v of each vertex, every pair whose distance at r is
// less than T + 2 A + 3 max b_v over its vertices. It holds all pairs of a search while
//
//   |x_v - r_v| <= A,   |y_v - x_v| <= b_v
//
// since the distance at x is less than that at r by no more than 2 A, and the sides come closer by
// no more than 3 max b_v (pair_advancement.hpp: without their mean motion, vertices that go at most
// b go at most 3/2 b). A few fast vertices cost little. The order is that of the search that filled
// the list.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A pair of features: a vertex and a triangle, or two edges.
struct NearPair {
  int a, b;
  bool edges;
};

/// A list of near pairs and the motions for which it was made.
template <RealScalar S>
class NearPairs {
 public:
  /// The scalar type.
  using Scalar = S;

  NearPairs() = default;
  /// Makes an empty list for a number of vertices, with the way A and the least b (m). Allocates.
  NearPairs(Index vertices, const Scalar& away, const Scalar& least) : away_(away), least_(least) {
    for (Points<Scalar>* points : {&last_, &start_, &low_, &high_})
      points->setConstant(3, vertices, Scalar(0));
    way_.setConstant(vertices, Scalar(0));
  }

  /// Makes room for `count` pairs. Allocates.
  void reserve(std::size_t count) { pairs_.reserve(count); }
  /// The pairs.
  const std::vector<NearPair>& pairs() const { return pairs_; }
  /// Whether the list is whole: no pair was refused since it was begun.
  bool filled() const { return filled_; }
  /// Number of searches that lists have served.
  long served() const { return served_; }

  /// Returns whether the list holds all pairs of a search from `x` to `y` (3×n, m) with the limit
  /// T (m).
  bool covers(const Points<Scalar>& x, const Points<Scalar>& y, const Scalar& limit) {
    // The searches of a step have the same x; so have those of a sheet that lies still.
    if (x != last_) {
      came_ = largest(last_, x);
      last_ = x;
      repeats_ = 0;
    } else if (++repeats_ > kMostRepeats) {
      came_ = Scalar(0);
    }
    if (!filled_ || limit_ < limit) return false;
    for (Index v = 0; v < x.cols(); ++v) {
      const Scalar way = Scalar(kSafe) * way_[v];
      if (!(Vector3<Scalar>(y.col(v) - x.col(v)).squaredNorm() <= way * way)) return false;
    }
    if (!(largest(start_, x) <= Scalar(kSafe) * away_)) return false;
    ++served_;
    return true;
  }

  /// Begins a list for a search that the last one does not cover, if it is likely to serve for a
  /// few more: vertices have come by no more than A/3 since the last other x, and go no farther
  /// than A and the least b. After a list that did not serve, none is begun for a while. Returns
  /// whether one was begun.
  bool begin(const Points<Scalar>& x, const Points<Scalar>& y, const Scalar& limit) {
    using std::sqrt;
    if (begun_ && served_ < before_ + kFewUses) pause_ = kPause;
    if (pause_ > 0) --pause_;
    const bool fast = away_ < Scalar(3) * came_ || away_ + least_ < largest(x, y);
    begun_ = filled_ = !fast && pause_ == 0;
    if (!begun_) return false;
    start_ = x;
    limit_ = limit;
    before_ = served_;
    pairs_.clear();
    for (Index v = 0; v < x.cols(); ++v) {
      Scalar way = Scalar(1.25) * sqrt(Vector3<Scalar>(y.col(v) - x.col(v)).squaredNorm());
      if (way < least_) way = least_;
      way_[v] = way;
      const Vector3<Scalar> by = Vector3<Scalar>::Constant(Scalar(1.5) * way);
      low_.col(v) = x.col(v) - by;
      high_.col(v) = x.col(v) + by;
    }
    return true;
  }
  /// What the boxes of vertices must hold for the list, 3×n, and by how much they are to be grown,
  /// m.
  const Points<Scalar>& low() const { return low_; }
  const Points<Scalar>& high() const { return high_; }
  Scalar grow() const { return limit_ / Scalar(2) + away_; }
  /// Returns the distance below which a pair with these vertices belongs to the list, m.
  Scalar reach(const std::array<int, 4>& vertex) const {
    Scalar most(0);
    for (const int v : vertex) {
      if (most < way_[v]) most = way_[v];
    }
    return limit_ + Scalar(2) * away_ + Scalar(3) * most;
  }
  /// Adds a pair. Where there is no room the list is given up.
  void add(const NearPair& pair) {
    if (pairs_.size() < pairs_.capacity())
      pairs_.push_back(pair);
    else
      filled_ = false;
  }

 private:
  /// A list that serves for fewer searches was not worth it: searches without one after it.
  static constexpr int kFewUses = 4, kPause = 48;
  /// Searches from the same x after which the sheet lies still.
  static constexpr int kMostRepeats = 20;
  /// Rounding of the distances is far less than what is left.
  static constexpr double kSafe = 0.999;

  /// Returns the largest distance of a vertex in p and in q.
  static Scalar largest(const Points<Scalar>& p, const Points<Scalar>& q) {
    using std::sqrt;
    Scalar most(0);
    for (Index v = 0; v < p.cols(); ++v) {
      const Scalar square = Vector3<Scalar>(q.col(v) - p.col(v)).squaredNorm();
      if (most < square) most = square;
    }
    return sqrt(most);
  }

  Points<Scalar> last_, start_, low_, high_;
  VectorX<Scalar> way_;
  std::vector<NearPair> pairs_;
  Scalar away_ = Scalar(0), least_ = Scalar(0), limit_ = Scalar(0), came_ = Scalar(0);
  bool begun_ = false, filled_ = false;
  int pause_ = 0, repeats_ = 0;
  long served_ = 0, before_ = 0;  // before_: when the list was begun
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
