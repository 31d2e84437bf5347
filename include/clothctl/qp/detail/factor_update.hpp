#pragma once

// Updates a factor over a changing set of unknowns to a wanted set: by single updates when few
// unknowns change, else from scratch.

#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Makes `factor` hold the unknowns i of n that wanted(i) names, in the order in which they came.
/// The factor has size(), order(k), place(i), append(i), remove(k), renew(list, count) and
/// few(changes, kept), which says whether updates are cheaper; it may refuse unknowns. `fresh`
/// then lists those that were new; their number is the answer. `kept` is scratch; both have room
/// for n. Never allocates.
template <class Factor, class Wanted>
Index update_factor_to(Factor& factor, Index n, Wanted wanted, std::vector<Index>& fresh,
                       std::vector<Index>& kept) {
  Index gone = 0, count = 0;
  for (Index i = 0; i < n; ++i) {
    const bool in = factor.place(i) >= 0, stays = wanted(i);
    if (stays && !in) fresh[static_cast<std::size_t>(count++)] = i;
    if (!stays && in) ++gone;
  }
  if (gone == 0 && count == 0) return 0;
  if (factor.few(gone + count, factor.size() - gone)) {
    for (Index k = factor.size(); k-- > 0;) {
      if (!wanted(factor.order(k))) factor.remove(k);
    }
    for (Index k = 0; k < count; ++k) factor.append(fresh[static_cast<std::size_t>(k)]);
    return count;
  }
  Index size = 0;
  for (Index k = 0; k < factor.size(); ++k) {
    if (wanted(factor.order(k))) kept[static_cast<std::size_t>(size++)] = factor.order(k);
  }
  for (Index k = 0; k < count; ++k)
    kept[static_cast<std::size_t>(size++)] = fresh[static_cast<std::size_t>(k)];
  factor.renew(kept, size);
  return count;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
