!> What `entroslip --version` says.
module driver_version
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use driver_build_info, only: architecture, build_type, compiler_flags, git_commit, version
   use io_hdf5, only: hdf5_version
   use numerics_fftw, only: fftw_version
   use numerics_lapack, only: lapack_version
   use numerics_nlopt, only: nlopt_version
   use parallel_world, only: mpi_version
   implicit none(type, external)
   private
   public :: version_text

contains

   function version_text() result(text)
      character(:), allocatable :: text
      character, parameter :: nl = new_line('a')

      text = 'entroslip '//version//' ('//git_commit//', '//build_type//')'//nl// &
             'compiler      '//compiler_version()//nl// &
             'flags         '//compiler_flags//nl// &
             'instructions  '//architecture//nl// &
             'MPI           '//mpi_version()//nl// &
             'HDF5          '//hdf5_version()//nl// &
             'FFTW          '//fftw_version()//nl// &
             'LAPACK        '//lapack_version()//nl// &
             'NLopt         '//nlopt_version()
   end function version_text

end module driver_version
