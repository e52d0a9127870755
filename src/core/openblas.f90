!> Threads and kernels of OpenBLAS, which reads them from the environment only when it is loaded.
!>
!> It then allocates a buffer of 128 MB for each of its threads, one for each core, and one more at
!> its first call. If the system refuses a buffer, it asks again without end (memory.c,
!> blas_memory_alloc). So under a limit of memory it gets one thread.
!>
!> On a processor that it does not know, as one newer than itself, it takes the kernels of a
!> Prescott, of 2004 (dynamic.c, get_coretype), which multiply matrices 3.4 times slower than those
!> for AVX-512. So it gets the kernels of the processor's vector instructions.
module core_openblas
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_procpointer, c_funptr, c_int, &
                                          c_loc, c_null_char, c_null_ptr, c_ptr, c_size_t
   use core_memory, only: limits_memory
   use core_system, only: c_dlsym, c_readlink, c_setenv, text_at
   implicit none(type, external)
   private
   public :: kernels_for, restart_for_openblas

   abstract interface
      !> Name of the kernels in use.
      function get_corename() result(name) bind(c)
         import :: c_ptr
         type(c_ptr) :: name
      end function get_corename
   end interface

   interface
      !> Replaces this program by another; returns only on failure.
      function c_execv(path, arguments) result(status) bind(c, name='execv')
         import :: c_char, c_int, c_ptr
         character(kind=c_char), intent(in) :: path(*)
         type(c_ptr), intent(in) :: arguments(*)
         integer(c_int) :: status
      end function c_execv
   end interface

contains

   !> Restarts the program, before it has done anything, if OpenBLAS needs other settings than it
   !> was loaded with. Kernels that the user has chosen stay, and so does the process number.
   subroutine restart_for_openblas()
      logical :: is_changed

      is_changed = .false.
      if (limits_memory()) call set('OPENBLAS_NUM_THREADS', '1', keeps=.false.)
      if (current_kernels() == 'Prescott') &
         call set('OPENBLAS_CORETYPE', kernels_for(processor_flags()), keeps=.true.)
      if (is_changed) call restart()

   contains

      !> Sets an environment variable, unless it has this value.
      subroutine set(name, value, keeps)
         character(*), intent(in) :: name, value   !! value: empty for none
         logical, intent(in) :: keeps              !! any value that it has stays
         character(16) :: present_value
         integer :: status

         call get_environment_variable(name, present_value, status=status)
         if (value == '' .or. (status == 0 .and. (keeps .or. present_value == value))) return
         ! if it cannot be set, the program continues as it is
         is_changed = c_setenv(name//c_null_char, value//c_null_char, 1_c_int) == 0 .or. is_changed
      end subroutine set

   end subroutine restart_for_openblas

   !> Name of the kernels that OpenBLAS has taken; empty with another BLAS.
   function current_kernels() result(name)
      character(:), allocatable :: name
      procedure(get_corename), pointer :: corename
      type(c_funptr) :: address

      name = ''
      address = c_dlsym(c_null_ptr, 'openblas_get_corename'//c_null_char)
      if (.not. c_associated(address)) return
      call c_f_procpointer(address, corename)
      name = text_at(corename())
   end function current_kernels

   !> OpenBLAS's name of the kernels for a processor with some flags; empty where its own choice is
   !> right.
   pure function kernels_for(flags) result(name)
      character(*), intent(in) :: flags   !! as in /proc/cpuinfo, with a blank before and after each
      character(:), allocatable :: name

      name = ''
      if (has('avx2') .and. has('fma')) name = 'Haswell'
      if (has('avx512f') .and. has('avx512dq') .and. has('avx512bw') .and. has('avx512vl')) &
         name = 'SkylakeX'

   contains

      pure logical function has(flag)
         character(*), intent(in) :: flag

         has = index(flags, ' '//flag//' ') > 0
      end function has

   end function kernels_for

   !> Flags of the first processor, with a blank before and after each; empty if they are unknown.
   function processor_flags() result(flags)
      character(:), allocatable :: flags
      integer, parameter :: longest = 8192
      character(longest) :: line
      integer :: status, unit

      flags = ''
      open (newunit=unit, file='/proc/cpuinfo', action='read', iostat=status)
      if (status /= 0) return
      do
         read (unit, '(a)', iostat=status) line
         if (status /= 0) exit
         if (line(:5) == 'flags') then
            flags = trim(line)//' '
            exit
         end if
      end do
      close (unit)
   end function processor_flags

   !> Replaces this program by itself, under its own name and with the arguments that Linux keeps,
   !> each with its null character.
   subroutine restart()
      character(kind=c_char), allocatable, target :: words(:)
      integer, parameter :: longest = 4096   ! limit of Linux
      character(kind=c_char) :: letter, path(longest + 1)
      integer, allocatable :: starts(:)
      integer(c_int) :: ignored
      integer :: i, status, unit

      path = c_null_char
      if (c_readlink('/proc/self/exe'//c_null_char, path, int(longest, c_size_t)) < 0) return
      open (newunit=unit, file='/proc/self/cmdline', access='stream', form='unformatted', &
            action='read', iostat=status)
      if (status /= 0) return
      allocate (words(0))
      do
         read (unit, iostat=status) letter
         if (status /= 0) exit
         words = [words, letter]
      end do
      close (unit)
      starts = pack([(i, i=1, size(words))], [c_null_char, words(:size(words) - 1)] == c_null_char)
      ignored = c_execv(path, [(c_loc(words(starts(i))), i=1, size(starts)), c_null_ptr])
   end subroutine restart

end module core_openblas
