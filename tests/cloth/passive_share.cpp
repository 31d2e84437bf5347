#include "clothctl/cloth/detail/passive_share.hpp"

#include <array>
#include <random>
#include <type_traits>
#include <vector>

#include "clothctl/core/simd.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

struct Mass {
  double m;
  Vector3<double> u, d;
};

/// Masses that moved by u and are displaced by d, along u on the whole if `along` is 1 and against
/// it if -1.
std::vector<Mass> random_masses(unsigned seed, double along) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto vector = [&] {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    return Vector3<double>(x, y, z);
  };
  std::vector<Mass> masses;
  for (int i = 0; i < 12; ++i) {
    const double m = 1.5 + uniform(random);
    const Vector3<double> u = vector();
    masses.push_back({m, u, along * u + 0.5 * vector()});
  }
  return masses;
}

template <class Scalar>
Scalar share_of(const std::vector<Mass>& masses, const PassiveFrame<Scalar>& held) {
  PassiveSums<Scalar> sums(Scalar(0));
  for (const Mass& one : masses) {
    const Vector3<Scalar> u = one.u.cast<Scalar>(), d = one.d.cast<Scalar>();
    sums.add(Scalar(one.m), Scalar(u[0] - held.mean.x), Scalar(u[1] - held.mean.y),
             Scalar(u[2] - held.mean.z), Triple<Scalar>{d[0], d[1], d[2]});
  }
  return passive_share(sums, held.gift);
}

/// Σ m |u + s d - mean|² and Σ m.
std::array<double, 2> motion(const std::vector<Mass>& masses, double s,
                             const Vector3<double>& mean) {
  std::array<double, 2> sum{0, 0};
  for (const Mass& one : masses) {
    sum[0] += one.m * (one.u + s * one.d - mean).squaredNorm();
    sum[1] += one.m;
  }
  return sum;
}

}  // namespace

TEMPLATE_TEST_CASE("the passive share is the largest that adds no kinetic energy but the gift",
                   "[passive_share]", float, double, long double) {
  using Scalar = TestType;
  const double small = std::is_same_v<Scalar, float> ? 1e-4 : 1e-9;
  int whole = 0, part = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    for (const double along : {-1.5, -0.7, 0.0, 0.6}) {
      for (const double spread : {0.0, 0.2}) {
        const auto masses = random_masses(seed, along);
        const Vector3<double> mean(0.3, -0.1, 0.2);
        const PassiveFrame<Scalar> held{{Scalar(0.3), Scalar(-0.1), Scalar(0.2)}, Scalar(spread)};
        const double s = static_cast<double>(share_of(masses, held));
        const auto before = motion(masses, 0, mean), after = motion(masses, s, mean);
        const double most = before[0] + spread * before[1];
        REQUIRE(s >= 0);
        REQUIRE(s <= 1);
        CHECK(after[0] <= most * (1 + small));
        s < 1 ? ++part : ++whole;
        if (s < 1) CHECK(motion(masses, s + 0.01, mean)[0] > most);
      }
    }
  }
  CHECK(whole > 50);
  CHECK(part > 50);
}

TEST_CASE("displacements along the motion are not applied unless the hands move apart",
          "[passive_share]") {
  const auto masses = random_masses(3, 5.0);
  CHECK(share_of(masses, PassiveFrame<double>{}) == 0.0);
  CHECK(share_of(masses, PassiveFrame<double>{{0, 0, 0}, 1e-3}) > 0.0);
}

TEST_CASE("the passive share of nothing displaced is whole", "[passive_share]") {
  std::vector<Mass> masses = random_masses(1, 1.0);
  for (Mass& one : masses) one.d.setZero();
  CHECK(share_of(masses, PassiveFrame<double>{}) == 1.0);
  CHECK(share_of({}, PassiveFrame<double>{}) == 1.0);
  masses.resize(1);
  masses[0].u.setZero();
  masses[0].d << 1, 2, 3;
  CHECK(share_of(masses, PassiveFrame<double>{}) == 0.0);  // what is at rest stays at rest
}

TEST_CASE("sums over packs of masses are those over masses", "[passive_share]") {
  using Pack = Simd<double, 4>;
  const auto masses = random_masses(8, -1.5);
  PassiveSums<Pack> sums(Pack::all(0));
  for (std::size_t i = 0; i < masses.size(); i += 4) {
    std::array<std::array<double, 4>, 7> lanes{};
    for (std::size_t k = 0; k < 4; ++k) {
      const Mass& one = masses[i + k];
      lanes[0][k] = one.m;
      for (std::size_t c = 0; c < 3; ++c) {
        lanes[1 + c][k] = one.u[static_cast<Index>(c)];
        lanes[4 + c][k] = one.d[static_cast<Index>(c)];
      }
    }
    const auto pack = [&](std::size_t l) { return Pack::load(lanes[l].data()); };
    sums.add(pack(0), pack(1), pack(2), pack(3), Triple<Pack>{pack(4), pack(5), pack(6)});
  }
  CHECK(passive_share(sums, 0.0) ==
        Approx(share_of(masses, PassiveFrame<double>{})).epsilon(1e-12));
}

TEST_CASE("the frame of held vertices is their mean and its largest deviation", "[passive_share]") {
  const std::array<Triple<double>, 3> moved{{{1, 0, 0}, {0, 3, 0}, {2, 0, 6}}};
  const auto displacement = [&](std::size_t i) { return moved[i]; };
  const auto frame = passive_frame(3, displacement, 0.1);
  CHECK(frame.mean.x == Approx(1));
  CHECK(frame.mean.y == Approx(1));
  CHECK(frame.mean.z == Approx(2));
  CHECK(frame.gift == Approx(1 + 1 + 16 + 0.25));
  const auto none = passive_frame(0, displacement, 0.0);
  CHECK(none.mean.x == 0);
  CHECK(none.gift == 0);
}
