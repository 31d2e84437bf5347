// A run that goes on from a snapshot has the same bits as one that was never interrupted.

#include <memory>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/core/snapshot.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/state_hash.hpp"

using namespace clothctl;

namespace {

constexpr int kSize = 9;

template <class Scalar>
SpringNetwork<Scalar> sheet() {
  const auto grid = make_grid<Scalar>(kSize, kSize, Scalar(0.5), Scalar(0.5)).value();
  return sheet_network<Scalar>(grid, Material<Scalar>()).value();
}

/// Makes a model anew, as another process would.
template <class Model>
Model made(bool first_kind);

template <>
MassSpring<double> made(bool first_kind) {
  auto settings = MassSpringSettings<double>::of(Material<double>(), true);
  settings.integration = first_kind ? Integration::Newton : Integration::LinearlyImplicit;
  return MassSpring<double>::create(sheet<double>(), settings).value();
}
template <>
MassSpring<float> made(bool first_kind) {
  auto settings = MassSpringSettings<float>::of(Material<float>(), true);
  settings.integration = first_kind ? Integration::Newton : Integration::LinearlyImplicit;
  return MassSpring<float>::create(sheet<float>(), settings).value();
}
template <>
PositionBased<double> made(bool first_kind) {
  auto settings = first_kind ? PositionBasedSettings<double>::of(Material<double>(), true)
                             : PositionBasedSettings<double>::verlet();
  return PositionBased<double>::create(sheet<double>(), settings).value();
}
template <>
PositionBased<float> made(bool first_kind) {
  auto settings = first_kind ? PositionBasedSettings<float>::of(Material<float>(), true)
                             : PositionBasedSettings<float>::verlet();
  return PositionBased<float>::create(sheet<float>(), settings).value();
}

/// Advances a sheet, whose upper corners move and on which a wind blows, from step `first` to
/// `last`.
template <class Model>
void run(const Model& model, int first, int last, ClothState<typename Model::Scalar>& state) {
  using S = typename Model::Scalar;
  auto workspace = model.make_workspace();
  const Points<S> rest = model.rest_state().positions;
  ClothInput<S> input;
  input.driven_vertices = {kSize * kSize - kSize, kSize * kSize - 1};
  input.driven_positions.resize(3, 2);
  input.wind = {S(0.5), S(1.5), S(-0.25)};
  for (int k = first; k < last; ++k) {
    for (Index c = 0; c < 2; ++c) {
      input.driven_positions.col(c) = rest.col(input.driven_vertices[static_cast<std::size_t>(c)]);
      input.driven_positions(1, c) = S(0.004) * S(k + 1);
    }
    REQUIRE(model.step(state, input, S(0.02), workspace).advanced);
  }
}

}  // namespace

TEMPLATE_TEST_CASE("a run restored in the middle ends with the same bits", "[cloth][snapshot]",
                   MassSpring<double>, MassSpring<float>, PositionBased<double>,
                   PositionBased<float>) {
  using S = typename TestType::Scalar;
  for (const bool first_kind : {true, false}) {
    CAPTURE(first_kind);
    ClothState<S> whole;
    std::vector<std::byte> bytes;
    {
      const TestType model = made<TestType>(first_kind);
      whole = model.rest_state();
      run(model, 0, 100, whole);
    }
    {
      const TestType model = made<TestType>(first_kind);
      ClothState<S> state = model.rest_state();
      run(model, 0, 50, state);
      write_snapshot(state, bytes);
    }
    const auto model = std::make_unique<TestType>(made<TestType>(first_kind));
    auto restored = read_snapshot<ClothState<S>>(bytes);
    REQUIRE(restored);
    run(*model, 50, 100, restored.value());
    CHECK(clothctl_test::state_hash(restored.value()) == clothctl_test::state_hash(whole));
    CHECK_FALSE(restored->positions == model->rest_state().positions);
  }
}
