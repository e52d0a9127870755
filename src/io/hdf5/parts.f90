!> Extents, and a part of a dataset, as HDF5 wants them said, for reading and for writing.
module io_hdf5_parts
   use, intrinsic :: iso_c_binding, only: c_loc, c_ptr
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use hdf5
   use io_hdf5_file, only: hdf5_file
   use io_hdf5_outcome, only: conclude
   implicit none(type, external)
   private
   public :: close_part, extents_of, move, move_part, select_part

   !> Writes values into the part of a dataset that begins at `first` (counted from 1, Fortran's
   !> order), or reads them from there.
   interface move_part
      module procedure move_reals, move_integers, move_longs
   end interface move_part

contains

   !> The shape of what is written or read; empty for a scalar, whose `shape` gfortran 11 gets wrong
   !> where the rank is assumed.
   pure function extents_of(values) result(extents)
      type(*), intent(in) :: values(..)
      integer(hsize_t), allocatable :: extents(:)
      integer :: i

      ! gfortran has -1 for the last extent of an expression without elements
      extents = [(max(size(values, i, hsize_t), 0_hsize_t), i=1, rank(values))]
   end function extents_of

   subroutine move_reals(file, path, first, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      real(wp), intent(inout), target, contiguous :: values(..)
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error

      call move(file, path, H5T_NATIVE_DOUBLE, first, extents_of(values), c_loc(values), &
                is_written, error)
   end subroutine move_reals

   subroutine move_integers(file, path, first, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      integer, intent(inout), target, contiguous :: values(..)
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error

      call move(file, path, H5T_NATIVE_INTEGER, first, extents_of(values), c_loc(values), &
                is_written, error)
   end subroutine move_integers

   subroutine move_longs(file, path, first, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      integer(long), intent(inout), target, contiguous :: values(..)
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error

      call move(file, path, h5kind_to_type(long, H5_INTEGER_KIND), first, extents_of(values), &
                c_loc(values), is_written, error)
   end subroutine move_longs

   !> Writes or reads values of an HDF5 type, those of a scalar or of a part of a dataset.
   subroutine move(file, path, kind, first, extents, values, is_written, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer(hid_t), intent(in) :: kind
      integer, intent(in) :: first(:)
      integer(hsize_t), intent(in) :: extents(:)
      type(c_ptr), value :: values
      logical, intent(in) :: is_written
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: dataset, part, memory
      integer :: status

      if (any(extents <= 0)) return
      call select_part(file, path, first, extents, dataset, part, memory)
      if (is_written) then
         call h5dwrite_f(dataset, kind, values, status, memory, part)
      else
         call h5dread_f(dataset, kind, values, status, memory, part)
      end if
      call close_part(dataset, part, memory)
      if (is_written) then
         call conclude(file%path//': '//path//': cannot be written', error)
      else
         call conclude(file%path//': '//path//': cannot be read', error)
      end if
   end subroutine move

   !> Opens what begins at `first` (counted from 1, Fortran's order).
   subroutine select_part(file, path, first, extents, dataset, part, memory)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer, intent(in) :: first(:)
      integer(hsize_t), intent(in) :: extents(:)
      integer(hid_t), intent(out) :: dataset, part, memory
      integer :: status

      call h5dopen_f(file%id, path, dataset, status)
      call h5dget_space_f(dataset, part, status)
      if (size(extents) == 0) then
         call h5screate_f(H5S_SCALAR_F, memory, status)
      else
        call h5sselect_hyperslab_f(part, H5S_SELECT_SET_F, int(first, hsize_t) - 1, extents, status)
         call h5screate_simple_f(size(extents), extents, memory, status)
      end if
   end subroutine select_part

   !> Closes what select_part has opened.
   subroutine close_part(dataset, part, memory)
      integer(hid_t), intent(in) :: dataset, part, memory
      integer :: status

      call h5sclose_f(memory, status)
      call h5sclose_f(part, status)
      call h5dclose_f(dataset, status)
   end subroutine close_part

end module io_hdf5_parts
