!> Signals that ask for an early stop at the next sample boundary: SIGTERM, SIGINT, SIGUSR1.
module parallel_signals
   use, intrinsic :: iso_c_binding, only: c_funloc, c_funptr, c_int, c_long, c_null_ptr, c_ptr
   use core_error, only: exit_stopped
   use core_system, only: c_signal
   implicit none(type, external)
   private
   public :: catch_stop_signals, stop_requested

   integer(c_int), parameter :: sigint = 2, sigusr1 = 10, sigterm = 15   !! Linux
   integer(c_long), parameter :: one_event = 1   !! [s]

   integer(c_int), volatile :: caught = 0         !! number of the first signal; 0: none
   integer(c_long), volatile :: caught_at = 0     !! [s] of the clock

   interface
      function c_time(unused) result(seconds) bind(c, name='time')
         import :: c_long, c_ptr
         type(c_ptr), value :: unused
         integer(c_long) :: seconds
      end function c_time

      subroutine c_exit_now(status) bind(c, name='_exit')
         import :: c_int
         integer(c_int), value :: status
      end subroutine c_exit_now
   end interface

contains

   !> From now on a first signal only sets a flag, and a second one ends the process at once.
   subroutine catch_stop_signals()
      type(c_funptr) :: previous

      previous = c_signal(sigterm, c_funloc(note_signal))
      previous = c_signal(sigint, c_funloc(note_signal))
      previous = c_signal(sigusr1, c_funloc(note_signal))
   end subroutine catch_stop_signals

   !> Whether a signal has asked this rank to stop.
   function stop_requested() result(is_requested)
      logical :: is_requested

      is_requested = caught /= 0
   end function stop_requested

   !> Calls nothing but what POSIX allows in a handler. A batch system and mpirun often deliver one
   !> and the same wish twice: repeats within a second or two of the first count as that first one.
   subroutine note_signal(number) bind(c)
      integer(c_int), value :: number

      if (caught == 0) then
         caught_at = c_time(c_null_ptr)
         caught = number
      else if (c_time(c_null_ptr) - caught_at > one_event) then
         call c_exit_now(int(exit_stopped, c_int))
      end if
   end subroutine note_signal

end module parallel_signals
