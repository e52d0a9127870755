!> Groups and datasets as objects of a file, and their attributes: numbers, logicals as 0 and 1,
!> texts as UTF-8.
!>
!> Texts have variable length, which h5py reads as str. HDF5 keeps those in a heap without a
!> checksum and may crash on a damaged one. So texts that the program itself reads back have a fixed
!> length: they lie in the header of their object, whose checksum shows damage.
module io_hdf5_attributes
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_loc, c_null_char, c_null_ptr, &
                                                                             c_ptr
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_system, only: text_at
   use hdf5
   use io_hdf5_file, only: conclude, forget_failure, hdf5_file, note_failure
   implicit none(type, external)
   private
   public :: hdf5_object

   !> Group or dataset of a file. It keeps the first error, until `take_error`; further calls then
   !> do nothing.
   type :: hdf5_object
      type(hdf5_file) :: file
      character(:), allocatable :: path
      type(error_type), allocatable :: error
      logical :: has_fixed_texts = .false.   !! texts are written with fixed length
   contains
      generic :: read => read_text, read_integer, read_real
      procedure :: path_of
      procedure :: has
      procedure :: change_to
      procedure :: attribute
      procedure :: has_attribute
      procedure :: take_error
      procedure :: keep_failure
      procedure, private :: read_text, read_integer, read_real
      procedure, private :: write_text, write_value, read_value, text_length
   end type hdf5_object

