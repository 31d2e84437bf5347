#pragma once

// The sweeps of a substep under a limit of stretch.
//
//   1. One-sided edges on coarse levels (lane_levels.hpp) carry the limit across the sheet.
//   2. Sweeps over all constraints correct stretch beyond the limit rigidly (LimitRule).
//   3. The last substep adds sweeps for the limit alone (TensionRule) until the largest stretch is
//      well below it.
//
// Compression is resisted only partly: a sheet gives way by folding.

#include <cstddef>

#include "clothctl/cloth/detail/edge_rules.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/core/report.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Does the sweeps of substep `part` (counted from 1) on a sheet in lanes or batches. `strain()`
/// corrects the triangle elements, `attach()` the attached vertices. Writes sweeps, residual and
/// status of the report.
template <class Sheet, RealScalar Scalar, class Strain, class Attach>
void sweep_within_limit(const Sheet& sheet, typename Sheet::Scratch& memory,
                        const PositionBasedSettings<Scalar>& settings, int part, Strain strain,
                        Attach attach, StepReport<Scalar>& report) {
  using Pack = typename Sheet::Pack;
  constexpr int kLevelSweeps = 3;
  const Scalar zero = Scalar(0), one = Scalar(1), limit = settings.stretch_limit;
  // The rules measure stretch by the current length: e = s/(1 + s). Sweeps leave a few percent, so
  // they pull edges back to a stretch that is 2 % below the limit, or to their rest length.
  const auto relative = [&](const Scalar& stretch) { return stretch / (one + stretch); };
  const Scalar target = limit - Scalar(0.02);
  const Scalar slack = zero < target ? relative(target) : zero;
  const Pack compression = Pack::all(settings.compression);
  sheet.correct_levels(part, kLevelSweeps, slack, memory);
  sheet.sweep_unlimited(memory);
  sheet.template bend<false, false>(memory);
  Scalar worst = zero;
  for (int i = 0; i < settings.iterations; ++i) {
    strain();
    attach();  // before the springs: a limit of stretch is kept whatever pulls
    LimitRule<Scalar, Sheet::kLanes> rule{Pack::all(slack), compression};
    worst = sheet.sweep(rule, memory).worst.largest();
    ++report.iterations;
  }
  if (part < settings.substeps) return;
  const Scalar goal = relative(target < zero ? limit * Scalar(0.75) : limit - Scalar(0.005));
  // These sweeps correct what all substeps left, so the share of one substep goes into velocities.
  // The whole correction would keep a sheet near its pins in motion for ever.
  const Scalar others = one - one / Scalar(static_cast<double>(settings.substeps));
  const auto add_to_start = [&](const Scalar& factor) {
    for (int v = 0; v < sheet.vertex_count(); ++v) {
      for (std::size_t c = 0; c < 3; ++c) {
        const Index at = static_cast<Index>(sheet.offset(v) + c * Sheet::kStride);
        memory.start[at] = memory.start[at] + factor * memory.points[at];
      }
    }
  };
  const bool more = goal < worst && settings.extra_sweeps > 0;
  if (more) add_to_start(zero - others);
  for (int i = 0; i < settings.extra_sweeps && goal < worst; ++i) {
    TensionRule<Scalar, Sheet::kLanes> rule{Pack::all(slack)};
    worst = sheet.sweep(rule, memory).worst.largest();
    ++report.iterations;
  }
  if (more) add_to_start(others);
  report.residual = zero < worst ? worst / (one - worst) : zero;
  if (relative(limit) < worst) report.status = StepStatus::IterationLimit;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
