!> Files that a test writes for itself.
module scratch_files
   use core_kinds, only: long
   implicit none(type, external)
   private
   public :: remove_file, scratch_path, write_file

contains

   !> A file of this process alone: tests of two builds may run at once.
   function scratch_path(name) result(path)
      character(*), intent(in) :: name
      character(:), allocatable :: path
      integer(long), save :: clock = 0
      character(20) :: digits

      if (clock == 0) call system_clock(clock)
      write (digits, '(i0)') clock
      path = '/tmp/entroslip_'//trim(digits)//'_'//name
   end function scratch_path

   subroutine remove_file(path)
      character(*), intent(in) :: path
      integer :: unit

      open (newunit=unit, file=path)
      close (unit, status='delete')
   end subroutine remove_file

   subroutine write_file(path, text)
      character(*), intent(in) :: path, text
      integer :: unit

      open (newunit=unit, file=path, access='stream', form='unformatted', status='replace')
      write (unit) text
      close (unit)
   end subroutine write_file

end module scratch_files
