#pragma once

// Hashes of numbers, and whether the bits of this translation unit are fixed: on x86-64, without
// -march or -m options that allow AVX or fused multiply-add, and without -ffast-math.

#include <cstddef>
#include <cstdint>

namespace clothctl_test {

/// True if this translation unit is compiled with flags for which the bits are fixed.
#if defined(__x86_64__) && !defined(__AVX__) && !defined(__FMA__) && !defined(__FAST_MATH__)
inline constexpr bool kBaselineFlags = true;
#else
inline constexpr bool kBaselineFlags = false;
#endif

/// True if the compiler may assume that NaN does not exist and may reorder sums.
#if defined(__FAST_MATH__)
inline constexpr bool kFastMath = true;
#else
inline constexpr bool kFastMath = false;
#endif

/// The FNV-1a hash of nothing.
inline constexpr std::uint64_t kEmptyHash = 14695981039346656037u;

/// Returns the FNV-1a hash of `size` bytes after those that `hash` stands for.
inline std::uint64_t hash_bytes(const void* data, std::size_t size,
                                std::uint64_t hash = kEmptyHash) {
  const auto* byte = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) hash = (hash ^ byte[i]) * 1099511628211u;
  return hash;
}

}  // namespace clothctl_test
