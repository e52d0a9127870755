!> Provenance of results: the scene, the program and the machine.
module driver_provenance
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use campaign_plan, only: plan_type
   use config_fingerprint, only: canonical_text, fingerprint
   use config_scene, only: scene_type
   use core_error, only: error_type
   use core_text, only: nl => line_feed
   use driver_build_info, only: architecture, build_type, compiler_flags, git_commit, version
   use io_hdf5, only: hdf5_file, hdf5_library, hdf5_object
   use io_identity, only: identity_type
   use io_store, only: create_unfinished, discard_file, shard_store
   use numerics_fftw, only: fftw_library
   use numerics_lapack, only: lapack_version
   use parallel_world, only: mpi_library
   implicit none(type, external)
   private
   public :: begin_results, identity_of, version_text

contains

   !> Identity that shards and results of one campaign share.
   function identity_of(scene, command) result(identity)
      type(scene_type), intent(in) :: scene
      character(*), intent(in) :: command   !! the command that writes the file
      type(identity_type) :: identity

      identity%settings = canonical_text(scene)
      identity%fingerprint = fingerprint(scene)
      identity%version = version//' ('//git_commit//')'
      identity%architecture = architecture//', '//compiler_version()
      identity%command = command
   end function identity_of

   !> Creates the results file of a store and writes its provenance as attributes. Nothing else in a
   !> results file differs between two equal runs.
   subroutine begin_results(store, plan, scene, overrides, n_ranks, file, error)
      type(shard_store), intent(in) :: store
      type(plan_type), intent(in) :: plan
      character(*), intent(in) :: scene       !! text of the scene
      character(*), intent(in) :: overrides   !! --set options, one a line
      integer, intent(in) :: n_ranks
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

      call create_unfinished(store%output, store%identity, file, error)
      if (allocated(error)) return
      root = hdf5_object(file, '/')
      call root%attribute('seed', plan%seed)
      call root%attribute('n_ranks', n_ranks)
      call root%attribute('title', plan%title)
      call root%attribute('scene', scene)
      call root%attribute('overrides', overrides(:len(overrides) - 1))
      call root%attribute('git_commit', git_commit)
      call root%attribute('compiler', compiler_version())
      call root%attribute('flags', compiler_flags)
      call root%attribute('created', now())
      call root%take_error(error)
      if (allocated(error)) call discard_file(file)
   end subroutine begin_results

   !> Date and time with the offset from UTC (ISO 8601).
   function now() result(text)
      character(:), allocatable :: text
      character(5) :: zone
      character(8) :: date
      character(10) :: time

      call date_and_time(date, time, zone)
      text = date(1:4)//'-'//date(5:6)//'-'//date(7:8)//'T'//time(1:2)//':'//time(3:4)//':'// &
             time(5:6)//zone(1:3)//':'//zone(4:5)
   end function now

   !> Text on the program, its compiler and the libraries that it runs with.
   function version_text() result(text)
      character(:), allocatable :: text

      text = 'entroslip '//version//' ('//git_commit//', '//build_type//')'//nl// &
             'compiler      '//compiler_version()//nl// &
             'flags         '//compiler_flags//nl// &
             'instructions  '//architecture//nl// &
             'MPI           '//mpi_library()//nl// &
             'HDF5          '//hdf5_library()//nl// &
             'FFTW          '//fftw_library()//nl// &
             'LAPACK        '//lapack_version()
   end function version_text

end module driver_provenance
