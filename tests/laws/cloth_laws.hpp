#pragma once

// The laws that every ClothModel must obey, whatever its equations. Call
// check_cloth_laws(model, laws) inside a TEST_CASE, where `laws` describes the model. A property
// that the model lacks (a free sheet, no Verlet damping) switches off the laws that need it.
//
//   refusals    bad input or state gives the right status and leaves the state's bits unchanged
//   repeats     the same state and input give the same bits, with a new workspace and with one
//               that has just done another step
//   driven      a driven vertex ends exactly at its prescribed position, with the velocity
//               (prescribed - start)/dt
//   symmetry    shifting the world, or turning it about the axis of gravity, shifts or turns the
//               result
//   momentum    of a free sheet without air: Σ m v⁺ = (Σ m v + dt (Σ m g + Σ f)) / (1 + α dt)
//   free fall   the centre of mass falls by implicit Euler: v_n = n h g and
//               x_n = x_0 + n (n + 1)/2 h² g
//   galilean    of a free sheet without drag: adding u to all velocities and to the wind adds u to
//               v⁺ and u dt to x⁺
//   memory      a step does not allocate

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// The scalar type of a model, taken from its rest state.
template <class Model>
using model_scalar_t =
    typename decltype(clothctl::cloth_traits<Model>::rest_state(std::declval<const Model&>())
                          .positions)::Scalar;

/// The properties of a model, and the tolerances of the laws.
template <class Scalar>
struct ClothLaws {
  /// Step length, s.
  Scalar dt = Scalar(0.01);
  /// Gravity of the model, m/s². The symmetry law turns the world about it (about z if it is zero).
  clothctl::Vector3<Scalar> gravity =
      clothctl::Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// Vertex masses, n, kg. Empty switches off the laws of momentum and free fall.
  clothctl::VectorX<Scalar> mass;
  /// Mass-proportional drag α, 1/s.
  Scalar drag = Scalar(0);
  /// Number of equal parts of a step, where each part is a step of implicit Euler (position-based
  /// substeps).
  int substeps = 1;
  /// False for models that damp or hold the whole sheet (pins, Verlet damping, air). Switches off
  /// the laws of momentum, free fall and galilean invariance.
  bool momentum_known = true;
  /// Vertices that the model pins. The laws neither drive nor push them.
  std::vector<int> pinned = {};
  /// Displacement of the vertices in the start state, m.
  Scalar displacement = Scalar(1e-3);
  /// Speed of the vertices in the start state, m/s.
  Scalar speed = Scalar(0.1);
  /// Size of the applied forces, N.
  Scalar force = Scalar(0.01);
  /// Largest error of velocities, m/s, in the laws of symmetry, momentum and galilean invariance.
  /// An iterative step is only as accurate as its tolerance. Positions may be off by dt times this,
  /// plus rounding.
  Scalar tolerance = std::is_same_v<Scalar, float> ? Scalar(2e-4) : Scalar(1e-9);
  /// Number of steps, in laws that take several.
  int steps = 5;
};

namespace law_detail {

template <class Scalar>
bool same_bits(const clothctl::Points<Scalar>& a, const clothctl::Points<Scalar>& b) {
  return a.cols() == b.cols() &&
         (a.size() == 0 || std::memcmp(a.data(), b.data(),
                                       sizeof(Scalar) * static_cast<std::size_t>(a.size())) == 0);
}

template <class Scalar>
bool same_bits(const clothctl::ClothState<Scalar>& a, const clothctl::ClothState<Scalar>& b) {
  return same_bits(a.positions, b.positions) && same_bits(a.velocities, b.velocities);
}

template <class Scalar>
Scalar largest_difference(const clothctl::Points<Scalar>& a, const clothctl::Points<Scalar>& b) {
  return a.cols() == 0 ? Scalar(0) : (a - b).cwiseAbs().maxCoeff();
}

// A smooth, irregular pattern, without a random source.
template <class Scalar>
clothctl::Points<Scalar> pattern(clothctl::Index n, double phase, Scalar size) {
  clothctl::Points<Scalar> out(3, n);
  for (clothctl::Index i = 0; i < n; ++i) {
    for (clothctl::Index c = 0; c < 3; ++c) {
      const double angle = 0.7 * static_cast<double>(i) * (1.0 + 0.3 * static_cast<double>(c)) +
                           2.1 * static_cast<double>(c) + phase;
      out(c, i) = size * static_cast<Scalar>(std::sin(angle));
    }
  }
  return out;
}

/// A model together with its properties.
template <class Model, class Scalar>
struct Bench {
  using Traits = clothctl::cloth_traits<Model>;
  using State = clothctl::ClothState<Scalar>;
  using Input = clothctl::ClothInput<Scalar>;
  using Workspace = decltype(Traits::make_workspace(std::declval<const Model&>()));

