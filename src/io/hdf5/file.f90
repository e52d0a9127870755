!> HDF5 files: create, open and close them, and list and make their groups.
!>
!> Failures of HDF5 become errors. A handler keeps the reason of the first failed call; after a
!> series of calls `conclude` raises an error with it. So the status of each call need not be
!> checked: after a failure HDF5 itself refuses the calls that depend on the failed one.
module io_hdf5_file
   use, intrinsic :: iso_c_binding, only: c_associated, c_bool, c_funloc, c_funptr, c_int, &
                                          c_int64_t, c_null_ptr, c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_system, only: text_at
   use core_text, only: to_text
   use hdf5
   implicit none(type, external)
   private
   public :: hdf5_file, create_hdf5, hdf5_library, new_timeless_list, open_hdf5
   public :: conclude, forget_failure, note_failure

   !> One open file. After an error it can only be abandoned.
   type :: hdf5_file
      character(:), allocatable :: path
      integer(hid_t) :: id = -1   !! HDF5's identifier, for the rooms of this wing; -1: closed
   contains
      procedure :: close => close_file
      procedure :: abandon
      procedure :: has
      procedure :: is_group
      procedure :: list
      procedure :: make_group
   end type hdf5_file

   !> H5E_error2_t: one entry of HDF5's error stack.
   type, bind(c) :: entry_type
      integer(c_int64_t) :: class, major, minor
      integer(c_int) :: line
      type(c_ptr) :: function_name, file_name, description
   end type entry_type

   interface
      !> Switches HDF5's file locks; missing in the Fortran interface of HDF5 1.10.
      function c_set_file_locking(access, use_locks, ignore_when_disabled) result(status) &
         bind(c, name='H5Pset_file_locking')
         import :: c_bool, c_int, c_int64_t
         integer(c_int64_t), value :: access
         logical(c_bool), value :: use_locks, ignore_when_disabled
         integer(c_int) :: status
      end function c_set_file_locking

      function c_set_auto(stack, report, client) result(status) bind(c, name='H5Eset_auto2')
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         type(c_funptr), value :: report
         type(c_ptr), value :: client
         integer(c_int) :: status
      end function c_set_auto

      function c_walk(stack, direction, visit, client) result(status) bind(c, name='H5Ewalk2')
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         integer(c_int), value :: direction
         type(c_funptr), value :: visit
         type(c_ptr), value :: client
         integer(c_int) :: status
      end function c_walk
   end interface

   logical :: is_started = .false.        !! the HDF5 library is initialized
   character(:), allocatable :: reason   !! reason of the first failure; unallocated: none

