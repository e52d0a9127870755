!> Failures of HDF5 as errors. A handler keeps the reason of the first failed call; after a series
!> of calls `conclude` raises an error with it.
!>
!> So the status of each call need not be checked: after a failure HDF5 itself refuses the calls
!> that depend on the failed one.
module io_hdf5_outcome
   use, intrinsic :: iso_c_binding, only: c_associated, c_funloc, c_funptr, c_int, c_int64_t, &
                                                                             c_null_ptr, c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_system, only: text_at
   implicit none(type, external)
   private
   public :: catch_failures, conclude, forget_failure, note_failure

   character(:), allocatable :: reason   !! reason of the first failure; unallocated: none

   !> H5E_error2_t: one entry of HDF5's error stack.
   type, bind(c) :: entry_type
      integer(c_int64_t) :: class, major, minor
      integer(c_int) :: line
      type(c_ptr) :: function_name, file_name, description
   end type entry_type

   interface
      function c_set_auto(stack, report, client) result(status) bind(c, name='H5Eset_auto2')
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         type(c_funptr), value :: report
         type(c_ptr), value :: client
         integer(c_int) :: status
      end function c_set_auto

      function c_walk(stack, direction, visit, client) result(status) bind(c, name='H5Ewalk2')
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         integer(c_int), value :: direction
         type(c_funptr), value :: visit
         type(c_ptr), value :: client
         integer(c_int) :: status
      end function c_walk
   end interface

contains

   !> Makes HDF5 call `report` at each failure instead of printing.
   subroutine catch_failures()
      integer(c_int64_t), parameter :: default_stack = 0
      integer(c_int) :: status

      status = c_set_auto(default_stack, c_funloc(report), c_null_ptr)
   end subroutine catch_failures

   !> Keeps the reason of the first failure: the system's error message if there is one, else the
   !> description by HDF5's innermost function. HDF5 calls it.
   function report(stack, client) result(status) bind(c)
      integer(c_int64_t), value :: stack
      type(c_ptr), value :: client
      integer(c_int) :: status
      integer(c_int), parameter :: from_inside = 0
      character(*), parameter :: opening = "error message = '"
      integer :: first

      status = 0
      if (allocated(reason)) return
      reason = ''
      status = c_walk(stack, from_inside, c_funloc(visit), client)
      first = index(reason, opening)
      if (first > 0) then
         reason = reason(first + len(opening):)
         reason = reason(:index(reason//"'", "'") - 1)
      end if
      if (reason == '') reason = 'HDF5 gives no reason'
   end function report

   !> Keeps the description by the innermost function. HDF5 calls it for each entry of its stack.
   function visit(depth, entry, client) result(status) bind(c)
      integer(c_int), value :: depth
      type(entry_type), intent(in) :: entry
      type(c_ptr), value :: client
      integer(c_int) :: status

      if (depth == 0 .and. c_associated(entry%description)) reason = text_at(entry%description)
      status = 0
      if (c_associated(client)) status = -1   ! never: no client is set
   end function visit

   !> Keeps the reason of a failure that is not HDF5's.
   subroutine note_failure(text)
      character(*), intent(in) :: text

      if (.not. allocated(reason)) reason = text
   end subroutine note_failure

   !> Forgets a failure that only means that there is no such object.
   subroutine forget_failure()
      if (allocated(reason)) deallocate (reason)
   end subroutine forget_failure

   !> Raises an error if any call has failed since the last `conclude`, and forgets the failure.
   subroutine conclude(message, error)
      character(*), intent(in) :: message
      type(error_type), allocatable, intent(out) :: error

      if (allocated(reason)) call raise(error, exit_file, message//': '//reason)
      call forget_failure()
   end subroutine conclude

end module io_hdf5_outcome
