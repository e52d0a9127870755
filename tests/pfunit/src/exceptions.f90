!> What has been thrown in the running test on this process, and where.
module funit_exceptions
   implicit none(type, external)
   private
   public :: SourceLocation, exception_type, throw, catch, anyExceptions, take_exceptions

   type :: SourceLocation
      character(:), allocatable :: file
      integer :: line = 0   !! 0: unknown
   end type SourceLocation

   type :: exception_type
      character(:), allocatable :: message
      type(SourceLocation) :: location
   end type exception_type

   interface catch
      module procedure catch_first, catch_message
   end interface catch

   type(exception_type), allocatable :: thrown(:)

contains

   subroutine throw(message, location)
      character(*), intent(in) :: message
      type(SourceLocation), intent(in), optional :: location
      type(exception_type), allocatable :: longer(:)
      integer :: n

      n = count_thrown()
      allocate (longer(n + 1))
      if (n > 0) longer(:n) = thrown
      longer(n + 1)%message = message
      if (present(location)) longer(n + 1)%location = location
      call move_alloc(longer, thrown)
   end subroutine throw

   logical function anyExceptions()
      anyExceptions = count_thrown() > 0
   end function anyExceptions

   !> Forget the first exception; false when there is none.
   logical function catch_first() result(caught)
      caught = anyExceptions()
      if (caught) call forget(1)
   end function catch_first

   !> Forget the first exception with this message; false when there is none.
   logical function catch_message(message) result(caught)
      character(*), intent(in) :: message
      integer :: i

      caught = .false.
      do i = 1, count_thrown()
         caught = thrown(i)%message == message
         if (.not. caught) cycle
         call forget(i)
         return
      end do
   end function catch_message

   !> Hand over everything thrown so far and start afresh.
   subroutine take_exceptions(taken)
      type(exception_type), allocatable, intent(out) :: taken(:)

      if (anyExceptions()) then
         call move_alloc(thrown, taken)
      else
         allocate (taken(0))
      end if
   end subroutine take_exceptions

   integer function count_thrown()
      count_thrown = 0
      if (allocated(thrown)) count_thrown = size(thrown)
   end function count_thrown

   subroutine forget(i)
      integer, intent(in) :: i
      type(exception_type), allocatable :: shorter(:)

      allocate (shorter(size(thrown) - 1))
      shorter(:i - 1) = thrown(:i - 1)
      shorter(i:) = thrown(i + 1:)
      call move_alloc(shorter, thrown)
   end subroutine forget

end module funit_exceptions
