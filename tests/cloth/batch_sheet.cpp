#include "clothctl/cloth/detail/batch_sheet.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::irregular_sheet;
using clothctl_test::Numbers;
using clothctl_test::PlainEdge;
using clothctl_test::PlainPoint;

namespace {

template <class Scalar>
SpringNetwork<Scalar> network_of(int rows, int cols, unsigned seed) {
  const auto mesh = irregular_sheet(rows, cols, 0.02, 0.2, seed);
  return sheet_network<double>(mesh.positions, mesh.triangles, Material<double>())
      .value()
      .template cast<Scalar>();
}

/// Sets positions and inverse masses in a sheet's memory.
template <class Scalar>
void load(typename BatchSheet<Scalar>::Scratch& memory, const SpringNetwork<Scalar>& network,
          const std::vector<int>& held, unsigned seed, double size) {
  Numbers random(seed);
  for (Index v = 0; v < network.vertex_count(); ++v) {
    for (Index c = 0; c < 3; ++c) {
      memory.points[4 * v + c] = network.rest_positions(c, v) + Scalar(random(-size, size));
      memory.start[4 * v + c] = network.rest_positions(c, v);
    }
    memory.points[4 * v + 3] = Scalar(1) / network.mass[v];
  }
  for (int v : held) memory.points[4 * v + 3] = Scalar(0);
}

template <class Scalar>
std::vector<PlainPoint> plain_points(const VectorX<Scalar>& buffer, Index count) {
  std::vector<PlainPoint> points(static_cast<std::size_t>(count));
  for (Index v = 0; v < count; ++v) {
    PlainPoint& p = points[static_cast<std::size_t>(v)];
    p.at = buffer.template segment<3>(4 * v).template cast<double>();
    p.w = static_cast<double>(buffer[4 * v + 3]);
  }
  return points;
}

template <class Scalar>
double distance(const VectorX<Scalar>& buffer, const std::vector<PlainPoint>& points) {
  double most = 0;
  for (std::size_t v = 0; v < points.size(); ++v)
    most = std::max(most,
                    (buffer.template segment<3>(static_cast<Index>(4 * v)).template cast<double>() -
                     points[v].at)
                        .norm());
  return most;
}

}  // namespace

TEMPLATE_TEST_CASE("batch sheet: a rigid sweep in listed order is that of the network's list",
                   "[batch_sheet]", float, double, long double) {
  using Scalar = TestType;
  SpringNetwork<Scalar> network = network_of<Scalar>(12, 9, 1);
  Numbers random(2);
  random.shuffle(network.springs);
  network.springs[4].stiffness = Scalar(0);  // has no effect
  network.springs[9].stiffness = network.springs[9].damping = Scalar(0);
  BatchSheetSetup<Scalar> setup;
  setup.rigid = setup.listed_order = true;
  for (std::size_t e = 0; e < network.springs.size(); ++e)
    setup.relaxation.push_back(Scalar(random(0.2, 1.0)));
  setup.bend_relaxation = Scalar(0.2);
  const BatchSheet<Scalar> sheet(network, setup);
  auto memory = sheet.make_scratch();
  const std::vector<int> held{0, 17};
  load(memory, network, held, 3, 4e-3);
  sheet.prepare(Scalar(0.01), false, held, memory);
  std::vector<PlainPoint> points = plain_points(memory.points, network.vertex_count());
  for (int sweep = 0; sweep < 2; ++sweep) {
    sheet.sweep(RigidRule<Scalar, BatchSheet<Scalar>::kLanes>{}, SweepOrder::Forward, memory);
    sheet.template bend<false, false>(SweepOrder::Forward, memory);
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      if (!(Scalar(0) < s.stiffness)) continue;
      project_rigid({static_cast<std::size_t>(s.a), static_cast<std::size_t>(s.b),
                     static_cast<double>(s.rest_length), static_cast<double>(setup.relaxation[e])},
                    points);
    }
    for (const BendStencil<Scalar>& bend : network.bends) {
      Vector3<double> error = Vector3<double>::Zero();
      double share = 0;
      for (std::size_t c = 0; c < 4; ++c) {
        const double weight = static_cast<double>(bend.weight[c]);
        const PlainPoint& p = points[static_cast<std::size_t>(bend.vertex[c])];
        error += weight * p.at;
        share += weight * weight * p.w;
      }
      if (!(share > 0)) continue;
      for (std::size_t c = 0; c < 4; ++c) {
        PlainPoint& p = points[static_cast<std::size_t>(bend.vertex[c])];
        p.at -= static_cast<double>(setup.bend_relaxation) * static_cast<double>(bend.weight[c]) *
                p.w / share * error;
      }
    }
    CHECK(distance(memory.points, points) < (std::is_same_v<Scalar, float> ? 2e-6 : 1e-12));
  }
}

