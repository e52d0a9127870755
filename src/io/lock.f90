!> Who may write an output: one run alone, or several that share its work. Advisory locks, which the
!> system gives back when a run dies; they hold between machines where the file system's locks do.
!>
!> A run alone locks the whole lock file. Runs that share each hold one byte of it to show that they
!> are there, and one more for each piece of work on its way.
!>
!> A lock can be lost: its file is removed, or the file system grants it twice. So a run that works
!> alone looks at the file again before it changes what others may need: the lock is its own while
!> the file is the one that it locked, the name in it is its own (the last run to come writes it),
!> and the output is as the run found or left it. A run that has lost its lock changes nothing more.
module io_lock
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_int, c_long, c_null_char, &
                                                                         c_null_ptr, c_ptr, c_size_t
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long
   use core_system, only: c_fopen, raise_system, system_error
   use core_terminal, only: write_all
   use core_text, only: to_text
   use io_files, only: exists, folder_of, host_name, make_folder, process_id, remove_file, &
                       rename_file, unfinished_name
   use io_posix, only: c_fclose, c_fileno, c_fstat, c_link, c_lockf, c_lseek, c_pread, c_stat
   implicit none(type, external)
   private
   public :: lock_type, take_lock

   integer(c_int), parameter :: unlock = 0, try_to_lock = 2   !! of lockf(3)
   integer(c_long), parameter :: whole = 0, one_byte = 1
   !> Bytes by which runs that share show that they are there; those of their work lie above.
   integer(c_long), parameter :: n_places = 2_c_long**20
   !> Words of struct stat [8 bytes]: device, inode, size, time of the last change.
   integer, parameter :: place_words(*) = [1, 2], content_words(*) = [1, 2, 7, 12, 13]

   !> Held from `take_lock` to `release`, or to the end of the process.
   type :: lock_type
      private
      character(:), allocatable, public :: output   !! path of what is locked
      integer, public :: n_folders = 0              !! that were missing on its way, and made
      character(:), allocatable :: path             !! of the lock file
      character(:), allocatable :: name             !! of this run, in the file; '' on a full disk
      type(c_ptr) :: stream = c_null_ptr
      logical :: is_shared = .false.
      !> of the output as it was found or left; zeros: none
      integer(c_long) :: content(size(content_words)) = 0
   contains
      procedure :: is_held
      procedure :: keep
      procedure :: publish
      procedure :: claim
      procedure :: give_back
      procedure :: release
   end type lock_type

