#pragma once

// Version, what the library demands of compiler and Eigen, and its few macros.
//
// Other macros of the library: linalg/detail/pack.hpp defines CLOTHCTL_KERNEL and
// CLOTHCTL_KERNEL_LAMBDA, which make numeric kernels inline. They stay defined, because several
// headers use them; they are not for use outside of the library.

#if defined(_MSVC_LANG) ? _MSVC_LANG < 202002L : __cplusplus < 202002L
#error "clothctl needs C++20: compile with -std=c++20 (g++ 12, clang 14 or later) or /std:c++20"
#include "clothctl needs C++20"  // no such file: stops compilers that would go on
#endif

// g++ 12 warns of the undefined values in its own AVX-512 intrinsics (GCC bug 105593) wherever
// Eigen uses them. A pragma around the text that a warning is about suppresses the warning, so it
// suffices to include those headers here, before Eigen does. Every header of the library therefore
// includes this one before Eigen's.
#if defined(__GNUC__) && !defined(__clang__) && defined(__AVX512F__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop
#endif

#include <Eigen/Core>

#if !EIGEN_VERSION_AT_LEAST(3, 4, 0)
#error "clothctl needs Eigen 3.4 or newer"
#endif

#define CLOTHCTL_VERSION_MAJOR 0
#define CLOTHCTL_VERSION_MINOR 2
#define CLOTHCTL_VERSION_PATCH 0
#define CLOTHCTL_VERSION_STRING "0.2.0"

/// Forces a small hot function to be inlined where the compiler offers it.
#if defined(_MSC_VER)
#define CLOTHCTL_FORCE_INLINE __forceinline
#else
#define CLOTHCTL_FORCE_INLINE inline __attribute__((always_inline))
#endif

// Translation units of one program may be compiled for different instruction sets. The same
// template then becomes different code under the same name, of which a linker keeps one. The whole
// library therefore is in an inline namespace that is named after what its code depends on: its
// version, the instruction set, whether Eigen vectorises, what -ffast-math and -ffinite-math-only
// let the compiler assume, and how Eigen aligns memory on the heap and inside of objects.
#if defined(__AVX512DQ__) && defined(__AVX512VL__)
#define CLOTHCTL_ABI_VECTORS avx512_dq
#elif defined(__AVX512F__)
#define CLOTHCTL_ABI_VECTORS avx512
#elif defined(__AVX2__) && defined(__FMA__)
#define CLOTHCTL_ABI_VECTORS avx2_fma
#elif defined(__AVX2__)
#define CLOTHCTL_ABI_VECTORS avx2
#elif defined(__AVX__) && defined(__FMA__)
#define CLOTHCTL_ABI_VECTORS avx_fma
#elif defined(__AVX__)
#define CLOTHCTL_ABI_VECTORS avx
#elif defined(__SSE4_2__)
#define CLOTHCTL_ABI_VECTORS sse42
#elif defined(__SSE4_1__)
#define CLOTHCTL_ABI_VECTORS sse41
#elif defined(__SSSE3__)
#define CLOTHCTL_ABI_VECTORS ssse3
#elif defined(__SSE3__)
#define CLOTHCTL_ABI_VECTORS sse3
#elif defined(__ARM_FEATURE_SVE)
#define CLOTHCTL_ABI_VECTORS sve
#else
#define CLOTHCTL_ABI_VECTORS base
#endif
#if defined(EIGEN_DONT_VECTORIZE)
#define CLOTHCTL_ABI_EIGEN scalar
#else
#define CLOTHCTL_ABI_EIGEN simd
#endif
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#define CLOTHCTL_ABI_NUMBERS fast
#elif defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0
#define CLOTHCTL_ABI_NUMBERS finite
#else
#define CLOTHCTL_ABI_NUMBERS ieee
#endif
#define CLOTHCTL_ABI_JOIN(major, minor, vectors, eigen, numbers, heap, object) \
  v##major##_##minor##_##vectors##_##eigen##_##numbers##_##heap##_##object
