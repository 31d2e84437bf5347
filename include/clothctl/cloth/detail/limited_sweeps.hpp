#pragma once

// The sweeps of a substep under a limit of stretch.
//
//   0. A state with edges beyond the limit is corrected before the first substep, without effect on
//      its velocities: a stretch of δ would become a velocity δ/h.
//   1. One-sided edges on coarse levels (lane_levels.hpp) carry the limit across the sheet.
//   2. Sweeps over all constraints correct stretch beyond the limit rigidly (LimitRule).
//   3. The last substep adds sweeps for the limit alone (TensionRule) until the largest stretch is
//      well below it. Before each of them, points inside of obstacles are lifted to the surface:
//      what the limit pulls in would come out later, at the cost of the limit. The contacts that
//      the step corrects afterwards bring back what these sweeps took along, so that correction has
//      as little effect on velocities: else what sticks would tremble.
//
// A sheet gives way to compression by folding: only large compressions are resisted, and partly.

#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/edge_rules.hpp"
#include "clothctl/cloth/detail/passive_share.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/core/report.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the stretch s (length over rest length, minus 1) as part of the current length, which is
/// what the rules measure: s/(1 + s).
template <RealScalar Scalar>
Scalar relative_stretch(const Scalar& stretch) {
  return stretch / (Scalar(1) + stretch);
}

/// Returns the stretch that sweeps pull edges back to, as above. Sweeps leave a few percent, so it
/// is 2 % below the limit, or 0.
template <RealScalar Scalar>
Scalar slack_of_limit(const Scalar& limit) {
  const Scalar target = limit - Scalar(0.02);
  return Scalar(0) < target ? relative_stretch(target) : Scalar(0);
}

/// Adds `factor` times the points to the points at the start of the substep.
template <class Sheet, RealScalar Scalar>
void add_to_start(const Sheet& sheet, typename Sheet::Scratch& memory, const Scalar& factor) {
  for (int v = 0; v < sheet.vertex_count(); ++v) {
    for (std::size_t c = 0; c < 3; ++c) {
      const Index at = static_cast<Index>(sheet.offset(v) + c * Sheet::kStride);
      memory.start[at] = memory.start[at] + factor * memory.points[at];
    }
  }
}

/// Calls `sweep()`; the share `still` of its corrections also moves the points at the start of the
/// substep, so that it has no effect on velocities.
template <class Sheet, RealScalar Scalar, class Sweep>
void with_start(const Sheet& sheet, typename Sheet::Scratch& memory, const Scalar& still,
                Sweep sweep) {
  const bool moves = Scalar(0) < still;
  if (moves) add_to_start(sheet, memory, Scalar(Scalar(0) - still));
  sweep();
  if (moves) add_to_start(sheet, memory, still);
}

/// Where the largest stretch `worst` is above `goal` (both by the current length), sweeps for the
/// limit alone until none is, `extra_sweeps` at most, each after `lift(1 - still)`. The share
/// `still` of the corrections also moves the points at the start of the substep, so it has no
/// effect on velocities. Returns the largest stretch that the last sweep met. Counts the sweeps in
/// the report.
///
/// What is too long lies along lines of edges, along which plain sweeps carry a correction slowly
/// and over-relaxed ones fast; but these overshoot and leave single edges stretched. So cycles of
/// 10, 20, 30, ... sweeps end with three plain ones, and the last sweep of all is plain.
template <class Sheet, RealScalar Scalar, class Lift>
Scalar sweep_until(const Scalar& goal, Scalar worst, const Scalar& still, const Sheet& sheet,
                   typename Sheet::Scratch& memory, const PositionBasedSettings<Scalar>& settings,
                   Lift lift, StepReport<Scalar>& report) {
  using Rule = TensionRule<Scalar, Sheet::kLanes>;
  constexpr int kCycle = 10, kPlain = 3;
  const int most = settings.extra_sweeps;
  if (!(goal < worst) || most < 1) return worst;
  const Scalar slack = slack_of_limit(settings.stretch_limit);
  const Rule plain{Sheet::Pack::all(slack)}, over = Rule::over_relaxed(slack);
  with_start(sheet, memory, still, [&] {
    int end = 0, cycle = 0;
    bool fast = false;
    for (int i = 0; i < most && (fast || goal < worst); ++i) {
      if (i == end) {
        cycle += kCycle;
        end = cycle < most - end ? end + cycle : most;
      }
      fast = goal < worst && i + kPlain < end;
      lift(Scalar(Scalar(1) - still));
      worst = sheet.sweep(fast ? over : plain, SweepOrder::Forward, memory).worst.largest();
      ++report.iterations;
    }
  });
  return worst;
}

