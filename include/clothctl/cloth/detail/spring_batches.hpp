#pragma once

// Springs in batches, so that compilers can vectorise the arithmetic of a batch. Only vertices are
// gathered and results scattered one by one.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/spring_forces.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Sixteen springs side by side; lanes without a spring have stiffness and damping zero.
template <RealScalar Scalar>
struct SpringBatch {
  static constexpr int kLanes = 16;
  using Row = std::array<Scalar, kLanes>;
  std::array<int, kLanes> a{}, b{}, slot{};
  Row rest{}, stiffness{}, compressed{}, damping{};
  int used = 0;
};

/// What the dampers of a step do, in the order of SpringBatches: the part N = D - h G of its
/// derivative (mass_spring_derivative.hpp). For a difference d of positions of the ends,
///
///   N d = n (q·d) - r d,   q = d_s n + r n - h (d_s/l) P u,   r = h (d_s/l) n·u
///
/// d_s: damping, n: direction before the step, u: difference of the velocities after it.
template <RealScalar Scalar>
struct DamperTerms {
  Points<Scalar> n, q;
  VectorX<Scalar> r;
};

/// The springs of a network, for gradient and matrix of a step (mass_spring_rollout.hpp) and for
/// its derivative.
template <RealScalar S>
class SpringBatches {
 public:
  using Scalar = S;
  using Batch = SpringBatch<Scalar>;
  static constexpr int kLanes = Batch::kLanes;

  SpringBatches() = default;

  /// Takes the springs of a network, whose pairs `pattern` has. Springs that are shorter than at
  /// rest keep the part compressed(spring) of their stiffness. Allocates.
  template <class Compressed>
  SpringBatches(const SpringNetwork<Scalar>& network, const BlockSymmetric<Scalar>& pattern,
                const Compressed& compressed) {
    for (const Spring<Scalar>& s : network.springs) {
      if (batches_.empty() || batches_.back().used == kLanes) batches_.emplace_back();
      Batch& batch = batches_.back();
      const std::size_t lane = static_cast<std::size_t>(batch.used++);
      batch.a[lane] = s.a;
      batch.b[lane] = s.b;
      batch.slot[lane] = pattern.find(s.a, s.b);
      batch.rest[lane] = s.rest_length;
      batch.stiffness[lane] = s.stiffness;
      batch.compressed[lane] = s.stiffness * compressed(s);
      batch.damping[lane] = s.damping;
    }
  }

  /// Returns the number of columns of `set_directions`.
  Index direction_columns() const { return static_cast<Index>(batches_.size()) * kLanes; }

  /// Writes the unit vectors along the springs at positions `x` (3×n, m), coordinate by coordinate
  /// for each batch: 3×direction_columns().
  void set_directions(const Points<Scalar>& x, Points<Scalar>& direction) const {
    using std::sqrt;
    Scalar* to = direction.data();
    for (const Batch& batch : batches_) {
      Lengths d;
      gather(batch, x, d);
      for (std::size_t l = 0; l < kLanes; ++l) {
        const Scalar inverse =
            Scalar(1) / sqrt(d.x[l] * d.x[l] + d.y[l] * d.y[l] + d.z[l] * d.z[l] + shortest());
        to[l] = d.x[l] * inverse;
        to[kLanes + l] = d.y[l] * inverse;
        to[2 * kLanes + l] = d.z[l] * inverse;
      }
      to += 3 * kLanes;
    }
  }

  /// Adds h D v - h f(y) to `gradient` (3×n, N s), with the damping D along `direction`. If
  /// `linear` also h² K v, with the projected stiffness K at y.
  void add_gradient(bool linear, const Points<Scalar>& y, const Points<Scalar>& v,
                    const Points<Scalar>& direction, const Scalar& h,
                    Points<Scalar>& gradient) const {
    add(linear, y, v, direction, h, gradient, [](const Batch&, std::size_t, const Blocks&) {});
  }

  /// The same, and adds h D + h² K to `matrix`.
  void add_step(bool linear, const Points<Scalar>& y, const Points<Scalar>& v,
                const Points<Scalar>& direction, const Scalar& h, Points<Scalar>& gradient,
                BlockSymmetric<Scalar>& matrix) const {
    add(linear, y, v, direction, h, gradient,
        [&](const Batch& batch, std::size_t l, const Blocks& k) {
          add_blocks(batch, l, k, matrix);
        });
  }

