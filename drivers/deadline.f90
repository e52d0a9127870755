!> When a run has to end early: a signal, or the wall-time limit of its scene.
module driver_deadline
   use core_kinds, only: long, wp
   use parallel_signals, only: catch_stop_signals, stop_requested
   use parallel_world, only: attend_to_others
   implicit none(type, external)
   private
   public :: start_watch, set_limit, seconds_so_far, time_to_stop

   integer(long) :: started = 0
   real(wp) :: limit = 0.0_wp   !! [s]; 0: none

contains

   !> Starts the clock of the run and catches stop signals.
   subroutine start_watch()
      call system_clock(started)
      call catch_stop_signals()
   end subroutine start_watch

   !> Sets the time after which the run is to end.
   subroutine set_limit(walltime)
      real(wp), intent(in) :: walltime   !! [min]; 0: none

      limit = 60.0_wp*walltime
   end subroutine set_limit

   !> Since start_watch [s].
   function seconds_so_far() result(seconds)
      real(wp) :: seconds
      integer(long) :: now, rate

      call system_clock(now, rate)
      seconds = real(now - started, wp)/real(rate, wp)
   end function seconds_so_far

   !> True if a signal asked to stop or the time is up, on this rank. For calls between pieces of
   !> work: serves other ranks meanwhile.
   logical function time_to_stop()
      call attend_to_others()
      time_to_stop = stop_requested()
      if (time_to_stop .or. .not. limit > 0.0_wp) return
      time_to_stop = seconds_so_far() > limit
   end function time_to_stop

end module driver_deadline
