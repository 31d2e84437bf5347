#include "clothctl/cloth/detail/edge_batches.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;
using clothctl_test::PlainEdge;
using clothctl_test::PlainPoint;

namespace {

/// Random pairs of vertices, as edges of a mesh without structure.
std::vector<std::array<int, 2>> random_pairs(int vertices, int count, unsigned seed) {
  Numbers random(seed);
  std::vector<std::array<int, 2>> pairs;
  while (static_cast<int>(pairs.size()) < count) {
    const int a = random.below(vertices);
    // Mostly near vertices, as in a mesh; sometimes any.
    const int b = random.below(4) == 0 ? random.below(vertices)
                                       : std::min(vertices - 1, a + 1 + random.below(8));
    if (a != b) pairs.push_back({a, b});
  }
  return pairs;
}

/// For each item, the batch that holds it; every item must be there once.
std::vector<int> batch_of_items(const std::vector<int>& slots, std::size_t items, int lanes) {
  std::vector<int> batch(items, -1);
  REQUIRE(slots.size() % static_cast<std::size_t>(lanes) == 0);
  for (std::size_t i = 0; i < slots.size(); ++i) {
    if (slots[i] < 0) continue;
    int& place = batch[static_cast<std::size_t>(slots[i])];
    REQUIRE(place == -1);
    place = static_cast<int>(i) / lanes;
  }
  for (int place : batch) REQUIRE(place >= 0);
  return batch;
}

/// A random network packed for sweeps, and the same in plain code.
template <class Scalar>
struct Mesh {
  static constexpr int kVertices = 60;
  std::vector<PlainPoint> points, start;
  std::vector<PlainEdge> list;
  EdgeBatches<Scalar> packed;
  EdgeBatchScratch<Scalar> scratch;
  VectorX<Scalar> buffer, start_buffer;

  Mesh(unsigned seed, const PackOrder& order, bool held, bool limited, double h,
       bool disjoint = false) {
    Numbers random(seed);
    points.resize(kVertices);
    for (PlainPoint& p : points) {
      for (Index c = 0; c < 3; ++c) p.at[c] = static_cast<double>(Scalar(random(-1, 1)));
      p.w = static_cast<double>(Scalar(held && random.below(5) == 0 ? 0.0 : random(0.2, 3.0)));
    }
    start = points;
    for (PlainPoint& p : start) {
      for (Index c = 0; c < 3; ++c)
        p.at[c] = static_cast<double>(Scalar(p.at[c] + random(-.1, .1)));
    }
    std::vector<ListedEdge<Scalar>> listed;
    std::vector<std::array<int, 2>> pairs = random_pairs(kVertices, 150, seed + 1);
    if (disjoint) {
      pairs.clear();
      for (int v = 0; v < kVertices; v += 2) pairs.push_back({v, v + 1});
    }
    for (const auto& [a, b] : pairs) {
      const ListedEdge<Scalar> edge{a,
                                    b,
                                    Scalar(random(0.2, 1.0)),
                                    Scalar(random(0.3, 1.0)),
                                    Scalar(random(1.0, 200.0)),
                                    Scalar(random(0.0, 2.0))};
      listed.push_back(edge);
      list.push_back({static_cast<std::size_t>(a), static_cast<std::size_t>(b),
                      static_cast<double>(edge.rest), static_cast<double>(edge.relaxation),
                      static_cast<double>(edge.stiffness), static_cast<double>(edge.damping)});
    }
    packed = pack_edges(listed, order, kVertices);
    scratch.resize(static_cast<Index>(packed.size()));
    buffer = pack(points);
    start_buffer = pack(start);
    prepare_edges(packed, Scalar(h), limited, buffer.data(), scratch);
  }
  static VectorX<Scalar> pack(const std::vector<PlainPoint>& from) {
    VectorX<Scalar> out = VectorX<Scalar>::Zero(4 * (kVertices + 2));
    for (std::size_t v = 0; v < from.size(); ++v) {
      for (Index c = 0; c < 3; ++c) out[static_cast<Index>(4 * v) + c] = Scalar(from[v].at[c]);
      out[static_cast<Index>(4 * v) + 3] = Scalar(from[v].w);
    }
    out[4 * kVertices + 4] = Scalar(1);
    return out;
  }
  /// The edges in the order of the batches.
  std::vector<PlainEdge> batch_order() const {
    std::vector<PlainEdge> out;
    for (std::size_t i = 0; i < packed.size(); ++i) {
      const Index at = static_cast<Index>(i);
      if (packed.first[i] == 4 * kVertices) continue;
      out.push_back(
          {static_cast<std::size_t>(packed.first[i] / 4),
           static_cast<std::size_t>(packed.second[i] / 4), static_cast<double>(packed.rest[at]),
           static_cast<double>(packed.relaxation[at]), static_cast<double>(packed.stiffness[at]),
           static_cast<double>(packed.damping[at])});
    }
    return out;
  }
  template <class Rule>
  Rule sweep(const Rule& rule, SweepOrder order = SweepOrder::Forward) {
    return sweep_edges(packed, scratch, buffer.data(), start_buffer.data(), rule, {}, order);
  }
  /// The largest distance between the buffer and points in plain code.
  double distance(const std::vector<PlainPoint>& other) const {
    double most = 0;
    for (std::size_t v = 0; v < other.size(); ++v) {
      const Vector3<double> p =
          buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>();
      most = std::max(most, (p - other[v].at).norm());
    }
    return most;
  }
};

template <class Scalar>
constexpr double kSmall = std::is_same_v<Scalar, float> ? 2e-4 : 1e-11;

}  // namespace

