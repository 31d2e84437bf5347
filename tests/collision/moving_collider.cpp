// Colliders that move as rigid bodies: the laws, the same answers in every frame, velocities,
// sweeps against rotating bodies, and what is refused.

#include "clothctl/collision/moving_collider.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "clothctl/collision/collider_union.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "laws/collider_laws.hpp"
#include "support/catch.hpp"
#include "support/solids.hpp"

using namespace clothctl;
using clothctl_test::exact_laws;
using clothctl_test::uniform;
using clothctl_test::law_detail::one_closest;
using clothctl_test::law_detail::one_distance;

namespace {

template <class S>
RigidMotion<S> motion(double speed, double turn) {
  RigidMotion<S> m;
  m.R_world_body = rotation_exp<S>(Vector3<S>(S(0.5), S(-0.8), S(0.3)));
  m.position = Vector3<S>(S(0.1), S(-0.2), S(0.05));
  m.velocity = S(speed) * Vector3<S>(S(1), S(0.5), S(-0.3));
  m.angular_velocity = S(turn) * Vector3<S>(S(0.4), S(-0.6), S(0.7));
  return m;
}

/// Checks the laws of a shape that moves.
template <class S, class C>
void check_moving(const C& shape, const RigidMotion<S>& m, S dt, S early) {
  const auto moving = MovingCollider<S, C>::create(shape, m, {S(0.7), 9}).value();
  auto laws = exact_laws<S>(S(1));
  laws.dt = dt;
  laws.early = std::max(early, laws.early);
  laws.velocity = [&](const Vector3<S>& q) {
    return Vector3<S>(m.velocity + m.angular_velocity.cross(Vector3<S>(q - m.position)));
  };
  laws.later = [&](const Vector3<S>& x, S s) {
    const Matrix3<S> R = rotation_exp<S>(Vector3<S>(s * m.angular_velocity)) * m.R_world_body;
    const Vector3<S> local = R.transpose() * Vector3<S>(x - m.position - s * m.velocity);
    return one_distance<S>(shape, local);
  };
  check_collider_laws<S>(moving, laws);
  const auto s = one_closest<S>(moving, Vector3<S>(S(1), S(2), S(3)));
  CHECK(s.friction == S(0.7));
  CHECK(s.body == 9);
}

}  // namespace

TEMPLATE_TEST_CASE("moving colliders obey the laws", "[contact]", float, double) {
  using S = TestType;
  const auto box =
      BoxCollider<S>::create(Vector3<S>(S(0.1), S(0), S(0)), Vector3<S>(S(0.4), S(0.2), S(0.1)))
          .value();
  const auto capsule = CapsuleCollider<S>::create(Vector3<S>(S(-0.3), S(0), S(0)),
                                                  Vector3<S>(S(0.3), S(0.1), S(0)), S(0.1))
                           .value();
  for (const double turn : {0.0, 2.0, 20.0}) {
    CAPTURE(turn);
    // Early by twice 1e-5 of the way and of the distance from the origin.
    check_moving<S>(box, motion<S>(3, turn), S(0.05), S(1.2e-4));
    check_moving<S>(capsule, motion<S>(3, turn), S(0.05), S(1.2e-4));
  }
  check_moving<S>(box, motion<S>(0, 0), S(0), S(0));
}