  /// Adds h D + h² K to `matrix`, with the share `compression` of the part of K under compression
  /// at y: 0 is the projected K, 1 the exact one.
  void add_matrix(const Points<Scalar>& y, const Points<Scalar>& direction, const Scalar& h,
                  const Scalar& compression, BlockSymmetric<Scalar>& matrix) const {
    const Scalar* e = direction.data();
    for (const Batch& batch : batches_) {
      Lengths d, f{};
      Blocks k;
      gather(batch, y, d);
      evaluate(batch, e, h, compression, d, f, k);
      for (std::size_t l = 0; l < static_cast<std::size_t>(batch.used); ++l)
        add_blocks(batch, l, k, matrix);
      e += 3 * kLanes;
    }
  }

  /// Writes what the dampers do to a step of `h` (s) that starts at the positions `x` (3×n, m) and
  /// ends with the velocities `v` (3×n, m/s). Allocates when `terms` is new.
  void write_dampers(const Points<Scalar>& x, const Points<Scalar>& v, const Scalar& h,
                     DamperTerms<Scalar>& terms) const {
    terms.n.resize(3, direction_columns());
    terms.q.resize(3, direction_columns());
    terms.r.resize(direction_columns());
    set_directions(x, terms.n);
    const Scalar* n = terms.n.data();
    Scalar* q = terms.q.data();
    Scalar* r = terms.r.data();
    for (const Batch& batch : batches_) {
      Lengths d, u;
      gather(batch, x, d);
      gather(batch, v, u);
      for (std::size_t l = 0; l < kLanes; ++l) {
        const Scalar nx = n[l], ny = n[kLanes + l], nz = n[2 * kLanes + l];
        const Scalar length = d.x[l] * nx + d.y[l] * ny + d.z[l] * nz;
        const Scalar least = Scalar(1e-6) * batch.rest[l];
        const Scalar turns = least < length ? h * batch.damping[l] / length : Scalar(0);
        const Scalar along = u.x[l] * nx + u.y[l] * ny + u.z[l] * nz;
        const Scalar rate = turns * along, own = batch.damping[l] + rate + rate;
        q[l] = own * nx - turns * u.x[l];
        q[kLanes + l] = own * ny - turns * u.y[l];
        q[2 * kLanes + l] = own * nz - turns * u.z[l];
        r[l] = rate;
      }
      n += 3 * kLanes;
      q += 3 * kLanes;
      r += kLanes;
    }
  }

  /// Adds N x to `out`, or Nᵀ x if `kTransposed`, for kColumns changes of the positions side by
  /// side (kColumns×3n).
  template <bool kTransposed, int kColumns>
  void add_dampers(const DamperTerms<Scalar>& terms, const Lanes<Scalar, kColumns>& x,
                   Lanes<Scalar, kColumns>& out) const {
    using Values = Eigen::Array<Scalar, kColumns, 1>;
    const Scalar* n = terms.n.data();
    const Scalar* q = terms.q.data();
    const Scalar* r = terms.r.data();
    for (const Batch& batch : batches_) {
      for (std::size_t l = 0; l < static_cast<std::size_t>(batch.used); ++l) {
        if (!(Scalar(0) < batch.damping[l])) continue;
        const Index a = 3 * static_cast<Index>(batch.a[l]), b = 3 * static_cast<Index>(batch.b[l]);
        const Scalar* from = kTransposed ? n : q;
        const Scalar* to = kTransposed ? q : n;
        const Values dx = (x.col(a) - x.col(b)).array();
        const Values dy = (x.col(a + 1) - x.col(b + 1)).array();
        const Values dz = (x.col(a + 2) - x.col(b + 2)).array();
        const Values along = from[l] * dx + from[kLanes + l] * dy + from[2 * kLanes + l] * dz;
        const auto add = [&](Index c, const Scalar& direction, const Values& d) {
          const Values push = direction * along - r[l] * d;
          out.col(a + c).array() += push;
          out.col(b + c).array() -= push;
        };
        add(0, to[l], dx);
        add(1, to[kLanes + l], dy);
        add(2, to[2 * kLanes + l], dz);
      }
      n += 3 * kLanes;
      q += 3 * kLanes;
      r += kLanes;
    }
  }

 private:
  using Row = typename Batch::Row;
  struct Lengths {
    Row x, y, z;
  };
  /// The six different entries of the springs' blocks.
  struct Blocks {
    Row xx, xy, xz, yy, yz, zz;
  };

  /// Keeps the directions of springs finite whose ends coincide, m².
  static Scalar shortest() { return Scalar(1e-20); }

  static void gather(const Batch& batch, const Points<Scalar>& x, Lengths& d) {
    const Scalar* from = x.data();
    for (std::size_t l = 0; l < kLanes; ++l) {
      const Scalar *a = from + 3 * batch.a[l], *b = from + 3 * batch.b[l];
      d.x[l] = a[0] - b[0];
      d.y[l] = a[1] - b[1];
      d.z[l] = a[2] - b[2];
    }
  }

