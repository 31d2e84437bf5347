#include "clothctl/cloth/detail/lane_levels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include <Eigen/Geometry>

#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::kSanitized;
using clothctl_test::Numbers;
using clothctl_test::PlainPoint;

namespace {

/// A flat sheet of equal cells with levels.
template <class Scalar>
struct Sheet {
  static constexpr Index kLanes = grid_lanes<Scalar>();
  LaneLayout<Scalar> layout;
  VectorX<Scalar> rest, points;
  LaneLevels<Scalar> levels;
  typename LaneLevels<Scalar>::Scratch scratch;

  Sheet(int rows, int cols, int count, bool shifted, bool equal_masses = true) {
    int strip = 1 << count;
    while (kLanes * strip + 1 < rows) strip += 1 << count;
    layout = {rows, cols, strip, std::min((rows - 1) / strip, int(kLanes) - 1)};
    rest.setZero(static_cast<Index>(layout.buffer_size()));
    Numbers random(8);
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        const Index at = offset(row, col);
        // Equal cells that are neither square nor upright.
        set(rest, at, {0.011 * col + 0.002 * row, 0.4 - 0.013 * row, 0.003 * col});
        rest[at + 3 * kLanes] = Scalar(equal_masses ? 50.0 : random(20.0, 200.0));
      }
    }
    levels = LaneLevels<Scalar>(layout, rest, count, shifted);
    scratch = levels.make_scratch();
    points = rest;
  }
  Index offset(int row, int col) const { return static_cast<Index>(layout.offset(row, col)); }
  static void set(VectorX<Scalar>& to, Index at, const Vector3<double>& p) {
    for (Index c = 0; c < 3; ++c) to[at + c * kLanes] = Scalar(p[c]);
  }
  static Vector3<double> get(const VectorX<Scalar>& from, Index at) {
    return {static_cast<double>(from[at]), static_cast<double>(from[at + kLanes]),
            static_cast<double>(from[at + 2 * kLanes])};
  }
  /// Calls visit(offset) for each vertex.
  template <class Visit>
  void for_each(Visit visit) const {
    for (int row = 0; row < layout.rows; ++row) {
      for (int col = 0; col < layout.cols; ++col) visit(offset(row, col));
    }
  }
  /// Maps the rest positions.
  template <class Map>
  void place(Map map) {
    for_each([&](Index at) { set(points, at, map(get(rest, at))); });
  }
  void hold(const std::vector<GridPlace>& held) {
    for (const GridPlace& p : held) points[offset(p.row, p.col) + 3 * kLanes] = Scalar(0);
    levels.prepare(held, scratch);
  }
  void correct(int sweeps, double slack) {
    levels.correct(sweeps, Scalar(slack), points.data(), scratch);
    levels.add(Scalar(1), points.data(), scratch);
  }
  /// The largest distance from `other`.
  double distance(const VectorX<Scalar>& other) const {
    double most = 0;
    for_each([&](Index at) { most = std::max(most, (get(points, at) - get(other, at)).norm()); });
    return most;
  }
};

/// Sizes with their number of levels: whole strips, one row more, any.
struct Size {
  int rows, cols, levels;
};
const std::vector<Size> kSizes{{33, 33, 1}, {64, 40, 1},  {65, 65, 2}, {70, 37, 1},
                               {48, 33, 1}, {129, 67, 2}, {40, 33, 2}, {81, 64, 3}};

template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 4e-6 : 1e-13;

Matrix3<double> some_rotation(unsigned seed) {
  Numbers random(seed);
  return Eigen::Quaterniond(random(-1, 1), random(-1, 1), random(-1, 1), random(-1, 1))
      .normalized()
      .toRotationMatrix();
}

}  // namespace

