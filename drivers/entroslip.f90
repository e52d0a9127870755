!> Maximum-entropy models of uncertain friction, and the vibration of structures with friction
!> joints.
program entroslip
   use, intrinsic :: iso_fortran_env, only: compiler_version
   use config_template, only: scene_reference, template_text
   use core_error, only: error_type, exit_done
   use core_memory, only: require_memory
   use core_openblas, only: restart_for_openblas
   use core_terminal, only: end_program, say, start_terminal, write_error
   use core_text, only: nl => line_feed
   use driver_build_info, only: architecture, build_type, compiler_flags, git_commit, version
   use driver_check, only: check
   use driver_command_line, only: command_line, help_text, read_command_line
   use driver_estimate, only: estimate
   use driver_replay, only: replay
   use driver_run, only: run
   use driver_tradeoff, only: tradeoff
   use driver_whatif, only: whatif
   use io_hdf5, only: hdf5_library
   use numerics_fftw, only: fftw_library
   use numerics_lapack, only: lapack_version
   use parallel_world, only: mpi_library, start_world, was_launched, world_type
   implicit none(type, external)
   type(command_line) :: line
   type(world_type) :: world
   type(error_type), allocatable :: error

   call start_terminal()
   call restart_for_openblas()
   call read_command_line(line, error)
   if (allocated(error)) then
      if (was_launched()) then   ! all ranks have the same error; one prints it
         call start_world(world)
         call world%stop_on(error)
      end if
   else if (all(line%command /= [character(8) :: 'template', 'version', 'help'])) then
      call require_memory(error)
   end if
   if (allocated(error)) then
      call write_error(error%message)
      call end_program(error%exit_code)
   end if
   select case (line%command)
   case ('run')
      call run(line)
   case ('check')
      call check(line)
   case ('tradeoff')
      call tradeoff(line)
   case ('replay')
      call replay(line)
   case ('estimate')
      call estimate(line)
   case ('whatif')
      call whatif(line)
   case ('template')
      if (line%has('--reference')) then
         call say(scene_reference())
      else
         call say(template_text())
      end if
   case ('version')
      call say('entroslip '//version//' ('//git_commit//', '//build_type//')'//nl// &
               'compiler      '//compiler_version()//nl// &
               'flags         '//compiler_flags//nl// &
               'instructions  '//architecture//nl// &
               'MPI           '//mpi_library()//nl// &
               'HDF5          '//hdf5_library()//nl// &
               'FFTW          '//fftw_library()//nl// &
               'LAPACK        '//lapack_version())
   case ('help')
      call say(help_text())
   end select
   call end_program(exit_done)

end program entroslip
