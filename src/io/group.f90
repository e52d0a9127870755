!> A group of a file being filled: after a first error everything else passes by, and the error is
!> taken once.
module io_group
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_hdf5, only: hdf5_file, label_type, write_attribute, write_dataset
   implicit none(type, external)
   private
   public :: group_type, new_group, counted

   !> A group and the first error met in filling it.
   type :: group_type
      type(hdf5_file) :: file
      character(:), allocatable :: path
      type(error_type), allocatable :: error
      character(24), private :: axis = ''   !! of the columns of a table
   contains
      generic :: put => put_reals, put_integers
      generic :: column => real_column, integer_column
      procedure :: attribute
      procedure :: put_allocated
      procedure :: put_value
      procedure :: start_table
      procedure :: take_error
      procedure, private :: put_reals, put_integers
      procedure, private :: real_column, integer_column
   end type group_type

contains

   !> The group at a path, made where it is not there.
   function new_group(file, path) result(group)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(group_type) :: group

      group%file = file
      group%path = path
      call file%make_group(path, group%error)
   end function new_group

   !> Returns the first error of all work on the group.
   subroutine take_error(self, error)
      class(group_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error

      if (allocated(self%error)) call move_alloc(self%error, error)
   end subroutine take_error

   !> Writes an attribute: a number, a logical or a text.
   subroutine attribute(self, name, value)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      class(*), intent(in) :: value

      if (.not. allocated(self%error)) &
         call write_attribute(self%file, self%path, name, value, self%error)
   end subroutine attribute

   !> Writes a whole dataset of any rank.
   subroutine put_reals(self, name, values, label)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), contiguous :: values(..)
      type(label_type), intent(in) :: label

      if (.not. allocated(self%error)) then
         call write_dataset(self%file, self%path//'/'//name, values, label, self%error)
      end if
   end subroutine put_reals

   !> Writes a whole dataset of any rank, where `values` is allocated.
   subroutine put_allocated(self, name, values, label)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), contiguous, optional :: values(..)
      type(label_type), intent(in) :: label

      if (present(values)) call self%put(name, values, label)
   end subroutine put_allocated

   subroutine put_integers(self, name, values, label)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in), contiguous :: values(..)
      type(label_type), intent(in) :: label

      if (.not. allocated(self%error)) then
         call write_dataset(self%file, self%path//'/'//name, values, label, self%error)
      end if
   end subroutine put_integers

   !> Writes a scalar, and beside it its standard error where it has one.
   subroutine put_value(self, name, value, units, long_name, standard_error)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: value
      real(wp), intent(in), optional :: standard_error
      type(label_type) :: label

      label%units = units
      label%long_name = long_name
      label%axes = ''
      call self%put(name, value, label)
      if (.not. present(standard_error)) return
      label%long_name = 'standard error: '//long_name
      call self%put(name//'_error', standard_error, label)
   end subroutine put_value

   !> Writes the axis of the columns that follow; rows are counted from 1.
   subroutine start_table(self, axis, n_rows, long_name)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: axis, long_name
      integer, intent(in) :: n_rows

      self%axis = axis
      call self%put(axis, counted(n_rows), label_type('1', long_name, axis))
   end subroutine start_table

   subroutine real_column(self, name, values, units, long_name)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: values(:)

      call self%put(name, values, label_type(units, long_name, trim(self%axis)))
   end subroutine real_column

   !> Writes a column of whole numbers, or of flags 0 and 1, without a unit.
   subroutine integer_column(self, name, values, long_name)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: values(:)

      call self%put(name, values, label_type('1', long_name, trim(self%axis)))
   end subroutine integer_column

   !> 1, 2, ... n: the values of an axis without others.
   pure function counted(n) result(numbers)
      integer, intent(in) :: n
      integer :: numbers(n)
      integer :: i

      numbers = [(i, i=1, n)]
   end function counted

end module io_group
