!> A solved process as a row of numbers and back, to hand it to other ranks.
module process_packing
   use core_kinds, only: wp
   use process_model, only: process_model_type, process_solution
   implicit none(type, external)
   private
   public :: pack_model, unpack_model

   !> Walks through a model and a row of numbers together, in either direction: one list of
   !> components serves both.
   type :: tape
      logical :: is_writing = .true.
      real(wp), allocatable :: numbers(:)
      integer :: position = 0   !! numbers already read
   contains
      procedure, private :: real_value, integer_value, logical_value, text_value
      procedure, private :: real_array, integer_array, complex_array
      generic :: pass => real_value, integer_value, logical_value, text_value, &
         real_array, integer_array, complex_array
   end type tape

contains

   !> Everything that was found; not the request, which every rank knows from the scene.
   function pack_model(model) result(numbers)
      type(process_model_type), intent(in) :: model
      real(wp), allocatable :: numbers(:)
      type(process_model_type) :: copy
      type(tape) :: t

      copy = model
      allocate (t%numbers(0))
      call walk(t, copy)
      call move_alloc(t%numbers, numbers)
   end function pack_model

   !> Fills everything but the request from what pack_model gave.
   subroutine unpack_model(numbers, model)
      real(wp), intent(in) :: numbers(:)
      type(process_model_type), intent(inout) :: model
      type(tape) :: t

      t%is_writing = .false.
      t%numbers = numbers
      call walk(t, model)
   end subroutine unpack_model

   !> The list of components.
   subroutine walk(t, model)
      type(tape), intent(inout) :: t
      type(process_model_type), intent(inout) :: model

      call t%pass(model%is_solved)
      call t%pass(model%reason)
      call t%pass(model%order)
      call t%pass(model%a)
      call t%pass(model%b0)
      call t%pass(model%mu)
      call t%pass(model%poles)
      call t%pass(model%autocovariance)
      call t%pass(model%autocovariance_error)
      call t%pass(model%l0)
      call t%pass(model%l1)
      call t%pass(model%l0_cut)
      call t%pass(model%l1_cut)
      call t%pass(model%mean)
      call t%pass(model%std)
      call t%pass(model%mean_error)
      call t%pass(model%std_error)
      call t%pass(model%l0_error)
      call t%pass(model%l1_error)
      call t%pass(model%entropy)
      call t%pass(model%entropy_error)
      call t%pass(model%entropy_bound)
      call t%pass(model%optimality)
      call t%pass(model%lambda)
      call t%pass(model%acceptance_ratio)
      call t%pass(model%acceptance_mean)
      call t%pass(model%acceptance_geometric)
      call t%pass(model%memory)
      call t%pass(model%other_mean)
      call t%pass(model%other_std)
      call t%pass(model%other_l0)
      call t%pass(model%other_entropy)
      call t%pass(model%signs)
      call t%pass(model%delta)
      call t%pass(model%lambda_3)
      call t%pass(model%n_examined)
      call t%pass(model%n_consistent)
      call t%pass(model%entropy_ceiling)
      call t%pass(model%search)
      call walk_solutions(t, model%solutions)
   end subroutine walk

   !> As for any array, the number stands in front; -1: not allocated.
   subroutine walk_solutions(t, solutions)
      type(tape), intent(inout) :: t
      type(process_solution), allocatable, intent(inout) :: solutions(:)
      integer :: i, n

      n = -1
      if (t%is_writing .and. allocated(solutions)) n = size(solutions)
      call t%pass(n)
      if (.not. t%is_writing) then
         if (allocated(solutions)) deallocate (solutions)
         if (n >= 0) allocate (solutions(n))
      end if
      do i = 1, n
         call t%pass(solutions(i)%signs)
         call t%pass(solutions(i)%delta)
         call t%pass(solutions(i)%lambda_3)
         call t%pass(solutions(i)%entropy)
      end do
   end subroutine walk_solutions

   subroutine real_value(self, value)
      class(tape), intent(inout) :: self
      real(wp), intent(inout) :: value

      if (self%is_writing) then
         self%numbers = [self%numbers, value]
      else
         self%position = self%position + 1
         value = self%numbers(self%position)
      end if
   end subroutine real_value

   subroutine integer_value(self, value)
      class(tape), intent(inout) :: self
      integer, intent(inout) :: value
      real(wp) :: number

      number = value
      call self%real_value(number)
      value = nint(number)
   end subroutine integer_value

   subroutine logical_value(self, value)
      class(tape), intent(inout) :: self
      logical, intent(inout) :: value
      integer :: number

      number = merge(1, 0, value)
      call self%integer_value(number)
      value = number == 1
   end subroutine logical_value

   !> An array stands behind its length; -1: not allocated.
   subroutine real_array(self, values)
      class(tape), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      integer :: n

      n = -1
      if (self%is_writing .and. allocated(values)) n = size(values)
      call self%integer_value(n)
      if (self%is_writing) then
         if (n > 0) self%numbers = [self%numbers, values]
      else
         if (allocated(values)) deallocate (values)
         if (n >= 0) values = self%numbers(self%position + 1:self%position + n)
         self%position = self%position + max(n, 0)
      end if
   end subroutine real_array

   subroutine integer_array(self, values)
      class(tape), intent(inout) :: self
      integer, allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: numbers(:)

      if (allocated(values)) numbers = real(values, wp)
      call self%real_array(numbers)
      if (allocated(values)) deallocate (values)
      if (allocated(numbers)) values = nint(numbers)
   end subroutine integer_array

   subroutine complex_array(self, values)
      class(tape), intent(inout) :: self
      complex(wp), allocatable, intent(inout) :: values(:)
      real(wp), allocatable :: re(:), im(:)

      if (allocated(values)) then
         re = real(values, wp)
         im = aimag(values)
      end if
      call self%real_array(re)
      call self%real_array(im)
      if (allocated(values)) deallocate (values)
      if (allocated(re)) values = cmplx(re, im, wp)
   end subroutine complex_array

   subroutine text_value(self, value)
      class(tape), intent(inout) :: self
      character(:), allocatable, intent(inout) :: value
      integer, allocatable :: codes(:)
      integer :: i

      if (allocated(value)) codes = [(iachar(value(i:i)), i=1, len(value))]
      call self%integer_array(codes)
      if (allocated(value)) deallocate (value)
      if (.not. allocated(codes)) return
      allocate (character(size(codes)) :: value)
      do i = 1, size(codes)
         value(i:i) = achar(codes(i))
      end do
   end subroutine text_value

end module process_packing
