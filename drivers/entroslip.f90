!> Maximum-entropy models of uncertain friction, and the vibration of structures with friction
!> joints.
program entroslip
   use config_template, only: scene_reference, template_text
   use core_error, only: error_type, exit_done
   use core_memory, only: require_memory
   use core_openblas, only: restart_for_openblas
   use core_terminal, only: end_program, say, start_terminal, write_error
   use driver_check, only: check
   use driver_command_line, only: command_line, help_text, read_command_line
   use driver_estimate, only: estimate
   use driver_provenance, only: version_text
   use driver_replay, only: replay
   use driver_run, only: run
   use driver_tradeoff, only: tradeoff
   use driver_whatif, only: whatif
   use parallel_world, only: start_world, was_launched, world_type
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
      call say(version_text())
   case ('help')
      call say(help_text())
   end select
   call end_program(exit_done)

end program entroslip
