!> A group of a file that is filled or read. After a first error everything else passes by.
module io_group
   use core_kinds, only: wp
   use io_hdf5, only: hdf5_file, hdf5_group
   implicit none(type, external)
   private
   public :: group_type, new_group

   !> A group that is filled with labelled datasets, or read.
   type, extends(hdf5_group) :: group_type
      character(24), private :: axis = ''   !! of the columns of a table
      character(8) :: kept_axis = 'dof'     !! stands for 'kept': dofs whose spectra are kept
   contains
      generic :: get => get_row, get_matrix
      generic :: put => put_reals, put_integers
      procedure :: axes_named
      procedure :: get_number
      procedure :: go_to
      procedure :: put_axis
      procedure :: put_value
      procedure :: start_table
      procedure, private :: get_row, get_matrix, put_reals, put_integers
   end type group_type

contains

   !> The group at a path, made where it is not there.
   function new_group(file, path) result(group)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(group_type) :: group

      group%file = file
      call group%go_to(path)
   end function new_group

   !> The axes as they are called in this group.
   pure function axes_named(self, axes) result(names)
      class(group_type), intent(in) :: self
      character(*), intent(in) :: axes   !! the last one may be 'kept'
      character(:), allocatable :: names
      integer :: last

      last = index(axes, ' ', back=.true.)
      names = axes
      if (axes(last + 1:) == 'kept') names = axes(:last)//trim(self%kept_axis)
   end function axes_named

   !> Goes on with another group of the file, made where it is not there.
   subroutine go_to(self, path)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: path

      self%path = path
      if (.not. allocated(self%error)) call self%file%make_group(path, self%error)
   end subroutine go_to

   !> Writes a whole dataset of any rank, where `values` is there.
   subroutine put_reals(self, name, values, units, long_name, axes, kind, extents)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: axes   !! in Python's order, '' of a scalar; of a column
      character(*), intent(in), optional :: kind   !! as `make` has it
      integer, intent(in), optional :: extents(:)  !! of the dataset, if not the shape of `values`
      character(:), allocatable :: names

      if (.not. present(values)) return
      names = trim(self%axis)
      if (present(axes)) names = self%axes_named(axes)
      call self%write_dataset(name, values, units, long_name, names, kind, extents)
   end subroutine put_reals

   subroutine put_integers(self, name, values, units, long_name, axes)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      integer, intent(in) :: values(:)
      character(*), intent(in), optional :: axes

      call self%put_reals(name, real(values, wp), units, long_name, axes, 'integer')
   end subroutine put_integers

   !> Writes a scalar, and beside it its standard error where it has one.
   subroutine put_value(self, name, value, units, long_name, standard_error)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: value
      real(wp), intent(in), optional :: standard_error

      call self%put(name, value, units, long_name, '')
      call self%put(name//'_error', standard_error, units, 'standard error: '//long_name, '')
   end subroutine put_value

   !> Writes an axis without values of its own: 1, 2, ... or from another first number on.
   subroutine put_axis(self, name, n, long_name, first)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: n
      integer, intent(in), optional :: first
      integer :: before, i

      before = 0
      if (present(first)) before = first - 1
      call self%put(name, [(before + i, i=1, n)], '1', long_name, name)
   end subroutine put_axis

   !> Writes the axis of the columns that follow, put without axes; rows are counted from 1.
   subroutine start_table(self, axis, n_rows, long_name)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: axis, long_name
      integer, intent(in) :: n_rows

      self%axis = axis
      call self%put_axis(axis, n_rows, long_name)
   end subroutine start_table

   !> Reads a scalar.
   subroutine get_number(self, name, value)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(inout) :: value

      call self%read_part(name, [integer ::], value)
   end subroutine get_number

   !> Reads a dataset of reals; an array that is not there is not allocated.
   subroutine get_row(self, name, values)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)   !! not allocated yet

      allocate (values(0))   ! as allocate_for wants it
      deallocate (values)
      call get_reals(self, name, values)
   end subroutine get_row

   subroutine get_matrix(self, name, values)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:, :)   !! not allocated yet

      allocate (values(0, 0))
      deallocate (values)
      call get_reals(self, name, values)
   end subroutine get_matrix

   subroutine get_reals(self, name, values)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(..)

      if (allocated(self%error)) return
      if (.not. self%has(name)) return
      call self%allocate_for(name, values)
      if (.not. allocated(self%error)) &
         call self%move_rows(name, 0, values, 0, size(values, rank(values)), .false.)
   end subroutine get_reals

end module io_group
