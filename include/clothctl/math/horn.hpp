#pragma once

// Absolute orientation (Horn's method): the rotation R and the translation t that map points a_j to
// points b_j with the least squared error,
//
//   min Σ w_j |b_j - R a_j - t|²,   t = c_b - R c_a,   c the weighted centroids.
//
// R maximises tr(R S), S = Σ w (a - c_a)(b - c_b)ᵀ. For a unit quaternion q that is qᵀ N q, with
// Horn's symmetric 4×4 matrix
//
//   N = [ tr S   zᵀ                 ]     z = (Syz - Szy, Szx - Sxz, Sxy - Syx),
//       [ z      S + Sᵀ - (tr S) I  ]
//
// so that q is the eigenvector of the largest eigenvalue. Let Sᵀ = U diag(s1, s2, d s3) Vᵀ with
// proper rotations U and V, s1 ≥ s2 ≥ s3 ≥ 0 and d = ±1. Then the eigenvectors of N are the
// quaternion q1 of U Vᵀ and the products q1 v_1, q1 v_2, q1 v_3 (a half turn about v_k, then U Vᵀ),
// with the eigenvalues
//
//   λ1 = s1 + s2 + d s3,   λ2 = s1 - s2 - d s3,   λ3 = -s1 + s2 - d s3,   λ4 = -s1 - s2 + d s3.
//
// These eigenpairs come from one-sided Jacobi rotations of the three columns of Sᵀ
// (symmetric_eigen.hpp). This does not square S, so no digits are lost, and takes half as many
// rotations as Jacobi on N. When other eigenvalues equal λ1 within a tolerance, the data do not
// determine R. Then q is the projection of a reference quaternion on the span of the eigenvectors
// of λ1 and of these eigenvalues: R is the solution closest to the reference. (λ1 - λ2)/2 is the
// curvature of the objective about its weakest axis v_1.
//
// Reference: Horn, J. Opt. Soc. Am. A 4, 629 (1987).

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "clothctl/config.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/math/symmetric_eigen.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// How much of a fitted rotation the data determine.
enum class HornStatus {
  /// All of R. Use it. `rotation_error` estimates its error for noisy data.
  Unique,
  /// R up to a turn about `free_axis`: the points are on a line, or there are only two. R is the
  /// solution closest to the reference. Use it if that turn does not matter or the reference is a
  /// good guess; otherwise add a point off the line.
  FreeTurn,
  /// Nothing of R: there is one point or none, all points coincide, or the two sets are not
  /// correlated.
  /// R is the reference.
  Free,
  /// b is a mirror image of a, up to a rigid motion and noise. Points in a plane are never
  /// mirrored; nearly flat sets that bulge to opposite sides are. R is the best rotation, never a
  /// reflection. Use it if the residuals are small enough, else look for swapped points or axes.
  Mirrored,
  /// `message` says what was refused. R is the reference (identity if the reference was refused), t
  /// is zero. Correct the input.
  InvalidInput
};

