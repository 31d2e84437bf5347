#include "clothctl/cloth/detail/lane_edges.hpp"

#include <cmath>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"
#include "support/lane_sheets.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

/// A grid of random springs in lanes and in plain code.
template <class Scalar>
struct Grid {
  LaneCloud<Scalar> cloud, start;
  LaneEdges<Scalar> edges;
  LaneEdgeScratch<Scalar> scratch;
  std::vector<GridEdgePlace> places;
  /// In the order of a sweep.
  std::vector<PlainEdge> list;
  /// For each edge of the list, the local row and, where strips have one row, the parity.
  std::vector<int> pass;

  Grid(const LaneCase& size, unsigned seed, bool held, bool limited, double h)
      : cloud(size, seed, held), start(size, seed + 1, held), places(sweep_order(cloud.layout)) {
    Numbers random(seed + 2);
    edges.resize(cloud.layout, {true, true, true, true});
    for (EdgeLanes<Scalar>* one : {&scratch.weight, &scratch.stiffness, &scratch.damping,
                                   &scratch.inverse, &scratch.multiplier})
      one->resize(cloud.layout, edges.present);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const GridEdgePlace& place = places[i];
      if (i % 23 == 5) continue;  // a missing spring
      const Index at = entry_of(cloud.layout, place.row, place.col);
      PlainEdge edge{place.a, place.b};
      const auto set = [&](EdgeLanes<Scalar>& to, double& value, double low, double high) {
        to.of[place.kind][at] = Scalar(random(low, high));
        value = static_cast<double>(to.of[place.kind][at]);
      };
      set(edges.rest, edge.rest, 0.07, 0.15);
      set(edges.relaxation, edge.relaxation, 0.3, 1.0);
      set(edges.stiffness, edge.stiffness, 1.0, 200.0);
      set(edges.damping, edge.damping, 0.0, 2.0);
      list.push_back(edge);
      const LaneLayout<Scalar>& layout = cloud.layout;
      pass.push_back(2 * layout.local_row(place.row) +
                     (layout.strip == 1 ? layout.lane(place.row) % 2 : 0));
    }
    prepare_edges(edges, Scalar(h), limited, cloud.buffer.data(), scratch);
  }
  template <class Rule>
  Rule sweep(const Rule& rule, SweepOrder order = SweepOrder::Forward) {
    read_ghost_row(cloud.layout, cloud.layout.whole(), start.buffer.data(),
                   start.buffer.data() + cloud.layout.size());
    return sweep_edges(edges, scratch, cloud.buffer.data(), start.buffer.data(), rule, {}, order);
  }

  /// Calls `visit(edge)` for the edges in plain code. A sweep back runs back within each row.
  template <class Visit>
  void for_each_edge(SweepOrder order, const Visit& visit) {
    for (std::size_t begin = 0, end = 0; begin < list.size(); begin = end) {
      while (end < list.size() && pass[end] == pass[begin]) ++end;
      const SweepPlaces in_order(order, begin, end);
      for (std::size_t i = 0; i < in_order.count(); ++i) visit(list[in_order[i]]);
    }
  }
};

template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 1e-4 : 1e-12;

}  // namespace

TEMPLATE_TEST_CASE("lane edges: a rigid sweep is a plain sequential sweep in the order described",
                   "[lane_edges]", float, double, long double) {
  using Scalar = TestType;
  std::vector<LaneCase> cases = lane_cases<Scalar>();
  cases.push_back({7, 6, grid_lanes<Scalar>() == 1 ? 7 : 1});
  if (grid_lanes<Scalar>() > 1) cases.push_back({grid_lanes<Scalar>() + 1, 6, 1});
  if (grid_lanes<Scalar>() > 1) cases.push_back({2 * grid_lanes<Scalar>(), 6, 2});
  unsigned seed = 1;
  for (const LaneCase& size : cases) {
    Grid<Scalar> grid(size, ++seed, true, false, 0.01);
    const std::vector<PlainPoint> before = grid.cloud.points;
    for (int sweep = 0; sweep < 3; ++sweep) {
      const SweepOrder order = alternating(sweep, 3);
      grid.sweep(RigidRule<Scalar, grid_lanes<Scalar>()>{}, order);
      grid.for_each_edge(order,
                         [&](const PlainEdge& edge) { project_rigid(edge, grid.cloud.points); });
      CHECK(grid.cloud.distance() < kSmall<Scalar>);
    }
    double moved = 0;
    for (std::size_t v = 0; v < before.size(); ++v) {
      CHECK(grid.cloud.in_lanes(v).w == before[v].w);
      moved = std::max(moved, (grid.cloud.points[v].at - before[v].at).norm());
      if (before[v].w > 0) continue;
      CHECK(grid.cloud.in_lanes(v).at == before[v].at);
    }
    CHECK(moved > 0.01);
  }
}

