!> Lock on an output: one run alone may write it, or several that share its work.
!>
!> Locks are advisory (lockf) on a file `<output>.lock`. The system releases them when a run dies;
!> they hold between machines if the file system's locks do. A run alone locks the whole file. Runs
!> that share the work each lock one byte of it to show their presence, and one more for each block
!> that they march.
!>
!> A lock can be lost: its file is removed, or the file system grants it twice. So a run alone
!> checks its lock before it changes a file that others may need: the path must lead to the file
!> that it locked, the name in the file must be its own (the last run writes its name), and the
!> output must be as the run found or left it. A run that has lost its lock changes no more files.
module io_lock
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_int, c_long, c_null_char, &
                                                                         c_null_ptr, c_ptr, c_size_t
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long
   use core_system, only: c_fopen, raise_system, system_error
   use core_terminal, only: write_all
   use core_text, only: line_feed, to_text
   use io_files, only: c_fclose, c_fileno, exists, folder_of, host_name, make_folder, process_id, &
                       remove_file, rename_file, unfinished_name
   implicit none(type, external)
   private
   public :: lock_type, take_lock

   integer(c_int), parameter :: unlock = 0, try_to_lock = 2     !! commands of lockf(3)
   integer(c_long), parameter :: whole_file = 0, one_byte = 1   !! lengths of lockf(3)
   !> Number of bytes that show the presence of runs; the bytes of blocks follow them.
   integer(c_long), parameter :: n_presence_bytes = 2_c_long**20
   integer, parameter :: n_stat_words = 64   !! words (8 bytes) of a buffer for struct stat: 18
   !> Words of struct stat: device, inode, size and time of the last change.
   integer, parameter :: stamp_words(*) = [1, 2, 7, 12, 13]

   !> Lock of a run, held from `take_lock` to `release` or to the end of the process.
   type :: lock_type
      private
      character(:), allocatable, public :: output   !! path of the locked output
      character(:), allocatable :: path             !! path of the lock file
      character(:), allocatable :: name             !! this run's name in it; '' on a full disk
      type(c_ptr) :: stream = c_null_ptr            !! open lock file
      character(:), allocatable :: new_folder       !! folder that was made for the output
      logical :: is_shared = .false.
      !> device, inode, size and time of the output as it was found or left; zeros: no file
      integer(c_long) :: stamp(size(stamp_words)) = 0
   contains
      procedure :: is_held
      procedure :: check_ownership
      procedure :: publish
      procedure :: claim
      procedure :: release_claim
      procedure :: release
   end type lock_type

   interface
      function c_link(from, to) result(status) bind(c, name='link')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: from(*), to(*)
         integer(c_int) :: status
      end function c_link

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

