// The basic shapes: the laws, analytic distances against dense samples of the surface, degenerate
// places (centre, axis, faces, corners), sweeps of needles, and what is refused.

#include "clothctl/collision/shapes.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/math/rotation.hpp"
#include "laws/collider_laws.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::exact_laws;
using clothctl_test::law_detail::one_closest;
using clothctl_test::law_detail::one_distance;

static_assert(Collider<PlaneCollider<float>, float> && Collider<PlaneCollider<double>>);
static_assert(Collider<SphereCollider<float>, float> && !Collider<SphereCollider<float>, double>);
static_assert(Collider<BoxCollider<double>> && Collider<CylinderCollider<double>> &&
              Collider<CapsuleCollider<double>>);

namespace {

template <class S>
Vector3<S> vec(double x, double y, double z) {
  return Vector3<S>(S(x), S(y), S(z));
}

template <class S>
Matrix3<S> tilted() {
  return rotation_exp<S>(vec<S>(0.4, -0.7, 0.9));
}

/// The distance from `x` to the nearest of many points of a surface, made by `surface(u, v, w)`
/// from three random numbers of [0, 1).
template <class Surface>
double sampled_distance(const Vector3<double>& x, const Surface& surface, int samples) {
  std::mt19937 random(21);
  double best = 1e9;
  for (int i = 0; i < samples; ++i) {
    double u[3];
    for (double& value : u) value = static_cast<double>(random()) / 4294967296.0;
    best = std::min(best, (x - surface(u[0], u[1], u[2])).norm());
  }
  return best;
}

/// Checks unsigned distances of random points against the samples. The nearest sample is farther
/// than the surface, by less than `slack`.
template <class C, class Surface>
void check_samples(const C& collider, const Surface& surface, double slack) {
  std::mt19937 random(22);
  for (int i = 0; i < 12; ++i) {
    Vector3<double> x;
    for (int c = 0; c < 3; ++c) x[c] = 2.0 * static_cast<double>(random()) / 4294967296.0 - 1.0;
    const double sampled = sampled_distance(x, surface, 20000);
    const double d = std::abs(one_distance<double>(collider, x));
    CHECK(d <= sampled + 1e-12);
    CHECK(sampled <= d + slack);
  }
}

}  // namespace

TEMPLATE_TEST_CASE("every basic shape obeys the laws", "[contact]", float, double) {
  using S = TestType;
  const auto laws = exact_laws<S>(S(1));
  const Matrix3<S> R = tilted<S>();
  check_collider_laws<S>(*PlaneCollider<S>::create(vec<S>(0.1, 0, 0.2), vec<S>(1, 2, -3)), laws);
  check_collider_laws<S>(*SphereCollider<S>::create(vec<S>(0.1, -0.2, 0), S(0.5)), laws);
  check_collider_laws<S>(
      *CapsuleCollider<S>::create(vec<S>(-0.3, 0.2, 0), vec<S>(0.4, 0, 0.5), S(0.2)), laws);
  check_collider_laws<S>(*CapsuleCollider<S>::create(vec<S>(0, 0, 0), vec<S>(0, 0, 0), S(0.3)),
                         laws);
  check_collider_laws<S>(*BoxCollider<S>::create(vec<S>(0.1, 0, 0), vec<S>(0.5, 0.3, 0.2), R),
                         laws);
  check_collider_laws<S>(*BoxCollider<S>::create(vec<S>(0, 0, 0), vec<S>(0.6, 0.6, 0.0005)), [&] {
    auto thin = laws;
    thin.difference = S(1e-4);
    return thin;
  }());
  check_collider_laws<S>(
      *CylinderCollider<S>::create(vec<S>(-0.2, 0.2, -0.4), vec<S>(0.4, 0, 0.5), S(0.3)), laws);
}