  static void add_blocks(const Batch& batch, std::size_t l, const Blocks& k,
                         BlockSymmetric<Scalar>& matrix) {
    const std::array<Scalar, 9> block{k.xx[l], k.xy[l], k.xz[l], k.xy[l], k.yy[l],
                                      k.yz[l], k.xz[l], k.yz[l], k.zz[l]};
    Scalar* a = matrix.diagonal(batch.a[l]).data();
    Scalar* b = matrix.diagonal(batch.b[l]).data();
    Scalar* lower = matrix.lower(batch.slot[l]).data();
    for (std::size_t i = 0; i < 9; ++i) {
      a[i] = a[i] + block[i];
      b[i] = b[i] + block[i];
      lower[i] = lower[i] - block[i];
    }
  }

  /// Impulses (in place of the velocities `f`) and blocks of a batch.
  static void evaluate(const Batch& batch, const Scalar* e, const Scalar& h,
                       const Scalar& compression, const Lengths& d, Lengths& f, Blocks& k) {
    using std::sqrt;
    const Scalar zero = Scalar(0), one = Scalar(1);
    for (std::size_t l = 0; l < kLanes; ++l) {
      const Scalar ex = e[l], ey = e[kLanes + l], ez = e[2 * kLanes + l];
      const Scalar squared = d.x[l] * d.x[l] + d.y[l] * d.y[l] + d.z[l] * d.z[l] + shortest();
      const Scalar inverse = one / sqrt(squared);
      const Scalar strain = one - batch.rest[l] * inverse;
      const Scalar stiffness = h * (strain < zero ? batch.compressed[l] : batch.stiffness[l]);
      const Scalar pull = stiffness * strain, damping = h * batch.damping[l];
      const Scalar damp = damping * (f.x[l] * ex + f.y[l] * ey + f.z[l] * ez);
      f.x[l] = pull * d.x[l] + damp * ex;
      f.y[l] = pull * d.y[l] + damp * ey;
      f.z[l] = pull * d.z[l] + damp * ez;
      const Scalar across = h * pull * (strain < zero ? compression : one);
      const Scalar axial = (h * stiffness - across) * inverse * inverse;
      const Scalar ax = axial * d.x[l], ay = axial * d.y[l], az = axial * d.z[l];
      const Scalar bx = damping * ex, by = damping * ey, bz = damping * ez;
      k.xx[l] = ax * d.x[l] + bx * ex + across;
      k.xy[l] = ax * d.y[l] + bx * ey;
      k.xz[l] = ax * d.z[l] + bx * ez;
      k.yy[l] = ay * d.y[l] + by * ey + across;
      k.yz[l] = ay * d.z[l] + by * ez;
      k.zz[l] = az * d.z[l] + bz * ez + across;
    }
  }

  /// Adds the blocks of a batch times differences of velocities to its impulses.
  static void add_product(const Blocks& k, const Lengths& u, Lengths& f) {
    for (std::size_t l = 0; l < kLanes; ++l) {
      f.x[l] = f.x[l] + k.xx[l] * u.x[l] + k.xy[l] * u.y[l] + k.xz[l] * u.z[l];
      f.y[l] = f.y[l] + k.xy[l] * u.x[l] + k.yy[l] * u.y[l] + k.yz[l] * u.z[l];
      f.z[l] = f.z[l] + k.xz[l] * u.x[l] + k.yz[l] * u.y[l] + k.zz[l] * u.z[l];
    }
  }

  template <class AddBlock>
  void add(bool linear, const Points<Scalar>& y, const Points<Scalar>& v,
           const Points<Scalar>& direction, const Scalar& h, Points<Scalar>& gradient,
           const AddBlock& add_block) const {
    const Scalar* e = direction.data();
    Scalar* g = gradient.data();
    for (const Batch& batch : batches_) {
      Lengths d, u, f{};
      Blocks k;
      gather(batch, y, d);
      gather(batch, v, u);
      if (!linear) f = u;
      evaluate(batch, e, h, Scalar(0), d, f, k);
      if (linear) add_product(k, u, f);
      for (std::size_t l = 0; l < static_cast<std::size_t>(batch.used); ++l) {
        Scalar *a = g + 3 * batch.a[l], *b = g + 3 * batch.b[l];
        const std::array<Scalar, 3> push{f.x[l], f.y[l], f.z[l]};
        for (std::size_t c = 0; c < 3; ++c) {
          a[c] = a[c] + push[c];
          b[c] = b[c] - push[c];
        }
        add_block(batch, l, k);
      }
      e += 3 * kLanes;
    }
  }

  std::vector<Batch> batches_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
