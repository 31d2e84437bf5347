#include "clothctl/network/spring_network.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Three vertices, two springs, a stencil and a triangle.
template <class S>
SpringNetwork<S> small_network() {
  SpringNetwork<S> network;
  network.rest_positions = Points<S>::Zero(3, 3);
  network.rest_positions(0, 1) = S(0.5);
  network.rest_positions(1, 2) = S(0.25);
  network.mass = VectorX<S>::Constant(3, S(0.1));
  network.springs.push_back({0, 1, S(0.5), S(100), S(0.2)});
  network.springs.push_back({0, 2, S(0.25), S(50), S(0.1)});
  BendStencil<S> stencil;
  stencil.vertex = {1, 0, 2, 0};
  stencil.weight = {S(1), S(-2), S(1), S(0)};
  stencil.stiffness = S(0.01);
  stencil.count = 3;
  network.bends.push_back(stencil);
  network.triangles.push_back({0, 1, 2});
  return network;
}

template <class S>
const S kNan = std::numeric_limits<S>::quiet_NaN();

}  // namespace

TEMPLATE_TEST_CASE("a valid network passes validate", "[cloth]", float, double) {
  const auto network = small_network<TestType>();
  CHECK(network.vertex_count() == 3);
  CHECK(network.validate().empty());
}

TEMPLATE_TEST_CASE("every error of a network is named with its index", "[cloth]", float, double) {
  using S = TestType;
  const auto fault = [](auto&& spoil) {
    SpringNetwork<S> network = small_network<S>();
    spoil(network);
    return network.validate();
  };
  CHECK(SpringNetwork<S>().validate() == "spring network has no vertices");
  CHECK(fault([](auto& n) { n.mass.conservativeResize(2); }) ==
        "spring network has 2 masses for 3 vertices");
  CHECK(fault([](auto& n) { n.rest_positions(1, 2) = kNan<S>; }) ==
        "rest position of vertex 2 is not finite: y is nan");
  CHECK(fault([](auto& n) { n.mass[1] = S(0); }) == "mass of vertex 1 is not positive: 0 kg");
  CHECK(fault([](auto& n) { n.mass[2] = kNan<S>; }) == "mass of vertex 2 is not positive: nan kg");
  CHECK(fault([](auto& n) { n.springs[1].b = 3; }) == "spring 1 joins vertex 3 off the mesh");
  CHECK(fault([](auto& n) { n.springs[0].a = -1; }) == "spring 0 joins vertex -1 off the mesh");
  CHECK(fault([](auto& n) { n.springs[1].b = 0; }) == "spring 1 joins vertex 0 to itself");
  CHECK(fault([](auto& n) { n.springs[1].rest_length = S(0); }) ==
        "spring 1 has no positive rest length: 0 m");
  CHECK(fault([](auto& n) { n.springs[1].stiffness = S(-1); }) ==
        "spring 1 has a negative or non-finite stiffness: -1 N/m");
  CHECK(fault([](auto& n) { n.springs[0].damping = kNan<S>; }) ==
        "spring 0 has a negative or non-finite damping: nan N s/m");
  CHECK(fault([](auto& n) { n.bends[0].count = 5; }) == "bending stencil 0 has 5 vertices");
  CHECK(fault([](auto& n) { n.bends[0].vertex[2] = 7; }) ==
        "bending stencil 0 holds vertex 7 off the mesh");
  CHECK(fault([](auto& n) { n.bends[0].weight[1] = kNan<S>; }) ==
        "bending stencil 0 has a non-finite weight: nan");
  CHECK(fault([](auto& n) { n.bends[0].stiffness = S(-2); }) ==
        "bending stencil 0 has a negative or non-finite stiffness: -2");
  CHECK(fault([](auto& n) { n.triangles[0][2] = 9; }) == "triangle 0 holds vertex 9 off the mesh");
}

TEMPLATE_TEST_CASE("a rest fold must be a hinge's, finite and moderate", "[cloth]", float, double) {
  using S = TestType;
  const auto fault = [](S fold, int count, S left = S(-1), S right = S(-1)) {
    SpringNetwork<S> network = small_network<S>();
    network.rest_positions = Points<S>::Random(3, 4);
    network.mass = VectorX<S>::Ones(4);
    BendStencil<S>& hinge = network.bends[0];
    hinge.vertex = {1, 0, 2, 3};
    hinge.weight = {S(1), S(1), left, right};
    hinge.count = count;
    hinge.rest_fold = fold;
    CHECK(hinge.is_folded() == (fold < S(0) || fold > S(0)));
    return network.validate();
  };
  const S infinite = std::numeric_limits<S>::infinity();
  CHECK(fault(S(0.5), 4).empty());
  CHECK(fault(S(-1e6), 4).empty());
  CHECK(fault(S(0), 3, S(1)).empty());
  for (const S bad : {kNan<S>, infinite, -infinite, S(2e6), S(-2e6)})
    CHECK(fault(bad, 4) == "bending stencil 0 has a rest_fold that is not finite or above 1e6");
  CHECK(fault(S(0.5), 3) ==
        "bending stencil 0 has a rest_fold, but not the four vertices of a hinge");
  for (const S left : {S(0), S(1)})
    CHECK(fault(S(0.5), 4, left) ==
          "bending stencil 0 has a rest_fold, but no negative weights on vertices 2 and 3 of the "
          "hinge");
}

TEST_CASE("a network converts to float and back", "[cloth]") {
  auto network = small_network<double>();
  network.bends[0].rest_fold = 0.25;
  const auto back = network.cast<float>().cast<double>();
  CHECK(back.bends[0].rest_fold == 0.25);
  CHECK(back.validate() == network.validate());
  CHECK((back.rest_positions - network.rest_positions).norm() == 0.0);
  CHECK((back.mass - network.mass).norm() < 1e-8);
  REQUIRE(back.springs.size() == 2);
  CHECK(back.springs[1].a == 0);
  CHECK(back.springs[1].b == 2);
  CHECK(back.springs[1].rest_length == 0.25);
  CHECK(back.springs[1].stiffness == 50.0);
  CHECK(back.springs[1].damping == Approx(0.1).epsilon(1e-6));
  REQUIRE(back.bends.size() == 1);
  CHECK(back.bends[0].vertex == network.bends[0].vertex);
  CHECK(back.bends[0].weight == network.bends[0].weight);
  CHECK(back.bends[0].count == 3);
  CHECK(back.bends[0].stiffness == Approx(0.01).epsilon(1e-6));
  CHECK(back.triangles == network.triangles);
}
