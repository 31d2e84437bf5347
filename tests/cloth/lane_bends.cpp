#include "clothctl/cloth/detail/lane_bends.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"
#include "support/lane_sheets.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

/// A stencil 1, -2, 1 in plain code.
struct PlainBend {
  std::array<std::size_t, 3> vertex;
  double stiffness;
  Vector3<double> multiplier = Vector3<double>::Zero();

  Vector3<double> error(const std::vector<PlainPoint>& points) const {
    return points[vertex[0]].at - 2.0 * points[vertex[1]].at + points[vertex[2]].at;
  }
  void visit(double h, std::vector<PlainPoint>& points) {
    const double k = h * h * stiffness;
    const double share = points[vertex[0]].w + 4.0 * points[vertex[1]].w + points[vertex[2]].w;
    const Vector3<double> change = -(k * error(points) + multiplier) / (k * share + 1.0);
    multiplier += change;
    points[vertex[0]].at += points[vertex[0]].w * change;
    points[vertex[1]].at -= 2.0 * points[vertex[1]].w * change;
    points[vertex[2]].at += points[vertex[2]].w * change;
  }
};

/// A grid of random stencils in lanes, and in plain code in the order of a sweep: along the rows
/// (row j of all strips at once), then down the columns by the row of the first vertex.
template <class Scalar>
struct Grid {
  LaneCloud<Scalar> cloud;
  LaneBends<Scalar> bends;
  LaneBendScratch<Scalar> scratch;
  std::vector<PlainBend> list;

  Grid(const LaneCase& size, unsigned seed, bool held, double h) : cloud(size, seed, held) {
    const LaneLayout<Scalar>& layout = cloud.layout;
    Numbers random(seed + 1);
    bends.layout = layout;
    bends.any = true;
    const Index count = static_cast<Index>(layout.size() / 4);
    for (VectorX<Scalar>& one : bends.stiffness) one.setZero(count);
    scratch.resize(count);
    const auto add = [&](std::size_t direction, int row, int col) {
      const int dr = direction == 1 ? 1 : 0, dc = 1 - dr;
      if (row + 2 * dr >= layout.rows || col + 2 * dc >= layout.cols) return;
      if (random.below(11) == 0) return;
      Scalar& k = bends.stiffness[direction][entry_of(layout, row, col)];
      k = Scalar(random(1.0, 300.0));
      const auto at = [&](int i) {
        return static_cast<std::size_t>((row + i * dr) * layout.cols + col + i * dc);
      };
      list.push_back({{at(0), at(1), at(2)}, static_cast<double>(k)});
    };
    for (std::size_t direction = 0; direction < 2; ++direction) {
      for (int j = 0; j < layout.local_rows; ++j) {
        for (int lane = 0; lane <= layout.last_lane; ++lane) {
          if (j >= layout.rows_in_lane(lane)) continue;
          for (int col = 0; col < layout.cols; ++col) add(direction, lane * layout.strip + j, col);
        }
      }
    }
    LaneBendPreparation<Scalar> preparation{bends, scratch, Scalar(h)};
    for_each_stencil(layout, layout.whole(), cloud.buffer.data(), preparation);
  }
  template <bool kRead, bool kWrite>
  void sweep(SweepOrder order = SweepOrder::Forward) {
    LaneBendSweep<Scalar, kRead, kWrite> rule{scratch};
    for_each_stencil(cloud.layout, cloud.layout.whole(), cloud.buffer.data(), rule, order);
  }
};

template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 1e-5 : 1e-13;

}  // namespace

