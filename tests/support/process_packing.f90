!> A solved process as a row of numbers and back, to hand it to other ranks.
module process_packing
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: component, component_visitor, reset_components, visit_components
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: pack_model, unpack_model

   !> Walks through a model and a row of numbers together, in either direction: one list of
   !> components serves both.
   type, extends(component_visitor) :: tape
      logical :: is_writing = .true.
      real(wp), allocatable :: numbers(:)
      integer :: position = 0   !! numbers already read
   contains
      procedure :: visit_table
   end type tape

contains

   !> Row of everything that was found; not the request, which every rank knows from the scene.
   function pack_model(model) result(numbers)
      type(process_model_type), intent(in) :: model
      real(wp), allocatable :: numbers(:)
      type(process_model_type) :: copy
      type(tape) :: t

      copy = model
      allocate (t%numbers(0))
      call visit_components(t, copy)
      call move_alloc(t%numbers, numbers)
   end function pack_model

   !> Fills everything but the request from what pack_model gave.
   subroutine unpack_model(numbers, model)
      real(wp), intent(in) :: numbers(:)
      type(process_model_type), intent(inout) :: model
      type(tape) :: t

      call reset_components(model)
      t%is_writing = .false.
      t%numbers = numbers
      call visit_components(t, model)
      if (t%position /= size(numbers)) error stop 'unpack_model: the row is none of pack_model'
   end subroutine unpack_model

   !> Passes a table behind its name and its extents; -1: not allocated. Stops where another
   !> component stands than this one.
   subroutine visit_table(self, item, values)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: item
      real(wp), allocatable, intent(inout) :: values(:, :)
      real(wp) :: head(3)
      integer :: n

      head = real([modulo(label_of(item%name), 2_long**30), -1_long, -1_long], wp)
      if (self%is_writing) then
         if (allocated(values)) head(2:) = shape(values)
         self%numbers = [self%numbers, head]
         if (allocated(values)) self%numbers = [self%numbers, values]
         return
      end if
      if (abs(self%numbers(self%position + 1) - head(1)) > 0.0_wp) &
         error stop 'unpack_model: the row is none of pack_model'
      head = self%numbers(self%position + 1:self%position + 3)
      self%position = self%position + 3
      if (head(2) < 0.0_wp) return
      n = nint(product(head(2:)))
      values = reshape(self%numbers(self%position + 1:self%position + n), nint(head(2:)))
      self%position = self%position + n
   end subroutine visit_table

end module process_packing
