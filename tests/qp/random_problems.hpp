#pragma once

// Random quadratic programs of many families whose outcome is known by construction, and a check of
// answers in long double that shares only the vector types with the library.
//
//   optimal      x is drawn, then bounds around it, multipliers y, z on the sides that x touches,
//                and g = Aᵀy + z - Hx
//   infeasible   y is drawn, z = -Aᵀy, and the sides that they name pass through a point; then
//                one row is moved until Σ max y_i r + Σ max z_j x = -margin · (size of its terms)
//   unbounded    d is drawn; columns of the factor J of H = JᵀJ and of A are chosen so that J d = 0
//                and A d is 0 or one-signed; the sides that d leaves are opened, x is feasible, and
//                gᵀd < 0
//
// Most data are small integers scaled by powers of two. All of this then holds exactly in double,
// so the outcome is certain for the numbers that the solver sees, however degenerate or badly
// scaled. For real data it holds up to rounding; they are not used where rounding could change the
// outcome.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl_test {

using clothctl::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Random numbers that are the same with every standard library.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : engine_(seed) {}
  /// In [0, 1).
  double unit() { return std::ldexp(static_cast<double>(engine_() >> 11), -53); }
  bool chance(double p) { return unit() < p; }
  /// An integer from `least` to `most`.
  int between(int least, int most) {
    return least + static_cast<int>(engine_() % static_cast<std::uint64_t>(most - least + 1));
  }
  double sign() { return chance(0.5) ? 1.0 : -1.0; }

 private:
  std::mt19937_64 engine_;
};

/// The outcome that a problem was built for.
enum class Outcome { Optimal, Infeasible, Unbounded, Neither, Crossed };

/// A problem and the known facts about it.
struct RandomQp {
  MatrixXd H, A;
  VectorXd g, lb, ub, rl, ru;
  Outcome outcome = Outcome::Optimal;
  /// The optimal value.
  long double objective = 0.0L;
  /// A minimiser or a feasible point. If there is none: the point around which the sides were
  /// drawn.
  VectorXd x;
  /// For Optimal its multipliers; for Infeasible and Neither a Farkas pair.
  VectorXd y, z;
  /// For Unbounded and Neither: a ray.
  VectorXd ray;
  /// If there is no solution: a lower limit of any point's residuals, relative to the sizes that
  /// residuals are divided by. If it is not far above the tolerances, a point within them is as
  /// good an answer as a certificate.
  double miss = std::numeric_limits<double>::infinity();
};

/// The properties of a random problem.
struct QpRecipe {
  Outcome outcome = Outcome::Optimal;
  int n = 1, m = 0;
  /// Numbers are integers up to this size, or real if it is 0.
  int span = 3;
  /// Nonzeros in a row of J and A; 0 for dense rows.
  int fill = 0;
  /// Whether the nonzeros of a row are neighbours.
  bool banded = false;
  /// Rank of H divided by n. For 1, a multiple of the identity is added.
  double rank = 1.0;
  /// Shares of the unknowns or rows: at a bound; of these, with a zero multiplier; equalities;
  /// fixed unknowns; unknowns and rows without bounds; rows that repeat or combine earlier ones;
  /// zero rows.
  double active = 0.5, degenerate = 0.0, equal = 0.2, fixed = 0.0, open = 0.2, copies = 0.0,
         zero = 0.0;
  /// If not 0: rows are positive multiples of this many directions.
  int directions = 0;
  /// Unknowns w and d under equality rows w - M d = b, H = diag(Q, ridge).
  bool contact = false;
  /// Infeasible: one row is minus a combination of others, so that z = 0 and unknowns may be
  /// unbounded.
  bool combined = false;
  /// Infeasible: the relative margin.
  double margin = 1.0;
  /// Rows, unknowns and the objective are scaled by 2 to ± these powers. `uneven` adds a random
  /// factor, so that scaling rounds.
  int row_spread = 0, column_spread = 0, objective_spread = 0;
  bool uneven = false;
};

/// A family: its share of the problems, and how its properties differ from the defaults.
struct QpFamilyEntry {
  const char* name;
  int weight;
  void (*change)(QpRecipe&, Draws&);
};