#define CLOTHCTL_ABI_NAME(major, minor, vectors, eigen, numbers, heap, object) \
  CLOTHCTL_ABI_JOIN(major, minor, vectors, eigen, numbers, heap, object)

/// The inline namespace of the library in this translation unit, such as
/// v0_2_avx2_fma_simd_ieee_32_32. Not for use outside of the library.
#define CLOTHCTL_ABI                                                                      \
  CLOTHCTL_ABI_NAME(CLOTHCTL_VERSION_MAJOR, CLOTHCTL_VERSION_MINOR, CLOTHCTL_ABI_VECTORS, \
                    CLOTHCTL_ABI_EIGEN, CLOTHCTL_ABI_NUMBERS, EIGEN_DEFAULT_ALIGN_BYTES,  \
                    EIGEN_MAX_STATIC_ALIGN_BYTES)

// Eigen's own templates are in no such namespace. A linker may merge them between instruction sets
// as long as Eigen aligns memory alike in all translation units, for example by
// EIGEN_MAX_ALIGN_BYTES=64 and EIGEN_MAX_STATIC_ALIGN_BYTES=16. If alignments differ, one unit may
// free memory that another unit allocated by a different method. So each unit defines one symbol
// whose value encodes how Eigen aligns, and linkers refuse a program with two values (those of g++
// -flto do not notice). CLOTHCTL_NO_LINK_CHECK leaves the symbol out.
#define CLOTHCTL_ABI_TEXT_OF(text) #text
#define CLOTHCTL_ABI_TEXT(text) CLOTHCTL_ABI_TEXT_OF(text)
#if defined(CLOTHCTL_NO_LINK_CHECK)
#elif defined(_MSC_VER)
#pragma detect_mismatch("clothctl: units differ in EIGEN_MAX_ALIGN_BYTES",                  \
                        CLOTHCTL_ABI_TEXT(EIGEN_DEFAULT_ALIGN_BYTES) "_" CLOTHCTL_ABI_TEXT( \
                            EIGEN_MAX_STATIC_ALIGN_BYTES))
#elif defined(__ELF__) && defined(__GNUC__) && \
    !defined(__clang__)  // clang -flto refuses equal ones
#define CLOTHCTL_ABI_SYMBOL                       \
  "clothctl_needs_one_EIGEN_MAX_ALIGN_BYTES_and_" \
  "EIGEN_MAX_STATIC_ALIGN_BYTES_in_all_units_of_" CLOTHCTL_ABI_TEXT(Eigen)
__asm__(".globl " CLOTHCTL_ABI_SYMBOL "\n.hidden " CLOTHCTL_ABI_SYMBOL "\n.set " CLOTHCTL_ABI_SYMBOL
        ", 1000 * (" CLOTHCTL_ABI_TEXT(EIGEN_DEFAULT_ALIGN_BYTES) ") + (" CLOTHCTL_ABI_TEXT(
            EIGEN_MAX_STATIC_ALIGN_BYTES) ")\n");
#undef CLOTHCTL_ABI_SYMBOL
#endif

// A program that defines CLOTHCTL_PRECOMPILED links the library clothctl_precompiled, which holds
// the heavy templates for the usual scalars, compiled once. Headers name these templates by
// CLOTHCTL_INSTANTIATE, which declares an explicit instantiation in such a program and does nothing
// otherwise. The sources of that library redefine CLOTHCTL_EXTERN as empty, which makes the
// declaration a definition. No function template with a parameter Eigen::Ref<MatrixX<Scalar>> may
// be among them, only members of classes: clang 14 gives such a function a name that depends on
// what the translation unit has seen before.
#if defined(CLOTHCTL_PRECOMPILED)
#define CLOTHCTL_EXTERN extern
#define CLOTHCTL_INSTANTIATE(...) CLOTHCTL_EXTERN template __VA_ARGS__
#else
#define CLOTHCTL_INSTANTIATE(...) static_assert(true)
#endif
