#pragma once

// Snapshots: a state as bytes, to store it, send it, or go on from it later. A restored state has
// the same bits, so a run that goes on from it has the same bits too. Layout, with all numbers
// little-endian whatever the machine:
//
//   at byte   bytes
//      0        8     "clothctl"
//      8        4     version of this layout, 1
//     12        4     scalar: 1 binary32, 2 binary64, 3 x87 extended, 4 binary128
//     16       24     name of the state, filled up with zero bytes
//     40        8     n, bytes of the fields
//     48        n     fields: kind (4 bytes: 1 scalars, 2 integers, 3 points), number of values
//                     (8 bytes), values (an integer 4 bytes, a point three scalars)
//     48+n      4     CRC-32C of all bytes before it
//
// Bytes are not trusted: the checksum is tested before anything else is used, and a count is
// compared with the bytes that are there before memory is allocated. The checksum detects every
// change of a single bit and every damage within 32 consecutive bits; other damage passes once in
// 4·10⁹ times. It does not protect against an attacker, who can compute it.

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/detail/crc32c.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a scalar is stored in a snapshot. Specialise it for your own scalar: `kCode` names the
/// format of the bytes, `kBytes` is their number, `store` writes a value to them, `load` reads it.
template <class Scalar>
struct snapshot_scalar_traits {};

/// The built-in scalars, bit by bit. A long double is stored in its own format, without padding.
template <std::floating_point Scalar>
requires(std::numeric_limits<Scalar>::digits != 106)  // a pair of doubles has no fixed format
    struct snapshot_scalar_traits<Scalar> {
  /// Format of the bytes: 1 binary32, 2 binary64, 3 x87 extended, 4 binary128.
  static constexpr std::uint32_t kCode = std::numeric_limits<Scalar>::digits == 24   ? 1
                                         : std::numeric_limits<Scalar>::digits == 53 ? 2
                                         : std::numeric_limits<Scalar>::digits == 64 ? 3
                                                                                     : 4;
  /// Number of bytes of a value.
  static constexpr std::size_t kBytes = kCode == 3 ? 10 : sizeof(Scalar);
  /// Writes the `kBytes` bytes of a value.
  static void store(const Scalar& value, std::byte* out) {
    std::memcpy(out, &value, kBytes);
    put_in_order(out);
  }
  /// Reads a value from `kBytes` bytes.
  static void load(const std::byte* in, Scalar& value) {
    std::array<std::byte, kBytes> bytes;
    std::memcpy(bytes.data(), in, kBytes);
    put_in_order(bytes.data());
    value = Scalar(0);  // padding, too
    std::memcpy(&value, bytes.data(), kBytes);
  }

 private:
  static void put_in_order(std::byte* bytes) {
    if constexpr (std::endian::native == std::endian::big) {
      for (std::size_t i = 0; i < kBytes / 2; ++i) std::swap(bytes[i], bytes[kBytes - 1 - i]);
    }
  }
};

/// A scalar that snapshots can hold: `snapshot_scalar_traits` tells how.
template <class Scalar>
concept SnapshotScalar = RealScalar<Scalar> &&
    requires(const Scalar value, Scalar read, std::byte* out, const std::byte* in) {
  { snapshot_scalar_traits<Scalar>::kCode } -> std::convertible_to<std::uint32_t>;
  { snapshot_scalar_traits<Scalar>::kBytes } -> std::convertible_to<std::size_t>;
  snapshot_scalar_traits<Scalar>::store(value, out);
  snapshot_scalar_traits<Scalar>::load(in, read);
};

namespace detail {

inline constexpr std::string_view kSnapshotMagic = "clothctl";
inline constexpr std::uint32_t kSnapshotVersion = 1;
inline constexpr std::size_t kSnapshotName = 24, kSnapshotHead = 48, kSnapshotFieldHead = 12,
                             kSnapshotChecksum = 4;

/// Kinds of fields.
enum class SnapshotField : std::uint32_t { Scalars = 1, Integers = 2, Points = 3 };

/// Returns what a field of this kind holds, for messages.
inline std::string field_name(std::uint32_t kind) {
  switch (kind) {
    case 1: return "scalars";
    case 2: return "integers";
    case 3: return "points";
    default: return "a field of kind " + std::to_string(kind);
  }
}

/// Returns the name of a scalar's format, for messages.
inline std::string scalar_format_name(std::uint32_t code) {
  switch (code) {
    case 1: return "binary32 (float)";
    case 2: return "binary64 (double)";
    case 3: return "x87 extended (long double)";
    case 4: return "binary128 (long double)";
    default: return "scalar format " + std::to_string(code);
  }
}

/// Writes the lowest `count` bytes of `value`, lowest first.
inline void store_bytes(std::uint64_t value, std::size_t count, std::byte* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<std::byte>(value >> (8 * i));
}

/// Reads a number of `count` bytes, lowest first.
inline std::uint64_t load_bytes(const std::byte* in, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value |= std::to_integer<std::uint64_t>(in[i]) << (8 * i);
  return value;
}

}  // namespace detail

