#pragma once

// The laws that every Collider must obey. Call check_collider_laws<Scalar>(collider, settings)
// inside a TEST_CASE.
//
//   distance   |d(x) - d(y)| <= |x - y|
//   gradient   the central difference of d is the normal, so |∇d| = 1, where the normals around x
//              agree (away from the medial axis)
//   closest    q = x - d n, |n| = 1, and d(q) = 0 (for a union: d(q) <= 0)
//   velocity   the surface moves as the settings say
//   sweep      no ball is ever inside the radius before its time of impact, and at that time it
//              touches; both against dense sampling of the path
//   bounds     hold all surface points during the step
//   again      a batch has the bits of its points one by one, and of its repetition
//   refusal    a point that is not finite has no answer and a status; a wrong length, radius or
//              time writes nothing
//   memory     nothing allocates
//   reference  a ColliderRef answers the same bits

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "clothctl/concepts/collider.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Where and how closely a collider is checked.
template <class Scalar>
struct ColliderLaws {
  /// The points are random in a cube about `centre` (m) of half width `extent` (m).
  clothctl::Vector3<Scalar> centre = clothctl::Vector3<Scalar>::Zero();
  Scalar extent = Scalar(1);
  /// Largest error of a distance or point, m.
  Scalar tolerance = Scalar(1e-12);
  /// Largest error of the normal against the finite difference.
  Scalar gradient_tolerance = Scalar(1e-6);
  /// Step of the finite difference, m.
  Scalar difference = Scalar(1e-5);
  /// Distances may differ by this factor times the distance of their points; 1 if exact.
  Scalar lipschitz = Scalar(1);
  /// Largest gap at the time of impact, m.
  Scalar early = Scalar(1e-9);
  /// Length of the step, s.
  Scalar dt = Scalar(0);
  /// True if the closest point lies on the surface of the whole; false for overlapping parts.
  bool exact_inside = true;
  /// The velocity of the surface at a point, m/s.
  std::function<clothctl::Vector3<Scalar>(const clothctl::Vector3<Scalar>&)> velocity =
      [](const clothctl::Vector3<Scalar>&) { return clothctl::Vector3<Scalar>::Zero().eval(); };
  /// The signed distance of a point from the collider where it is after a time (s). Empty: the
  /// collider rests.
  std::function<Scalar(const clothctl::Vector3<Scalar>&, Scalar)> later = {};
  int points = 200;
};

