#pragma once

// The inner loops of the dense factorisations, on plain arrays:
//
//   add_scaled      y ← y + a x                          add_four     y ← y + Σ_{k<4} a_k x_k
//   dot_product     xᵀy                                  dot_four     x_kᵀy for four vectors x_k
//   apply_rotation  (x, y) ← (c x + s y, c y - s x)      scale_by     x ← a x
//   ColumnSum       Σ_k w_k M_k over chosen columns of a matrix
//
// The loops use vector registers (linalg/detail/pack.hpp). Eigen expressions would be as fast, but
// each expression is a separate type, and the solvers would need hundreds of them. These few
// functions save most of the compile time.

#include <array>
#include <cstring>
#include <initializer_list>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/detail/pack.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Reads one vector register of numbers from any address.
template <class Scalar>
CLOTHCTL_KERNEL auto load_register(const Scalar* from) {
  typename Register<Scalar, native_lanes<Scalar>()>::type value;
  if constexpr (native_lanes<Scalar>() > 1) {
    std::memcpy(&value, from, sizeof(value));
  } else {
    value = *from;
  }
  return value;
}

/// Writes one vector register of numbers to any address.
template <class Scalar, class Value>
CLOTHCTL_KERNEL void store_register(Scalar* to, const Value& value) {
  if constexpr (native_lanes<Scalar>() > 1) {
    std::memcpy(to, &value, sizeof(value));
  } else {
    *to = value;
  }
}

/// The sum of the numbers in a register, from the first to the last.
template <class Scalar, class Value>
CLOTHCTL_KERNEL Scalar sum_register(const Value& value) {
  if constexpr (native_lanes<Scalar>() > 1) {
    Scalar sum = value[0];
    for (int i = 1; i < native_lanes<Scalar>(); ++i) sum += value[i];
    return sum;
  } else {
    return value;
  }
}

}  // namespace detail

/// y ← y + a x for arrays of n numbers that do not overlap.
template <RealScalar Scalar>
void add_scaled(Index n, const Scalar& a, const Scalar* x, Scalar* y) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  const Scalar factor = a;
  Index i = 0;
  for (; i + kLanes <= n; i += kLanes)
    detail::store_register(y + i,
                           detail::load_register(y + i) + detail::load_register(x + i) * factor);
  for (; i < n; ++i) y[i] = y[i] + x[i] * factor;
}

/// y ← y + Σ_k a[k] x[k] for four arrays x[k] of n numbers that do not overlap y. Reads and writes
/// y once instead of four times.
template <RealScalar Scalar>
void add_four(Index n, const std::array<Scalar, 4>& a, const std::array<const Scalar*, 4>& x,
              Scalar* y) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  const Scalar a0 = a[0], a1 = a[1], a2 = a[2], a3 = a[3];
  const Scalar *x0 = x[0], *x1 = x[1], *x2 = x[2], *x3 = x[3];
  Index i = 0;
  for (; i + kLanes <= n; i += kLanes) {
    const auto sum = detail::load_register(x0 + i) * a0 + detail::load_register(x1 + i) * a1 +
                     detail::load_register(x2 + i) * a2 + detail::load_register(x3 + i) * a3;
    detail::store_register(y + i, detail::load_register(y + i) + sum);
  }
  for (; i < n; ++i) y[i] = y[i] + (x0[i] * a0 + x1[i] * a1 + x2[i] * a2 + x3[i] * a3);
}

/// xᵀy for arrays of n numbers.
template <RealScalar Scalar>
Scalar dot_product(Index n, const Scalar* x, const Scalar* y) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  Scalar sum(0);
  Index i = 0;
  if (n >= 2 * kLanes) {
    auto even = detail::load_register(x) * detail::load_register(y);
    auto odd = detail::load_register(x + kLanes) * detail::load_register(y + kLanes);
    for (i = 2 * kLanes; i + 2 * kLanes <= n; i += 2 * kLanes) {
      even = even + detail::load_register(x + i) * detail::load_register(y + i);
      odd = odd + detail::load_register(x + i + kLanes) * detail::load_register(y + i + kLanes);
    }
    even = even + odd;
    sum = detail::sum_register<Scalar>(even);
  }
  for (; i < n; ++i) sum += x[i] * y[i];
  return sum;
}

