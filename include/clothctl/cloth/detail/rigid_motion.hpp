#pragma once

// The rigid motion that is closest to a field of displacements d of masses m at x: it has the same
// linear and angular momentum.
//
//   u = Σ m d / Σ m,   c = Σ m x / Σ m,   ω = I⁻¹ Σ m (x - c) × d,
//   rigid displacement  u + ω × (x - c)
//
// Sums run over numbers or over packs of them (core/simd.hpp).

#include <array>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The sum of the lanes of a pack.
template <class Number>
auto total_of(const Number& value) {
  if constexpr (requires { value.sum(); }) {
    return value.sum();
  } else {
    return value;
  }
}

/// Σ m, Σ m x and Σ m d.
template <class Number>
struct FirstMoments {
  Number mass, x, y, z, px, py, pz;

  explicit FirstMoments(const Number& zero)
      : mass(zero), x(zero), y(zero), z(zero), px(zero), py(zero), pz(zero) {}
  /// Adds a mass at `at` with the displacement `d`; both have members x, y, z.
  template <class Point>
  void add(const Number& m, const Point& at, const Point& d) {
    mass = mass + m;
    x = x + m * at.x;
    y = y + m * at.y;
    z = z + m * at.z;
    px = px + m * d.x;
    py = py + m * d.y;
    pz = pz + m * d.z;
  }
};

/// Second moments about a centre, and Σ m (x - c) × d.
template <class Number>
struct SecondMoments {
  Number xx, yy, zz, xy, yz, zx, lx, ly, lz;

  explicit SecondMoments(const Number& zero)
      : xx(zero), yy(zero), zz(zero), xy(zero), yz(zero), zx(zero), lx(zero), ly(zero), lz(zero) {}
  /// Adds a mass at r from the centre with the displacement `d`.
  template <class Point>
  void add(const Number& m, const Number& rx, const Number& ry, const Number& rz, const Point& d) {
    xx = xx + m * rx * rx;
    yy = yy + m * ry * ry;
    zz = zz + m * rz * rz;
    xy = xy + m * rx * ry;
    yz = yz + m * ry * rz;
    zx = zx + m * rz * rx;
    lx = lx + m * (ry * d.z - rz * d.y);
    ly = ly + m * (rz * d.x - rx * d.z);
    lz = lz + m * (rx * d.y - ry * d.x);
  }
};

/// Returns ω from the sums. About an axis on which all mass lies, ω is close to zero.
template <RealScalar Scalar, class Number>
Vector3<Scalar> angular_displacement(const SecondMoments<Number>& sums) {
  const Scalar xx = total_of(sums.xx), yy = total_of(sums.yy), zz = total_of(sums.zz);
  const Scalar trace = xx + yy + zz;
  if (!(Scalar(0) < trace)) return Vector3<Scalar>::Zero();
  // I = trace 1 - moments. Scaled by the trace, its determinant neither over- nor underflows.
  const Scalar one = Scalar(1), least = Scalar(16) * scalar_traits<Scalar>::epsilon();
  const Scalar a = one - xx / trace + least, b = one - yy / trace + least,
               c = one - zz / trace + least;
  const Scalar d = Scalar(0) - total_of(sums.xy) / trace, e = Scalar(0) - total_of(sums.yz) / trace,
               f = Scalar(0) - total_of(sums.zx) / trace;
  // The cofactors of a symmetric matrix are its inverse times its determinant.
  const Scalar aa = b * c - e * e, bb = a * c - f * f, cc = a * b - d * d, ab = e * f - d * c,
               bc = d * f - a * e, ca = d * e - b * f;
  const Scalar scale = one / ((a * aa + d * ab + f * ca) * trace);
  const Scalar x = total_of(sums.lx), y = total_of(sums.ly), z = total_of(sums.lz);
  return Vector3<Scalar>(scale * (aa * x + ab * y + ca * z), scale * (ab * x + bb * y + bc * z),
                         scale * (ca * x + bc * y + cc * z));
}

/// Returns a number, or a pack with this number in all lanes.
template <class Number, class Scalar>
Number filled_with(const Scalar& value) {
  if constexpr (requires { Number::all(value); }) {
    return Number::all(value);
  } else {
    return value;
  }
}

/// A rigid displacement: u + ω × (x - c).
template <class Number>
struct RigidDisplacement {
  Number cx, cy, cz, ux, uy, uz, ox, oy, oz;

  /// Returns `d` without the rigid displacement at `x`; both have members x, y, z.
  template <class Point>
  Point removed_from(Point d, const Point& x) const {
    const Number rx = x.x - cx, ry = x.y - cy, rz = x.z - cz;
    d.x = d.x - (ux + oy * rz - oz * ry);
    d.y = d.y - (uy + oz * rx - ox * rz);
    d.z = d.z - (uz + ox * ry - oy * rx);
    return d;
  }
};

/// Returns the closest rigid displacement. `for_each(visit)` calls visit(m, x, d) for each mass m
/// at x with the displacement d; x and d have members x, y, z.
template <RealScalar Scalar, class Number, class ForEach>
RigidDisplacement<Number> closest_rigid_displacement(ForEach&& for_each) {
  const Number zero = filled_with<Number>(Scalar(0));
  FirstMoments<Number> first(zero);
  for_each([&](const Number& m, const auto& x, const auto& d) { first.add(m, x, d); });
  const Scalar per_mass = Scalar(1) / total_of(first.mass);
  const auto mean = [&](const Number& sum) {
    return filled_with<Number>(Scalar(total_of(sum) * per_mass));
  };
  RigidDisplacement<Number> rigid{mean(first.x),  mean(first.y),  mean(first.z),
                                  mean(first.px), mean(first.py), mean(first.pz),
                                  zero,           zero,           zero};
  SecondMoments<Number> second(zero);
  for_each([&](const Number& m, const auto& x, const auto& d) {
    second.add(m, x.x - rigid.cx, x.y - rigid.cy, x.z - rigid.cz, d);
  });
  const Vector3<Scalar> turn = angular_displacement<Scalar>(second);
  rigid.ox = filled_with<Number>(turn[0]);
  rigid.oy = filled_with<Number>(turn[1]);
  rigid.oz = filled_with<Number>(turn[2]);
  return rigid;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