TEST_CASE("edge batches: every item once, no vertex twice in a batch, and the order kept",
          "[edge_batches]") {
  for (unsigned seed = 0; seed < 12; ++seed) {
    const int vertices = seed < 4 ? 12 : 300, count = 40 + 80 * static_cast<int>(seed);
    const auto pairs = random_pairs(vertices, count, seed);
    for (const int lanes : {1, 8, 16}) {
      for (const PackOrder& order :
           {PackOrder{1, 0}, PackOrder{2, 0}, PackOrder{3, 256}, PackOrder{1, 8}}) {
        const auto slots = pack_items(pairs.size(), static_cast<std::size_t>(vertices), lanes,
                                      order, [&](std::size_t i) { return pairs[i]; });
        const std::vector<int> batch = batch_of_items(slots, pairs.size(), lanes);
        for (std::size_t i = 0; i < pairs.size(); ++i) {
          for (std::size_t j = 0; j < i; ++j) {
            const bool shared = pairs[i][0] == pairs[j][0] || pairs[i][0] == pairs[j][1] ||
                                pairs[i][1] == pairs[j][0] || pairs[i][1] == pairs[j][1];
            if (!shared) continue;
            const int apart = batch[i] - batch[j];
            // j comes first in the list.
            if (order.window == 0 && apart < static_cast<int>(order.distance)) FAIL(i << " " << j);
            if (std::abs(apart) < static_cast<int>(order.distance)) FAIL(i << " " << j);
          }
        }
      }
    }
  }
}

TEST_CASE("edge batches: an item waits no longer than the window allows", "[edge_batches]") {
  // A long chain leaves one item a batch in its order; any order fills the batches.
  std::vector<std::array<int, 2>> chain;
  for (int v = 0; v < 256; ++v) chain.push_back({v, v + 1});
  const auto corners = [&](std::size_t i) { return chain[i]; };
  const auto listed = pack_items(chain.size(), 257, 8, PackOrder{1, 0}, corners);
  CHECK(listed.size() == 256 * 8);
  const auto free = pack_items(chain.size(), 257, 8, PackOrder{1, 256}, corners);
  CHECK(free.size() <= 40 * 8);
  batch_of_items(free, chain.size(), 8);
  // Items without common vertices need no padding but at the end.
  std::vector<std::array<int, 2>> apart;
  for (int v = 0; v < 83; ++v) apart.push_back({2 * v, 2 * v + 1});
  const auto full =
      pack_items(apart.size(), 166, 8, PackOrder{3, 256}, [&](std::size_t i) { return apart[i]; });
  CHECK(full.size() == 88);
  CHECK(pack_items(0, 5, 8, PackOrder{}, corners).empty());
}

TEMPLATE_TEST_CASE("edge batches: a sweep in listed order is a plain sequential sweep",
                   "[edge_batches]", float, double, long double) {
  using Scalar = TestType;
  for (unsigned seed = 0; seed < 5; ++seed) {
    Mesh<Scalar> mesh(seed, {1, 0}, true, false, 0.01);
    const auto spare = mesh.buffer.template tail<8>().eval();
    for (int sweep = 0; sweep < 2; ++sweep) {
      mesh.sweep(RigidRule<Scalar, batch_lanes<Scalar>()>{});
      for (const PlainEdge& edge : mesh.list) project_rigid(edge, mesh.points);
      CHECK(mesh.distance(mesh.points) < kSmall<Scalar>);
    }
    CHECK(mesh.buffer.template tail<8>() == spare);
    // Held vertices and inverse masses have the same bits.
    const VectorX<Scalar> before = mesh.pack(mesh.start);
    for (Index v = 0; v < Mesh<Scalar>::kVertices; ++v) {
      CHECK(mesh.buffer[4 * v + 3] == before[4 * v + 3]);
      if (mesh.points[static_cast<std::size_t>(v)].w > 0.0) continue;
      for (Index c = 0; c < 3; ++c)
        CHECK(static_cast<double>(mesh.buffer[4 * v + c]) ==
              mesh.points[static_cast<std::size_t>(v)].at[c]);
    }
  }
}