contains

   !> Locks an output by a file `<output>.lock` that names its holder, or takes a place among the
   !> runs that share it; refused by name while another process holds it alone, and for a run alone
   !> while others share it. Makes the folder of the output where it is missing.
   subroutine take_lock(output, lock, error, is_shared)
      character(*), intent(in) :: output
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_shared

      lock%output = output
      lock%path = output//'.lock'
      if (present(is_shared)) lock%is_shared = is_shared
      call make_folder(folder_of(output), error, lock%n_folders)
      if (.not. allocated(error)) call try_longest_name(output, error)
      if (.not. allocated(error)) call obtain(lock, error)
      if (allocated(error)) call remove_folders(lock)
      if (.not. allocated(error)) lock%content = content_of(output)
   end subroutine take_lock

   !> Refuses an output beside which the file system does not take the longest name: that of the
   !> file while it is filled, which else would fail behind the work.
   subroutine try_longest_name(output, error)
      character(*), intent(in) :: output
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: enametoolong = 36   !! Linux
      character(:), allocatable :: path
      type(c_ptr) :: stream
      integer(c_int) :: number

      path = unfinished_name(output)
      stream = c_fopen(path//c_null_char, 'w'//c_null_char)
      if (c_associated(stream)) then
         number = c_fclose(stream)
         call remove_file(path, error)
      else
         number = system_error()
         if (number == enametoolong) call raise_system(number, path//': cannot be made', error)
      end if
   end subroutine try_longest_name

   recursive subroutine obtain(lock, error)
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable, intent(out) :: error
      logical :: is_taken

      call open_lock(lock, error)
      if (allocated(error)) return
      if (lock%is_shared) then
         is_taken = takes_a_place(lock)
      else
         is_taken = is_done(lock, try_to_lock, 0_c_long, whole)
      end if
      if (.not. is_taken) then
         call refuse(lock, system_error(), error)
      else if (.not. is_same_file(lock)) then
         ! its holder removed the file between our opening and our locking it
         call close_lock(lock)
         call obtain(lock, error)
      else
         call write_name(lock)
      end if
   end subroutine obtain

   !> True if one of 64 places that follow from the process number could be locked.
   function takes_a_place(lock) result(is_taken)
      type(lock_type), intent(in) :: lock
      logical :: is_taken
      integer, parameter :: n_tries = 64
      integer :: i

      do i = 1, n_tries
         is_taken = is_done(lock, try_to_lock, &
                            modulo(int(process_id(), c_long)*n_tries + i, n_places), one_byte)
         if (is_taken) return
      end do
   end function takes_a_place

   pure function is_held(self)
      class(lock_type), intent(in) :: self
      logical :: is_held

      is_held = c_associated(self%stream)
   end function is_held

   !> Makes sure that the lock still is this run's, and the output as it was found or left: an error
   !> names who has it now. A lock file that was removed is made again, unless another run was
   !> faster. Of a lock that is not held nothing is said.
   subroutine keep(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      type(lock_type) :: again
      integer(c_long) :: now(size(content_words))

      if (.not. self%is_held()) return
      if (.not. exists(self%path)) then
         again = self
         call obtain(again, error)
         if (allocated(error)) return
         call close_lock(self)
         self%stream = again%stream
         self%name = again%name
      else if (.not. is_ours(self)) then
         call raise(error, exit_file, self%path//' was taken by '//holder_of(self%path)// &
                    ': another run is at work on this output, and this one ends. What is '// &
                    'finished is safe; start again when the other has ended')
         return
      end if
      now = content_of(self%output)
      if (any(now /= 0) .and. any(now /= self%content)) call refuse_change(self, error)
   end subroutine keep

   !> Gives a finished file the name of the output, in place of what was there when the lock was
   !> taken, and of nothing else.
   subroutine publish(self, temporary, error)
      class(lock_type), intent(inout) :: self
      character(*), intent(in) :: temporary
      type(error_type), allocatable, intent(out) :: error
      integer(c_int), parameter :: eexist = 17   !! Linux
      integer(c_int) :: number

      call self%keep(error)
      if (allocated(error)) return
      if (exists(self%output)) then
         call rename_file(temporary, self%output, error)
      else if (c_link(temporary//c_null_char, self%output//c_null_char) == 0) then
         call remove_file(temporary, error)
      else   ! another run has just finished, which a renaming would not see, or there are no links
         number = system_error()
         if (number == eexist) then
            call refuse_change(self, error)
         else
            call rename_file(temporary, self%output, error)
         end if
      end if
      if (.not. allocated(error)) self%content = content_of(self%output)
   end subroutine publish

   subroutine refuse_change(self, error)
      class(lock_type), intent(in) :: self
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, self%output//' was written by another run while this one '// &
                 'was at work, and stays as it is: start again to see what it lacks')
   end subroutine refuse_change

   !> True if a piece of work is now this process's: no other that shares the lock has it.
   function claim(self, number) result(is_ours)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number   !! of the piece, from 0
      logical :: is_ours

      is_ours = is_done(self, try_to_lock, n_places + int(number, c_long), one_byte)
   end function claim

   !> Releases claimed work that is done or left to other runs.
   subroutine give_back(self, number)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number
      logical :: ignored

      ignored = is_done(self, unlock, n_places + int(number, c_long), one_byte)
   end subroutine give_back

   !> Gives the lock back. Who held it alone removes the file first, while it is still locked, and
   !> the folders that it made for an output that there is not.
   subroutine release(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      logical :: is_its_own

      if (.not. self%is_held()) return
      is_its_own = is_ours(self)
      if (is_its_own .and. .not. self%is_shared) then
         call remove_file(self%path, error)
         call remove_folders(self)
      end if
      call close_lock(self)
   end subroutine release

   !> Removes the folders that were made for the output, unless something is in them.
   subroutine remove_folders(lock)
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable :: error
      character(:), allocatable :: folder

      folder = lock%output
      do while (lock%n_folders > 0)
         folder = folder_of(folder)
         if (.not. exists(folder)) cycle
         call remove_file(folder, error)
         if (allocated(error)) return
         lock%n_folders = lock%n_folders - 1
      end do
   end subroutine remove_folders

   subroutine open_lock(lock, error)
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable, intent(out) :: error

      lock%stream = c_fopen(lock%path//c_null_char, 'r+'//c_null_char)
      if (.not. c_associated(lock%stream)) then
         lock%stream = c_fopen(lock%path//c_null_char, 'a+'//c_null_char)
      end if
      if (.not. c_associated(lock%stream)) then
         call raise_system(system_error(), lock%path//': cannot make this lock file', error)
      end if
   end subroutine open_lock

   subroutine close_lock(lock)
      type(lock_type), intent(inout) :: lock
      integer(c_int) :: status

      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
   end subroutine close_lock

   !> Writes the holder's name into the lock file. A full disk costs only the name.
   subroutine write_name(lock)
      type(lock_type), intent(inout) :: lock
      integer(c_int) :: number

      lock%name = ''
      if (.not. stands_at(lock, 0_c_long)) return
      call write_all(c_fileno(lock%stream), own_name()//new_line('a'), number)
      if (number == 0) lock%name = own_name()
   end subroutine write_name

   !> process 123 on host
   function own_name() result(name)
      character(:), allocatable :: name

      name = 'process '//to_text(process_id())//' on '//host_name()
   end function own_name

   !> Refuses with the holder's name, or with the system's words where it cannot lock at all.
   subroutine refuse(lock, number, error)
      type(lock_type), intent(inout) :: lock
      integer(c_int), intent(in) :: number   !! of system_error
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
   function is_done(lock, command, first, length)
      type(lock_type), intent(in) :: lock
      integer(c_int), intent(in) :: command
      integer(c_long), intent(in) :: first, length   !! bytes
      logical :: is_done

      is_done = stands_at(lock, first)
      if (is_done) is_done = c_lockf(c_fileno(lock%stream), command, length) == 0
   end function is_done

   !> True if the place from which lockf counts could be set.
   function stands_at(lock, place)
      type(lock_type), intent(in) :: lock
      integer(c_long), intent(in) :: place   !! byte, from 0
      logical :: stands_at
      integer(c_int), parameter :: from_the_start = 0

      stands_at = c_lseek(c_fileno(lock%stream), place, from_the_start) == place
   end function stands_at

   !> True if the path leads to the file that was locked, with this run's name in it. A run that
   !> shares accepts the names of others.
   function is_ours(lock)
      type(lock_type), intent(in) :: lock
      logical :: is_ours
      character(kind=c_char) :: found(len(lock%name) + 1)
      integer(c_long) :: n
      integer :: i

      is_ours = is_same_file(lock)
      if (lock%is_shared .or. lock%name == '' .or. .not. is_ours) return
      ! by the stream that has the lock: to close another one would give the lock back
      n = c_pread(c_fileno(lock%stream), found, size(found, kind=c_size_t), 0_c_long)
      is_ours = n == size(found)
      if (is_ours) is_ours = all(found == [(lock%name(i:i), i=1, len(lock%name)), new_line('a')])
   end function is_ours

   !> True if the path still leads to the file that was opened.
   function is_same_file(lock)
      type(lock_type), intent(in) :: lock
      logical :: is_same_file
      integer(c_long) :: opened(64), named(64)   ! struct stat has 18 words

      is_same_file = .false.
      if (c_fstat(c_fileno(lock%stream), opened) /= 0) return
      if (c_stat(lock%path//c_null_char, named) /= 0) return
      is_same_file = all(opened(place_words) == named(place_words))
   end function is_same_file

   !> Numbers by which a file is known to be the same and unchanged; zeros where there is none.
   function content_of(path) result(content)
      character(*), intent(in) :: path
      integer(c_long) :: content(size(content_words))
      integer(c_long) :: facts(64)   ! struct stat has 18 words

      content = 0
      if (c_stat(path//c_null_char, facts) == 0) content = facts(content_words)
   end function content_of

   !> Text that the holder wrote into the file.
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
