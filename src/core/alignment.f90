!> Aligned memory and padding of arrays, so that loops load whole vector registers.
module core_alignment
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_intptr_t, c_loc
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: aligned_memory, register_width, whole_registers

   integer, parameter :: register_width = 8   !! reals in a vector register: 64 bytes, a cache line

   !> Memory that begins at a multiple of 64 bytes, assigned to pointers plane by plane. Its owner
   !> deallocates it.
   type :: aligned_memory
      real(wp), allocatable, private :: memory(:)
      integer(long), private :: next = 1   !! index of the first real that is not assigned
   contains
      procedure :: reserve
      procedure :: assign_planes
   end type aligned_memory

contains

   !> Allocates memory filled with zeros; pointers into earlier memory become invalid.
   subroutine reserve(self, n)
      class(aligned_memory), intent(inout), target :: self
      integer(long), intent(in) :: n   !! number of reals
      integer(c_intptr_t), parameter :: line = 64   ! bytes

      if (allocated(self%memory)) deallocate (self%memory)
      allocate (self%memory(n + register_width), source=0.0_wp)
      self%next = 1 + int(modulo(-transfer(c_loc(self%memory), 0_c_intptr_t), line))/8
   end subroutine reserve

   !> Assigns the next planes to a pointer.
   subroutine assign_planes(self, extents, planes)
      class(aligned_memory), intent(inout), target :: self
      integer, intent(in) :: extents(3)
      real(wp), pointer, contiguous, intent(out) :: planes(:, :, :)

      if (self%next + product(int(extents, long)) - 1 > size(self%memory, kind=long)) &
         error stop 'core_alignment: assign_planes'
      call c_f_pointer(c_loc(self%memory(self%next)), planes, extents)
      self%next = self%next + size(planes, kind=long)
   end subroutine assign_planes

   !> n, rounded up to whole registers.
   pure integer function whole_registers(n)
      integer, intent(in) :: n

      whole_registers = register_width*((n + register_width - 1)/register_width)
   end function whole_registers

end module core_alignment
