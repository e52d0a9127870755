!> Text of `entroslip --version`.
module driver_version
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use driver_build_info, only: architecture, build_type, compiler_flags, git_commit, version
   use io_hdf5, only: hdf5_library
   use numerics_fftw, only: fftw_library
   use numerics_lapack, only: lapack_version
   use numerics_nlopt, only: nlopt_library
   use parallel_world, only: mpi_library
   implicit none(type, external)
   private
   public :: version_text

contains

   !> Text on the program, how it was compiled, and the libraries that it runs with, in their words.
   function version_text() result(text)
      character(:), allocatable :: text
      character, parameter :: nl = new_line('a')

      text = 'entroslip '//version//' ('//git_commit//', '//build_type//')'//nl// &
             'compiler      '//compiler_version()//nl// &
             'flags         '//compiler_flags//nl// &
             'instructions  '//architecture//nl// &
             'MPI           '//mpi_library()//nl// &
             'HDF5          '//hdf5_library()//nl// &
             'FFTW          '//fftw_library()//nl// &
             'LAPACK        '//lapack_version()//nl// &
             'NLopt         '//nlopt_library()
   end function version_text

end module driver_version