TEST_CASE("distances of the basic shapes agree with samples of their surfaces", "[contact]") {
  using V = Vector3<double>;
  const double pi = std::acos(-1.0);
  const Matrix3<double> R = tilted<double>();
  const V c(0.1, 0.05, -0.1);
  const auto direction = [&](double u, double v) {
    const double z = 2 * u - 1, s = std::sqrt(1 - z * z);
    return V(s * std::cos(2 * pi * v), s * std::sin(2 * pi * v), z);
  };
  check_samples(
      *SphereCollider<double>::create(c, 0.4),
      [&](double u, double v, double) { return V(c + 0.4 * direction(u, v)); }, 0.03);
  check_samples(
      *BoxCollider<double>::create(c, V(0.5, 0.3, 0.2), R),
      [&](double u, double v, double w) {
        const int face = static_cast<int>(6 * w);
        V y(2 * u - 1, 2 * v - 1, 2 * (6 * w - face) - 1);
        y[face % 3] = face < 3 ? -1 : 1;
        return V(c + R * y.cwiseProduct(V(0.5, 0.3, 0.2)));
      },
      0.05);
  const V a(-0.3, 0.2, 0), b(0.4, 0, 0.5), axis = (b - a).normalized();
  const V side = axis.unitOrthogonal(), other = axis.cross(side);
  check_samples(
      *CylinderCollider<double>::create(a, b, 0.25),
      [&](double u, double v, double w) {
        const V around = std::cos(2 * pi * v) * side + std::sin(2 * pi * v) * other;
        if (w < 0.6) return V(a + u * (b - a) + 0.25 * around);
        return V((w < 0.8 ? a : b) + 0.25 * std::sqrt(u) * around);
      },
      0.05);
  check_samples(
      *CapsuleCollider<double>::create(a, b, 0.25),
      [&](double u, double v, double w) {
        const V around = std::cos(2 * pi * v) * side + std::sin(2 * pi * v) * other;
        if (w < 0.6) return V(a + u * (b - a) + 0.25 * around);
        const V out = direction(u, v);
        return V((out.dot(axis) < 0 ? a : b) + 0.25 * out);
      },
      0.05);
}

TEMPLATE_TEST_CASE("places where the closest point is not unique have one answer", "[contact]",
                   float, double) {
  using S = TestType;
  const S tolerance = S(4) * std::numeric_limits<S>::epsilon();
  const auto sphere = SphereCollider<S>::create(vec<S>(0, 0, 0), S(1)).value();
  CHECK(one_closest<S>(sphere, vec<S>(0, 0, 0)).distance == S(-1));
  const auto capsule =
      CapsuleCollider<S>::create(vec<S>(0, 0, 0), vec<S>(1, 0, 0), S(0.25)).value();
  const auto on_axis = one_closest<S>(capsule, vec<S>(0.5, 0, 0));
  CHECK(on_axis.distance == S(-0.25));
  CHECK(std::abs(on_axis.normal.norm() - S(1)) <= tolerance);
  CHECK(on_axis.normal[0] == S(0));
  const auto cylinder =
      CylinderCollider<S>::create(vec<S>(0, 0, 0), vec<S>(0, 0, 2), S(0.25)).value();
  const auto inside = one_closest<S>(cylinder, vec<S>(0, 0, 1));
  CHECK(inside.distance == S(-0.25));
  CHECK(inside.normal[2] == S(0));
  const auto box = BoxCollider<S>::create(vec<S>(0, 0, 0), vec<S>(1, 1, 1)).value();
  CHECK(one_closest<S>(box, vec<S>(0, 0, 0)).distance == S(-1));
  for (const auto& x : {vec<S>(1, 0, 0), vec<S>(1, 1, 0.5), vec<S>(-1, 1, -1)}) {
    const auto at = one_closest<S>(box, x);  // on a face, an edge, a corner
    CHECK(at.distance == S(0));
    CHECK(at.normal.norm() == S(1));
    CHECK(at.point == x);
  }
}

TEST_CASE("a fast ball does not pass a needle or a thin plate", "[contact]") {
  using V = Vector3<double>;
  const auto needle = CapsuleCollider<double>::create(V(-1, 0, 0), V(1, 0, 0), 1e-6).value();
  const auto plate = BoxCollider<double>::create(V(0, 0, 0), V(0.5, 0.5, 1e-6)).value();
  std::mt19937 random(23);
  const auto uniform = [&](double a, double b) {
    return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
  };
  int missed = 0;
  for (int i = 0; i < 1000; ++i) {
    // A path through a point of the needle's axis, and one through the plate.
    const V direction(uniform(-1, 1), uniform(-1, 1), uniform(0.1, 1));
    const V through(uniform(-0.4, 0.4), 0, 0);
    Points<double> from(3, 1), to(3, 1);
    from.col(0) = through - uniform(0.2, 5) * direction;
    to.col(0) = through + uniform(0.2, 5) * direction;
    VectorX<double> t(1);
    CHECK(needle.sweep(from, to, 0, 0, t) == QueryStatus::Answered);
    if (t[0] > 1) ++missed;
    CHECK(plate.sweep(from, to, 0, 0, t) == QueryStatus::Answered);
    if (t[0] > 1) ++missed;
  }
  CHECK(missed == 0);
}

