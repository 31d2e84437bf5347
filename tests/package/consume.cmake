# Configures, builds and runs one consumer project (KIND) in WORK_DIR. Stops with an error at the
# first step that fails.

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code)
  if(NOT code EQUAL 0)
    list(JOIN ARGN " " command)
    message(FATAL_ERROR "package ${KIND}: failed (${code}): ${command}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK_DIR})
file(MAKE_DIRECTORY ${WORK_DIR})

if(KIND STREQUAL "pkg_config")
  # Installed, then moved: flags come from clothctl.pc alone, without CMake.
  run(${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix ${WORK_DIR}/first)
  file(RENAME ${WORK_DIR}/first ${WORK_DIR}/prefix)
  set(ENV{PKG_CONFIG_PATH} ${WORK_DIR}/prefix/share/pkgconfig:$ENV{PKG_CONFIG_PATH})
  execute_process(COMMAND ${PKG_CONFIG} --cflags clothctl OUTPUT_VARIABLE flags RESULT_VARIABLE code
                  OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "package pkg_config: pkg-config does not know clothctl")
  endif()
  execute_process(COMMAND ${PKG_CONFIG} --modversion clothctl OUTPUT_VARIABLE version
                  OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(NOT version STREQUAL VERSION)
    message(FATAL_ERROR "package pkg_config: version '${version}', expected '${VERSION}'")
  endif()
  separate_arguments(flags)
  run(${COMPILER} -std=c++20 ${flags} ${SOURCE_DIR}/tests/package/main.cpp -o ${WORK_DIR}/consumer)
  run(${WORK_DIR}/consumer)
  return()
endif()

# Errors from merged functions appear in optimised code only; at -O1 fewer functions are inlined, so
# the linker merges more of them.
set(build_type Debug)
if(KIND STREQUAL "two_units")
  set(build_type Release)
endif()
set(arguments -S ${SOURCE_DIR}/tests/package/${KIND} -B ${WORK_DIR}/build -G ${GENERATOR}
    -DCMAKE_BUILD_TYPE=${build_type} -DCMAKE_CXX_FLAGS_RELEASE=-O1
    -DCMAKE_CXX_COMPILER=${COMPILER} -DEigen3_DIR=${EIGEN_DIR})
if(KIND STREQUAL "find_package")
  # Installed into its own prefix; the source tree is not on any search path.
  run(${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix ${WORK_DIR}/prefix)
  list(APPEND arguments -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix)
elseif(KIND STREQUAL "precompiled")
  # Configured with the compiled library, built, and installed. Compiling it takes minutes: where the
  # build has a library of the same sources (LIBRARY), that one is installed, without what the tests
  # add to it.
  run(${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/library -G ${GENERATOR}
      -DCMAKE_BUILD_TYPE=${build_type} -DCMAKE_CXX_FLAGS_DEBUG=-O0
      -DCMAKE_CXX_COMPILER=${COMPILER} -DEigen3_DIR=${EIGEN_DIR} -DCLOTHCTL_PRECOMPILED=ON
      -DCLOTHCTL_BUILD_TESTS=OFF -DCLOTHCTL_BUILD_EXAMPLES=OFF -DCLOTHCTL_BUILD_BENCH=OFF)
  if(LIBRARY)
    # That it would be built with all else is read from the build's rules, where they are known.
    if(GENERATOR STREQUAL "Ninja")
      file(STRINGS ${WORK_DIR}/library/build.ninja rules
           REGEX "^build all: phony.* libclothctl_precompiledd\\.a( |$)")
      if(NOT rules)
        message(FATAL_ERROR "package precompiled: the library is not part of the build")
      endif()
    endif()
    set(library ${WORK_DIR}/library/libclothctl_precompiledd.a)
    file(COPY_FILE ${LIBRARY} ${library})
    run(${AR} d ${library} instances.cpp.o)
  else()
    run(${CMAKE_COMMAND} --build ${WORK_DIR}/library)
  endif()
  run(${CMAKE_COMMAND} --install ${WORK_DIR}/library --prefix ${WORK_DIR}/prefix)
  list(APPEND arguments -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix)
elseif(KIND STREQUAL "fetch_content")
  # The consumer names a remote repository. Here this source tree replaces it, so no network is
  # needed.
  list(APPEND arguments -DFETCHCONTENT_SOURCE_DIR_CLOTHCTL=${SOURCE_DIR}
       -DFETCHCONTENT_FULLY_DISCONNECTED=ON)
else()
  list(APPEND arguments -DCLOTHCTL_TREE=${SOURCE_DIR})
endif()
run(${CMAKE_COMMAND} ${arguments})
if(KIND STREQUAL "alignment")
  return()  # configuring it is the test
endif()
run(${CMAKE_COMMAND} --build ${WORK_DIR}/build)
run(${WORK_DIR}/build/consumer)
