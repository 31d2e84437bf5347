#pragma once

// Updates a factor to a new set of unknowns: by single updates when few unknowns change, else from
// scratch.

#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Changes `factor` to hold the unknowns i < n for which wanted(i) is true. Unknowns that stay keep
/// their order; new ones follow. The factor has size(), order(k), place(i), append(i), remove(k),
/// renew(list, count), and few(changes, kept), which returns true when single updates are cheaper.
/// append and renew may refuse an unknown. Returns the number of new unknowns, refused ones
/// included, and lists them in `fresh`. `kept` is scratch memory. Both lists have room for n
/// entries. Never allocates.
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
