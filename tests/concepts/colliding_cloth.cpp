// A foreign sheet satisfies CollidingCloth by traits alone and lives in a World. For other types
// the concept is false instead of a compile error.

#include "clothctl/concepts/colliding_cloth.hpp"

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/sim/world.hpp"
#include "laws/colliding_cloth_laws.hpp"
#include "support/catch.hpp"
#include "support/sheet_on_obstacles.hpp"

namespace other_engine {

// Another engine's net of equal beads on threads of fixed length, with its own numbers.
struct Net {
  std::vector<std::array<double, 3>> knots;
  std::vector<std::array<int, 3>> faces;
  std::vector<std::array<int, 2>> threads;
  std::vector<double> lengths;
  std::vector<int> nails;  // knots that stay
  double bead = 0.01;      // kg
  int rounds = 30;
};
// Where the knots were before the step.
struct Scratch {
  clothctl::Points<double> start;
};

}  // namespace other_engine

namespace clothctl {

template <>
struct cloth_traits<other_engine::Net> {
  using Net = other_engine::Net;
  using Scratch = other_engine::Scratch;
  static Index vertex_count(const Net& net) { return static_cast<Index>(net.knots.size()); }
  static ClothState<double> rest_state(const Net& net) {
    ClothState<double> state{Points<double>(3, vertex_count(net)),
                             Points<double>::Zero(3, vertex_count(net))};
    for (std::size_t i = 0; i < net.knots.size(); ++i)
      for (std::size_t c = 0; c < 3; ++c)
        state.positions(static_cast<Index>(c), static_cast<Index>(i)) = net.knots[i][c];
    return state;
  }
  static Scratch make_workspace(const Net& net) {
    return {Points<double>::Zero(3, vertex_count(net))};
  }
  static StepReport<double> step(const Net& net, ClothState<double>& state,
                                 const ClothInput<double>&, double h, Scratch& ws) {
    return advance(net, state, h, ws, [] {});
  }
  // Predicts positions, shortens the threads, calls `collide`, and takes velocities from positions.
  template <class Collide>
  static StepReport<double> advance(const Net& net, ClothState<double>& state, double h,
                                    Scratch& ws, Collide collide) {
    if (!(h > 0)) return {StepStatus::InvalidInput, false, 0.0, 0};
    ws.start = state.positions;
    state.velocities.row(2).array() -= 9.81 * h;
    state.positions += h * state.velocities;
    const auto stay = [&] {
      for (const int v : net.nails) state.positions.col(v) = ws.start.col(v);
    };
    stay();
    for (int round = 0; round < net.rounds; ++round) {
      for (std::size_t e = 0; e < net.threads.size(); ++e) {
        const auto [a, b] = net.threads[e];
        const Vector3<double> d = state.positions.col(b) - state.positions.col(a);
        const double length = d.norm();
        if (length <= net.lengths[e]) continue;  // threads do not push
        const Vector3<double> move = 0.5 * (length - net.lengths[e]) / length * d;
        state.positions.col(a) += move;
        state.positions.col(b) -= move;
      }
      stay();
    }
    collide();
    state.velocities = (state.positions - ws.start) / h;
    return {StepStatus::Converged, true, 0.0, net.rounds};
  }
};

template <>
struct colliding_cloth_traits<other_engine::Net> {
  using Net = other_engine::Net;
  using Base = cloth_traits<Net>;
  static other_engine::Scratch make_workspace(const Net& net, Index) {
    return Base::make_workspace(net);
  }
  static StepReport<double> step(const Net& net, ClothState<double>& state,
                                 const ClothInput<double>&, ObstacleContacts<double>& contacts,
                                 double h, other_engine::Scratch& ws) {
    return Base::advance(net, state, h, ws, [&] {
      for (ObstacleContact<double>& c : contacts.contacts()) {
        c.impulse.setZero();
        c.state = ContactState::Open;
        push_out(net, c, contacts.settings().thickness, h, ws.start, state.positions);
        if (c.state == ContactState::Open) continue;
        ++c.age;
        ++contacts.report().closed;
        contacts.report().slipping += c.state == ContactState::Slip;
      }
    });
  }
  // Moves the knots that carry a contact out of the obstacle, and back along it within the cone.
  static void push_out(const Net& net, ObstacleContact<double>& c, double thickness, double h,
                       const Points<double>& before, Points<double>& x) {
    const SurfacePoint<double>& there = c.point.surface;
    const Vector3<double>& n = there.normal;
    Vector3<double> now = Vector3<double>::Zero(), start = now;
    double weights = 0;
    for (Index k = 0; k < c.point.vertex_count(); ++k) {
      const int v = c.point.vertex[static_cast<std::size_t>(k)];
      now += c.point.weight[k] * x.col(v);
      start += c.point.weight[k] * before.col(v);
      weights += c.point.weight[k] * c.point.weight[k];
    }
    const double depth = thickness - c.point.slack - n.dot(now - there.point - h * there.velocity);
    if (depth <= 0) return;
    Vector3<double> slide = now - start - h * there.velocity;
    slide -= n.dot(slide) * n;
    const double most = there.friction * depth, way = slide.norm();
    c.state = way <= most ? ContactState::Stick : ContactState::Slip;
    const Vector3<double> move = depth * n - (way <= most ? 1.0 : most / way) * slide;
    for (Index k = 0; k < c.point.vertex_count(); ++k)
      x.col(c.point.vertex[static_cast<std::size_t>(k)]) += c.point.weight[k] / weights * move;
    c.impulse = net.bead / (weights * h) * move;
  }
  static VectorX<double> masses(const Net& net) {
    return VectorX<double>::Constant(Base::vertex_count(net), net.bead);
  }
  static std::vector<std::array<int, 3>> triangles(const Net& net) { return net.faces; }
  static std::vector<int> pinned(const Net& net) { return net.nails; }
};

}  // namespace clothctl

