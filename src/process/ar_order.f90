!> The autoregressive order, where it is not given: the paper's second criterion (end of Sec. 2.3,
!> Fig. 4).
!>
!> One length is imposed and the two drift apart as the order grows: with L0 imposed L1 grows, with
!> L1 imposed L0 falls. A bound of the other one (L1 at most, or L0 at least) leaves the orders up
!> to one; the entropy grows with the order, so the largest is taken. The paper reads order 6 off
!> Fig. 4 for L0 = 0.3 and L1 <= 1; the infinite sums are L1 = 0.887 at order 5 and 1.034 at order
!> 6, so it is 5. Without a bound the order is taken after which one more order gains too little
!> entropy.
module process_ar_order
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use process_ar_fit, only: fit_ar
   use process_model, only: process_model_type, process_request
   implicit none(type, external)
   private
   public :: choose_order, least_gain

   real(wp), parameter :: least_gain = 1.0e-3_wp   !! of entropy by one more order [nat per point]

contains

   !> The request's own order, or for order = 0 the chosen one, at most `max_order`. Fails when not
   !! even order 1 keeps the bound.
   subroutine choose_order(request, order, error)
      type(process_request), intent(in) :: request
      integer, intent(out) :: order
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: higher, model
      logical :: is_enough

      order = request%order
      if (order /= 0) return
      call check_bounds(request, error)
      if (allocated(error)) return
      call fit_ar(request%correlation, request%correlation_length, 1, 1.0_wp, model, error)
      if (allocated(error)) return
      if (.not. keeps_bound(request, model)) then   ! both lengths are equal at order 1
         call raise(error, exit_no_solution, name_of_bound(request)//' = '// &
                    to_text(bound_of(request))//': no order keeps it with '//request%correlation// &
                    ' = '//to_text(request%correlation_length)//', the nearest bound that is kept')
         return
      end if
      do order = 1, request%max_order - 1
         call fit_ar(request%correlation, request%correlation_length, order + 1, 1.0_wp, higher, &
                     error)
         if (allocated(error)) return
         if (bound_of(request) > 0.0_wp) then
            is_enough = .not. keeps_bound(request, higher)
         else
            is_enough = higher%entropy - model%entropy < least_gain
         end if
         if (is_enough) return
         model = higher
      end do
   end subroutine choose_order

   !> A bound of the length that is imposed is a mistake.
   pure subroutine check_bounds(request, error)
      type(process_request), intent(in) :: request
      type(error_type), allocatable, intent(out) :: error

      if (request%max_order < 1) then
         call raise(error, exit_bad_input, 'max_order = '//to_text(request%max_order)// &
                    ': must be at least 1')
      else if (request%correlation == 'L0' .and. request%bound_l0 > 0.0_wp) then
         call raise(error, exit_bad_input, 'bound_l0 = '//to_text(request%bound_l0)// &
                    ': L0 is imposed, only L1 can be bounded')
      else if (request%correlation == 'L1' .and. request%bound_l1 > 0.0_wp) then
         call raise(error, exit_bad_input, 'bound_l1 = '//to_text(request%bound_l1)// &
                    ': L1 is imposed, only L0 can be bounded')
      end if
   end subroutine check_bounds

   pure function keeps_bound(request, model) result(does_keep)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model
      logical :: does_keep
      real(wp), parameter :: slack = 1.0e-9_wp   ! a bound equal to the length itself is kept

      if (.not. bound_of(request) > 0.0_wp) then
         does_keep = .true.
      else if (request%correlation == 'L0') then
         does_keep = model%l1 <= (1.0_wp + slack)*request%bound_l1
      else
         does_keep = model%l0 >= (1.0_wp - slack)*request%bound_l0
      end if
   end function keeps_bound

   pure function bound_of(request) result(bound)
      type(process_request), intent(in) :: request
      real(wp) :: bound

      bound = merge(request%bound_l1, request%bound_l0, request%correlation == 'L0')
   end function bound_of

   pure function name_of_bound(request) result(name)
      type(process_request), intent(in) :: request
      character(8) :: name

      name = merge('bound_l1', 'bound_l0', request%correlation == 'L0')
   end function name_of_bound

end module process_ar_order
