!> Progress of a command: lines on what it does, and one that is redrawn on a terminal, or printed
!> once a minute in a log. A quiet rank prints nothing.
module io_progress
   use core_kinds, only: long, wp
   use core_terminal, only: say, write_output
   use core_text, only: duration, to_text
   use io_files, only: shows_on_terminal
   implicit none(type, external)
   private
   public :: inform, progress_text, progress_type, set_quiet

   logical :: is_quiet = .false.   !! with --quiet, and on all ranks but the root

   !> Progress line: call `start`, then `show` any number of times, then `finish`. It prints nothing
   !> before `start`.
   type :: progress_type
      private
      logical :: is_silent = .true.
      logical :: is_redrawn = .false.         !! on a terminal
      character(:), allocatable :: noun       !! counted things, such as 'samples'
      integer :: total = 0, done_before = 0   !! items in all, and those of an earlier run
      integer :: width = 0                    !! characters of the line on the terminal
      real(wp) :: interval = 0.0_wp           !! time between two lines [s]
      real(wp) :: next_line = 0.0_wp          !! time of the next line after the start [s]
      integer(long) :: started = 0            !! clock at the start [ticks]
   contains
      procedure :: announce
      procedure :: start
      procedure :: show
      procedure :: finish
   end type progress_type

contains

   !> Makes this rank quiet, or not.
   subroutine set_quiet(quiet)
      logical, intent(in) :: quiet

      is_quiet = quiet
   end subroutine set_quiet

   !> Prints lines, unless the rank is quiet.
   subroutine inform(text)
      character(*), intent(in) :: text

      if (.not. is_quiet) call say(text)
   end subroutine inform

   !> Shows what is going on until `finish`, on a terminal.
   subroutine announce(self, text)
      class(progress_type), intent(inout) :: self
      character(*), intent(in) :: text

      if (shows_on_terminal() .and. .not. is_quiet) call redraw(self, text)
   end subroutine announce

   !> Starts the clock; items of an earlier run do not enter the rate.
   subroutine start(self, total, done_before, noun)
      class(progress_type), intent(inout) :: self
      integer, intent(in) :: total, done_before
      character(*), intent(in) :: noun   !! what is counted, such as 'samples'

      self%is_silent = is_quiet
      self%is_redrawn = shows_on_terminal()
      self%total = total
      self%noun = noun
      self%done_before = done_before
      self%interval = merge(0.2_wp, 60.0_wp, self%is_redrawn)
      self%next_line = self%interval
      call system_clock(self%started)
   end subroutine start

   !> Prints or redraws the line if the interval since the last one is over.
   subroutine show(self, done, share)
      class(progress_type), intent(inout) :: self
      integer, intent(in) :: done   !! items done, with those of an earlier run
      real(wp), intent(in), optional :: share   !! of the work that is done, if items differ in it
      character(:), allocatable :: text
      integer(long) :: now, rate
      real(wp) :: seconds

      if (self%is_silent) return
      call system_clock(now, rate)
      seconds = real(now - self%started, wp)/real(rate, wp)
      if (seconds < self%next_line) return
      self%next_line = seconds + self%interval
      text = progress_text(done, self%done_before, self%total, seconds, self%noun, share)
      if (self%is_redrawn) then
         call redraw(self, text)
      else
         call say(text)
      end if
   end subroutine show

   !> Clears the line and silences the progress.
   subroutine finish(self)
      class(progress_type), intent(inout) :: self

      if (self%width > 0) call redraw(self, '')
      self%is_silent = .true.
   end subroutine finish

   !> Replaces the line on the terminal, which does not wrap it: a narrow one shows its beginning.
   subroutine redraw(self, text)
      class(progress_type), intent(inout) :: self
      character(*), intent(in) :: text
      character, parameter :: escape = achar(27), return = achar(13)
      character(*), parameter :: no_wrap = escape//'[?7l', wrap = escape//'[?7h'

      call write_output(no_wrap//return//repeat(' ', self%width)//return//text//wrap)
      self%width = len(text)
   end subroutine redraw

   !> Progress line, such as '412 of 1200 samples, 34 %, 5.2 a second, 2.5 min left'; without the
   !> rate if items differ in work.
   pure function progress_text(done, done_before, total, seconds, noun, share) result(text)
      integer, intent(in) :: done, done_before, total
      real(wp), intent(in) :: seconds   !! time for the items after done_before
      character(*), intent(in) :: noun
      real(wp), intent(in), optional :: share   !! as in show
      character(:), allocatable :: text
      real(wp) :: finished, rate, remaining   ! share; items a second; time [s]

      finished = real(done, wp)/max(total, 1)
      if (present(share)) finished = share
      text = to_text(done)//' of '//to_text(total)//' '//noun//', '// &
             to_text(int(100.0_wp*finished))//' %'
      if (done <= done_before .or. .not. seconds > 0.0_wp) return
      rate = (done - done_before)/seconds
      remaining = (total - done)/rate
      if (present(share)) then
         remaining = seconds*(1.0_wp - share)/share
      else if (rate >= 1.0_wp) then
         text = text//', '//to_text(anint(10.0_wp*rate)/10.0_wp)//' a second'
      else
         text = text//', '//to_text(anint(600.0_wp*rate)/10.0_wp)//' a minute'
      end if
      text = text//', '//duration(remaining)//' left'
   end function progress_text

end module io_progress
