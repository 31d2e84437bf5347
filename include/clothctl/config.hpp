#pragma once

// Version and the few macros there are. Nothing here includes anything.
//
// Macros of the library, besides those below: math/pack.hpp defines CLOTHCTL_KERNEL and CLOTHCTL_KERNEL_LAMBDA, which make
// numeric kernels inline, and CLOTHCTL_ISA, the name of the instruction set that a unit is compiled for. They stay defined,
// since several headers use them; they are not for use outside of the library.

#define CLOTHCTL_VERSION_MAJOR 0
#define CLOTHCTL_VERSION_MINOR 1
#define CLOTHCTL_VERSION_PATCH 0
#define CLOTHCTL_VERSION_STRING "0.1.0"

/// Forces a small hot function to be inlined where the compiler offers it.
#if defined(_MSC_VER)
#define CLOTHCTL_FORCE_INLINE __forceinline
#else
#define CLOTHCTL_FORCE_INLINE inline __attribute__((always_inline))
#endif
