!> Values of datasets, moved between file and memory: numbers of any rank, whole or in parts. In
!> memory all are reals, which hold the whole numbers of a file exactly (below 2^53); HDF5 converts
!> them. Arrays are Fortran's here; Python sees their axes reversed.
module io_hdf5_values
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc, c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use hdf5
   use io_hdf5_file, only: hdf5_file
   use io_hdf5_outcome, only: conclude
   implicit none(type, external)
   private
   public :: allocate_for, check_dataset, extents_of, move, move_part, move_rows, read_dataset, &
             read_extent, read_shape

contains

   !> Reads the extent of each axis of a dataset, in Fortran's order; a scalar has none.
   subroutine read_shape(file, path, extents, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer(long), allocatable, intent(out) :: extents(:)
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: dataset, space
      integer(hsize_t), allocatable :: most(:), now(:)
      integer :: n_axes, status

      n_axes = 0
      call h5dopen_f(file%id, path, dataset, status)
      call h5dget_space_f(dataset, space, status)
      call h5sget_simple_extent_ndims_f(space, n_axes, status)
      allocate (most(max(n_axes, 0)), now(max(n_axes, 0)), source=0_hsize_t)
      if (n_axes > 0) then
         call h5sget_simple_extent_dims_f(space, now, most, status)
      end if
      extents = int(now, long)
      call h5sclose_f(space, status)
      call h5dclose_f(dataset, status)
      call conclude(file%path//': '//path//': cannot be read', error)
   end subroutine read_shape

   !> Reads the extents of a dataset and refuses another number of axes than expected.
   subroutine read_extent(file, path, n_axes, extents, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: n_axes   !! expected; 0 for a scalar
      integer(long), allocatable, intent(out) :: extents(:)
      type(error_type), allocatable, intent(out) :: error

      call read_shape(file, path, extents, error)
      if (allocated(error) .or. size(extents) == n_axes) return
      call raise(error, exit_file, file%path//': '//path//': cannot be read: '// &
                 to_text(size(extents))//' axes where '//to_text(n_axes)//' are expected')
   end subroutine read_extent

   !> Allocates an array for a dataset, or for so many rows of its last axis, unless it is there. A
   !> damaged file names any extent. In gfortran 11 `select rank` takes an array for one of assumed
   !> size if its last bound is -1, as memory where it was never allocated may hold it: that memory
   !> is set before.
   subroutine allocate_for(file, path, values, error, n_rows)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      real(wp), allocatable, intent(inout) :: values(..)
      type(error_type), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_rows
      integer(long), allocatable :: n(:)
      integer :: status

      call read_extent(file, path, rank(values), n, error)
      if (allocated(error) .or. allocated(values)) return
      if (present(n_rows)) n(size(n)) = n_rows
      select rank (values)
      rank (1)
         allocate (values(n(1)), stat=status)
      rank (2)
         allocate (values(n(1), n(2)), stat=status)
      rank (3)
         allocate (values(n(1), n(2), n(3)), stat=status)
      rank default
         error stop 'allocate_for: more axes than datasets have'
      end select
      if (status /= 0) call raise(error, exit_file, file%path//': '//path// &
                                  ' does not fit into memory: '//to_text(product(n))//' values')
   end subroutine allocate_for

   !> Reads values from a dataset of just their shape.
   subroutine read_dataset(file, path, values, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      real(wp), intent(out), target, contiguous :: values(..)
      type(error_type), allocatable, intent(out) :: error
      integer(long), allocatable :: found(:)

      call read_extent(file, path, rank(values), found, error)
      if (allocated(error)) return
      if (any(found /= extents_of(values))) then
         call raise(error, exit_file, file%path//': '//path//': has another shape than expected')
      else
         call move(file, path, spread(1, 1, rank(values)), found, c_loc(values), .false., error)
      end if
   end subroutine read_dataset

   !> Reads all of a dataset, a piece at a time, for HDF5 to see that its checksums are right.
   subroutine check_dataset(file, path, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: piece = 2**20   ! values
      integer(long), allocatable :: extents(:)
      real(wp), allocatable, target :: values(:)
      integer(hsize_t), allocatable :: count(:)
      integer, allocatable :: first(:)
      integer :: i, n, rows

      call read_shape(file, path, extents, error)
      if (allocated(error)) return
      n = size(extents)
      if (n == 0) then
         allocate (values(1))
         call read_dataset(file, path, values(1), error)
         return
      end if
      if (any(extents == 0)) return
      rows = int(max(1_long, min(extents(n), piece/product(extents(:n - 1)))))
      count = extents
      first = [(1, i=1, n)]
      allocate (values(product(extents(:n - 1))*rows))
      do i = 1, int(extents(n)), rows
         first(n) = i
         count(n) = min(int(rows, hsize_t), extents(n) - i + 1)
         call pass(file, path, first, count, c_loc(values), .false.)
      end do
      call conclude(file%path//': '//path//': cannot be read back', error)
   end subroutine check_dataset

   !> The shape of what is written or read; empty for a scalar, whose `shape` gfortran 11 gets wrong
   !> where the rank is assumed.
   pure function extents_of(values) result(extents)
      type(*), intent(in) :: values(..)
      integer(hsize_t), allocatable :: extents(:)
      integer :: i

      ! gfortran has -1 for the last extent of an expression without elements
      extents = [(max(size(values, i, hsize_t), 0_hsize_t), i=1, rank(values))]
   end function extents_of

   !> Writes values into the part of a dataset that begins at `first` (counted from 1, Fortran's
   !> order), or reads them from there.
   subroutine move_part(file, path, first, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      real(wp), intent(inout), target, contiguous :: values(..)
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error

      call move(file, path, first, extents_of(values), c_loc(values), is_written, error)
   end subroutine move_part

   !> Writes n rows of the last axis behind the first `place` of them into a dataset, behind its
   !> first `before`, or reads them from there.
   subroutine move_rows(file, path, before, values, place, n, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: before, place, n
      real(wp), allocatable, intent(in), target :: values(..)
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error
      integer(hsize_t) :: extents(rank(values))
      integer :: first(rank(values))
      real(wp), pointer :: numbers(:)

      extents = shape(values)
      if (any(extents < 1) .or. n < 1) return
      call c_f_pointer(c_loc(values), numbers, [product(extents)])
      associate (last => size(extents))
         extents(last) = n
         first = 1
         first(last) = before + 1
         call move(file, path, first, extents, &
                   c_loc(numbers(product(extents(:last - 1))*place + 1)), is_written, error)
      end associate
   end subroutine move_rows

   !> Writes or reads the values of a scalar or of a part of a dataset.
   subroutine move(file, path, first, extents, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      integer(hsize_t), intent(in) :: extents(:)
      type(c_ptr), value :: values
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error

      if (any(extents <= 0)) return
      call pass(file, path, first, extents, values, is_written)
      if (is_written) then
         call conclude(file%path//': '//path//': cannot be written', error)
      else
         call conclude(file%path//': '//path//': cannot be read', error)
      end if
   end subroutine move

   !> Passes values to or from what begins at `first` (counted from 1, Fortran's order).
   subroutine pass(file, path, first, extents, values, is_written)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      integer(hsize_t), intent(in) :: extents(:)
      type(c_ptr), value :: values
      logical, intent(in) :: is_written
      integer(hid_t) :: dataset, part, memory
      integer :: status

      call h5dopen_f(file%id, path, dataset, status)
      call h5dget_space_f(dataset, part, status)
      if (size(extents) == 0) then
         call h5screate_f(H5S_SCALAR_F, memory, status)
      else
         call h5sselect_hyperslab_f(part, H5S_SELECT_SET_F, int(first, hsize_t) - 1, extents, &
                                    status)
         call h5screate_simple_f(size(extents), extents, memory, status)
      end if
      if (is_written) then
         call h5dwrite_f(dataset, H5T_NATIVE_DOUBLE, values, status, memory, part)
      else
         call h5dread_f(dataset, H5T_NATIVE_DOUBLE, values, status, memory, part)
      end if
      call h5sclose_f(memory, status)
      call h5sclose_f(part, status)
      call h5dclose_f(dataset, status)
   end subroutine pass

end module io_hdf5_values