TEMPLATE_TEST_CASE("edge batches: compliant sweeps with dampers are plain sweeps in batch order",
                   "[edge_batches]", float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = batch_lanes<Scalar>();
  for (unsigned seed = 0; seed < 5; ++seed) {
    const double h = static_cast<double>(Scalar(0.05));
    Mesh<Scalar> mesh(seed, {3, 256}, true, false, h);
    std::vector<PlainEdge> order = mesh.batch_order();
    REQUIRE(order.size() == mesh.list.size());
    mesh.sweep(CompliantRule<Scalar, kLanes, true, false, true>{});
    for (PlainEdge& edge : order) project_compliant(edge, h, mesh.start, mesh.points);
    CHECK(mesh.distance(mesh.points) < kSmall<Scalar>);
    mesh.sweep(CompliantRule<Scalar, kLanes, true, true, true>{}, SweepOrder::Backward);
    const SweepPlaces back(SweepOrder::Backward, 0, order.size());
    for (std::size_t i = 0; i < back.count(); ++i)
      project_compliant(order[back[i]], h, mesh.start, mesh.points);
    mesh.sweep(CompliantRule<Scalar, kLanes, true, true, false>{});
    for (PlainEdge& edge : order) project_compliant(edge, h, mesh.start, mesh.points);
    CHECK(mesh.distance(mesh.points) < kSmall<Scalar>);
  }
}

TEMPLATE_TEST_CASE("edge batches: sweeps of all rules keep linear and angular momentum",
                   "[edge_batches]", float, double, long double) {
  using Scalar = TestType;
  constexpr int kLanes = batch_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  // The torques of several corrections of a vertex are about different points, so edges without
  // common vertices show the angular momentum.
  for (const auto& [limited, disjoint] :
       {std::pair{false, false}, {false, true}, {true, false}, {true, true}}) {
    Mesh<Scalar> mesh(9, {3, 256}, false, limited, 0.1, disjoint);
    for (int sweep = 0; sweep < 3; ++sweep) {
      if (limited) {
        mesh.sweep(LimitRule<Scalar, kLanes>{Pack::all(Scalar(0.02)), Pack::all(Scalar(0.1))});
        mesh.sweep(TensionRule<Scalar, kLanes>{Pack::all(Scalar(0.01)), Pack::all(Scalar(1.7))});
      } else {
        mesh.sweep(RigidRule<Scalar, kLanes>{});
        mesh.sweep(CompliantRule<Scalar, kLanes, false, false, true>{});
      }
    }
    std::vector<Vector3<double>> moved(mesh.points.size());
    double most = 0;
    for (std::size_t v = 0; v < moved.size(); ++v) {
      moved[v] =
          mesh.buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>() -
          mesh.points[v].at;
      most = std::max(most, moved[v].norm());
    }
    CHECK(most > 0.1);
    const auto [linear, angular] = momenta(mesh.points, moved);
    const double small = std::is_same_v<Scalar, float> ? 1e-4 : 1e-12;
    CHECK(linear.norm() < small);
    if (disjoint) CHECK(angular.norm() < small);
  }
}

TEMPLATE_TEST_CASE("edge batches: the numbers of a step are those of the formulas",
                   "[edge_batches]", float, double, long double) {
  using Scalar = TestType;
  const Scalar h = Scalar(0.05);
  for (const bool limited : {false, true}) {
    Mesh<Scalar> mesh(4, {3, 256}, true, limited, static_cast<double>(h));
    std::size_t edges = 0;
    for (std::size_t i = 0; i < mesh.packed.size(); ++i) {
      const Index at = static_cast<Index>(i);
      const Scalar w =
          mesh.buffer[mesh.packed.first[i] + 3] + mesh.buffer[mesh.packed.second[i] + 3];
      const Scalar k = h * h * mesh.packed.stiffness[at], c = h * mesh.packed.damping[at];
      const bool padding = mesh.packed.first[i] == 4 * Mesh<Scalar>::kVertices;
      edges += padding ? 0 : 1;
      const double small = std::is_same_v<Scalar, float> ? 1e-6 : 2e-15;
      const auto same = [&](const Scalar& found, const Scalar& expected) {
        CHECK(static_cast<double>(found) == Approx(static_cast<double>(expected)).epsilon(small));
      };
      same(mesh.scratch.weight[at],
           w > Scalar(0) && !padding ? mesh.packed.relaxation[at] / w : Scalar(0));
      same(mesh.scratch.stiffness[at], limited ? k * w / (Scalar(1) + k * w) : k);
      same(mesh.scratch.damping[at], c);
      same(mesh.scratch.inverse[at], Scalar(1) / (Scalar(1) + (k + c) * w));
    }
    CHECK(edges == mesh.list.size());
  }
}