/// Writes the fields of a state into a snapshot. `write_snapshot` makes one; `snapshot_traits` of a
/// state use it.
template <SnapshotScalar Scalar>
class SnapshotWriter {
 public:
  /// Starts a snapshot of a state called `name` (1 to 24 bytes, none zero) in `bytes`, which lose
  /// their content and keep their memory; they must outlive the writer.
  SnapshotWriter(std::string_view name, std::vector<std::byte>& bytes) : bytes_(bytes) {
    assert(!name.empty() && name.size() <= detail::kSnapshotName);
    bytes_.assign(detail::kSnapshotHead, std::byte(0));
    std::memcpy(bytes_.data(), detail::kSnapshotMagic.data(), detail::kSnapshotMagic.size());
    detail::store_bytes(detail::kSnapshotVersion, 4, bytes_.data() + 8);
    detail::store_bytes(Format::kCode, 4, bytes_.data() + 12);
    std::memcpy(bytes_.data() + 16, name.data(), (std::min)(name.size(), detail::kSnapshotName));
  }

  /// Adds a field of scalars. Allocates when `bytes` is too short for them.
  void scalars(std::span<const Scalar> values) {
    std::byte* out =
        open_field(detail::SnapshotField::Scalars, values.size(), Format::kBytes * values.size());
    for (std::size_t i = 0; i < values.size(); ++i)
      Format::store(values[i], out + Format::kBytes * i);
  }
  /// Adds a field of integers. Allocates when `bytes` is too short for them.
  void integers(std::span<const int> values) {
    std::byte* out = open_field(detail::SnapshotField::Integers, values.size(), 4 * values.size());
    for (std::size_t i = 0; i < values.size(); ++i)
      detail::store_bytes(static_cast<std::uint32_t>(values[i]), 4, out + 4 * i);
  }
  /// Adds a field of points (3×n). Allocates when `bytes` is too short for them.
  void points(const PointsView<Scalar>& values) {
    const std::size_t count = static_cast<std::size_t>(values.cols());
    std::byte* out = open_field(detail::SnapshotField::Points, count, 3 * Format::kBytes * count);
    for (Index i = 0; i < values.cols(); ++i) {
      for (Index c = 0; c < 3; ++c, out += Format::kBytes) Format::store(values(c, i), out);
    }
  }

  /// Completes the snapshot with its length and checksum. Call it once, after the last field.
  void finish() {
    detail::store_bytes(bytes_.size() - detail::kSnapshotHead, 8, bytes_.data() + 40);
    const std::uint32_t checksum = detail::crc32c(bytes_);
    bytes_.resize(bytes_.size() + detail::kSnapshotChecksum);
    detail::store_bytes(checksum, 4, bytes_.data() + bytes_.size() - detail::kSnapshotChecksum);
  }

 private:
  using Format = snapshot_scalar_traits<Scalar>;

  /// Adds the head of a field and room for its values; returns where they go.
  std::byte* open_field(detail::SnapshotField kind, std::size_t count, std::size_t size) {
    const std::size_t start = bytes_.size();
    bytes_.resize(start + detail::kSnapshotFieldHead + size);
    detail::store_bytes(static_cast<std::uint32_t>(kind), 4, bytes_.data() + start);
    detail::store_bytes(count, 8, bytes_.data() + start + 4);
    return bytes_.data() + start + detail::kSnapshotFieldHead;
  }

  std::vector<std::byte>& bytes_;
};

/// Reads the fields of a state from a snapshot, in the order in which they were written. The first
/// error is kept: after it, all reads return false and leave their argument alone. `read_snapshot`
/// makes a reader; `snapshot_traits` of a state use it.
template <SnapshotScalar Scalar>
class SnapshotReader {
 public:
  /// Tests length, version, checksum, scalar and name of a snapshot. `bytes` must outlive the
  /// reader.
  SnapshotReader(std::string_view name, std::span<const std::byte> bytes) : bytes_(bytes) {
    error_ = bad_frame();
    if (error_.empty()) error_ = bad_content(name);
    at_ = detail::kSnapshotHead;
    end_ = bytes.size() - (std::min)(bytes.size(), detail::kSnapshotChecksum);
  }

