!> What exists where a positive process is refused: an order contains all lower ones, so that the
!> limit named must not hide what they reach.
module process_positive_refusal
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: search_result
   use process_model, only: process_request
   use process_positive_approach, only: approach, end_of_family, find_shape
   use process_positive_first_order, only: find_limit, stated
   use process_positive_law, only: positive_law
   implicit none(type, external)
   private
   public :: name_what_exists

contains

   !> Adds to a refusal where the family ends that the search has left behind, how far order 1 goes
   !> with either sign of K(1), and the highest order that has the request. The direct method's
   !> orders do not contain each other.
   subroutine name_what_exists(request, seed, passed_limit, error)
      type(process_request), intent(in) :: request   !! of order 2 or more
      integer(long), intent(in) :: seed
      real(wp), intent(in) :: passed_limit           !! see `approach`
      type(error_type), allocatable, intent(inout) :: error
      type(error_type), allocatable :: unknown
      character(:), allocatable :: message
      integer :: order
      real(wp) :: farther, limit

      if (request%method == 'direct' .or. error%exit_code /= exit_no_solution .or. &
          .not. request%mean > 0.0_wp) return
      message = error%message
      if (passed_limit > 0.0_wp) message = message//'; '//end_of_family(passed_limit)
      call find_limit(request, .false., limit, unknown)
      if (allocated(unknown)) return
      message = message//'; order = 1 has them up to '//stated(limit)//' with K(m) >= 0'
      if (request%branch == 'any') then
         call find_limit(request, .true., farther, unknown)
         if (allocated(unknown)) return
         if (farther < huge(farther)) then
            message = message//', up to '//stated(farther)
         else
            message = message//', beyond any limit'
         end if
         message = message//' with alternating K(m), which higher orders are not searched for'
      end if
      order = 1
      if (request%std <= limit*request%mean) order = highest_order(request, seed)
      if (order > 1) message = message//', order = '//to_text(order)//' has this one'
      call raise(error, exit_no_solution, message)
   end subroutine name_what_exists

   !> Of the orders below the request's that have a process of its ratio and length; order 1 has.
   !> What is in reach becomes less as the order grows.
   function highest_order(request, seed) result(order)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      integer :: order
      class(positive_law), allocatable :: law
      type(error_type), allocatable :: error
      type(process_request) :: lower
      type(search_result) :: found
      real(wp), parameter :: most_effort = 3.0e8_wp   ! each, of some five orders tried
      real(wp), allocatable :: point(:)
      integer :: refused

      order = 1
      refused = request%order
      lower = request
      do while (refused - order > 1)
         lower%order = (order + refused)/2
         call approach(lower, seed, law, point, found, error, most_effort)
         if (.not. allocated(error)) call find_shape(law, point, found, error)
         if (allocated(error)) then
            refused = lower%order
         else
            order = lower%order
         end if
      end do
   end function highest_order

end module process_positive_refusal
