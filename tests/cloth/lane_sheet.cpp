#include "clothctl/cloth/detail/lane_sheet.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <type_traits>
#include <vector>

#include "clothctl/cloth/detail/batch_sheet.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::kSanitized;
using clothctl_test::Numbers;

namespace {

template <class Scalar>
SpringNetwork<Scalar> network_of(int rows, int cols) {
  const GridMesh<Scalar> mesh = make_grid<Scalar>(rows, cols, Scalar(0.4), Scalar(0.5)).value();
  SpringNetwork<Scalar> network = sheet_network<Scalar>(mesh, Material<Scalar>()).value();
  // No spring and no vertex like another.
  Numbers random(6);
  for (Spring<Scalar>& s : network.springs) s.stiffness *= Scalar(random(0.5, 2.0));
  for (BendStencil<Scalar>& s : network.bends) s.stiffness *= Scalar(random(0.5, 2.0));
  for (Index v = 0; v < network.mass.size(); ++v) network.mass[v] *= Scalar(random(0.5, 2.0));
  return network;
}

/// Writes a state into a sheet's memory: positions, and positions one substep before.
template <class Scalar, class Sheet>
void load(const Sheet& sheet, typename Sheet::Scratch& memory, const Points<Scalar>& now,
          const Points<Scalar>& before, const VectorX<Scalar>& w) {
  for (int v = 0; v < static_cast<int>(now.cols()); ++v) {
    for (std::size_t c = 0; c < 4; ++c) {
      const Index at = static_cast<Index>(sheet.offset(v) + c * Sheet::kStride);
      memory.points[at] = c < 3 ? now(static_cast<Index>(c), v) : w[v];
      memory.start[at] = c < 3 ? before(static_cast<Index>(c), v) : w[v];
    }
  }
}

template <class Scalar, class Sheet>
Points<Scalar> unload(const Sheet& sheet, const typename Sheet::Scratch& memory, Index count) {
  Points<Scalar> out(3, count);
  for (int v = 0; v < static_cast<int>(count); ++v) {
    for (std::size_t c = 0; c < 3; ++c)
      out(static_cast<Index>(c), v) =
          memory.points[static_cast<Index>(sheet.offset(v) + c * Sheet::kStride)];
  }
  return out;
}

/// A substep of XPBD with many sweeps, which both layouts converge to.
template <class Scalar, class Sheet>
void substep(const Sheet& sheet, typename Sheet::Scratch& memory, Scalar h,
             const std::vector<int>& held, int sweeps) {
  sheet.prepare(h, false, held, memory);
  sheet.predict(Scalar(1), Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81) * h * h), memory);
  constexpr int kLanes = Sheet::kLanes;
  sheet.sweep(CompliantRule<Scalar, kLanes, true, false, true>{}, SweepOrder::Forward, memory);
  sheet.template bend<false, true>(SweepOrder::Forward, memory);
  for (int i = 1; i < sweeps; ++i) {
    sheet.sweep(CompliantRule<Scalar, kLanes, true, true, true>{}, SweepOrder::Forward, memory);
    sheet.template bend<true, true>(SweepOrder::Forward, memory);
  }
}

