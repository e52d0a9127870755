!> Alignment and padding of arrays, so that the processor loads a whole register at once.
module dynamics_alignment
   use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: register_width, whole_registers, first_aligned

   integer, parameter :: register_width = 8   !! reals; 64 bytes, a cache line

contains

   !> n, padded to whole registers.
   pure integer function whole_registers(n)
      integer, intent(in) :: n

      whole_registers = register_width*((n + register_width - 1)/register_width)
   end function whole_registers

   !> Where in the memory the first whole cache line begins: registers then load from one line only.
   function first_aligned(memory) result(first)
      real(wp), intent(in), target, contiguous :: memory(:)
      integer :: first
      integer(c_intptr_t), parameter :: line = 64

      first = 1 + int(modulo(-transfer(c_loc(memory), 0_c_intptr_t), line))/8
   end function first_aligned

end module dynamics_alignment
