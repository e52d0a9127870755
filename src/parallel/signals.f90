!> Signals that ask the run to stop early, between two blocks: SIGTERM, SIGINT, SIGUSR1, SIGHUP (a
!> closed terminal), SIGQUIT and SIGXCPU (a limit of processor time).
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
   integer(c_intptr_t), parameter :: sig_ign = 1   !! SIG_IGN of C: the signal does nothing
   integer(c_long), parameter :: repeat_time = 1   !! time in which repeated signals are ignored [s]

   integer(c_int), volatile :: caught = 0          !! number of the first signal; 0: none
   integer(c_long), volatile :: caught_at = 0      !! time of the first signal [s]

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

   !> Catches the signals: the first sets a flag, a second one ends the process.
   subroutine catch_stop_signals()
      integer(c_int), parameter :: signals(*) = [sigterm, sigint, sigusr1, sighup, sigquit, sigxcpu]
      type(c_funptr) :: previous
      integer :: i

      do i = 1, size(signals)
         previous = c_signal(signals(i), c_funloc(note_signal))
         if (signals(i) == sighup .and. transfer(previous, sig_ign) == sig_ign) &
            previous = c_signal(sighup, previous)   ! the program was started by nohup
      end do
      ! a write beyond the limit of file sizes then fails, with an error, instead of a signal
      previous = c_signal(sigxfsz, transfer(sig_ign, previous))
   end subroutine catch_stop_signals

   !> True if this rank has received a signal to stop.
   logical function stop_requested() result(is_requested)

      is_requested = caught /= 0
   end function stop_requested

   !> Handles a signal, with calls that POSIX allows in a handler. Batch systems and mpirun often
   !> deliver a signal twice: signals within a second or two of the first are ignored.
   subroutine note_signal(number) bind(c)
      integer(c_int), value :: number

      if (caught == 0) then
         caught_at = c_time(c_null_ptr)
         caught = number
      else if (c_time(c_null_ptr) - caught_at > repeat_time) then
         call c_exit_now(int(exit_stopped, c_int))
      end if
   end subroutine note_signal

end module parallel_signals