template <class Scalar>
Points<Scalar> shaken(const Points<Scalar>& points, unsigned seed, double size) {
  Numbers random(seed);
  Points<Scalar> out = points;
  for (Index i = 0; i < out.size(); ++i) out(i) += Scalar(random(-size, size));
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("lane sheet: every vertex has its own place and keeps its rest position",
                   "[lane_sheet]", float, double, long double) {
  using Scalar = TestType;
  for (const auto& [rows, cols] :
       std::vector<std::array<int, 2>>{{8, 8}, {33, 33}, {24, 17}, {17, 24}, {65, 40}, {50, 9}}) {
    const SpringNetwork<Scalar> network = network_of<Scalar>(rows, cols);
    for (const bool limited : {false, true}) {
      const LaneSheet<Scalar> sheet(network, *find_grid(network), limited);
      auto memory = sheet.make_scratch();
      CHECK(sheet.fits(memory));
      CHECK(sheet.damped());
      std::set<std::size_t> places;
      for (int v = 0; v < rows * cols; ++v) places.insert(sheet.offset(v));
      CHECK(places.size() == static_cast<std::size_t>(rows * cols));
      CHECK(unload<Scalar>(sheet, memory, rows * cols) == network.rest_positions);
      CHECK(memory.points[static_cast<Index>(sheet.offset(5) + 3 * sheet.kStride)] ==
            Scalar(1) / network.mass[5]);
    }
  }
}

TEMPLATE_TEST_CASE("lane sheet: both layouts converge to the same substep", "[lane_sheet]", double,
                   long double) {
  using Scalar = TestType;
  for (const auto& [rows, cols] :
       std::vector<std::array<int, 2>>{{9, 9}, {12, 17}, {26, 8}, {8, 33}}) {
    if (kSanitized && rows * cols > 100) continue;
    const SpringNetwork<Scalar> network = network_of<Scalar>(rows, cols);
    const LaneSheet<Scalar> lanes(network, *find_grid(network), false);
    const BatchSheet<Scalar> batches(network, {});
    auto a = lanes.make_scratch();
    auto b = batches.make_scratch();
    const std::vector<int> held{0, cols - 1};
    VectorX<Scalar> w = network.mass.cwiseInverse();
    for (int v : held) w[v] = Scalar(0);
    const Points<Scalar> now = shaken(network.rest_positions, 1, 2e-5);
    const Points<Scalar> before = shaken(now, 2, 1e-5);
    load(lanes, a, now, before, w);
    load(batches, b, now, before, w);
    const Scalar h = Scalar(0.001);
    substep(lanes, a, h, held, 400);
    substep(batches, b, h, held, 400);
    const Points<Scalar> p = unload<Scalar>(lanes, a, now.cols()),
                         q = unload<Scalar>(batches, b, now.cols());
    // The directions in which springs act change during the sweeps, so both differ by the square of
    // the displacements.
    CHECK(static_cast<double>((p - now).cwiseAbs().maxCoeff()) > 1e-5);
    CHECK(static_cast<double>((p - q).cwiseAbs().maxCoeff()) < 1e-8);
    for (int v : held) {
      CHECK(p.col(v) == now.col(v));
      CHECK(q.col(v) == now.col(v));
    }
  }
}

TEMPLATE_TEST_CASE("lane sheet: prediction is that of the formula, in both layouts", "[lane_sheet]",
                   float, double) {
  using Scalar = TestType;
  const SpringNetwork<Scalar> network = network_of<Scalar>(17, 10);
  const Index n = network.vertex_count();
  const Points<Scalar> now = shaken(network.rest_positions, 3, 0.01),
                       before = shaken(now, 4, 0.001);
  VectorX<Scalar> w = network.mass.cwiseInverse();
  for (int v : {0, 50, 169}) w[v] = Scalar(0);
  const Vector3<Scalar> push(Scalar(0.001), Scalar(-0.002), Scalar(0.003));
  const auto check = [&](const auto& sheet) {
    auto memory = sheet.make_scratch();
    load(sheet, memory, now, before, w);
    sheet.predict(Scalar(0.9), push, memory);
    const Points<Scalar> found = unload<Scalar>(sheet, memory, n);
    std::swap(memory.points, memory.start);
    CHECK(unload<Scalar>(sheet, memory, n) == now);  // the start of the substep
    for (Index v = 0; v < n; ++v) {
      const Vector3<Scalar> expected =
          now.col(v) + (w[v] > Scalar(0)
                            ? Vector3<Scalar>(Scalar(0.9) * (now.col(v) - before.col(v)) + push)
                            : Vector3<Scalar>(Vector3<Scalar>::Zero()));
      CHECK((found.col(v) - expected).norm() < Scalar(1e-6));
    }
  };
  check(LaneSheet<Scalar>(network, *find_grid(network), false));
  check(BatchSheet<Scalar>(network, {}));
}

TEMPLATE_TEST_CASE("lane sheet: nothing moves at rest, with levels and without", "[lane_sheet]",
                   float, double) {
  using Scalar = TestType;
  using Pack = typename LaneSheet<Scalar>::Pack;
  for (const auto& [rows, cols] : std::vector<std::array<int, 2>>{{33, 33}, {40, 70}, {20, 11}}) {
    const SpringNetwork<Scalar> network = network_of<Scalar>(rows, cols);
    const LaneSheet<Scalar> sheet(network, *find_grid(network), true);
    auto memory = sheet.make_scratch();
    for (const std::vector<int>& held : {std::vector<int>{}, {0, cols - 1}, {cols + 3}}) {
      VectorX<Scalar> w = network.mass.cwiseInverse();
      for (int v : held) w[v] = Scalar(0);
      load(sheet, memory, network.rest_positions, network.rest_positions, w);
      sheet.prepare(Scalar(0.005), true, held, memory);
      for (int turn = 0; turn < 3; ++turn) {
        sheet.correct_levels(turn, 3, Scalar(0), PassiveFrame<Scalar>{{}, Scalar(1)}, memory);
        sheet.template bend<false, false>(SweepOrder::Forward, memory);
        const auto rule =
            sheet.sweep(LimitRule<Scalar, LaneSheet<Scalar>::kLanes>{Pack::all(Scalar(0)),
                                                                     Pack::all(Scalar(0.1))},
                        SweepOrder::Forward, memory);
        CHECK(rule.worst.largest() < Scalar(std::is_same_v<Scalar, float> ? 2e-4 : 1e-12));
      }
      const Points<Scalar> found = unload<Scalar>(sheet, memory, network.vertex_count());
      CHECK((found - network.rest_positions).cwiseAbs().maxCoeff() <
            Scalar(std::is_same_v<Scalar, float> ? 1e-5 : 1e-13));
    }
  }
}

TEST_CASE("lane sheet: the number of levels follows the longer side", "[lane_sheet]") {
  CHECK(level_count(9, 9) == 0);
  CHECK(level_count(12, 9) == 1);
  CHECK(level_count(17, 17) == 1);
  CHECK(level_count(33, 33) == 1);
  CHECK(level_count(9, 40) == 2);
  CHECK(level_count(65, 65) == 2);
  CHECK(level_count(129, 129) == 3);
}

TEST_CASE("lane sheet: scratch of another sheet does not fit", "[lane_sheet]") {
  const auto make = [](int rows, int cols, bool limited) {
    const SpringNetwork<double> network = network_of<double>(rows, cols);
    return LaneSheet<double>(network, *find_grid(network), limited);
  };
  const auto a = make(33, 33, false), b = make(33, 33, true), c = make(33, 32, false);
  CHECK(a.fits(a.make_scratch()));
  CHECK(b.fits(b.make_scratch()));
  CHECK_FALSE(a.fits(c.make_scratch()));
  CHECK_FALSE(b.fits(a.make_scratch()));
  CHECK_FALSE(a.fits(LaneSheet<double>::Scratch{}));
}