/// The four products x[k]ᵀy for arrays of n numbers. Reads y once instead of four times.
template <RealScalar Scalar>
std::array<Scalar, 4> dot_four(Index n, const std::array<const Scalar*, 4>& x, const Scalar* y) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  const Scalar *x0 = x[0], *x1 = x[1], *x2 = x[2], *x3 = x[3];
  std::array<Scalar, 4> sum{Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  Index i = 0;
  if (n >= kLanes) {
    auto value = detail::load_register(y);
    auto s0 = detail::load_register(x0) * value, s1 = detail::load_register(x1) * value;
    auto s2 = detail::load_register(x2) * value, s3 = detail::load_register(x3) * value;
    for (i = kLanes; i + kLanes <= n; i += kLanes) {
      value = detail::load_register(y + i);
      s0 = s0 + detail::load_register(x0 + i) * value;
      s1 = s1 + detail::load_register(x1 + i) * value;
      s2 = s2 + detail::load_register(x2 + i) * value;
      s3 = s3 + detail::load_register(x3 + i) * value;
    }
    sum = {detail::sum_register<Scalar>(s0), detail::sum_register<Scalar>(s1),
           detail::sum_register<Scalar>(s2), detail::sum_register<Scalar>(s3)};
  }
  for (; i < n; ++i) {
    sum[0] += x0[i] * y[i];
    sum[1] += x1[i] * y[i];
    sum[2] += x2[i] * y[i];
    sum[3] += x3[i] * y[i];
  }
  return sum;
}

/// The rotation (x, y) ← (c x + s y, c y - s x) of arrays of n numbers that do not overlap.
template <RealScalar Scalar>
void apply_rotation(Index n, const Scalar& c, const Scalar& s, Scalar* x, Scalar* y) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  const Scalar cosine = c, sine = s;
  Index i = 0;
  for (; i + kLanes <= n; i += kLanes) {
    const auto old_x = detail::load_register(x + i);
    const auto old_y = detail::load_register(y + i);
    detail::store_register(x + i, old_x * cosine + old_y * sine);
    detail::store_register(y + i, old_y * cosine - old_x * sine);
  }
  for (; i < n; ++i) {
    const Scalar old_x = x[i], old_y = y[i];
    x[i] = old_x * cosine + old_y * sine;
    y[i] = old_y * cosine - old_x * sine;
  }
}

/// x ← a x for an array of n numbers.
template <RealScalar Scalar>
void scale_by(Index n, const Scalar& a, Scalar* x) {
  constexpr Index kLanes = detail::native_lanes<Scalar>();
  const Scalar factor = a;
  Index i = 0;
  for (; i + kLanes <= n; i += kLanes)
    detail::store_register(x + i, detail::load_register(x + i) * factor);
  for (; i < n; ++i) x[i] = x[i] * factor;
}

/// Sizes each of the vectors to n entries and sets them to zero. Allocates when a size changes.
template <RealScalar Scalar>
void set_zero(std::initializer_list<VectorX<Scalar>*> vectors, Index n) {
  for (VectorX<Scalar>* v : vectors) v->setZero(n);
}

/// Adds weighted columns of a column-major matrix to a vector `sum`. Adds four columns at a time,
/// so that `sum` is read and written once for four columns. The sum is complete only after
/// `finish`. Columns with weight zero cost nothing. Never allocates.
template <RealScalar Scalar>
class ColumnSum {
 public:
  /// Refers to a matrix whose column i begins at `matrix + i * stride`, and to `sum`, both with
  /// `rows` rows. Both must outlive this object.
  ColumnSum(const Scalar* matrix, Index stride, Index rows, Scalar* sum)
      : matrix_(matrix), sum_(sum), stride_(stride), rows_(rows) {}

  /// Adds w times column i.
  void add(Index i, const Scalar& w) {
    if (!(w < Scalar(0)) && !(w > Scalar(0))) return;
    column_[waiting_] = matrix_ + i * stride_;
    weight_[waiting_] = w;
    if (++waiting_ < kWidth) return;
    waiting_ = 0;
    add_four(rows_, weight_, column_, sum_);
  }

  /// Adds the collected columns.
  void finish() {
    for (std::size_t k = 0; k < waiting_; ++k) add_scaled(rows_, weight_[k], column_[k], sum_);
    waiting_ = 0;
  }

 private:
  static constexpr std::size_t kWidth = 4;

  const Scalar* matrix_;
  Scalar* sum_;
  Index stride_, rows_;
  std::array<const Scalar*, kWidth> column_{};
  std::array<Scalar, kWidth> weight_{};
  std::size_t waiting_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
