#pragma once

// The inputs of a frame of planning: measured positions and velocities, the time, the target and
// the air. `take_plan_input` refuses bad arguments without a message, because it may not allocate;
// `check_plan_input` finds the same faults and names the first.

#include <algorithm>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/detail/window_cost.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Samples target and wind over the window that starts at `t` (s), and stores the measured motion
/// of the held vertices. `x` (m) and `v` (m/s): 3×vertex_count. Returns false when a size is wrong,
/// a value is not finite or a target is out of reach. Never allocates.
template <RealScalar Scalar, class Contact, class Target, class Wind>
[[nodiscard]] bool take_plan_input(WindowProblem<Scalar, Contact>& problem,
                                   WindowCost<Scalar, Contact>& cost, Index vertex_count,
                                   const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                   Scalar t, const Target& target, const Wind& wind) {
  if (x.cols() != vertex_count || v.cols() != vertex_count) return false;
  if (!is_finite(t) || !all_finite(x) || !all_finite(v)) return false;
  for (Index k = 0; k < problem.settings.horizon; ++k) {
    // The air that acts during a frame is that of its start.
    const Vector3<Scalar> air = wind(frame_time(problem, t, k));
    problem.request.wind.col(k) = air;
  }
  if (!all_finite(problem.request.wind) || !cost.sample(problem, t, target)) return false;
  for (std::size_t j = 0; j < problem.request.held.size(); ++j) {
    problem.motion.position.col(static_cast<Index>(j)) = x.col(problem.request.held[j]);
    problem.motion.velocity.col(static_cast<Index>(j)) = v.col(problem.request.held[j]);
  }
  return true;
}

/// Stores supports in a request, sorted by vertex. Returns an empty string, or what is wrong, and
/// then changes nothing. Allocates.
template <RealScalar Scalar>
std::string take_supports(std::span<const VertexSupport<Scalar>> supports, Index vertices,
                          WindowRequest<Scalar>& request) {
  std::vector<VertexSupport<Scalar>> sorted(supports.begin(), supports.end());
  std::sort(sorted.begin(), sorted.end(),
            [](const auto& a, const auto& b) { return a.vertex < b.vertex; });
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const VertexSupport<Scalar>& support = sorted[i];
    const std::string name = "the support of vertex " + std::to_string(support.vertex);
    if (support.vertex < 0 || vertices <= support.vertex) return name + " is off the mesh";
    if (i > 0 && sorted[i - 1].vertex == support.vertex) return name + " occurs twice";
    if (!is_unit(support.normal)) return name + " has a normal that is not a unit vector";
    if (!all_finite(support.force)) return name + " has a force that is not finite";
    const bool ends = is_finite(support.release) || is_unbounded(support.release);
    if (!ends || !(Scalar(0) < support.release))
      return name + " has the release " + number_text(support.release) + " m, must be positive";
  }
  request.supports = std::move(sorted);
  return {};
}

/// Returns " is (x, y, z)". Allocates.
template <RealScalar Scalar>
std::string value_text(const Vector3<Scalar>& p) {
  return " is (" + number_text(p[0]) + ", " + number_text(p[1]) + ", " + number_text(p[2]) + ")";
}

/// Returns `value_text(p)` and the range that a target must be in. Allocates.
template <RealScalar Scalar>
std::string far_text(const Vector3<Scalar>& p) {
  return value_text(p) + ", must be finite and within " + number_text(largest_target<Scalar>()) +
         " m";
}

/// Returns an empty string, or a line that names the first target of a feature or hand, or the
/// first wind, that is not finite or out of reach. Allocates.
template <RealScalar Scalar, class Contact, class Target, class Wind>
std::string check_samples(const WindowProblem<Scalar, Contact>& problem,
                          const WindowCost<Scalar, Contact>& cost, Scalar t, const Target& target,
                          const Wind& wind) {
  const PlannerSettings<Scalar>& settings = problem.settings;
  for (Index k = 0; k < settings.horizon; ++k) {
    const Scalar start = frame_time(problem, t, k);
    const Vector3<Scalar> air = wind(start);
    if (!all_finite(air)) return "the wind at " + number_text(start) + " s" + value_text(air);
  }
  // The anchors need the targets at the start of the window, too.
  const Index first = Scalar(0) < settings.weights.anchor ? 0 : 1;
  for (Index k = first; k <= settings.horizon; ++k) {
    const Scalar time = frame_time(problem, t, k);
    for (Index i = 0; i < problem.feature_count; ++i) {
      const Vector3<Scalar> wanted = target(i, time);
      if (within_reach(wanted)) continue;
      return "the target of feature " + std::to_string(i) + " at " + number_text(time) + " s" +
             far_text(wanted);
    }
  }
  if (!(Scalar(0) < settings.weights.anchor)) return {};
  for (Index k = 0; k < settings.horizon; ++k) {
    const Scalar end = frame_time(problem, t, k + 1);
    for (std::size_t g = 0; g < problem.basis.grips().size(); ++g) {
      const Vector3<Scalar> wanted = cost.hand(settings, g, end, target);
      if (!within_reach(wanted)) {
        return "where grip " + std::to_string(g) + " belongs at " + number_text(end) +
               " s, by the target at times around it," + far_text(wanted);
      }
    }
  }
  return {};
}

/// Returns an empty string, or a line that names the first argument that `take_plan_input` would
/// refuse, and its value. Allocates.
template <RealScalar Scalar, class Contact, class Target, class Wind>
std::string check_plan_input(const WindowProblem<Scalar, Contact>& problem,
                             const WindowCost<Scalar, Contact>& cost, Index vertex_count,
                             const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                             const Target& target, const Wind& wind) {
  if (!is_finite(t)) return "the time is " + number_text(t);
  for (const auto& [name, points] :
       {std::pair<const char*, const PointsView<Scalar>*>{"position", &x}, {"velocity", &v}}) {
    if (points->cols() != vertex_count) {
      return "there are " + std::to_string(points->cols()) + " columns of " + name + " for " +
             std::to_string(vertex_count) + " vertices";
    }
    for (Index i = 0; i < points->cols(); ++i) {
      const Vector3<Scalar> value = points->col(i);
      if (!all_finite(value))
        return "the " + std::string(name) + " of vertex " + std::to_string(i) + value_text(value);
    }
  }
  return check_samples(problem, cost, t, target, wind);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