TEST_CASE("a sweep hits at the analytic time", "[contact]") {
  using V = Vector3<double>;
  const auto sphere = SphereCollider<double>::create(V(0, 0, 0), 0.5).value();
  Points<double> from(3, 4), to(3, 4);
  from << -2, 0, 0, -2,  //
      0, 0.2, 0, 0.6,    //
      0, 0, 3, 0;        //
  to << 2, 0, 0, 2,      //
      0, 5, 0, 0.6,      //
      0, 0, 0.61, 0;     //
  VectorX<double> t(4);
  CHECK(sphere.sweep(from, to, 0.1, 0, t) == QueryStatus::Answered);
  CHECK(std::abs(t[0] - 1.4 / 4) <= 1e-14);
  CHECK(t[1] == 0.0);  // starts inside, and leaves
  CHECK(t[2] == no_impact<double>());
  CHECK(std::abs(t[3] - 0.5) <= 1e-7);  // grazes: the gap is quadratic in time
}

TEMPLATE_TEST_CASE("shapes and points of absurd sizes have sound answers", "[contact]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(24);
  const auto uniform = [&](double a, double b) {
    return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
  };
  const auto size = [&] { return S(std::pow(10.0, uniform(-8, 8))); };
  const auto point = [&] {
    const S scale = size();
    return Vector3<S>(scale * S(uniform(-1, 1)), scale * S(uniform(-1, 1)),
                      scale * S(uniform(-1, 1)));
  };
  int bad = 0;
  const auto check = [&](const auto& made, const char* what) {
    REQUIRE(made);
    for (int i = 0; i < 20; ++i) {
      const Points<S> a = point(), b = i % 4 == 0 ? a : Points<S>(point());
      std::vector<SurfacePoint<S>> s(1);
      VectorX<S> t(1);
      CHECK(made->closest(a, s) == QueryStatus::Answered);
      CHECK(made->sweep(a, b, size(), S(0), t) == QueryStatus::Answered);
      const bool sound = is_finite(s[0].distance) && all_finite(s[0].point) &&
                         std::abs(s[0].normal.norm() - S(1)) <= S(1e-5) &&
                         (t[0] == no_impact<S>() || (S(0) <= t[0] && t[0] <= S(1)));
      CAPTURE(what, a, s[0].distance, t[0]);
      CHECK(sound);
      bad += !sound;
    }
  };
  for (int trial = 0; trial < clothctl_test::trials(100, 10000, 20) && bad < 5; ++trial) {
    const Matrix3<S> R = rotation_exp<S>(vec<S>(uniform(-3, 3), uniform(-3, 3), uniform(-3, 3)));
    check(PlaneCollider<S>::create(point(), point()), "plane");
    check(SphereCollider<S>::create(point(), size()), "sphere");
    check(CapsuleCollider<S>::create(point(), point(), size()), "capsule");
    check(BoxCollider<S>::create(point(), Vector3<S>(size(), size(), size()), R), "box");
    check(CylinderCollider<S>::create(point(), point(), size()), "cylinder");
  }
}

TEMPLATE_TEST_CASE("points at any distance from a shape have sound answers", "[contact]", float,
                   double) {
  using S = TestType;
  using V = Vector3<S>;
  using Limits = std::numeric_limits<S>;
  std::mt19937 random(25);
  const auto uniform = [&](double a, double b) {
    return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
  };
  const auto check = [&](const auto& shape) {
    double not_unit = 0, off = 0;
    int missed = 0, not_finite = 0;
    for (int i = 0; i < 400; ++i) {
      // The squares of most of these lengths are beyond the range of the scalar.
      const double size =
          std::pow(10.0, uniform(Limits::min_exponent10 - 5, Limits::max_exponent10 - 1));
      V x;
      for (int k = 0; k < 3; ++k) x[k] = S(uniform(-1, 1) * size);
      const auto s = one_closest<S>(shape, x);
      not_finite += !is_finite(s.distance) || !all_finite(s.point);
      not_unit = std::max(not_unit, std::abs(static_cast<double>(s.normal.norm()) - 1));
      // All shapes lie between the spheres of radius 1 and 2.
      const double length = static_cast<double>(x.template cast<long double>().stableNorm());
      const double d = static_cast<double>(s.distance), slack = 1e-6 * (1 + length);
      off = std::max({off, d - (length - 1) - slack, length - 2 - d - slack});
      const Points<S> from = x, to = -x;
      VectorX<S> t(1);
      CHECK(shape.sweep(from, to, S(0), S(0), t) == QueryStatus::Answered);
      missed += !(t[0] <= S(0.500001));
    }
    CHECK(not_finite == 0);
    CHECK(not_unit <= 4 * static_cast<double>(Limits::epsilon()));
    CHECK(off <= 0);
    CHECK(missed == 0);
  };
  check(*SphereCollider<S>::create(V::Zero(), S(1)));
  check(*BoxCollider<S>::create(V::Zero(), V::Ones(), tilted<S>()));
  check(*CylinderCollider<S>::create(vec<S>(0, 0, -1), vec<S>(0, 0, 1), S(1)));
  // Segments whose squared length is beyond the range, too, or rounds.
  for (const double length : {0.0, 1e-44, 1e-42, 1e-30, 1e-22, 1e-20, 1e-10, 0.9})
    check(*CapsuleCollider<S>::create(V::Zero(), vec<S>(length, 0, 0), S(1)));
  const auto along = CapsuleCollider<S>::create(V::Zero(), vec<S>(1e20, 0, 0), S(1)).value();
  CHECK(one_distance<S>(along, vec<S>(5e19, 3, 0)) == S(2));
  for (const double length : {1e-22, 1e20}) {
    const auto plane = PlaneCollider<S>::create(V::Zero(), vec<S>(0, 0, length)).value();
    CHECK(one_distance<S>(plane, vec<S>(1, 2, 3)) == S(3));
  }
}

