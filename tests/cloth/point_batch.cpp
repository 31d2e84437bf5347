#include "clothctl/cloth/detail/point_batch.hpp"

#include <array>
#include <type_traits>
#include <vector>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;

namespace {

/// The lanes of a pack.
template <class Scalar, int kLanes>
std::vector<Scalar> lanes_of(const Simd<Scalar, kLanes>& pack) {
  std::vector<Scalar> out(static_cast<std::size_t>(kLanes));
  pack.store(out.data());
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("point batch: lane i holds the four numbers at offset i", "[point_batch]", float,
                   double, long double) {
  using Scalar = TestType;
  using Batch = PointBatch<Scalar>;
  constexpr std::size_t kLanes = std::size_t(Batch::kLanes);
  Numbers random(1);
  std::vector<Scalar> memory(4 * 40 + 1);
  for (Scalar& value : memory) value = Scalar(random(-1, 1));
  for (int trial = 0; trial < 50; ++trial) {
    std::array<int, kLanes> offset;
    // Any offset, also one that is no multiple of four; vertices may repeat.
    for (int& at : offset) at = random.below(4 * 39);
    const Batch batch = Batch::load(memory.data(), offset.data());
    const auto x = lanes_of(batch.x), y = lanes_of(batch.y), z = lanes_of(batch.z),
               w = lanes_of(batch.w);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const std::size_t at = static_cast<std::size_t>(offset[i]);
      CHECK(x[i] == memory[at]);
      CHECK(y[i] == memory[at + 1]);
      CHECK(z[i] == memory[at + 2]);
      CHECK(w[i] == memory[at + 3]);
    }
  }
}

TEMPLATE_TEST_CASE("point batch: a store writes each lane to its vertex and nothing else",
                   "[point_batch]", float, double, long double) {
  using Scalar = TestType;
  using Batch = PointBatch<Scalar>;
  constexpr std::size_t kLanes = std::size_t(Batch::kLanes);
  Numbers random(2);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<int> vertices;
    for (int v = 0; v < 40; ++v) vertices.push_back(v);
    random.shuffle(vertices);
    std::array<int, kLanes> offset;
    for (std::size_t i = 0; i < kLanes; ++i) offset[i] = 4 * vertices[i];
    std::vector<Scalar> memory(4 * 40, Scalar(-7)), expected = memory;
    std::array<std::array<Scalar, kLanes>, 4> value;
    for (std::size_t c = 0; c < 4; ++c) {
      for (std::size_t i = 0; i < kLanes; ++i) {
        value[c][i] = Scalar(random(-1, 1));
        expected[static_cast<std::size_t>(offset[i]) + c] = value[c][i];
      }
    }
    using Pack = typename Batch::Pack;
    const Batch batch{Pack::load(value[0].data()), Pack::load(value[1].data()),
                      Pack::load(value[2].data()), Pack::load(value[3].data())};
    batch.store(memory.data(), offset.data());
    CHECK(memory == expected);
  }
}

TEMPLATE_TEST_CASE("point batch: lanes of one vertex may be stored with the same numbers",
                   "[point_batch]", float, double, long double) {
  using Scalar = TestType;
  using Batch = PointBatch<Scalar>;
  std::vector<Scalar> memory{Scalar(1), Scalar(2), Scalar(3), Scalar(4),
                             Scalar(5), Scalar(6), Scalar(7), Scalar(8)};
  std::array<int, std::size_t(Batch::kLanes)> offset;
  offset.fill(4);
  const std::vector<Scalar> before = memory;
  Batch::load(memory.data(), offset.data()).store(memory.data(), offset.data());
  CHECK(memory == before);
}
