#include "clothctl/cloth/detail/rigid_motion.hpp"

#include <vector>

#include <Eigen/Geometry>

#include "clothctl/core/simd.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;

namespace {

/// Masses with positions and displacements.
struct Cloud {
  VectorX<double> mass;
  Points<double> at, moved;

  Cloud(int count, unsigned seed) {
    Numbers random(seed);
    mass.setZero(count);
    at.setZero(3, count);
    moved.setZero(3, count);
    for (Index i = 0; i < count; ++i) {
      mass[i] = random(0.5, 2.0);
      for (Index c = 0; c < 3; ++c) {
        at(c, i) = random(-1, 1) + 3.0;
        moved(c, i) = random(-0.1, 0.1);
      }
    }
  }
  Vector3<double> centre() const { return at * mass / mass.sum(); }
  Vector3<double> mean() const { return moved * mass / mass.sum(); }
  /// Σ m (x - c) × d.
  Vector3<double> spin() const {
    Vector3<double> sum = Vector3<double>::Zero();
    for (Index i = 0; i < at.cols(); ++i)
      sum += mass[i] * Vector3<double>(at.col(i) - centre()).cross(Vector3<double>(moved.col(i)));
    return sum;
  }
};

template <class Scalar>
struct Place {
  Scalar x, y, z;
};

/// ω of a cloud by the header's sums.
template <class Scalar>
Vector3<Scalar> turn_of(const Cloud& cloud) {
  const Vector3<double> c = cloud.centre();
  SecondMoments<Scalar> sums(Scalar(0));
  for (Index i = 0; i < cloud.at.cols(); ++i) {
    const Vector3<double> r = cloud.at.col(i) - c;
    sums.add(Scalar(cloud.mass[i]), Scalar(r[0]), Scalar(r[1]), Scalar(r[2]),
             Place<Scalar>{Scalar(cloud.moved(0, i)), Scalar(cloud.moved(1, i)),
                           Scalar(cloud.moved(2, i))});
  }
  return angular_displacement<Scalar>(sums);
}

}  // namespace

TEST_CASE("rigid motion: first moments are sums", "[rigid_motion]") {
  const Cloud cloud(30, 1);
  FirstMoments<double> sums(0.0);
  for (Index i = 0; i < 30; ++i)
    sums.add(cloud.mass[i], Place<double>{cloud.at(0, i), cloud.at(1, i), cloud.at(2, i)},
             Place<double>{cloud.moved(0, i), cloud.moved(1, i), cloud.moved(2, i)});
  const Vector3<double> x = cloud.at * cloud.mass, p = cloud.moved * cloud.mass;
  CHECK(sums.mass == Approx(cloud.mass.sum()));
  CHECK((Vector3<double>(sums.x, sums.y, sums.z) - x).norm() < 1e-12);
  CHECK((Vector3<double>(sums.px, sums.py, sums.pz) - p).norm() < 1e-12);
}

TEMPLATE_TEST_CASE("rigid motion: the turn of a rigid displacement is found", "[rigid_motion]",
                   float, double, long double) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Cloud cloud(20, seed);
    Numbers random(seed + 100);
    const Vector3<double> turn(random(-1, 1), random(-1, 1), random(-1, 1)), shift(0.3, -2.0, 0.1);
    if (seed % 2 == 1) cloud.at.row(1).setConstant(0.5);  // a flat sheet
    const Vector3<double> c = cloud.centre();
    for (Index i = 0; i < 20; ++i)
      cloud.moved.col(i) = shift + turn.cross(Vector3<double>(cloud.at.col(i) - c));
    const Vector3<double> found = turn_of<TestType>(cloud).template cast<double>();
    CHECK((found - turn).norm() < (std::is_same_v<TestType, float> ? 2e-5 : 1e-13));
  }
}

TEST_CASE("rigid motion: without it, no momentum is left, linear or angular", "[rigid_motion]") {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Cloud cloud(25, seed);
    if (seed % 2 == 1) cloud.at.row(2).setConstant(1.0);
    const Vector3<double> turn = turn_of<double>(cloud), c = cloud.centre(), u = cloud.mean();
    CHECK(cloud.spin().norm() > 1e-3);
    for (Index i = 0; i < 25; ++i)
      cloud.moved.col(i) -= u + turn.cross(Vector3<double>(cloud.at.col(i) - c));
    CHECK((cloud.moved * cloud.mass).norm() < 1e-13);
    CHECK(cloud.spin().norm() < 1e-13);
  }
}

TEST_CASE("rigid motion: packs give the sums of their lanes", "[rigid_motion]") {
  using Pack = Simd<double, 8>;
  const Cloud cloud(24, 5);
  const Vector3<double> c = cloud.centre();
  SecondMoments<Pack> packs(Pack::all(0.0));
  SecondMoments<double> plain(0.0);
  for (Index i = 0; i < 24; i += 8) {
    double m[8], r[3][8], d[3][8];
    for (Index k = 0; k < 8; ++k) {
      m[k] = cloud.mass[i + k];
      for (Index a = 0; a < 3; ++a) {
        r[a][k] = cloud.at(a, i + k) - c[a];
        d[a][k] = cloud.moved(a, i + k);
      }
      plain.add(m[k], r[0][k], r[1][k], r[2][k], Place<double>{d[0][k], d[1][k], d[2][k]});
    }
    packs.add(Pack::load(m), Pack::load(r[0]), Pack::load(r[1]), Pack::load(r[2]),
              Place<Pack>{Pack::load(d[0]), Pack::load(d[1]), Pack::load(d[2])});
  }
  const Vector3<double> a = angular_displacement<double>(packs),
                        b = angular_displacement<double>(plain);
  CHECK((a - b).norm() < 1e-13 * b.norm());
  CHECK(total_of(packs.xy) == Approx(plain.xy));
  CHECK(total_of(plain.yz) == plain.yz);
}

TEST_CASE("rigid motion: points on a line or in one place give a finite turn", "[rigid_motion]") {
  Cloud line(12, 7);
  const Vector3<double> axis = Vector3<double>(1, 2, -1).normalized();
  for (Index i = 0; i < 12; ++i) line.at.col(i) = 0.1 * static_cast<double>(i) * axis;
  const Vector3<double> c = line.centre();
  const Vector3<double> turn(0.4, -0.1, 0.2);
  for (Index i = 0; i < 12; ++i)
    line.moved.col(i) = turn.cross(Vector3<double>(line.at.col(i) - c));
  const Vector3<double> found = turn_of<double>(line), across = turn - axis * axis.dot(turn);
  // The turn about the line itself cannot be seen; rounding errors take its place.
  CHECK((found - across).norm() < 0.1 * across.norm());
  Cloud heap(5, 8);
  heap.at.setConstant(2.0);
  CHECK(turn_of<double>(heap).norm() < 1e10);
  CHECK(all_finite(turn_of<double>(heap)));
  SecondMoments<double> nothing(0.0);
  CHECK(angular_displacement<double>(nothing).isZero(0.0));
}
