#pragma once

// Hashes of simulated states, and their expected values on platforms where the library promises
// equal bits (support/bits.hpp).

#include <array>
#include <cstdint>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/bits.hpp"

namespace clothctl_test {

/// Returns the FNV-1a hash of the bits of positions and velocities.
template <class Scalar>
std::uint64_t state_hash(const clothctl::ClothState<Scalar>& state) {
  std::uint64_t hash = kEmptyHash;
  for (const clothctl::Points<Scalar>* points : {&state.positions, &state.velocities})
    hash =
        hash_bytes(points->data(), static_cast<std::size_t>(points->size()) * sizeof(Scalar), hash);
  return hash;
}

/// Returns the hash of a sheet's state after 100 steps of 0.02 s, or 0 if a step fails. Two upper
/// corners are driven, two forces act, and a wind blows.
template <class Model>
std::uint64_t hash_after_steps(const Model& model, int size) {
  using Scalar = typename Model::Scalar;
  auto workspace = model.make_workspace();
  clothctl::ClothState<Scalar> state = model.rest_state();
  clothctl::ClothInput<Scalar> input;
  input.driven_vertices = {size * size - size, size * size - 1};
  input.driven_positions.resize(3, 2);
  input.force_vertices = {0, size - 1};
  input.forces.resize(3, 2);
  input.forces << Scalar(0.01), Scalar(-0.01), Scalar(0.02), Scalar(0.02), Scalar(0), Scalar(0.01);
  input.wind = {Scalar(0.5), Scalar(1.5), Scalar(-0.25)};
  const clothctl::Points<Scalar> rest = state.positions;
  for (int k = 0; k < 100; ++k) {
    const Scalar t = Scalar(0.02) * Scalar(k);
    for (int c = 0; c < 2; ++c) {
      const int vertex = input.driven_vertices[static_cast<std::size_t>(c)];
      input.driven_positions(0, c) = rest(0, vertex) + (c == 0 ? Scalar(0.05) : Scalar(-0.05)) * t;
      input.driven_positions(1, c) = rest(1, vertex) + Scalar(0.25) * t * (Scalar(2) - t);
      input.driven_positions(2, c) = rest(2, vertex);
    }
    if (!model.step(state, input, Scalar(0.02), workspace).advanced) return 0;
  }
  return state_hash(state);
}

/// Returns the hashes for four models on a grid of 13×13 vertices in air: mass-spring with one
/// linear solve and with Newton, position-based with XPBD and with Verlet.
template <class Scalar>
std::array<std::uint64_t, 4> sheet_hashes() {
  using namespace clothctl;
  const int size = 13;
  const GridMesh<Scalar> grid = make_grid<Scalar>(size, size, Scalar(0.5), Scalar(0.5)).value();
  const Material<Scalar> material;
  const SpringNetwork<Scalar> network = sheet_network<Scalar>(grid, material).value();
  auto implicit = MassSpringSettings<Scalar>::of(material, true);
  const auto once = MassSpring<Scalar>::create(network, implicit).value();
  implicit.integration = Integration::Newton;
  const auto newton = MassSpring<Scalar>::create(network, implicit).value();
  auto positions = PositionBasedSettings<Scalar>::of(material, true);
  const auto xpbd = PositionBased<Scalar>::create(network, positions).value();
  positions.scheme = PositionScheme::Verlet;
  positions.substeps = 1;
  positions.iterations = 15;
  const auto verlet = PositionBased<Scalar>::create(network, positions).value();
  return {hash_after_steps(once, size), hash_after_steps(newton, size),
          hash_after_steps(xpbd, size), hash_after_steps(verlet, size)};
}

/// The expected hashes; g++ and clang give the same.
inline constexpr std::array<std::uint64_t, 4> kDoubleHashes{
    0x9c7c62e298f19aafu, 0xa11ac397cfdee32eu, 0x87815c1e2969d7cfu, 0x176b20a8c67dc47au};
inline constexpr std::array<std::uint64_t, 4> kFloatHashes{
    0x0e5f7b70c7ba1232u, 0x2523aa411c37584eu, 0xcd0ffaa86bbd72ffu, 0x8e9458f6f6b9b7dbu};

}  // namespace clothctl_test