  /// Reads a field of scalars. Returns false, and keeps an error, when the next field is another.
  /// Allocates at most the size of the snapshot.
  bool scalars(std::vector<Scalar>& values) {
    const std::byte* in = nullptr;
    std::size_t count = 0;
    if (!open_field(detail::SnapshotField::Scalars, Format::kBytes, in, count)) return false;
    values.resize(count);
    for (std::size_t i = 0; i < count; ++i) Format::load(in + Format::kBytes * i, values[i]);
    return true;
  }
  /// Reads a field of integers. Returns false, and keeps an error, when the next field is another.
  /// Allocates at most the size of the snapshot.
  bool integers(std::vector<int>& values) {
    const std::byte* in = nullptr;
    std::size_t count = 0;
    if (!open_field(detail::SnapshotField::Integers, 4, in, count)) return false;
    values.resize(count);
    for (std::size_t i = 0; i < count; ++i)
      values[i] = static_cast<int>(static_cast<std::uint32_t>(detail::load_bytes(in + 4 * i, 4)));
    return true;
  }
  /// Reads a field of points (3×n). Returns false, and keeps an error, when the next field is
  /// another. Allocates at most the size of the snapshot.
  bool points(Points<Scalar>& values) {
    const std::byte* in = nullptr;
    std::size_t count = 0;
    if (!open_field(detail::SnapshotField::Points, 3 * Format::kBytes, in, count)) return false;
    values.resize(3, static_cast<Index>(count));
    for (std::size_t i = 0; i < 3 * count; ++i)
      Format::load(in + Format::kBytes * i, values.data()[i]);
    return true;
  }

  /// Keeps an error that the state's own checks have found, unless there is one already.
  void fail(const std::string& problem) {
    if (error_.empty()) error_ = "snapshot: " + problem;
  }

  /// Returns the first error, or an empty string when every field was read without one.
  std::string finish() {
    if (error_.empty() && at_ < end_)
      fail("byte " + std::to_string(at_) + ": " + std::to_string(end_ - at_) +
           " bytes of fields that the state does not have");
    return error_;
  }

 private:
  using Format = snapshot_scalar_traits<Scalar>;

  /// Returns what is wrong with magic, version, length or checksum, or "".
  std::string bad_frame() const {
    constexpr std::size_t least = detail::kSnapshotHead + detail::kSnapshotChecksum;
    const std::size_t size = bytes_.size();
    if (size < least)
      return "snapshot: " + std::to_string(size) + " bytes, fewer than the " +
             std::to_string(least) + " of an empty one";
    if (std::memcmp(bytes_.data(), detail::kSnapshotMagic.data(), 8) != 0)
      return "snapshot: byte 0: does not start with \"clothctl\"";
    if (const std::uint64_t version = number(8, 4); version != detail::kSnapshotVersion)
      return "snapshot: byte 8: version " + std::to_string(version) +
             " of the layout is not known, only 1 is";
    if (const std::uint64_t length = number(40, 8); length != size - least)
      return "snapshot: byte 40: fields of " + std::to_string(length) +
             " bytes are promised, but there are " + std::to_string(size - least);
    const std::size_t end = size - detail::kSnapshotChecksum;
    if (number(end, 4) != detail::crc32c(bytes_.first(end)))
      return "snapshot: byte " + std::to_string(end) +
             ": the checksum does not fit: bytes were changed or lost";
    return {};
  }

  /// Returns why the snapshot is not one of this state, or "".
  std::string bad_content(std::string_view name) const {
    if (const std::uint64_t code = number(12, 4); code != Format::kCode)
      return "snapshot: byte 12: holds " +
             detail::scalar_format_name(static_cast<std::uint32_t>(code)) + ", expected " +
             detail::scalar_format_name(Format::kCode);
    std::string found(reinterpret_cast<const char*>(bytes_.data()) + 16, detail::kSnapshotName);
    while (!found.empty() && found.back() == '\0') found.pop_back();
    if (found != name)
      return "snapshot: byte 16: holds a state " + quoted_text(found) + ", expected " +
             quoted_text(name);
    return {};
  }

