#pragma once

// Columns of a dense column-major matrix, with a list of the nonzeros when at most a quarter of the
// entries are nonzero. The cost of products is then proportional to the number of nonzeros.

#include <algorithm>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A view of a column-major matrix, with a list of its nonzeros if it is sparse. The matrix must
/// outlive the view.
template <RealScalar Scalar>
class Columns {
 public:
  /// A dense vector.
  using Vector = VectorX<Scalar>;

  /// Makes room for the nonzeros of sparse matrices of up to rows × columns. Allocates.
  void reserve(Index rows, Index columns) {
    const std::size_t most = static_cast<std::size_t>(rows * columns / kSparse);
    if (index_.size() < most) index_.resize(most);
    if (value_.size() < most) value_.resize(most);
    if (start_.size() < static_cast<std::size_t>(columns) + 1)
      start_.resize(static_cast<std::size_t>(columns) + 1);
    view(nullptr, 0, 0);
  }

  /// Refers to a matrix and treats it as dense.
  void view(const Scalar* data, Index rows, Index columns) {
    data_ = data;
    rows_ = rows;
    columns_ = columns;
    sparse_ = false;
  }

  /// Sets the new address of the matrix after its memory moved. Its contents must be the same.
  void attach(const Scalar* data) { data_ = data; }

  /// Refers to a matrix, and lists its nonzeros if at most a quarter of the entries are nonzero.
  /// Otherwise treats it as dense. The matrix must not change afterwards.
  void list(const Scalar* data, Index rows, Index columns) {
    view(data, rows, columns);
    const std::size_t most = static_cast<std::size_t>(rows * columns / kSparse);
    std::size_t count = 0;
    for (Index j = 0; j < columns; ++j) {
      start_[static_cast<std::size_t>(j)] = static_cast<int>(count);
      const Scalar* column = data + j * rows;
      for (Index i = 0; i < rows; ++i) {
        if (!(column[i] < Scalar(0)) && !(column[i] > Scalar(0))) continue;
        if (count == most) return;
        index_[count] = static_cast<int>(i);
        value_[count++] = column[i];
      }
    }
    start_[static_cast<std::size_t>(columns)] = static_cast<int>(count);
    sparse_ = true;
  }

  /// Returns true when the nonzeros are listed.
  bool sparse() const { return sparse_; }
  /// Number of rows.
  Index rows() const { return rows_; }
  /// Number of columns.
  Index columns() const { return columns_; }
  /// Index of the first nonzero of column j. The nonzeros of column j end where those of column j +
  /// 1 begin. Valid only if `sparse()`.
  int start(Index j) const { return start_[static_cast<std::size_t>(j)]; }
  /// The row of nonzero k.
  int row(int k) const { return index_[static_cast<std::size_t>(k)]; }
  /// The value of nonzero k.
  const Scalar& value(int k) const { return value_[static_cast<std::size_t>(k)]; }

  /// out += s · column j, on the first rows() entries.
  void add(Index j, const Scalar& s, Vector& out) const {
    if (!sparse_) {
      add_scaled(rows_, s, column(j), out.data());
    } else {
      for (int k = start(j); k < start(j + 1); ++k) out[row(k)] += s * value(k);
    }
  }

  /// Returns Σ_i |M_ij x_i| for column j of the matrix M.
  Scalar size_of_dot(Index j, const Vector& x) const {
    using std::abs;
    Scalar size(0);
    if (!sparse_) {
      for (Index i = 0; i < rows_; ++i) size += abs(column(j)[i] * x[i]);
      return size;
    }
    for (int k = start(j); k < start(j + 1); ++k) size += abs(value(k) * x[row(k)]);
    return size;
  }

  /// sum += column j · x.
  void add_dot(Index j, const Vector& x, AccurateSum<Scalar>& sum) const {
    if (!sparse_) {
      for (Index i = 0; i < rows_; ++i) sum.add_product(column(j)[i], x[i]);
    } else {
      for (int k = start(j); k < start(j + 1); ++k) sum.add_product(value(k), x[row(k)]);
    }
  }

  /// out += |s · column j|, entry by entry.
  void add_size(Index j, const Scalar& s, Vector& out) const {
    using std::abs;
    if (!sparse_) {
      const Scalar factor = abs(s);
      for (Index i = 0; i < rows_; ++i) out[i] += factor * abs(column(j)[i]);
    } else {
      for (int k = start(j); k < start(j + 1); ++k) out[row(k)] += abs(s * value(k));
    }
  }

 private:
  static constexpr Index kSparse = 4;

  const Scalar* column(Index j) const { return data_ + j * rows_; }

  const Scalar* data_ = nullptr;
  Index rows_ = 0, columns_ = 0;
  bool sparse_ = false;
  std::vector<int> start_, index_;
  std::vector<Scalar> value_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
