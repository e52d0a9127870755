!> Ends a command early: after a stop signal, or at the time limit of its scene.
module driver_deadline
   use core_error, only: error_type, exit_stopped
   use core_kinds, only: long, wp
   use io_lock, only: lock_type
   use io_progress, only: inform
   use parallel_signals, only: catch_stop_signals, stop_requested
   use parallel_world, only: attend_to_others, stop_world, world_type
   implicit none(type, external)
   private
   public :: end_if_requested, start_watch, set_limit, seconds_so_far, time_to_stop

   integer(long) :: started = 0   !! count of the system clock
   real(wp) :: limit = 0.0_wp     !! [s]; 0: no limit

contains

   !> Starts the clock of the run and catches stop signals.
   subroutine start_watch()
      call system_clock(started)
      call catch_stop_signals()
   end subroutine start_watch

   !> Sets the time limit of the run.
   subroutine set_limit(walltime)
      real(wp), intent(in) :: walltime   !! [min]; 0: no limit

      limit = 60.0_wp*walltime
   end subroutine set_limit

   !> Time since start_watch [s].
   real(wp) function seconds_so_far() result(seconds)
      integer(long) :: now, rate

      call system_clock(now, rate)
      seconds = real(now - started, wp)/real(rate, wp)
   end function seconds_so_far

   !> True if this rank got a stop signal or the time limit has passed. Also serves the requests of
   !> other ranks: call it between pieces of work.
   logical function time_to_stop()
      call attend_to_others()
      time_to_stop = stop_requested()
      if (time_to_stop .or. .not. limit > 0.0_wp) return
      time_to_stop = seconds_so_far() > limit
   end function time_to_stop

   !> Ends the command if any rank was requested to stop, and says what is kept. Collective.
   subroutine end_if_requested(world, keeps_work, lock)
      type(world_type), intent(in) :: world
      logical, intent(in) :: keeps_work   !! true if the command continues from finished work
      type(lock_type), intent(inout), optional :: lock
      type(error_type), allocatable :: ignored   ! a remaining lock file is not a lock
      character(:), allocatable :: outcome

      if (.not. world%any_true(time_to_stop())) return
      outcome = 'nothing is kept: start again'
      if (keeps_work) outcome = 'what is finished is safe: start again to continue'
      call inform('stopped early; '//outcome)
      if (present(lock)) call lock%release(ignored)
      call stop_world(exit_stopped)
   end subroutine end_if_requested

end module driver_deadline
