!> Labelled datasets written: numbers of any rank, whole or in parts, each axis joined to its scale.
!>
!> Arrays are Fortran's here; Python sees their axes reversed, and axis names are given in Python's
!> order.
module io_hdf5_writing
   use, intrinsic :: iso_c_binding, only: c_loc
   use core_chunks, only: chunk_of
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_table, only: next_word
   use hdf5
   use h5ds, only: h5dsattach_scale_f, h5dsset_scale_f
   use io_hdf5_attributes, only: hdf5_object
   use io_hdf5_file, only: hdf5_file, make_parents, new_timeless_list
   use io_hdf5_outcome, only: conclude
   use io_hdf5_values, only: extents_of, move
   implicit none(type, external)
   private
   public :: label_type, make_dataset, write_dataset

   !> Label of a dataset.
   type :: label_type
      character(:), allocatable :: units       !! '1' for pure numbers
      character(:), allocatable :: long_name
      character(:), allocatable :: axes        !! 'sample dof': as Python sees them; '' for a scalar
      integer, allocatable :: chunk(:)         !! Fortran's order; unallocated: chosen
      integer, allocatable :: extents(:)       !! the same; unallocated: the shape of the values
      !> 'integer' or 'long' where the file has whole numbers, of 4 or 8 bytes
      character(8) :: kind = 'real'
   end type label_type

contains

   !> Writes a whole dataset of any rank with its label; groups are made where missing. One that
   !> bears the name of its only axis becomes that axis: write it before those that have the axis.
   subroutine write_dataset(file, path, values, label, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      real(wp), intent(in), target, contiguous :: values(..)
      type(label_type), intent(in) :: label
      type(error_type), allocatable, intent(out) :: error
      integer(long), allocatable :: extents(:)

      extents = extents_of(values)
      if (allocated(label%extents)) extents = label%extents
      call make_dataset(file, path, extents, label, error)
      if (.not. allocated(error)) call move(file, path, spread(1, 1, size(extents)), extents, &
                                            c_loc(values), .true., error)
   end subroutine write_dataset

   !> Creates a dataset with its label, without values, which move_part fills: a scalar in the
   !> object's header, an array in chunks, both under a checksum of HDF5's own.
   subroutine make_dataset(file, path, extents, label, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      integer(long), intent(in) :: extents(:)   !! Fortran's order
      type(label_type), intent(in) :: label
      type(error_type), allocatable, intent(out) :: error
      integer(hsize_t) :: chunk(size(extents))
      integer(hid_t) :: dataset, kind, properties, space
      integer :: n_axes, status

      n_axes = size(extents)
      call make_parents(file, path)
      call new_timeless_list(H5P_DATASET_CREATE_F, properties)
      if (n_axes == 0) then
         call h5screate_f(H5S_SCALAR_F, space, status)
         call h5pset_layout_f(properties, H5D_COMPACT_F, status)
      else
         call h5screate_simple_f(n_axes, int(extents, hsize_t), space, status)
         if (all(extents > 0)) then
            chunk = chunk_of(extents)
            if (allocated(label%chunk)) chunk = label%chunk
            call h5pset_chunk_f(properties, n_axes, chunk, status)
            call h5pset_fletcher32_f(properties, status)
         end if
      end if
      select case (label%kind)
      case ('integer')
         kind = H5T_NATIVE_INTEGER
      case ('long')
         kind = h5kind_to_type(long, H5_INTEGER_KIND)
      case default
         kind = H5T_NATIVE_DOUBLE
      end select
      call h5dcreate_f(file%id, path, kind, space, dataset, status, dcpl_id=properties)
      call h5dclose_f(dataset, status)
      call h5sclose_f(space, status)
      call h5pclose_f(properties, status)
      call conclude(file%path//': '//path//': cannot be made', error)
      if (.not. allocated(error)) call describe(file, path, label, error)
   end subroutine make_dataset

   !> Writes units, long name and axes of a dataset.
   subroutine describe(file, path, label, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path
      type(label_type), intent(in) :: label
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: dataset

      dataset = hdf5_object(file, path)
      call dataset%attribute('units', label%units)
      call dataset%attribute('long_name', label%long_name)
      call dataset%take_error(error)
      if (.not. allocated(error)) call attach_axes(file, path, label%axes, error)
   end subroutine describe

   !> Joins each axis of a dataset to the scale of that name in the same group, or in the group
   !> above.
   subroutine attach_axes(file, path, axes, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path, axes
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: dataset, scale
      integer :: above, first, last, n, slash, status

      slash = index(path, '/', back=.true.)
      call h5dopen_f(file%id, path, dataset, status)
      if (axes == path(slash + 1:)) then
         call h5dsset_scale_f(dataset, status, axes)
      else
         n = 0
         last = 0
         do
            call next_word(axes, first, last)
            if (first > last) exit
            n = n + 1
            above = slash
            if (.not. file%has(path(:slash)//axes(first:last))) &
               above = index(path(:slash - 1), '/', back=.true.)
            call h5dopen_f(file%id, path(:above)//axes(first:last), scale, status)
            call h5dsattach_scale_f(dataset, scale, n, status)   ! counted as Python counts
            call h5dclose_f(scale, status)
         end do
      end if
      call h5dclose_f(dataset, status)
      call conclude(file%path//': '//path//': cannot be given its axes ('//axes//')', error)
   end subroutine attach_axes

end module io_hdf5_writing
