# Sets ENTROSLIP_GIT_COMMIT and ENTROSLIP_ARCH_TEXT: what results files and shards name as their origin.
find_package(Git QUIET)
set(ENTROSLIP_GIT_COMMIT "unknown")
if(Git_FOUND AND EXISTS ${PROJECT_SOURCE_DIR}/.git)
  set(git ${GIT_EXECUTABLE} -c safe.directory=*)   # also where another user owns the source
  execute_process(COMMAND ${git} describe --always --dirty --abbrev=12 --exclude=*
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE commit RESULT_VARIABLE status
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  execute_process(COMMAND ${git} rev-parse --path-format=absolute --git-path logs/HEAD
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE log
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  if(status EQUAL 0)
    set(ENTROSLIP_GIT_COMMIT ${commit})
  endif()
  if(EXISTS "${log}")   # a new commit configures anew
    set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${log})
  endif()
endif()

# 'native' says nothing to another machine: ask the compiler what it stands for here.
set(ENTROSLIP_ARCH_TEXT ${ENTROSLIP_ARCH})
if(CMAKE_BUILD_TYPE STREQUAL "Debug")
  set(ENTROSLIP_ARCH_TEXT "x86-64")
elseif(ENTROSLIP_ARCH STREQUAL "native")
  # with something to compile, else the compiler wrapper of Spack says nothing
  execute_process(COMMAND ${CMAKE_Fortran_COMPILER} -march=native -Q --help=target
    -c -x f95 /dev/null -o /dev/null OUTPUT_VARIABLE target ERROR_QUIET
    WORKING_DIRECTORY ${PROJECT_BINARY_DIR})   # where it leaves help-dummy.o
  if(target MATCHES "-march=[ \t]+([a-z0-9_-]+)")
    set(ENTROSLIP_ARCH_TEXT ${CMAKE_MATCH_1})
  else()
    message(WARNING "What -march=native stands for is not known: results will not name it")
  endif()
  if(target MATCHES "-mavx512f[ \t]+\\[enabled\\]")
    string(APPEND ENTROSLIP_ARCH_TEXT "+avx512f")
  endif()
endif()