using namespace clothctl;
using clothctl_test::CollidingClothLaws;
using clothctl_test::level_sheet;

namespace {

other_engine::Net make_net(int n) {
  const SpringNetwork<double> sheet = level_sheet<double>(n);
  other_engine::Net net;
  for (Index v = 0; v < sheet.vertex_count(); ++v) {
    const Vector3<double> x = sheet.rest_positions.col(v);
    net.knots.push_back({x[0], x[1], x[2]});
  }
  net.faces = sheet.triangles;
  for (const Spring<double>& s : sheet.springs) {
    if (s.kind != SpringKind::Structural) continue;
    net.threads.push_back({s.a, s.b});
    net.lengths.push_back(s.rest_length);
  }
  return net;
}

// A model without contacts.
struct Ghost {
  Index vertex_count() const { return 1; }
  ClothState<double> rest_state() const { return {}; }
  int make_workspace() const { return 0; }
  StepReport<double> step(ClothState<double>&, const ClothInput<double>&, double, int&) const {
    return {};
  }
};
// The net, with masses that the test gives.
struct Wrong : other_engine::Net {
  VectorX<double> told;
};

}  // namespace

namespace clothctl {

template <>
struct cloth_traits<Wrong> : cloth_traits<other_engine::Net> {};
template <>
struct colliding_cloth_traits<Wrong> : colliding_cloth_traits<other_engine::Net> {
  static VectorX<double> masses(const Wrong& wrong) { return wrong.told; }
};

}  // namespace clothctl

static_assert(CollidingCloth<other_engine::Net, ObstacleContacts<double>>);
static_assert(!CollidingCloth<other_engine::Net, ObstacleContacts<float>, float>);
static_assert(ClothModel<Ghost> && !CollidingCloth<Ghost, ObstacleContacts<double>>);
static_assert(CollidingCloth<MassSpring<double>, ObstacleContacts<double>> &&
              CollidingCloth<PositionBased<float>, ObstacleContacts<float>, float>);
static_assert(!CollidingCloth<std::string, ObstacleContacts<double>>);

TEST_CASE("a foreign net obeys the laws of sheets that collide", "[concepts]") {
  CollidingClothLaws<double> laws;
  laws.momentum = 1e-10;
  laws.depth = 1e-4;
  clothctl_test::check_colliding_cloth_laws<other_engine::Net, double>(make_net(6), laws,
                                                                       {0, 0, -9.81});
}

TEST_CASE("the library's models obey the laws of sheets that collide", "[concepts]") {
  const SpringNetwork<double> sheet = level_sheet<double>(6);
  CollidingClothLaws<double> laws;
  laws.momentum = 1e-7;
  clothctl_test::check_colliding_cloth_laws<MassSpring<double>, double>(
      MassSpring<double>::create(sheet).value(), laws, {0, 0, -9.81});
  clothctl_test::check_colliding_cloth_laws<PositionBased<double>, double>(
      PositionBased<double>::create(sheet).value(), laws, {0, 0, -9.81});
}

TEST_CASE("a foreign net hangs from its nails over a ball in a world", "[concepts]") {
  other_engine::Net net = make_net(9);
  net.nails = {0, 8};
  World<double> world;
  ColliderSurface<double> surface;
  surface.friction = 0.5;
  const auto ball = SphereCollider<double>::create({0, 0, -0.1}, 0.08).value();
  REQUIRE(world.add_obstacle(ball, {}, surface).has_value());
  WorldSheetSetup<double> setup;
  setup.meets_sheets = true;
  const ClothState<double> rest = cloth_traits<other_engine::Net>::rest_state(net);
  const int sheet = world.add_sheet(net, rest, setup).value();
  int touching = 0;
  for (int i = 0; i < 200; ++i) {
    const WorldReport<double> report = world.step(0.01);
    REQUIRE(report.advanced);
    touching += report.contacts > 0;
  }
  CHECK(touching > 150);
  CHECK(world.state(sheet).positions.col(0) == rest.positions.col(0));
  CHECK(world.state(sheet).positions.col(40)[2] > -0.05);  // on the ball
  for (Index v = 0; v < 81; ++v)
    CHECK((world.state(sheet).positions.col(v) - Vector3<double>(0, 0, -0.1)).norm() > 0.08);
}

TEST_CASE("a world refuses a foreign sheet whose masses or pins are wrong", "[concepts]") {
  Wrong wrong{make_net(3), {}};
  const ClothState<double> rest = cloth_traits<Wrong>::rest_state(wrong);
  World<double> world;
  wrong.told.setConstant(8, 0.01);
  CHECK(world.add_sheet(wrong, rest).error() == "sheet 0: 8 masses for 9 vertices");
  wrong.told.setConstant(9, 0.01);
  wrong.told[4] = 0;
  CHECK(world.add_sheet(wrong, rest).error() ==
        "sheet 0: mass of vertex 4 must be positive and finite, got 0 kg");
  wrong.told[4] = 0.01;
  wrong.nails = {9};
  CHECK(world.add_sheet(wrong, rest).error() ==
        "sheet 0: pinned vertex 0: vertex 9 is off the mesh of 9 vertices");
  CHECK(world.sheet_count() == 0);
}
