!> What a .pf file gets from `use funit`.
module funit
   use funit_cases, only: AbstractTestParameter, ParameterizedTestCase, TestCase
   use funit_context, only: anyExceptions, ParallelContext
   use funit_exceptions, only: catch, SourceLocation, throw
   use funit_logic, only: assertAll, assertAny, assertEqual, assertEquivalent, &
      assertExceptionRaised, assertFail, assertFalse, assertIsFinite, assertIsNaN, assertNone, &
      assertNotAll, assertSameShape, assertTrue
   use funit_numbers, only: assertEqual, assertGreaterThan, assertGreaterThanOrEqual, &
      assertLessThan, assertLessThanOrEqual, assertNotEqual, assertRelativelyEqual
   implicit none(type, external)
   public
end module funit
