#include "clothctl/core/snapshot.hpp"

#include <cstring>
#include <limits>
#include <random>
#include <type_traits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Bytes = std::vector<std::byte>;

template <class Scalar>
ClothState<Scalar> sample_state(Index vertices) {
  ClothState<Scalar> state;
  state.positions.resize(3, vertices);
  state.velocities.resize(3, vertices);
  std::mt19937 random(5);
  const auto next = [&] { return Scalar(random()) / Scalar(3e9) - Scalar(0.6); };
  for (Index i = 0; i < 3 * vertices; ++i) {
    state.positions.data()[i] = next();
    state.velocities.data()[i] = next();
  }
  return state;
}

/// Compares bits, so that -0 differs from 0 and NaN equals itself. Padding does not count.
template <class Scalar>
bool same_bits(const Points<Scalar>& a, const Points<Scalar>& b) {
  if (a.cols() != b.cols()) return false;
  std::byte p[16], q[16];
  for (Index i = 0; i < a.size(); ++i) {
    snapshot_scalar_traits<Scalar>::store(a.data()[i], p);
    snapshot_scalar_traits<Scalar>::store(b.data()[i], q);
    if (std::memcmp(p, q, snapshot_scalar_traits<Scalar>::kBytes) != 0) return false;
  }
  return true;
}

template <class Scalar>
Bytes bytes_of(const ClothState<Scalar>& state) {
  Bytes bytes;
  write_snapshot(state, bytes);
  return bytes;
}

/// Why the bytes are refused as a ClothState<double>, or "".
std::string refusal(const Bytes& bytes) {
  const Result<ClothState<double>> state = read_snapshot<ClothState<double>>(bytes);
  return state ? std::string() : state.error();
}

void put(std::uint64_t value, std::size_t count, std::size_t at, Bytes& bytes) {
  for (std::size_t i = 0; i < count; ++i) bytes[at + i] = static_cast<std::byte>(value >> (8 * i));
}

/// Makes the checksum fit again, as an attacker would.
void reseal(Bytes& bytes) {
  const std::size_t end = bytes.size() - 4;
  put(detail::crc32c(std::span<const std::byte>(bytes).first(end)), 4, end, bytes);
}

/// A state of another kind, such as a model with plastic springs would have.
struct WornSprings {
  std::vector<double> rest_lengths;
  std::vector<int> torn;
  Points<double> anchors;
};

}  // namespace

namespace clothctl {

template <>
struct snapshot_traits<WornSprings> {
  using Scalar = double;
  static constexpr std::string_view kName = "worn_springs";
  static void write(const WornSprings& state, SnapshotWriter<double>& writer) {
    writer.scalars(state.rest_lengths);
    writer.integers(state.torn);
    writer.points(state.anchors);
  }
  static void read(SnapshotReader<double>& reader, WornSprings& state) {
    reader.scalars(state.rest_lengths);
    reader.integers(state.torn);
    reader.points(state.anchors);
  }
};

}  // namespace clothctl

static_assert(SnapshotState<ClothState<float>> && SnapshotState<WornSprings>);
static_assert(!SnapshotState<int> && !SnapshotState<ClothInput<double>>);

TEMPLATE_TEST_CASE("a restored state has the same bits", "[snapshot]", float, double, long double) {
  using S = TestType;
  ClothState<S> state = sample_state<S>(7);
  state.positions(0, 0) = S(-0.0);
  state.positions(1, 0) = std::numeric_limits<S>::denorm_min();
  state.positions(2, 3) = (std::numeric_limits<S>::max)();
  state.velocities(1, 2) = std::numeric_limits<S>::quiet_NaN();
  state.velocities(2, 2) = -std::numeric_limits<S>::infinity();
  const Result<ClothState<S>> restored = read_snapshot<ClothState<S>>(bytes_of(state));
  REQUIRE(restored);
  CHECK(same_bits(restored->positions, state.positions));
  CHECK(same_bits(restored->velocities, state.velocities));
  const Result<ClothState<S>> none = read_snapshot<ClothState<S>>(bytes_of(ClothState<S>{}));
  REQUIRE(none);
  CHECK(*none == ClothState<S>{});
}

