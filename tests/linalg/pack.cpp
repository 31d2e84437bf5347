#include "clothctl/linalg/detail/pack.hpp"

#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

template <class Scalar, int kLanes>
void check_pack() {
  // An unaligned address, which packs must accept.
  std::vector<Scalar> memory(static_cast<std::size_t>(2 * kLanes + 2), Scalar(-1));
  Scalar* from = memory.data() + 1;
  for (int i = 0; i < kLanes; ++i) from[i] = Scalar(i + 1);
  Pack<Scalar, kLanes> a, b;
  a.load(from);
  b.load(from);
  a.add(b);                          // 2i
  a.scale(Scalar(3));                // 6i
  a.subtract(b);                     // 5i
  a.add_product(b, Scalar(2));       // 7i
  a.subtract_product(b, Scalar(6));  // i
  a.add_product(b, b);               // i + i²
  a.store(from + kLanes);
  for (int i = 1; i <= kLanes; ++i) CHECK(from[kLanes + i - 1] == Scalar(i + i * i));
  CHECK(b.sum() == Scalar(kLanes * (kLanes + 1) / 2));
  CHECK(memory.front() == Scalar(-1));
  CHECK(memory.back() == Scalar(-1));
  a.set_zero();
  CHECK(a.sum() == Scalar(0));
  STATIC_REQUIRE(Pack<Scalar, kLanes>::kChunk * Pack<Scalar, kLanes>::kChunks == kLanes);
}

template <class Scalar>
void check_packs() {
  check_pack<Scalar, 1>();
  check_pack<Scalar, 3>();
  check_pack<Scalar, 4>();
  check_pack<Scalar, 6>();
  check_pack<Scalar, 8>();
  check_pack<Scalar, 12>();
  check_pack<Scalar, 16>();
}

}  // namespace

TEST_CASE("Packs of any width do lane arithmetic") {
  check_packs<float>();
  check_packs<double>();
  check_packs<long double>();
}

TEST_CASE("Memory of packs has the same layout for every instruction set") {
  STATIC_REQUIRE(padded_lanes<float>() == 16);
  STATIC_REQUIRE(padded_lanes<double>() == 8);
  STATIC_REQUIRE(padded_lanes<long double>() == 1);
  STATIC_REQUIRE(padded_lanes<float>() % native_lanes<float>() == 0);
  STATIC_REQUIRE(padded_lanes<double>() % native_lanes<double>() == 0);
}

TEST_CASE("Names that depend on the instruction set contain its name") {
  // The full name exists only if the inline namespace has it.
  STATIC_REQUIRE(std::is_same_v<Pack<float, 8>, clothctl::CLOTHCTL_ABI::detail::Pack<float, 8>>);
  STATIC_REQUIRE(&kVectorBytes == &clothctl::CLOTHCTL_ABI::detail::kVectorBytes);
}

TEST_CASE("Unrolled loops count up") {
  int sum = 0, calls = 0;
  unroll<5>([&](auto i) {
    CHECK(i == calls);
    sum += i;
    ++calls;
  });
  CHECK(calls == 5);
  CHECK(sum == 10);
  unroll<0>([&](auto) { FAIL("no call expected"); });
}