/// Solvable families first.
inline const std::vector<QpFamilyEntry>& qp_families() {
  constexpr int k1e8 = 27;  // 2^27 = 1.3e8
  static const auto tiny = [](QpRecipe& r, Draws& d, int least_rows) {
    r.n = d.between(1, 3);
    r.m = d.between(least_rows, 3);
  };
  static const auto wide = [](QpRecipe& r, Draws& d) {
    r.n = d.between(50, 150);
    r.m = d.between(0, 150);
    r.fill = d.between(1, 4);
    r.banded = d.chance(0.4);
  };
  static const auto linear = [](QpRecipe& r, Draws& d) {
    r.rank = 0.0;
    r.active = d.unit();
  };
  static const auto box = [](QpRecipe& r, Draws& d) {
    r.m = 0;
    r.rank = d.unit() * 1.5;
    r.degenerate = d.chance(0.5) ? d.unit() : 0.0;
  };
  static const auto infeasible = [](QpRecipe& r, Draws& d) {
    r.outcome = Outcome::Infeasible;
    r.m = std::max(1, r.m);
    r.combined = d.chance(0.4);
    if (r.combined) r.span = std::max(1, r.span);
    r.rank = d.chance(0.3) ? 1.0 : d.unit();
    r.copies = d.chance(0.4) ? 0.4 : 0.0;
    r.margin = std::ldexp(1.0, -d.between(0, 13));
  };
  static const auto unbounded = [](QpRecipe& r, Draws& d) {
    r.outcome = Outcome::Unbounded;
    r.span = std::max(1, r.span);
    r.rank = d.chance(0.4) ? 0.0 : d.unit();
  };
  static const auto scaled = [](QpRecipe& r, Draws& d) {
    r.row_spread = d.chance(0.6) ? k1e8 : 0;
    r.column_spread = d.chance(0.6) ? k1e8 : 0;
  };
  static const auto mixed = [](QpRecipe& r, Draws& d) {
    r.degenerate = d.unit();
    r.copies = 0.5 * d.unit();
    r.active = d.unit();
    r.equal = d.chance(0.3) ? 0.8 : 0.3 * d.unit();
    r.fixed = d.chance(0.3) ? 0.3 : 0.0;
    r.zero = d.chance(0.3) ? 0.1 : 0.0;
    r.open = d.unit();
    r.rank = d.chance(0.3) ? 1.0 : d.chance(0.3) ? 0.0 : d.unit();
    r.row_spread = d.chance(0.7) ? k1e8 : 0;
    r.column_spread = d.chance(0.5) ? d.between(1, k1e8) : 0;
    r.objective_spread = d.chance(0.2) ? d.between(1, k1e8) : 0;
    r.uneven = d.chance(0.4);
  };
  static const std::vector<QpFamilyEntry> families = {
      {"plain", 6, [](QpRecipe&, Draws&) {}},
      {"tiny", 8,
       [](QpRecipe& r, Draws& d) {
         tiny(r, d, 0);
         r.rank = d.unit() * 1.5;
         r.degenerate = d.chance(0.5) ? 0.5 : 0.0;
         r.open = d.unit();
       }},
      {"degenerate", 5,
       [](QpRecipe& r, Draws& d) {
         r.active = 0.5 + 0.5 * d.unit();
         r.degenerate = 0.3 + 0.7 * d.unit();
         r.m += r.n;
       }},
      {"semidefinite", 5, [](QpRecipe& r, Draws& d) { r.rank = d.unit(); }},
      {"redundant", 5,
       [](QpRecipe& r, Draws& d) {
         r.m += r.n;
         r.copies = 0.3 + 0.6 * d.unit();
         r.equal = d.unit();
       }},
      {"linear", 6, linear},
      {"equalities", 5,
       [](QpRecipe& r, Draws& d) {
         r.equal = 0.9;
         r.m = d.between(r.n / 2, 3 * r.n / 2);
         r.copies = d.chance(0.5) ? 0.3 : 0.0;
         r.rank = d.chance(0.5) ? 1.0 : d.unit();
       }},
      {"fixed", 3,
       [](QpRecipe& r, Draws& d) {
         r.fixed = d.chance(0.2) ? 1.0 : 0.1 + 0.8 * d.unit();
         r.rank = d.unit() * 1.5;
       }},
      {"no bounds", 4,
       [](QpRecipe& r, Draws& d) {
         r.open = 1.0;
         r.active = 0.0;
         r.zero = d.chance(0.5) ? 0.2 : 0.0;
         r.rank = d.chance(0.5) ? 1.0 : d.unit();
       }},
      {"zero rows", 2,
       [](QpRecipe& r, Draws& d) {
         r.zero = d.chance(0.2) ? 1.0 : d.unit();
         r.rank = d.unit() * 1.5;
       }},
      {"scaled rows", 4,
       [](QpRecipe& r, Draws& d) {
         r.row_spread = k1e8;
         r.uneven = d.chance(0.4);
       }},
      {"scaled columns", 4,
       [](QpRecipe& r, Draws& d) {
         r.column_spread = k1e8;
         r.uneven = d.chance(0.4);
       }},
      {"scaled objective", 3,
       [](QpRecipe& r, Draws& d) {
         r.objective_spread = k1e8;
         r.rank = d.unit() * 1.5;
       }},
      {"cone", 6,
       [](QpRecipe& r, Draws& d) {
         r.n = d.between(2, 12);
         r.m = d.between(24, 96);
         r.directions = d.between(1, 6);
         r.active = 0.3 + 0.7 * d.unit();
         r.degenerate = d.unit();
         r.equal = 0.0;
         r.open = d.unit();
         r.rank = d.unit() * 1.5;
       }},
      {"contact", 4,
       [](QpRecipe& r, Draws& d) {
         r.contact = true;
         r.m = d.between(1, r.n);
         r.n += r.m;
         r.open = 0.0;
         r.rank = d.unit();
         r.degenerate = d.chance(0.4) ? 0.5 : 0.0;
         r.equal = 1.0;
       }},
      {"mixture", 8, mixed},
      {"dense", 1,
       [](QpRecipe& r, Draws& d) {
         r.n = d.between(30, 150);
         r.m = d.between(0, 150);
         r.rank = d.unit() * 1.5;
         r.degenerate = d.chance(0.3) ? 0.5 : 0.0;
       }},
      {"sparse", 6,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         r.degenerate = d.chance(0.4) ? 0.5 : 0.0;
         r.copies = d.chance(0.3) ? 0.3 : 0.0;
       }},
      {"sparse semidefinite", 3,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         r.rank = d.unit();
       }},
      {"sparse linear", 3,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         linear(r, d);
       }},
      {"sparse equalities", 2,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         r.equal = 0.9;
         r.fixed = d.chance(0.3) ? 0.3 : 0.0;
         r.rank = d.chance(0.5) ? 1.0 : d.unit();
       }},
      {"sparse mixture", 3,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         mixed(r, d);
       }},
      {"small sparse", 3,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         r.n = d.between(15, 50);
         r.m = d.between(0, 50);
         r.fill = d.between(1, 2);
         r.rank = d.unit() * 1.5;
       }},
      {"box", 5,
       [](QpRecipe& r, Draws& d) {
         box(r, d);
         r.fixed = d.chance(0.2) ? 0.3 : 0.0;
       }},
      {"scaled box", 2,
       [](QpRecipe& r, Draws& d) {
         box(r, d);
         r.column_spread = k1e8;
       }},
      {"infeasible", 5, infeasible},
      {"tiny infeasible", 2,
       [](QpRecipe& r, Draws& d) {
         tiny(r, d, 1);
         infeasible(r, d);
       }},
      {"scaled infeasible", 3,
       [](QpRecipe& r, Draws& d) {
         infeasible(r, d);
         scaled(r, d);
       }},
      {"sparse infeasible", 3,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         infeasible(r, d);
       }},
      {"unbounded", 4, unbounded},
      {"tiny unbounded", 2,
       [](QpRecipe& r, Draws& d) {
         tiny(r, d, 0);
         unbounded(r, d);
       }},
      {"scaled unbounded", 2,
       [](QpRecipe& r, Draws& d) {
         unbounded(r, d);
         scaled(r, d);
       }},
      {"sparse unbounded", 2,
       [](QpRecipe& r, Draws& d) {
         wide(r, d);
         unbounded(r, d);
       }},
      {"unbounded box", 2,
       [](QpRecipe& r, Draws& d) {
         unbounded(r, d);
         r.m = 0;
       }},
      {"infeasible and unbounded", 2,
       [](QpRecipe& r, Draws& d) {
         infeasible(r, d);
         unbounded(r, d);
         r.outcome = Outcome::Neither;
         r.m = std::max(2, r.m);
         r.combined = true;
       }},
      {"crossed", 1, [](QpRecipe& r, Draws&) { r.outcome = Outcome::Crossed; }},
  };
  return families;
}