TEMPLATE_TEST_CASE("lane edges: compliant sweeps with dampers are plain sequential sweeps",
                   "[lane_edges]", float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = grid_lanes<Scalar>();
  const double h = static_cast<double>(Scalar(0.05));
  unsigned seed = 10;
  for (const LaneCase& size : lane_cases<Scalar>()) {
    Grid<Scalar> grid(size, ++seed, true, false, h);
    const auto plain_sweep = [&](SweepOrder order) {
      grid.for_each_edge(order, [&](PlainEdge& edge) {
        project_compliant(edge, h, grid.start.points, grid.cloud.points);
      });
    };
    grid.sweep(CompliantRule<Scalar, kLanes, true, false, true>{});
    plain_sweep(SweepOrder::Forward);
    CHECK(grid.cloud.distance() < kSmall<Scalar>);
    grid.sweep(CompliantRule<Scalar, kLanes, true, true, true>{}, SweepOrder::Backward);
    plain_sweep(SweepOrder::Backward);
    grid.sweep(CompliantRule<Scalar, kLanes, true, true, false>{});
    plain_sweep(SweepOrder::Forward);
    CHECK(grid.cloud.distance() < 3 * kSmall<Scalar>);
  }
}

TEMPLATE_TEST_CASE("lane edges: sweeps keep the momentum and find the largest stretch",
                   "[lane_edges]", float, double, long double) {
  using Scalar = TestType;
  using Pack = Simd<Scalar, grid_lanes<Scalar>()>;
  unsigned seed = 20;
  for (const LaneCase& size : lane_cases<Scalar>()) {
    Grid<Scalar> grid(size, ++seed, false, true, 0.05);
    // A rule that moves nothing meets every edge as it is.
    double worst = 0;
    for (const PlainEdge& edge : grid.list) {
      const double length = (grid.cloud.points[edge.a].at - grid.cloud.points[edge.b].at).norm();
      worst = std::max(worst, 1.0 - edge.rest / length);
    }
    const TensionRule<Scalar, grid_lanes<Scalar>()> none{Pack::all(Scalar(1000))};
    CHECK(static_cast<double>(grid.sweep(none).worst.largest()) == Approx(worst).epsilon(1e-5));
    CHECK(grid.cloud.distance() == 0.0);

    grid.sweep(
        LimitRule<Scalar, grid_lanes<Scalar>()>{Pack::all(Scalar(0.02)), Pack::all(Scalar(0.1))});
    std::vector<Vector3<double>> moved;
    for (std::size_t v = 0; v < grid.cloud.points.size(); ++v)
      moved.push_back(grid.cloud.in_lanes(v).at - grid.cloud.points[v].at);
    CHECK(grid.cloud.distance() > 0.001);
    CHECK(momenta(grid.cloud.points, moved)[0].norm() <
          (std::is_same_v<Scalar, float> ? 1e-4 : 1e-12));
  }
}

TEMPLATE_TEST_CASE("lane edges: the numbers of a step are those of the formulas", "[lane_edges]",
                   float, double, long double) {
  using Scalar = TestType;
  const double h = static_cast<double>(Scalar(0.05));
  const double small = std::is_same_v<Scalar, float> ? 1e-6 : 2e-15;
  std::vector<LaneCase> cases = lane_cases<Scalar>();
  if (grid_lanes<Scalar>() > 1) cases.push_back({grid_lanes<Scalar>() + 1, 6, 1});
  for (const bool limited : {false, true}) {
    for (const LaneCase& size : cases) {
      Grid<Scalar> grid(size, 33, true, limited, h);
      std::size_t edges = 0, weights = 0;
      for (const GridEdgePlace& place : grid.places) {
        const Index at = entry_of(grid.cloud.layout, place.row, place.col);
        const auto number = [&](const EdgeLanes<Scalar>& list) {
          return static_cast<double>(list.of[place.kind][at]);
        };
        const double relaxation = number(grid.edges.relaxation);
        const double w = grid.cloud.points[place.a].w + grid.cloud.points[place.b].w;
        const double k = h * h * number(grid.edges.stiffness), c = h * number(grid.edges.damping);
        if (relaxation > 0) ++edges;
        CHECK(number(grid.scratch.weight) == Approx(w > 0 ? relaxation / w : 0.0).epsilon(small));
        CHECK(number(grid.scratch.stiffness) ==
              Approx(limited ? k * w / (1 + k * w) : k).epsilon(small));
        CHECK(number(grid.scratch.damping) == Approx(c).epsilon(small));
        CHECK(number(grid.scratch.inverse) == Approx(1 / (1 + (k + c) * w)).epsilon(small));
      }
      CHECK(edges == grid.list.size());
      // No entry but those of edges has a weight.
      for (const VectorX<Scalar>& list : grid.scratch.weight.of)
        weights += static_cast<std::size_t>((list.array() != Scalar(0)).count());
      CHECK(weights <= edges);
    }
  }
}

TEST_CASE("lane edges: kinds that a grid has not take no memory", "[lane_edges]") {
  LaneEdges<double> edges;
  edges.resize(LaneLayout<double>(9, 8, 3, 2), {true, true, false, false});
  CHECK(edges.rest.of[kAlong].size() > 0);
  CHECK(edges.rest.of[kRising].size() == 0);
  CHECK(edges.stiffness.same_size(edges.rest));
  LaneEdges<double> other;
  other.resize(LaneLayout<double>(9, 8, 3, 2), {true, true, true, false});
  CHECK_FALSE(other.rest.same_size(edges.rest));
}