  const Model& model;
  const ClothLaws<Scalar>& laws;
  clothctl::Index n = Traits::vertex_count(model);

  State start() const {
    State state = Traits::rest_state(model);
    state.positions += pattern<Scalar>(n, 0.0, laws.displacement);
    state.velocities += pattern<Scalar>(n, 1.0, laws.speed);
    for (int v : laws.pinned) state.velocities.col(v).setZero();
    return state;
  }

  // Returns `count` vertices that the model does not pin, counted from the end.
  std::vector<int> free_vertices(int count) const {
    std::vector<int> out;
    for (clothctl::Index i = n; i-- > 0 && static_cast<int>(out.size()) < count;) {
      bool pinned = false;
      for (int v : laws.pinned) pinned = pinned || v == i;
      if (!pinned) out.push_back(static_cast<int>(i));
    }
    return out;
  }

  Input pushed() const {
    Input input;
    input.force_vertices = free_vertices(2);
    input.force_vertices.push_back(input.force_vertices.front());  // an index may occur twice
    input.forces =
        pattern<Scalar>(static_cast<clothctl::Index>(input.force_vertices.size()), 0.4, laws.force);
    return input;
  }

  Input driven(const State& state) const {
    Input input;
    input.driven_vertices = free_vertices(3);
    if (input.driven_vertices.size() > 1) input.driven_vertices.pop_back();
    input.driven_positions.resize(3, static_cast<clothctl::Index>(input.driven_vertices.size()));
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const clothctl::Vector3<Scalar> move =
          pattern<Scalar>(3, 2.5, laws.dt * laws.speed).col(static_cast<clothctl::Index>(i) % 3);
      input.driven_positions.col(static_cast<clothctl::Index>(i)) =
          state.positions.col(input.driven_vertices[i]) + move;
    }
    return input;
  }

  Workspace workspace() const { return Traits::make_workspace(model); }

  clothctl::StepReport<Scalar> step(State& state, const Input& input, Workspace& ws) const {
    return Traits::step(model, state, input, laws.dt, ws);
  }

  /// Takes one step with its own workspace, and requires that it succeeds.
  State after(State state, const Input& input) const {
    Workspace ws = workspace();
    const clothctl::StepReport<Scalar> report = step(state, input, ws);
    CHECK(report.advanced);
    return state;
  }
};

template <class Model, class Scalar>
void check_refusals(const Bench<Model, Scalar>& bench) {
  using clothctl::StepStatus;
  using Input = clothctl::ClothInput<Scalar>;
  using State = clothctl::ClothState<Scalar>;
  const Scalar nan = static_cast<Scalar>(std::numeric_limits<double>::quiet_NaN());
  const Scalar infinity = clothctl::scalar_traits<Scalar>::infinity();
  const int n = static_cast<int>(bench.n);
  auto ws = bench.workspace();

  const auto refuse = [&](const std::string& name, const State& state, const Input& input,
                          Scalar dt, StepStatus status) {
    INFO("refusal: " << name);
    State moved = state;
    const clothctl::StepReport<Scalar> report =
        clothctl::cloth_traits<Model>::step(bench.model, moved, input, dt, ws);
    CHECK(report.status == status);
    CHECK_FALSE(report.advanced);
    CHECK(same_bits(moved, state));
  };
  const State good = bench.start();
  const auto with = [&](const std::string& name, const std::function<void(Input&)>& spoil) {
    Input input = bench.pushed();
    spoil(input);
    refuse(name, good, input, bench.laws.dt, StepStatus::InvalidInput);
  };

  for (const Scalar bad : {nan, infinity, -infinity}) {
    with("force not finite", [bad](Input& i) { i.forces(1, i.forces.cols() - 1) = bad; });
    with("wind not finite", [bad](Input& i) { i.wind[2] = bad; });
    with("driven position not finite", [bad](Input& i) {
      i.driven_vertices = {0};
      i.driven_positions = clothctl::Points<Scalar>::Zero(3, 1);
      i.driven_positions(0, 0) = bad;
    });
    refuse("dt not finite", good, bench.pushed(), bad, StepStatus::InvalidInput);
  }
  refuse("dt zero", good, bench.pushed(), Scalar(0), StepStatus::InvalidInput);
  refuse("dt negative", good, bench.pushed(), -bench.laws.dt, StepStatus::InvalidInput);
  for (const int off : {-1, n, n + 1000000}) {
    with("force off the mesh", [off](Input& i) { i.force_vertices.back() = off; });
    with("driven vertex off the mesh", [off](Input& i) {
      i.driven_vertices = {off};
      i.driven_positions = clothctl::Points<Scalar>::Zero(3, 1);
    });
  }
  with("driven vertex twice", [](Input& i) {
    i.driven_vertices = {0, 0};
    i.driven_positions = clothctl::Points<Scalar>::Zero(3, 2);
  });
  with("more forces than vertices", [](Input& i) { i.force_vertices.pop_back(); });
  with("fewer driven positions than vertices", [](Input& i) { i.driven_vertices = {0}; });

  for (const Scalar bad : {nan, infinity}) {
    State state = good;
    state.positions(2, bench.n - 1) = bad;
    refuse("position not finite", state, bench.pushed(), bench.laws.dt, StepStatus::InvalidState);
    state = good;
    state.velocities(0, 0) = bad;
    refuse("velocity not finite", state, bench.pushed(), bench.laws.dt, StepStatus::InvalidState);
  }
  State small = good;
  small.positions.conservativeResize(3, bench.n - 1);
  small.velocities.conservativeResize(3, bench.n - 1);
  refuse("state of another size", small, Input{}, bench.laws.dt, StepStatus::InvalidState);

  // The workspace must still work after all refusals.
  INFO("a good step after the refusals");
  State state = good;
  CHECK(bench.step(state, bench.pushed(), ws).advanced);
  CHECK(same_bits(state, bench.after(good, bench.pushed())));
}

