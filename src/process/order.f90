!> The order, where it is not given: the paper's second criterion (end of Sec. 2.3, Fig. 4).
!>
!> One length is imposed and the two drift apart as the order grows: with L0 imposed L1 grows, with
!> L1 imposed L0 falls. A bound on the drift (L1 at most, or L0 at least) leaves the orders up to
!> one; the entropy grows with the order, so the largest is taken. A bound from the other side (L1
!> at least, or L0 at most) leaves the orders from one on, and the smallest is taken. A range leaves
!> the orders between two, and the largest is taken. The paper reads order 6 off Fig. 4 for L0 = 0.3
!> and L1 <= 1; the infinite sums are L1 = 0.887 at order 5 and 1.034 at order 6, so it is 5.
!> Without a bound the order is taken after which one more order gains too little entropy.
!>
!> The lengths are the ones that the method imposes: infinite sums of an autoregressive process,
!> cut at m_max those of the direct method, whose orders begin with the first that is feasible.
module process_order
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use process_direct_fit, only: fit_unconstrained
   use process_direct_limits, only: certainly_infeasible_m_max
   use process_model, only: lengths_of, process_model_type, process_request
   use process_positive_fit, only: fit_positive
   implicit none(type, external)
   private
   public :: choose_order, fit_positive_order, least_gain

   real(wp), parameter :: least_gain = 1.0e-3_wp   !! of entropy by one more order [nat per point]

contains

   !> Chooses the order: the request's own, or for order = 0 by its bounds or the gain of entropy,
   !> at most `max_order`. Fails when no order up to there has the length and keeps the bounds.
   subroutine choose_order(request, order, error)
      type(process_request), intent(in) :: request
      integer, intent(out) :: order
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: higher, model
      type(process_request) :: trial   ! of one order, and std 1
      integer :: lowest, n
      logical :: is_bounded, is_found

      order = request%order
      if (order /= 0) return
      is_bounded = request%bounds(1) > 0.0_wp
      if (is_bounded .and. request%correlation == 'both') then
         call raise(error, exit_bad_input, bounds_of(request)// &
                    ': must be absent with both lengths imposed')
         return
      end if
      is_found = .false.
      lowest = merge(2, 1, request%correlation == 'both')
      if (request%method == 'direct') lowest = 1 + certainly_infeasible_m_max(request)
      lowest = min(lowest, request%max_order)   ! refused in its own words
      trial = request
      trial%std = 1.0_wp
      trial%all_signs = .false.
      do n = lowest, request%max_order
         trial%order = n
         call fit_unconstrained(trial, higher, error)
         if (allocated(error) .and. order == 0 .and. &
             (request%method == 'direct' .or. request%correlation == 'both')) cycle
         if (allocated(error)) exit
         if (is_found) then
            if (is_bounded .and. place_of(request, higher) > 0) return
            if (.not. is_bounded .and. higher%entropy - model%entropy < least_gain) return
         end if
         model = higher
         order = n
         is_found = is_found .or. place_of(request, model) == 0
         if (place_of(request, model) > 0) exit
         if (is_found .and. is_bounded .and. .not. limits_drift(request)) return
      end do
      if (is_found .and. request%correlation == 'both') then   ! lower ones may have both
         if (allocated(error)) deallocate (error)
      else if (.not. (is_found .or. allocated(error))) then
         call refuse_bound(request, order, model, error)
      end if
   end subroutine choose_order

   !> Fits a positive process whose order is to be found, from that of the process of any sign on:
   !> its own length decides which orders keep the bounds. Refused where none of those tried does.
   subroutine fit_positive_order(request, seed, model)
      type(process_request), intent(in) :: request   !! with the order to begin with
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(process_model_type), allocatable :: best
      type(process_request) :: trial
      type(error_type), allocatable :: error
      integer :: step, way

      trial = request
      call fit_positive(trial, seed, model)
      if (.not. model%is_solved .or. .not. request%bounds(1) > 0.0_wp) return
      step = 0
      do
         way = -place_of(request, model)
         if (way == 0) then
            best = model
            way = merge(1, -1, limits_drift(request))
         end if
         if (way == -step) exit
         step = way
         trial%order = trial%order + step
         if (trial%order < 1 .or. trial%order > request%max_order) exit
         call fit_positive(trial, seed, model)
         if (.not. model%is_solved) exit
      end do
      if (allocated(best)) then
         model = best
      else if (model%is_solved) then
         call refuse_bound(request, model%order, model, error)
         model%is_solved = .false.
         model%reason = error%message
      end if
   end subroutine fit_positive_order

   !> Says what the nearest bound is that is kept.
   pure subroutine refuse_bound(request, order, model, error)
      type(process_request), intent(in) :: request
      integer, intent(in) :: order
      type(process_model_type), intent(in) :: model   !! of this order, the nearest to the bound
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_no_solution, bounds_of(request)//': no order up to '// &
                 to_text(request%max_order)//' keeps it with '//lengths_of(request)// &
                 '; the nearest bound that is kept is '// &
                 to_text(other_length(request, model))//', by order '//to_text(order))
   end subroutine refuse_bound

   !> True if a bound ends the orders that keep it, rather than only begins them.
   pure logical function limits_drift(request)
      type(process_request), intent(in) :: request

      associate (interval => interval_of(request))
         limits_drift = merge(interval(2) < huge(1.0_wp), interval(1) > 0.0_wp, &
                              request%correlation == 'L0')
      end associate
   end function limits_drift

   !> Place of the drift: -1 before the orders that keep the bounds, 0 among them, 1 beyond. A
   !> length that equals a bound keeps it, within its error.
   pure integer function place_of(request, model) result(place)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model
      real(wp), parameter :: slack = 1.0e-9_wp, errors = 2.0_wp
      real(wp) :: error, interval(2)

      error = errors*merge(model%l1_error, model%l0_error, request%correlation == 'L0')
      interval = interval_of(request)
      place = 0
      associate (length => other_length(request, model))
         if (length + error < (1.0_wp - slack)*interval(1)) place = -1
         if (length - error - interval(2) > slack*interval(2)) place = 1
      end associate
      if (request%correlation == 'L1') place = -place   ! L0 falls as the order grows
   end function place_of

   !> Lower and upper bound of the other length; 0 and huge where there is none.
   pure function interval_of(request) result(interval)
      type(process_request), intent(in) :: request
      real(wp) :: interval(2)
      logical :: is_upper

      interval = [0.0_wp, huge(1.0_wp)]
      if (.not. request%bounds(1) > 0.0_wp) return
      is_upper = merge(request%correlation == 'L0', request%bound_side == 'upper', &
                       request%bound_side == 'automatic')
      if (request%bounds(2) > 0.0_wp) then
         interval = request%bounds
      else
         interval(merge(2, 1, is_upper)) = request%bounds(1)
      end if
   end function interval_of

   !> The length that is not imposed.
   pure function other_length(request, model) result(length)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model
      real(wp) :: length

      if (request%method == 'direct') then
         length = merge(model%l1_cut, model%l0_cut, request%correlation == 'L0')
      else
         length = merge(model%l1, model%l0, request%correlation == 'L0')
      end if
   end function other_length

   !> 'bound_l1 = 1.0', or with both bounds of a range, for messages.
   pure function bounds_of(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = merge('bound_l1', 'bound_l0', request%correlation == 'L0')//' = '// &
             to_text(request%bounds(1))
      if (request%bounds(2) > 0.0_wp) text = text//', '//to_text(request%bounds(2))
   end function bounds_of

end module process_order