/// Returns the family of problem `index` when families get their shares.
inline int qp_family_of(long index) {
  static const std::vector<int> deal = [] {
    std::vector<int> cards;
    const std::vector<QpFamilyEntry>& all = qp_families();
    for (int round = 0, left = 1; left > 0; ++round) {
      left = 0;
      for (int f = 0; f < static_cast<int>(all.size()); ++f) {
        if (all[static_cast<std::size_t>(f)].weight <= round) continue;
        cards.push_back(f);
        ++left;
      }
    }
    return cards;
  }();
  return deal[static_cast<std::size_t>(index) % deal.size()];
}

/// Returns the properties for a family and seed.
inline QpRecipe draw_recipe(const QpFamilyEntry& family, Draws& draws) {
  QpRecipe r;
  r.n = draws.chance(0.9) ? draws.between(1, 30) : draws.between(30, 60);
  r.m = draws.chance(0.1) ? 0 : draws.between(1, std::max(2, 3 * r.n / 2));
  r.span = draws.chance(0.3) ? 0 : draws.chance(0.7) ? 3 : 40;
  r.active = 0.9 * draws.unit();
  r.equal = 0.4 * draws.unit();
  r.open = 0.5 * draws.unit();
  family.change(r, draws);
  return r;
}

/// The matrices of a problem, its scaling, and what is needed to draw bounds. Bounds may be drawn
/// many times.
class QpMaker {
 public:
  QpMaker(const QpRecipe& recipe, Draws& draws)
      : recipe_(recipe), draws_(draws), n_(recipe.n), m_(recipe.m) {
    draw_matrices();
    draw_scales();
  }

  /// Draws bounds, gradient and known facts as the properties say.
  RandomQp make() { return make(recipe_.outcome); }

