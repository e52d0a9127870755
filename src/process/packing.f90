!> A solved process, or a part of a search for one, as a row of numbers and back, to hand it to
!> other ranks.
module process_packing
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use process_components, only: axis_type, component, component_visitor, forget_components, &
                                 visit_components
   use process_direct_sign_search, only: search_result
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: pack_model, unpack_model, pack_search, unpack_search

   !> Walks through a model and a row of numbers together, in either direction: one list of
   !> components serves both.
   type, extends(component_visitor) :: tape
      logical :: is_writing = .true.
      real(wp), allocatable :: numbers(:)
      integer :: position = 0   !! numbers already read
   contains
      procedure :: visit_real, visit_integer, visit_text, visit_reals, visit_integers, &
         visit_table, visit_seconds
      procedure, private :: real_value, integer_value, long_value, logical_value
      procedure, private :: real_array, integer_array
      procedure, private :: check_name
      generic :: pass => real_value, integer_value, long_value, logical_value, real_array, &
         integer_array
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

   !> Numbers of a search that a merged search needs.
   function pack_search(search) result(numbers)
      type(search_result), intent(in) :: search
      real(wp), allocatable :: numbers(:)
      type(search_result) :: copy
      type(tape) :: t

      copy = search
      allocate (t%numbers(0))
      call walk_search(t, copy)
      call move_alloc(t%numbers, numbers)
   end function pack_search

   !> Fills a search from what pack_search gave.
   subroutine unpack_search(numbers, search)
      real(wp), intent(in) :: numbers(:)
      type(search_result), intent(out) :: search
      type(tape) :: t

      t%is_writing = .false.
      t%numbers = numbers
      call walk_search(t, search)
   end subroutine unpack_search

   subroutine walk_search(t, search)
      type(tape), intent(inout) :: t
      type(search_result), intent(inout) :: search
      integer :: i, n

      call t%pass(search%n_examined)
      call t%pass(search%n_excluded)
      call t%pass(search%n_consistent)
      call t%pass(search%seconds)
      n = 0
      if (allocated(search%solutions)) n = size(search%solutions)
      call t%pass(n)
      if (.not. t%is_writing) allocate (search%solutions(n))
      do i = 1, n
         call walk_sequence(t, search%solutions(i))
      end do
   end subroutine walk_search

   subroutine walk_sequence(t, solution)
      type(tape), intent(inout) :: t
      type(sequence_solution), intent(inout) :: solution

      call t%pass(solution%is_feasible)
      call t%pass(solution%is_consistent)
      call t%pass(solution%s)
      call t%pass(solution%delta)
      call t%pass(solution%lambda_3)
      call t%pass(solution%correlation, first=0)
      call t%pass(solution%entropy)
      call t%pass(solution%number)
      call t%pass(solution%factor, first=0)
   end subroutine walk_sequence

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

   !> Passes a whole number, exact up to 2**53.
   subroutine long_value(self, value)
      class(tape), intent(inout) :: self
      integer(long), intent(inout) :: value
      real(wp) :: number

      number = real(value, wp)
      call self%real_value(number)
      value = nint(number, long)
   end subroutine long_value

   subroutine logical_value(self, value)
      class(tape), intent(inout) :: self
      logical, intent(inout) :: value
      integer :: number

      number = merge(1, 0, value)
      call self%integer_value(number)
      value = number == 1
   end subroutine logical_value

   !> Passes an array behind its length; -1: not allocated.
   subroutine real_array(self, values, first)
      class(tape), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(in), optional :: first   !! lower bound, else 1
      integer :: lower, n

      lower = 1
      if (present(first)) lower = first
      n = -1
      if (self%is_writing .and. allocated(values)) n = size(values)
      call self%integer_value(n)
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
      call self%pass(value)
      if (present(error)) call self%pass(error)
   end subroutine visit_real

   subroutine visit_integer(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, intent(inout) :: value

      call self%check_name(what)
      call self%pass(value)
   end subroutine visit_integer

   subroutine visit_text(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      character(:), allocatable, intent(inout) :: value
      integer, allocatable :: codes(:)
      integer :: i

      call self%check_name(what)
      if (allocated(value)) codes = [(iachar(value(i:i)), i=1, len(value))]
      call self%pass(codes)
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
      call self%pass(values, what%axis%first)
   end subroutine visit_reals

   subroutine visit_integers(self, what, values)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, allocatable, intent(inout) :: values(:)

      call self%check_name(what)
      call self%pass(values)
   end subroutine visit_integers

   !> Passes the values of a table, then the number of its rows.
   subroutine visit_table(self, what, values, rows)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer, allocatable, intent(inout) :: values(:, :)
      type(axis_type), intent(in) :: rows
      integer, allocatable :: flat(:)
      integer :: n_columns, n_rows

      call self%check_name(what)
      call self%check_name(component(rows%name))
      n_rows = 0
      if (allocated(values)) then
         flat = reshape(values, [size(values)])
         n_rows = size(values, 1)
         deallocate (values)
      end if
      call self%pass(flat)
      call self%pass(n_rows)
      if (.not. allocated(flat)) return
      n_columns = size(flat)/max(1, n_rows)
      values = reshape(flat, [n_rows, n_columns])
   end subroutine visit_table

   subroutine visit_seconds(self, what, value)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      real(wp), intent(inout) :: value

      call self%check_name(what)
      call self%pass(value)
   end subroutine visit_seconds

   !> Stops where another component stands than this one.
   subroutine check_name(self, what)
      class(tape), intent(inout) :: self
      type(component), intent(in) :: what
      integer :: expected, number

      expected = int(modulo(label_of(what%name), 2_long**30))
      number = expected
      call self%pass(number)
      if (number /= expected) error stop 'unpack_model: the row is none of pack_model'
   end subroutine check_name

end module process_packing
