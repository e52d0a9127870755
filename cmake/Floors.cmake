# A floor sees only the modules of the floors it names, and the libraries it holds the door to. A LEVEL is that of a
# release build, instead of -O3.
function(add_floor name)
  cmake_parse_arguments(PARSE_ARGV 1 floor "" "LEVEL" "SOURCES;USES;DOORS")
  set(modules ${PROJECT_BINARY_DIR}/modules/${name})
  add_library(${name} STATIC ${floor_SOURCES})
  file(MAKE_DIRECTORY ${modules})   # else gfortran warns of it before the first module is written
  set_target_properties(${name} PROPERTIES
    OUTPUT_NAME entroslip_${name}
    Fortran_PREPROCESS OFF   # no source needs it, and each file is compiled once instead of twice
    Fortran_MODULE_DIRECTORY ${modules})
  target_include_directories(${name} INTERFACE $<BUILD_INTERFACE:${modules}>)
  if(floor_LEVEL)
    set_property(SOURCE ${floor_SOURCES} APPEND PROPERTY COMPILE_OPTIONS "$<$<CONFIG:Release>:${floor_LEVEL}>")
  endif()
  # PRIVATE: the modules are seen here and not passed on; what the floor above wants, it names itself
  target_link_libraries(${name} PRIVATE ${floor_USES} ${floor_DOORS}
    $<BUILD_INTERFACE:entroslip_flags>)
  install(TARGETS ${name} EXPORT entroslip
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/entroslip/${name})
  install(DIRECTORY ${modules}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/entroslip/${name})
endfunction()
