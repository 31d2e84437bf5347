#pragma once

// The budget of a solve: a number of rounds, and a time limit by the caller's clock. The library
// itself has no clock.

#include <algorithm>

#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The budget of one solve. The time starts at construction.
class Budget {
 public:
  /// Takes the limits of iterations and time from `settings`. `size`, the number of unknowns plus
  /// constraint rows, sets the default limit of iterations. If there is a time limit, reads the
  /// clock once, for the start time.
  template <RealScalar Scalar>
  Budget(const QpSettings<Scalar>& settings, Index size)
      : rounds_(settings.max_iterations > 0 ? settings.max_iterations
                                            : 10 * static_cast<int>(size) + 10) {
    if (!(settings.time_limit > 0)) return;
    clock_ = settings.clock;
    context_ = settings.clock_context;
    deadline_ = clock_(context_) + settings.time_limit;
  }

  /// Returns a budget with half of the rounds that remain after `rounds`, at least one, and with
  /// the same deadline.
  Budget half(int rounds) const {
    Budget share = *this;
    share.rounds_ = rounds + (std::max)(1, (rounds_ - rounds) / 2);
    return share;
  }

  /// Returns Solved while the budget lasts after `rounds` rounds, else IterationLimit or TimeLimit.
  /// Reads the clock if there is a time limit.
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
