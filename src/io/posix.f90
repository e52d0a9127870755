!> Calls of POSIX for files, folders and locks, as libc declares them.
module io_posix
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_ptr, c_size_t
   implicit none(type, external)
   private
   public :: c_fclose, c_fileno, c_fsync, c_gethostname, c_getpid, c_getppid, c_glob, &
             c_globfree, c_link, c_lockf, c_lseek, c_mkdir, c_pread, c_remove, c_rename, c_stat

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

      function c_link(from, to) result(status) bind(c, name='link')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*)
         integer(c_int) :: status
      end function c_link

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

      function c_lseek(descriptor, offset, whence) result(place) bind(c, name='lseek')
         import :: c_int, c_long
         integer(c_int), value :: descriptor, whence
         integer(c_long), value :: offset
         integer(c_long) :: place
      end function c_lseek

      !> Reads at most `most` bytes from byte `offset` of a file; the descriptor's position stays.
      function c_pread(descriptor, text, most, offset) result(length) bind(c, name='pread')
         import :: c_char, c_int, c_long, c_size_t
         integer(c_int), value :: descriptor
         character(kind=c_char), intent(out) :: text(*)
         integer(c_size_t), value :: most
         integer(c_long), value :: offset
         integer(c_long) :: length
      end function c_pread

      !> Locks or unlocks `length` bytes from the descriptor's position on; 0: all bytes from there.
      function c_lockf(descriptor, command, length) result(status) bind(c, name='lockf')
         import :: c_int, c_long
         integer(c_int), value :: descriptor, command
         integer(c_long), value :: length
         integer(c_int) :: status
      end function c_lockf

      function c_stat(path, words) result(status) bind(c, name='stat')
         import :: c_char, c_int, c_long
         character(kind=c_char), intent(in) :: path(*)
         integer(c_long), intent(out) :: words(*)   !! struct stat: device, inode and others
         integer(c_int) :: status
      end function c_stat
   end interface

end module io_posix
