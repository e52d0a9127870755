# find_package(entroslip) for who links the library: targets entroslip::core .. entroslip::parallel.
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/entroslip)
install(EXPORT entroslip NAMESPACE entroslip:: DESTINATION ${package_dir})
configure_package_config_file(cmake/entroslipConfig.cmake.in
  ${PROJECT_BINARY_DIR}/entroslipConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/entroslipConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_BINARY_DIR}/entroslipConfig.cmake
  ${PROJECT_BINARY_DIR}/entroslipConfigVersion.cmake
  ${PROJECT_SOURCE_DIR}/cmake/Dependencies.cmake
  DESTINATION ${package_dir})
install(FILES LICENSE README.md CHANGELOG.md CITATION.cff DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY input DESTINATION ${CMAKE_INSTALL_DATADIR}/entroslip)
