!> A solved process as a row of numbers and back, to hand it to other ranks.
module process_packing
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: axis_type, component, component_visitor, forget_components, &
                                 visit_components
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
      procedure :: visit_real, visit_integer, visit_text, visit_reals, visit_integers, visit_table
      procedure, private :: number, real_array, integer_array, check_name
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

   !> Passes an array behind its length; -1: not allocated.
   subroutine real_array(self, values, first)
      class(tape), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: first   !! lower bound, else 1
      real(wp) :: length
      integer :: lower, n

      lower = 1
      if (present(first)) lower = first
      length = -1.0_wp
      if (self%is_writing .and. allocated(values)) length = size(values)
      call self%number(length)
      n = nint(length)
      if (self%is_writing) then
         if (n > 0) self%numbers = [self%numbers, values]
      else
         if (allocated(values)) deallocate (values)
         if (n < 0) return
         allocate (values(lower:lower + n - 1))
         values(:) = self%numbers(self%position + 1:self%position + n)
         self%position = self%position + n
      end if
   end subroutine real_array

   subroutine integer_array(self, values)
      class(tape), intent(inout) :: self
      integer, allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: numbers(:)

      if (allocated(values)) numbers = real(values, wp)
      call self%real_array(numbers)
      if (allocated(values)) deallocate (values)
      if (.not. allocated(numbers)) return
      values = nint(numbers)
   end subroutine integer_array

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

   subroutine visit_integer(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, intent(inout) :: value
      real(wp) :: passed

      call self%check_name(what)
      passed = value
      call self%number(passed)
      value = nint(passed)
   end subroutine visit_integer

   subroutine visit_text(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      character(:), allocatable, intent(inout) :: value
      integer, allocatable :: codes(:)
      integer :: i

      call self%check_name(what)
      if (allocated(value)) codes = [(iachar(value(i:i)), i=1, len(value))]
      call self%integer_array(codes)
      if (allocated(value)) deallocate (value)
      if (.not. allocated(codes)) return
      allocate (character(size(codes)) :: value)
      do i = 1, size(codes)
         value(i:i) = achar(modulo(codes(i), 128))
      end do
   end subroutine visit_text

   subroutine visit_reals(self, what, values)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp), allocatable, intent(inout) :: values(:)

      call self%check_name(what)
      call self%real_array(values, what%axis%first)
   end subroutine visit_reals

   subroutine visit_integers(self, what, values)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, allocatable, intent(inout) :: values(:)

      call self%check_name(what)
      call self%integer_array(values)
   end subroutine visit_integers

   !> Passes the values of a table, then the number of its rows.
   subroutine visit_table(self, what, values, rows)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, allocatable, intent(inout) :: values(:, :)
      type(axis_type), intent(in) :: rows
      integer, allocatable :: flat(:)
      real(wp) :: n_rows

      call self%check_name(what)
      call self%check_name(component(rows%name))
      n_rows = 0.0_wp
      if (allocated(values)) then
         flat = reshape(values, [size(values)])
         n_rows = size(values, 1)
         deallocate (values)
      end if
      call self%integer_array(flat)
      call self%number(n_rows)
      if (.not. allocated(flat)) return
      values = reshape(flat, [nint(n_rows), size(flat)/max(1, nint(n_rows))])
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
