#include "clothctl/core/simd.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "support/bits.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using clothctl_test::kFastMath;
using clothctl_test::Numbers;

namespace {

/// A scalar and a number of lanes.
template <class S, int kCount>
struct Lane {
  using Scalar = S;
  static constexpr int kLanes = kCount;
  using Pack = Simd<S, kCount>;
  using List = std::array<S, static_cast<std::size_t>(kCount)>;

  static List random(unsigned seed, double low = -3.0, double high = 3.0) {
    Numbers numbers(seed);
    List list;
    for (S& value : list) value = S(numbers(low, high));
    return list;
  }
  static List list(const Pack& pack) {
    List out;
    pack.store(out.data());
    return out;
  }
};

/// The largest relative error of reciprocal_sqrt over mantissas at one exponent.
template <class Scalar>
long double worst_at_exponent(int exponent, int steps) {
  constexpr int kLanes = 8;
  long double worst = 0;
  for (int i = 0; i < steps; i += kLanes) {
    std::array<Scalar, kLanes> x, y;
    for (int k = 0; k < kLanes; ++k) {
      const Scalar mantissa = Scalar(1) + Scalar(i + k) / Scalar(steps);
      x[static_cast<std::size_t>(k)] = std::ldexp(mantissa, exponent);
    }
    reciprocal_sqrt(Simd<Scalar, kLanes>::load(x.data())).store(y.data());
    for (std::size_t k = 0; k < kLanes; ++k) {
      const long double exact = 1.0L / std::sqrt(static_cast<long double>(x[k]));
      worst = std::max(worst, std::abs(static_cast<long double>(y[k]) / exact - 1.0L));
    }
  }
  return worst;
}

}  // namespace

#define CLOTHCTL_TEST_LANES                                                                   \
  (Lane<float, 16>), (Lane<float, 8>), (Lane<float, 4>), (Lane<float, 3>), (Lane<float, 12>), \
      (Lane<double, 8>), (Lane<double, 6>), (Lane<double, 1>), (Lane<double, 2>),             \
      (Lane<long double, 1>), (Lane<long double, 4>)

TEMPLATE_TEST_CASE("simd: each operation is the operation of the lanes", "[simd]",
                   CLOTHCTL_TEST_LANES) {
  using Pack = typename TestType::Pack;
  using Scalar = typename TestType::Scalar;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto a = TestType::random(2 * seed), b = TestType::random(2 * seed + 1);
    const Pack p = Pack::load(a.data()), q = Pack::load(b.data());
    CHECK(TestType::list(p) == a);
    const auto sum = TestType::list(p + q), difference = TestType::list(p - q),
               product = TestType::list(p * q), quotient = TestType::list(p / q),
               positive = TestType::list(where_positive(p, q)), most = TestType::list(larger(p, q)),
               same = TestType::list(Pack::all(a[0]));
    for (std::size_t i = 0; i < a.size(); ++i) {
      CHECK(sum[i] == a[i] + b[i]);
      CHECK(difference[i] == a[i] - b[i]);
      CHECK(product[i] == a[i] * b[i]);
      if (kFastMath) {
        CHECK(quotient[i] == Approx(a[i] / b[i]).epsilon(1e-5));
      } else {
        CHECK(quotient[i] == a[i] / b[i]);
      }
      CHECK(positive[i] == (a[i] > Scalar(0) ? b[i] : Scalar(0)));
      CHECK(most[i] == std::max(a[i], b[i]));
      CHECK(same[i] == a[0]);
    }
    CHECK(p.largest() == *std::max_element(a.begin(), a.end()));
  }
}

TEMPLATE_TEST_CASE("simd: a register divides the lanes", "[simd]", CLOTHCTL_TEST_LANES) {
  using Pack = typename TestType::Pack;
  constexpr int chunk = Pack::kChunk;
  CHECK(chunk * Pack::kChunks == TestType::kLanes);
  CHECK((chunk & (chunk - 1)) == 0);
  CHECK(chunk <= clothctl::detail::native_lanes<typename TestType::Scalar>());
  CHECK(sizeof(Pack) == sizeof(typename TestType::Scalar) * std::size_t(TestType::kLanes));
}

TEMPLATE_TEST_CASE("simd: loads and stores need no alignment and touch no neighbour", "[simd]",
                   CLOTHCTL_TEST_LANES) {
  using Scalar = typename TestType::Scalar;
  using Pack = typename TestType::Pack;
  constexpr std::size_t kLanes = std::size_t(TestType::kLanes);
  std::vector<Scalar> memory(kLanes + 4);
  for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = Scalar(static_cast<double>(i));
  for (std::size_t shift = 1; shift < 4; ++shift) {
    std::vector<Scalar> copy(memory.size(), Scalar(-1));
    Pack::load(memory.data() + shift).store(copy.data() + shift);
    for (std::size_t i = 0; i < copy.size(); ++i)
      CHECK(copy[i] == (i >= shift && i < shift + kLanes ? memory[i] : Scalar(-1)));
  }
}