TEST_CASE("the bytes of a snapshot are those of the documented layout", "[snapshot]") {
  ClothState<float> state;
  state.positions.resize(3, 1);
  state.positions << 1.0f, -2.0f, 0.5f;
  state.velocities = Points<float>::Zero(3, 1);
  const unsigned char wanted[] = {
      'c', 'l', 'o', 't', 'h', 'c', 't', 'l', 1, 0, 0, 0,  1, 0, 0, 0, 'c', 'l', 'o', 't',
      'h', '_', 's', 't', 'a', 't', 'e', 0,   0, 0, 0, 0,  0, 0, 0, 0, 0,   0,   0,   0,
      48,  0,   0,   0,   0,   0,   0,   0,   3, 0, 0, 0,  1, 0, 0, 0, 0,   0,   0,   0,
      0,   0,   128, 63,  0,   0,   0,   192, 0, 0, 0, 63, 3, 0, 0, 0, 1,   0,   0,   0,
      0,   0,   0,   0,   0,   0,   0,   0,   0, 0, 0, 0,  0, 0, 0, 0};
  const Bytes bytes = bytes_of(state);
  REQUIRE(bytes.size() == sizeof wanted + 4);
  CHECK(std::memcmp(bytes.data(), wanted, sizeof wanted) == 0);
  Bytes sealed = bytes;
  reseal(sealed);
  CHECK(sealed == bytes);
}

TEST_CASE("columns of a larger matrix are stored without the rows between them", "[snapshot]") {
  DenseMatrix<double, 4, Eigen::Dynamic> wide(4, 3);
  wide << 1, 2, 3, 4, 5, 6, 7, 8, 9, -1, -1, -1;
  Bytes bytes;
  SnapshotWriter<double> writer("rows", bytes);
  writer.points(wide.topRows<3>());
  writer.finish();
  SnapshotReader<double> reader("rows", bytes);
  Points<double> points;
  REQUIRE(reader.points(points));
  CHECK(reader.finish().empty());
  CHECK(points == wide.topRows<3>());
}

TEST_CASE("any state takes part through its trait", "[snapshot]") {
  WornSprings state;
  state.rest_lengths = {0.1, 0.2, 0.25};
  state.torn = {0, -1, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()};
  state.anchors = sample_state<double>(2).positions;
  Bytes bytes;
  write_snapshot(state, bytes);
  const Result<WornSprings> restored = read_snapshot<WornSprings>(bytes);
  REQUIRE(restored);
  CHECK(restored->rest_lengths == state.rest_lengths);
  CHECK(restored->torn == state.torn);
  CHECK(restored->anchors == state.anchors);
  CHECK(refusal(bytes) ==
        "snapshot: byte 16: holds a state \"worn_springs\", expected \"cloth_state\"");
}

TEST_CASE("every change of one bit, every truncation and every extension is noticed",
          "[snapshot]") {
  const Bytes bytes = bytes_of(sample_state<double>(3));
  REQUIRE(refusal(bytes).empty());
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      Bytes spoilt = bytes;
      spoilt[i] ^= static_cast<std::byte>(1 << bit);
      CAPTURE(i, bit);
      CHECK_FALSE(refusal(spoilt).empty());
    }
  }
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    CAPTURE(length);
    CHECK_FALSE(refusal(Bytes(bytes.begin(), bytes.begin() + std::ptrdiff_t(length))).empty());
  }
  Bytes longer = bytes;
  longer.push_back(std::byte(0));
  CHECK_FALSE(refusal(longer).empty());
}

TEST_CASE("messages say what is wrong and at which byte", "[snapshot]") {
  const Bytes bytes = bytes_of(sample_state<double>(3));  // 48 + 2·(12 + 72) + 4 bytes
  REQUIRE(bytes.size() == 220);
  const auto spoilt = [&](std::uint64_t value, std::size_t count, std::size_t at) {
    Bytes copy = bytes;
    put(value, count, at, copy);
    reseal(copy);
    return refusal(copy);
  };
  CHECK(refusal({}) == "snapshot: 0 bytes, fewer than the 52 of an empty one");
  CHECK(spoilt('C', 1, 0) == "snapshot: byte 0: does not start with \"clothctl\"");
  CHECK(spoilt(9, 4, 8) == "snapshot: byte 8: version 9 of the layout is not known, only 1 is");
  CHECK(spoilt(77, 4, 12) ==
        "snapshot: byte 12: holds scalar format 77, expected binary64 (double)");
  CHECK(spoilt('\n', 1, 16) ==
        "snapshot: byte 16: holds a state \"\\nloth_state\", expected \"cloth_state\"");
  CHECK(refusal(Bytes(bytes.begin(), bytes.end() - 1)) ==
        "snapshot: byte 40: fields of 168 bytes are promised, but there are 167");
  CHECK(spoilt(2, 4, 48) == "snapshot: byte 48: expected points, found integers");
  CHECK(spoilt(8, 4, 132) == "snapshot: byte 132: expected points, found a field of kind 8");
  CHECK(spoilt(2, 8, 136) == "snapshot: 2 velocities for 3 positions");
  Bytes changed = bytes;
  changed[100] ^= std::byte(1);
  CHECK(refusal(changed) ==
        "snapshot: byte 216: the checksum does not fit: bytes were changed or lost");
  CHECK(refusal(bytes_of(sample_state<float>(3))) ==
        "snapshot: byte 12: holds binary32 (float), expected binary64 (double)");
}

