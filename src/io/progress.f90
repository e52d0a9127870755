!> How far a run is: one line, redrawn on a terminal, repeated once a minute in a log.
module io_progress
   use core_kinds, only: long, wp
   use core_terminal, only: say, write_output
   use core_text, only: duration, to_text
   use io_files, only: shows_on_terminal
   implicit none(type, external)
   private
   public :: progress_text, progress_type

   !> `start`, then `show` as often as one likes, then `finish`. Without `start` it says nothing.
   type :: progress_type
      private
      logical :: is_silent = .true.
      logical :: is_redrawn = .false.
      character(:), allocatable :: noun
      integer :: total = 0, done_before = 0
      integer :: width = 0                 !! of the line that stands on the terminal
      real(wp) :: interval = 0.0_wp        !! between two lines [s]
      real(wp) :: next_line = 0.0_wp       !! [s] after the start
      integer(long) :: started = 0         !! ticks of the clock
   contains
      procedure :: start
      procedure :: show
      procedure :: finish
   end type progress_type

contains

   !> Starts the clock; work of an earlier run does not enter the rate.
   subroutine start(self, total, done_before, noun)
      class(progress_type), intent(inout) :: self
      integer, intent(in) :: total, done_before   !! samples
      character(*), intent(in), optional :: noun  !! what is counted, if not samples

      self%is_silent = .false.
      self%is_redrawn = shows_on_terminal()
      self%total = total
      self%noun = 'samples'
      if (present(noun)) self%noun = noun
      self%done_before = done_before
      self%interval = merge(0.2_wp, 60.0_wp, self%is_redrawn)
      self%next_line = self%interval
      call system_clock(self%started)
   end subroutine start

   !> Says how far it is, when it is time to.
   subroutine show(self, done)
      class(progress_type), intent(inout) :: self
      integer, intent(in) :: done   !! samples, those of an earlier run with them
      character(:), allocatable :: text
      integer(long) :: now, rate
      real(wp) :: seconds

      if (self%is_silent) return
      call system_clock(now, rate)
      seconds = real(now - self%started, wp)/real(rate, wp)
      if (seconds < self%next_line) return
      self%next_line = seconds + self%interval
      text = progress_text(done, self%done_before, self%total, seconds, self%noun)
      if (self%is_redrawn) then
         call redraw(self, text)
      else
         call say(text)
      end if
   end subroutine show

   !> Leaves a clean line.
   subroutine finish(self)
      class(progress_type), intent(inout) :: self

      if (self%width > 0) call redraw(self, '')
      self%is_silent = .true.
   end subroutine finish

   subroutine redraw(self, text)
      class(progress_type), intent(inout) :: self
      character(*), intent(in) :: text
      character, parameter :: return = achar(13)

      call write_output(return//repeat(' ', self%width)//return//text)
      self%width = len(text)
   end subroutine redraw

   !> 412 of 1200 samples, 34 %, 5.2 a second, 2.5 min left
   pure function progress_text(done, done_before, total, seconds, noun) result(text)
      integer, intent(in) :: done, done_before, total   !! samples
      real(wp), intent(in) :: seconds                   !! since done_before
      character(*), intent(in) :: noun                  !! 'samples'
      character(:), allocatable :: text
      real(wp) :: rate

      text = to_text(done)//' of '//to_text(total)//' '//noun//', '// &
             to_text(int(100.0_wp*done/max(total, 1)))//' %'
      if (done <= done_before .or. .not. seconds > 0.0_wp) return
      rate = (done - done_before)/seconds
      if (rate >= 1.0_wp) then
         text = text//', '//to_text(anint(10.0_wp*rate)/10.0_wp)//' a second'
      else
         text = text//', '//to_text(anint(600.0_wp*rate)/10.0_wp)//' a minute'
      end if
      text = text//', '//duration((total - done)/rate)//' left'
   end function progress_text

end module io_progress