  /// The same for another outcome. For Unbounded and Neither, the properties must name one of these
  /// two.
  RandomQp make(Outcome outcome) {
    place();
    if (outcome == Outcome::Optimal) tighten();
    if (outcome == Outcome::Infeasible || outcome == Outcome::Neither) contradict();
    if (outcome == Outcome::Unbounded || outcome == Outcome::Neither) open_along_ray();
    if (outcome == Outcome::Crossed) cross();
    gradient(outcome);
    return scaled(outcome);
  }

  /// Draws new multipliers and a new gradient for the bounds of the last optimal problem. Its
  /// minimiser stays the same.
  RandomQp turn() {
    multiply();
    gradient(Outcome::Optimal);
    return scaled(Outcome::Optimal);
  }

 private:
  static constexpr double kInf = std::numeric_limits<double>::infinity();

  bool exact() const { return recipe_.span > 0; }
  /// Not zero.
  double value() { return draws_.sign() * size(recipe_.span); }
  /// Positive.
  double size(int span) { return span > 0 ? draws_.between(1, span) : 0.1 + 2.0 * draws_.unit(); }
  double small() { return size(exact() ? 3 : 0); }
  /// An index below `count`.
  int one_of(Index count) { return draws_.between(0, static_cast<int>(count) - 1); }

  void fill_row(MatrixXd& M, Index i, Index first, Index columns) {
    if (recipe_.fill == 0) {
      for (Index j = 0; j < columns; ++j) M(i, first + j) = draws_.chance(0.15) ? 0.0 : value();
      return;
    }
    const int start = one_of(columns);
    for (int k = 0; k < recipe_.fill; ++k) {
      const Index j = recipe_.banded ? (start + k) % columns : one_of(columns);
      M(i, first + j) = value();
    }
  }

  void draw_matrices() {
    const double part = std::min(1.0, recipe_.rank);
    const Index curved = recipe_.contact ? m_ : n_;
    const Index rank = static_cast<Index>(std::lround(part * static_cast<double>(curved)));
    MatrixXd J = MatrixXd::Zero(rank, n_);
    for (Index i = 0; i < rank; ++i) fill_row(J, i, 0, curved);
    const bool with_ray =
        recipe_.outcome == Outcome::Unbounded || recipe_.outcome == Outcome::Neither;
    if (with_ray) draw_ray(J);
    H_ = J.transpose() * J;
    H_ = (0.5 * (H_ + H_.transpose())).eval();
    if (recipe_.contact) {
      H_.diagonal().tail(n_ - m_).array() += exact() ? 0.125 : 0.1;
    } else if (rank == n_ && !with_ray) {
      H_.diagonal().array() += exact() ? 1.0 : 0.05;
    }
    draw_rows(with_ray);
  }

  /// Draws d with a pivot of ±1, and makes J d = 0 through the column of the pivot.
  void draw_ray(MatrixXd& J) {
    ray_.setZero(n_);
    const int count =
        recipe_.fill > 0 || draws_.chance(0.4) ? draws_.between(1, 4) : static_cast<int>(n_);
    for (int k = 0; k < count; ++k) ray_[one_of(n_)] = draws_.sign() * draws_.between(1, 3);
    pivot_ = one_of(n_);
    ray_[pivot_] = draws_.sign();
    for (Index i = 0; i < J.rows(); ++i) make_orthogonal(J, i);
  }

  /// Makes row i of M times d zero through its entry at the pivot.
  void make_orthogonal(MatrixXd& M, Index i) const {
    M(i, pivot_) = 0.0;
    M(i, pivot_) = -M.row(i).dot(ray_) / ray_[pivot_];
  }

  void draw_rows(bool with_ray) {
    A_.setZero(m_, n_);
    MatrixXd directions = MatrixXd::Zero(recipe_.directions, n_);
    for (Index i = 0; i < directions.rows(); ++i) fill_row(directions, i, 0, n_);
    for (Index i = 0; i < m_; ++i) {
      if (recipe_.contact) {
        A_(i, i) = draws_.chance(0.8) ? 1.0 : value();
        if (n_ > m_) fill_row(A_, i, m_, n_ - m_);
      } else if (recipe_.directions > 0) {
        A_.row(i) = small() * directions.row(i % recipe_.directions);
      } else if (draws_.chance(recipe_.zero)) {
        continue;
      } else if (i > 0 && draws_.chance(recipe_.copies)) {
        A_.row(i) = draws_.sign() * draws_.between(1, 2) * A_.row(one_of(i));
        if (draws_.chance(0.3)) A_.row(i) += A_.row(one_of(i));
      } else {
        fill_row(A_, i, 0, n_);
        if (with_ray && (recipe_.outcome == Outcome::Neither || draws_.chance(0.5)))
          make_orthogonal(A_, i);
      }
    }
    if (!recipe_.combined) return;
    // Row k is minus a combination of some others. Then y proves a contradiction without bounds.
    combination_.setZero(m_);
    const int k = one_of(m_);
    A_.row(k).setZero();
    const int count = std::min(static_cast<int>(m_) - 1, draws_.between(1, 4));
    for (int c = 0; c < count; ++c) {
      const int i = one_of(m_);
      if (i != k) combination_[i] = draws_.sign() * draws_.between(1, 3);
    }
    A_.row(k) = -combination_.transpose() * A_;
    combination_[k] = 1.0;
  }

