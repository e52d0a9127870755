!> The processes that take part in a test, as funit knows them without knowing MPI.
module funit_context
   use funit_exceptions, only: any_here => anyExceptions
   implicit none(type, external)
   private
   public :: anyExceptions, ParallelContext

   type, abstract :: ParallelContext
   contains
      procedure(any_of_interface), deferred :: any_of
   end type ParallelContext

   abstract interface
      !> Collective: is it so on any process?
      logical function any_of_interface(this, mine)
         import :: ParallelContext
         implicit none(type, external)
         class(ParallelContext), intent(in) :: this
         logical, intent(in) :: mine
      end function any_of_interface
   end interface

   !> Has the running test thrown: on this process, or (collective) on any process of a context.
   interface anyExceptions
      procedure any_here, any_in_context
   end interface anyExceptions

contains

   logical function any_in_context(context) result(thrown)
      class(ParallelContext), intent(in) :: context

      thrown = context%any_of(any_here())
   end function any_in_context

end module funit_context
