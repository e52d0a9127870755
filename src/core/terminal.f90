!> Standard output, standard error, and the end of the program. A failed write to standard output is
!> an error of the program.
module core_terminal
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_funptr, c_int, c_intptr_t, &
                                          c_long, c_null_char, c_null_funptr, c_ptr, c_short, &
                                          c_size_t
   use core_error, only: exit_done, exit_file
   use core_system, only: c_fopen, c_signal, system_error, system_text
   use core_text, only: line_feed, set_line_width
   implicit none(type, external)
   private
   public :: end_program, is_terminal, output_is_lost, say, standard_error, standard_output, &
             start_terminal, write_all, write_error, write_output

   integer(c_int), parameter :: standard_output = 1, standard_error = 2   !! POSIX file descriptors

   logical :: has_output = .false.   !! the program has written to standard output
   integer(c_int) :: failure = 0     !! system error of its first failed write; 0: none

   interface
      function c_isatty(descriptor) result(answer) bind(c, name='isatty')
         import :: c_int
         integer(c_int), value :: descriptor
         integer(c_int) :: answer
      end function c_isatty

      function c_write(descriptor, text, length) result(written) bind(c, name='write')
         import :: c_char, c_int, c_long, c_size_t
         integer(c_int), value :: descriptor
         character(kind=c_char), intent(in) :: text(*)
         integer(c_size_t), value :: length
         integer(c_long) :: written
      end function c_write

      function c_dup(descriptor) result(copy) bind(c, name='dup')
         import :: c_int
         integer(c_int), value :: descriptor
         integer(c_int) :: copy
      end function c_dup

      function c_close(descriptor) result(status) bind(c, name='close')
         import :: c_int
         integer(c_int), value :: descriptor
         integer(c_int) :: status
      end function c_close

      !> Variable arguments of C: those of integers and addresses pass as any others.
      function c_ioctl(descriptor, request, sizes) result(status) bind(c, name='ioctl')
         import :: c_int, c_long, c_short
         integer(c_int), value :: descriptor
         integer(c_long), value :: request
         integer(c_short), intent(out) :: sizes(*)
         integer(c_int) :: status
      end function c_ioctl

      subroutine c_exit(code) bind(c, name='exit')
         import :: c_int
         integer(c_int), value :: code
      end subroutine c_exit
   end interface

contains

   !> Prepares the standard descriptors, before anything else. Writing to a closed pipe then fails
   !> instead of killing the program. A closed standard descriptor is opened for reading, so that no
   !> results file gets its number; writing there still fails. Reports fit a narrow terminal.
   subroutine start_terminal()
      integer(c_int), parameter :: sigpipe = 13       ! Linux
      integer(c_intptr_t), parameter :: sig_ign = 1   ! SIG_IGN of C: the signal does nothing
      integer(c_long), parameter :: tiocgwinsz = int(z'5413', c_long)   ! Linux: size of a terminal
      type(c_funptr) :: previous
      type(c_ptr) :: stream
      integer(c_int) :: copy, descriptor, status
      integer(c_short) :: sizes(4)   ! rows, columns, and both in pixels

      previous = c_signal(sigpipe, transfer(sig_ign, c_null_funptr))
      do descriptor = 0, standard_error
         copy = c_dup(descriptor)
         if (copy >= 0) then
            status = c_close(copy)
         else
            stream = c_fopen('/dev/null'//c_null_char, 'r'//c_null_char)
            if (.not. c_associated(stream)) return
         end if
      end do
      if (c_ioctl(standard_output, tiocgwinsz, sizes) /= 0) return
      if (sizes(2) > 0) call set_line_width(int(sizes(2)))   ! 0: a terminal that does not say
   end subroutine start_terminal

   !> True if a descriptor leads to a terminal.
   function is_terminal(descriptor)
      integer(c_int), intent(in) :: descriptor
      logical :: is_terminal

      is_terminal = c_isatty(descriptor) == 1
   end function is_terminal

   !> Writes lines to standard output.
   subroutine say(text)
      character(*), intent(in) :: text   !! text without its last line feed

      call write_output(text//line_feed)
   end subroutine say

   !> Writes characters to standard output at once. Keeps the first failure for `end_program` and
   !> writes nothing after it.
   subroutine write_output(text)
      character(*), intent(in) :: text

      has_output = .true.
      if (failure == 0) call write_all(standard_output, text, failure)
   end subroutine write_output

   !> True if a write to standard output failed. Network file systems report that only when a
   !> descriptor is closed, so a copy of it is closed.
   function output_is_lost() result(is_lost)
      logical :: is_lost
      integer(c_int) :: status

      if (has_output .and. failure == 0) then
         status = c_close(c_dup(standard_output))
         if (status /= 0) failure = system_error()
      end if
      is_lost = failure /= 0
   end function output_is_lost

   !> Ends the program with an exit code: exit_file instead of exit_done if output was lost. Reports
   !> that, unless a reader such as `head` has ended. (gfortran 11 has no `stop` with quiet=.)
   subroutine end_program(exit_code)
      integer, intent(in) :: exit_code
      integer(c_int), parameter :: epipe = 32   !! Linux
      integer :: code

      code = exit_code
      if (output_is_lost()) then
         if (failure /= epipe) &
            call write_error('standard output: cannot be written: '//system_text(failure))
         if (code == exit_done) code = exit_file
      end if
      call c_exit(int(code, c_int))
   end subroutine end_program

   !> Writes a message to standard error. Messages of several lines, complaints about a scene, stay
   !> as they are; any other begins with the program's name, in red on a terminal unless NO_COLOR is
   !> set (https://no-color.org).
   subroutine write_error(message)
      character(*), intent(in) :: message
      character(:), allocatable :: heading
      character, parameter :: escape = achar(27)
      integer(c_int) :: ignored   ! a failure cannot be reported anywhere else
      logical :: is_plain

      heading = 'entroslip: '
      is_plain = is_set('NO_COLOR')
      if (is_terminal(standard_error) .and. .not. is_plain) &
         heading = escape//'[1;31mentroslip:'//escape//'[0m '
      if (index(message, line_feed) > 0) heading = ''
      call write_all(standard_error, heading//message//line_feed, ignored)
   end subroutine write_error

   !> Writes a text to a descriptor, in as many pieces as the system needs.
   subroutine write_all(descriptor, text, number)
      integer(c_int), intent(in) :: descriptor
      character(*), intent(in) :: text
      integer(c_int), intent(out) :: number   !! system error; 0: all is written
      integer(c_int), parameter :: eintr = 4  !! a signal came before anything was written
      integer(c_long) :: written
      integer :: first

      number = 0
      first = 1
      do while (first <= len(text))
         written = c_write(descriptor, text(first:), int(len(text) - first + 1, c_size_t))
         if (written >= 0) then
            first = first + int(written)
         else
            number = system_error()
            if (number /= eintr) return
            number = 0
         end if
      end do
   end subroutine write_all

   !> True if an environment variable is set and not empty.
   function is_set(name)
      character(*), intent(in) :: name
      logical :: is_set
      integer :: length, status

      call get_environment_variable(name, length=length, status=status)
      is_set = status /= 1 .and. length > 0
   end function is_set

end module core_terminal
