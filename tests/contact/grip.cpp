#include "clothctl/contact/grip.hpp"

#include <functional>
#include <limits>
#include <random>
#include <string>

#include "clothctl/mesh/mesh_editor.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
std::vector<Grip<S>> two_pinches() {
  return {make_pinch<S>({0, 1, 4}, S(0.5), S(20)), make_pinch<S>({3, 7}, S(0.3), S(5), 8)};
}

template <class S>
std::string verdict(const std::function<void(std::vector<Grip<S>>&)>& spoil) {
  std::vector<Grip<S>> grips = two_pinches<S>();
  spoil(grips);
  return validate_grips(grips, 9);
}

}  // namespace

TEMPLATE_TEST_CASE("a pinch has two opposed fingers on the same vertices", "[contact]", float,
                   double) {
  using S = TestType;
  const Grip<S> grip = make_pinch<S>({5, 2, 9}, S(0.7), S(12), 6);
  REQUIRE(grip.fingers.size() == 2);
  CHECK(grip.fingers[0].side == S(1));
  CHECK(grip.fingers[1].side == S(-1));
  for (const Finger<S>& finger : grip.fingers) {
    CHECK(finger.vertices == std::vector<int>{5, 2, 9});
    CHECK(finger.contact.friction == S(0.7));
    CHECK(finger.max_normal_force == S(12));
    CHECK(finger.contact.pyramid == 6);
  }
  CHECK(grip.vertices() == std::vector<int>{2, 5, 9});
  CHECK(validate_grips<S>({grip}, 10).empty());
}

TEMPLATE_TEST_CASE("grips with several fingers at a vertex, or without friction, are valid",
                   "[contact]", float, double) {
  using S = TestType;
  CHECK(validate_grips(two_pinches<S>(), 9).empty());
  CHECK(verdict<S>([](auto& g) { g[0].fingers[0].contact.friction = S(0); }).empty());
  CHECK(verdict<S>([](auto& g) {
          g[1].fingers.push_back({{3}, S(1), {S(0.1), 4}, S(1)});
        }).empty());
}

TEMPLATE_TEST_CASE("bad grips are refused with a message that names the item", "[contact]", float,
                   double) {
  using S = TestType;
  using Grips = std::vector<Grip<S>>;
  const S nan = std::numeric_limits<S>::quiet_NaN();
  const S infinity = std::numeric_limits<S>::infinity();
  CHECK(validate_grips(Grips{}, 9) == "there are no grips");
  CHECK(verdict<S>([](Grips& g) { g[1].fingers.clear(); }) == "grip 1 has no fingers");
  CHECK(verdict<S>([](Grips& g) { g[1].fingers[1].vertices.clear(); }) ==
        "grip 1 finger 1 holds no vertices");
  CHECK(verdict<S>([](Grips& g) { g[0].fingers[1].vertices[2] = 9; }) ==
        "grip 0 finger 1 holds vertex 9, off a mesh of 9 vertices");
  CHECK(verdict<S>([](Grips& g) { g[0].fingers[0].vertices[0] = -1; }) ==
        "grip 0 finger 0 holds vertex -1, off a mesh of 9 vertices");
  CHECK(verdict<S>([](Grips& g) { g[0].fingers[0].vertices[2] = 1; }) ==
        "grip 0 finger 0 holds vertex 1 twice");
  CHECK(verdict<S>([](Grips& g) { g[1].fingers[0].vertices[1] = 4; }) ==
        "grip 1 finger 0 holds vertex 4, which grip 0 holds already");
  const auto begins = [](const std::string& text, const std::string& begin) {
    return text.rfind(begin, 0) == 0;
  };
  for (const S bad : {S(-0.1), nan, infinity}) {
    CHECK(begins(verdict<S>([&](Grips& g) { g[0].fingers[1].contact.friction = bad; }),
                 "grip 0 finger 1 has the friction coefficient "));
  }
  CHECK(verdict<S>([](Grips& g) { g[0].fingers[1].contact.friction = S(-0.5); }) ==
        "grip 0 finger 1 has the friction coefficient -0.5, must be finite and not negative");
  for (const S bad : {S(0), S(-1), nan, infinity})
    CHECK(begins(verdict<S>([&](Grips& g) { g[0].fingers[1].max_normal_force = bad; }),
                 "grip 0 finger 1 has the largest normal force "));
  for (const S bad : {S(0), S(0.5), S(-2), nan})
    CHECK(begins(verdict<S>([&](Grips& g) { g[1].fingers[0].side = bad; }),
                 "grip 1 finger 0 has the side "));
  CHECK(verdict<S>([](Grips& g) { g[1].fingers[1].contact.pyramid = 3; }) ==
        "grip 1 finger 1 has 3 generators, must be 4 to 1024");
  for (const Vector3<S>& bad :
       {Vector3<S>(S(0), S(0), S(0)), Vector3<S>(S(1), S(1), S(0)), Vector3<S>(nan, S(0), S(1))}) {
    CHECK(verdict<S>([&](Grips& g) { g[0].fallback_normal = bad; }) ==
          "grip 0 has a fallback normal that is not a unit vector");
  }
}

