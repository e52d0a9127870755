!> How a series of HDF5 calls ended: the first failure, in HDF5's own words or the system's.
module io_hdf5_outcome
   use, intrinsic :: iso_c_binding, only: c_associated, c_bool, c_char, c_f_pointer, c_funloc, &
                                                            c_funptr, c_int, c_int64_t, c_loc, c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_system, only: text_at
   implicit none(type, external)
   private
   public :: outcome_type

   !> Every status of a series is noted; after the first failure HDF5 refuses what depends on it by
   !> itself.
   type :: outcome_type
      character(:), allocatable :: reason   !! allocated after a failure
   contains
      procedure :: note
      procedure :: conclude
   end type outcome_type

   !> H5E_error2_t: one entry of HDF5's stack of reasons.
   type, bind(c) :: entry_type
      integer(c_int64_t) :: class, major, minor
      integer(c_int) :: line
      type(c_ptr) :: function_name, file_name, description
   end type entry_type

   type :: reason_type
      character(:), allocatable :: text
   end type reason_type

   interface
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

   !> Takes note of one status; called right after its call.
   subroutine note(self, status)
      class(outcome_type), intent(inout) :: self
      integer, intent(in) :: status

      if (status < 0 .and. .not. allocated(self%reason)) self%reason = deepest_reason()
   end subroutine note

   !> Raises an error where any status was a failure.
   subroutine conclude(self, message, error)
      class(outcome_type), intent(in) :: self
      character(*), intent(in) :: message
      type(error_type), allocatable, intent(out) :: error

      if (allocated(self%reason)) call raise(error, exit_file, message//': '//self%reason)
   end subroutine conclude

   !> The system's words where the system refused, else what the innermost function of HDF5 says.
   function deepest_reason() result(text)
      character(:), allocatable :: text
      integer(c_int64_t), parameter :: current_stack = 0
      integer(c_int), parameter :: from_inside = 0
      character(*), parameter :: opening = "error message = '"
      type(reason_type), target :: reason
      integer :: first
      integer(c_int) :: status

      reason%text = ''
      status = c_walk(current_stack, from_inside, c_funloc(visit), c_loc(reason))
      text = reason%text
      first = index(text, opening)
      if (first > 0) then
         text = text(first + len(opening):)
         text = text(:index(text//"'", "'") - 1)
      end if
      if (text == '') text = 'HDF5 gives no reason'
   end function deepest_reason

   !> Keeps the first description that it is shown.
   function visit(depth, entry, client) result(status) bind(c)
      integer(c_int), value :: depth
      type(entry_type), intent(in) :: entry
      type(c_ptr), value :: client
      integer(c_int) :: status
      type(reason_type), pointer :: reason

      call c_f_pointer(client, reason)
      if (depth == 0 .and. c_associated(entry%description)) reason%text = text_at(entry%description)
      status = 0
   end function visit

end module io_hdf5_outcome
