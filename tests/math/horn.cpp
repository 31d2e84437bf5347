// Absolute orientation. Exact motions are recovered, and no rotation is better than the answer
// (compared with an independent SVD, Horn's own matrix and rotated answers). Free rotations are
// reported and follow the reference.

#include "clothctl/math/horn.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using clothctl::horn;
using clothctl::horn_about;
using clothctl::HornResult;
using clothctl::HornSettings;
using clothctl::HornStatus;
using clothctl::Index;
using clothctl::Matrix3;
using clothctl::Points;
using clothctl::Vector3;
using clothctl::VectorX;

namespace {

constexpr double kPi = 3.14159265358979323846;

template <class Scalar>
constexpr double eps() {
  return static_cast<double>(std::numeric_limits<Scalar>::epsilon());
}

/// Random data for the tests.
class Draw {
 public:
  explicit Draw(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  int integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine_); }
  double normal() { return normal_(engine_); }
  Vector3<double> vector() {
    const double x = normal(), y = normal(), z = normal();
    return Vector3<double>(x, y, z);
  }
  Vector3<double> direction() { return vector().normalized(); }
  Eigen::Quaterniond rotation() {
    const double w = normal(), x = normal(), y = normal(), z = normal();
    return Eigen::Quaterniond(w, x, y, z).normalized();
  }
  /// n normally distributed points with the given deviations along three axes, rotated.
  Points<double> cloud(Index n, const Vector3<double>& deviations) {
    const Matrix3<double> axes = rotation().toRotationMatrix();
    Points<double> x(3, n);
    for (Index j = 0; j < n; ++j) x.col(j) = axes * deviations.cwiseProduct(vector());
    return x;
  }
  Points<double> noise(Index n, double deviation) {
    return cloud(n, Vector3<double>::Constant(deviation));
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

template <class Scalar>
Points<Scalar> moved(const Points<Scalar>& x, const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
  return (R * x).colwise() + t;
}

/// The angle between two rotations (rad), accurate for small ones.
double angle(const Matrix3<double>& R, const Matrix3<double>& Q) {
  return 2 * std::asin(std::min(1.0, (R - Q).norm() / std::sqrt(8.0)));
}

/// A rotation, as matrix and as quaternion.
template <class Scalar>
bool is_rotation(const HornResult<Scalar>& r) {
  const Matrix3<double> R = r.R.template cast<double>();
  const double tolerance = sizeof(Scalar) == sizeof(double) ? 1e-14 : 2e-6;
  return (R.transpose() * R - Matrix3<double>::Identity()).norm() < tolerance &&
         std::abs(R.determinant() - 1) < tolerance &&
         (r.rotation.template cast<double>().toRotationMatrix() - R).norm() < tolerance &&
         std::abs(double(r.rotation.norm()) - 1) < tolerance;
}

double rms(const Points<double>& a, const Points<double>& b, const VectorX<double>& w,
           const Matrix3<double>& R, const Vector3<double>& t) {
  double sum = 0, total = 0;
  for (Index j = 0; j < a.cols(); ++j) {
    const double weight = w.size() == 0 ? 1 : w[j];
    sum += weight * (b.col(j) - R * a.col(j) - t).squaredNorm();
    total += weight;
  }
  return std::sqrt(sum / total);
}

/// An independent answer by Eigen's SVD. The sign of the last column is changed to avoid a
/// reflection.
struct Oracle {
  Matrix3<double> S = Matrix3<double>::Zero(), R;
  Vector3<double> t, centre_a = Vector3<double>::Zero(), centre_b = Vector3<double>::Zero();
  double total = 0;

  Oracle(const Points<double>& a, const Points<double>& b, const VectorX<double>& w) {
    const auto weight = [&w](Index j) { return w.size() == 0 ? 1.0 : w[j]; };
    for (Index j = 0; j < a.cols(); ++j) {
      total += weight(j);
      centre_a += weight(j) * a.col(j);
      centre_b += weight(j) * b.col(j);
    }
    centre_a /= total;
    centre_b /= total;
    for (Index j = 0; j < a.cols(); ++j)
      S += weight(j) * (a.col(j) - centre_a) * (b.col(j) - centre_b).transpose();
    const Eigen::JacobiSVD<Matrix3<double>> svd(S, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Matrix3<double> turn = svd.matrixU();
    if ((svd.matrixV() * turn.transpose()).determinant() < 0) turn.col(2) = -turn.col(2);
    R = svd.matrixV() * turn.transpose();
    t = centre_b - R * centre_a;
  }
  /// The eigenvalues of Horn's 4×4 matrix, smallest first.
  Eigen::Vector4d eigenvalues() const {
    Eigen::Matrix4d N;
    const Vector3<double> z(S(1, 2) - S(2, 1), S(2, 0) - S(0, 2), S(0, 1) - S(1, 0));
    N << S.trace(), z.transpose(), z, S + S.transpose() - S.trace() * Matrix3<double>::Identity();
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(N).eigenvalues();
  }
};

/// A pair of sets with a name, in double.
struct Pair {
  std::string name;
  Points<double> a, b;
};

Points<double> cube() {
  Points<double> x(3, 8);
  for (Index j = 0; j < 8; ++j) x.col(j) << (j & 1 ? 1 : -1), (j & 2 ? 1 : -1), (j & 4 ? 1 : -1);
  return x;
}

Points<double> tetrahedron() {
  Points<double> x(3, 4);
  x << 1, 1, -1, -1, 1, -1, 1, -1, 1, -1, -1, 1;
  return x;
}

/// One pair of every kind, moved at random, with noise.
std::vector<Pair> pairs_of_all_kinds(Draw& draw, double noise) {
  std::vector<Pair> pairs;
  const Matrix3<double> R = draw.rotation().toRotationMatrix();
  const Vector3<double> t = draw.vector();
  const auto add = [&](const char* name, const Points<double>& a, const Matrix3<double>& by) {
    const Matrix3<double> motion = R * by;
    pairs.push_back({name, a, moved<double>(a, motion, t) + draw.noise(a.cols(), noise)});
  };
  const Matrix3<double> same = Matrix3<double>::Identity(), mirror = -same;
  const Index n = draw.integer(4, 30);
  const Points<double> ball = draw.noise(n, 1), slab = draw.cloud(n, {1, 0.5, 0.01}),
                       strip = draw.cloud(n, {1, 0.02, 0.001});
  add("ball", ball, same);
  add("slab", slab, same);
  add("strip", strip, same);
  add("three points", draw.noise(3, 1), same);
  add("plane", draw.cloud(n, {1, 0.5, 0}), same);
  add("mirrored plane", draw.cloud(n, {1, 0.5, 0}), mirror);
  add("line", draw.cloud(n, {1, 0, 0}), same);
  add("mirrored line", draw.cloud(n, {1, 0, 0}), mirror);
  add("two points", draw.noise(2, 1), same);
  add("one point", draw.noise(1, 1), same);
  add("one place", draw.vector().replicate(1, n), same);
  add("cube", cube(), same);
  add("mirrored cube", cube(), mirror);
  add("tetrahedron", tetrahedron(), same);
  add("mirrored tetrahedron", tetrahedron(), mirror);
  add("mirrored ball", ball, mirror);
  add("mirrored slab", slab, mirror);
  add("mirrored strip", strip, mirror);
  pairs.push_back({"strangers", draw.noise(n, 1), draw.noise(n, 1)});
  pairs.push_back({"ball to line", draw.noise(n, 1), draw.cloud(n, {1, 0, 0})});
  return pairs;
}

/// NaN and both infinities.
template <class Scalar>
std::vector<Scalar> no_numbers() {
  using Limits = std::numeric_limits<Scalar>;
  return {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity()};
}

}  // namespace

TEMPLATE_TEST_CASE("exact motions of random sets are recovered", "[horn]", float, double) {
  using Scalar = TestType;
  Draw draw(1);
  const int count = clothctl_test::trials(3000, 100000);
  for (int trial = 0; trial < count; ++trial) {
    const double thin =
        std::pow(10.0, draw.uniform(sizeof(Scalar) == sizeof(double) ? -2.5 : -1, 0));
    const Points<Scalar> a = draw.cloud(draw.integer(3, 40), {1, thin, thin * thin}).cast<Scalar>();
    const Eigen::Quaterniond q = draw.rotation();
    const Matrix3<double> R = q.toRotationMatrix();
    const Vector3<double> t = draw.vector();
    const Points<Scalar> b = moved<double>(a.template cast<double>(), R, t).template cast<Scalar>();
    const HornResult<Scalar> r = horn<Scalar>(a, b);
    if (r.status == HornStatus::FreeTurn &&
        r.gap < Scalar(2) * HornSettings<Scalar>().tie_tolerance)
      continue;
    INFO("trial " << trial << ", " << a.cols() << " points, gap " << r.gap);
    REQUIRE(r.status == HornStatus::Unique);
    REQUIRE(is_rotation(r));
    // Rounding of the data rotates R by the data's size divided by the width; rounding of S by the
    // size of S divided by the gap.
    const double off = angle(r.R.template cast<double>(), R), gap = static_cast<double>(r.gap);
    REQUIRE(off <= 30 * eps<Scalar>() / gap);
    REQUIRE((r.t.template cast<double>() - t).norm() <= 60 * eps<Scalar>() / gap);
    REQUIRE(static_cast<double>(r.largest_residual) <= 30 * eps<Scalar>() / std::sqrt(gap));
    REQUIRE(r.rms_residual <= r.largest_residual);
    REQUIRE(r.rotation.w() >= Scalar(0));
    REQUIRE(r.free_turns == 0);
    REQUIRE(r.free_axis.norm() <= Scalar(0));
    REQUIRE(r.message.empty());
  }
}

TEST_CASE("no rotation is better than the answer for sets of every kind", "[horn]") {
  Draw draw(2);
  const int count = clothctl_test::trials(200, 5000);
  HornSettings<double> strict;
  strict.tie_tolerance = 1e-14;
  for (int trial = 0; trial < count; ++trial) {
    const double noise = trial % 3 == 0 ? 0.0 : std::pow(10.0, draw.uniform(-6, 0));
    for (const Pair& pair : pairs_of_all_kinds(draw, noise)) {
      VectorX<double> w(trial % 2 == 0 ? 0 : pair.a.cols());
      for (Index j = 0; j < w.size(); ++j)
        w[j] = draw.integer(0, 3) == 0 && j > 1 ? 0.0 : draw.uniform(0.1, 3);
      const Oracle oracle(pair.a, pair.b, w);
      const double least = rms(pair.a, pair.b, w, oracle.R, oracle.t);
      const Eigen::Quaterniond reference = draw.rotation();
      const HornResult<double> tight = horn<double>(pair.a, pair.b, w, reference, strict);
      const HornResult<double> loose = horn<double>(pair.a, pair.b, w, reference);
      INFO(pair.name << ", trial " << trial << ", noise " << noise << ", " << pair.a.cols()
                     << " points, weights " << w.size());
      REQUIRE(is_rotation(tight));
      REQUIRE(is_rotation(loose));
      REQUIRE(tight.rotation.dot(reference) >= -1e-15);
      // For exact, nearly collinear sets, the rounding of S is visible.
      const double rounding =
          2e-14 + (noise <= 0 && tight.gap > 1e-12 ? 4e-15 / std::sqrt(tight.gap) : 0);
      REQUIRE(rms(pair.a, pair.b, w, tight.R, tight.t) <= (1 + 1e-12) * least + rounding);
      // Where rotations tie, the loss is within the tolerance.
      const Eigen::Vector4d lambda = oracle.eigenvalues();
      const double largest = std::max(lambda[3], -lambda[0]);
      const double given = HornSettings<double>().tie_tolerance * 2 * largest / oracle.total;
      REQUIRE(rms(pair.a, pair.b, w, loose.R, loose.t) <=
              std::sqrt(least * least * (1 + 1e-12) + given) + 2e-14);
      for (const HornResult<double>& r : {tight, loose}) {
        REQUIRE(r.rms_residual ==
                Approx(rms(pair.a, pair.b, w, r.R, r.t)).epsilon(1e-12).margin(4e-15));
        if (r.free_turns == 3) continue;
        REQUIRE(r.gap == Approx((lambda[3] - lambda[2]) / largest).epsilon(1e-10).margin(2e-14));
        REQUIRE(r.rms_width * r.rms_width * oracle.total ==
                Approx((lambda[3] - lambda[2]) / 2).epsilon(1e-10).margin(1e-14 * largest));
        REQUIRE(std::abs((r.R * oracle.S).trace() - lambda[3]) <=
                (1e-13 + (r.free_turns > 0 ? 1e-7 : 0)) * largest);
      }
    }
  }
}

TEST_CASE("rotating the answer increases the residual by the reported curvature", "[horn]") {
  Draw draw(3);
  for (int trial = 0; trial < 300; ++trial) {
    const Points<double> a = draw.cloud(12, {1, 0.3, 0.1});
    const Matrix3<double> R = draw.rotation().toRotationMatrix();
    const Points<double> b = moved<double>(a, R, draw.vector()) + draw.noise(12, 0.05);
    const HornResult<double> r = horn<double>(a, b);
    const Vector3<double> centre_a = a.rowwise().mean(), centre_b = b.rowwise().mean();
    double least_rise = 1e300;
    for (int k = 0; k < 50; ++k) {
      const Matrix3<double> turned =
          Eigen::AngleAxisd(1e-3, draw.direction()).toRotationMatrix() * r.R;
      const double there = rms(a, b, {}, turned, centre_b - turned * centre_a);
      const double rise = (there * there - r.rms_residual * r.rms_residual) / 1e-6;
      least_rise = std::min(least_rise, rise);
    }
    CHECK(least_rise >= r.rms_width * r.rms_width * (1 - 1e-5));
    CHECK(least_rise <= r.rms_width * r.rms_width + 0.5);
  }
}

TEST_CASE("the width of an exact set is its rms distance from its long axis", "[horn]") {
  Points<double> a(3, 4);
  a << 10, 10, -10, -10, 0.1, -0.1, 0.1, -0.1, 0, 0, 0, 0;
  a *= 1e-3;
  for (const double scale : {1.0, 1e3, 1e-5}) {
    const HornResult<double> r = horn<double>(scale * a, scale * a);
    CHECK(r.rms_width == Approx(scale * 1e-4).epsilon(1e-12));
    CHECK(r.gap == Approx(2e-4 / 1.0001).epsilon(1e-12));
    CHECK(r.status == HornStatus::Unique);
    CHECK(r.rotation_error < 1e-12);
  }
  CHECK(horn<double>(cube(), cube()).gap == Approx(4.0 / 3).epsilon(1e-12));
}

TEST_CASE("the expected rotation error agrees with many trials", "[horn]") {
  Draw draw(4);
  for (const bool given : {false, true}) {
    double ratio = 0;
    int inside = 0;
    const int count = clothctl_test::trials(3000, 30000);
    for (int trial = 0; trial < count; ++trial) {
      const Vector3<double> axis = draw.direction();
      const Matrix3<double> frame =
          Eigen::Quaterniond::FromTwoVectors(Vector3<double>::UnitX(), axis).toRotationMatrix();
      Points<double> a(3, 14);
      VectorX<double> w(14);
      for (Index j = 0; j < 14; ++j) {
        a.col(j) = frame * Vector3<double>(0.02 * draw.normal(), 1e-3 * draw.normal(), 0);
        w[j] = draw.uniform(0.2, 2);
      }
      const Vector3<double> centre_a = a * w / w.sum();
      const Matrix3<double> R = draw.rotation().toRotationMatrix();
      Points<double> b = moved<double>(a, R, {1, 2, 3});
      for (Index j = 0; j < 14; ++j) b.col(j) += draw.vector() * (2e-5 / std::sqrt(w[j]));
      const HornResult<double> r =
          given ? horn_about<double>(a, b, centre_a, R * centre_a + Vector3<double>(1, 2, 3), w)
                : horn<double>(a, b, w);
      const Eigen::AngleAxisd off(Matrix3<double>(r.R * R.transpose()));
      const double about = off.angle() * off.axis().dot(R * axis);
      ratio += about * about / (r.rotation_error * r.rotation_error);
      inside += std::abs(about) < r.rotation_error;
    }
    CHECK(ratio / count > 0.95);
    CHECK(ratio / count < 1.2);
    CHECK(double(inside) / count > 0.63);
    CHECK(double(inside) / count < 0.71);
  }
  // If residuals show no noise, the expected error is zero.
  CHECK(horn<double>(draw.noise(2, 1), draw.noise(2, 1)).rotation_error == Approx(kPi));
  CHECK(horn<double>(draw.cloud(9, {1, 0, 0}), draw.cloud(9, {1, 0, 0})).rotation_error ==
        Approx(kPi));
}

TEST_CASE("collinear points get the shortest rotation between their lines", "[horn]") {
  Draw draw(5);
  const int count = clothctl_test::trials(2000, 100000);
  for (int trial = 0; trial < count; ++trial) {
    const Index n = trial % 4 == 0 ? 2 : draw.integer(2, 12);
    const Vector3<double> from = draw.direction(), to = draw.direction();
    const Vector3<double> centre_a = draw.vector(), centre_b = draw.vector();
    const double size = std::pow(10.0, draw.uniform(-2, 2));
    const VectorX<double> s = size * draw.noise(n, 1).row(0).transpose();
    const Points<double> along_a = from * s.transpose(), along_b = to * s.transpose();
    const Points<double> a = along_a.colwise() + size * centre_a,
                         b = along_b.colwise() + size * centre_b;
    const double length =
        (along_a.colwise() - along_a.rowwise().mean()).colwise().norm().maxCoeff() / size;
    if (length < 0.1) continue;
    const bool refer = trial % 2 == 1;
    const Eigen::Quaterniond reference = refer ? draw.rotation() : Eigen::Quaterniond::Identity();
    const Vector3<double> start = reference * from;
    if (start.dot(to) < -0.9)
      continue;  // nearly opposite: rounding decides which rotation is shortest
    const Matrix3<double> shortest =
        Eigen::Quaterniond::FromTwoVectors(start, to).toRotationMatrix() *
        reference.toRotationMatrix();
    const HornResult<double> r = horn<double>(a, b, VectorX<double>(), reference);
    INFO("trial " << trial << ", " << n << " points, length " << length);
    REQUIRE(r.status == HornStatus::FreeTurn);
    REQUIRE(r.free_turns == 1);
    REQUIRE(is_rotation(r));
    REQUIRE((r.R - shortest).norm() < 1e-12);
    REQUIRE(r.free_axis.cross(to).norm() < 1e-12);
    REQUIRE(r.free_axis.norm() == Approx(1).epsilon(1e-12));
    REQUIRE(r.largest_residual < 1e-14 * size * 30);
  }
}

TEST_CASE("opposite lines get a half turn, always the same one", "[horn]") {
  Draw draw(6);
  for (int trial = 0; trial < 200; ++trial) {
    const Points<double> a = draw.direction() * draw.noise(5, 1).row(0);
    const Points<double> b = -a;
    const HornResult<double> r = horn<double>(a, b), again = horn<double>(a, b);
    CHECK(r.status == HornStatus::FreeTurn);
    CHECK(is_rotation(r));
    CHECK(r.largest_residual < 1e-14);
    CHECK(r.R.trace() == Approx(-1).epsilon(1e-12));
    CHECK(r.R == again.R);
  }
}

TEMPLATE_TEST_CASE("coincident points keep the reference", "[horn]", float, double) {
  using Scalar = TestType;
  Draw draw(7);
  const Scalar close = static_cast<Scalar>(8 * eps<Scalar>());
  for (const Index n : {0, 1, 2, 7}) {
    const Vector3<Scalar> from = draw.vector().cast<Scalar>(), to = draw.vector().cast<Scalar>();
    const Points<Scalar> a = from.replicate(1, n), b = to.replicate(1, n),
                         wide = draw.noise(n, 1).cast<Scalar>();
    const Eigen::Quaternion<Scalar> reference = draw.rotation().cast<Scalar>();
    const Eigen::Quaternion<Scalar> longer(
        Eigen::Matrix<Scalar, 4, 1>(reference.coeffs() * Scalar(7)));
    const HornResult<Scalar> plain = horn<Scalar>(a, b);
    CHECK(plain.status == HornStatus::Free);
    CHECK(plain.free_turns == 3);
    CHECK(plain.R == Matrix3<Scalar>::Identity());
    CHECK(
        (plain.t - (n > 0 ? Vector3<Scalar>(to - from) : Vector3<Scalar>(Vector3<Scalar>::Zero())))
            .norm() <= Scalar(0));
    CHECK(plain.rms_residual <= Scalar(0));
    CHECK(plain.gap <= Scalar(0));
    CHECK(plain.rotation_error == Approx(static_cast<Scalar>(kPi)));
    for (const auto& q : {reference, longer}) {
      const HornResult<Scalar> r = horn<Scalar>(a, b, VectorX<Scalar>(), q);
      CHECK(r.status == HornStatus::Free);
      CHECK((r.R - reference.toRotationMatrix()).norm() <= close);
      if (n > 0) CHECK((r.R * from + r.t - to).norm() <= close * Scalar(4));
    }
    // It suffices if one of the sets is coincident,
    CHECK(horn<Scalar>(a, wide).status == HornStatus::Free);
    CHECK(horn<Scalar>(wide, b).status == HornStatus::Free);
    // or if all weights are zero.
    const HornResult<Scalar> weightless =
        horn<Scalar>(wide, wide, VectorX<Scalar>::Constant(n, Scalar(0)), reference);
    CHECK(weightless.status == HornStatus::Free);
    CHECK((weightless.R - reference.toRotationMatrix()).norm() <= close);
    if (n > 0) CHECK(weightless.t.norm() <= Scalar(0));
    CHECK(weightless.largest_residual <= Scalar(0));
  }
}

TEST_CASE("unrelated sets leave all rotations free", "[horn]") {
  // Each corner of a square is mapped to the same corner once and to the opposite one once.
  Points<double> a(3, 8), b(3, 8);
  a << 1, -1, 1, -1, 1, -1, 1, -1, 1, 1, -1, -1, 1, 1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0;
  b << a.leftCols(4), -a.leftCols(4);
  const Matrix3<double> R = Draw(8).rotation().toRotationMatrix();
  const HornResult<double> r = horn<double>(0.3 * R * a, 0.7 * b);
  CHECK(r.status == HornStatus::Free);
  CHECK(r.R == Matrix3<double>::Identity());
}

TEST_CASE("points in a plane have a unique rotation and are not mirrored", "[horn]") {
  Draw draw(9);
  for (int trial = 0; trial < 300; ++trial) {
    const Points<double> a = draw.cloud(draw.integer(3, 9), {1, 0.7, 0});
    const Matrix3<double> R = draw.rotation().toRotationMatrix();
    const HornResult<double> r = horn<double>(a, moved<double>(a, R, {5, 6, 7}));
    if (r.gap < 1e-4) continue;
    CHECK(r.status == HornStatus::Unique);
    CHECK((r.R - R).norm() < 1e-10);
    // A reflection in the origin is a half turn within the plane.
    const HornResult<double> back = horn<double>(a, Points<double>(-a));
    CHECK(back.status == HornStatus::Unique);
    CHECK(back.largest_residual < 1e-11);
    CHECK(back.R.trace() == Approx(-1).epsilon(1e-9));
  }
}

TEST_CASE("mirrored sets are reported and never answered by a reflection", "[horn]") {
  Draw draw(10);
  for (int trial = 0; trial < 500; ++trial) {
    const Matrix3<double> R = draw.rotation().toRotationMatrix();
    Points<double> box = Vector3<double>(3, 2, 1).asDiagonal() * cube();
    const HornResult<double> r = horn<double>(box, Points<double>(-R * box));
    // The thinnest direction is sacrificed: R times the half turn about it.
    CHECK(r.status == HornStatus::Mirrored);
    CHECK(r.free_turns == 0);
    CHECK(is_rotation(r));
    CHECK((r.R - R * Vector3<double>(-1, -1, 1).asDiagonal()).norm() < 1e-12);
    CHECK(r.largest_residual == Approx(2).epsilon(1e-12));

    // With two equally thin directions, one rotation is free.
    const Points<double> beam = Vector3<double>(3, 1, 1).asDiagonal() * cube();
    const Eigen::Quaterniond reference = draw.rotation();
    const HornResult<double> turning =
        horn<double>(beam, Points<double>(-R * beam), VectorX<double>(), reference);
    CHECK(turning.status == HornStatus::Mirrored);
    CHECK(turning.free_turns == 1);
    CHECK(turning.free_axis.cross(R.col(0)).norm() < 1e-12);
    CHECK(is_rotation(turning));
    const Matrix3<double> spun =
        Eigen::AngleAxisd(draw.uniform(-3, 3), turning.free_axis).toRotationMatrix() * turning.R;
    CHECK(rms(beam, -R * beam, {}, spun, {0, 0, 0}) == Approx(turning.rms_residual).epsilon(1e-12));
    CHECK(angle(spun, reference.toRotationMatrix()) >=
          angle(turning.R, reference.toRotationMatrix()) - 1e-12);
  }
}

TEST_CASE("symmetric sets report their free rotations", "[horn]") {
  Draw draw(11);
  for (const Points<double>& set : {cube(), tetrahedron()}) {
    for (int trial = 0; trial < 200; ++trial) {
      const Eigen::Quaterniond q = draw.rotation(), reference = draw.rotation();
      const Matrix3<double> R = q.toRotationMatrix();
      const HornResult<double> r = horn<double>(set, moved<double>(set, R, {1, 1, 1}));
      CHECK(r.status == HornStatus::Unique);
      CHECK((r.R - R).norm() < 1e-13);

      // For sets mirrored in a point, R times any half turn is equally good. The closest one to a
      // reference (w, v) is the half turn about v.
      const HornResult<double> m =
          horn<double>(set, Points<double>(-R * set), VectorX<double>(), q * reference);
      CHECK(m.status == HornStatus::Mirrored);
      CHECK(m.free_turns == 2);
      CHECK(is_rotation(m));
      CHECK(m.free_axis.norm() <= 0);
      const Vector3<double> v = reference.vec().normalized();
      if (reference.vec().norm() < 0.05) continue;
      CHECK((m.R - R * Eigen::AngleAxisd(kPi, v).toRotationMatrix()).norm() < 1e-12);
    }
    // The identity is equally far from all half turns, so any is right.
    const HornResult<double> m = horn<double>(set, Points<double>(-set));
    CHECK(m.free_turns == 2);
    CHECK(is_rotation(m));
    CHECK(m.R.trace() == Approx(-1).epsilon(1e-12));
  }
}

TEST_CASE("a reference that is among the best rotations is returned", "[horn]") {
  Draw draw(12);
  for (int trial = 0; trial < 500; ++trial) {
    const Points<double> a =
        trial % 2 == 0 ? draw.cloud(6, {1, 0, 0}) : Points<double>(draw.noise(2, 1));
    const Eigen::Quaterniond q = draw.rotation();
    const Matrix3<double> R = q.toRotationMatrix();
    const Vector3<double> along = R * (a.col(1) - a.col(0)).normalized();
    const Points<double> b = moved<double>(a, R, draw.vector());
    const Eigen::Quaterniond spun = Eigen::AngleAxisd(draw.uniform(-3, 3), along) * q;
    for (const auto& reference : {q, spun}) {
      const HornResult<double> r = horn<double>(a, b, VectorX<double>(), reference);
      CHECK(r.free_turns == 1);
      CHECK((r.R - reference.toRotationMatrix()).norm() < 1e-11);
      CHECK((r.rotation.coeffs() - reference.coeffs()).norm() < 1e-11);
    }
  }
}

TEST_CASE("with the last answer as reference, a moving line rotates without jumps", "[horn]") {
  Draw draw(13);
  const Points<double> a = draw.cloud(5, {1, 0, 0});
  const Vector3<double> along = (a.col(1) - a.col(0)).normalized();
  Eigen::Quaterniond last = Eigen::Quaterniond::Identity(), true_turn = last;
  for (int frame = 0; frame < 2000; ++frame) {
    const Vector3<double> rate(std::sin(0.01 * frame), std::cos(0.017 * frame), 0.5);
    const Eigen::Quaterniond step(Eigen::AngleAxisd(0.01 * rate.norm(), rate.normalized()));
    true_turn = step * true_turn;
    const Points<double> b = moved<double>(a, true_turn.toRotationMatrix(), {0, 0, 0.001 * frame});
    const HornResult<double> r = horn<double>(a, b, VectorX<double>(), last);
    REQUIRE(r.status == HornStatus::FreeTurn);
    REQUIRE((r.R * along - true_turn * along).norm() < 1e-11);
    REQUIRE(angle(r.R, last.toRotationMatrix()) <= 0.01 * rate.norm() + 1e-11);
    REQUIRE(r.rotation.dot(last) > 0.99);
    last = r.rotation;
  }
}

TEST_CASE("pairs of weight zero have no effect", "[horn]") {
  Draw draw(14);
  for (int trial = 0; trial < 200; ++trial) {
    const Points<double> a = draw.noise(6, 0.1), b = draw.noise(6, 0.1);
    Points<double> more_a(3, 9), more_b(3, 9);
    VectorX<double> w(6), more_w(9);
    for (Index j = 0; j < 6; ++j) w[j] = draw.uniform(0.5, 2);
    const double far = std::pow(10.0, draw.uniform(-3, 30));
    more_a << draw.noise(2, far), a, draw.noise(1, far);
    more_b << draw.noise(2, far), b, draw.noise(1, far);
    more_w << 0, 0, w, 0;
    const HornResult<double> r = horn<double>(a, b, w), more = horn<double>(more_a, more_b, more_w);
    REQUIRE(r.R == more.R);
    REQUIRE(r.t == more.t);
    REQUIRE(r.rms_residual == more.rms_residual);
    REQUIRE(r.largest_residual == more.largest_residual);
    REQUIRE(r.rotation_error == more.rotation_error);
    REQUIRE(r.status == more.status);
  }
}

TEST_CASE("an integer weight equals repeating the pair", "[horn]") {
  Draw draw(15);
  for (int trial = 0; trial < 300; ++trial) {
    const Points<double> a = draw.noise(6, 1);
    const Points<double> b =
        moved<double>(a, draw.rotation().toRotationMatrix(), draw.vector()) + draw.noise(6, 0.2);
    VectorX<double> w(6);
    std::vector<Index> list;
    for (Index j = 0; j < 6; ++j) {
      const int times = draw.integer(1, 4);
      w[j] = times;
      list.insert(list.end(), static_cast<std::size_t>(times), j);
    }
    Points<double> many_a(3, static_cast<Index>(list.size())), many_b = many_a;
    for (Index k = 0; k < many_a.cols(); ++k) {
      many_a.col(k) = a.col(list[static_cast<std::size_t>(k)]);
      many_b.col(k) = b.col(list[static_cast<std::size_t>(k)]);
    }
    const HornResult<double> r = horn<double>(a, b, w), many = horn<double>(many_a, many_b);
    CHECK((r.R - many.R).norm() < 1e-12);
    CHECK((r.t - many.t).norm() < 1e-12);
    CHECK(r.rms_residual == Approx(many.rms_residual).epsilon(1e-12));
    CHECK(r.largest_residual == Approx(many.largest_residual).epsilon(1e-12));
    CHECK(r.gap == Approx(many.gap).epsilon(1e-11));
    CHECK(r.rms_width == Approx(many.rms_width).epsilon(1e-11));
    // Only ratios of weights matter; for powers of two, even the bits are equal.
    for (const double factor : {std::ldexp(1.0, -60), std::ldexp(1.0, 55)}) {
      const HornResult<double> scaled = horn<double>(a, b, factor * w);
      CHECK(scaled.R == r.R);
      CHECK(scaled.t == r.t);
      CHECK(scaled.rms_residual == r.rms_residual);
      CHECK(scaled.rotation_error == r.rotation_error);
    }
    CHECK((horn<double>(a, b, VectorX<double>::Constant(6, 0.3)).R - horn<double>(a, b).R).norm() <
          1e-13);
  }
}

TEMPLATE_TEST_CASE(
    "scaling lengths by powers of two scales results bit for bit, from nanometres to a million "
    "kilometres",
    "[horn]", float, double) {
  using Scalar = TestType;
  Draw draw(16);
  for (int trial = 0; trial < 100; ++trial) {
    const Points<Scalar> a = draw.cloud(7, {1, 0.4, 0.2}).cast<Scalar>();
    const Matrix3<double> R = draw.rotation().toRotationMatrix();
    const Points<Scalar> b = (moved<double>(a.template cast<double>(), R, draw.vector()) +
                              draw.noise(7, trial % 2 == 0 ? 0 : 0.1))
                                 .template cast<Scalar>();
    const HornResult<Scalar> r = horn<Scalar>(a, b);
    for (const int power : {-60, -30, -9, 1, 8, 17, 30, 60}) {
      const Scalar scale = std::ldexp(Scalar(1), power);
      INFO("trial " << trial << ", scale 2^" << power);
      const HornResult<Scalar> scaled = horn<Scalar>(scale * a, scale * b);
      REQUIRE(scaled.status == r.status);
      REQUIRE(scaled.R == r.R);
      REQUIRE(scaled.t == scale * r.t);
      REQUIRE(scaled.rms_residual == scale * r.rms_residual);
      REQUIRE(scaled.largest_residual == scale * r.largest_residual);
      REQUIRE(scaled.rms_width == scale * r.rms_width);
      REQUIRE(scaled.gap == r.gap);
      REQUIRE(scaled.rotation_error == r.rotation_error);
      // Sets of different sizes still have a best rotation.
      REQUIRE(horn<Scalar>(scale * a, b).R == r.R);
    }
  }
}

TEST_CASE("far from the origin only the rounding of the coordinates is lost", "[horn]") {
  Draw draw(17);
  for (int trial = 0; trial < 500; ++trial) {
    const double size = std::pow(10.0, draw.uniform(-3, 0));
    const Points<double> a = draw.cloud(10, size * Vector3<double>(1, 0.5, 0.3));
    const Matrix3<double> R = draw.rotation().toRotationMatrix();
    const Vector3<double> far_a = 1e6 * draw.direction(), far_b = 1e6 * draw.direction();
    const Points<double> b = R * a, there_a = a.colwise() + far_a, there_b = b.colwise() + far_b;
    const HornResult<double> r = horn<double>(there_a, there_b);
    const double rounding = 2e-10;
    CHECK(r.status == HornStatus::Unique);
    CHECK(is_rotation(r));
    CHECK(angle(r.R, R) < 5 * rounding / size);
    CHECK(r.largest_residual < 3 * rounding);
    CHECK((r.R * far_a + r.t - far_b).norm() < 1e-9);
    // Exact offsets (small integers) far away lose nothing.
    Points<double> steps = 4 * tetrahedron();
    steps.col(0) *= 3;
    const Points<double> shifted = steps.colwise() + Vector3<double>(1e15, -1e15, 3e14);
    CHECK((horn<double>(shifted, steps).R - Matrix3<double>::Identity()).norm() < 1e-14);
  }
}

TEST_CASE("differences within the rounding of far coordinates determine no rotation", "[horn]") {
  Draw draw(18);
  HornSettings<double> strict;
  strict.tie_tolerance = 1e-15;
  for (int trial = 0; trial < 300; ++trial) {
    const Vector3<double> far_a = 1e6 * draw.direction(), far_b = 1e6 * draw.direction();
    const auto at = [](const Points<double>& x, const Vector3<double>& where) {
      return Points<double>(x.colwise() + where);
    };
    const double size = 1e-6;
    const Points<double> line = draw.cloud(6, {size, 0, 0}),
                         turned = draw.rotation().toRotationMatrix() * line;
    const HornResult<double> free =
        horn<double>(at(line, far_a), at(turned, far_b), VectorX<double>(),
                     Eigen::Quaterniond::Identity(), strict);
    CHECK(free.status == HornStatus::FreeTurn);
    const Points<double> speck_a = draw.noise(6, 5e-11), speck_b = draw.noise(6, 5e-11);
    CHECK(horn<double>(at(speck_a, far_a), at(speck_b, far_b), VectorX<double>(),
                       Eigen::Quaterniond::Identity(), strict)
              .status == HornStatus::Free);
    // At the origin, equally small sets determine a rotation.
    CHECK(horn<double>(speck_a, speck_a, VectorX<double>(), Eigen::Quaterniond::Identity(), strict)
              .status == HornStatus::Unique);
  }
}

TEMPLATE_TEST_CASE("the tolerance separates thin strips from lines", "[horn]", float, double) {
  using Scalar = TestType;
  const auto strip = [](double width) {
    Points<double> x(3, 4);
    x << 1, 1, -1, -1, width, -width, width, -width, 0, 0, 0, 0;
    return x;
  };
  const Matrix3<double> R = Eigen::AngleAxisd(0.7, Vector3<double>::UnitX()).toRotationMatrix();
  const auto fit = [&](double width, const HornSettings<Scalar>& settings) {
    return horn<Scalar>(strip(width).template cast<Scalar>(),
                        (R * strip(width)).template cast<Scalar>(), VectorX<Scalar>(),
                        Eigen::Quaternion<Scalar>::Identity(), settings);
  };
  HornSettings<Scalar> settings;
  for (const double tolerance : {static_cast<double>(settings.tie_tolerance), 1e-2, 1e-3}) {
    settings.tie_tolerance = static_cast<Scalar>(tolerance);
    const double width = std::sqrt(tolerance / 2);
    const HornResult<Scalar> narrow = fit(0.95 * width, settings),
                             wide = fit(1.05 * width, settings);
    CHECK(narrow.status == HornStatus::FreeTurn);
    CHECK((narrow.R - Matrix3<Scalar>::Identity()).norm() < Scalar(1e-3));
    CHECK(wide.status == HornStatus::Unique);
    CHECK((wide.R - R.cast<Scalar>()).norm() < Scalar(2e-3));
  }
}

TEST_CASE("fits about given centroids agree with fits about computed ones", "[horn]") {
  Draw draw(19);
  for (int trial = 0; trial < 300; ++trial) {
    const Points<double> a = draw.noise(8, 0.1), b = draw.noise(8, 0.1);
    const Vector3<double> centre_a = draw.vector(), centre_b = draw.vector();
    VectorX<double> w(8);
    for (Index j = 0; j < 8; ++j) w[j] = draw.uniform(0.1, 1);
    const HornResult<double> r = horn_about<double>(a, b, centre_a, centre_b, w);
    REQUIRE(is_rotation(r));
    CHECK((r.R * centre_a + r.t - centre_b).norm() < 1e-14 * 10);
    // Each pair and its mirror image have the given centres as centroids.
    Points<double> both_a(3, 16), both_b(3, 16);
    both_a << a, (-a).colwise() + 2 * centre_a;
    both_b << b, (-b).colwise() + 2 * centre_b;
    VectorX<double> both_w(16);
    both_w << w, w;
    const HornResult<double> both = horn<double>(both_a, both_b, both_w);
    CHECK((r.R - both.R).norm() < 1e-9);
    CHECK(r.rms_residual == Approx(both.rms_residual).epsilon(1e-12));
    CHECK(r.gap == Approx(both.gap).epsilon(1e-9).margin(1e-13));
    CHECK(r.status == both.status);
    // With the sets' own centroids, the result equals horn.
    const Vector3<double> own_a = a * w / w.sum(), own_b = b * w / w.sum();
    const HornResult<double> own = horn_about<double>(a, b, own_a, own_b, w),
                             free = horn<double>(a, b, w);
    CHECK((own.R - free.R).norm() < 1e-10);
    CHECK((own.t - free.t).norm() < 1e-10);
    CHECK(own.rotation_error == Approx(free.rotation_error * std::sqrt(18.0 / 21.0)).epsilon(1e-9));
    // One point and its centroid form a line.
    const HornResult<double> one =
        horn_about<double>(a.leftCols(1), b.leftCols(1), centre_a, centre_b);
    CHECK(one.status == HornStatus::FreeTurn);
    CHECK((one.R * (a.col(0) - centre_a).normalized() - (b.col(0) - centre_b).normalized()).norm() <
          1e-13);
    // No points: the reference about the centroids.
    const HornResult<double> none =
        horn_about<double>(Points<double>(3, 0), Points<double>(3, 0), centre_a, centre_b);
    CHECK(none.status == HornStatus::Free);
    CHECK(none.t == centre_b - centre_a);
  }
}

TEMPLATE_TEST_CASE("bad input is refused with a message", "[horn]", float, double) {
  using Scalar = TestType;
  Draw draw(20);
  const Points<Scalar> a = draw.noise(5, 1).cast<Scalar>(), b = draw.noise(5, 1).cast<Scalar>();
  const VectorX<Scalar> ones = VectorX<Scalar>::Constant(5, Scalar(1));
  const Eigen::Quaternion<Scalar> reference = draw.rotation().cast<Scalar>();
  const HornSettings<Scalar> settings;
  const auto refused = [&](const HornResult<Scalar>& r, const std::string& part,
                           bool has_reference = true) {
    const Matrix3<Scalar> R =
        has_reference ? reference.toRotationMatrix() : Matrix3<Scalar>(Matrix3<Scalar>::Identity());
    INFO("message: " << std::string(r.message));
    CHECK(r.status == HornStatus::InvalidInput);
    CHECK(std::string(r.message).find(part) != std::string::npos);
    CHECK((r.R - R).norm() <= Scalar(4) * std::numeric_limits<Scalar>::epsilon());
    CHECK(r.t == Vector3<Scalar>::Zero());
    CHECK(r.free_turns == 3);
    CHECK(r.rotation_error > Scalar(3));
    CHECK(r.rms_residual == Scalar(0));
  };
  std::vector<Scalar> bad = no_numbers<Scalar>();
  bad.push_back(Scalar(1e25));
  bad.push_back(Scalar(-2e20));
  for (const Scalar& value : bad) {
    for (Index k = 0; k < 15; ++k) {
      Points<Scalar> worse = a;
      worse(k % 3, k / 3) = value;
      refused(horn<Scalar>(worse, b, ones, reference), "a ");
      refused(horn<Scalar>(b, worse, VectorX<Scalar>(), reference), "b ");
    }
    for (Index k = 0; k < 5; ++k) {
      VectorX<Scalar> w = ones;
      w[k] = value;
      refused(horn<Scalar>(a, b, w, reference), "weights ");
    }
    for (Index k = 0; k < 3; ++k) {
      Vector3<Scalar> centre = a.col(0);
      centre[k] = value;
      refused(horn_about<Scalar>(a, b, centre, b.col(0), ones, reference), "centroid ");
      refused(horn_about<Scalar>(a, b, b.col(0), centre, ones, reference), "centroid ");
    }
  }
  for (const Scalar& value : no_numbers<Scalar>()) {
    for (int k = 0; k < 4; ++k) {
      Eigen::Quaternion<Scalar> worse = reference;
      worse.coeffs()[k] = value;
      refused(horn<Scalar>(a, b, ones, worse), "reference ", false);
    }
    // Even with weight zero, NaN is refused.
    VectorX<Scalar> w = ones;
    w[2] = Scalar(0);
    Points<Scalar> worse = a;
    worse(1, 2) = value;
    refused(horn<Scalar>(worse, b, w, reference), "a ");
    HornSettings<Scalar> broken;
    broken.tie_tolerance = value;
    refused(horn<Scalar>(a, b, ones, reference, broken), "tie_tolerance ");
  }
  const Eigen::Quaternion<Scalar> zero(Scalar(0), Scalar(0), Scalar(0), Scalar(0));
  refused(horn<Scalar>(a, b, ones, zero), "reference ", false);
  VectorX<Scalar> negative = ones;
  negative[3] = Scalar(-1e-30);
  refused(horn<Scalar>(a, b, negative, reference), "negative");
  refused(horn<Scalar>(a, b.leftCols(4), ones, reference), "number of points");
  refused(horn<Scalar>(a, b, ones.head(4), reference), "weights ");
  refused(horn<Scalar>(Points<Scalar>(3, 0), Points<Scalar>(3, 0), ones, reference), "weights ");
  for (const double tolerance : {0.0, -1e-3, 1.0, 5.0}) {
    HornSettings<Scalar> broken;
    broken.tie_tolerance = static_cast<Scalar>(tolerance);
    CHECK(!broken.validate().empty());
    refused(horn<Scalar>(a, b, ones, reference, broken), "tie_tolerance ");
  }
  CHECK(settings.validate().empty());
  CHECK(horn<Scalar>(a, b, ones, reference, settings).status != HornStatus::InvalidInput);
}

TEMPLATE_TEST_CASE("fits do not allocate and repeat bit for bit", "[horn]", float, double) {
  using Scalar = TestType;
  Draw draw(21);
  std::vector<std::pair<Points<Scalar>, Points<Scalar>>> sets;
  for (const Pair& pair : pairs_of_all_kinds(draw, 1e-3))
    sets.emplace_back(pair.a.cast<Scalar>(), pair.b.cast<Scalar>());
  for (const Pair& pair : pairs_of_all_kinds(draw, 0))
    sets.emplace_back(pair.a.cast<Scalar>(), pair.b.cast<Scalar>());
  const VectorX<Scalar> many = VectorX<Scalar>::Constant(40, Scalar(0.5));
  const Eigen::Quaternion<Scalar> reference = draw.rotation().cast<Scalar>();
  for (const auto& set : sets) {
    const Index n = set.first.cols();
    const long before = clothctl_test::allocations();
    const HornResult<Scalar> r = horn<Scalar>(set.first, set.second);
    const HornResult<Scalar> again = horn<Scalar>(set.first, set.second);
    const HornResult<Scalar> weighted =
        horn<Scalar>(set.first, set.second, many.head(n), reference);
    const HornResult<Scalar> about =
        horn_about<Scalar>(set.first, set.second, r.t, r.t, many.head(n), reference);
    const HornResult<Scalar> wrong = horn<Scalar>(set.first, set.second, many, reference);
    const long after = clothctl_test::allocations();
    if (clothctl_test::allocation_counting_works()) CHECK(after == before);
    CHECK(std::memcmp(r.R.data(), again.R.data(), sizeof(Scalar) * 9) == 0);
    CHECK(std::memcmp(r.t.data(), again.t.data(), sizeof(Scalar) * 3) == 0);
    CHECK(std::memcmp(&r.rms_residual, &again.rms_residual, sizeof(Scalar)) == 0);
    CHECK(is_rotation(r));
    CHECK(is_rotation(weighted));
    CHECK(is_rotation(about));
    CHECK(wrong.status == HornStatus::InvalidInput);
  }
}

TEST_CASE("columns of a larger matrix are read in place", "[horn]") {
  Draw draw(22);
  Points<double> store = draw.noise(20, 1);
  const Points<double> a = store.middleCols(3, 6);
  const HornResult<double> r = horn<double>(store.middleCols(3, 6), store.middleCols(9, 6));
  CHECK(r.R == horn<double>(a, Points<double>(store.middleCols(9, 6))).R);
}

TEST_CASE("statuses of fits have names", "[horn]") {
  CHECK(to_string(HornStatus::Unique) == "unique");
  CHECK(to_string(HornStatus::FreeTurn) == "free_turn");
  CHECK(to_string(HornStatus::Free) == "free");
  CHECK(to_string(HornStatus::Mirrored) == "mirrored");
  CHECK(to_string(HornStatus::InvalidInput) == "invalid_input");
}
