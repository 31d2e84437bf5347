# Installs the headers, a package that `find_package(clothctl)` finds, and clothctl.pc for pkg-config.

include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(clothctl_package_dir ${CMAKE_INSTALL_DATADIR}/cmake/clothctl)

install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/clothctl DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
        FILES_MATCHING PATTERN "*.hpp")
install(TARGETS clothctl EXPORT clothctlTargets INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(CLOTHCTL_PRECOMPILED)
  install(TARGETS clothctl_precompiled EXPORT clothctlTargets
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endif()
install(EXPORT clothctlTargets NAMESPACE clothctl:: DESTINATION ${clothctl_package_dir})

configure_package_config_file(
  ${CMAKE_CURRENT_LIST_DIR}/clothctlConfig.cmake.in ${PROJECT_BINARY_DIR}/clothctlConfig.cmake
  INSTALL_DESTINATION ${clothctl_package_dir})
# Before 1.0 a minor version may change the interface.
set(clothctl_any_architecture ARCH_INDEPENDENT)
if(CLOTHCTL_PRECOMPILED)
  set(clothctl_any_architecture "")
endif()
write_basic_package_version_file(
  ${PROJECT_BINARY_DIR}/clothctlConfigVersion.cmake COMPATIBILITY SameMinorVersion
  ${clothctl_any_architecture})
install(FILES ${PROJECT_BINARY_DIR}/clothctlConfig.cmake
              ${PROJECT_BINARY_DIR}/clothctlConfigVersion.cmake
        DESTINATION ${clothctl_package_dir})

# The prefix is told relative to where the file lies, so that an installed tree may be moved.
set(clothctl_pc_dir ${CMAKE_INSTALL_DATADIR}/pkgconfig)
file(RELATIVE_PATH clothctl_pc_up /${clothctl_pc_dir} /)
string(REGEX REPLACE "/$" "" clothctl_pc_up "${clothctl_pc_up}")
set(clothctl_pc_includedir "\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}")
if(IS_ABSOLUTE "${CMAKE_INSTALL_INCLUDEDIR}")
  set(clothctl_pc_includedir "${CMAKE_INSTALL_INCLUDEDIR}")
endif()
configure_file(${CMAKE_CURRENT_LIST_DIR}/clothctl.pc.in ${PROJECT_BINARY_DIR}/clothctl.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/clothctl.pc DESTINATION ${clothctl_pc_dir})

install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/clothctl)
