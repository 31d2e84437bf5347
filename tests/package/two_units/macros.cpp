// Some systems' headers define common words as macros. The library's headers compile after them.

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <queue>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

// Function-like macros of windows.h.
#define min(a, b) (((a) < (b)) ? (a) : (b))
#define max(a, b) (((a) > (b)) ? (a) : (b))

// These words are empty or numbers there. Here, any use of one is an error.
#define CLOTHCTL_TAKEN static_assert(false, "a word that others define")
// windows.h
#define near CLOTHCTL_TAKEN
#define far CLOTHCTL_TAKEN
#define small CLOTHCTL_TAKEN
#define hyper CLOTHCTL_TAKEN
#define interface CLOTHCTL_TAKEN
#define cdecl CLOTHCTL_TAKEN
#define pascal CLOTHCTL_TAKEN
#define IN CLOTHCTL_TAKEN
#define OUT CLOTHCTL_TAKEN
#define OPTIONAL CLOTHCTL_TAKEN
#define ERROR CLOTHCTL_TAKEN
#define DELETE CLOTHCTL_TAKEN
#define CONST CLOTHCTL_TAKEN
#define VOID CLOTHCTL_TAKEN
#define TRUE CLOTHCTL_TAKEN
#define FALSE CLOTHCTL_TAKEN
#define ABSOLUTE CLOTHCTL_TAKEN
#define RELATIVE CLOTHCTL_TAKEN
#define DIFFERENCE CLOTHCTL_TAKEN
#define STRICT CLOTHCTL_TAKEN
#define IGNORE CLOTHCTL_TAKEN
#define INFINITE CLOTHCTL_TAKEN
// AssertMacros.h, Unreal Engine
#define check CLOTHCTL_TAKEN
#define verify CLOTHCTL_TAKEN
#define require CLOTHCTL_TAKEN
#define ensure CLOTHCTL_TAKEN
#define PI CLOTHCTL_TAKEN
// X11
#define None CLOTHCTL_TAKEN
#define Bool CLOTHCTL_TAKEN
#define Status CLOTHCTL_TAKEN
#define Always CLOTHCTL_TAKEN
#define True CLOTHCTL_TAKEN
#define False CLOTHCTL_TAKEN
#define Unsorted CLOTHCTL_TAKEN
#define Convex CLOTHCTL_TAKEN
#define Complex CLOTHCTL_TAKEN
#define Above CLOTHCTL_TAKEN
#define Below CLOTHCTL_TAKEN
// Qt
#define slots CLOTHCTL_TAKEN
#define signals CLOTHCTL_TAKEN
#define emit CLOTHCTL_TAKEN
#define foreach CLOTHCTL_TAKEN
#define forever CLOTHCTL_TAKEN
// complex.h, math.h, sys/param.h, Arduino
#define I CLOTHCTL_TAKEN
#define DOMAIN CLOTHCTL_TAKEN
#define OVERFLOW CLOTHCTL_TAKEN
#define UNDERFLOW CLOTHCTL_TAKEN
#define MIN CLOTHCTL_TAKEN
#define MAX CLOTHCTL_TAKEN
#define HIGH CLOTHCTL_TAKEN
#define LOW CLOTHCTL_TAKEN
#define unix CLOTHCTL_TAKEN
#define linux CLOTHCTL_TAKEN

#include <clothctl/clothctl.hpp>
#include <clothctl/io.hpp>
