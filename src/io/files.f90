!> Files and folders: exist, list, make, remove, rename, sync. Errors end with the system's reason.
module io_files
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_int, c_loc, c_long, &
                                                            c_null_char, c_null_ptr, c_ptr, c_size_t
   use core_error, only: error_type
   use core_kinds, only: long
   use core_source, only: is_folder
   use core_system, only: c_fopen, c_readlink, raise_system, system_error, text_at
   use core_terminal, only: is_terminal, standard_output, write_all
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: c_fclose, c_fileno
   public :: exists, file_size, folder_of, host_name, is_readable, process_id, shows_on_terminal
   public :: follow_links, list_files, make_folder, remove_file, rename_file, sync_file, &
             unfinished_name, write_new_file

   character(*), parameter, public :: unfinished = '.part-'   !! mark in names of unfinished files

   interface
      function c_mkdir(path, mode) result(status) bind(c, name='mkdir')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: mode
         integer(c_int) :: status
      end function c_mkdir

      function c_remove(path) result(status) bind(c, name='remove')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int) :: status
      end function c_remove

      function c_rename(from, to) result(status) bind(c, name='rename')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*)
         integer(c_int) :: status
      end function c_rename

      function c_fclose(stream) result(status) bind(c, name='fclose')
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
         integer(c_int) :: status
      end function c_fclose

      function c_fileno(stream) result(descriptor) bind(c, name='fileno')
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
         integer(c_int) :: descriptor
      end function c_fileno

      function c_fsync(descriptor) result(status) bind(c, name='fsync')
         import :: c_int
         integer(c_int), value :: descriptor
         integer(c_int) :: status
      end function c_fsync

      function c_glob(pattern, flags, on_error, found) result(status) bind(c, name='glob')
         import :: c_char, c_int, c_long, c_ptr
         character(kind=c_char), intent(in) :: pattern(*)
         integer(c_int), value :: flags
         type(c_ptr), value :: on_error
         integer(c_long), intent(inout) :: found(*)   !! glob_t: count, list, words of libc's own
         integer(c_int) :: status
      end function c_glob

      subroutine c_globfree(found) bind(c, name='globfree')
         import :: c_long
         integer(c_long), intent(inout) :: found(*)
      end subroutine c_globfree

      function c_getpid() result(number) bind(c, name='getpid')
         import :: c_int
         integer(c_int) :: number
      end function c_getpid

      function c_getppid() result(number) bind(c, name='getppid')
         import :: c_int
         integer(c_int) :: number
      end function c_getppid

      function c_gethostname(name, length) result(status) bind(c, name='gethostname')
         import :: c_char, c_int, c_size_t
         character(kind=c_char), intent(out) :: name(*)
         integer(c_size_t), value :: length
         integer(c_int) :: status
      end function c_gethostname
   end interface

