#pragma once

// The laws that every ClothPlant must obey: equal plants with equal input stay equal to the bit,
// and a plant that does not advance keeps its state.

#include <limits>

#include "clothctl/concepts/cloth.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Checks the laws on plants made by `make()`, which must all be equal. Vertex 0 must be free.
template <class Scalar, class Make>
requires clothctl::ClothPlant<decltype(std::declval<Make>()()), Scalar>
void check_plant_laws(const Make& make, Scalar dt) {
  auto one = make(), other = make();
  using Traits = clothctl::plant_traits<decltype(one)>;
  using Points = clothctl::Points<Scalar>;
  clothctl::ClothInput<Scalar> input;
  input.force_vertices = {0};
  input.forces = clothctl::Vector3<Scalar>(Scalar(0.01), Scalar(0.02), Scalar(0.03));
  const clothctl::Index n = Traits::vertex_count(one);
  for (int frame = 0; frame < 5; ++frame) {
    Traits::apply(one, input);
    Traits::apply(other, input);
    const Points before = Traits::positions(one);
    REQUIRE(Traits::advance(one, dt).advanced);
    REQUIRE(Traits::advance(other, dt).advanced);
    const Points x = Traits::positions(one), v = Traits::velocities(one);
    CHECK(x.cols() == n);
    CHECK(v.cols() == n);
    CHECK(x != before);
    CHECK(x == Points(Traits::positions(other)));
    CHECK(v == Points(Traits::velocities(other)));
  }
  const Points x = Traits::positions(one), v = Traits::velocities(one);
  input.forces(1, 0) = std::numeric_limits<Scalar>::quiet_NaN();
  Traits::apply(one, input);
  CHECK_FALSE(Traits::advance(one, dt).advanced);
  CHECK(Points(Traits::positions(one)) == x);
  CHECK(Points(Traits::velocities(one)) == v);
  input.forces(1, 0) = Scalar(0);
  Traits::apply(one, input);
  CHECK_FALSE(Traits::advance(one, Scalar(0)).advanced);
  CHECK(Points(Traits::positions(one)) == x);
  CHECK(Traits::advance(one, dt).advanced);
}

}  // namespace clothctl_test
