!> Who may write an output: one run alone, or several that share its work. Advisory locks, which the
!> system gives back when a run dies; they hold between machines where the file system's locks do.
!>
!> A run alone locks the whole lock file. Runs that share each hold one byte of it to show that they
!> are there, and one more for each piece of work on its way.
module io_lock
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_long, c_null_char, c_null_ptr, &
                                                                             c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long
   use core_system, only: raise_system, system_error
   use core_text, only: to_text
   use io_files, only: host_name, process_id, remove_file
   use io_posix, only: c_fclose, c_fflush, c_fileno, c_fopen, c_fputs, c_fstat, c_lockf, c_lseek, &
                       c_stat
   implicit none(type, external)
   private
   public :: lock_type, join_lock, take_lock

   integer(c_int), parameter :: unlock = 0, try_to_lock = 2   !! of lockf(3)
   integer(c_long), parameter :: whole = 0, one_byte = 1
   !> Bytes by which runs that share show that they are there; those of their work lie above.
   integer(c_long), parameter :: n_places = 2_c_long**20

   !> Held from `take_lock` or `join_lock` to `release`, or to the end of the process.
   type :: lock_type
      private
      character(:), allocatable :: path
      type(c_ptr) :: stream = c_null_ptr
      logical :: is_shared = .false.
   contains
      procedure :: is_held
      procedure :: claim
      procedure :: give_back
      procedure :: release
   end type lock_type

contains

   !> Locks a file, made where it is missing, that names its holder; refused by name while another
   !> process holds it, alone or with others.
   subroutine take_lock(path, lock, error)
      character(*), intent(in) :: path
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error

      call obtain(path, .false., lock, error)
   end subroutine take_lock

   !> A place among the runs that share; refused by name while a run alone holds the lock.
   subroutine join_lock(path, lock, error)
      character(*), intent(in) :: path
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error

      call obtain(path, .true., lock, error)
   end subroutine join_lock

   recursive subroutine obtain(path, is_shared, lock, error)
      character(*), intent(in) :: path
      logical, intent(in) :: is_shared
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error
      logical :: is_taken

      call open_lock(path, lock, error)
      if (allocated(error)) return
      lock%is_shared = is_shared
      if (is_shared) then
         is_taken = takes_a_place(lock)
      else
         is_taken = takes(lock, 0_c_long, whole)
      end if
      if (.not. is_taken) then
         call refuse(lock, error)
      else if (.not. is_same_file(lock)) then
         ! its holder removed the file between our opening and our locking it
         call close_lock(lock)
         call obtain(path, is_shared, lock, error)
      else
         call write_name(lock)
      end if
   end subroutine obtain

   !> One of some places that follow from the process number: that all are others' is beyond belief.
   function takes_a_place(lock) result(is_taken)
      type(lock_type), intent(in) :: lock
      logical :: is_taken
      integer, parameter :: n_tries = 64
      integer :: i

      do i = 1, n_tries
         is_taken = takes(lock, modulo(int(process_id(), c_long)*n_tries + i, n_places), one_byte)
         if (is_taken) return
      end do
   end function takes_a_place

   pure function is_held(self)
      class(lock_type), intent(in) :: self
      logical :: is_held

      is_held = c_associated(self%stream)
   end function is_held

   !> Whether a piece of work is now this process's: no other that shares the lock has it.
   function claim(self, number) result(is_ours)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number   !! of the piece, from 0
      logical :: is_ours

      is_ours = takes(self, n_places + int(number, c_long), one_byte)
   end function claim

   !> A piece of work that was claimed is done, or left to others.
   subroutine give_back(self, number)
      class(lock_type), intent(in) :: self
      integer(long), intent(in) :: number
      integer(c_int) :: status

      status = lock_at(self, unlock, n_places + int(number, c_long), one_byte)
   end subroutine give_back

   !> Gives the lock back. Who held it alone removes the file first, while it is still locked.
   subroutine release(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error

      if (.not. self%is_held()) return
      if (.not. self%is_shared) call remove_file(self%path, error)
      call close_lock(self)
   end subroutine release

   subroutine open_lock(path, lock, error)
      character(*), intent(in) :: path
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable, intent(out) :: error

      lock%path = path
      lock%stream = c_fopen(path//c_null_char, 'r+'//c_null_char)
      if (.not. c_associated(lock%stream)) then
         lock%stream = c_fopen(path//c_null_char, 'a+'//c_null_char)
      end if
      if (.not. c_associated(lock%stream)) then
         call raise_system(system_error(), path//': cannot make this lock file', error)
      end if
   end subroutine open_lock

   subroutine close_lock(lock)
      type(lock_type), intent(inout) :: lock
      integer(c_int) :: status

      status = c_fclose(lock%stream)
      lock%stream = c_null_ptr
   end subroutine close_lock

   !> A full disk only costs the name of the holder.
   subroutine write_name(lock)
      type(lock_type), intent(in) :: lock
      integer(c_int) :: status

      if (.not. stands_at(lock, 0_c_long)) return
      status = c_fputs('process '//to_text(process_id())//' on '//host_name()//new_line('a')// &
                       c_null_char, lock%stream)
      status = c_fflush(lock%stream)
   end subroutine write_name

   subroutine refuse(lock, error)
      type(lock_type), intent(inout) :: lock
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, lock%path//' is locked by '//holder_of(lock%path)// &
                 ': another run is at work on this output')
      call close_lock(lock)
   end subroutine refuse

   function takes(lock, first, length) result(is_taken)
      type(lock_type), intent(in) :: lock
      integer(c_long), intent(in) :: first, length   !! bytes
      logical :: is_taken

      is_taken = lock_at(lock, try_to_lock, first, length) == 0
   end function takes

   function lock_at(lock, command, first, length) result(status)
      type(lock_type), intent(in) :: lock
      integer(c_int), intent(in) :: command
      integer(c_long), intent(in) :: first, length   !! bytes
      integer(c_int) :: status

      status = -1
      if (stands_at(lock, first)) status = c_lockf(c_fileno(lock%stream), command, length)
   end function lock_at

   !> Sets the place from which lockf counts.
   function stands_at(lock, place)
      type(lock_type), intent(in) :: lock
      integer(c_long), intent(in) :: place   !! byte, from 0
      logical :: stands_at
      integer(c_int), parameter :: from_the_start = 0

      stands_at = c_lseek(c_fileno(lock%stream), place, from_the_start) == place
   end function stands_at

   !> Whether the path still leads to the file that was opened.
   function is_same_file(lock)
      type(lock_type), intent(in) :: lock
      logical :: is_same_file
      integer(c_long) :: opened(64), named(64)   ! struct stat has 18 words

      is_same_file = .false.
      if (c_fstat(c_fileno(lock%stream), opened) /= 0) return
      if (c_stat(lock%path//c_null_char, named) /= 0) return
      is_same_file = all(opened(:2) == named(:2))   ! device and inode
   end function is_same_file

   !> What the holder wrote into the file.
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
