!> Error type of all procedures that can fail, and the exit codes of the program.
module core_error
   implicit none(type, external)
   private
   public :: error_type, raise
   public :: exit_done, exit_bad_input, exit_file, exit_no_solution, exit_stopped

   integer, parameter :: exit_done = 0         !! success
   integer, parameter :: exit_bad_input = 2    !! bad command line, scene or input file
   integer, parameter :: exit_file = 3         !! file unwritable, locked, damaged or foreign
   integer, parameter :: exit_no_solution = 4  !! problem without a solution, or search that failed
   integer, parameter :: exit_stopped = 75     !! early stop by a signal or the wall-time limit

   !> Error of a procedure; an unallocated one means success.
   type :: error_type
      integer :: exit_code = exit_no_solution
      character(:), allocatable :: message   !! thing, its value and the broken rule
      integer :: sample = 0   !! the sample of its block that it concerns, from 1; 0: none
   end type error_type

contains

   !> Allocates an error.
   pure subroutine raise(error, exit_code, message)
      type(error_type), allocatable, intent(out) :: error
      integer, intent(in) :: exit_code   !! one of the constants above
      character(*), intent(in) :: message

      allocate (error)
      error%exit_code = exit_code
      error%message = message
   end subroutine raise

end module core_error