contains

   !> True if there is a file or folder of this name.
   logical function exists(path)
      character(*), intent(in) :: path

      inquire (file=path, exist=exists)
   end function exists

   !> True if this process may read the file of this name.
   logical function is_readable(path)
      character(*), intent(in) :: path
      character(7) :: answer

      inquire (file=path, read=answer)
      is_readable = answer /= 'NO'
   end function is_readable

   !> Size of a file [byte]; -1 if there is no such file.
   integer(long) function file_size(path) result(bytes)
      character(*), intent(in) :: path

      inquire (file=path, size=bytes)
   end function file_size

   !> Folder of a path; '.' for a bare name.
   pure function folder_of(path) result(folder)
      character(*), intent(in) :: path
      character(:), allocatable :: folder
      integer :: slash

      slash = index(path, '/', back=.true.)
      select case (slash)
      case (0)
         folder = '.'
      case (1)
         folder = '/'
      case default
         folder = path(:slash - 1)
      end select
   end function folder_of

   !> Replaces a path that is a symbolic link by its target, which need not exist.
   subroutine follow_links(path, error)
      character(:), allocatable, intent(inout) :: path
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_links = 40, longest = 4096   !! limits of Linux
      integer(c_int), parameter :: eloop = 40
      character(kind=c_char), target :: buffer(longest + 1)
      character(:), allocatable :: target
      integer :: i

      do i = 1, max_links
         buffer = c_null_char
         if (c_readlink(path//c_null_char, buffer, int(longest, c_size_t)) < 0) return
         target = text_at(c_loc(buffer))
         if (index(target, '/') /= 1 .and. index(path, '/') > 0) &
            target = path(:index(path, '/', back=.true.))//target
         call move_alloc(target, path)
      end do
      call raise_system(eloop, path//': leads nowhere', error)
   end subroutine follow_links

   !> Temporary name of a file that this process writes; no other process uses the same.
   function unfinished_name(path) result(name)
      character(*), intent(in) :: path   !! final name of the file
      character(:), allocatable :: name

      name = path//unfinished//host_name()//'-'//to_text(process_id())
   end function unfinished_name

   !> Makes a folder, and those above it, if they are missing.
   recursive subroutine make_folder(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: mode = int(o'777', c_int)   !! less the user's umask
      integer(c_int) :: number

      if (is_folder(path)) return
      if (.not. exists(folder_of(path))) then
         call make_folder(folder_of(path), error)
         if (allocated(error)) return
      end if
      if (c_mkdir(path//c_null_char, mode) == 0) return
      number = system_error()
      if (.not. is_folder(path)) call raise_system(number, path//': cannot make this folder', error)
   end subroutine make_folder

   !> Removes a file or an empty folder, if there is one.
   subroutine remove_file(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: enoent = 2
      integer(c_int) :: number

      if (c_remove(path//c_null_char) == 0) return
      number = system_error()
      if (number /= enoent) call raise_system(number, path//': cannot be removed', error)
   end subroutine remove_file

   !> Writes a text to a new file, whole or not at all.
   subroutine write_new_file(path, text, error)
      character(*), intent(in) :: path, text
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: ignored
      type(c_ptr) :: stream
      integer(c_int) :: closed, number

      stream = c_fopen(path//c_null_char, 'wx'//c_null_char)
      if (.not. c_associated(stream)) then
         call raise_system(system_error(), path//': cannot be written', error)
         return
      end if
      call write_all(c_fileno(stream), text, number)
      closed = c_fclose(stream)
      if (number == 0) then
         call sync_file(path, error)
      else
         call raise_system(number, path//': cannot be written to its end', error)
         call remove_file(path, ignored)
      end if
   end subroutine write_new_file

   !> Renames a file; a file `to` is replaced in one step.
   subroutine rename_file(from, to, error)
      character(*), intent(in) :: from, to
      type(error_type), allocatable, intent(out) :: error

      if (c_rename(from//c_null_char, to//c_null_char) /= 0) &
         call raise_system(system_error(), to//': cannot be made from '//from, error)
   end subroutine rename_file

   !> Waits until the contents of a file, or the names in a folder, are on the disk.
   subroutine sync_file(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error
      type(c_ptr) :: stream
      integer(c_int) :: closed

      stream = c_fopen(path//c_null_char, 'r'//c_null_char)
      if (.not. c_associated(stream)) then
         call raise_system(system_error(), path//': cannot be opened to be synced', error)
         return
      end if
      if (c_fsync(c_fileno(stream)) /= 0) &
         call raise_system(system_error(), path//': cannot be brought to the disk', error)
      closed = c_fclose(stream)
   end subroutine sync_file

   !> Lists the paths that begin with `prefix` and have `part` in the rest, sorted, without hidden
   !> files; none if there is no such folder.
   subroutine list_files(prefix, part, paths, error)
      character(*), intent(in) :: prefix, part   !! 'folder/' and '' for all files of a folder
      character(:), allocatable, intent(out) :: paths(:)   !! padded with blanks
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: fail_when_unreadable = 1, no_match = 3, enoent = 2
      integer(c_long) :: found(16)   ! glob_t has 9 words
      character(:), allocatable :: pattern
      type(c_ptr) :: list
      type(c_ptr), pointer :: names(:)
      integer(c_int) :: number, status
      integer :: i

      found = 0
      pattern = ''
      do i = 1, len(prefix)   ! glob takes it as it is: its wildcards are escaped
         if (scan(prefix(i:i), '*?[]\') > 0) pattern = pattern//'\'
         pattern = pattern//prefix(i:i)
      end do
      status = c_glob(pattern//'*'//part//'*'//c_null_char, fail_when_unreadable, &
                      c_null_ptr, found)
      if (status /= 0) then
         number = system_error()
         allocate (character(0) :: paths(0))
         if (status /= no_match .and. number /= enoent) &
            call raise_system(number, folder_of(prefix)//': cannot list this folder', error)
         return
      end if
      list = transfer(found(2), list)
      call c_f_pointer(list, names, [found(1)])
      allocate (character(maxval([(len(text_at(names(i))), i=1, &
                                   size(names))])) :: paths(size(names)))
      do i = 1, size(names)
         paths(i) = text_at(names(i))
      end do
      call c_globfree(found)
   end subroutine list_files

   !> Number of this process.
   integer function process_id() result(number)

      number = int(c_getpid())
   end function process_id

   !> Name of this machine.
   function host_name() result(name)
      character(:), allocatable :: name
      character(kind=c_char), target :: buffer(256)

      buffer = c_null_char
      if (c_gethostname(buffer, size(buffer, kind=c_size_t) - 1) /= 0) buffer(1) = '?'
      name = text_at(c_loc(buffer))
   end function host_name

   !> True if standard output goes to a terminal. mpirun gives every rank a terminal of its own and
   !> copies it to mpirun's standard output: then that one counts.
   logical function shows_on_terminal()
      type(c_ptr) :: stream
      integer(c_int) :: closed
      integer :: status

      shows_on_terminal = is_terminal(standard_output)
      call get_environment_variable('OMPI_COMM_WORLD_SIZE', status=status)
      if (status /= 0 .or. .not. shows_on_terminal) return
      stream = c_fopen('/proc/'//to_text(int(c_getppid()))//'/fd/1'//c_null_char, 'r'//c_null_char)
      shows_on_terminal = c_associated(stream)
      if (.not. shows_on_terminal) return
      shows_on_terminal = is_terminal(c_fileno(stream))
      closed = c_fclose(stream)
   end function shows_on_terminal

end module io_files
