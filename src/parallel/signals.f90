!> Signals that ask for an early stop at the next sample boundary: SIGTERM, SIGINT, SIGUSR1, SIGHUP
!> (a closed terminal), SIGQUIT and SIGXCPU (a limit of processor time).
module parallel_signals
   use, intrinsic :: iso_c_binding, only: c_funloc, c_funptr, c_int, c_intptr_t, c_long, &
                                          c_null_ptr, c_ptr
   use core_error, only: exit_stopped
   use core_system, only: c_signal
   implicit none(type, external)
   private
   public :: catch_stop_signals, stop_requested

   integer(c_int), parameter :: sighup = 1, sigint = 2, sigquit = 3, sigusr1 = 10, sigterm = 15, &
                                sigxcpu = 24, sigxfsz = 25   !! Linux
   integer(c_intptr_t), parameter :: ignore = 1              !! SIG_IGN
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

   !> Catches signals: from now on the first only sets a flag, and a second one ends the process.
   subroutine catch_stop_signals()
      integer(c_int), parameter :: wishes(*) = [sigterm, sigint, sigusr1, sighup, sigquit, sigxcpu]
      type(c_funptr) :: previous
      integer :: i

      do i = 1, size(wishes)
         previous = c_signal(wishes(i), c_funloc(note_signal))
         if (wishes(i) == sighup .and. transfer(previous, ignore) == ignore) &
            previous = c_signal(sighup, previous)   ! nohup wants it so
      end do
      ! a file beyond the limit of its size is an error of the write, with a message of ours
      previous = c_signal(sigxfsz, transfer(ignore, previous))
   end subroutine catch_stop_signals

   !> True if a signal has asked this rank to stop.
   function stop_requested() result(is_requested)
      logical :: is_requested

      is_requested = caught /= 0
   end function stop_requested

   !> Handles a signal, with calls that POSIX allows in a handler. A batch system and mpirun often
   !> deliver the same signal twice: repeats within a second or two of the first are ignored.
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
