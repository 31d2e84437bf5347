// SplitMix: published values, range and mean of its numbers.

#include "clothctl/grasp/detail/split_mix.hpp"

#include <cmath>
#include <cstdint>

#include "support/catch.hpp"

using clothctl::detail::SplitMix;

TEST_CASE("splitmix64 gives the published numbers", "[split_mix]") {
  SplitMix random(1234567);
  for (const std::uint64_t expected :
       {6457827717110365317u, 3203168211198807973u, 9817491932198370423u, 4593380528125082431u,
        16408922859458223821u})
    CHECK(random.next() == expected);
}

TEMPLATE_TEST_CASE("numbers are uniform in [0, 1)", "[split_mix]", float, double, long double) {
  using Scalar = TestType;
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    SplitMix random(seed);
    double sum = 0, squares = 0, products = 0, last = 0.5;
    bool inside = true;
    constexpr int kCount = 20000;
    for (int i = 0; i < kCount; ++i) {
      const Scalar x = random.uniform<Scalar>();
      inside = inside && x >= 0 && x < 1;
      const double centred = static_cast<double>(x) - 0.5;
      sum += centred;
      squares += centred * centred;
      products += centred * last;
      last = centred;
    }
    CHECK(inside);
    CHECK(std::abs(sum / kCount) < 0.01);
    CHECK(squares / kCount == Approx(1.0 / 12).epsilon(0.02));
    CHECK(std::abs(products / kCount) < 0.005);
  }
}

TEST_CASE("all scalars see the same stream", "[split_mix]") {
  SplitMix a(7), b(7), c(8);
  const float x = a.uniform<float>();
  CHECK(static_cast<double>(x) == b.uniform<double>());
  CHECK(static_cast<double>(x) != c.uniform<double>());
}