template <class Model, class Scalar>
void check_repeats(const Bench<Model, Scalar>& bench) {
  INFO("law: repeats");
  using State = clothctl::ClothState<Scalar>;
  auto used = bench.workspace();
  State state = bench.start();
  State elsewhere = bench.start();
  elsewhere.positions += pattern<Scalar>(bench.n, 4.0, bench.laws.displacement);
  for (int k = 0; k < bench.laws.steps; ++k) {
    CAPTURE(k);
    const clothctl::ClothInput<Scalar> input = k % 2 == 0 ? bench.pushed() : bench.driven(state);
    const State fresh = bench.after(state, input);
    (void)bench.step(elsewhere, bench.driven(elsewhere), used);
    const clothctl::StepReport<Scalar> report = bench.step(state, input, used);
    CHECK(report.advanced);
    CHECK((report.status == clothctl::StepStatus::Converged ||
           report.status == clothctl::StepStatus::IterationLimit));
    CHECK(clothctl::all_finite(state.positions));
    CHECK(clothctl::all_finite(state.velocities));
    CHECK(same_bits(state, fresh));
  }
}

template <class Model, class Scalar>
void check_driven(const Bench<Model, Scalar>& bench) {
  INFO("law: driven");
  using State = clothctl::ClothState<Scalar>;
  State state = bench.start();
  auto ws = bench.workspace();
  for (int k = 0; k < bench.laws.steps; ++k) {
    const State before = state;
    clothctl::ClothInput<Scalar> input = bench.driven(state);
    // A force on a driven vertex is ignored.
    input.force_vertices = {input.driven_vertices[0]};
    input.forces = clothctl::Points<Scalar>::Constant(3, 1, Scalar(100) * bench.laws.force);
    REQUIRE(bench.step(state, input, ws).advanced);
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const clothctl::Index v = input.driven_vertices[i];
      const clothctl::Vector3<Scalar> told =
          input.driven_positions.col(static_cast<clothctl::Index>(i));
      const clothctl::Vector3<Scalar> ended = state.positions.col(v);
      CHECK(std::memcmp(told.data(), ended.data(), 3 * sizeof(Scalar)) == 0);
      const clothctl::Vector3<Scalar> rate = (told - before.positions.col(v)) / bench.laws.dt;
      CHECK((state.velocities.col(v) - rate).cwiseAbs().maxCoeff() <= bench.laws.tolerance);
    }
    const State quiet = bench.after(before, bench.driven(before));
    CHECK(same_bits(state, quiet));
  }
  for (int v : bench.laws.pinned) {
    CHECK(same_bits<Scalar>(state.positions.col(v), bench.start().positions.col(v)));
  }
}

