!> Group of an HDF5 file: writes datasets with units, meaning and axes, and reads datasets. It keeps
!> the first error; further calls then do nothing.
module io_group
   use core_kinds, only: wp
   use io_hdf5, only: hdf5_file, hdf5_group
   implicit none(type, external)
   private
   public :: group_type, new_group

   !> A group that is written or read.
   type, extends(hdf5_group) :: group_type
      character(24), private :: axis = ''   !! axis of datasets that are written without axes
      character(8) :: kept_axis = 'dof'     !! axis of the dofs whose spectra are kept
   contains
      generic :: get => get_row, get_matrix
      generic :: put => put_reals, put_integers
      procedure :: axes_named
      procedure :: get_number
      procedure :: change_to
      procedure :: put_axis
      procedure :: put_value
      procedure :: start_table
      procedure, private :: get_row, get_matrix, put_reals, put_integers
   end type group_type

contains

   !> The group at a path, created if it is missing.
   function new_group(file, path) result(group)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(group_type) :: group

      group%file = file
      call group%change_to(path)
   end function new_group

   !> Names of axes, with the name of `kept_axis` in place of 'kept'.
   pure function axes_named(self, axes) result(names)
      class(group_type), intent(in) :: self
      character(*), intent(in) :: axes   !! only the last one may be 'kept'
      character(:), allocatable :: names
      integer :: last

      last = index(axes, ' ', back=.true.)
      names = axes
      if (axes(last + 1:) == 'kept') names = axes(:last)//trim(self%kept_axis)
   end function axes_named

   !> Changes to another group of the file, created if it is missing.
   subroutine change_to(self, path)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: path

      self%path = path
      if (.not. allocated(self%error)) call self%file%make_group(path, self%error)
   end subroutine change_to

   !> Writes a whole dataset of any rank, or nothing if `values` is absent or unallocated.
   subroutine put_reals(self, name, values, units, long_name, axes, kind, extents)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in), contiguous, optional :: values(..)
      !> axes in Python's order, '' for a scalar; absent: the axis of `start_table`
      character(*), intent(in), optional :: axes
      character(*), intent(in), optional :: kind   !! kind of whole numbers: see `make`
      integer, intent(in), optional :: extents(:)  !! of the dataset; default: as `values`
      character(:), allocatable :: names

      if (.not. present(values)) return
      names = trim(self%axis)
      if (present(axes)) names = self%axes_named(axes)
      call self%write_dataset(name, values, units, long_name, names, kind, extents)
   end subroutine put_reals

   !> Writes a whole dataset of one axis of integers.
   subroutine put_integers(self, name, values, units, long_name, axes)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      integer, intent(in) :: values(:)
      character(*), intent(in), optional :: axes

      call self%put_reals(name, real(values, wp), units, long_name, axes, 'integer')
   end subroutine put_integers

   !> Writes a scalar, and its standard error as another one if it is present.
   subroutine put_value(self, name, value, units, long_name, standard_error)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: value
      real(wp), intent(in), optional :: standard_error

      call self%put(name, value, units, long_name, '')
      call self%put(name//'_error', standard_error, units, 'standard error: '//long_name, '')
   end subroutine put_value

   !> Writes an axis of n whole numbers that begin at 1, or at `first`.
   subroutine put_axis(self, name, n, long_name, first)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: n
      integer, intent(in), optional :: first
      integer :: i, start

      start = 1
      if (present(first)) start = first
      call self%put(name, [(i, i=start, start + n - 1)], '1', long_name, name)
   end subroutine put_axis

   !> Writes the axis of a table: of the datasets that are then written without axes.
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

   !> Reads a whole dataset; `values` stays unallocated if there is none.
   subroutine get_row(self, name, values)
      class(group_type), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)   !! not allocated yet

      allocate (values(0))   ! sets the bounds that gfortran 11 reads in allocate_for
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