TEMPLATE_TEST_CASE("lane bends: sweeps are plain sequential sweeps in the order described",
                   "[lane_bends]", float, double, long double) {
  using Scalar = TestType;
  const double h = static_cast<double>(Scalar(0.05));
  unsigned seed = 1;
  for (const LaneCase& size : lane_cases<Scalar>()) {
    Grid<Scalar> grid(size, ++seed, true, h);
    const std::vector<PlainPoint> before = grid.cloud.points;
    const auto plain_sweep = [&](SweepOrder order) {
      const SweepPlaces places(order, 0, grid.list.size());
      for (std::size_t i = 0; i < places.count(); ++i)
        grid.list[places[i]].visit(h, grid.cloud.points);
    };
    REQUIRE(grid.list.size() > 5);
    grid.template sweep<false, true>();
    plain_sweep(SweepOrder::Forward);
    CHECK(grid.cloud.distance() < kSmall<Scalar>);
    grid.template sweep<true, true>(SweepOrder::Backward);
    plain_sweep(SweepOrder::Backward);
    CHECK(grid.cloud.distance() < kSmall<Scalar>);
    grid.template sweep<true, false>();
    plain_sweep(SweepOrder::Forward);
    CHECK(grid.cloud.distance() < kSmall<Scalar>);
    double moved = 0;
    for (std::size_t v = 0; v < before.size(); ++v) {
      moved = std::max(moved, (grid.cloud.points[v].at - before[v].at).norm());
      CHECK(grid.cloud.in_lanes(v).w == before[v].w);
      if (before[v].w > 0) continue;
      CHECK(grid.cloud.in_lanes(v).at == before[v].at);
    }
    CHECK(moved > 0.005);
  }
}

TEMPLATE_TEST_CASE("lane bends: bands and seams together visit each stencil once", "[lane_bends]",
                   float, double) {
  using Scalar = TestType;
  const LaneLayout<Scalar> layout(3 * grid_lanes<Scalar>() + 1, 200, 3, grid_lanes<Scalar>() - 1);
  struct Counter {
    std::map<std::array<std::size_t, 2>, int> visits;
    void stencil(std::size_t direction, std::size_t at, Scalar*, Scalar*, Scalar*) {
      ++visits[{direction, at}];
    }
  };
  std::vector<Scalar> points(layout.buffer_size(), Scalar(0));
  Counter in_bands, at_once;
  REQUIRE(layout.band_count() == 3);
  for_each_band(layout, {}, 2, [&](const ColumnBand& band, int) {
    for_each_stencil(layout, band, points.data(), in_bands);
  });
  for_each_stencil(layout, layout.whole(), points.data(), at_once);
  CHECK(at_once.visits.size() > 1000);
  CHECK(in_bands.visits == at_once.visits);
  Counter back;
  const auto go_back = [&](const ColumnBand& band, int) {
    for_each_stencil(layout, band, points.data(), back, SweepOrder::Backward);
  };
  for_each_band(layout, {}, 2, go_back, SweepOrder::Backward);
  CHECK(back.visits == at_once.visits);
}

TEMPLATE_TEST_CASE("lane bends: a sweep keeps the momentum", "[lane_bends]", float, double) {
  using Scalar = TestType;
  unsigned seed = 30;
  for (const LaneCase& size : lane_cases<Scalar>()) {
    Grid<Scalar> grid(size, ++seed, false, 0.1);
    grid.template sweep<false, false>();
    std::vector<Vector3<double>> moved;
    for (std::size_t v = 0; v < grid.cloud.points.size(); ++v)
      moved.push_back(grid.cloud.in_lanes(v).at - grid.cloud.points[v].at);
    CHECK(grid.cloud.distance() > 0.005);
    CHECK(momenta(grid.cloud.points, moved)[0].norm() <
          (std::is_same_v<Scalar, float> ? 1e-4 : 1e-12));
  }
}

TEMPLATE_TEST_CASE("lane bends: a flat sheet in equal steps stays, whatever its stiffness",
                   "[lane_bends]", float, double) {
  using Scalar = TestType;
  constexpr Index kLanes = grid_lanes<Scalar>();
  for (const LaneCase& size : lane_cases<Scalar>()) {
    Grid<Scalar> grid(size, 5, true, 1.0);
    const LaneLayout<Scalar>& layout = grid.cloud.layout;
    for (int row = 0; row < layout.rows; ++row) {
      for (int col = 0; col < layout.cols; ++col) {
        const Index at = static_cast<Index>(layout.offset(row, col));
        // Multiples of 1/8 are exact.
        grid.cloud.buffer[at] = Scalar(0.125) * Scalar(row);
        grid.cloud.buffer[at + kLanes] = Scalar(0.25) * Scalar(col);
        grid.cloud.buffer[at + 2 * kLanes] = Scalar(0.5) * Scalar(row) - Scalar(0.25) * Scalar(col);
      }
    }
    const VectorX<Scalar> before = grid.cloud.buffer;
    grid.template sweep<false, false>();
    const Index count = static_cast<Index>(layout.size());
    CHECK(grid.cloud.buffer.head(count) == before.head(count));
  }
}