TEMPLATE_TEST_CASE("lane levels: tethers pull a sheet that is scaled about its corner back to rest",
                   "[lane_levels]", float, double, long double) {
  // The displacements of the levels are then linear in the rest position, and interpolation must
  // reproduce them at every vertex.
  using Scalar = TestType;
  for (const Size& size : kSizes) {
    if (kSanitized && size.rows * size.cols > 1000) continue;
    for (const bool shifted : {false, true}) {
      for (const int corner : {0, 1, 2, 3}) {
        Sheet<Scalar> sheet(size.rows, size.cols, size.levels, shifted);
        const GridPlace held{corner % 2 == 0 ? 0 : size.rows - 1, corner < 2 ? 0 : size.cols - 1};
        const Vector3<double> q = sheet.get(sheet.rest, sheet.offset(held.row, held.col));
        const Matrix3<double> turn = some_rotation(3);
        sheet.hold({held});
        sheet.place(
            [&](const Vector3<double>& x) -> Vector3<double> { return q + turn * (x - q); });
        const VectorX<Scalar> expected = sheet.points;
        sheet.place(
            [&](const Vector3<double>& x) -> Vector3<double> { return q + 1.2 * turn * (x - q); });
        sheet.correct(0, 0.0);
        INFO(size.rows << " × " << size.cols << ", corner " << corner << ", shifted " << shifted);
        CHECK(sheet.distance(expected) < kSmall<Scalar>);
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane levels: nothing happens where nothing is stretched", "[lane_levels]",
                   float, double, long double) {
  using Scalar = TestType;
  for (const Size& size : kSizes) {
    if (kSanitized && size.rows * size.cols > 1000) continue;
    for (const bool shifted : {false, true}) {
      const int held_count = GENERATE(0, 1, 2);
      Sheet<Scalar> sheet(size.rows, size.cols, size.levels, shifted);
      std::vector<GridPlace> held;
      if (held_count > 0) held.push_back({0, 0});
      if (held_count > 1) held.push_back({0, size.cols - 1});
      sheet.hold(held);
      const Matrix3<double> turn = some_rotation(5);
      // Flat, moved rigidly; and shrunk, as in folds.
      for (const double scale : {1.0, 0.9}) {
        sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
          return Vector3<double>(1, 2, -1) + scale * turn * x;
        });
        const VectorX<Scalar> before = sheet.points;
        sheet.correct(3, 0.0);
        CHECK(sheet.distance(before) < 5 * kSmall<Scalar>);
        if (scale < 1) CHECK(sheet.distance(before) < kSmall<Scalar>);
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane levels: held vertices that are on no level stretch nothing at rest",
                   "[lane_levels]", float, double) {
  using Scalar = TestType;
  for (const Size& size : kSizes) {
    for (const bool shifted : {false, true}) {
      for (const GridPlace& place :
           {GridPlace{5, 7}, GridPlace{0, size.cols / 2 - 1}, GridPlace{size.rows - 2, 3}}) {
        Sheet<Scalar> sheet(size.rows, size.cols, size.levels, shifted);
        sheet.hold({place});
        sheet.correct(3, 0.0);
        INFO(size.rows << " × " << size.cols << ": " << place.row << ", " << place.col);
        CHECK(sheet.distance(sheet.rest) < 5 * kSmall<Scalar>);
      }
    }
  }
}

TEMPLATE_TEST_CASE("lane levels: held vertices have the same bits afterwards", "[lane_levels]",
                   float, double) {
  using Scalar = TestType;
  Sheet<Scalar> sheet(65, 40, 1, true);
  const std::vector<GridPlace> held{{0, 0}, {64, 39}, {64, 1}, {31, 17}, {30, 2}, {1, 38}};
  sheet.hold(held);
  Numbers random(4);
  sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
    return 1.3 * x + Vector3<double>(random(-0.01, 0.01), random(-0.01, 0.01), random(-0.01, 0.01));
  });
  const VectorX<Scalar> before = sheet.points;
  sheet.correct(3, 0.0);
  CHECK(sheet.distance(before) > 0.01);
  for (const GridPlace& place : held) {
    const Index at = sheet.offset(place.row, place.col);
    CHECK(sheet.get(sheet.points, at) == sheet.get(before, at));
  }
  sheet.for_each([&](Index at) {
    CHECK(sheet.points[at + 3 * sheet.kLanes] == before[at + 3 * sheet.kLanes]);
  });
}

TEMPLATE_TEST_CASE("lane levels: a free sheet keeps its momentum, linear and angular",
                   "[lane_levels]", float, double, long double) {
  using Scalar = TestType;
  for (const Size& size : kSizes) {
    Sheet<Scalar> sheet(size.rows, size.cols, size.levels, size.rows % 2 == 0, false);
    sheet.hold({});
    Numbers random(9);
    sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
      return 1.1 * x + Vector3<double>(0.2 * x[1] * x[1], random(-1e-3, 1e-3), random(-1e-3, 1e-3));
    });
    const VectorX<Scalar> before = sheet.points;
    sheet.correct(3, 0.0);
    Vector3<double> linear = Vector3<double>::Zero(), angular = linear;
    double mass = 0, most = 0;
    sheet.for_each([&](Index at) {
      const double m = 1.0 / static_cast<double>(before[at + 3 * sheet.kLanes]);
      const Vector3<double> x = sheet.get(before, at), d = sheet.get(sheet.points, at) - x;
      mass += m;
      linear += m * d;
      angular += m * x.cross(d);
      most = std::max(most, d.norm());
    });
    CHECK(most > 1e-3);
    CHECK(linear.norm() / mass < kSmall<Scalar> * most * 100);
    CHECK(angular.norm() / mass < kSmall<Scalar> * most * 100);
  }
}

TEMPLATE_TEST_CASE("lane levels: corrections shorten a stretched sheet", "[lane_levels]", float,
                   double) {
  using Scalar = TestType;
  // Held at two corners and stretched downwards by 20 %.
  for (const Size& size : kSizes) {
    Sheet<Scalar> sheet(size.rows, size.cols, size.levels, false);
    sheet.hold({{0, 0}, {0, size.cols - 1}});
    sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
      return Vector3<double>(x[0], 0.4 + 1.2 * (x[1] - 0.4), x[2]);
    });
    const auto height = [&]() {
      return (sheet.get(sheet.points, sheet.offset(size.rows - 1, 0)) -
              sheet.get(sheet.points, sheet.offset(0, 0)))
          .norm();
    };
    const double rest = (sheet.get(sheet.rest, sheet.offset(size.rows - 1, 0)) -
                         sheet.get(sheet.rest, sheet.offset(0, 0)))
                            .norm();
    CHECK(height() > 1.15 * rest);
    for (int i = 0; i < 3; ++i) sheet.correct(3, 0.0);
    CHECK(height() < 1.03 * rest);
    CHECK(height() > 0.9 * rest);
  }
}

TEST_CASE("lane levels: scratch of another sheet does not fit", "[lane_levels]") {
  const Sheet<double> small(33, 33, 1, false), large(65, 65, 2, false);
  CHECK(small.levels.fits(small.scratch));
  CHECK(large.levels.count() == 2);
  CHECK_FALSE(small.levels.fits(large.scratch));
  CHECK_FALSE(large.levels.fits(small.scratch));
  LaneLevels<double> none;
  auto memory = none.make_scratch();
  CHECK(none.fits(memory));
  none.correct(3, 0.0, nullptr, memory);  // does nothing
}
