// Kinematic bodies, rigid bodies and particles as sides of contacts: the laws, momentum and energy,
// and what is refused.

#include "clothctl/contact/impulse_responses.hpp"

#include <array>
#include <limits>

#include "laws/impulse_response_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::Numbers;

namespace {

template <class S>
Points<S> places(int count, unsigned seed) {
  Numbers random(seed);
  Points<S> x(3, count);
  for (Index i = 0; i < x.size(); ++i) x(i) = static_cast<S>(random(-0.5, 0.5));
  return x;
}

template <class S>
RigidMotion<S> motion() {
  RigidMotion<S> m;
  m.R_world_body = rotation_exp<S>(Vector3<S>(S(0.5), S(-0.8), S(0.3)));
  m.position = Vector3<S>(S(0.1), S(-0.2), S(0.05));
  m.velocity = Vector3<S>(S(0.4), S(0.2), S(-0.1));
  m.angular_velocity = Vector3<S>(S(1), S(-2), S(0.7));
  return m;
}

template <class S>
RigidBodyResponse<S> body() {
  Matrix3<S> inertia;
  inertia << S(0.02), S(0.003), S(0), S(0.003), S(0.03), S(-0.002), S(0), S(-0.002), S(0.025);
  return RigidBodyResponse<S>::create(S(1.5), inertia, motion<S>(), 4).value();
}

template <class S>
S rounding() {
  return S(64) * scalar_traits<S>::epsilon();
}

}  // namespace

TEMPLATE_TEST_CASE("the sides of contacts obey the laws", "[contact]", float, double) {
  using S = TestType;
  KinematicResponse<S> kinematic(3);
  REQUIRE(kinematic.set_motion(motion<S>()).empty());
  REQUIRE(kinematic.set_points(places<S>(3, 1)) == QueryStatus::Answered);
  clothctl_test::check_impulse_response_laws<S>(kinematic, rounding<S>());
  RigidBodyResponse<S> rigid = body<S>();
  clothctl_test::check_impulse_response_laws<S>(rigid, rounding<S>());  // no points
  REQUIRE(rigid.set_points(places<S>(4, 2)) == QueryStatus::Answered);
  clothctl_test::check_impulse_response_laws<S>(rigid, rounding<S>());
  ParticleResponse<S> particles(2);
  const VectorX<S> inverse = (VectorX<S>(4) << S(2), S(0), S(5), S(100)).finished();
  const std::array<int, 3> touched{3, 1, 0};
  REQUIRE(particles.gather(touched, inverse, places<S>(4, 3)) == QueryStatus::Answered);
  clothctl_test::check_impulse_response_laws<S>(particles, rounding<S>());
}

TEST_CASE("points of bodies move with them", "[contact]") {
  const RigidMotion<double> m = motion<double>();
  const Points<double> x = places<double>(3, 4);
  KinematicResponse<double> kinematic;
  REQUIRE(kinematic.set_motion(m).empty());
  REQUIRE(kinematic.set_points(x) == QueryStatus::Answered);
  RigidBodyResponse<double> rigid = body<double>();
  REQUIRE(rigid.set_points(x) == QueryStatus::Answered);
  VectorX<double> u(9), v(9);
  kinematic.velocities(u);
  rigid.velocities(v);
  CHECK(u == v);
  for (Index i = 0; i < 3; ++i) {
    // A finite difference of the motion.
    const double e = 1e-6;
    const Vector3<double> r = x.col(i) - m.position;
    const Vector3<double> turned =
        rotation_exp<double>(Vector3<double>(e * m.angular_velocity)) * r;
    const Vector3<double> moved = m.position + e * m.velocity + turned;
    CHECK((u.segment<3>(3 * i) - (moved - x.col(i)) / e).norm() < 1e-5);
  }
}

