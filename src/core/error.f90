!> The error that every procedure that can fail returns, with the exit code of the program.
module core_error
   implicit none(type, external)
   private
   public :: error_type, raise
   public :: exit_done, exit_bad_input, exit_file, exit_no_solution, exit_stopped

   integer, parameter :: exit_done = 0         !! all that was asked is done
   integer, parameter :: exit_bad_input = 2    !! bad usage, scene or input file; nothing computed
   integer, parameter :: exit_file = 3         !! a file is unwritable, locked, damaged or foreign
   integer, parameter :: exit_no_solution = 4  !! the problem has none, or a search failed
   integer, parameter :: exit_stopped = 75     !! stopped early by a signal or the wall-time limit

   !> Unallocated means success.
   type :: error_type
      integer :: exit_code = exit_no_solution
      character(:), allocatable :: message   !! names the thing, its value and the rule
   end type error_type

contains

   !> Allocates an error; `exit_code` is one of the exit_* above.
   pure subroutine raise(error, exit_code, message)
      type(error_type), allocatable, intent(out) :: error
      integer, intent(in) :: exit_code
      character(*), intent(in) :: message

      allocate (error)
      error%exit_code = exit_code
      error%message = message
   end subroutine raise

end module core_error
