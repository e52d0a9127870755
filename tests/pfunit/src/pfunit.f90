!> What a .pf file gets from `use pfunit`: the MPI tests.
module pfunit
   use pfunit_cases, only: MpiTestCase, MpiTestMethod, MpiTestParameter
   use pfunit_context, only: MpiContext
   implicit none(type, external)
   public
end module pfunit