  double scale(int spread) {
    if (spread == 0) return 1.0;
    const double power =
        std::ldexp(1.0, draws_.chance(0.3) ? (draws_.chance(0.5) ? spread : -spread)
                                           : draws_.between(-spread, spread));
    return recipe_.uneven ? power * (0.7 + 0.6 * draws_.unit()) : power;
  }

  void draw_scales() {
    columns_.resize(n_);
    rows_.resize(m_);
    for (Index j = 0; j < n_; ++j) columns_[j] = scale(recipe_.column_spread);
    for (Index i = 0; i < m_; ++i) rows_[i] = scale(recipe_.row_spread);
    factor_ = scale(recipe_.objective_spread);
  }

  /// Draws a point, and bounds around it that it does not touch.
  void place() {
    x_.resize(n_);
    lb_.resize(n_);
    ub_.resize(n_);
    rl_.resize(m_);
    ru_.resize(m_);
    for (Index j = 0; j < n_; ++j) x_[j] = draws_.chance(0.2) ? 0.0 : value();
    const VectorXd Ax = A_ * x_;
    for (Index j = 0; j < n_; ++j)
      surround(x_[j], lb_[j], ub_[j], recipe_.contact && j < m_ ? 1.0 : recipe_.open);
    for (Index i = 0; i < m_; ++i) surround(Ax[i], rl_[i], ru_[i], recipe_.open);
    side_.assign(static_cast<std::size_t>(n_ + m_), Side::None);
    y_.setZero(m_);
    z_.setZero(n_);
  }

  /// Side of unknown k, or of row k - n.
  double& lower_side(Index k) { return k >= n_ ? rl_[k - n_] : lb_[k]; }
  double& upper_side(Index k) { return k >= n_ ? ru_[k - n_] : ub_[k]; }

  void surround(double at, double& lower, double& upper, double open) {
    lower = at - small();
    upper = at + small();
    if (!draws_.chance(open)) return;
    const double unlimited = draws_.chance(0.9) ? kInf : 1e30;
    if (open > 0.99 || draws_.chance(0.5)) {
      lower = -unlimited;
      upper = unlimited;
    } else if (draws_.chance(0.5)) {
      lower = -unlimited;
    } else {
      upper = unlimited;
    }
  }

  /// Moves bounds to the point, and draws their multipliers.
  void tighten() {
    const VectorXd Ax = A_ * x_;
    for (Index k = 0; k < n_ + m_; ++k) {
      const bool row = k >= n_;
      if (!row && recipe_.contact && k < m_) continue;
      const double at = row ? Ax[k - n_] : x_[k];
      double &lower = lower_side(k), &upper = upper_side(k);
      Side& side = side_[static_cast<std::size_t>(k)];
      if (draws_.chance(row ? recipe_.equal : recipe_.fixed)) {
        lower = upper = at;
        side = Side::Both;
      } else if (draws_.chance(recipe_.active)) {
        side = draws_.chance(0.5) ? Side::Lower : Side::Upper;
        (side == Side::Lower ? lower : upper) = at;
      }
    }
    multiply();
  }

  void multiply() {
    for (Index k = 0; k < n_ + m_; ++k) {
      double& multiplier = k >= n_ ? y_[k - n_] : z_[k];
      const Side side = side_[static_cast<std::size_t>(k)];
      multiplier = side == Side::None || draws_.chance(recipe_.degenerate) ? 0.0 : small();
      if (side == Side::Upper || (side == Side::Both && draws_.chance(0.5)))
        multiplier = -multiplier;
    }
  }

  /// Draws a Farkas pair, closes the sides that it names, and moves one row until they contradict.
  void contradict() {
    y_.setZero(m_);
    if (recipe_.combined) {
      y_ = combination_;
    } else {
      const int count = draws_.chance(0.2) ? static_cast<int>(m_) : draws_.between(1, 3);
      for (int c = 0; c < count; ++c) y_[one_of(m_)] = draws_.sign() * draws_.between(1, 3);
    }
    if (draws_.chance(0.5)) y_ = -y_;
    z_ = -A_.transpose() * y_;
    long double support = 0.0L, terms = 0.0L;
    const auto close = [&](double v, double at, double& lower, double& upper) {
      if (!(v < 0.0) && !(v > 0.0)) return;
      double& side = v > 0.0 ? upper : lower;
      if (std::abs(side) > 1e20) side = v > 0.0 ? at + small() : at - small();
      if (draws_.chance(0.3)) side = at;
      support += static_cast<long double>(v) * side;
      terms += std::abs(static_cast<long double>(v) * side);
    };
    const VectorXd Ax = A_ * x_;
    for (Index j = 0; j < n_; ++j) close(z_[j], x_[j], lb_[j], ub_[j]);
    for (Index i = 0; i < m_; ++i) close(y_[i], Ax[i], rl_[i], ru_[i]);
    Index k = 0;
    y_.cwiseAbs().maxCoeff(&k);
    // A power of two above the size, so that integers stay exact.
    const int exponent = std::ilogb(std::max(1.0, static_cast<double>(terms))) + 1;
    const double step =
        (static_cast<double>(support) + recipe_.margin * std::ldexp(1.0, exponent)) /
        std::abs(y_[k]);
    const double move = exact() ? std::ceil(step * 65536.0) / 65536.0 : step;
    if (y_[k] > 0.0) {
      ru_[k] -= move;
      rl_[k] = draws_.chance(0.5) ? -kInf : draws_.chance(0.3) ? ru_[k] : ru_[k] - small();
    } else {
      rl_[k] += move;
      ru_[k] = draws_.chance(0.5) ? kInf : draws_.chance(0.3) ? rl_[k] : rl_[k] + small();
    }
  }

