# Each outside library as one imported target, linked by the one floor that has its door.
# The installed CMake package includes this file too.
find_package(MPI REQUIRED COMPONENTS Fortran)
if(NOT MPI_Fortran_HAVE_F08_MODULE)
  message(FATAL_ERROR "entroslip needs an MPI with the module mpi_f08 (Debian: libopenmpi-dev)")
endif()

find_package(LAPACK REQUIRED)

set(HDF5_PREFER_PARALLEL OFF)
find_package(HDF5 REQUIRED COMPONENTS Fortran Fortran_HL)
# CMake searches for two names of one library where the wrapper h5fc fails, as in a path with blanks
list(FILTER HDF5_Fortran_HL_LIBRARIES EXCLUDE REGEX "-NOTFOUND$")
if(NOT TARGET entroslip::hdf5)   # HDF5::HDF5 lacks the high-level library
  add_library(entroslip::hdf5 INTERFACE IMPORTED)
  target_include_directories(entroslip::hdf5 SYSTEM INTERFACE ${HDF5_Fortran_INCLUDE_DIRS})
  target_link_libraries(entroslip::hdf5 INTERFACE
    ${HDF5_Fortran_HL_LIBRARIES} ${HDF5_Fortran_LIBRARIES})
endif()

find_path(FFTW3_INCLUDE_DIR fftw3.f03 REQUIRED)
find_library(FFTW3_LIBRARY fftw3 REQUIRED)
if(NOT TARGET entroslip::fftw)
  add_library(entroslip::fftw INTERFACE IMPORTED)
  target_link_libraries(entroslip::fftw INTERFACE ${FFTW3_LIBRARY})
  # not target_include_directories: gfortran needs the path even where it is /usr/include
  target_compile_options(entroslip::fftw INTERFACE -I${FFTW3_INCLUDE_DIR})
endif()