TEMPLATE_TEST_CASE("the box of a cylinder nearly along an axis holds it", "[contact]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(26);
  double out = 0;
  for (int i = 0; i < 500; ++i) {
    const auto uniform = [&](double a, double b) {
      return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
    };
    const double off = std::pow(10.0, uniform(-9, 0));
    Vector3<S> end = vec<S>(off * uniform(-1, 1), off * uniform(-1, 1), 1);
    std::swap(end[2], end[i % 3]);
    const auto cylinder = CylinderCollider<S>::create(vec<S>(0, 0, 0), end, S(1)).value();
    const BoundingBox<S> box = cylinder.bounds(S(0));
    const Vector3<double> axis = end.template cast<double>().normalized();
    for (int k = 0; k < 3; ++k) {
      // The rim of the end reaches this far beyond its centre.
      const double reach = std::hypot(axis[(k + 1) % 3], axis[(k + 2) % 3]);
      const double top = std::max(0.0, static_cast<double>(end[k])) + reach;
      const double bottom = std::min(0.0, static_cast<double>(end[k])) - reach;
      out = std::max({out, top - static_cast<double>(box.upper[k]),
                      static_cast<double>(box.lower[k]) - bottom});
    }
  }
  CHECK(out <= 4 * static_cast<double>(std::numeric_limits<S>::epsilon()));
}

TEST_CASE("what makes no shape is refused by name and value", "[contact]") {
  using V = Vector3<double>;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const V o(0, 0, 0), z(0, 0, 1);
  CHECK(PlaneCollider<double>::create(o, o).error() ==
        "the plane has the normal of length 0 m, must be finite and positive");
  CHECK(PlaneCollider<double>::create(V(0, nan, 0), z).error() ==
        "the plane has the point with the coordinate 1 = nan, must be finite");
  CHECK(SphereCollider<double>::create(o, 0).error() ==
        "the sphere has the radius 0 m, must be finite and positive");
  CHECK(SphereCollider<double>::create(o, 1, {-0.5, 0}).error() ==
        "the sphere has the friction coefficient -0.5, must be finite and not negative");
  CHECK(CapsuleCollider<double>::create(o, V(nan, 0, 0), 1).error() ==
        "the capsule has the end b with the coordinate 0 = nan, must be finite");
  CHECK(CapsuleCollider<double>::create(o, z, -1).error() ==
        "the capsule has the radius -1 m, must be finite and positive");
  CHECK(CylinderCollider<double>::create(o, o, 1).error() ==
        "the cylinder has the length 0 m, must be finite and positive");
  CHECK(BoxCollider<double>::create(o, V(1, 0, 1)).error() ==
        "the box has the half length along y 0 m, must be finite and positive");
  Matrix3<double> R = Matrix3<double>::Identity();
  R(0, 0) = -1;
  CHECK(BoxCollider<double>::create(o, V(1, 1, 1), R).error() ==
        "the box has the orientation of a reflection, must be a rotation");
  R(0, 0) = nan;
  CHECK(BoxCollider<double>::create(o, V(1, 1, 1), R).error() ==
        "the box has the orientation with the entry (0, 0) = nan, must be finite");
  CHECK(BoxCollider<double>::create(o, V(1, 1, 1), 2 * Matrix3<double>::Identity()).error() ==
        "the box has the orientation with columns that are off by 3, must be a rotation");
  CHECK(SphereCollider<double>::create(o, std::numeric_limits<double>::infinity()).error() ==
        "the sphere has the radius inf m, must be finite and positive");
}
