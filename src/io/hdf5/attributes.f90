!> Attributes of groups and datasets: texts as UTF-8, logicals as 0 and 1.
!>
!> Texts are of variable length, as Python likes them best. HDF5 keeps those in a heap without
!> checksum, and may crash on a damaged one: what must be read from files of unknown health is
!> written with write_sealed_attribute, of fixed length, which lies under the checksum of its
!> object.
module io_hdf5_attributes
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_loc, c_null_char, c_null_ptr, &
                                                                             c_ptr
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use core_system, only: text_at
   use hdf5
   use io_hdf5_file, only: hdf5_file
   use io_hdf5_outcome, only: conclude, forget_failure, note_failure
   implicit none(type, external)
   private
   public :: has_attribute, read_attribute, write_attribute, write_sealed_attribute

   !> A number, a logical as 0 or 1, or a text.
   interface read_attribute
      module procedure read_text, read_integer, read_real
   end interface read_attribute

contains

   !> True if an object has an attribute of this name.
   function has_attribute(file, object, name)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      logical :: has_attribute
      integer :: status

      call h5aexists_by_name_f(file%id, object, name, has_attribute, status)
      has_attribute = has_attribute .and. status >= 0
      call forget_failure()
   end function has_attribute

   !> Writes a number, a logical or a text; the object is a group or dataset, '/' the file itself.
   subroutine write_attribute(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      class(*), intent(in), target :: value
      type(error_type), allocatable, intent(out) :: error
      integer, target :: flag

      select type (value)
      type is (character(*))
         call write_text(file, object, name, value, error)
         return
      type is (logical)
         flag = merge(1, 0, value)
         call write_value(file, object, name, H5T_NATIVE_INTEGER, c_loc(flag))
      type is (integer)
         call write_value(file, object, name, H5T_NATIVE_INTEGER, c_loc(value))
      type is (integer(long))
         call write_value(file, object, name, h5kind_to_type(long, H5_INTEGER_KIND), c_loc(value))
      type is (real(wp))
         call write_value(file, object, name, H5T_NATIVE_DOUBLE, c_loc(value))
      class default
         error stop 'write_attribute: no kind of value that it knows'
      end select
      call conclude(attribute_of(file, object, name)//': cannot be written', error)
   end subroutine write_attribute

   subroutine write_text(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name, value
      type(error_type), allocatable, intent(out) :: error
      character(kind=c_char), allocatable, target :: characters(:)
      type(c_ptr), target :: location
      integer(hid_t) :: kind
      integer :: status

      characters = transfer(value//c_null_char, [c_char_'x'])
      location = c_loc(characters)
      call new_text_kind(kind)
      call write_value(file, object, name, kind, c_loc(location))
      call h5tclose_f(kind, status)
      call conclude(attribute_of(file, object, name)//': cannot be written', error)
   end subroutine write_text

   !> Writes a text of fixed length. HDF5 keeps it under a checksum, unlike one of variable length,
   !> so a flipped bit is noticed.
   subroutine write_sealed_attribute(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      character(*), intent(in) :: value
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable, target :: text
      integer(hid_t) :: kind
      integer :: status

      text = value
      if (len(text) == 0) text = ' '
      call new_text_kind(kind, len(text))
      call write_value(file, object, name, kind, c_loc(text))
      call h5tclose_f(kind, status)
      call conclude(attribute_of(file, object, name)//': cannot be written', error)
   end subroutine write_sealed_attribute

   subroutine write_value(file, object, name, kind, value)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      integer(hid_t), intent(in) :: kind
      type(c_ptr), intent(in) :: value
      integer(hid_t) :: attribute, space
      integer :: status

      call h5screate_f(H5S_SCALAR_F, space, status)
      call h5acreate_by_name_f(file%id, object, name, kind, space, attribute, status)
      call h5awrite_f(attribute, kind, value, status)
      call h5aclose_f(attribute, status)
      call h5sclose_f(space, status)
   end subroutine write_value

   !> Name of an attribute in messages.
   pure function attribute_of(file, object, name) result(text)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      character(:), allocatable :: text

      text = file%path//': attribute '//name//' of '//object
   end function attribute_of

   subroutine read_text(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      character(:), allocatable, intent(out), target :: value
      type(error_type), allocatable, intent(out) :: error
      type(c_ptr), target :: location
      type(c_ptr) :: address
      integer(hid_t) :: kind, space
      integer(size_t) :: length
      integer :: status

      value = ''
      call find_text_length(file, object, name, length)
      if (length > 0) then
         value = repeat(' ', int(length))
         call new_text_kind(kind, int(length))
         call read_value(file, object, name, kind, c_loc(value))
         value = trim(value)
      else
         location = c_null_ptr
         call new_text_kind(kind)
         call read_value(file, object, name, kind, c_loc(location))
         if (c_associated(location)) value = text_at(location)
         call h5screate_f(H5S_SCALAR_F, space, status)
         address = c_loc(location)
         call h5dvlen_reclaim_f(kind, space, H5P_DEFAULT_F, address, status)
         call h5sclose_f(space, status)
      end if
      call h5tclose_f(kind, status)
      call conclude(attribute_of(file, object, name)//': cannot be read', error)
   end subroutine read_text

   !> Finds the bytes of a text of fixed length; 0 for one of variable length.
   subroutine find_text_length(file, object, name, length)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      integer(size_t), intent(out) :: length
      integer(hid_t) :: attribute, kind
      logical :: is_variable
      integer :: status

      length = 0
      is_variable = .true.
      call h5aopen_by_name_f(file%id, object, name, attribute, status)
      call h5aget_type_f(attribute, kind, status)
      call h5tis_variable_str_f(kind, is_variable, status)
      if (status >= 0 .and. .not. is_variable) call h5tget_size_f(kind, length, status)
      call h5tclose_f(kind, status)
      call h5aclose_f(attribute, status)
   end subroutine find_text_length

   subroutine read_integer(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      integer, intent(out), target :: value
      type(error_type), allocatable, intent(out) :: error

      value = 0
      call read_value(file, object, name, H5T_NATIVE_INTEGER, c_loc(value))
      call conclude(attribute_of(file, object, name)//': cannot be read', error)
   end subroutine read_integer

   subroutine read_real(file, object, name, value, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      real(wp), intent(out), target :: value
      type(error_type), allocatable, intent(out) :: error

      value = 0.0_wp
      call read_value(file, object, name, H5T_NATIVE_DOUBLE, c_loc(value))
      call conclude(attribute_of(file, object, name)//': cannot be read', error)
   end subroutine read_real

   !> Refuses what is not one single value: `value` has room for no more.
   subroutine read_value(file, object, name, kind, value)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: object, name
      integer(hid_t), intent(in) :: kind
      type(c_ptr), value :: value
      integer(hid_t) :: attribute, space
      integer(hsize_t) :: n_values
      integer :: status

      call h5aopen_by_name_f(file%id, object, name, attribute, status)
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
