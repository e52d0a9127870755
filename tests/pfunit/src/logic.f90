!> Assertions on logicals, strings, exceptions and the state of a real: no templates needed.
module funit_logic
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
   use, intrinsic :: iso_fortran_env, only: real32, real64
   use funit_compare, only: fail
   use funit_exceptions, only: catch, SourceLocation
   implicit none(type, external)
   private
   public :: assertAll, assertAny, assertEqual, assertEquivalent, assertExceptionRaised
   public :: assertFail, assertFalse, assertIsFinite, assertIsNaN, assertNone, assertNotAll
   public :: assertSameShape, assertTrue

   interface assertTrue
      module procedure assert_true, assertAll
   end interface assertTrue

   interface assertFalse
      module procedure assert_false, assertNone
   end interface assertFalse

   interface assertEqual
      module procedure assert_same_string, assertEquivalent
   end interface assertEqual

   interface assertIsNaN
      module procedure assert_nan_real32, assert_nan_real64
   end interface assertIsNaN

   interface assertIsFinite
      module procedure assert_finite_real32, assert_finite_real64
   end interface assertIsFinite

contains

   subroutine assert_true(condition, message, location)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. condition) call fail('wanted .true.', message, location)
   end subroutine assert_true

   subroutine assert_false(condition, message, location)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (condition) call fail('wanted .false.', message, location)
   end subroutine assert_false

   subroutine assertAll(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. all(conditions)) call fail('wanted all .true.', message, location)
   end subroutine assertAll

   subroutine assertAny(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. any(conditions)) call fail('wanted at least one .true.', message, location)
   end subroutine assertAny

   subroutine assertNone(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (any(conditions)) call fail('wanted all .false.', message, location)
   end subroutine assertNone

   subroutine assertNotAll(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (all(conditions)) call fail('wanted at least one .false.', message, location)
   end subroutine assertNotAll

   !> The location first: a message is passed by name.
   subroutine assertEquivalent(expected, actual, location, message)
      logical, intent(in) :: expected, actual
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (expected .eqv. actual) return
      call fail(merge('wanted .true. ', 'wanted .false.', expected), message, location)
   end subroutine assertEquivalent

   !> Blanks on both ends do not count.
   subroutine assert_same_string(expected, actual, message, location)
      character(*), intent(in) :: expected, actual
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (trim(adjustl(expected)) == trim(adjustl(actual))) return
      call fail('wanted "'//trim(adjustl(expected))//'", found "'//trim(adjustl(actual))//'"', &
         message, location)
   end subroutine assert_same_string

   subroutine assert_nan_real32(x, message, location)
      real(real32), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. ieee_is_nan(x)) call fail('wanted NaN', message, location)
   end subroutine assert_nan_real32

   subroutine assert_nan_real64(x, message, location)
      real(real64), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. ieee_is_nan(x)) call fail('wanted NaN', message, location)
   end subroutine assert_nan_real64

   subroutine assert_finite_real32(x, message, location)
      real(real32), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. ieee_is_finite(x)) call fail('wanted a finite number', message, location)
   end subroutine assert_finite_real32

   subroutine assert_finite_real64(x, message, location)
      real(real64), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (.not. ieee_is_finite(x)) call fail('wanted a finite number', message, location)
   end subroutine assert_finite_real64

   subroutine assertSameShape(expected, actual, message, location)
      integer, intent(in) :: expected(:), actual(:)   !! shapes
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (size(expected) == size(actual)) then
         if (all(expected == actual)) return
      end if
      call fail('wanted equal shapes', message, location)
   end subroutine assertSameShape

   !> Catches what was thrown; with a message, only an exception of that message.
   subroutine assertExceptionRaised(message, location)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (present(message)) then
         if (.not. catch(message)) call fail('wanted an exception: '//message, location=location)
      else
         if (.not. catch()) call fail('wanted an exception', location=location)
      end if
   end subroutine assertExceptionRaised

   subroutine assertFail(message, location)
      character(*), intent(in) :: message
      type(SourceLocation), intent(in), optional :: location

      call fail(message, location=location)
   end subroutine assertFail

end module funit_logic
