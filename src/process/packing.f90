!> A solved process as a row of numbers and back, to hand it to other ranks.
module process_packing
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: component, component_visitor, forget_components, visit_components
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
      procedure :: visit_real, visit_text, visit_table
      procedure, private :: number, check_name
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

      call forget_components(model)
      t%is_writing = .false.
      t%numbers = numbers
      call visit_components(t, model)
      if (t%position /= size(numbers)) error stop 'unpack_model: the row is none of pack_model'
   end subroutine unpack_model

   subroutine number(self, value)
      class(tape), intent(inout) :: self
      real(wp), intent(inout) :: value

      if (self%is_writing) then
         self%numbers = [self%numbers, value]
      else
         self%position = self%position + 1
         value = self%numbers(self%position)
      end if
   end subroutine number

   subroutine visit_real(self, what, value, error, none)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp), intent(inout) :: value
      real(wp), intent(inout), optional :: error
      real(wp), intent(in), optional :: none

      call self%check_name(what)
      if (present(none) .and. .not. self%is_writing) value = none
      call self%number(value)
      if (present(error)) call self%number(error)
   end subroutine visit_real

   subroutine visit_text(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      character(:), allocatable, intent(inout) :: value
      integer, allocatable :: codes(:)
      integer :: i

      if (allocated(value)) then
         codes = [(iachar(value(i:i)), i=1, len(value))]
         deallocate (value)
      end if
      call self%visit(what, codes)
      if (.not. allocated(codes)) return
      allocate (character(size(codes)) :: value)
      do i = 1, size(codes)
         value(i:i) = achar(codes(i))
      end do
   end subroutine visit_text

   !> Passes a table behind its extents; -1: not allocated.
   subroutine visit_table(self, what, values)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:, :)
      real(wp) :: extents(2)
      integer :: n

      call self%check_name(what)
      extents = -1.0_wp
      if (allocated(values)) extents = shape(values)
      call self%number(extents(1))
      call self%number(extents(2))
      if (extents(1) < 0.0_wp) return
      n = nint(product(extents))
      if (self%is_writing) then
         self%numbers = [self%numbers, values]
      else
         values = reshape(self%numbers(self%position + 1:self%position + n), nint(extents))
         self%position = self%position + n
      end if
   end subroutine visit_table

   !> Stops where another component stands than this one.
   subroutine check_name(self, what)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp) :: expected, found

      expected = real(modulo(label_of(what%name), 2_long**30), wp)
      found = expected
      call self%number(found)
      if (abs(found - expected) > 0.0_wp) error stop 'unpack_model: the row is none of pack_model'
   end subroutine check_name

end module process_packing