/// Returns the name of a status.
constexpr std::string_view to_string(HornStatus status) {
  switch (status) {
    case HornStatus::Unique: return "unique";
    case HornStatus::FreeTurn: return "free_turn";
    case HornStatus::Free: return "free";
    case HornStatus::Mirrored: return "mirrored";
    case HornStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// Settings of `horn`: when a turn counts as free.
template <RealScalar Scalar>
struct HornSettings {
  /// Eigenvalues whose distance from the largest is at most this, relative to the largest in
  /// modulus, count as equal to it. A strip of rms half length l and rms half width w has the
  /// relative distance 2 (w/l)². The default, 64 times the scalar's spacing (1.4e-14 in double,
  /// 7.6e-6 in float: strips 1e-7 and 0.002 as wide as long), lets R turn freely only where
  /// rounding has lost the turn, so the residuals are minimal; the R of a strip near this limit is
  /// as uncertain as `rotation_error` says. For n points with noise σ (m, each coordinate) and an
  /// acceptable turn error φ (rad), use 2 σ² / (φ² n l²); 1e-4 suits simulated cloth.
  Scalar tie_tolerance = default_tolerance();

  /// 64 times the scalar's spacing at one.
  static Scalar default_tolerance() { return Scalar(64) * scalar_traits<Scalar>::epsilon(); }
  /// Checks the values. Returns an empty text, or a static one that names the first bad value.
  std::string_view validate() const {
    if (!is_finite(tie_tolerance) || !(Scalar(0) < tie_tolerance))
      return "tie_tolerance is not a positive number";
    if (!(tie_tolerance < Scalar(1))) return "tie_tolerance is not below one";
    return {};
  }
};

/// A fitted rigid motion b ≈ R a + t.
template <RealScalar Scalar>
struct HornResult {
  /// The rotation as a matrix; orthonormal to rounding, with determinant +1, whatever the data.
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
  /// The rotation as a unit quaternion, of non-negative dot product with the reference (w ≥ 0 if
  /// the reference is the identity).
  Eigen::Quaternion<Scalar> rotation =
      Eigen::Quaternion<Scalar>(Scalar(1), Scalar(0), Scalar(0), Scalar(0));
  /// The translation (m): c_b - R c_a; zero if no point has a positive weight.
  Vector3<Scalar> t = Vector3<Scalar>::Constant(Scalar(0));
  /// Weighted root mean square of the distances |b_j - R a_j - t| (m).
  Scalar rms_residual = Scalar(0);
  /// Largest |b_j - R a_j - t| among the points of positive weight (m).
  Scalar largest_residual = Scalar(0);
  /// (λ1 - λ2) divided by the largest eigenvalue in modulus, in [0, 4/3]: at most the tolerance if
  /// a turn is free, 4/3 for a ball.
  Scalar gap = Scalar(0);
  /// Rms distance of the points from the axis about which R is weakest (m): noise σ (m, each
  /// coordinate) of n points turns R by σ / (rms_width √n) rad about this axis.
  Scalar rms_width = Scalar(0);
  /// Standard deviation of R about its weakest axis (rad), estimated from the residuals as if they
  /// came from independent noise; at most π, which also stands for "unknown": a free turn, or fewer
  /// than three points (two with given centroids).
  Scalar rotation_error = Scalar(3.14159265358979323846);
  /// Dimension of the set of equally good rotations: 0 for one rotation, 1 for a turn about
  /// `free_axis`, 2 for all products of two turns (mirrored balls), 3 for any rotation.
  int free_turns = 3;
  /// The unit axis, in the frame of the b_j, about which R may turn when `free_turns` is 1; else
  /// zero.
  Vector3<Scalar> free_axis = Vector3<Scalar>::Constant(Scalar(0));
  /// How much of R the data determine.
  HornStatus status = HornStatus::InvalidInput;
  /// With InvalidInput: what was refused (static text); else empty.
  std::string_view message;
};

namespace detail {

/// Returns a power of two that scales a positive value into 2⁻⁸ … 2⁸, if the value is within 2⁻¹⁰⁴
/// … 2¹⁰⁴.
template <RealScalar Scalar>
Scalar scaling_power_of_two(const Scalar& value) {
  const Scalar large(256), inverse = Scalar(1) / large;
  Scalar power(1);
  for (int k = 0; k < 12 && value * power > large; ++k) power *= inverse;
  for (int k = 0; k < 12 && value * power < inverse; ++k) power *= large;
  return power;
}

/// Returns true when every coefficient is finite. Reads all coefficients without an early return,
/// which is faster when all are finite.
template <class Derived>
bool every_finite(const Eigen::DenseBase<Derived>& matrix) {
  bool all = true;
  for (Index j = 0; j < matrix.cols(); ++j) {
    for (Index i = 0; i < matrix.rows(); ++i)
      all = all & is_finite(matrix.derived().coeffRef(i, j));
  }
  return all;
}

/// U diag(s) Vᵀ = A with proper rotations U, V and s1 ≥ s2 ≥ |s3|; s3 has the sign of det A.
template <RealScalar Scalar>
struct ProperSvd {
  Matrix3<Scalar> U, V;
  Vector3<Scalar> s;

  /// Decomposes A, whose largest entry in modulus must be within 2^±30. Singular values below the
  /// rounding error of the largest one have arbitrary vectors. Complexity: O(1), usually 4 and at
  /// most 12 sweeps of 3 rotations.
  explicit ProperSvd(const Matrix3<Scalar>& A) : U(A), V(Matrix3<Scalar>::Identity()) {
    using std::abs;
    using std::sqrt;
    for (int sweep = 0; sweep < 12; ++sweep) {
      const bool first = rotate<0, 1>(), second = rotate<0, 2>(), third = rotate<1, 2>();
      if (!first && !second && !third) break;
    }
    for (Index k = 0; k < 3; ++k) s[k] = U.col(k).squaredNorm();
    order(0, 1);
    order(1, 2);
    order(0, 1);

    s[0] = sqrt(s[0]);
    if (!(Scalar(0) < s[0])) {
      U.setIdentity();
      s.setConstant(Scalar(0));
      return;
    }
    const Vector3<Scalar> u1 = U.col(0) / s[0];
    Vector3<Scalar> u2 = U.col(1) - u1 * u1.dot(U.col(1));
    s[1] = sqrt(u2.squaredNorm());
    if (s[1] > Scalar(4) * scalar_traits<Scalar>::epsilon() * s[0]) {
      u2 /= s[1];
    } else {
      Index thin = 0;
      for (Index i = 1; i < 3; ++i) thin = abs(u1[i]) < abs(u1[thin]) ? i : thin;
      u2 = u1.cross(Vector3<Scalar>::Unit(thin));
      u2 /= Scalar(sqrt(u2.squaredNorm()));
    }
    const Vector3<Scalar> u3 = u1.cross(u2);
    s[2] = u3.dot(U.col(2));
    U.col(0) = u1;
    U.col(1) = u2;
    U.col(2) = u3;
  }

 private:
  /// Rotates columns i and j of U and of V so that those of U become orthogonal. Returns false when
  /// they were orthogonal already.
  template <int i, int j>
  bool rotate() {
    using std::abs;
    const Scalar eps = scalar_traits<Scalar>::epsilon();
    const Scalar alpha = U.col(i).squaredNorm(), beta = U.col(j).squaredNorm(),
                 gamma = U.col(i).dot(U.col(j));
    const Scalar negligible = eps * eps;
    if (!(gamma * gamma > negligible * alpha * beta) || !(abs(gamma) > negligible * (alpha + beta)))
      return false;
    const auto [cosine, sine] = jacobi_rotation<Scalar>(alpha, beta, gamma);
    turn<i, j>(U, cosine, sine);
    turn<i, j>(V, cosine, sine);
    return true;
  }
  template <int i, int j>
  static void turn(Matrix3<Scalar>& M, const Scalar& cosine, const Scalar& sine) {
    const Vector3<Scalar> before = M.col(i);
    M.col(i) = cosine * before - sine * M.col(j);
    M.col(j) = sine * before + cosine * M.col(j);
  }
  /// Exchanges columns i and j, by a rotation of 90°, when column j is longer.
  void order(Index i, Index j) {
    if (!(s[i] < s[j])) return;
    std::swap(s[i], s[j]);
    U.col(i).swap(U.col(j));
    V.col(i).swap(V.col(j));
    U.col(i) = -U.col(i);
    V.col(i) = -V.col(i);
  }
};

/// Sets the rotation of `result` to the one that maximises tr(R Bᵀ); among several, to the one
/// closest to the rotation that `result` holds at the call. Sets the status. Returns the curvature
/// of the objective about the weakest axis.
template <RealScalar Scalar>
Scalar fit_rotation(const Matrix3<Scalar>& B, const Scalar& tolerance, const Scalar& rounding,
                    HornResult<Scalar>& result) {
  using std::sqrt;
  const ProperSvd<Scalar> svd(B);
  const Scalar s1 = svd.s[0], s2 = svd.s[1], s3 = svd.s[2];
  const Scalar size = s1 + s2 + (s3 < Scalar(0) ? -s3 : s3);
  const Scalar tie = (std::max)(Scalar(tolerance * size), rounding);
  const Scalar apart[3] = {Scalar(2) * (s2 + s3), Scalar(2) * (s1 + s3), Scalar(2) * (s1 + s2)};
  const bool mirrored = Scalar(-2) * s3 > tie;
  result.free_turns = 0;
  while (result.free_turns < 3 && !(apart[result.free_turns] > tie)) ++result.free_turns;
  if (result.free_turns == 3 || (result.free_turns == 2 && !mirrored)) {
    result.free_turns = 3;
    result.status = HornStatus::Free;
    return Scalar(0);
  }
  result.status = mirrored                ? HornStatus::Mirrored
                  : result.free_turns > 0 ? HornStatus::FreeTurn
                                          : HornStatus::Unique;
  if (result.free_turns == 1) result.free_axis = svd.U.col(0);

  const Eigen::Quaternion<Scalar> reference = result.rotation;
  Eigen::Quaternion<Scalar> best(Matrix3<Scalar>(svd.U * svd.V.transpose()));
  best.normalize();
  if (result.free_turns > 0) {
    // All best quaternions are spanned by the orthonormal q1 (`best`) and q1 v_k. Multiplied by the
    // conjugate of q1 from the left, these become 1 and the v_k.
    const Eigen::Quaternion<Scalar> seen = best.conjugate() * reference;
    Vector3<Scalar> turn = Vector3<Scalar>::Constant(Scalar(0));
    for (Index k = 0; k < result.free_turns; ++k)
      turn += svd.V.col(k) * svd.V.col(k).dot(seen.vec());
    const Scalar length = sqrt(seen.w() * seen.w() + turn.squaredNorm());
    if (length > Scalar(4) * sqrt(scalar_traits<Scalar>::epsilon())) {
      best = best * Eigen::Quaternion<Scalar>(seen.w() / length, turn[0] / length, turn[1] / length,
                                              turn[2] / length);
      best.normalize();
    }
  }
  if (best.dot(reference) < Scalar(0)) best.coeffs() = -best.coeffs();
  result.rotation = best;
  result.R = best.toRotationMatrix();
  const Scalar curvature = apart[0] > Scalar(0) ? apart[0] : Scalar(0);
  result.gap = curvature / size;
  return curvature * Scalar(0.5);
}

/// Weights of the pairs, scaled by a power of two. An empty vector means that all weights are one.
template <RealScalar Scalar>
struct HornWeights {
  const Eigen::Ref<const VectorX<Scalar>>& weights;
  /// The largest weight, and the index of a pair that has it (-1 when no weight is positive).
  Scalar largest = Scalar(0);
  Index heaviest = -1;
  /// The power of two by which weights are multiplied.
  Scalar scale;

  /// Reads `n` finite weights, or an empty vector.
  HornWeights(const Eigen::Ref<const VectorX<Scalar>>& w, Index n) : weights(w) {
    if (w.size() == 0 && n > 0) heaviest = 0;
    for (Index j = 0; j < w.size(); ++j) {
      if (!(largest < w[j])) continue;
      largest = w[j];
      heaviest = j;
    }
    scale = Scalar(0) < largest ? scaling_power_of_two(largest) : Scalar(1);
  }
  /// Returns true when pair j has a positive weight.
  bool counts(Index j) const { return weights.size() == 0 || Scalar(0) < weights[j]; }
  /// Returns the scaled weight of pair j.
  Scalar operator[](Index j) const { return weights.size() == 0 ? Scalar(1) : weights[j] * scale; }
};

/// Points as offsets from a centre.
template <RealScalar Scalar>
struct HornCloud {
  const PointsView<Scalar>& points;
  /// The centre is origin + shift. They are stored apart, since the rounding of their sum would
  /// spoil the offsets of points far from the coordinate origin.
  Vector3<Scalar> origin, shift = Vector3<Scalar>::Constant(Scalar(0));
  /// Largest coordinate in modulus of the points, and of their offsets from `origin`.
  Scalar reach, spread;
  /// The power of two by which offsets are multiplied.
  Scalar scale;

  /// Puts the centre at `centre`, or at the weighted centroid if `centre` is null. The points must
  /// be finite.
  HornCloud(const PointsView<Scalar>& x, const HornWeights<Scalar>& weights,
            const Vector3<Scalar>* centre)
      : points(x) {
    origin = shift;
    if (centre != nullptr) {
      origin = *centre;
    } else if (weights.heaviest >= 0) {
      origin = x.col(weights.heaviest);
    }
    Scalar total(0);
    Vector3<Scalar> sum = shift, most = origin.cwiseAbs(), most_offset = shift;
    for (Index j = 0; j < x.cols(); ++j) {
      if (!weights.counts(j)) continue;
      const Vector3<Scalar> place = x.col(j), offset = place - origin;
      total += weights[j];
      sum += weights[j] * offset;
      most = most.cwiseMax(place.cwiseAbs());
      most_offset = most_offset.cwiseMax(offset.cwiseAbs());
    }
    if (centre == nullptr && weights.heaviest >= 0) shift = sum / total;
    reach = most.maxCoeff();
    spread = most_offset.maxCoeff();
    scale = Scalar(0) < spread ? scaling_power_of_two(spread) : Scalar(1);
  }
  /// Returns the rounding error of the coordinates relative to the spread, at most 1.
  Scalar noise() const {
    const Scalar rounding = Scalar(4) * scalar_traits<Scalar>::epsilon() * reach;
    return rounding < spread ? rounding / spread : Scalar(1);
  }
  /// Returns point j relative to the centre.
  CLOTHCTL_FORCE_INLINE Vector3<Scalar> offset(Index j) const {
    return (points.col(j) - origin) - shift;
  }
};

/// Fits R, then t. On entry the rotation of `result` is the reference. `unknowns` is the number of
/// fitted parameters: 6, or 3 with given centres.
template <RealScalar Scalar>
void fit_motion(const HornCloud<Scalar>& a, const HornCloud<Scalar>& b,
                const HornWeights<Scalar>& weights, const Scalar& tie_tolerance, Index unknowns,
                HornResult<Scalar>& result) {
  using std::sqrt;
  // B = Sᵀ, and the second moments, which scale its rounding error.
  const Index n = a.points.cols();
  Matrix3<Scalar> B = Matrix3<Scalar>::Constant(Scalar(0));
  Scalar total(0), moment_a(0), moment_b(0);
  Index count = 0;
  for (Index j = 0; j < n; ++j) {
    if (!weights.counts(j)) continue;
    const Vector3<Scalar> p = a.offset(j) * a.scale, q = b.offset(j) * b.scale, wq = weights[j] * q;
    for (Index k = 0; k < 3; ++k) B.col(k) += wq * p[k];
    total += weights[j];
    moment_a += weights[j] * p.squaredNorm();
    moment_b += wq.dot(q);
    ++count;
  }

  // The rounding errors of coordinates far from the origin, and those of the sum B, count as noise.
  const Scalar noise = (std::max)(a.noise(), b.noise());
  const Scalar tolerance = (std::max)(tie_tolerance, Scalar(Scalar(2) * noise * noise));
  const Scalar rounding =
      Scalar(8) * scalar_traits<Scalar>::epsilon() * sqrt(moment_a) * sqrt(moment_b);
  const Scalar curvature = fit_rotation<Scalar>(B, tolerance, rounding, result);
  const Matrix3<Scalar> R = result.R;
  result.t = (b.origin - R * a.origin) + (b.shift - R * a.shift);

  const Scalar scale = (std::min)(a.scale, b.scale);
  Scalar sum(0), worst(0);
  for (Index j = 0; j < n; ++j) {
    if (!weights.counts(j)) continue;
    const Vector3<Scalar> p = a.offset(j);
    const Vector3<Scalar> miss =
        (b.offset(j) - R.col(0) * p[0] - R.col(1) * p[1] - R.col(2) * p[2]) * scale;
    const Scalar square = miss.squaredNorm();
    sum += weights[j] * square;
    worst = (std::max)(worst, square);
  }
  if (!(Scalar(0) < total)) return;
  result.rms_residual = sqrt(sum / total) / scale;
  result.largest_residual = sqrt(worst) / scale;
  result.rms_width = sqrt(curvature / total) / (sqrt(a.scale) * sqrt(b.scale));
  const Index spare = Index(3) * count - unknowns;
  if (result.free_turns > 0 || spare <= 0) return;
  const Scalar miss = result.rms_residual / sqrt(Scalar(static_cast<double>(spare)));
  if (miss < result.rms_width * result.rotation_error)
    result.rotation_error = miss / result.rms_width;
}

/// Checks the input, then fits about the given centres, or about the centroids if these are null.
template <RealScalar Scalar>
HornResult<Scalar> fit_pairs(const PointsView<Scalar>& a, const PointsView<Scalar>& b,
                             const Eigen::Ref<const VectorX<Scalar>>& weights,
                             const Eigen::Quaternion<Scalar>& reference,
                             const HornSettings<Scalar>& settings, const Vector3<Scalar>* centre_a,
                             const Vector3<Scalar>* centre_b) {
  HornResult<Scalar> result;
  const auto refuse = [&result](std::string_view fault) {
    result.message = fault;
    return result;
  };
  const auto no_number = [](const auto& matrix) { return !every_finite(matrix); };
  if (no_number(reference.coeffs())) return refuse("the reference holds NaN or an infinity");
  const Scalar length = reference.coeffs().cwiseAbs().maxCoeff();
  if (!(length > Scalar(0))) return refuse("the reference is zero");
  Eigen::Quaternion<Scalar> unit = reference;
  unit.coeffs() /= length;
  unit.normalize();
  result.rotation = unit;
  result.R = unit.toRotationMatrix();

  if (const std::string_view fault = settings.validate(); !fault.empty()) return refuse(fault);
  if (a.cols() != b.cols()) return refuse("a and b differ in their number of points");
  if (weights.size() != 0 && weights.size() != a.cols())
    return refuse("weights are neither none nor one for each pair");
  if (no_number(a)) return refuse("a holds NaN or an infinity");
  if (no_number(b)) return refuse("b holds NaN or an infinity");
  if (no_number(weights)) return refuse("weights hold NaN or an infinity");
  if (centre_a != nullptr && (no_number(*centre_a) || no_number(*centre_b)))
    return refuse("a centroid holds NaN or an infinity");
  for (Index j = 0; j < weights.size(); ++j) {
    if (weights[j] < Scalar(0)) return refuse("weights hold a negative value");
  }

  const HornWeights<Scalar> tamed(weights, a.cols());
  const HornCloud<Scalar> from(a, tamed, centre_a), to(b, tamed, centre_b);
  if (is_unbounded(tamed.largest)) return refuse("weights hold a value beyond 1e20");
  if (is_unbounded(from.reach)) return refuse("a or its centroid holds a coordinate beyond 1e20 m");
  if (is_unbounded(to.reach)) return refuse("b or its centroid holds a coordinate beyond 1e20 m");
  fit_motion<Scalar>(from, to, tamed, settings.tie_tolerance, centre_a != nullptr ? 3 : 6, result);
  return result;
}

}  // namespace detail

/// Fits R and t to the pairs a_j → b_j (3×n each, m). `weights` (n, ≥ 0) may be empty, which stands
/// for ones. Pairs of weight zero are ignored. `rotation_error` takes weights as inverse variances.
/// Of equally good rotations the one closest to `reference` (any length but zero) is returned; pass
/// the rotation of the last result to avoid jumps along free turns. Name the scalar in the call:
/// `horn<double>(a, b)`. Never allocates. Complexity: O(n). Fails when (InvalidInput): a value is
/// NaN, infinite or beyond 1e20, a weight is negative, sizes differ, the reference is zero, or a
/// setting is bad.
template <RealScalar Scalar>
[[nodiscard]] HornResult<Scalar> horn(
    const PointsView<Scalar>& a, const PointsView<Scalar>& b,
    const Eigen::Ref<const VectorX<Scalar>>& weights = VectorX<Scalar>(),
    const Eigen::Quaternion<Scalar>& reference = Eigen::Quaternion<Scalar>::Identity(),
    const HornSettings<Scalar>& settings = HornSettings<Scalar>()) {
  return detail::fit_pairs<Scalar>(a, b, weights, reference, settings, nullptr, nullptr);
}

/// Fits only R, about given centroids: t = centroid_b - R centroid_a, even if they are not the
/// centroids of the points. A single point away from its centroid counts as a line. Everything else
/// is as in `horn`. Reference: [Bai 2016], eq. 11, with R u_j about the planned centroid.
template <RealScalar Scalar>
[[nodiscard]] HornResult<Scalar> horn_about(
    const PointsView<Scalar>& a, const PointsView<Scalar>& b, const Vector3<Scalar>& centroid_a,
    const Vector3<Scalar>& centroid_b,
    const Eigen::Ref<const VectorX<Scalar>>& weights = VectorX<Scalar>(),
    const Eigen::Quaternion<Scalar>& reference = Eigen::Quaternion<Scalar>::Identity(),
    const HornSettings<Scalar>& settings = HornSettings<Scalar>()) {
  return detail::fit_pairs<Scalar>(a, b, weights, reference, settings, &centroid_a, &centroid_b);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(void detail::fit_motion<double>(const detail::HornCloud<double>&,
                                                     const detail::HornCloud<double>&,
                                                     const detail::HornWeights<double>&,
                                                     const double&, Index, HornResult<double>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
