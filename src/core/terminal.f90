!> Where a person reads along: is it a terminal, what an error looks like there, and a quiet end.
module core_terminal
   use, intrinsic :: iso_c_binding, only: c_int
   use, intrinsic :: iso_fortran_env, only: error_unit
   implicit none(type, external)
   private
   public :: end_program, is_terminal, standard_error, standard_output, write_error

   integer(c_int), parameter :: standard_output = 1, standard_error = 2   !! POSIX file descriptors

   interface
      function c_isatty(descriptor) result(answer) bind(c, name='isatty')
         import :: c_int
         integer(c_int), value :: descriptor
         integer(c_int) :: answer
      end function c_isatty

      subroutine c_exit(code) bind(c, name='exit')
         import :: c_int
         integer(c_int), value :: code
      end subroutine c_exit
   end interface

contains

   !> Whether a descriptor leads to a terminal.
   function is_terminal(descriptor)
      integer(c_int), intent(in) :: descriptor
      logical :: is_terminal

      is_terminal = c_isatty(descriptor) == 1
   end function is_terminal

   !> Ends the program with an exit code and without a word, units flushed: gfortran 11 has no
   !> `stop` with quiet=.
   subroutine end_program(exit_code)
      integer, intent(in) :: exit_code

      call c_exit(int(exit_code, c_int))
   end subroutine end_program

   !> Complaints about a scene, several lines that begin with their place, stand as they are; any
   !> other message is headed by the program's name, red on a terminal unless NO_COLOR is set
   !> (https://no-color.org). For drivers, and for what ends a run for them.
   subroutine write_error(message)
      character(*), intent(in) :: message
      character(:), allocatable :: heading
      character, parameter :: escape = achar(27)
      logical :: is_plain

      heading = 'entroslip: '
      is_plain = is_set('NO_COLOR')
      if (is_terminal(standard_error) .and. .not. is_plain) &
         heading = escape//'[1;31mentroslip:'//escape//'[0m '
      if (index(message, new_line('a')) > 0) heading = ''
      write (error_unit, '(a)') heading//message
   end subroutine write_error

   !> Is the variable there and not empty?
   function is_set(name)
      character(*), intent(in) :: name
      logical :: is_set
      integer :: length, status

      call get_environment_variable(name, length=length, status=status)
      is_set = status /= 1 .and. length > 0
   end function is_set

end module core_terminal