TEST_CASE("fields that do not follow each other as in the state are refused", "[snapshot]") {
  Bytes bytes;
  const auto made = [&](int fields) {
    SnapshotWriter<double> writer("cloth_state", bytes);
    for (int i = 0; i < fields; ++i) writer.points(Points<double>::Zero(3, 1));
    writer.finish();
    return refusal(bytes);
  };
  CHECK(made(0) == "snapshot: byte 48: ends, expected points");
  CHECK(made(1) == "snapshot: byte 84: ends, expected points");
  CHECK(made(2).empty());
  CHECK(made(3) == "snapshot: byte 120: 36 bytes of fields that the state does not have");
}

TEST_CASE("absurd counts are refused before memory is allocated", "[snapshot]") {
  const Bytes bytes = bytes_of(sample_state<double>(3));
  for (const std::uint64_t count :
       {std::uint64_t(7), std::uint64_t(1) << 31, std::uint64_t(1) << 40,
        std::uint64_t(0x0aaaaaaaaaaaaaabu), ~std::uint64_t(0)}) {  // the fourth overflows 24·count
    Bytes copy = bytes;
    put(count, 8, 52, copy);
    reseal(copy);
    CHECK(refusal(copy) == "snapshot: byte 48: " + std::to_string(count) +
                               " points of 24 bytes each, but 156 bytes are left");
    put(count, 8, 40, copy);  // the length of all fields
    reseal(copy);
    CHECK_FALSE(refusal(copy).empty());
  }
}

TEST_CASE("random bytes with a good checksum never crash a reader", "[snapshot]") {
  std::mt19937 random(3);
  const Bytes bytes = bytes_of(sample_state<double>(4));
  for (int trial = 0; trial < 20000; ++trial) {
    Bytes copy = bytes;
    const int changes = 1 + static_cast<int>(random() % 6u);
    for (int i = 0; i < changes; ++i) {
      const std::size_t at = random() % 2u != 0 ? random() % 64u : random() % copy.size();
      copy[at] = static_cast<std::byte>(random() & 255u);
    }
    if (random() % 4u == 0) copy.resize(random() % (copy.size() + 1));
    if (copy.size() >= 4) reseal(copy);
    (void)read_snapshot<ClothState<double>>(copy);
    (void)read_snapshot<ClothState<float>>(copy);
    (void)read_snapshot<WornSprings>(copy);
  }
  SUCCEED();
}

TEST_CASE("a reader keeps its first error and then leaves everything alone", "[snapshot]") {
  Bytes bytes;
  SnapshotWriter<double> writer("mixed", bytes);
  writer.integers(std::vector<int>{1, 2});
  writer.scalars(std::vector<double>{0.5});
  writer.finish();
  SnapshotReader<double> reader("mixed", bytes);
  std::vector<int> integers{9};
  std::vector<double> scalars{8.0};
  Points<double> points = Points<double>::Ones(3, 1);
  CHECK_FALSE(reader.points(points));
  CHECK_FALSE(reader.integers(integers));
  CHECK_FALSE(reader.scalars(scalars));
  reader.fail("later");
  CHECK(reader.finish() == "snapshot: byte 48: expected points, found integers");
  CHECK(integers == std::vector<int>{9});
  CHECK(scalars == std::vector<double>{8.0});
  CHECK(points == Points<double>::Ones(3, 1));
  SnapshotReader<double> unread("mixed", bytes);
  CHECK(unread.integers(integers));
  CHECK_FALSE(unread.finish().empty());
}

TEST_CASE("a snapshot into the bytes of an earlier one does not allocate", "[snapshot]") {
  if (!clothctl_test::allocation_counting_works()) {
    WARN("allocations cannot be counted in this build");
    return;
  }
  const ClothState<double> state = sample_state<double>(50);
  Bytes bytes = bytes_of(state);
  const Bytes first = bytes;
  const long before = clothctl_test::allocations();
  write_snapshot(state, bytes);
  const long during = clothctl_test::allocations() - before;
  CHECK(during == 0);
  CHECK(bytes == first);
}
