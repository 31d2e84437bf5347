#pragma once

// The sweeps of a substep without a limit of stretch (with one: limited_sweeps.hpp), on a sheet in
// lanes or batches. A sweep corrects all springs, triangle elements, bending stencils and attached
// vertices once.

#include "clothctl/cloth/detail/edge_rules.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Does `sweeps` sweeps with rigid distances, in the listed order. `strain(order)` corrects the
/// triangle elements, `attach()` the attached vertices.
template <class Scalar, class Sheet, class Strain, class Attach>
void sweep_rigidly(const Sheet& sheet, typename Sheet::Scratch& memory, int sweeps, Strain strain,
                   Attach attach) {
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    constexpr SweepOrder kListed = SweepOrder::Forward;
    sheet.sweep(RigidRule<Scalar, Sheet::kLanes>{}, kListed, memory);
    strain(kListed);
    sheet.template bend<false, false>(kListed, memory);
    attach();
  }
}

/// Does a sweep of compliant constraints, number `turn` of `sweeps`. `kDamped`: with dampers;
/// `kRead`: from the multipliers of the sweep before; `kWrite`: leaves them for the next.
template <class Scalar, bool kDamped, bool kRead, bool kWrite, class Sheet, class Strain,
          class Attach>
void sweep_compliantly_once(const Sheet& sheet, typename Sheet::Scratch& memory, int turn,
                            int sweeps, Strain strain, Attach attach) {
  const SweepOrder order = alternating(turn, sweeps);
  const auto springs = [&] {
    sheet.sweep(CompliantRule<Scalar, Sheet::kLanes, kDamped, kRead, kWrite>{}, order, memory);
  };
  if (order == SweepOrder::Forward) {
    springs();
    strain(order);
    sheet.template bend<kRead, kWrite>(order, memory);
  } else {
    sheet.template bend<kRead, kWrite>(order, memory);
    strain(order);
    springs();
  }
  attach();
}

/// Does `sweeps` sweeps of compliant constraints, in alternating directions.
template <class Scalar, bool kDamped, class Sheet, class Strain, class Attach>
void sweep_compliantly_as(const Sheet& sheet, typename Sheet::Scratch& memory, int sweeps,
                          Strain strain, Attach attach) {
  const auto once = [&]<bool kRead, bool kWrite>(int turn) {
    sweep_compliantly_once<Scalar, kDamped, kRead, kWrite>(sheet, memory, turn, sweeps, strain,
                                                           attach);
  };
  const int last = sweeps - 1;
  if (last == 0) return once.template operator()<false, false>(0);
  once.template operator()<false, true>(0);
  for (int i = 1; i < last; ++i) once.template operator()<true, true>(i);
  once.template operator()<true, false>(last);
}

/// The same, with dampers if the sheet has any.
template <class Scalar, class Sheet, class Strain, class Attach>
void sweep_compliantly(const Sheet& sheet, typename Sheet::Scratch& memory, int sweeps,
                       Strain strain, Attach attach) {
  if (sheet.damped())
    return sweep_compliantly_as<Scalar, true>(sheet, memory, sweeps, strain, attach);
  sweep_compliantly_as<Scalar, false>(sheet, memory, sweeps, strain, attach);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
