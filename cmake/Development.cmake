# What tests, examples and benchmarks share: warnings, code for this machine's processor, and the libraries that bridges need.
# Users of the library never come here.

# The warnings that the headers must be free of.
set(clothctl_warning_flags "")
if(CMAKE_CXX_COMPILER_ID MATCHES "GNU|Clang")
  set(clothctl_warning_flags -Wall -Wextra -Wconversion -Wshadow)
elseif(MSVC)
  set(clothctl_warning_flags /W4)
endif()

# Turns the warnings on for a target, and into errors where CLOTHCTL_WARNINGS_AS_ERRORS asks for it.
function(clothctl_warn target)
  target_compile_options(${target} PRIVATE ${clothctl_warning_flags})
  if(CLOTHCTL_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE $<IF:$<CXX_COMPILER_ID:MSVC>,/WX,-Werror>)
  endif()
endfunction()

# Compiles a target for the processor of this machine, where the compiler can.
include(CheckCXXCompilerFlag)
function(clothctl_native target)
  check_cxx_compiler_flag(-march=native CLOTHCTL_HAS_MARCH_NATIVE)
  if(CLOTHCTL_HAS_MARCH_NATIVE)
    target_compile_options(${target} PRIVATE -march=native)
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
      # g++ 12 warns of its own AVX-512 headers, whose "undefined" values are meant to be.
      target_compile_options(${target} PRIVATE -Wno-uninitialized -Wno-maybe-uninitialized)
    endif()
  endif()
endfunction()

# clothctl_tinyxml2 is what bridge/urdf.hpp needs; there is no such target where the library is missing.
find_path(CLOTHCTL_TINYXML2_INCLUDE_DIR tinyxml2.h)
find_library(CLOTHCTL_TINYXML2_LIBRARY tinyxml2)
mark_as_advanced(CLOTHCTL_TINYXML2_INCLUDE_DIR CLOTHCTL_TINYXML2_LIBRARY)
if(CLOTHCTL_TINYXML2_INCLUDE_DIR AND CLOTHCTL_TINYXML2_LIBRARY)
  add_library(clothctl_tinyxml2 INTERFACE)
  target_include_directories(clothctl_tinyxml2 SYSTEM INTERFACE ${CLOTHCTL_TINYXML2_INCLUDE_DIR})
  target_link_libraries(clothctl_tinyxml2 INTERFACE ${CLOTHCTL_TINYXML2_LIBRARY})
else()
  message(STATUS "What reads URDF is not built; missing: tinyxml2 (libtinyxml2-dev)")
endif()

# nlohmann_json::nlohmann_json is what bridge/hand_json.hpp needs.
find_package(nlohmann_json QUIET)
if(NOT TARGET nlohmann_json::nlohmann_json)
  message(STATUS "What reads JSON is not built; missing: nlohmann_json (nlohmann-json3-dev)")
endif()

# What examples and benchmarks link: the heavy templates compiled once, for the same processor.
if(CLOTHCTL_BUILD_EXAMPLES OR CLOTHCTL_BUILD_BENCH)
  clothctl_add_precompiled(clothctl_native_precompiled)
  if(CLOTHCTL_NATIVE)
    clothctl_native(clothctl_native_precompiled)
  endif()
endif()
