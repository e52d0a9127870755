!> One run at a time on one output: an advisory lock that the system gives back when a run dies.
module io_lock
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_long, c_null_char, c_null_ptr, &
                     c_ptr
   use core_error, only: error_type, exit_file, raise
   use core_text, only: to_text
   use io_files, only: host_name, process_id, remove_file
   use io_posix, only: c_fclose, c_fflush, c_fileno, c_fopen, c_fputs, c_fstat, c_lockf, c_stat, &
                       raise_system, system_error
   implicit none(type, external)
   private
   public :: lock_type, take_lock

   integer(c_int), parameter :: try_to_lock = 2   !! F_TLOCK of lockf(3); works across NFS too

   !> Held from `take_lock` to `release`, or to the end of the process.
   type :: lock_type
      private
      character(:), allocatable :: path
      type(c_ptr) :: stream = c_null_ptr
   contains
      procedure :: is_held
      procedure :: release
   end type lock_type

contains

   !> Locks a file, made where it is missing, that names its holder; refused by name while another
   !> process holds it.
   recursive subroutine take_lock(path, lock, error)
      character(*), intent(in) :: path
      type(lock_type), intent(out) :: lock
      type(error_type), allocatable, intent(out) :: error
      integer(c_int) :: status

      lock%path = path
      lock%stream = c_fopen(path//c_null_char, 'r+'//c_null_char)
      if (.not. c_associated(lock%stream)) then
         lock%stream = c_fopen(path//c_null_char, 'a+'//c_null_char)
      end if
      if (.not. c_associated(lock%stream)) then
         call raise_system(system_error(), path//': cannot make this lock file', error)
         return
      end if
      if (c_lockf(c_fileno(lock%stream), try_to_lock, 0_c_long) /= 0) then
         call raise(error, exit_file, path//' is locked by '//holder_of(path)// &
                    ': another run is at work on this output')
         status = c_fclose(lock%stream)
         lock%stream = c_null_ptr
      else if (.not. is_same_file(lock)) then
         ! its holder removed the file between our opening and our locking it
         status = c_fclose(lock%stream)
         call take_lock(path, lock, error)
      else
         status = c_fputs('process '//to_text(process_id())//' on '//host_name()//new_line('a')// &
                          c_null_char, lock%stream)
         status = c_fflush(lock%stream)   ! a full disk only costs the name of the holder
      end if
   end subroutine take_lock

   pure function is_held(self)
      class(lock_type), intent(in) :: self
      logical :: is_held

      is_held = c_associated(self%stream)
   end function is_held

   !> Removes the file while it is still locked, then gives the lock back.
   subroutine release(self, error)
      class(lock_type), intent(inout) :: self
      type(error_type), allocatable, intent(out) :: error
      integer(c_int) :: status

      if (.not. self%is_held()) return
      call remove_file(self%path, error)
      status = c_fclose(self%stream)
      self%stream = c_null_ptr
   end subroutine release

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