TEST_CASE("answers do not depend on the frame", "[contact]") {
  std::mt19937 random(41);
  const auto mesh_of = [](const clothctl_test::PlainMesh& mesh) {
    return MeshCollider<double>::create(mesh.positions, mesh.triangles).value();
  };
  const auto torus = mesh_of(clothctl_test::torus_mesh(20, 10, 0.4, 0.15));
  const auto cylinder = CylinderCollider<double>::create(Vector3<double>(-0.3, 0, 0.1),
                                                         Vector3<double>(0.2, 0.1, 0), 0.3)
                            .value();
  const RigidMotion<double> m = motion<double>(0, 0);
  const auto compare = [&](const auto& shape) {
    using C = std::remove_cvref_t<decltype(shape)>;
    const auto moved = MovingCollider<double, C>::create(shape, m).value();
    double worst = 0;
    for (int i = 0; i < 300; ++i) {
      const Vector3<double> x(uniform(random, -1, 1), uniform(random, -1, 1),
                              uniform(random, -1, 1));
      const Vector3<double> there = m.position + m.R_world_body * x;
      const auto a = one_closest<double>(shape, x), b = one_closest<double>(moved, there);
      worst = std::max(worst, std::abs(a.distance - b.distance));
      worst = std::max(worst, (m.position + m.R_world_body * a.point - b.point).norm());
      worst = std::max(worst, (m.R_world_body * a.normal - b.normal).norm() * std::abs(a.distance));
    }
    CHECK(worst <= 2e-15);
  };
  compare(torus);
  compare(cylinder);
}

TEST_CASE("a wall that overtakes a resting point hits it", "[contact]") {
  const auto wall =
      PlaneCollider<double>::create(Vector3<double>(0, 0, 0), Vector3<double>(1, 0, 0)).value();
  RigidMotion<double> m;
  m.velocity = Vector3<double>(2, 0, 0);
  auto moving = MovingCollider<double, PlaneCollider<double>>::create(wall, m).value();
  Points<double> x(3, 2);
  x << 0.05, 0.3, 0, 0, 0, 0;
  VectorX<double> t(2);
  CHECK(moving.sweep(x, x, 0.01, 0.1, t) == QueryStatus::Answered);
  CHECK(std::abs(t[0] - 0.2) <= 1e-14);
  CHECK(t[1] == no_impact<double>());
  CHECK(moving.is_convex());
  CHECK(moving.bounds(0.1).upper[0] >= 0.2);
}

TEST_CASE("a spinning blade hits a resting point", "[contact]") {
  // A blade that turns by 90 degrees in the step; its edge passes the point after 60.
  const auto blade =
      BoxCollider<double>::create(Vector3<double>(0.5, 0, 0), Vector3<double>(0.5, 1e-6, 0.1))
          .value();
  const double pi = std::acos(-1.0);
  RigidMotion<double> m;
  m.angular_velocity = Vector3<double>(0, 0, pi / 2 / 0.02);
  const auto moving = MovingCollider<double, BoxCollider<double>>::create(blade, m).value();
  Points<double> x(3, 1);
  x << 0.9 * std::cos(pi / 3), 0.9 * std::sin(pi / 3), 0;
  VectorX<double> t(1);
  CHECK(moving.sweep(x, x, 0, 0.02, t) == QueryStatus::Answered);
  CHECK(t[0] == Approx(2.0 / 3.0).epsilon(1e-3));
  CHECK(t[0] <= 2.0 / 3.0);
}

TEST_CASE("a bad motion is refused and changes nothing", "[contact]") {
  const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.1).value();
  using Moving = MovingCollider<double, SphereCollider<double>>;
  RigidMotion<double> m;
  m.position[1] = std::numeric_limits<double>::quiet_NaN();
  CHECK(Moving::create(ball, m).error() ==
        "the moving collider has the position with the coordinate 1 = nan, must be finite");
  auto moving = Moving::create(ball, motion<double>(1, 1)).value();
  CHECK(moving.set_motion(m) == "the position with the coordinate 1 = nan, must be finite");
  CHECK(moving.motion().position == motion<double>(1, 1).position);
  m = motion<double>(1, 1);
  m.R_world_body(0, 0) += 0.1;
  CHECK(moving.set_motion(m).find("the orientation with columns that are off by ") == 0);
  m = motion<double>(1, 1);
  m.angular_velocity[2] = std::numeric_limits<double>::infinity();
  CHECK(moving.set_motion(m) == "the angular velocity with the coordinate 2 = inf, must be finite");
  CHECK(moving.set_motion(RigidMotion<double>()).empty());
  CHECK(Moving::create(ball, {}, {-2, 0}).error() ==
        "the moving collider has the friction coefficient -2, must be finite and not negative");
}