template <class Model, class Scalar>
void check_symmetry(const Bench<Model, Scalar>& bench) {
  INFO("law: symmetry");
  using State = clothctl::ClothState<Scalar>;
  using Input = clothctl::ClothInput<Scalar>;
  using std::cos;
  using std::sin;
  using std::sqrt;
  clothctl::Vector3<Scalar> axis = bench.laws.gravity;
  const Scalar length = sqrt(axis.squaredNorm());
  axis = Scalar(0) < length ? clothctl::Vector3<Scalar>(axis / length)
                            : clothctl::Vector3<Scalar>::UnitZ();
  // Rodrigues' formula: R = cos a I + sin a [axis]x + (1 - cos a) axis axisᵀ.
  const Scalar angle = Scalar(0.8);
  clothctl::Matrix3<Scalar> across;
  across << Scalar(0), -axis[2], axis[1], axis[2], Scalar(0), -axis[0], -axis[1], axis[0],
      Scalar(0);
  const clothctl::Matrix3<Scalar> turn = cos(angle) * clothctl::Matrix3<Scalar>::Identity() +
                                         sin(angle) * across +
                                         (Scalar(1) - cos(angle)) * axis * axis.transpose();
  const clothctl::Vector3<Scalar> shift(Scalar(0.5), Scalar(-0.25), Scalar(0.125));

  struct Change {
    const char* name;
    clothctl::Matrix3<Scalar> turn;
    clothctl::Vector3<Scalar> shift;
  };
  const State start = bench.start();
  for (const Change& change : {Change{"shift", clothctl::Matrix3<Scalar>::Identity(), shift},
                               Change{"turn", turn, clothctl::Vector3<Scalar>::Zero()}}) {
    if (std::string(change.name) == "turn" && !bench.laws.pinned.empty())
      continue;  // pins are placed in the world
    for (const bool drive : {false, true}) {
      CAPTURE(change.name, drive);
      Input input = drive ? bench.driven(start) : bench.pushed();
      input.wind = clothctl::Vector3<Scalar>(Scalar(0.5), Scalar(0.2), Scalar(-0.1));
      State moved = start;
      Input moved_input = input;
      const auto move = [&change](clothctl::Points<Scalar>& points) {
        for (clothctl::Index i = 0; i < points.cols(); ++i) {
          points.col(i) = (change.turn * points.col(i) + change.shift).eval();
        }
      };
      move(moved.positions);
      move(moved_input.driven_positions);
      moved.velocities = (change.turn * moved.velocities).eval();
      moved_input.forces = (change.turn * moved_input.forces).eval();
      moved_input.wind = (change.turn * moved_input.wind).eval();
      State expected = bench.after(start, input);
      move(expected.positions);
      expected.velocities = (change.turn * expected.velocities).eval();
      const State got = bench.after(moved, moved_input);
      // An error of a position causes an error of the velocity, divided by dt.
      const Scalar extent = Scalar(1) + expected.positions.cwiseAbs().maxCoeff();
      const Scalar rounding = Scalar(64) * clothctl::scalar_traits<Scalar>::epsilon() * extent;
      CHECK(largest_difference(got.velocities, expected.velocities) <=
            bench.laws.tolerance + rounding / bench.laws.dt);
      CHECK(largest_difference(got.positions, expected.positions) <=
            bench.laws.tolerance * bench.laws.dt + rounding);
    }
  }
}

