#pragma once

// Limits as a one-sided cost of a window, w max(0, s_k)² in frame k:
//
//   grips, features    s_k = n · (z_k - o_k) - most      z: centroid or feature, o: other or zero
//   acceleration       s_k = K (±(z_k - 2 z_{k-1} + z_{k-2})_i - a h²)     each grip, axis and sign
//
// The second is the distance by which a change of velocity beyond a h carries the grip within the
// window. The frames in which a limit counts are those beyond it in the last solution (a semismooth
// Newton method): solve, see which frames are beyond, and solve again where others are.

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "clothctl/mpc/detail/window_problem.hpp"
#include "clothctl/mpc/plan_types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The limits of a planner.
template <RealScalar Scalar>
class WindowLimits {
 public:
  /// Sets limits of grips and features. With another number of them no frame counts at first.
  /// Returns an empty string, or what is wrong, and then changes nothing. Allocates when there are
  /// more than ever before.
  template <class Problem>
  std::string set(const Problem& problem, std::span<const GripLimit<Scalar>> grips,
                  std::span<const FeatureLimit<Scalar>> features) {
    for (std::size_t i = 0; i < grips.size(); ++i) {
      const std::string bad = grips[i].validate(static_cast<int>(problem.basis.grips().size()));
      if (!bad.empty()) return "limit " + std::to_string(i) + bad;
    }
    for (std::size_t i = 0; i < features.size(); ++i) {
      const std::string bad = features[i].validate(problem.feature_count);
      if (!bad.empty()) return "feature limit " + std::to_string(i) + bad;
    }
    grips_.assign(grips.begin(), grips.end());
    features_.assign(features.begin(), features.end());
    resize(problem);
    return {};
  }
  /// Makes room for a problem; drops limits of grips that are no longer there. Allocates.
  template <class Problem>
  void reserve(const Problem& problem) {
    const int count = static_cast<int>(problem.basis.grips().size());
    std::erase_if(grips_, [&](const GripLimit<Scalar>& limit) {
      return count <= limit.grip || count <= limit.other;
    });
    row_.setZero(problem.request.inputs() * problem.settings.horizon);
    resize(problem);
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
    for (std::size_t i = 0; i < count_; ++i) {
      for (Index k = 0; k < horizon; ++k) {
        if (beyond_[flag(i, k, horizon)] == 0) continue;
        const Limit limit = at(problem, i);
        const Index size = (k + 1) * m;
        auto row = row_.head(size);
        row.setZero();
        for (Index d = 0; d <= limit.order && d <= k; ++d) add_row(problem, limit, d, k - d);
        for (Index c = 0; c < size; ++c) hessian.col(c).head(size) += (weight * row[c]) * row;
        gradient.head(size) += (weight * excess(problem, limit, k, nullptr)) * row;
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
    for (std::size_t i = 0; i < count_; ++i) {
      const Limit limit = at(problem, i);
      for (Index k = 0; k < horizon; ++k) {
        const Scalar s = excess(problem, limit, k, &change);
        const char now = Scalar(0) < s ? 1 : 0;
        if (limit.order == 0 && largest_ < s) largest_ = s;
        changed = changed || now != beyond_[flag(i, k, horizon)];
        beyond_[flag(i, k, horizon)] = now;
      }
    }
    return changed;
  }
  /// How far the plan of the last update is beyond a limit of grips or features at most, m.
  const Scalar& largest() const { return largest_; }

 private:
  /// Outputs whose mean is limited: `count` of them from `first` on.
  struct Mean {
    Index first = 0, count = 0;
  };
  /// s_k = scale · (n · Σ_d b_d (point - other)_{k-d} - most), b = 1, or 1, -2, 1 for order 2.
  struct Limit {
    Mean point, other;
    Vector3<Scalar> normal;
    Scalar most, scale;
    Index order;
  };

  static std::size_t flag(std::size_t i, Index k, Index horizon) {
    return i * static_cast<std::size_t>(horizon) + static_cast<std::size_t>(k);
  }
  static Scalar binomial(Index order, Index d) {
    return order == 2 && d == 1 ? Scalar(-2) : Scalar(1);
  }

  template <class Problem>
  void resize(const Problem& problem) {
    const std::size_t axes =
        Scalar(0) < problem.settings.max_acceleration ? 6 * problem.basis.grips().size() : 0;
    count_ = grips_.size() + features_.size() + axes;
    const std::size_t flags = count_ * static_cast<std::size_t>(problem.settings.horizon);
    if (beyond_.size() != flags) beyond_.assign(flags, 0);
  }

  template <class Problem>
  static Mean centroid(const Problem& problem, int grip) {
    const auto& held = problem.basis.held();
    const std::size_t g = static_cast<std::size_t>(grip);
    const Index first = static_cast<Index>(held.grip_begin(g));
    return {problem.feature_count + first, static_cast<Index>(held.grip_begin(g + 1)) - first};
  }
  /// Limit `i` of all: those of grips, of features, and of acceleration.
  template <class Problem>
  Limit at(const Problem& problem, std::size_t i) const {
    if (i < grips_.size()) {
      const GripLimit<Scalar>& limit = grips_[i];
      const Mean other = limit.other < 0 ? Mean() : centroid(problem, limit.other);
      return {centroid(problem, limit.grip), other, limit.normal, limit.most, Scalar(1), 0};
    }
    i -= grips_.size();
    if (i < features_.size()) {
      const FeatureLimit<Scalar>& limit = features_[i];
      return {{limit.feature, 1}, {}, limit.normal, limit.most, Scalar(1), 0};
    }
    i -= features_.size();
    const PlannerSettings<Scalar>& settings = problem.settings;
    const Scalar frames = Scalar(static_cast<double>(settings.horizon));
    Vector3<Scalar> normal = Vector3<Scalar>::Zero();
    normal[static_cast<Index>(i % 6) / 2] = i % 2 == 0 ? Scalar(1) : Scalar(-1);
    return {centroid(problem, static_cast<int>(i / 6)),
            {},
            normal,
            settings.max_acceleration * settings.dt * settings.dt,
            frames,
            2};
  }

  /// Adds what the inputs up to frame k do to the limited value through the point `d` frames ago.
  template <class Problem>
  void add_row(const Problem& problem, const Limit& limit, Index d, Index k) {
    const Index m = problem.request.inputs(), own = 3 * problem.feature_count;
    const WindowResponse<Scalar>& response = problem.response;
    const auto add = [&](const Mean& mean, const Scalar& sign) {
      const Scalar share =
          sign * limit.scale * binomial(limit.order, d) / Scalar(static_cast<double>(mean.count));
      for (Index o = mean.first; o < mean.first + mean.count; ++o) {
        for (Index j = 0; j <= k; ++j) {
          for (Index c = 0; c < 3; ++c) {
            const Scalar factor = share * limit.normal[c];
            if (response.has_jacobian && 3 * o < own) {
              row_.segment(j * m, m) +=
                  factor * response.jacobian.row(k * own + 3 * o + c).segment(j * m, m);
            } else {
              row_.segment(j * m, m) +=
                  factor * response.impulse_response.row(3 * o + c).segment((k - j) * m, m);
            }
          }
        }
      }
    };
    add(limit.point, Scalar(1));
    if (limit.other.count > 0) add(limit.other, Scalar(-1));
  }

  /// The mean of outputs at the end of frame k, or as measured: k = -1 now, -2 a frame ago.
  template <class Problem>
  static Vector3<Scalar> value(const Problem& problem, const Mean& mean, Index k,
                               const MatrixX<Scalar>* change) {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (Index o = mean.first; o < mean.first + mean.count; ++o) {
      const Index slot = o - problem.feature_count;
      if (k >= 0) {
        sum += problem.response.free_response.template block<3, 1>(3 * o, k);
        if (change != nullptr) sum += change->template block<3, 1>(3 * o, k);
      } else {
        sum += problem.motion.position.col(slot);
        if (k == -2) sum -= problem.settings.dt * problem.motion.velocity.col(slot);
      }
    }
    return sum / Scalar(static_cast<double>(mean.count));
  }

  /// s_k of a limit, with a change of the outputs or without.
  template <class Problem>
  static Scalar excess(const Problem& problem, const Limit& limit, Index k,
                       const MatrixX<Scalar>* change) {
    Vector3<Scalar> way = Vector3<Scalar>::Zero();
    for (Index d = 0; d <= limit.order; ++d)
      way += binomial(limit.order, d) * value(problem, limit.point, k - d, change);
    if (limit.other.count > 0) way -= value(problem, limit.other, k, change);
    return limit.scale * (limit.normal.dot(way) - limit.most);
  }

  std::vector<GripLimit<Scalar>> grips_;
  std::vector<FeatureLimit<Scalar>> features_;
  std::vector<char> beyond_;  // limit by limit, frame by frame
  VectorX<Scalar> row_;
  std::size_t count_ = 0;
  Scalar largest_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