  /// Moves behind the next field; sets where its values are and how many of `size` bytes each.
  bool open_field(detail::SnapshotField kind, std::size_t size, const std::byte*& in,
                  std::size_t& count) {
    if (!error_.empty()) return false;
    const std::string wanted = detail::field_name(static_cast<std::uint32_t>(kind));
    const std::string place = "byte " + std::to_string(at_) + ": ";
    if (end_ - at_ < detail::kSnapshotFieldHead) {
      fail(place + "ends, expected " + wanted);
      return false;
    }
    if (const std::uint64_t found = number(at_, 4); found != static_cast<std::uint64_t>(kind)) {
      fail(place + "expected " + wanted + ", found " +
           detail::field_name(static_cast<std::uint32_t>(found)));
      return false;
    }
    const std::uint64_t stored = number(at_ + 4, 8);
    const std::size_t left = end_ - at_ - detail::kSnapshotFieldHead;
    if (stored > left / size) {
      fail(place + std::to_string(stored) + " " + wanted + " of " + std::to_string(size) +
           " bytes each, but " + std::to_string(left) + " bytes are left");
      return false;
    }
    count = static_cast<std::size_t>(stored);
    in = bytes_.data() + at_ + detail::kSnapshotFieldHead;
    at_ += detail::kSnapshotFieldHead + count * size;
    return true;
  }

  std::uint64_t number(std::size_t at, std::size_t count) const {
    return detail::load_bytes(bytes_.data() + at, count);
  }

  std::span<const std::byte> bytes_;
  std::string error_;
  std::size_t at_ = 0;
  std::size_t end_ = 0;
};

/// How a state is written to a snapshot and read from it. Specialise it for your own state:
/// `Scalar`; `kName`, its name (1 to 24 bytes); `write`, which adds its fields to a writer; `read`,
/// which reads them in the same order, and calls `fail` of the reader when they contradict each
/// other.
template <class State>
struct snapshot_traits {};

/// Positions and velocities of a sheet.
template <SnapshotScalar S>
struct snapshot_traits<ClothState<S>> {
  /// The scalar of the state.
  using Scalar = S;
  /// The name in the snapshot.
  static constexpr std::string_view kName = "cloth_state";
  /// Adds positions and velocities.
  static void write(const ClothState<S>& state, SnapshotWriter<S>& writer) {
    writer.points(state.positions);
    writer.points(state.velocities);
  }
  /// Reads positions and velocities. Fails when: their numbers differ.
  static void read(SnapshotReader<S>& reader, ClothState<S>& state) {
    if (reader.points(state.positions) && reader.points(state.velocities) &&
        state.positions.cols() != state.velocities.cols())
      reader.fail(std::to_string(state.velocities.cols()) + " velocities for " +
                  std::to_string(state.positions.cols()) + " positions");
  }
};

/// A state that `write_snapshot` and `read_snapshot` take: `snapshot_traits` tells how.
template <class State>
concept SnapshotState = std::default_initializable<State> &&
    requires(const State& state, State& read,
             SnapshotWriter<typename snapshot_traits<State>::Scalar>& writer,
             SnapshotReader<typename snapshot_traits<State>::Scalar>& reader) {
  { snapshot_traits<State>::kName } -> std::convertible_to<std::string_view>;
  snapshot_traits<State>::write(state, writer);
  snapshot_traits<State>::read(reader, read);
};

/// Replaces the content of `bytes` by a snapshot of `state`. Values that are not finite are stored
/// like all others. Allocates only when the memory of `bytes` is too short, so bytes that held a
/// snapshot of an equally large state take another without allocation. Complexity: O(size).
template <SnapshotState State>
void write_snapshot(const State& state, std::vector<std::byte>& bytes) {
  SnapshotWriter<typename snapshot_traits<State>::Scalar> writer(snapshot_traits<State>::kName,
                                                                 bytes);
  snapshot_traits<State>::write(state, writer);
  writer.finish();
}

/// Returns the state in a snapshot, with the same bits. Name the type: read_snapshot<ClothState<
/// double>>(bytes). Allocates, at most about the size of the snapshot. Complexity: O(size). Fails
/// when: bytes were changed or lost, the version is unknown, the snapshot holds another state or
/// scalar, or its fields are not those of the state; the message names the byte.
template <SnapshotState State>
Result<State> read_snapshot(std::span<const std::byte> bytes) {
  SnapshotReader<typename snapshot_traits<State>::Scalar> reader(snapshot_traits<State>::kName,
                                                                 bytes);
  State state;
  snapshot_traits<State>::read(reader, state);
  if (std::string problem = reader.finish(); !problem.empty()) return Error{std::move(problem)};
  return state;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