contains

   !> Moves the first error out of the object.
   subroutine take_error(self, error)
      class(hdf5_object), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error

      if (allocated(self%error)) call move_alloc(self%error, error)
   end subroutine take_error

   !> Changes to another group of the file, created if it is missing.
   subroutine change_to(self, path)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: path

      self%path = path
      if (.not. allocated(self%error)) call self%file%make_group(path, self%error)
   end subroutine change_to

   !> Path of a member of the group.
   pure function path_of(self, name) result(path)
      class(hdf5_object), intent(in) :: self
      character(*), intent(in) :: name
      character(:), allocatable :: path

      path = self%path//'/'//name
      if (self%path == '/') path = '/'//name
   end function path_of

   !> True if there is a member of this name.
   logical function has(self, name)
      class(hdf5_object), intent(in) :: self
      character(*), intent(in) :: name

      has = self%file%has(self%path_of(name))
   end function has

   !> Keeps an error if one of the last calls of HDF5 has failed, unless there is one.
   subroutine keep_failure(self, subject, failure)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: subject, failure   !! such as '/row' and ': cannot be read'

      if (allocated(self%error)) then
         call forget_failure()
      else
         call conclude(self%file%path//': '//subject//failure, self%error)
      end if
   end subroutine keep_failure

   !> True if there is an attribute of this name. True also if the file is damaged there: reading
   !> then raises an error.
   logical function has_attribute(self, name)
      class(hdf5_object), intent(in) :: self
      character(*), intent(in) :: name
      integer :: status

      call h5aexists_by_name_f(self%file%id, self%path, name, has_attribute, status)
      has_attribute = has_attribute .or. status < 0
      call forget_failure()
   end function has_attribute

   !> Writes an attribute: a number, a logical or a text.
   subroutine attribute(self, name, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      class(*), intent(in), target :: value
      integer, target :: flag

      if (allocated(self%error)) return
      select type (value)
      type is (character(*))
         call self%write_text(name, value)
      type is (logical)
         flag = merge(1, 0, value)
         call self%write_value(name, H5T_NATIVE_INTEGER, c_loc(flag))
      type is (integer)
         call self%write_value(name, H5T_NATIVE_INTEGER, c_loc(value))
      type is (integer(long))
         call self%write_value(name, h5kind_to_type(long, H5_INTEGER_KIND), c_loc(value))
      type is (real(wp))
         call self%write_value(name, H5T_NATIVE_DOUBLE, c_loc(value))
      class default
         error stop 'attribute: a value of another type'
      end select
   end subroutine attribute

   !> Writes a text of fixed or variable length. HDF5 has no text of fixed length 0: a blank stands
   !> for it.
   subroutine write_text(self, name, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name, value
      character(kind=c_char), allocatable, target :: characters(:)
      type(c_ptr), target :: location
      integer(hid_t) :: kind
      integer :: status

      if (self%has_fixed_texts) then
         characters = transfer(value//repeat(' ', merge(1, 0, len(value) == 0)), [c_char_'x'])
         call new_text_kind(kind, size(characters))
         call self%write_value(name, kind, c_loc(characters))
      else
         characters = transfer(value//c_null_char, [c_char_'x'])
         location = c_loc(characters)
         call new_text_kind(kind)
         call self%write_value(name, kind, c_loc(location))
      end if
      call h5tclose_f(kind, status)
   end subroutine write_text

   !> Creates an attribute of an HDF5 type and writes its value.
   subroutine write_value(self, name, kind, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      integer(hid_t), intent(in) :: kind
      type(c_ptr), intent(in) :: value
      integer(hid_t) :: attribute, space
      integer :: status

      call h5screate_f(H5S_SCALAR_F, space, status)
      call h5acreate_by_name_f(self%file%id, self%path, name, kind, space, attribute, status)
      call h5awrite_f(attribute, kind, value, status)
      call h5aclose_f(attribute, status)
      call h5sclose_f(space, status)
      call self%keep_failure('attribute '//name//' of '//self%path, ': cannot be written')
   end subroutine write_value

   !> Reads a text of fixed or variable length.
   subroutine read_text(self, name, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      character(:), allocatable, intent(out), target :: value
      type(c_ptr), target :: location
      type(c_ptr) :: address
      integer(hid_t) :: kind, space
      integer :: length, status

      value = ''
      if (allocated(self%error)) return
      length = self%text_length(name)
      if (length > 0) then
         value = repeat(' ', length)
         call new_text_kind(kind, length)
         call self%read_value(name, kind, c_loc(value))
         value = trim(value)
      else
         location = c_null_ptr
         call new_text_kind(kind)
         call self%read_value(name, kind, c_loc(location))
         if (c_associated(location)) value = text_at(location)
         call h5screate_f(H5S_SCALAR_F, space, status)
         address = c_loc(location)
         call h5dvlen_reclaim_f(kind, space, H5P_DEFAULT_F, address, status)
         call h5sclose_f(space, status)
      end if
      call h5tclose_f(kind, status)
   end subroutine read_text

   !> Length of a text of fixed length [byte]; 0 for one of variable length.
   integer function text_length(self, name)
      class(hdf5_object), intent(in) :: self
      character(*), intent(in) :: name
      integer(hid_t) :: attribute, kind
      integer(size_t) :: length
      logical :: is_variable
      integer :: status

      length = 0
      is_variable = .true.
      call h5aopen_by_name_f(self%file%id, self%path, name, attribute, status)
      call h5aget_type_f(attribute, kind, status)
      call h5tis_variable_str_f(kind, is_variable, status)
      if (status >= 0 .and. .not. is_variable) call h5tget_size_f(kind, length, status)
      call h5tclose_f(kind, status)
      call h5aclose_f(attribute, status)
      text_length = int(length)
   end function text_length

   subroutine read_integer(self, name, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(inout), target :: value

      if (.not. allocated(self%error)) call self%read_value(name, H5T_NATIVE_INTEGER, c_loc(value))
   end subroutine read_integer

   subroutine read_real(self, name, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(inout), target :: value

      if (.not. allocated(self%error)) call self%read_value(name, H5T_NATIVE_DOUBLE, c_loc(value))
   end subroutine read_real

   !> Reads an attribute of one value; refuses an array, for which `value` has no memory.
   subroutine read_value(self, name, kind, value)
      class(hdf5_object), intent(inout) :: self
      character(*), intent(in) :: name
      integer(hid_t), intent(in) :: kind
      type(c_ptr), value :: value
      integer(hid_t) :: attribute, space
      integer(hsize_t) :: n_values
      integer :: status

      call h5aopen_by_name_f(self%file%id, self%path, name, attribute, status)
      call h5aget_space_f(attribute, space, status)
      n_values = 0
      call h5sget_simple_extent_npoints_f(space, n_values, status)
      if (n_values == 1) then
         call h5aread_f(attribute, kind, value, status)
      else
         call note_failure('it is not one value')
      end if
      call h5sclose_f(space, status)
      call h5aclose_f(attribute, status)
      call self%keep_failure('attribute '//name//' of '//self%path, ': cannot be read')
   end subroutine read_value

   !> Creates the HDF5 type of UTF-8 text of a fixed length, or of variable length.
   subroutine new_text_kind(kind, length)
      integer(hid_t), intent(out) :: kind
      integer, intent(in), optional :: length   !! bytes
      integer :: status

      if (present(length)) then
         call h5tcopy_f(H5T_FORTRAN_S1, kind, status)
         call h5tset_size_f(kind, int(length, size_t), status)
      else
         call h5tcopy_f(H5T_STRING, kind, status)
         call h5tset_strpad_f(kind, H5T_STR_NULLTERM_F, status)
      end if
      call h5tset_cset_f(kind, H5T_CSET_UTF8_F, status)
   end subroutine new_text_kind

end module io_hdf5_attributes