namespace {

// Frictionless, with answers that break the axioms on request.
struct Liar : Frictionless<double> {
  Index count = 1, first = 0;
  double share = 1, bound = 5, pull = 0;
  Index generators(Index) const { return count; }
  std::pair<Index, Index> support(Index, Index) const { return {first, 1}; }
  double normal_share(Index, Index) const { return share; }
  double upper_bound(Index, Index, double) const { return bound; }
  double adhesion() const { return pull; }
};
static_assert(ContactModel<Liar>);

std::string of_liar(const std::function<void(Liar&)>& change) {
  Liar liar;
  change(liar);
  Grip<double, Liar> grip;
  grip.fingers.push_back({{3}, 1.0, liar, 5.0});
  return validate_grips<double, Liar>({grip}, 9);
}

}  // namespace

TEST_CASE("a contact model that breaks its axioms is refused with the value", "[contact]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(of_liar([](Liar&) {}) == "");
  CHECK(of_liar([](Liar& l) { l.count = 0; }) == "grip 0 finger 0 has 0 generators");
  CHECK(of_liar([](Liar& l) { l.first = 1; }) ==
        "grip 0 finger 0 has a generator 0 that acts off its 1 vertices");
  CHECK(of_liar([](Liar& l) { l.first = -1; }).find("acts off") != std::string::npos);
  CHECK(of_liar([](Liar& l) { l.share = 0; }) ==
        "grip 0 finger 0 has a generator 0 of normal share 0, must be finite and positive");
  CHECK(of_liar([&](Liar& l) { l.bound = nan; }).find("upper bound nan") != std::string::npos);
  CHECK(of_liar([](Liar& l) { l.pull = -6; }) ==
        "grip 0 finger 0 has the adhesion -6, must be finite and not negative");
  // Friction whose square overflows leaves no share of the normal force.
  CHECK(verdict<double>([](auto& g) {
          g[0].fingers[0].contact.friction = 1e200;
        }).find("normal share 0") != std::string::npos);
}

TEMPLATE_TEST_CASE("a vertex normal is the area-weighted mean of its triangles, or the fallback",
                   "[contact]", float, double) {
  using S = TestType;
  Points<S> x(3, 5);
  x << S(0), S(1), S(1), S(0), S(-2),  //
      S(0), S(0), S(1), S(1), S(0),    //
      S(0), S(0), S(0), S(0), S(2);
  const std::vector<std::array<int, 3>> triangles{
      {0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {2, 1, 0}, {1, 1, 2}};
  const Vector3<S> fallback = Vector3<S>::UnitX();
  const S near = S(4) * scalar_traits<S>::epsilon();
  const auto normal = [&](const std::vector<int>& around) {
    return vertex_normal<S>(x, triangles, around, fallback);
  };
  CHECK((normal({0, 1}) - Vector3<S>::UnitZ()).norm() <= near);
  // The area vectors of triangles 0, 1 and 2 add up to (0,0,1) + (2,0,2).
  const Vector3<S> mean(S(1), S(0), S(1));
  CHECK((normal({0, 1, 2}) - Vector3<S>(S(2), S(0), S(4)).normalized()).norm() <= S(4) * near);
  CHECK((normal({2}) - mean.normalized()).norm() <= S(4) * near);
  CHECK(normal({}) == fallback);
  CHECK(normal({0, 3}) == fallback);  // front and back cancel
  CHECK(normal({4}) == fallback);     // no area
}

TEST_CASE(
    "a vertex normal rotates with the sheet, does not depend on position and does not allocate",
    "[contact]") {
  std::mt19937 random(3);
  std::normal_distribution<double> gauss;
  const std::vector<std::array<int, 3>> triangles{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}};
  const std::vector<int> around{0, 1, 2};
  const Eigen::Vector3d fallback = Eigen::Vector3d::UnitY();
  for (int trial = 0; trial < 50; ++trial) {
    Points<double> x(3, 5);
    for (Index i = 0; i < x.size(); ++i) x.data()[i] = gauss(random);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(gauss(random), Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    Points<double> moved = 0.02 * (turn * x);
    moved.colwise() += Eigen::Vector3d(3, -2, 1);
    const long before = clothctl_test::allocations();
    const Eigen::Vector3d n = vertex_normal<double>(x, triangles, around, fallback);
    const long during = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
    CHECK((vertex_normal<double>(moved, triangles, around, fallback) - turn * n).norm() <= 1e-9);
  }
}

TEST_CASE("fingers hold all copies of their vertices after a tear", "[contact]") {
  const Points<double> x = Points<double>::Random(3, 4);
  auto editor = MeshEditor<double>::create(x, {{0, 1, 2}, {1, 3, 2}}).value();
  editor.mark(1, 2);
  REQUIRE(editor.open_marked() == 2);
  const Remap<double> remap = editor.change().remap;
  const std::vector<Grip<double>> grips{make_pinch<double>({2, 3}, 0.5, 10.0),
                                        make_pinch<double>({0}, 0.5, 10.0)};
  const std::vector<Grip<double>> next = remap_grips(grips, remap);
  CHECK(validate_grips(next, 6) == "");
  CHECK(next[0].fingers[1].vertices == std::vector<int>{2, remap.copies(2)[1], 3});
  CHECK(next[1].vertices() == std::vector<int>{0});
  CHECK(next[0].fingers[0].side == grips[0].fingers[0].side);
}
