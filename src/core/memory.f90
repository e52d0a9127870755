!> Memory limits of the system (`ulimit -v`, RLIMIT_AS): checks that memory can be allocated.
module core_memory
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: can_allocate, limits_memory, require_memory

   integer, parameter :: needed_megabytes = 256               !! OpenBLAS 128, MPI 64, others 64
   integer(c_int64_t), parameter :: no_limit = -1_c_int64_t   !! RLIM_INFINITY

   type, bind(c) :: limit_type
      integer(c_int64_t) :: soft, hard   !! [byte]
   end type limit_type

   interface
      function c_getrlimit(resource, limits) result(status) bind(c, name='getrlimit')
         import :: c_int, limit_type
         integer(c_int), value :: resource
         type(limit_type), intent(out) :: limits
         integer(c_int) :: status
      end function c_getrlimit
   end interface

contains

   !> True if the system limits the address space or the data of this process.
   function limits_memory()
      logical :: limits_memory
      integer(c_int), parameter :: rlimit_data = 2, rlimit_as = 9   ! Linux

      limits_memory = is_limited(rlimit_as) .or. is_limited(rlimit_data)
   end function limits_memory

   !> True if the system limits a resource of this process.
   function is_limited(resource)
      integer(c_int), intent(in) :: resource
      logical :: is_limited
      type(limit_type) :: limits

      is_limited = .false.
      if (c_getrlimit(resource, limits) == 0) is_limited = limits%soft /= no_limit
   end function is_limited

   !> Raises an error if the system refuses the memory that libraries allocate at their start.
   subroutine require_memory(error)
      type(error_type), allocatable, intent(out) :: error

      if (.not. limits_memory()) return
      if (.not. can_allocate(1.0e6_wp*needed_megabytes)) &
         call raise(error, exit_file, 'memory: the system does not give the '// &
                    to_text(needed_megabytes)//' MB that libraries take before any work: '// &
                    'raise the limit (ulimit -v) to 400000 kB or more')
   end subroutine require_memory

   !> True if so much memory can be allocated now; it is freed at once.
   function can_allocate(bytes)
      real(wp), intent(in) :: bytes
      logical :: can_allocate
      real(wp), parameter :: word = 8.0_wp   ! bytes of a number
      real(wp), allocatable, volatile :: words(:)
      integer :: status

      can_allocate = bytes/word < real(huge(1_long), wp)/16
      if (.not. can_allocate) return
      allocate (words(max(1_long, nint(bytes/word, long))), stat=status)
      can_allocate = status == 0
      if (can_allocate) words(1) = 0.0_wp
   end function can_allocate

end module core_memory
