#include "clothctl/cloth/detail/held_impulses.hpp"

#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

/// Points x y z w one after the other.
struct Sheet {
  using Scalar = double;
  static constexpr std::size_t kStride = 1;
  struct Scratch {
    VectorX<double> points, start;
  };
  std::size_t offset(int v) const { return 4 * static_cast<std::size_t>(v); }
};

}  // namespace

TEST_CASE("what sweeps do to a held vertex is its impulse, and it stays", "[cloth]") {
  Sheet sheet;
  Sheet::Scratch memory{VectorX<double>::LinSpaced(12, 0, 1.1),
                        VectorX<double>::LinSpaced(12, 0, 1)};
  for (const int v : {0, 2}) memory.points[4 * v + 3] = 0;
  const VectorX<double> points = memory.points, start = memory.start;
  const Eigen::Vector3d mass(0.5, 7, 2);
  HeldImpulses<double> held;
  held.reserve(2);
  held.begin(std::vector<int>{2, 0}, VectorX<double>(mass));
  const double h = 0.01, light = HeldImpulses<double>::kLightness;
  for (int part = 0; part < 3; ++part) {
    held.begin_sweeps(sheet, memory);
    CHECK(memory.points[11] == Approx(light / 2));
    CHECK(memory.points[3] == Approx(light / 0.5));
    memory.points[8] += light * 1e-3;  // x of vertex 2
    memory.start[10] += light * 1e-3;  // z, of which the velocity must not see anything
    memory.points[10] += light * 3e-3;
    held.end_sweeps(h, sheet, memory);
    CHECK((memory.points - points).cwiseAbs().maxCoeff() < 1e-15);
    CHECK((memory.start - start).cwiseAbs().maxCoeff() < 1e-15);
  }
  const VectorX<double> masses = mass, inverse = Eigen::Vector3d(0, 1.0 / 7, 0);
  double speed = 1;
  const auto velocity = [&](Index) { return Triple<double>{0, speed, 0}; };
  held.account([&] { speed += 0.5 / 7; }, velocity, masses, inverse);
  const double total = held.end();
  const Triple<double> of_2 = held.impulse(0), of_0 = held.impulse(1);
  // -m d/h, and all that is not accounted for goes to the vertex that gives anything.
  CHECK(of_2.x == Approx(-3 * 2 * 1e-3 / h).epsilon(1e-9));
  CHECK(of_2.y == Approx(0.5));
  CHECK(of_2.z == Approx(-3 * 2 * 2e-3 / h).epsilon(1e-9));
  CHECK(std::abs(of_0.x) + std::abs(of_0.y) + std::abs(of_0.z) < 1e-12);
  CHECK(total == Approx(std::sqrt(0.36 + 0.25 + 1.44)));
}

TEST_CASE("what is not accounted for is divided equally where nothing else is known", "[cloth]") {
  HeldImpulses<float> held;
  held.reserve(2);
  held.begin(std::vector<int>{0, 1}, VectorX<float>(Eigen::Vector2f(1, 3)));
  float speed = 0;
  const auto velocity = [&](Index) { return Triple<float>{speed, 0, -2 * speed}; };
  const VectorX<float> mass = Eigen::Vector3f(1, 3, 2), inverse = Eigen::Vector3f(0, 0, 0.5f);
  held.account([&] { speed = 0.5f; }, velocity, mass, inverse);
  held.end();
  for (const std::size_t i : {0u, 1u}) {
    CHECK(held.impulse(i).x == 0.5f);
    CHECK(held.impulse(i).z == -1.0f);
  }
}