template <class Model, class Scalar>
void check_momentum(const Bench<Model, Scalar>& bench) {
  using State = clothctl::ClothState<Scalar>;
  const ClothLaws<Scalar>& laws = bench.laws;
  const Scalar total = laws.mass.sum();
  State state = bench.start();
  auto ws = bench.workspace();
  // Σ m v from the formula above, with drag in each part of the step.
  const Scalar part = laws.dt / static_cast<Scalar>(laws.substeps);
  for (int k = 0; k < laws.steps; ++k) {
    INFO("law: momentum");
    CAPTURE(k);
    const clothctl::ClothInput<Scalar> input = bench.pushed();
    clothctl::Vector3<Scalar> expected = state.velocities * laws.mass;
    const clothctl::Vector3<Scalar> force = total * laws.gravity + input.forces.rowwise().sum();
    for (int s = 0; s < laws.substeps; ++s)
      expected = ((expected + part * force) / (Scalar(1) + part * laws.drag)).eval();
    REQUIRE(bench.step(state, input, ws).advanced);
    const clothctl::Vector3<Scalar> got = state.velocities * laws.mass;
    CHECK((got - expected).cwiseAbs().maxCoeff() <= total * laws.tolerance);
  }

  if (laws.drag == Scalar(0)) {
    INFO("law: free fall");
    State falling = clothctl::cloth_traits<Model>::rest_state(bench.model);
    const clothctl::Vector3<Scalar> centre0 = falling.positions * laws.mass / total;
    for (int k = 0; k < laws.steps; ++k)
      REQUIRE(bench.step(falling, clothctl::ClothInput<Scalar>{}, ws).advanced);
    const Scalar parts = static_cast<Scalar>(laws.steps * laws.substeps);
    const clothctl::Vector3<Scalar> speed = falling.velocities * laws.mass / total;
    const clothctl::Vector3<Scalar> fallen = falling.positions * laws.mass / total - centre0;
    const clothctl::Vector3<Scalar> expected_speed = parts * part * laws.gravity;
    const clothctl::Vector3<Scalar> expected_fall =
        parts * (parts + Scalar(1)) / Scalar(2) * part * part * laws.gravity;
    const Scalar allowed = laws.tolerance * static_cast<Scalar>(laws.steps);
    CHECK((speed - expected_speed).cwiseAbs().maxCoeff() <= allowed);
    CHECK((fallen - expected_fall).cwiseAbs().maxCoeff() <=
          allowed * laws.dt * static_cast<Scalar>(laws.steps));
  }

  if (laws.drag == Scalar(0)) {
    INFO("law: galilean");
    const clothctl::Vector3<Scalar> u(Scalar(1), Scalar(-2), Scalar(0.5));
    const State slow = bench.start();
    State fast = slow;
    fast.velocities.colwise() += u;
    clothctl::ClothInput<Scalar> input = bench.pushed();
    State expected = bench.after(slow, input);
    expected.velocities.colwise() += u;
    expected.positions.colwise() += laws.dt * u;
    input.wind = u;
    const State got = bench.after(fast, input);
    const Scalar extent = Scalar(1) + expected.positions.cwiseAbs().maxCoeff();
    const Scalar rounding = Scalar(64) * clothctl::scalar_traits<Scalar>::epsilon() * extent;
    CHECK(largest_difference(got.velocities, expected.velocities) <=
          laws.tolerance + rounding / laws.dt);
    CHECK(largest_difference(got.positions, expected.positions) <=
          laws.tolerance * laws.dt + rounding);
  }
}

template <class Model, class Scalar>
void check_memory(const Bench<Model, Scalar>& bench) {
  if (!allocation_counting_works()) {
    WARN("allocations cannot be counted in this build; the memory law is skipped");
    return;
  }
  INFO("law: memory");
  using State = clothctl::ClothState<Scalar>;
  using Input = clothctl::ClothInput<Scalar>;
  State state = bench.start();
  const Input push = bench.pushed();
  const Input drive = bench.driven(state);
  Input bad = push;
  bad.forces(0, 0) = static_cast<Scalar>(std::numeric_limits<double>::quiet_NaN());
  auto ws = bench.workspace();
  for (const Input& input : {std::cref(push), std::cref(drive), std::cref(std::as_const(bad))}) {
    const long before = allocations();
    (void)bench.step(state, input, ws);
    const long during = allocations() - before;
    CHECK(during == 0);
  }
}

}  // namespace law_detail

/// Checks all laws of this file. A failed CHECK names the law.
template <class Model>
void check_cloth_laws(const Model& model, const ClothLaws<model_scalar_t<Model>>& laws = {}) {
  using Scalar = model_scalar_t<Model>;
  static_assert(clothctl::ClothModel<Model, Scalar>);
  const law_detail::Bench<Model, Scalar> bench{model, laws};
  const clothctl::ClothState<Scalar> rest = clothctl::cloth_traits<Model>::rest_state(model);
  REQUIRE(bench.n >= 3);
  REQUIRE(rest.positions.cols() == bench.n);
  REQUIRE(rest.velocities.cols() == bench.n);
  REQUIRE(clothctl::all_finite(rest.positions));
  CHECK(rest.velocities == clothctl::Points<Scalar>::Zero(3, bench.n));

  law_detail::check_refusals(bench);
  law_detail::check_repeats(bench);
  law_detail::check_driven(bench);
  law_detail::check_symmetry(bench);
  if (laws.momentum_known && laws.mass.size() == bench.n && laws.pinned.empty())
    law_detail::check_momentum(bench);
  law_detail::check_memory(bench);
}

}  // namespace clothctl_test
