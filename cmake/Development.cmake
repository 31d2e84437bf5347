# What tests, examples and benchmarks share: warnings, and code for this machine's processor. Users of the library never
# come here.

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