/// Where edges are beyond the limit before the first substep, pulls stretched edges back to the
/// slack with at most `extra_sweeps` sweeps, until none is beyond the limit. The points at the
/// start of the substep move alike. Counts these sweeps in the report.
template <class Sheet, RealScalar Scalar>
void pull_within_limit(const Sheet& sheet, typename Sheet::Scratch& memory,
                       const PositionBasedSettings<Scalar>& settings, StepReport<Scalar>& report) {
  using Pack = typename Sheet::Pack;
  using Rule = TensionRule<Scalar, Sheet::kLanes>;
  const Scalar goal = relative_stretch(settings.stretch_limit);
  if (settings.extra_sweeps < 1) return;
  const Rule measure{Pack::all(goal), Pack::all(Scalar(0))};
  const Scalar worst = sheet.sweep(measure, SweepOrder::Forward, memory).worst.largest();
  sweep_until(
      goal, worst, Scalar(1), sheet, memory, settings, [](const Scalar&) {}, report);
}

/// Returns what the motion of a substep of `h` s is measured against. `held`: vertices.
template <class Sheet, RealScalar Scalar>
PassiveFrame<Scalar> substep_frame(const Sheet& sheet, const typename Sheet::Scratch& memory,
                                   const PositionBasedSettings<Scalar>& settings, const Scalar& h,
                                   const std::vector<int>& held) {
  using std::sqrt;
  const auto displacement = [&](std::size_t i) {
    const auto coordinate = [&](std::size_t c) {
      const Index at = static_cast<Index>(sheet.offset(held[i]) + c * Sheet::kStride);
      return Scalar(memory.points[at] - memory.start[at]);
    };
    return Triple<Scalar>{coordinate(0), coordinate(1), coordinate(2)};
  };
  return passive_frame(held.size(), displacement,
                       Scalar(h * h * sqrt(settings.gravity.squaredNorm())));
}

/// Corrects the sheet on its levels in substep `part` (counted from 1). The sets of levels take
/// turns if they `alternate`, else the set of odd substeps serves all.
template <class Sheet, RealScalar Scalar>
void correct_on_levels(const Sheet& sheet, typename Sheet::Scratch& memory,
                       const PositionBasedSettings<Scalar>& settings, int part, bool alternate,
                       const PassiveFrame<Scalar>& frame) {
  constexpr int kLevelSweeps = 3;
  const Scalar slack = slack_of_limit(settings.stretch_limit);
  sheet.correct_levels(alternate ? part : 1, kLevelSweeps, slack, frame, memory);
}

/// Does the sweeps of substep `part` on a sheet in lanes or batches. `strain()` corrects the
/// triangle elements, `attach()` attached vertices and contacts, `lift()` lifts points out of
/// obstacles. Writes sweeps, residual and status of the report. Returns the share of the last
/// sweeps that has no effect on velocities.
template <class Sheet, RealScalar Scalar, class Strain, class Attach, class Lift>
Scalar sweep_within_limit(const Sheet& sheet, typename Sheet::Scratch& memory,
                          const PositionBasedSettings<Scalar>& settings, int part, Strain strain,
                          Attach attach, Lift lift, StepReport<Scalar>& report) {
  using Pack = typename Sheet::Pack;
  const Scalar zero = Scalar(0), one = Scalar(1), limit = settings.stretch_limit;
  const Scalar slack = slack_of_limit(limit);
  const Pack compression = Pack::all(settings.compression);
  const Pack free = Pack::all(zero - relative_stretch(Scalar(zero - settings.free_compression)));
  sheet.sweep_unlimited(memory);
  sheet.template bend<false, false>(SweepOrder::Forward, memory);
  Scalar worst = zero;
  for (int i = 0; i < settings.iterations; ++i) {
    strain(SweepOrder::Forward);
    attach();  // before the springs: a limit of stretch is kept whatever pulls
    LimitRule<Scalar, Sheet::kLanes> rule{Pack::all(slack), compression, free};
    worst = sheet.sweep(rule, SweepOrder::Forward, memory).worst.largest();
    ++report.iterations;
  }
  if (part < settings.substeps) return zero;
  const Scalar goal =
      relative_stretch(Scalar(limit < Scalar(0.02) ? limit * Scalar(0.75) : limit - Scalar(0.005)));
  // These sweeps correct what all substeps left, so the share of one substep goes into velocities.
  // The whole correction would keep a sheet near its pins in motion for ever.
  const Scalar others = one - one / Scalar(static_cast<double>(settings.substeps));
  const int before = report.iterations;
  worst = sweep_until(goal, worst, others, sheet, memory, settings, lift, report);
  report.residual = zero < worst ? worst / (one - worst) : zero;
  if (relative_stretch(limit) < worst) report.status = StepStatus::IterationLimit;
  return before < report.iterations ? others : zero;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
