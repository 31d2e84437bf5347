// A foreign collision world satisfies Collider by a trait alone. For other types the concept is
// false instead of a compile error.

#include "clothctl/concepts/collider.hpp"

#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "laws/collider_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Balls that drift through space, as a particle effect has them.
struct Ball {
  double centre[3];
  double radius;
  double drift[3];  // m/s
};
struct World {
  std::vector<Ball> balls;
};

}  // namespace other_engine

template <>
struct clothctl::collider_traits<other_engine::World> {
  using World = other_engine::World;
  using Ball = other_engine::Ball;
  using View = PointsView<double>;
  static Vector3<double> vector(const double* v) { return {v[0], v[1], v[2]}; }
  static const Ball& nearest_ball(const World& world, const Vector3<double>& x) {
    const Ball* best = &world.balls.front();
    for (const Ball& b : world.balls) {
      if (gap(b, x) < gap(*best, x)) best = &b;
    }
    return *best;
  }
  static double gap(const Ball& b, const Vector3<double>& x) {
    return (x - vector(b.centre)).norm() - b.radius;
  }
  static QueryStatus distance(const World& world, const View& x, Eigen::Ref<VectorX<double>> out) {
    if (out.size() != x.cols()) return QueryStatus::InvalidArgument;
    for (Index i = 0; i < x.cols(); ++i) {
      const Vector3<double> at = x.col(i);
      out[i] = all_finite(at) ? gap(nearest_ball(world, at), at)
                              : std::numeric_limits<double>::infinity();
    }
    return all_finite(x) ? QueryStatus::Answered : QueryStatus::InvalidPoint;
  }
  static QueryStatus closest(const World& world, const View& x,
                             std::span<SurfacePoint<double>> out) {
    if (static_cast<Index>(out.size()) != x.cols()) return QueryStatus::InvalidArgument;
    for (Index i = 0; i < x.cols(); ++i) {
      SurfacePoint<double>& s = out[static_cast<std::size_t>(i)];
      s = {};
      const Vector3<double> at = x.col(i);
      if (!all_finite(at)) continue;
      const Ball& ball = nearest_ball(world, at);
      s.distance = gap(ball, at);
      s.normal = (at - vector(ball.centre)) / (at - vector(ball.centre)).norm();
      s.point = vector(ball.centre) + ball.radius * s.normal;
      s.velocity = vector(ball.drift);
      s.friction = 0.3;
      s.body = static_cast<int>(&ball - world.balls.data());
    }
    return all_finite(x) ? QueryStatus::Answered : QueryStatus::InvalidPoint;
  }
  // The time at which a point at p with the velocity v, relative to the centre, is within r.
  static double impact(const Vector3<double>& p, const Vector3<double>& v, double r) {
    const double c = p.squaredNorm() - r * r, b = p.dot(v), a = v.squaredNorm();
    if (c <= 0) return 0;
    if (b >= 0 || b * b < a * c) return 2;
    const double t = c / (-b + std::sqrt(b * b - a * c));
    return t <= 1 ? t : 2;
  }
  static QueryStatus sweep(const World& world, const View& from, const View& to, double radius,
                           double dt, Eigen::Ref<VectorX<double>> out) {
    if (!is_finite(radius) || radius < 0 || !is_finite(dt) || dt < 0 || to.cols() != from.cols() ||
        out.size() != from.cols())
      return QueryStatus::InvalidArgument;
    for (Index i = 0; i < from.cols(); ++i) {
      out[i] = 2;
      if (!all_finite(from.col(i)) || !all_finite(to.col(i))) continue;
      for (const Ball& ball : world.balls) {
        const Vector3<double> p = from.col(i) - vector(ball.centre);
        const Vector3<double> v = to.col(i) - from.col(i) - dt * vector(ball.drift);
        out[i] = std::fmin(out[i], impact(p, v, ball.radius + radius));
      }
    }
    const bool good = all_finite(from) && all_finite(to);
    return good ? QueryStatus::Answered : QueryStatus::InvalidPoint;
  }
  static BoundingBox<double> bounds(const World& world, double dt) {
    const Vector3<double> first = vector(world.balls.front().centre);
    BoundingBox<double> box{first, first};
    for (const Ball& ball : world.balls) {
      for (const double s : {0.0, dt}) {
        const Vector3<double> at = vector(ball.centre) + s * vector(ball.drift);
        box.include(BoundingBox<double>{at, at}.grown(ball.radius));
      }
    }
    return box;
  }
};

using namespace clothctl;

namespace {

struct Empty {};
// A collider without a sweep.
struct Sweepless {
  QueryStatus distance(const PointsView<double>&, Eigen::Ref<VectorX<double>>) const {
    return QueryStatus::Answered;
  }
  QueryStatus closest(const PointsView<double>&, std::span<SurfacePoint<double>>) const {
    return QueryStatus::Answered;
  }
  BoundingBox<double> bounds(double) const { return {}; }
};
// One that swallows its status.
struct Silent : Sweepless {
  void sweep(const PointsView<double>&, const PointsView<double>&, double, double,
             Eigen::Ref<VectorX<double>>) const {}
};
struct Whole : Sweepless {
  QueryStatus sweep(const PointsView<double>&, const PointsView<double>&, double, double,
                    Eigen::Ref<VectorX<double>>) const {
    return QueryStatus::Answered;
  }
};

}  // namespace

static_assert(Collider<other_engine::World> && !Collider<other_engine::World, float>);
static_assert(Collider<Whole> && !Collider<Sweepless> && !Collider<Silent>);
static_assert(Collider<ColliderRef<double>> && !Collider<ColliderRef<double>, float>);
static_assert(!Collider<Empty> && !Collider<int> && !Collider<Whole, std::string>);

TEST_CASE("a foreign collision world obeys the laws", "[concepts]") {
  const other_engine::World world{
      {{{0.0, 0.1, 0.0}, 0.4, {0.5, 0, 0}}, {{0.7, 0.0, 0.2}, 0.3, {0.5, 0, 0}}}};
  auto laws = clothctl_test::exact_laws<double>(1.0);
  laws.exact_inside = false;  // the balls overlap
  laws.dt = 0.1;
  laws.velocity = [](const Vector3<double>&) { return Vector3<double>(0.5, 0, 0); };
  laws.later = [&](const Vector3<double>& x, double s) {
    const Vector3<double> back = x - s * Vector3<double>(0.5, 0, 0);
    return clothctl_test::law_detail::one_distance<double>(world, back);
  };
  clothctl_test::check_collider_laws<double>(world, laws);
  const ColliderRef<double> reference(world);
  CHECK_FALSE(reference.is_convex());
  CHECK(reference.part_count() == 0);
}

TEST_CASE("the statuses of a query have names", "[concepts]") {
  CHECK(to_string(QueryStatus::Answered) == "answered");
  CHECK(to_string(QueryStatus::InvalidPoint) == "invalid_point");
  CHECK(to_string(QueryStatus::InvalidArgument) == "invalid_argument");
}
