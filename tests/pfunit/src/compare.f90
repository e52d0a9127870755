!> The comparisons behind the assertions: operands as lists of the widest kind, with their shapes.
module funit_compare
   use, intrinsic :: ieee_exceptions, only: ieee_all, ieee_get_halting_mode, ieee_set_flag, &
      ieee_set_halting_mode
   use, intrinsic :: iso_fortran_env, only: int64, real64
   use funit_exceptions, only: SourceLocation, throw
   implicit none(type, external)
   private
   public :: compare, extents, fail

   !> Throws unless every pair of elements fulfils the relation; an lhs of rank 0 meets every rhs.
   interface compare
      module procedure compare_integers, compare_reals, compare_complexes
   end interface compare

   !> `~=` is |rhs - lhs| <= tolerance*|lhs|, and never holds for lhs = 0; in `==` and `/=` the
   !! tolerance is absolute.
   interface holds
      module procedure holds_integer, holds_real, holds_complex
   end interface holds

   interface text
      module procedure text_of_integer, text_of_real, text_of_complex
   end interface text

contains

   subroutine compare_integers(lhs, relation, rhs, lhs_shape, rhs_shape, message, location)
      integer(int64), intent(in) :: lhs(:), rhs(:)
      character(*), intent(in) :: relation
      integer, intent(in) :: lhs_shape(:), rhs_shape(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      integer :: i, j

      if (.not. conformable(lhs_shape, rhs_shape, message, location)) return
      do i = 1, size(rhs)
         j = min(i, size(lhs))
         if (holds(lhs(j), relation, rhs(i))) cycle
         call fail(wanted(text(lhs(j)), relation, text(rhs(i)), i, rhs_shape), message, location)
         return
      end do
   end subroutine compare_integers

   subroutine compare_reals(lhs, relation, rhs, lhs_shape, rhs_shape, tolerance, message, location)
      real(real64), intent(in) :: lhs(:), rhs(:)
      character(*), intent(in) :: relation
      integer, intent(in) :: lhs_shape(:), rhs_shape(:)
      real(real64), intent(in) :: tolerance
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      logical :: traps(size(ieee_all))
      integer :: i, j

      if (.not. conformable(lhs_shape, rhs_shape, message, location)) return
      call close_traps(traps)
      do i = 1, size(rhs)
         j = min(i, size(lhs))
         if (holds(lhs(j), relation, rhs(i), tolerance)) cycle
         call fail(wanted(text(lhs(j)), relation, text(rhs(i)), i, rhs_shape) &
            //'; difference '//text(rhs(i) - lhs(j))//', tolerance '//text(tolerance), &
            message, location)
         exit
      end do
      call open_traps(traps)
   end subroutine compare_reals

   subroutine compare_complexes(lhs, relation, rhs, lhs_shape, rhs_shape, tolerance, message, &
      location)
      complex(real64), intent(in) :: lhs(:), rhs(:)
      character(*), intent(in) :: relation
      integer, intent(in) :: lhs_shape(:), rhs_shape(:)
      real(real64), intent(in) :: tolerance
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      logical :: traps(size(ieee_all))
      integer :: i, j

      if (.not. conformable(lhs_shape, rhs_shape, message, location)) return
      call close_traps(traps)
      do i = 1, size(rhs)
         j = min(i, size(lhs))
         if (holds(lhs(j), relation, rhs(i), tolerance)) cycle
         call fail(wanted(text(lhs(j)), relation, text(rhs(i)), i, rhs_shape) &
            //'; modulus of the difference '//text(abs(rhs(i) - lhs(j))) &
            //', tolerance '//text(tolerance), message, location)
         exit
      end do
      call open_traps(traps)
   end subroutine compare_complexes

   !> From here to open_traps NaN and overflow are verdicts, not accidents.
   subroutine close_traps(traps)
      logical, intent(out) :: traps(:)   !! as they were

      call ieee_get_halting_mode(ieee_all, traps)
      call ieee_set_halting_mode(ieee_all, .false.)
   end subroutine close_traps

   !> Not left to the end of a procedure: gfortran 12 restores nothing there when it is the module
   !! that uses ieee_exceptions.
   subroutine open_traps(traps)
      logical, intent(in) :: traps(:)

      call ieee_set_flag(ieee_all, .false.)   ! a raised flag would trap late
      call ieee_set_halting_mode(ieee_all, traps)
   end subroutine open_traps

   !> The shape of an operand: of a scalar's, gfortran 11 frees what it has not allocated.
   pure function extents(operand) result(list)
      type(*), intent(in) :: operand(..)
      integer, allocatable :: list(:)
      integer :: i

      list = [(size(operand, i), i=1, rank(operand))]
   end function extents

   !> Throw: the user's message, if any, and below it what was found.
   subroutine fail(finding, message, location)
      character(*), intent(in) :: finding
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (present(message)) then
         call throw(message//new_line('a')//'  '//finding, location)
      else
         call throw(finding, location)
      end if
   end subroutine fail

   logical function conformable(lhs_shape, rhs_shape, message, location)
      integer, intent(in) :: lhs_shape(:), rhs_shape(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      conformable = size(lhs_shape) == 0
      if (size(lhs_shape) == size(rhs_shape)) then
         ! gfortran has -1 for the last extent of an expression without elements
         conformable = all(max(lhs_shape, 0) == max(rhs_shape, 0))
      end if
      if (conformable) return
      call fail('Arrays not conformable: shapes '//text_of_list(lhs_shape)//' and ' &
         //text_of_list(rhs_shape), message, location)
   end function conformable

   pure logical function holds_integer(lhs, relation, rhs) result(holds)
      integer(int64), intent(in) :: lhs, rhs
      character(*), intent(in) :: relation

      select case (relation)
      case ('=='); holds = lhs == rhs
      case ('/='); holds = lhs /= rhs
      case ('<'); holds = lhs < rhs
      case ('<='); holds = lhs <= rhs
      case ('>'); holds = lhs > rhs
      case ('>='); holds = lhs >= rhs
      case default; error stop 'funit_compare: unknown relation of integers'
      end select
   end function holds_integer

   pure logical function holds_real(lhs, relation, rhs, tolerance) result(holds)
      real(real64), intent(in) :: lhs, rhs, tolerance
      character(*), intent(in) :: relation

      select case (relation)
      case ('=='); holds = lhs == rhs .or. abs(rhs - lhs) <= tolerance   ! Inf equals Inf
      case ('/='); holds = abs(rhs - lhs) > tolerance
      case ('~='); holds = abs(lhs) > 0 .and. abs(rhs - lhs) <= tolerance*abs(lhs)
      case ('<'); holds = lhs < rhs
      case ('<='); holds = lhs <= rhs
      case ('>'); holds = lhs > rhs
      case ('>='); holds = lhs >= rhs
      case default; error stop 'funit_compare: unknown relation of reals'
      end select
   end function holds_real

   pure logical function holds_complex(lhs, relation, rhs, tolerance) result(holds)
      complex(real64), intent(in) :: lhs, rhs
      character(*), intent(in) :: relation
      real(real64), intent(in) :: tolerance

      select case (relation)
      case ('=='); holds = lhs == rhs .or. abs(rhs - lhs) <= tolerance
      case ('/='); holds = abs(rhs - lhs) > tolerance
      case default; error stop 'funit_compare: unknown relation of complex numbers'
      end select
   end function holds_complex

   !> For example `wanted 1.0 == 1.1 at element [2, 1]`.
   pure function wanted(lhs, relation, rhs, i, shape) result(finding)
      character(*), intent(in) :: lhs, relation, rhs
      integer, intent(in) :: i          !! position in the flattened array
      integer, intent(in) :: shape(:)
      character(:), allocatable :: finding
      integer :: index(size(shape)), left, k

      finding = 'wanted '//lhs//' '//relation//' '//rhs
      if (size(shape) == 0) return
      left = i - 1
      do k = 1, size(shape)
         index(k) = 1 + mod(left, shape(k))
         left = left/shape(k)
      end do
      finding = finding//' at element '//text_of_list(index)
   end function wanted

   pure function text_of_list(list) result(text)
      integer, intent(in) :: list(:)
      character(:), allocatable :: text
      character(12*size(list) + 2) :: buffer

      write (buffer, '("[",*(i0,:,", "))') list
      text = trim(buffer)//']'
   end function text_of_list

   pure function text_of_integer(x) result(text)
      integer(int64), intent(in) :: x
      character(:), allocatable :: text
      character(20) :: buffer

      write (buffer, '(i0)') x
      text = trim(buffer)
   end function text_of_integer

   pure function text_of_real(x) result(text)
      real(real64), intent(in) :: x
      character(:), allocatable :: text
      character(32) :: buffer

      write (buffer, '(g0)') x
      text = trim(buffer)
   end function text_of_real

   pure function text_of_complex(x) result(text)
      complex(real64), intent(in) :: x
      character(:), allocatable :: text

      text = '('//text_of_real(x%re)//', '//text_of_real(x%im)//')'
   end function text_of_complex

end module funit_compare
