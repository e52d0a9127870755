!> Groups and their datasets: numbers of any rank, whole or in parts, with units, meaning and axes.
!>
!> In memory all numbers are reals. HDF5 converts the whole numbers of a file, which are exact below
!> 2^53. Extents and indices have Fortran's order; Python sees the axes reversed, and the names of
!> axes are given in Python's order.
module io_hdf5_datasets
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc, c_ptr
   use core_chunks, only: chunk_of
   use core_error, only: exit_file, raise
   use core_kinds, only: long, wp
   use core_table, only: words_of
   use core_text, only: to_text
   use h5ds, only: h5dsattach_scale_f, h5dsset_scale_f
   use hdf5
   use io_hdf5_attributes, only: hdf5_object
   use io_hdf5_file, only: hdf5_file, new_timeless_list, note_failure
   implicit none(type, external)
   private
   public :: hdf5_group, new_group

   !> Group whose datasets have their names in it. It keeps the first error, see hdf5_object.
   type, extends(hdf5_object) :: hdf5_group
      character(24), private :: axis = ''   !! axis of datasets that are written without axes
      character(8) :: kept_axis = 'dof'     !! axis of the dofs whose spectra are kept
   contains
      generic :: get => get_row, get_matrix
      generic :: put => put_reals, put_integers
      procedure :: axes_named
      procedure :: put_axis
      procedure :: put_value
      procedure :: start_table
      procedure :: make
      procedure :: read_shape
      procedure :: allocate_for
      procedure :: check
      procedure :: read_part
      procedure :: move_rows
      procedure, private :: put_reals, put_integers, get_row, get_matrix
      procedure, private :: attach_axes, move
   end type hdf5_group

