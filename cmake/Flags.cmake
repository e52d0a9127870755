# Compiler flags as a target. Never -ffast-math: stick-slip transitions are signs.
include(CheckFortranCompilerFlag)
string(MAKE_C_IDENTIFIER "CAN_MARCH_${ENTROSLIP_ARCH}" can_march)   # a result for each value
check_fortran_compiler_flag(-march=${ENTROSLIP_ARCH} ${can_march})
if(NOT ${can_march})
  message(FATAL_ERROR "ENTROSLIP_ARCH = ${ENTROSLIP_ARCH}: must be a value of -march= of the compiler")
endif()
add_library(entroslip_flags INTERFACE)
set(strict -fimplicit-none -std=f2018 -fopenmp-simd)   # directives only, no threads
# gfortran includes a header of its own that gives exp, log, tanh and others vector forms. Their last bits differ from
# the scalar ones, and which of the two serve an element depends on where arrays lie in memory: results would too. With
# -nostdinc it is not found; nor are the intrinsic modules, unless told.
execute_process(COMMAND ${CMAKE_Fortran_COMPILER} -print-file-name=finclude
  OUTPUT_VARIABLE intrinsic_modules OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
list(APPEND strict -nostdinc -fintrinsic-modules-path ${intrinsic_modules})
set(warnings -Wall -Wextra -Wimplicit-interface -Wno-compare-reals -Wno-uninitialized -Wno-maybe-uninitialized)
# Every check of errors; a copy made for an argument is none, and its notices drowned what a program says.
set(debug -Og -g -fcheck=all,no-array-temps -fbacktrace -ffpe-trap=invalid,zero,overflow
  -finit-real=snan -finit-derived -Werror)
# -fno-trapping-math changes no value; it lets both arms of a merge be computed
set(release -O3 -g1 -march=${ENTROSLIP_ARCH} -fno-trapping-math)
if(ENTROSLIP_ARCH STREQUAL "native")
  list(APPEND release -mprefer-vector-width=512)
endif()
# gfortran 14 spoils a .or. b of arrays of logicals by masked loads (AVX-512). Rooms without such arrays have them back
# where it counts: a third of a march.
if(CMAKE_Fortran_COMPILER_VERSION VERSION_GREATER_EQUAL 14)
  list(APPEND release -fno-tree-loop-if-convert)
endif()
set(masked_loads -ftree-loop-if-convert)
# Loops over lanes: at -O3 they are unrolled before they could be vector operations, and sums are spilled. Peeled
# afterwards, loops over a few vectors leave sums in registers. Copies made by halves of a vector are read back slowly.
# Tuned for Zen, gcc reads what eight multiplications share from memory eight times: a product takes twice as long.
check_fortran_compiler_flag(-mtune=icelake-server CAN_TUNE)
set(lane_loops -O2 -ftree-vectorize ${masked_loads} -fpeel-loops -fno-tree-loop-distribute-patterns
  "$<$<BOOL:${CAN_TUNE}>:-mtune=icelake-server>")
set(lane_loops "$<$<CONFIG:Release>:${lane_loops}>")
# Floors without a loop that takes time compile in half of it.
set(few_loops -O1)
if(ENTROSLIP_SANITIZE)
  list(APPEND debug -fsanitize=address,undefined -fno-omit-frame-pointer)
  target_link_options(entroslip_flags INTERFACE -fsanitize=address,undefined)
  # For rooms that hand on arrays which may be absent, unallocated or empty: gfortran computes with their bounds, to no effect.
  set(no_bounds -fno-sanitize=signed-integer-overflow)
endif()
target_compile_options(entroslip_flags INTERFACE
  "$<$<COMPILE_LANGUAGE:Fortran>:${strict};${warnings}>"
  "$<$<AND:$<COMPILE_LANGUAGE:Fortran>,$<CONFIG:Debug>>:${debug}>"
  "$<$<AND:$<COMPILE_LANGUAGE:Fortran>,$<CONFIG:Release>>:${release}>")
set(CMAKE_Fortran_FLAGS_RELEASE "")
set(CMAKE_Fortran_FLAGS_DEBUG "")
if(CMAKE_BUILD_TYPE STREQUAL "Debug")
  set(ENTROSLIP_FLAGS_TEXT ${debug})
else()
  set(ENTROSLIP_FLAGS_TEXT ${release})
endif()
list(JOIN ENTROSLIP_FLAGS_TEXT " '// &\n      '" ENTROSLIP_FLAGS_TEXT)   # one to a line of build_info.f90
