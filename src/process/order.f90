!> Choice of the order of a process, if it is not given (end of Sec. 2.3, Fig. 4).
!>
!> One length is imposed. As the order grows, the entropy grows and the other length moves away: L1
!> grows if L0 is imposed, L0 falls if L1 is imposed. Bounds of the other length leave some orders:
!>    L1 at most, or L0 at least:  all up to one order; the largest is chosen
!>    L1 at least, or L0 at most:  all from one order on; the smallest is chosen
!>    a range:                     all between two orders; the largest is chosen
!> Without bounds the chosen order is the first whose successor gains too little entropy. The paper
!> reads order 6 from Fig. 4 for L0 = 0.3 and L1 <= 1; the infinite sums are L1 = 0.887 at order 5
!> and 1.034 at order 6, so order 5 is chosen here.
!>
!> Lengths are those that the method imposes: infinite sums of an autoregressive process, sums cut
!> at m_max of the direct method. The direct method begins with the smallest feasible order.
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

   real(wp), parameter :: least_gain = 1.0e-3_wp   !! entropy by one more order [nat per point]

contains

   !> Chooses the order: the given one, or for order = 0 the one that the bounds or the gain of
   !> entropy tell. Fails if no order up to `max_order` has the length and keeps the bounds.
   subroutine choose_order(request, order, error)
      type(process_request), intent(in) :: request
      integer, intent(out) :: order
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: higher, model
      type(process_request) :: trial   ! with one order and std 1
      integer :: lowest, n
      logical :: is_bounded, is_found

      order = request%order
      if (order /= 0) return
      is_bounded = request%bounds(1) > 0.0_wp
      if (is_bounded .and. request%correlation == 'both') then
         call raise(error, exit_bad_input, bounds_text(request)// &
                    ': must be absent with both lengths imposed')
         return
      end if
      is_found = .false.
      lowest = merge(2, 1, request%correlation == 'both')
      if (request%method == 'direct') lowest = 1 + certainly_infeasible_m_max(request)
      lowest = min(lowest, request%max_order)   ! an infeasible one gives its own error
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
            if (is_bounded .and. side_of_bounds(request, higher) > 0) return
            if (.not. is_bounded .and. higher%entropy - model%entropy < least_gain) return
         end if
         model = higher
         order = n
         is_found = is_found .or. side_of_bounds(request, model) == 0
         if (side_of_bounds(request, model) > 0) exit
         if (is_found .and. is_bounded .and. .not. limits_order(request)) return
      end do
      if (is_found .and. request%correlation == 'both') then   ! only higher orders failed
         if (allocated(error)) deallocate (error)
      else if (.not. (is_found .or. allocated(error))) then
         call raise_bound(request, order, model, error)
      end if
   end subroutine choose_order

   !> Fits a positive process and chooses its order, beginning with that of the process of any sign:
   !> goes up or down until its own length keeps the bounds, and on to the last order that does.
   !> Refuses the process if no order on the way keeps them.
   subroutine fit_positive_order(request, seed, model)
      type(process_request), intent(in) :: request   !! its order is tried first
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(process_model_type), allocatable :: best
      type(process_request) :: trial
      type(error_type), allocatable :: error
      integer :: last_direction, direction

      trial = request
      call fit_positive(trial, seed, model)
      if (.not. model%is_solved .or. .not. request%bounds(1) > 0.0_wp) return
      last_direction = 0
      do
         direction = -side_of_bounds(request, model)
         if (direction == 0) then
            best = model
            direction = merge(1, -1, limits_order(request))
         end if
         if (direction == -last_direction) exit
         last_direction = direction
         trial%order = trial%order + last_direction
         if (trial%order < 1 .or. trial%order > request%max_order) exit
         call fit_positive(trial, seed, model)
         if (.not. model%is_solved) exit
      end do
      if (allocated(best)) then
         model = best
      else if (model%is_solved) then
         call raise_bound(request, model%order, model, error)
         model%is_solved = .false.
         model%reason = error%message
      end if
   end subroutine fit_positive_order

   !> Raises the error that no order keeps the bounds, with the nearest bound that is kept.
   pure subroutine raise_bound(request, order, model, error)
      type(process_request), intent(in) :: request
      integer, intent(in) :: order
      type(process_model_type), intent(in) :: model   !! model that is nearest to the bound
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_no_solution, bounds_text(request)//': no order up to '// &
                 to_text(request%max_order)//' keeps it with '//lengths_of(request)// &
                 '; the nearest bound that is kept is '// &
                 to_text(other_length(request, model))//', by order '//to_text(order))
   end subroutine raise_bound

   !> True if the bounds limit the order from above.
   pure logical function limits_order(request)
      type(process_request), intent(in) :: request

      associate (interval => interval_of(request))
         limits_order = merge(interval(2) < huge(1.0_wp), interval(1) > 0.0_wp, &
                              request%correlation == 'L0')
      end associate
   end function limits_order

   !> -1 if the order is below those that keep the bounds, 0 if it keeps them, 1 if it is above. A
   !> length keeps a bound that it reaches within two standard errors.
   pure integer function side_of_bounds(request, model) result(side)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model
      real(wp), parameter :: slack = 1.0e-9_wp, n_errors = 2.0_wp
      real(wp) :: error, interval(2)

      error = n_errors*merge(model%l1_error, model%l0_error, request%correlation == 'L0')
      interval = interval_of(request)
      side = 0
      associate (length => other_length(request, model))
         if (length + error < (1.0_wp - slack)*interval(1)) side = -1
         if (length - error - interval(2) > slack*interval(2)) side = 1
      end associate
      if (request%correlation == 'L1') side = -side   ! L0 falls as the order grows
   end function side_of_bounds

   !> Lower and upper bound of the length that is not imposed; 0 and huge if there is none.
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

   !> Length that is not imposed [lags].
   pure real(wp) function other_length(request, model) result(length)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model

      if (request%method == 'direct') then
         length = merge(model%l1_cut, model%l0_cut, request%correlation == 'L0')
      else
         length = merge(model%l1, model%l0, request%correlation == 'L0')
      end if
   end function other_length

   !> 'bound_l1 = 1.0', or with both bounds of a range, for messages.
   pure function bounds_text(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = merge('bound_l1', 'bound_l0', request%correlation == 'L0')//' = '// &
             to_text(request%bounds(1))
      if (request%bounds(2) > 0.0_wp) text = text//', '//to_text(request%bounds(2))
   end function bounds_text

end module process_order