namespace law_detail {

template <class Scalar>
clothctl::Points<Scalar> random_points(const ColliderLaws<Scalar>& laws, int count,
                                       std::mt19937& random) {
  clothctl::Points<Scalar> x(3, count);
  for (clothctl::Index i = 0; i < x.size(); ++i) {
    const double u = static_cast<double>(random()) / 4294967296.0;
    x(i) = laws.centre[i % 3] + laws.extent * Scalar(2 * u - 1);
  }
  return x;
}

template <class Scalar, class C>
Scalar one_distance(const C& collider, const clothctl::Vector3<Scalar>& x) {
  clothctl::VectorX<Scalar> d(1);
  const clothctl::Points<Scalar> point = x;
  CHECK(clothctl::collider_traits<C>::distance(collider, point, d) ==
        clothctl::QueryStatus::Answered);
  return d[0];
}

template <class Scalar, class C>
clothctl::SurfacePoint<Scalar> one_closest(const C& collider, const clothctl::Vector3<Scalar>& x) {
  std::vector<clothctl::SurfacePoint<Scalar>> out(1);
  const clothctl::Points<Scalar> point = x;
  CHECK(clothctl::collider_traits<C>::closest(collider, point,
                                              std::span<clothctl::SurfacePoint<Scalar>>(out)) ==
        clothctl::QueryStatus::Answered);
  return out[0];
}

template <class Scalar>
bool same_bits(const clothctl::SurfacePoint<Scalar>& a, const clothctl::SurfacePoint<Scalar>& b) {
  return std::memcmp(&a.distance, &b.distance, sizeof a.distance) == 0 && a.point == b.point &&
         a.normal == b.normal && a.velocity == b.velocity && a.friction == b.friction &&
         a.body == b.body;
}

template <class Scalar, class C>
void check_surface(const C& collider, const ColliderLaws<Scalar>& laws) {
  using clothctl::Index;
  using Vector = clothctl::Vector3<Scalar>;
  std::mt19937 random(5);
  const clothctl::Points<Scalar> x = random_points(laws, laws.points, random);
  const Scalar step = laws.difference;
  const clothctl::BoundingBox<Scalar> box =
      clothctl::BoundingBox<Scalar>(clothctl::collider_traits<C>::bounds(collider, laws.dt))
          .grown(laws.tolerance);
  Scalar lipschitz(-1), closest(0), unit(0), surface(0), gradient(0), speed(0);
  int compared = 0, outside_box = 0, wrong_distance = 0;
  Vector last = x.col(0);
  for (Index i = 0; i < x.cols(); ++i) {
    const Vector at = x.col(i);
    const clothctl::SurfacePoint<Scalar> s = one_closest<Scalar>(collider, at);
    if (one_distance<Scalar>(collider, at) != s.distance) ++wrong_distance;
    const Scalar d_last = one_distance<Scalar>(collider, last);
    lipschitz =
        std::max(lipschitz, std::abs(s.distance - d_last) - laws.lipschitz * (at - last).norm());
    last = at;
    unit = std::max(unit, std::abs(s.normal.norm() - Scalar(1)));
    closest = std::max(closest, (at - s.point - s.distance * s.normal).norm());
    const Scalar there = one_distance<Scalar>(collider, s.point);
    surface = std::max(surface, laws.exact_inside ? std::abs(there) : there);
    speed = std::max(speed, (s.velocity - laws.velocity(s.point)).norm());
    if (!box.overlaps({s.point, s.point})) ++outside_box;
    Vector slope = Vector::Zero();
    bool agree = true;
    for (Index c = 0; c < 3; ++c) {
      const Vector e = step * Vector::Unit(c);
      const auto up = one_closest<Scalar>(collider, Vector(at + e));
      const auto down = one_closest<Scalar>(collider, Vector(at - e));
      slope[c] = (up.distance - down.distance) / ((at + e)[c] - (at - e)[c]);
      // Curvature bends the normal by step/|d| at most, unless the surface is closer than that.
      const Scalar bend =
          Scalar(4) * step / std::max(std::abs(s.distance), Scalar(4) * step) + Scalar(0.01);
      agree =
          agree && (up.normal - s.normal).norm() < bend && (down.normal - s.normal).norm() < bend;
    }
    if (!agree || std::abs(s.distance) < Scalar(20) * step) continue;
    ++compared;
    gradient = std::max(gradient, (slope - s.normal).norm());
  }
  CHECK(wrong_distance == 0);
  CHECK(lipschitz <= laws.tolerance);
  CHECK(unit <= Scalar(64) * std::numeric_limits<Scalar>::epsilon());
  CHECK(closest <= laws.tolerance);
  CHECK(surface <= laws.tolerance);
  CHECK(speed <= laws.tolerance * Scalar(100));
  CHECK(outside_box == 0);
  CHECK(gradient <= laws.gradient_tolerance);
  CHECK(compared >= laws.points / 4);
}

template <class Scalar, class C>
void check_sweep(const C& collider, const ColliderLaws<Scalar>& laws) {
  using clothctl::Index;
  using Vector = clothctl::Vector3<Scalar>;
  using Traits = clothctl::collider_traits<C>;
  std::mt19937 random(6);
  const int count = laws.points / 2;
  clothctl::Points<Scalar> from = random_points(laws, count, random);
  const clothctl::Points<Scalar> to = random_points(laws, count, random);
  const auto distance = [&](const Vector& p, Scalar s) {
    return laws.later ? laws.later(p, s) : one_distance<Scalar>(collider, p);
  };
  for (const Scalar radius : {Scalar(0), Scalar(0.05) * laws.extent}) {
    clothctl::VectorX<Scalar> time(count);
    REQUIRE(Traits::sweep(collider, from, to, radius, laws.dt, time) ==
            clothctl::QueryStatus::Answered);
    Scalar late(0), early(0);
    int hits = 0, off_range = 0;
    for (Index i = 0; i < count; ++i) {
      const Vector a = from.col(i), v = to.col(i) - from.col(i);
      const bool hit = time[i] <= Scalar(1);
      if (!hit && time[i] != clothctl::no_impact<Scalar>()) ++off_range;
      if (time[i] < Scalar(0)) ++off_range;
      const Scalar end = hit ? time[i] : Scalar(1);
      constexpr int kSamples = 100;
      for (int k = 0; k < kSamples; ++k) {
        const Scalar t = end * Scalar(k) / Scalar(kSamples);
        if (hit && t >= end) continue;
        late = std::max(late, radius - distance(a + t * v, t * laws.dt));
      }
      if (!hit) continue;
      ++hits;
      early = std::max(early, distance(a + end * v, end * laws.dt) - radius);
    }
    CAPTURE(static_cast<double>(radius));
    CHECK(off_range == 0);
    CHECK(late <= laws.tolerance * Scalar(10));
    CHECK(early <= laws.early);
    CHECK(hits > 0);
  }
}

template <class Scalar, class C>
void check_repetition(const C& collider, const ColliderLaws<Scalar>& laws) {
  using clothctl::Index;
  using Traits = clothctl::collider_traits<C>;
  using Answers = std::vector<clothctl::SurfacePoint<Scalar>>;
  using Span = std::span<clothctl::SurfacePoint<Scalar>>;
  std::mt19937 random(7);
  const int count = 40;
  const clothctl::Points<Scalar> x = random_points(laws, count, random);
  const clothctl::Points<Scalar> y = random_points(laws, count, random);
  const clothctl::ColliderRef<Scalar> reference(collider);
  Answers batch(count), again(count), referred(count);
  clothctl::VectorX<Scalar> d(count), t(count), d_again(count), t_again(count);
  const Scalar radius = Scalar(0.03) * laws.extent;
  const clothctl::PointsView<Scalar> x_view(x), y_view(y);
  const Span batch_span(batch), again_span(again), referred_span(referred);
  const long before = allocations();
  bool good = Traits::closest(collider, x_view, batch_span) == clothctl::QueryStatus::Answered;
  good &= Traits::closest(collider, x_view, again_span) == clothctl::QueryStatus::Answered;
  good &= reference.closest(x_view, referred_span) == clothctl::QueryStatus::Answered;
  good &= Traits::distance(collider, x_view, d) == clothctl::QueryStatus::Answered;
  good &= Traits::sweep(collider, x_view, y_view, radius, laws.dt, t) ==
          clothctl::QueryStatus::Answered;
  good &= reference.distance(x_view, d_again) == clothctl::QueryStatus::Answered;
  good &=
      reference.sweep(x_view, y_view, radius, laws.dt, t_again) == clothctl::QueryStatus::Answered;
  const clothctl::BoundingBox<Scalar> box = Traits::bounds(collider, laws.dt);
  const long made = allocations() - before;
  CHECK(good);
  CHECK(clothctl::all_finite(box.lower));
  if (allocation_counting_works()) CHECK(made == 0);
  CHECK(d == d_again);
  CHECK(t == t_again);
  int differ = 0;
  for (Index i = 0; i < count; ++i) {
    const std::size_t k = static_cast<std::size_t>(i);
    const clothctl::Points<Scalar> from = x.col(i), to = y.col(i);
    clothctl::VectorX<Scalar> time(1);
    CHECK(Traits::sweep(collider, from, to, radius, laws.dt, time) ==
          clothctl::QueryStatus::Answered);
    const auto single = one_closest<Scalar>(collider, from);
    if (!same_bits(batch[k], again[k]) || !same_bits(batch[k], referred[k]) ||
        !same_bits(batch[k], single) || d[i] != single.distance || t[i] != time[0])
      ++differ;
  }
  CHECK(differ == 0);
}

template <class Scalar, class C>
void check_refusals(const C& collider, const ColliderLaws<Scalar>& laws) {
  using clothctl::Index;
  using Traits = clothctl::collider_traits<C>;
  using Status = clothctl::QueryStatus;
  std::mt19937 random(8);
  const clothctl::Points<Scalar> good = random_points(laws, 3, random);
  std::vector<clothctl::SurfacePoint<Scalar>> known(3), out(3);
  const std::span<clothctl::SurfacePoint<Scalar>> span(out);
  REQUIRE(Traits::closest(collider, good, std::span<clothctl::SurfacePoint<Scalar>>(known)) ==
          Status::Answered);
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  for (const Scalar bad : {nan, std::numeric_limits<Scalar>::infinity()}) {
    clothctl::Points<Scalar> x = good;
    x(1, 1) = bad;
    clothctl::VectorX<Scalar> d(3), t(3);
    CHECK(Traits::closest(collider, x, span) == Status::InvalidPoint);
    CHECK(Traits::distance(collider, x, d) == Status::InvalidPoint);
    CHECK(Traits::sweep(collider, x, good, Scalar(0), laws.dt, t) == Status::InvalidPoint);
    CHECK(t[1] == clothctl::no_impact<Scalar>());
    CHECK(Traits::sweep(collider, good, x, Scalar(0), laws.dt, t) == Status::InvalidPoint);
    CHECK(t[1] == clothctl::no_impact<Scalar>());
    CHECK(clothctl::is_unbounded(d[1]));
    CHECK((clothctl::is_unbounded(out[1].distance) && out[1].body == -1));
    CHECK(clothctl::all_finite(out[1].point));
    CHECK(out[1].normal.isZero(Scalar(0)));
    CHECK((same_bits(out[0], known[0]) && same_bits(out[2], known[2])));
    CHECK((d[0] == known[0].distance && d[2] == known[2].distance));
    const Scalar kept = t[0];
    CHECK(Traits::sweep(collider, good, good, bad, laws.dt, t) == Status::InvalidArgument);
    CHECK(Traits::sweep(collider, good, good, Scalar(0), bad, t) == Status::InvalidArgument);
    CHECK(t[0] == kept);
  }
  clothctl::VectorX<Scalar> brief = clothctl::VectorX<Scalar>::Constant(2, Scalar(7));
  CHECK(Traits::distance(collider, good, brief) == Status::InvalidArgument);
  CHECK(Traits::sweep(collider, good, good, Scalar(0), laws.dt, brief) == Status::InvalidArgument);
  CHECK(Traits::closest(collider, good, span.first(2)) == Status::InvalidArgument);
  CHECK(brief[0] == Scalar(7));
  clothctl::VectorX<Scalar> t(3);
  CHECK(Traits::sweep(collider, good, good, Scalar(-1), laws.dt, t) == Status::InvalidArgument);
  CHECK(Traits::sweep(collider, good, good, Scalar(0), Scalar(-1), t) == Status::InvalidArgument);
  const clothctl::Points<Scalar> none(3, 0);
  clothctl::VectorX<Scalar> no_values(0);
  CHECK(Traits::distance(collider, none, no_values) == Status::Answered);
}

}  // namespace law_detail

/// Checks all laws of this file.
template <class Scalar, class C>
void check_collider_laws(const C& collider, const ColliderLaws<Scalar>& laws) {
  static_assert(clothctl::Collider<C, Scalar>);
  law_detail::check_surface<Scalar>(collider, laws);
  law_detail::check_sweep<Scalar>(collider, laws);
  law_detail::check_repetition<Scalar>(collider, laws);
  law_detail::check_refusals<Scalar>(collider, laws);
}

/// The tolerances of an exact collider of about 1 m in `Scalar`.
template <class Scalar>
ColliderLaws<Scalar> exact_laws(Scalar extent) {
  ColliderLaws<Scalar> laws;
  laws.extent = extent;
  if constexpr (std::numeric_limits<Scalar>::digits < 30) {
    laws.tolerance = Scalar(2e-6);
    laws.gradient_tolerance = Scalar(5e-3);
    laws.difference = Scalar(1e-3);
    laws.early = Scalar(2e-5);
  }
  return laws;
}

}  // namespace clothctl_test