TEMPLATE_TEST_CASE("simd: lanes are added in their order", "[simd]", (Lane<float, 16>),
                   (Lane<float, 5>), (Lane<double, 8>), (Lane<long double, 4>)) {
  using Scalar = typename TestType::Scalar;
  if (kFastMath) return;
  // A term that is lost or not according to the order.
  const Scalar big = Scalar(4) / std::numeric_limits<Scalar>::epsilon();
  for (unsigned seed = 0; seed < 50; ++seed) {
    auto a = TestType::random(seed, 0.1, 1.0);
    Numbers numbers(seed);
    a[std::size_t(numbers.below(TestType::kLanes))] += big;
    a[std::size_t(numbers.below(TestType::kLanes))] -= big;
    Scalar total = a[0];
    for (std::size_t i = 1; i < a.size(); ++i) total += a[i];
    CHECK(TestType::Pack::load(a.data()).sum() == total);
  }
}

TEMPLATE_TEST_CASE("simd: NaN and zero in comparisons", "[simd]", CLOTHCTL_TEST_LANES) {
  using Pack = typename TestType::Pack;
  using Scalar = typename TestType::Scalar;
  if (kFastMath) return;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  const Scalar infinity = std::numeric_limits<Scalar>::infinity();
  const Pack one = Pack::all(Scalar(1)), none = Pack::all(nan), zero = Pack::all(Scalar(0));
  const auto first = [](const Pack& pack) { return TestType::list(pack).back(); };
  CHECK(first(larger(none, one)) == Scalar(1));
  CHECK(std::isnan(first(larger(one, none))));
  CHECK(first(larger(Pack::all(infinity), one)) == infinity);
  CHECK(first(larger(Pack::all(-infinity), one)) == Scalar(1));
  CHECK(first(where_positive(none, one)) == Scalar(0));
  CHECK(first(where_positive(zero, one)) == Scalar(0));
  CHECK(first(where_positive(Pack::all(Scalar(-0.0)), one)) == Scalar(0));
  // What is not selected does not spread.
  CHECK(first(where_positive(zero, none)) == Scalar(0));
  CHECK(first(where_positive(zero, Pack::all(infinity))) == Scalar(0));
  auto list = TestType::random(1);
  list[0] = nan;
  CHECK(std::isnan(Pack::load(list.data()).largest()));
}

TEST_CASE("simd: 1/sqrt is accurate over the whole range", "[simd]") {
  // Where products may be reordered, y² must neither over- nor underflow.
  const int least = kFastMath ? -100 : -126, most = kFastMath ? 100 : 128;
  long double worst = 0;
  for (int exponent = least; exponent < most; ++exponent)
    worst = std::max(worst, worst_at_exponent<float>(exponent, 512));
  for (int exponent : {0, 1}) worst = std::max(worst, worst_at_exponent<float>(exponent, 1 << 18));
  CHECK(worst < 8e-7L);
  CHECK(worst > 1e-8L);
  worst = 0;
  for (int exponent = 8 * least - 14; exponent < 8 * most; ++exponent)
    worst = std::max(worst, worst_at_exponent<double>(exponent, 128));
  for (int exponent : {0, 1}) worst = std::max(worst, worst_at_exponent<double>(exponent, 1 << 18));
  CHECK(worst < 1e-15L);
  worst = 0;
  for (int exponent = -100; exponent < 1000; exponent += 7)
    worst = std::max(worst, worst_at_exponent<long double>(exponent, 64));
  CHECK(worst < 4 * std::numeric_limits<long double>::epsilon());
}

TEMPLATE_TEST_CASE("simd: 1/sqrt of zero is finite and large", "[simd]", CLOTHCTL_TEST_LANES) {
  using Pack = typename TestType::Pack;
  using Scalar = typename TestType::Scalar;
  if (kFastMath) return;
  for (const Scalar y : TestType::list(reciprocal_sqrt(Pack::all(Scalar(0))))) {
    CHECK(is_finite(y));
    CHECK(y >= Scalar(0.99e18));
    // So a vanishing length stays zero: x/√x = 0.
    CHECK(Scalar(0) * y == Scalar(0));
  }
}

TEMPLATE_TEST_CASE("simd: 1/sqrt does not depend on the number of lanes", "[simd]", float, double) {
  using Scalar = TestType;
  Numbers numbers(3);
  std::array<Scalar, 16> x, wide, narrow;
  for (Scalar& value : x) value = Scalar(numbers(1e-6, 1e3));
  reciprocal_sqrt(Simd<Scalar, 16>::load(x.data())).store(wide.data());
  for (std::size_t i = 0; i < 16; i += 4)
    reciprocal_sqrt(Simd<Scalar, 4>::load(x.data() + i)).store(narrow.data() + i);
  for (std::size_t i = 0; i < 16; ++i)
    CHECK(wide[i] == Approx(narrow[i]).epsilon(2 * std::numeric_limits<Scalar>::epsilon()));
  if (clothctl_test::kBaselineFlags) CHECK(wide == narrow);
}

TEMPLATE_TEST_CASE("simd: the bits of 1/sqrt are those on record", "[simd]", float, double) {
  if (!clothctl_test::kBaselineFlags) {
    WARN("skipped: equal bits are promised for x86-64 at baseline flags only");
    return;
  }
  using Scalar = TestType;
  std::uint64_t hash = clothctl_test::kEmptyHash;
  for (int i = 0; i < 4096; ++i) {
    const Scalar x = Scalar(1e-6) * Scalar(i + 1) * Scalar(i + 1);
    std::array<Scalar, 8> y;
    reciprocal_sqrt(Simd<Scalar, 8>::all(x)).store(y.data());
    hash = clothctl_test::hash_bytes(y.data(), sizeof y, hash);
  }
  CHECK(hash == (std::is_same_v<Scalar, float> ? 0x6dae9949883f4c15u : 0x0763e1d220eee105u));
}
