#pragma once

// Limits of grips as a one-sided cost of a window, w max(0, s_k)², s_k = n · (c_k - o_k) - most in
// frame k: c the centroid of a grip, o that of another or the origin. The frames in which it counts
// are those beyond the limit in the last solution (a semismooth Newton method): solve, see which
// frames are beyond, and solve again where others are.

#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/mpc/detail/window_problem.hpp"
#include "clothctl/mpc/plan_types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The limits of the grips of a planner.
template <RealScalar Scalar>
class GripLimits {
 public:
  /// Sets the limits, which must be valid. With another number of them no frame counts at first.
  /// Allocates when there are more than ever before.
  void set(std::span<const GripLimit<Scalar>> limits, Index horizon) {
    if (limits_.size() != limits.size())
      beyond_.assign(limits.size() * static_cast<std::size_t>(horizon), 0);
    limits_.assign(limits.begin(), limits.end());
  }
  /// Drops limits of grips that are no longer there. Allocates.
  void drop(int grips, Index horizon) {
    std::vector<GripLimit<Scalar>> kept;
    for (const GripLimit<Scalar>& limit : limits_) {
      if (limit.grip < grips && limit.other < grips) kept.push_back(limit);
    }
    set(kept, horizon);
  }
  /// Makes room for a problem. Allocates.
  template <class Problem>
  void reserve(const Problem& problem) {
    row_.setZero(problem.request.inputs() * problem.settings.horizon);
  }
  /// Forgets which frames are beyond.
  void reset() { beyond_.assign(beyond_.size(), 0); }
  /// Moves on by a frame.
  void shift(Index horizon) {
    const std::size_t frames = static_cast<std::size_t>(horizon);
    for (std::size_t i = 0; i < beyond_.size(); ++i) {
      if ((i + 1) % frames != 0) beyond_[i] = beyond_[i + 1];
    }
  }

  /// Adds the cost about the plan of the prediction to a Hessian and gradient in raw inputs. Never
  /// allocates. Complexity: O((inputs K)²) for each limit and frame beyond it.
  template <class Problem>
  void add(const Problem& problem, MatrixX<Scalar>& hessian, VectorX<Scalar>& gradient) {
    const Scalar& weight = problem.settings.weights.limit;
    const Index horizon = problem.settings.horizon, m = problem.request.inputs();
    for (std::size_t i = 0; i < limits_.size(); ++i) {
      for (Index k = 0; k < horizon; ++k) {
        if (beyond_[flag(i, k, horizon)] == 0) continue;
        const Index size = (k + 1) * m;
        auto row = row_.head(size);
        row.setZero();
        add_row(problem, limits_[i].grip, limits_[i].normal, Scalar(1), k);
        if (limits_[i].other >= 0)
          add_row(problem, limits_[i].other, limits_[i].normal, Scalar(-1), k);
        for (Index c = 0; c < size; ++c) hessian.col(c).head(size) += (weight * row[c]) * row;
        gradient.head(size) += (weight * excess(problem, i, k, nullptr)) * row;
      }
    }
  }

  /// Takes the frames that are beyond a limit when the outputs change by `change` (output rows ×
  /// K). Returns true when they are others than before. Never allocates.
  template <class Problem>
  bool update(const Problem& problem, const MatrixX<Scalar>& change) {
    bool changed = false;
    largest_ = Scalar(0);
    const Index horizon = problem.settings.horizon;
    for (std::size_t i = 0; i < limits_.size(); ++i) {
      for (Index k = 0; k < horizon; ++k) {
        const Scalar s = excess(problem, i, k, &change);
        const char now = Scalar(0) < s ? 1 : 0;
        if (largest_ < s) largest_ = s;
        changed = changed || now != beyond_[flag(i, k, horizon)];
        beyond_[flag(i, k, horizon)] = now;
      }
    }
    return changed;
  }
  /// How far the plan of the last update is beyond a limit at most, m.
  const Scalar& largest() const { return largest_; }

 private:
  static std::size_t flag(std::size_t i, Index k, Index horizon) {
    return i * static_cast<std::size_t>(horizon) + static_cast<std::size_t>(k);
  }

  /// Calls `take(output, share)` for the vertices of a grip.
  template <class Problem, class Take>
  static void for_each_output(const Problem& problem, int grip, const Take& take) {
    const auto& held = problem.basis.held();
    const std::size_t g = static_cast<std::size_t>(grip);
    for (std::size_t j = held.grip_begin(g); j < held.grip_begin(g + 1); ++j) {
      const Index slot = static_cast<Index>(j);
      take(problem.feature_count + slot, held.vertex_share(slot));
    }
  }
  /// Adds what the inputs up to frame k do to n times the centroid of a grip.
  template <class Problem>
  void add_row(const Problem& problem, int grip, const Vector3<Scalar>& normal, const Scalar& sign,
               Index k) {
    const Index m = problem.request.inputs();
    for_each_output(problem, grip, [&](Index output, const Scalar& share) {
      for (Index j = 0; j <= k; ++j) {
        for (Index c = 0; c < 3; ++c)
          row_.segment(j * m, m) +=
              (sign * share * normal[c]) *
              problem.response.impulse_response.row(3 * output + c).segment((k - j) * m, m);
      }
    });
  }
  /// s_k of limit i, with a change of the outputs or without.
  template <class Problem>
  Scalar excess(const Problem& problem, std::size_t i, Index k,
                const MatrixX<Scalar>* change) const {
    const GripLimit<Scalar>& limit = limits_[i];
    Vector3<Scalar> way = Vector3<Scalar>::Zero();
    const auto add = [&](int grip, const Scalar& sign) {
      for_each_output(problem, grip, [&](Index output, const Scalar& share) {
        way += sign * share * problem.response.free_response.template block<3, 1>(3 * output, k);
        if (change != nullptr) way += sign * share * change->template block<3, 1>(3 * output, k);
      });
    };
    add(limit.grip, Scalar(1));
    if (limit.other >= 0) add(limit.other, Scalar(-1));
    return limit.normal.dot(way) - limit.most;
  }

  std::vector<GripLimit<Scalar>> limits_;
  std::vector<char> beyond_;  // limit by limit, frame by frame
  VectorX<Scalar> row_;
  Scalar largest_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