  void open_along_ray() {
    const VectorXd Ad = A_ * ray_;
    for (Index j = 0; j < n_; ++j) {
      if (ray_[j] > 0.0) ub_[j] = kInf;
      if (ray_[j] < 0.0) lb_[j] = -kInf;
    }
    for (Index i = 0; i < m_; ++i) {
      if (Ad[i] > 0.0) ru_[i] = kInf;
      if (Ad[i] < 0.0) rl_[i] = -kInf;
    }
  }

  void cross() {
    const int k = one_of(n_ + m_);
    const double at = value();
    lower_side(k) = at + (draws_.chance(0.5) ? 1e-4 : small());
    upper_side(k) = at;
  }

  void gradient(Outcome outcome) {
    g_.resize(n_);
    if (outcome == Outcome::Optimal) {
      g_ = A_.transpose() * y_ + z_ - H_ * x_;
      return;
    }
    for (Index j = 0; j < n_; ++j) g_[j] = draws_.chance(0.3) ? 0.0 : value();
    if (outcome == Outcome::Infeasible || outcome == Outcome::Crossed) return;
    g_[pivot_] = 0.0;
    g_[pivot_] = (-small() - g_.dot(ray_)) / ray_[pivot_];
  }

  RandomQp scaled(Outcome outcome) const {
    RandomQp q;
    q.outcome = outcome;
    q.H.resize(n_, n_);
    q.A.resize(m_, n_);
    for (Index j = 0; j < n_; ++j) {
      for (Index i = 0; i < n_; ++i) q.H(i, j) = factor_ * (columns_[i] * columns_[j]) * H_(i, j);
      for (Index i = 0; i < m_; ++i) q.A(i, j) = rows_[i] * columns_[j] * A_(i, j);
    }
    const auto bounds = [](const VectorXd& from, const VectorXd& by) {
      VectorXd to = from;
      for (Index k = 0; k < to.size(); ++k) {
        if (std::abs(from[k]) < 1e20) to[k] *= by[k];
      }
      return to;
    };
    const VectorXd narrow = columns_.cwiseInverse();
    q.g = factor_ * columns_.cwiseProduct(g_);
    q.x = x_.cwiseProduct(narrow);
    q.lb = bounds(lb_, narrow);
    q.ub = bounds(ub_, narrow);
    q.rl = bounds(rl_, rows_);
    q.ru = bounds(ru_, rows_);
    const bool dual = outcome == Outcome::Optimal;
    q.y = (dual ? factor_ : 1.0) * y_.cwiseQuotient(rows_);
    q.z = (dual ? factor_ : 1.0) * z_.cwiseProduct(columns_);
    if (ray_.size() > 0) q.ray = ray_.cwiseProduct(narrow);
    for (Index j = 0; j < n_; ++j) {
      long double slope = q.g[j];
      for (Index i = 0; i < n_; ++i) slope += 0.5L * q.H(i, j) * q.x[i];
      q.objective += slope * q.x[j];
    }
    q.miss = least_miss(q);
    return q;
  }

  /// A Farkas pair implies a violation of at least -support / (|y| + |z|) at every point; a ray
  /// implies a stationarity error of at least -gᵀd / |d|.
  static double least_miss(const RandomQp& q) {
    if (q.outcome == Outcome::Unbounded) {
      return -q.g.dot(q.ray) / (q.ray.lpNorm<1>() * std::max(1.0, q.g.cwiseAbs().maxCoeff()));
    }
    if (q.outcome == Outcome::Optimal || q.outcome == Outcome::Crossed) return kInf;
    double support = 0.0;
    const auto add = [&support](double v, double lower, double upper) {
      if (v < 0.0 || v > 0.0) support += v * (v > 0.0 ? upper : lower);
    };
    for (Index i = 0; i < q.y.size(); ++i) add(q.y[i], q.rl[i], q.ru[i]);
    for (Index j = 0; j < q.z.size(); ++j) add(q.z[j], q.lb[j], q.ub[j]);
    const double size =
        std::max({1.0, q.x.cwiseAbs().maxCoeff(), (q.A * q.x).cwiseAbs().maxCoeff()});
    return -support / (size * (q.y.lpNorm<1>() + q.z.lpNorm<1>()));
  }