contains

   !> The group at a path, created if it is missing.
   type(hdf5_group) function new_group(file, path) result(group)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: path

      group%file = file
      call group%change_to(path)
   end function new_group

   !> Creates a dataset without values: a small one in the header of its object, where it is opened
   !> and read the fastest, a large one in chunks, both with checksums of HDF5. A dataset with the
   !> name of its only axis becomes that axis; it must be made before the datasets that have the
   !> axis.
   subroutine make(self, name, extents, units, long_name, axes, kind, chunk)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer(hsize_t), intent(in) :: extents(:)   !! Fortran's order
      character(*), intent(in) :: units            !! '1' for pure numbers
      character(*), intent(in) :: long_name
      character(*), intent(in) :: axes             !! names in Python's order: 'sample dof'; or ''
      !> 'integer' or 'long' for whole numbers of 4 or 8 bytes in the file; else reals
      character(*), intent(in), optional :: kind
      integer, intent(in), optional :: chunk(:)    !! Fortran's order; absent: that of chunk_of
      type(hdf5_object) :: object
      integer(hsize_t), parameter :: most_in_header = 512   ! values: 4 kB; HDF5 allows 64 kB
      integer(hsize_t) :: chunks(size(extents))
      integer(hid_t) :: dataset, number, properties, space
      integer :: status

      if (allocated(self%error)) return
      call new_timeless_list(H5P_DATASET_CREATE_F, properties)
      call h5screate_simple_f(size(extents), extents, space, status)   ! without axes: a scalar
      if (product(extents) <= most_in_header) then
         call h5pset_layout_f(properties, H5D_COMPACT_F, status)
      else
         chunks = chunk_of(int(extents, long))
         if (present(chunk)) chunks = chunk
         call h5pset_chunk_f(properties, size(extents), chunks, status)
         call h5pset_fletcher32_f(properties, status)
      end if
      number = H5T_NATIVE_DOUBLE
      if (present(kind)) then
         if (kind == 'integer') number = H5T_NATIVE_INTEGER
         if (kind == 'long') number = h5kind_to_type(long, H5_INTEGER_KIND)
      end if
      call h5dcreate_f(self%file%id, self%path_of(name), number, space, dataset, status, &
                       dcpl_id=properties)
      call h5dclose_f(dataset, status)
      call h5sclose_f(space, status)
      call h5pclose_f(properties, status)
      call self%keep_failure(self%path_of(name), ': cannot be made')
      if (allocated(self%error)) return
      object%file = self%file   ! gfortran leaks a text that a constructor is given by a function
      object%path = self%path_of(name)
      call object%attribute('units', units)
      call object%attribute('long_name', long_name)
      call object%take_error(self%error)
      if (.not. allocated(self%error)) call self%attach_axes(name, axes)
   end subroutine make

   !> Attaches the scale of each axis, a dataset of the same group or of the group above, to a
   !> dataset.
   subroutine attach_axes(self, name, axes)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name, axes
      character(:), allocatable :: path, words(:)
      integer(hid_t) :: dataset, scale
      integer :: n, status

      call h5dopen_f(self%file%id, self%path_of(name), dataset, status)
      if (axes == name) then
         call h5dsset_scale_f(dataset, status, axes)
      else
         words = words_of(axes)
         do n = 1, size(words)
            path = self%path_of(trim(words(n)))
            if (.not. self%has(trim(words(n)))) &
               path = self%path(:index(self%path, '/', back=.true.))//trim(words(n))
            call h5dopen_f(self%file%id, path, scale, status)
            call h5dsattach_scale_f(dataset, scale, n, status)   ! counted as Python counts
            call h5dclose_f(scale, status)
         end do
      end if
      call h5dclose_f(dataset, status)
      call self%keep_failure(self%path_of(name), ': cannot be given its axes ('//axes//')')
   end subroutine attach_axes

   !> Reads the extent of each axis of a dataset, in Fortran's order; a scalar has none. Refuses
   !> another number of axes than expected.
   subroutine read_shape(self, name, extents, n_axes)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer(long), allocatable, intent(out) :: extents(:)
      integer, intent(in), optional :: n_axes   !! expected; 0 for a scalar
      integer(hid_t) :: dataset, space
      integer(hsize_t), allocatable :: most(:), now(:)
      integer :: n, status

      n = 0
      call h5dopen_f(self%file%id, self%path_of(name), dataset, status)
      call h5dget_space_f(dataset, space, status)
      call h5sget_simple_extent_ndims_f(space, n, status)
      allocate (most(max(n, 0)), now(max(n, 0)), source=0_hsize_t)
      if (n > 0) call h5sget_simple_extent_dims_f(space, now, most, status)
      extents = int(now, long)
      call h5sclose_f(space, status)
      call h5dclose_f(dataset, status)
      if (present(n_axes)) then
         if (n /= n_axes) call note_failure(to_text(n)//' axes where '//to_text(n_axes)// &
                                            ' are expected')
      end if
      call self%keep_failure(self%path_of(name), ': cannot be read')
   end subroutine read_shape

   !> Allocates an array for a dataset, or for n_rows rows of its last axis, unless it is allocated.
   !> Raises an error if memory is too small, as for the extents of a damaged file. In gfortran 11
   !> `select rank` takes an array for one of assumed size if its last bound is -1, which may stand
   !> in memory that was never allocated: the caller sets that memory before.
   subroutine allocate_for(self, name, values, n_rows)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(..)
      integer, intent(in), optional :: n_rows
      integer(long), allocatable :: n(:)
      integer :: status

      call self%read_shape(name, n, rank(values))
      if (allocated(self%error) .or. allocated(values)) return
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
      if (status /= 0) call raise(self%error, exit_file, self%file%path//': '// &
                                  self%path_of(name)//' does not fit into memory: '// &
                                       to_text(product(n))//' values')
   end subroutine allocate_for

   !> Reads all of a dataset, a piece at a time, so that HDF5 verifies its checksums.
   subroutine check(self, name)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer, parameter :: piece = 2**20   ! values that are read at once
      integer(long), allocatable :: extents(:)
      real(wp), allocatable, target :: values(:)
      real(wp) :: scalar
      integer(hsize_t), allocatable :: count(:)
      integer :: i, n, rows

      call self%read_shape(name, extents)
      n = size(extents)
      if (n == 0) call self%read_part(name, [integer ::], scalar)
      if (allocated(self%error) .or. n == 0 .or. any(extents == 0)) return
      count = extents
      rows = int(max(1_long, min(extents(n), piece/product(extents(:n - 1)))))
      allocate (values(product(extents(:n - 1))*rows))
      do i = 1, int(extents(n)), rows
         count(n) = min(int(rows, hsize_t), extents(n) - i + 1)
         call self%move(name, [spread(1, 1, n - 1), i], count, c_loc(values), .false.)
      end do
   end subroutine check

   !> Names of axes, with the name of `kept_axis` in place of 'kept'.
   pure function axes_named(self, axes) result(names)
      class(hdf5_group), intent(in) :: self
      character(*), intent(in) :: axes   !! only the last one may be 'kept'
      character(:), allocatable :: names
      integer :: last

      last = index(axes, ' ', back=.true.)
      names = axes
      if (axes(last + 1:) == 'kept') names = axes(:last)//trim(self%kept_axis)
   end function axes_named

   !> Writes a whole dataset of any rank, or nothing if `values` is absent or unallocated.
   subroutine put_reals(self, name, values, units, long_name, axes, kind, extents)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in), target, contiguous, optional :: values(..)
      !> axes in Python's order, '' for a scalar; absent: the axis of `start_table`
      character(*), intent(in), optional :: axes
      character(*), intent(in), optional :: kind   !! kind of whole numbers: see `make`
      integer, intent(in), optional :: extents(:)  !! of the dataset; default: as `values`
      integer(hsize_t), allocatable :: shape_in_file(:)
      character(:), allocatable :: names

      if (.not. present(values)) return
      names = trim(self%axis)
      if (present(axes)) names = self%axes_named(axes)
      shape_in_file = extents_of(values)
      if (present(extents)) shape_in_file = extents
      call self%make(name, shape_in_file, units, long_name, names, kind)
      call self%move(name, spread(1, 1, size(shape_in_file)), shape_in_file, c_loc(values), .true.)
   end subroutine put_reals

   !> Writes a whole dataset of one axis of integers.
   subroutine put_integers(self, name, values, units, long_name, axes)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      integer, intent(in) :: values(:)
      character(*), intent(in), optional :: axes

      call self%put_reals(name, real(values, wp), units, long_name, axes, 'integer')
   end subroutine put_integers

   !> Writes a scalar, and its standard error as another one if it is present.
   subroutine put_value(self, name, value, units, long_name, standard_error)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: value
      real(wp), intent(in), optional :: standard_error

      call self%put(name, value, units, long_name, '')
      call self%put(name//'_error', standard_error, units, 'standard error: '//long_name, '')
   end subroutine put_value

   !> Writes an axis of n whole numbers that begin at 1, or at `first`, unless the group has it; a
   !> piece at a time, because an axis of transitions may be long.
   subroutine put_axis(self, name, n, long_name, first)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: n
      integer, intent(in), optional :: first
      integer, parameter :: piece = 2**16
      real(wp), allocatable :: numbers(:)
      integer :: i, offset

      if (allocated(self%error)) return
      if (self%has(name)) return
      call self%make(name, [int(n, hsize_t)], '1', long_name, name, 'integer')
      offset = 0
      if (present(first)) offset = first - 1
      numbers = [(i + offset, i=1, min(n, piece))]
      do i = 0, n - 1, piece
         call self%move_rows(name, i, numbers, 0, min(piece, n - i), .true.)
         numbers = numbers + piece
      end do
   end subroutine put_axis

   !> Writes the axis of a table: of the datasets that are then written without axes.
   subroutine start_table(self, axis, n_rows, long_name)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: axis, long_name
      integer, intent(in) :: n_rows

      self%axis = axis
      call self%put_axis(axis, n_rows, long_name)
   end subroutine start_table

   !> Reads a whole dataset; `values` stays unallocated if there is none.
   subroutine get_row(self, name, values)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)   !! not allocated yet

      allocate (values(0))   ! sets the bounds that gfortran 11 reads in allocate_for
      deallocate (values)
      call get_reals(self, name, values)
   end subroutine get_row

   subroutine get_matrix(self, name, values)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:, :)   !! not allocated yet

      allocate (values(0, 0))
      deallocate (values)
      call get_reals(self, name, values)
   end subroutine get_matrix

   subroutine get_reals(self, name, values)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(..)

      if (allocated(self%error)) return
      if (.not. self%has(name)) return
      call self%allocate_for(name, values)
      if (.not. allocated(self%error)) &
         call self%move_rows(name, 0, values, 0, size(values, rank(values)), .false.)
   end subroutine get_reals

   !> Reads the part of a dataset that begins at `first` and has the shape of `values`.
   subroutine read_part(self, name, first, values)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: first(:)   !! counted from 1, Fortran's order; empty for a scalar
      real(wp), intent(inout), target, contiguous :: values(..)

      call self%move(name, first, extents_of(values), c_loc(values), .false.)
   end subroutine read_part

   !> Shape of an array of assumed rank, empty for a scalar, for which gfortran 11 gets `shape`
   !> wrong.
   pure function extents_of(values) result(extents)
      type(*), intent(in) :: values(..)
      integer(hsize_t), allocatable :: extents(:)
      integer :: i

      ! gfortran gives the last extent of an empty expression as -1
      extents = [(max(size(values, i, hsize_t), 0_hsize_t), i=1, rank(values))]
   end function extents_of

   !> Writes or reads n rows of the last axis, between the dataset from row file_offset + 1 on and
   !> the array from row offset + 1 on.
   subroutine move_rows(self, name, file_offset, values, offset, n, is_written)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: file_offset, offset, n
      real(wp), allocatable, intent(in), target :: values(..)
      logical, intent(in) :: is_written   !! else read
      integer(hsize_t) :: extents(rank(values))
      integer :: first(rank(values))
      real(wp), pointer :: numbers(:)

      extents = shape(values)
      if (any(extents < 1) .or. n < 1) return
      call c_f_pointer(c_loc(values), numbers, [product(extents)])
      associate (last => size(extents))
         extents(last) = n
         first = 1
         first(last) = file_offset + 1
         call self%move(name, first, extents, &
                        c_loc(numbers(product(extents(:last - 1))*offset + 1)), is_written)
      end associate
   end subroutine move_rows

   !> Writes or reads a scalar, or the part of a dataset that begins at `first`.
   subroutine move(self, name, first, extents, values, is_written)
      class(hdf5_group), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: first(:)
      integer(hsize_t), intent(in) :: extents(:)
      type(c_ptr), value :: values
      logical, intent(in) :: is_written   !! else read
      integer(hid_t) :: dataset, part, memory
      integer :: status

      if (allocated(self%error) .or. any(extents <= 0)) return
      call h5dopen_f(self%file%id, self%path_of(name), dataset, status)
      call h5dget_space_f(dataset, part, status)
      call h5screate_simple_f(size(extents), extents, memory, status)
      if (size(extents) > 0) call h5sselect_hyperslab_f(part, H5S_SELECT_SET_F, &
                                                        int(first, hsize_t) - 1, extents, status)
      if (is_written) then
         call h5dwrite_f(dataset, H5T_NATIVE_DOUBLE, values, status, memory, part)
      else
         call h5dread_f(dataset, H5T_NATIVE_DOUBLE, values, status, memory, part)
      end if
      call h5sclose_f(memory, status)
      call h5sclose_f(part, status)
      call h5dclose_f(dataset, status)
      call self%keep_failure(self%path_of(name), &
                             ': cannot be '//trim(merge('written', 'read   ', is_written)))
   end subroutine move

end module io_hdf5_datasets