contains

   !> Locks an output for this run alone, or for the runs that share it. The error names the run
   !> that holds a lock against this. Makes the folder of the output if it is missing.
   subroutine take_lock(output, lock, error, is_shared)
      character(*), intent(in) :: output
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_shared

      lock%output = output
      lock%path = output//'.lock'
      if (present(is_shared)) lock%is_shared = is_shared
      call check_length(output, error)
      if (.not. exists(folder_of(output))) lock%new_folder = folder_of(output)
      if (.not. allocated(error)) call make_folder(folder_of(output), error)
      if (.not. allocated(error)) call acquire(lock, error)
      if (.not. allocated(error)) lock%stamp = stamp_of(output)
   end subroutine take_lock

   !> Refuses an output whose temporary name is too long for a file system, before any work.
   subroutine check_length(output, error)
      character(*), intent(in) :: output
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: longest_name = 255        ! bytes; of Linux
      integer(c_int), parameter :: enametoolong = 36  ! Linux
      character(:), allocatable :: path

      path = unfinished_name(output)
      if (len(path) - index(path, '/', back=.true.) > longest_name) &
         call raise_system(enametoolong, path//': cannot be made', error)
   end subroutine check_length

   !> Opens and locks the lock file and writes this run's name into it, as 'process 123 on host';
   !> on a full disk the name stays empty.
   recursive subroutine acquire(lock, error)
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable, intent(out) :: error
      integer(c_long), parameter :: n_tries = 64   ! presence bytes that are tried
      integer(c_long) :: i
      integer(c_int) :: number
      logical :: is_locked

      lock%stream = c_fopen(lock%path//c_null_char, 'r+'//c_null_char)
      if (.not. c_associated(lock%stream)) &
         lock%stream = c_fopen(lock%path//c_null_char, 'a+'//c_null_char)
      if (.not. c_associated(lock%stream)) then
         call raise_system(system_error(), lock%path//': cannot make this lock file', error)
         return
      end if
      if (lock%is_shared) then
         do i = 1, n_tries
            is_locked = lockf_succeeds(lock, try_to_lock, modulo(process_id()*n_tries + i, &
                                                                 n_presence_bytes), one_byte)
            if (is_locked) exit
         end do
      else
         is_locked = lockf_succeeds(lock, try_to_lock, 0_c_long, whole_file)
      end if
      if (.not. is_locked) then
         call refuse(lock, system_error(), error)
      else if (.not. is_same_file(lock)) then
         ! the holder removed the file after it was opened here and before it was locked
         call close_lock(lock)
         call acquire(lock, error)
      else
         lock%name = ''
         if (.not. seek_succeeds(lock, 0_c_long)) return
         lock%name = 'process '//to_text(process_id())//' on '//host_name()
         call write_all(c_fileno(lock%stream), lock%name//line_feed, number)
         if (number /= 0) lock%name = ''
      end if
   end subroutine acquire

   !> True between `take_lock` and `release`.
   pure logical function is_held(self)
      class(lock_type), intent(in) :: self

      is_held = c_associated(self%stream)
   end function is_held

   !> Checks that the lock still is this run's and that the output is as it was found or left. The
   !> error names the run that has the lock now. A lock file that was removed is made again, unless
   !> another run has done so. A lock that is not held raises no error.
   subroutine check_ownership(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      integer(c_long) :: now(size(stamp_words))

      if (.not. self%is_held()) return
      if (.not. exists(self%path)) then
         call close_lock(self)
         call acquire(self, error)
         if (allocated(error)) return
      else if (.not. is_ours(self)) then
         call raise(error, exit_file, self%path//' was taken by '//holder_of(self%path)// &
                    ': another run is at work on this output, and this one ends. What is '// &
                    'finished is safe; start again when the other has ended')
         return
      end if
      now = stamp_of(self%output)
      if (any(now /= 0) .and. any(now /= self%stamp)) call refuse_change(self, error)
   end subroutine check_ownership

   !> Renames a finished file to the output. Replaces the file that was there when the lock was
   !> taken, and no other.
   subroutine publish(self, temporary, error)
      class(lock_type), intent(inout) :: self
      character(*), intent(in) :: temporary
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: eexist = 17   !! Linux

      call self%check_ownership(error)
      if (allocated(error)) return
      if (exists(self%output)) then
         call rename_file(temporary, self%output, error)
      else if (c_link(temporary//c_null_char, self%output//c_null_char) == 0) then
         call remove_file(temporary, error)
      else if (system_error() == eexist) then   ! another run has just written the output
         call refuse_change(self, error)
      else   ! the file system has no links
         call rename_file(temporary, self%output, error)
      end if
      if (.not. allocated(error)) self%stamp = stamp_of(self%output)
   end subroutine publish

   !> Raises the error of an output that another run has written.
   subroutine refuse_change(self, error)
      class(lock_type), intent(in) :: self
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, self%output//' was written by another run while this one '// &
                 'was at work, and stays as it is: start again to see what it lacks')
   end subroutine refuse_change

   !> True if no other process that shares the lock has claimed a block: it is now this process's.
   logical function claim(self, number) result(is_ours)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number   !! number of the block, from 0

      is_ours = lockf_succeeds(self, try_to_lock, n_presence_bytes + int(number, c_long), one_byte)
   end function claim

   !> Releases a claimed block that is finished or left to other runs.
   subroutine release_claim(self, number)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number
      logical :: ignored

      ignored = lockf_succeeds(self, unlock, n_presence_bytes + int(number, c_long), one_byte)
   end subroutine release_claim

   !> Releases the lock. A run alone first removes the file, while it is still locked. A folder that
   !> was made for the output goes if it is empty.
   subroutine release(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: ignored

      if (.not. self%is_held()) return
      if (is_ours(self) .and. .not. self%is_shared) call remove_file(self%path, error)
      call close_lock(self)
      if (allocated(self%new_folder)) call remove_file(self%new_folder, ignored)
   end subroutine release

   subroutine close_lock(lock)
      type(lock_type), intent(inout) :: lock
      integer(c_int) :: status

      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
   end subroutine close_lock

   !> Raises an error with the holder's name, or with the system's reason if it has no locks at all.
   subroutine refuse(lock, number, error)
      type(lock_type), intent(inout) :: lock
      integer(c_int), intent(in) :: number   !! number of the system's error
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: eagain = 11, eacces = 13   !! Linux: another process has the lock

      if (number == eagain .or. number == eacces) then
         call raise(error, exit_file, lock%path//' is locked by '//holder_of(lock%path)// &
                    ': another run is at work on this output')
      else
         call raise_system(number, lock%path//': cannot be locked', error)
      end if
      call close_lock(lock)
   end subroutine refuse

   !> True if bytes of the file could be locked or unlocked.
   logical function lockf_succeeds(lock, command, first, length)
      type(lock_type), intent(in) :: lock
      integer(c_int), intent(in) :: command
      integer(c_long), intent(in) :: first, length   !! bytes

      lockf_succeeds = seek_succeeds(lock, first)
      if (lockf_succeeds) lockf_succeeds = c_lockf(c_fileno(lock%stream), command, length) == 0
   end function lockf_succeeds

   !> True if the byte at which lockf and write begin could be set.
   logical function seek_succeeds(lock, byte)
      type(lock_type), intent(in) :: lock
      integer(c_long), intent(in) :: byte   !! counted from 0
      integer(c_int), parameter :: from_the_start = 0

      seek_succeeds = c_lseek(c_fileno(lock%stream), byte, from_the_start) == byte
   end function seek_succeeds

   !> True if the path leads to the file that was locked, with this run's name in it, or with any
   !> name if runs share it.
   logical function is_ours(lock)
      type(lock_type), intent(in) :: lock
      character(kind=c_char) :: found(len(lock%name) + 1)
      integer(c_long) :: n
      integer :: i

      is_ours = is_same_file(lock)
      if (lock%is_shared .or. lock%name == '' .or. .not. is_ours) return
      ! by the stream that has the lock, because closing another one would release it
      n = c_pread(c_fileno(lock%stream), found, size(found, kind=c_size_t), 0_c_long)
      is_ours = n == size(found)
      if (is_ours) is_ours = all(found == [(lock%name(i:i), i=1, len(lock%name)), line_feed])
   end function is_ours

   !> True if the path still leads to the file that was opened.
   logical function is_same_file(lock)
      type(lock_type), intent(in) :: lock
      integer(c_long), dimension(size(stamp_words)) :: named, opened

      named = stamp_of(lock%path)
      opened = stamp_of('/proc/self/fd/'//to_text(int(c_fileno(lock%stream))))
      is_same_file = all(named(:2) == opened(:2)) .and. any(opened /= 0)
   end function is_same_file

   !> Device, inode, size and time of a file, which show that it is unchanged; zeros: no file.
   function stamp_of(path) result(stamp)
      character(*), intent(in) :: path
      integer(c_long) :: stamp(size(stamp_words))
      integer(c_long) :: words(n_stat_words)

      stamp = 0
      if (c_stat(path//c_null_char, words) == 0) stamp = words(stamp_words)
   end function stamp_of

   !> Name of the run that holds a lock, as its lock file has it.
   function holder_of(path) result(holder)
      character(*), intent(in) :: path
      character(:), allocatable :: holder
      character(320) :: line
      integer :: status, unit

      line = ''
      open (newunit=unit, file=path, action='read', iostat=status)
      if (status == 0) read (unit, '(a)', iostat=status) line
      if (status == 0) close (unit)
      holder = trim(line)
      if (holder == '') holder = 'another process'
   end function holder_of

end module io_lock