  enum class Side : unsigned char { None, Lower, Upper, Both };

  QpRecipe recipe_;
  Draws& draws_;
  Index n_, m_, pivot_ = 0;
  MatrixXd H_, A_;
  VectorXd g_, x_, y_, z_, lb_, ub_, rl_, ru_, ray_, combination_, columns_, rows_;
  double factor_ = 1.0;
  std::vector<Side> side_;
};

/// The residuals of an answer in long double, relative as in the shared problems.
struct JudgedPoint {
  /// |Hx + g - Aᵀy - z|, and multipliers on infinite sides, over max(1, |Hx|, |g|).
  long double stationarity = 0.0L;
  /// Violation over max(1, |Ax|, |x|).
  long double feasibility = 0.0L;
  /// Σ |multiplier| · slack over max(1, |objective|).
  long double complementarity = 0.0L;
  /// ½ xᵀHx + gᵀx.
  long double objective = 0.0L;
};

using LongVector = std::vector<long double>;

/// M v or Mᵀv, and the sizes of the terms.
inline LongVector product(const MatrixXd& M, const VectorXd& v, bool transposed,
                          LongVector& terms) {
  LongVector sum(static_cast<std::size_t>(transposed ? M.cols() : M.rows()), 0.0L);
  terms = sum;
  for (Index j = 0; j < M.cols(); ++j) {
    for (Index i = 0; i < M.rows(); ++i) {
      const long double term = static_cast<long double>(M(i, j)) * v[transposed ? i : j];
      sum[static_cast<std::size_t>(transposed ? j : i)] += term;
      terms[static_cast<std::size_t>(transposed ? j : i)] += std::abs(term);
    }
  }
  return sum;
}

inline bool is_side(double bound) { return std::abs(bound) < 1e20; }
inline bool is_number(const VectorXd& v) {
  for (Index k = 0; k < v.size(); ++k) {
    if (!std::isfinite(v[k])) return false;
  }
  return true;
}

/// Computes the residuals of (x, y, z).
inline JudgedPoint judge_point(const RandomQp& q, const VectorXd& x, const VectorXd& y,
                               const VectorXd& z) {
  JudgedPoint p;
  LongVector terms;
  const LongVector Hx = product(q.H, x, false, terms), Ax = product(q.A, x, false, terms),
                   Aty = product(q.A, y, true, terms);
  long double dual = 1.0L, primal = 1.0L;
  const auto bounded = [&](long double at, double lower, double upper, double multiplier) {
    primal = std::max(primal, std::abs(at));
    if (is_side(lower)) p.feasibility = std::max(p.feasibility, lower - at);
    if (is_side(upper)) p.feasibility = std::max(p.feasibility, at - upper);
    const double side = multiplier > 0.0 ? lower : upper;
    const long double push = std::abs(multiplier);
    if (!(push > 0.0L)) return;
    if (is_side(side)) {
      p.complementarity += push * std::abs(at - side);
    } else {
      p.stationarity = std::max(p.stationarity, push);
    }
  };
  for (Index j = 0; j < x.size(); ++j) {
    const std::size_t k = static_cast<std::size_t>(j);
    dual = std::max({dual, std::abs(Hx[k]), static_cast<long double>(std::abs(q.g[j]))});
    p.stationarity = std::max(p.stationarity, std::abs(Hx[k] + q.g[j] - Aty[k] - z[j]));
    p.objective += (0.5L * Hx[k] + q.g[j]) * x[j];
    bounded(x[j], q.lb[j], q.ub[j], z[j]);
  }
  for (Index i = 0; i < y.size(); ++i)
    bounded(Ax[static_cast<std::size_t>(i)], q.rl[i], q.ru[i], y[i]);
  p.stationarity /= dual;
  p.feasibility /= primal;
  p.complementarity /= std::max(1.0L, std::abs(p.objective));
  return p;
}

/// Returns what is wrong with (x, y, z) as a solution, or "". `tolerance` applies to the three
/// residuals.
inline std::string fault_of_solution(const RandomQp& q, const VectorXd& x, const VectorXd& y,
                                     const VectorXd& z, double tolerance,
                                     double objective_tolerance) {
  if (!is_number(x) || !is_number(y) || !is_number(z)) return "an answer is not finite";
  const JudgedPoint p = judge_point(q, x, y, z);
  const auto over = [](const char* what, long double value) {
    char text[32];
    std::snprintf(text, sizeof text, " %.1e", static_cast<double>(value));
    return std::string(what) + text;
  };
  if (!(p.feasibility <= tolerance)) return over("feasibility", p.feasibility);
  if (!(p.stationarity <= tolerance)) return over("stationarity", p.stationarity);
  if (!(p.complementarity <= tolerance)) return over("complementarity", p.complementarity);
  if (q.outcome != Outcome::Optimal) return "";
  const long double error =
      std::abs(p.objective - q.objective) / std::max(1.0L, std::abs(q.objective));
  return error <= objective_tolerance ? "" : over("objective error", error);
}

