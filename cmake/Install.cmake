# Installs the headers and a package that `find_package(clothctl)` finds.

include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(clothctl_package_dir ${CMAKE_INSTALL_DATADIR}/cmake/clothctl)

install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/clothctl DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.hpp")
install(TARGETS clothctl EXPORT clothctlTargets INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT clothctlTargets NAMESPACE clothctl:: DESTINATION ${clothctl_package_dir})

configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/clothctlConfig.cmake.in ${PROJECT_BINARY_DIR}/clothctlConfig.cmake
                              INSTALL_DESTINATION ${clothctl_package_dir})
# Before 1.0 a minor version may change the interface.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/clothctlConfigVersion.cmake COMPATIBILITY SameMinorVersion
                                 ARCH_INDEPENDENT)
install(FILES ${PROJECT_BINARY_DIR}/clothctlConfig.cmake ${PROJECT_BINARY_DIR}/clothctlConfigVersion.cmake
        DESTINATION ${clothctl_package_dir})
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/clothctl)
