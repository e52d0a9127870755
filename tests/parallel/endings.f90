!> Ends as its first argument says, for check_endings.py.
program endings
   use, intrinsic :: iso_fortran_env, only: output_unit
   use core_error, only: error_type, exit_done, exit_file, exit_no_solution, exit_stopped, raise
   use core_text, only: to_text
   use parallel_signals, only: catch_stop_signals, stop_requested
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: attend_to_others, start_world, stop_world, world_type
   implicit none(type, external)
   type(world_type) :: world
   type(error_type), allocatable :: error
   character(20) :: ending
   logical :: is_stopped

   call get_command_argument(1, ending)
   call start_world(world)
   is_stopped = .false.
   select case (ending)
   case ('done')
   case ('last_rank_fails')
      if (world%rank == world%n_ranks - 1) then
         call raise(error, exit_no_solution, 'rank '//to_text(world%rank)//' found no solution')
      end if
   case ('all_ranks_fail')
      call raise(error, merge(exit_file, exit_no_solution, world%is_root()), &
                 'rank '//to_text(world%rank)//' failed')
   case ('signal')
      call work_until_signal(heeds_signals=.true.)
      is_stopped = .true.
   case ('second_signal')
      call work_until_signal(heeds_signals=.false.)
   end select
   call world%stop_on(error)
   call stop_world(merge(exit_stopped, exit_done, is_stopped))

contains

   !> Claims work without end, until a rank receives a signal and stops all.
   subroutine work_until_signal(heeds_signals)
      logical, intent(in) :: heeds_signals
      type(work_counter) :: counter

      call catch_stop_signals()
      call new_counter(world, huge(1), counter)
      if (world%is_root()) print '(a)', 'ready'
      if (world%is_root()) flush (output_unit)
      do while (counter%next(stops=heeds_signals .and. stop_requested()) > 0)
         call attend_to_others()
      end do
      call counter%close()
   end subroutine work_until_signal

end program endings
