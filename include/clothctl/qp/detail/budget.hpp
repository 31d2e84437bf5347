#pragma once

// The budget of a solve: a number of rounds, and seconds by the caller's clock. The library itself
// reads no clock.

#include <algorithm>

#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The budget of one solve, counted from its making.
class Budget {
 public:
  /// The budget that `settings` give a problem of `size` unknowns and rows. Reads the clock once if
  /// there is a time limit.
  template <RealScalar Scalar>
  Budget(const QpSettings<Scalar>& settings, Index size)
      : rounds_(settings.max_iterations > 0 ? settings.max_iterations
                                            : 10 * static_cast<int>(size) + 10) {
    if (!(settings.time_limit > 0)) return;
    clock_ = settings.clock;
    context_ = settings.clock_context;
    deadline_ = clock_(context_) + settings.time_limit;
  }

  /// Half of the rounds that are left after `rounds`, at least one; the same deadline.
  Budget half(int rounds) const {
    Budget share = *this;
    share.rounds_ = rounds + (std::max)(1, (rounds_ - rounds) / 2);
    return share;
  }

  /// Solved while there is something left after `rounds` rounds, else what ran out. Reads the
  /// clock.
  QpStatus after(int rounds) const {
    if (rounds >= rounds_) return QpStatus::IterationLimit;
    return clock_ != nullptr && !(clock_(context_) < deadline_) ? QpStatus::TimeLimit
                                                                : QpStatus::Solved;
  }

 private:
  int rounds_;
  double (*clock_)(void*) = nullptr;
  void* context_ = nullptr;
  double deadline_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
