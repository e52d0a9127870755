# Files that `cmake --install` puts beside the program and the floors.

# find_package(entroslip): targets entroslip::core .. entroslip::parallel
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

# pkg-config entroslip, wherever the prefix is moved to
set(pkgconfig_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH pkgconfig_to_prefix /prefix/${pkgconfig_dir} /prefix)
string(REGEX REPLACE "/$" "" pkgconfig_to_prefix ${pkgconfig_to_prefix})
set(pkgconfig_modules)
set(pkgconfig_libraries)
list(TRANSFORM CMAKE_DL_LIBS PREPEND -l OUTPUT_VARIABLE pkgconfig_dl)
foreach(floor io io_hdf5 config config_groups config_text parallel tradeoff campaign dynamics_exact dynamics_newmark dynamics process process_positive
    process_direct process_autoregressive process_ground structure statistics numerics core)
  list(APPEND pkgconfig_modules "-I\${includedir}/${floor}")
  list(APPEND pkgconfig_libraries -lentroslip_${floor})
endforeach()
list(APPEND pkgconfig_libraries
  ${HDF5_Fortran_HL_LIBRARIES} ${HDF5_Fortran_LIBRARIES} ${MPI_Fortran_LIBRARIES}
  ${FFTW3_LIBRARY} ${LAPACK_LIBRARIES} ${BLAS_LIBRARIES} ${pkgconfig_dl})
list(REMOVE_DUPLICATES pkgconfig_libraries)
list(JOIN pkgconfig_modules " " pkgconfig_modules)
list(JOIN pkgconfig_libraries " " pkgconfig_libraries)
configure_file(cmake/entroslip.pc.in entroslip.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/entroslip.pc DESTINATION ${pkgconfig_dir})

# man page, shell completion, guide, scenes, examples
install(FILES packaging/entroslip.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES packaging/completions/entroslip.bash
  DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME entroslip)
install(FILES packaging/completions/_entroslip
  DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
install(FILES packaging/completions/entroslip.fish
  DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
install(FILES LICENSE README.md CHANGELOG.md CITATION.cff DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR}
  FILES_MATCHING PATTERN *.md PATTERN *.png PATTERN *.svg)
install(DIRECTORY input examples DESTINATION ${CMAKE_INSTALL_DATADIR}/entroslip
  USE_SOURCE_PERMISSIONS)   # job scripts are executable