TEMPLATE_TEST_CASE("batch sheet: sweeps and levels keep the momentum of a free sheet",
                   "[batch_sheet]", float, double) {
  using Scalar = TestType;
  using Pack = typename BatchSheet<Scalar>::Pack;
  const SpringNetwork<Scalar> network = network_of<Scalar>(34, 30, 4);
  BatchSheetSetup<Scalar> setup;
  setup.limited = true;
  const BatchSheet<Scalar> sheet(network, setup);
  auto memory = sheet.make_scratch();
  load(memory, network, {}, 5, 4e-3);
  sheet.prepare(Scalar(0.005), true, {}, memory);
  const std::vector<PlainPoint> before = plain_points(memory.points, network.vertex_count());
  for (int turn = 0; turn < 3; ++turn) {
    sheet.correct_levels(turn, 3, Scalar(0), PassiveFrame<Scalar>{{}, Scalar(1)}, memory);
    sheet.template bend<false, false>(SweepOrder::Forward, memory);
    sheet.sweep(
        LimitRule<Scalar, BatchSheet<Scalar>::kLanes>{Pack::all(Scalar(0)), Pack::all(Scalar(0.1))},
        SweepOrder::Forward, memory);
  }
  std::vector<Vector3<double>> moved;
  for (std::size_t v = 0; v < before.size(); ++v)
    moved.push_back(
        memory.points.template segment<3>(static_cast<Index>(4 * v)).template cast<double>() -
        before[v].at);
  CHECK(distance(memory.points, before) > 1e-3);
  const double mass = static_cast<double>(network.mass.sum());
  CHECK(momenta(before, moved)[0].norm() / mass < (std::is_same_v<Scalar, float> ? 1e-6 : 1e-14));
}

TEMPLATE_TEST_CASE("batch sheet: nothing moves at rest, with levels and tethers", "[batch_sheet]",
                   float, double) {
  using Scalar = TestType;
  using Pack = typename BatchSheet<Scalar>::Pack;
  const SpringNetwork<Scalar> network = network_of<Scalar>(40, 33, 6);
  for (const std::vector<int>& held : {std::vector<int>{}, {12}, {12, 800}, {1, 2, 3, 4, 5, 6}}) {
    BatchSheetSetup<Scalar> setup;
    setup.limited = true;
    setup.tethered = held;
    const BatchSheet<Scalar> sheet(network, setup);
    auto memory = sheet.make_scratch();
    CHECK(sheet.fits(memory));
    load(memory, network, held, 0, 0.0);
    sheet.prepare(Scalar(0.005), true, held, memory);
    const VectorX<Scalar> before = memory.points;
    for (int turn = 0; turn < 3; ++turn) {
      sheet.correct_levels(turn, 3, Scalar(0), PassiveFrame<Scalar>{{}, Scalar(1)}, memory);
      sheet.template bend<false, false>(SweepOrder::Forward, memory);
      const auto rule =
          sheet.sweep(LimitRule<Scalar, BatchSheet<Scalar>::kLanes>{Pack::all(Scalar(0)),
                                                                    Pack::all(Scalar(0.1))},
                      SweepOrder::Forward, memory);
      CHECK(rule.worst.largest() < Scalar(std::is_same_v<Scalar, float> ? 2e-4 : 1e-12));
    }
    CHECK((memory.points - before).cwiseAbs().maxCoeff() <
          Scalar(std::is_same_v<Scalar, float> ? 1e-5 : 1e-12));
  }
}

TEMPLATE_TEST_CASE("batch sheet: held vertices never move", "[batch_sheet]", float, double,
                   long double) {
  using Scalar = TestType;
  using Pack = typename BatchSheet<Scalar>::Pack;
  const SpringNetwork<Scalar> network = network_of<Scalar>(34, 30, 7);
  BatchSheetSetup<Scalar> setup;
  setup.limited = true;
  setup.tethered = {3, 90};
  const BatchSheet<Scalar> sheet(network, setup);
  auto memory = sheet.make_scratch();
  const std::vector<int> held{3, 90, 511, 700};
  load(memory, network, held, 8, 8e-3);
  sheet.prepare(Scalar(0.005), true, held, memory);
  const VectorX<Scalar> before = memory.points;
  sheet.predict(Scalar(1), Vector3<Scalar>::Constant(Scalar(0.01)), memory);
  for (int turn = 0; turn < 2; ++turn) {
    sheet.correct_levels(turn, 3, Scalar(0), PassiveFrame<Scalar>{{}, Scalar(1)}, memory);
    sheet.template bend<false, false>(SweepOrder::Forward, memory);
    sheet.sweep(
        LimitRule<Scalar, BatchSheet<Scalar>::kLanes>{Pack::all(Scalar(0)), Pack::all(Scalar(0.1))},
        SweepOrder::Forward, memory);
  }
  CHECK((memory.points - before).cwiseAbs().maxCoeff() > Scalar(0.005));
  for (int v : held)
    CHECK(memory.points.template segment<4>(4 * v) == before.template segment<4>(4 * v));
  // Nor do the spare vertices.
  CHECK(memory.points.template tail<8>() == before.template tail<8>());
}

TEST_CASE("batch sheet: what it is damped by, and scratch of another sheet", "[batch_sheet]") {
  SpringNetwork<double> network = network_of<double>(30, 30, 9);
  BatchSheetSetup<double> limited;
  limited.limited = true;
  const BatchSheet<double> plain(network, {}), with_levels(network, limited);
  CHECK(plain.damped());
  CHECK(plain.fits(plain.make_scratch()));
  CHECK_FALSE(plain.fits(with_levels.make_scratch()));
  CHECK_FALSE(with_levels.fits(plain.make_scratch()));
  CHECK_FALSE(plain.fits(BatchSheet<double>::Scratch{}));
  for (Spring<double>& s : network.springs) s.damping = 0;
  CHECK_FALSE(BatchSheet<double>(network, {}).damped());
}