contains

   !> Version of the HDF5 library.
   function hdf5_library() result(text)
      character(:), allocatable :: text
      integer :: major, minor, release, status

      call h5get_libversion_f(major, minor, release, status)
      text = to_text(major)//'.'//to_text(minor)//'.'//to_text(release)
   end function hdf5_library

   !> Creates a file and replaces any other of its path.
   subroutine create_hdf5(path, file, error)
      character(*), intent(in) :: path
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: access, root
      integer :: status

      call start_library()
      file%path = path
      call new_access_list(access)
      call new_timeless_list(H5P_FILE_CREATE_F, root)
      call h5fcreate_f(path, H5F_ACC_TRUNC_F, file%id, status, root, access)
      call h5pclose_f(access, status)
      call h5pclose_f(root, status)
      call conclude(path//': cannot be made', error)
   end subroutine create_hdf5

   !> Opens an existing file for reading. An empty one may be a pipe, where opening would wait.
   subroutine open_hdf5(path, file, error)
      character(*), intent(in) :: path
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: access
      integer(c_int64_t) :: n_bytes
      integer :: status

      inquire (file=path, size=n_bytes)
      if (n_bytes == 0) then
         call raise(error, exit_file, path//': cannot be opened as HDF5: it is empty, or a pipe')
         return
      end if
      call start_library()
      file%path = path
      call new_access_list(access)
      call h5fopen_f(path, H5F_ACC_RDONLY_F, file%id, status, access_prp=access)
      call h5pclose_f(access, status)
      call conclude(path//': cannot be opened as HDF5', error)
   end subroutine open_hdf5

   !> Closes the file. It is written only if this succeeds: a full disk may show here first.
   subroutine close_file(self, error)
      class(hdf5_file), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      integer :: status

      if (self%id < 0) return
      call h5fclose_f(self%id, status)
      self%id = -1
      call conclude(self%path//': cannot be written to its end', error)
   end subroutine close_file

   !> Closes a file after an error, or one that was only read, and ignores failures.
   subroutine abandon(self)
      class(hdf5_file), intent(inout) :: self
      type(error_type), allocatable :: error

      call self%close(error)
   end subroutine abandon

   !> True if there is a group or dataset of this path. Groups above it may be missing. True also if
   !> the file is damaged there: reading then raises an error.
   logical function has(self, path)
      class(hdf5_file), intent(in) :: self
      character(*), intent(in) :: path
      integer :: i, status

      has = .true.
      do i = 2, len(path) + 1
         if (i <= len(path)) then
            if (path(i:i) /= '/') cycle
         end if
         call h5lexists_f(self%id, path(:i - 1), has, status)
         if (status < 0) call forget_failure()
         has = has .or. status < 0
         if (.not. has) return
      end do
   end function has

   !> True if the object of this path is a group. A failure of HDF5 stays for the caller: a second
   !> attempt to open a damaged object may succeed.
   logical function is_group(self, path)
      class(hdf5_file), intent(in) :: self
      character(*), intent(in) :: path
      integer(hid_t) :: object
      integer :: kind, status

      call h5oopen_f(self%id, path, object, status)
      call h5iget_type_f(object, kind, status)
      is_group = kind == H5I_GROUP_F
      call h5oclose_f(object, status)
   end function is_group

   !> Lists the names in a group, sorted. HDF5 would sort all of them for each name that it gives.
   subroutine list(self, group, names, error)
      class(hdf5_file), intent(in) :: self
      character(*), intent(in) :: group
      character(:), allocatable, intent(out) :: names(:)   !! padded with blanks
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: longest = 64
      character(longest) :: name
      integer :: i, n, n_before, status

      call h5gn_members_f(self%id, group, n, status)
      if (status < 0) n = 0   ! HDF5 leaves it undefined
      allocate (character(longest) :: names(n))
      do i = 1, size(names)
         name = ''
         call h5lget_name_by_idx_f(self%id, group, H5_INDEX_NAME_F, H5_ITER_NATIVE_F, &
                                   int(i - 1, hsize_t), name, status)
         n_before = count(names(:i - 1) < name)
         names(n_before + 2:i) = names(n_before + 1:i - 1)
         names(n_before + 1) = name
      end do
      call conclude(self%path//': '//group//': cannot be listed', error)
   end subroutine list

   !> Creates a group and the groups above it.
   subroutine make_group(self, path, error)
      class(hdf5_file), intent(in) :: self
      character(*), intent(in) :: path   !! such as /campaign/c001/plain
      type(error_type), allocatable, intent(out) :: error
      integer(hid_t) :: group, properties
      integer :: last, status

      call new_timeless_list(H5P_GROUP_CREATE_F, properties)
      last = 1
      do while (last < len(path))
         last = last + index(path(last + 1:)//'/', '/')   ! next slash, or one after the path
         if (last < len(path)) then
            if (self%has(path(:last - 1))) cycle
         end if
         call h5gcreate_f(self%id, path(:last - 1), group, status, gcpl_id=properties)
         call h5gclose_f(group, status)
      end do
      call h5pclose_f(properties, status)
      call conclude(self%path//': '//path//': cannot be made', error)
   end subroutine make_group

   !> Creates a property list of objects without time stamps, so that the same run writes the same
   !> bytes.
   subroutine new_timeless_list(class, properties)
      integer(hid_t), intent(in) :: class
      integer(hid_t), intent(out) :: properties
      integer :: status

      call h5pcreate_f(class, properties, status)
      call h5pset_obj_track_times_f(properties, .false., status)
   end subroutine new_timeless_list

   !> Creates the access property list: the format of HDF5 1.10, whose metadata have checksums;
   !> closing a file closes all objects in it; no file locks of HDF5's own, which some network file
   !> systems refuse: io_lock locks outputs.
   subroutine new_access_list(access)
      integer(hid_t), intent(out) :: access
      integer :: status

      call h5pcreate_f(H5P_FILE_ACCESS_F, access, status)
      call h5pset_libver_bounds_f(access, H5F_LIBVER_V110_F, H5F_LIBVER_V110_F, status)
      call h5pset_fclose_degree_f(access, H5F_CLOSE_STRONG_F, status)
      status = c_set_file_locking(access, .false._c_bool, .true._c_bool)
   end subroutine new_access_list

   !> Starts the HDF5 library, once in a process; it then calls `report` at each failure instead of
   !> printing.
   subroutine start_library()
      integer(c_int64_t), parameter :: default_stack = 0
      integer :: status

      if (is_started) return
      call h5dont_atexit_f(status)   ! its cleaning up at exit crashes after a full disk
      call h5open_f(status)
      if (status < 0) error stop 'io_hdf5_file: the HDF5 library does not start'
      status = c_set_auto(default_stack, c_funloc(report), c_null_ptr)
      is_started = .true.
   end subroutine start_library

   !> Keeps the reason of the first failure: the system's error message if there is one, else the
   !> description by HDF5's innermost function. HDF5 calls it.
   function report(stack, client) result(status) bind(c)
      integer(c_int64_t), value :: stack
      type(c_ptr), value :: client
      integer(c_int) :: status
      integer(c_int), parameter :: from_inside = 0
      character(*), parameter :: opening = "error message = '"
      integer :: first

      status = 0
      if (allocated(reason)) return
      reason = ''
      status = c_walk(stack, from_inside, c_funloc(visit), client)
      first = index(reason, opening)
      if (first > 0) then
         reason = reason(first + len(opening):)
         reason = reason(:index(reason//"'", "'") - 1)
      end if
      if (reason == '') reason = 'HDF5 gives no reason'
   end function report

   !> Keeps the description by the innermost function. HDF5 calls it for each entry of its stack.
   function visit(depth, entry, client) result(status) bind(c)
      integer(c_int), value :: depth
      type(entry_type), intent(in) :: entry
      type(c_ptr), value :: client
      integer(c_int) :: status

      if (depth == 0 .and. c_associated(entry%description)) reason = text_at(entry%description)
      status = 0
      if (c_associated(client)) status = -1   ! never: no client is set
   end function visit

   !> Keeps the reason of a failure that is not HDF5's.
   subroutine note_failure(text)
      character(*), intent(in) :: text

      if (.not. allocated(reason)) reason = text
   end subroutine note_failure

   !> Forgets a failure that only means that there is no such object.
   subroutine forget_failure()
      if (allocated(reason)) deallocate (reason)
   end subroutine forget_failure

   !> Raises an error if any call has failed since the last `conclude`, and forgets the failure.
   subroutine conclude(message, error)
      character(*), intent(in) :: message
      type(error_type), allocatable, intent(out) :: error

      if (allocated(reason)) call raise(error, exit_file, message//': '//reason)
      call forget_failure()
   end subroutine conclude

end module io_hdf5_file