TEST_CASE("impulses change a rigid body's momentum, angular momentum and energy", "[contact]") {
  RigidBodyResponse<double> rigid = body<double>();
  const Points<double> x = places<double>(4, 5);
  REQUIRE(rigid.set_points(x) == QueryStatus::Answered);
  const auto momentum = [&] { return Vector3<double>(rigid.mass() * rigid.motion().velocity); };
  const auto spin = [&]() -> Vector3<double> {
    const Matrix3<double>& R = rigid.motion().R_world_body;
    return R * rigid.inertia() * R.transpose() * rigid.motion().angular_velocity;
  };
  const auto energy = [&] {
    return 0.5 * momentum().dot(rigid.motion().velocity) +
           0.5 * spin().dot(rigid.motion().angular_velocity);
  };
  Numbers random(6);
  const VectorX<double> p = clothctl_test::law_detail::random_impulses<double>(12, random);
  Vector3<double> sum = Vector3<double>::Zero(), moment = sum;
  for (Index i = 0; i < 4; ++i) {
    const Vector3<double> p_i = p.segment<3>(3 * i), r = x.col(i) - rigid.motion().position;
    sum += p_i;
    moment += r.cross(p_i);
  }
  VectorX<double> u(12), v(12);
  rigid.velocities(u);
  const Vector3<double> P = momentum(), L = spin();
  const double E = energy();
  rigid.apply(p);
  rigid.velocities(v);
  CHECK((momentum() - P - sum).norm() < 1e-14);
  CHECK((spin() - L - moment).norm() < 1e-14);
  CHECK(energy() - E == Approx(0.5 * p.dot(u + v)).epsilon(1e-12));
}

TEST_CASE("particles are gathered from a sheet and scattered back", "[contact]") {
  Points<double> v = places<double>(5, 7);
  const Points<double> start = v;
  const VectorX<double> inverse = VectorX<double>::Constant(5, 4.0);
  ParticleResponse<double> particles;
  const std::array<int, 2> touched{4, 2};
  REQUIRE(particles.gather(touched, inverse, v) == QueryStatus::Answered);
  VectorX<double> p(6);
  p << 1, 0, 0, 0, 0, 2;
  particles.apply(p);
  REQUIRE(particles.scatter(touched, v) == QueryStatus::Answered);
  CHECK(v(0, 4) == start(0, 4) + 4);
  CHECK(v(2, 2) == start(2, 2) + 8);
  v.col(4) = start.col(4);
  v.col(2) = start.col(2);
  CHECK(v == start);
}

TEST_CASE("bad bodies and particles are refused and change nothing", "[contact]") {
  using Body = RigidBodyResponse<double>;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Matrix3<double> unit = Matrix3<double>::Identity();
  CHECK(Body::create(0, unit).error().find("mass") != std::string::npos);
  CHECK_FALSE(Body::create(std::numeric_limits<double>::infinity(), unit));
  CHECK_FALSE(Body::create(nan, unit));
  CHECK(Body::create(1, -unit).error().find("inertia") != std::string::npos);
  RigidMotion<double> bad;
  bad.angular_velocity[1] = nan;
  CHECK(Body::create(1, unit, bad).error().find("angular velocity") != std::string::npos);
  Body rigid = body<double>();
  CHECK_FALSE(rigid.set_motion(bad).empty());
  CHECK(rigid.motion().velocity == motion<double>().velocity);
  KinematicResponse<double> kinematic;
  CHECK_FALSE(kinematic.set_motion(bad).empty());
  Points<double> x = places<double>(3, 8);
  REQUIRE(rigid.set_points(x) == QueryStatus::Answered);
  x(1, 1) = nan;
  CHECK(rigid.set_points(x.leftCols(2)) == QueryStatus::InvalidPoint);
  CHECK(rigid.point_count() == 3);
  ParticleResponse<double> particles;
  VectorX<double> inverse = VectorX<double>::Ones(3);
  const std::array<int, 1> first{0}, second{1}, off{3};
  CHECK(particles.gather(second, inverse, x) == QueryStatus::InvalidPoint);
  CHECK(particles.gather(off, inverse, x) == QueryStatus::InvalidArgument);
  CHECK(particles.gather(first, inverse.head(2), x) == QueryStatus::InvalidArgument);
  inverse[0] = -1;
  CHECK(particles.gather(first, inverse, x) == QueryStatus::InvalidArgument);
  CHECK(particles.point_count() == 0);
  inverse[0] = 1;
  REQUIRE(particles.gather(first, inverse, x) == QueryStatus::Answered);
  CHECK(particles.scatter(off, x) == QueryStatus::InvalidArgument);
  CHECK(particles.scatter({}, x) == QueryStatus::InvalidArgument);
}
