!> Datasets read: numbers of any rank, whole or in parts. Arrays are Fortran's here; Python sees
!> their axes reversed.
module io_hdf5_reading
   use, intrinsic :: iso_c_binding, only: c_loc, c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use hdf5
   use io_hdf5_file, only: hdf5_file
   use io_hdf5_outcome, only: conclude
   use io_hdf5_parts, only: close_part, extents_of, move, select_part
   implicit none(type, external)
   private
   public :: check_dataset, read_dataset, read_extent, read_shape

   !> Values from a dataset of just their shape.
   interface read_dataset
      module procedure read_real, read_integer
   end interface read_dataset

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

   subroutine read_real(file, path, values, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      real(wp), intent(out), target, contiguous :: values(..)
      type(error_type), allocatable, intent(out) :: error

      call read_whole(file, path, H5T_NATIVE_DOUBLE, extents_of(values), c_loc(values), error)
   end subroutine read_real

   subroutine read_integer(file, path, values, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(out), target, contiguous :: values(..)
      type(error_type), allocatable, intent(out) :: error

      call read_whole(file, path, H5T_NATIVE_INTEGER, extents_of(values), c_loc(values), error)
   end subroutine read_integer

   subroutine read_whole(file, path, kind, extents, values, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer(hid_t), intent(in) :: kind
      integer(long), intent(in) :: extents(:)
      type(c_ptr), value :: values
      type(error_type), allocatable, intent(out) :: error
      integer(long), allocatable :: found(:)

      call read_extent(file, path, size(extents), found, error)
      if (allocated(error)) return
      if (any(found /= extents)) then
         call raise(error, exit_file, file%path//': '//path//': has another shape than expected')
      else
         call move(file, path, kind, spread(1, 1, size(extents)), extents, values, .false., error)
      end if
   end subroutine read_whole

   !> Reads all of a dataset, a piece at a time, for HDF5 to see that its checksums are right.
   subroutine check_dataset(file, path, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: piece = 2**20   ! values
      integer(long), allocatable :: extents(:)
      real(wp), allocatable, target :: values(:)
      type(c_ptr) :: address
      integer(hsize_t), allocatable :: count(:)
      integer(hid_t) :: dataset, memory, part
      integer, allocatable :: first(:)
      integer :: i, n, rows, status

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
         call select_part(file, path, first, count, dataset, part, memory)
         address = c_loc(values)
         call h5dread_f(dataset, H5T_NATIVE_DOUBLE, address, status, memory, part)
         call close_part(dataset, part, memory)
      end do
      call conclude(file%path//': '//path//': cannot be read back', error)
   end subroutine check_dataset

end module io_hdf5_reading