/// Returns what is wrong with (y, z) as a proof of infeasibility, or "". Aᵀy + z must be zero to
/// `rounding` of its terms, and no multiplier may name an infinite side. The support must be
/// negative by more than the rest of Aᵀy + z can add within the bounds; open sides count as 1e4
/// times the point around which the problem was drawn.
inline std::string fault_of_farkas(const RandomQp& q, const VectorXd& y, const VectorXd& z,
                                   double rounding) {
  if (!is_number(y) || !is_number(z)) return "a proof is not finite";
  LongVector terms;
  const LongVector Aty = product(q.A, y, true, terms);
  long double support = 0.0L, size = 0.0L, rest = 0.0L;
  const auto add = [&](double v, double lower, double upper) {
    if (!(v < 0.0) && !(v > 0.0)) return true;
    const double side = v > 0.0 ? upper : lower;
    if (!is_side(side)) return false;
    support += static_cast<long double>(v) * side;
    size += std::abs(static_cast<long double>(v) * side);
    return true;
  };
  for (Index i = 0; i < y.size(); ++i) {
    if (!add(y[i], q.rl[i], q.ru[i]))
      return "a proof names the infinite side of row " + std::to_string(i);
  }
  for (Index j = 0; j < z.size(); ++j) {
    if (!add(z[j], q.lb[j], q.ub[j]))
      return "a proof names the infinite side of unknown " + std::to_string(j);
    const std::size_t k = static_cast<std::size_t>(j);
    const long double error = std::abs(Aty[k] + z[j]);
    if (!(error <= rounding * terms[k]))
      return "Aty + z is not zero at unknown " + std::to_string(j);
    const bool closed = is_side(q.lb[j]) && is_side(q.ub[j]);
    rest +=
        error * (closed ? std::max(std::abs(q.lb[j]), std::abs(q.ub[j])) : 1e4 * std::abs(q.x[j]));
  }
  return support + rest < -rounding * size ? "" : "the support of a proof is not negative";
}

/// Returns what is wrong with d as a ray from x, or "". H d, and A d towards a bound, must be zero
/// to `rounding` of their terms. d must leave no bound, the slope must be negative beyond rounding,
/// and x must be feasible to `tolerance`.
inline std::string fault_of_ray(const RandomQp& q, const VectorXd& d, const VectorXd& x,
                                double rounding, double tolerance) {
  if (!is_number(d) || !is_number(x)) return "a ray is not finite";
  LongVector h_terms, a_terms;
  const LongVector Hd = product(q.H, d, false, h_terms), Ad = product(q.A, d, false, a_terms);
  long double slope = 0.0L, size = 0.0L;
  for (Index j = 0; j < d.size(); ++j) {
    const std::size_t k = static_cast<std::size_t>(j);
    if ((d[j] < 0.0 && is_side(q.lb[j])) || (d[j] > 0.0 && is_side(q.ub[j])))
      return "a ray leaves bound " + std::to_string(j);
    if (!(std::abs(Hd[k]) <= rounding * h_terms[k]))
      return "H d is not zero at unknown " + std::to_string(j);
    slope += static_cast<long double>(q.g[j]) * d[j];
    size += std::abs(static_cast<long double>(q.g[j]) * d[j]);
  }
  for (Index i = 0; i < q.A.rows(); ++i) {
    const std::size_t k = static_cast<std::size_t>(i);
    const bool leaves = (Ad[k] < 0.0L && is_side(q.rl[i])) || (Ad[k] > 0.0L && is_side(q.ru[i]));
    if (leaves && !(std::abs(Ad[k]) <= rounding * a_terms[k]))
      return "a ray leaves row " + std::to_string(i);
  }
  if (!(slope < -rounding * size)) return "the objective does not fall along a ray";
  const JudgedPoint p = judge_point(q, x, VectorXd::Zero(q.A.rows()), VectorXd::Zero(d.size()));
  return p.feasibility <= tolerance ? "" : "the point of a ray is not feasible";
}

/// Returns what is wrong with the known facts of a problem, or "". The known answer must pass the
/// check.
inline std::string fault_of_construction(const RandomQp& q) {
  if (q.outcome == Outcome::Crossed) return "";
  if (q.outcome == Outcome::Optimal) return fault_of_solution(q, q.x, q.y, q.z, 1e-12, 1e-15);
  if (q.outcome != Outcome::Unbounded) {
    const std::string fault = fault_of_farkas(q, q.y, q.z, 1e-14);
    if (!fault.empty() || q.outcome == Outcome::Infeasible) return fault;
  }
  return fault_of_ray(
      q, q.ray, q.x, 1e-14,
      q.outcome == Outcome::Unbounded ? 1e-14 : std::numeric_limits<double>::infinity());
}

}  // namespace clothctl_test
