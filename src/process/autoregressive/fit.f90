!> Fit of the autoregressive process of largest entropy for an order M, a std and one or both
!> correlation lengths (Sec. 2.3).
!>
!> The entropy is ln std + 0.5 sum ln(1 - kappa_m^2) plus a constant. If K(m) >= 0 at every lag, the
!> lengths are closed forms of v_m = ln(R_M/R_m), R_m of `process_autoregressive_sums`:
!>    L0 = (exp(v_0) - 1)/2,      L1 = sum_(m<M) sinh(v_m)/(1 + exp(-v_0)).
!> With L0 imposed, all kappa_m are equal at the maximum. With L1 imposed, it is the maximum of
!>    - sum ln cosh((v_(m-1) - v_m)/2) + nu (sum_(m<M) sinh(v_m) - L1 (1 + exp(-v_0))),
!> and with both lengths v_0 is fixed too. The conditions of the maximum give all v_m from v_(M-1)
!> and the multiplier nu, which two nested searches find. K(m) >= 0 is checked on the result. If no
!> such process has both lengths, `process_autoregressive_search` looks for one with K(m) of either
!> sign or 0. The tests search for processes of larger entropy, and find none.
module process_autoregressive_fit
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: projected_gradient
   use numerics_elementary, only: log_one_plus
   use numerics_roots, only: root_search
   use process_autoregressive_description, only: describe_ar
   use process_autoregressive_model, only: coefficients_of, innovation_std
   use process_autoregressive_search, only: both_lengths_maximum, find_feasible_maximum
   use process_autoregressive_sums, only: correlation_sums, positive_gradient, sum_correlation
   use process_model, only: gaussian_entropy, lengths_of, process_model_type, process_request
   implicit none(type, external)
   private
   public :: broken_rule, equal_reflection, fit_ar, nonnegative_reflection, optimal_reflection

   real(wp), parameter :: length_tolerance = 1.0e-10_wp      !! relative error of a length
   real(wp), parameter :: optimality_tolerance = 1.0e-8_wp   !! residual of optimality conditions
   real(wp), parameter :: search_tolerance = 1.0e-2_wp       !! residual of smoothed lengths
   real(wp), parameter :: entropy_tolerance = 1.0e-5_wp      !! entropy of smoothed lengths [nat]
   real(wp), parameter :: longest_length = 1.0e6_wp          !! [lags]
   integer, parameter :: max_steps = 200                     !! steps of a search for a root
   real(wp), parameter :: first_step = 0.1_wp                !! first step of a search

contains

   !> Fits the process and fills its model. Fails if the request is invalid or the result is not a
   !> maximum.
   subroutine fit_ar(request, model, error)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      type(correlation_sums) :: sums
      type(both_lengths_maximum) :: best
      real(wp), allocatable :: kappa(:)
      real(wp) :: length_error

      call optimal_reflection(request, kappa, error)
      if (allocated(error)) return
      call sum_correlation(kappa, sums, error)
      length_error = length_error_of(request, sums)
      if (request%correlation == 'both' .and. .not. (sums%is_nonnegative .and. &
                                                     length_error <= length_tolerance)) then
         call find_feasible_maximum([request%correlation_length, request%second_length], &
                           equal_reflection(request%correlation_length, request%order), best)
         associate (lower => nonnegative_reflection(request))
            if (size(lower) > 0) &   ! a process of lower order is one of this order too
               best%is_feasible = best%is_feasible .and. &
                                  best%entropy > gaussian_entropy(innovation_std(lower, 1.0_wp)) - &
                                  entropy_tolerance
         end associate
         if (best%is_feasible) then
            kappa = best%kappa
            call sum_correlation(kappa, sums, error)
            length_error = length_error_of(request, sums)
         end if
      end if
      if (allocated(error)) return
      call describe_ar(coefficients_of(kappa), innovation_std(kappa, request%std), model, error, &
                       sums)
      if (allocated(error)) return
      if (best%is_feasible) then
         model%optimality = max(best%residual, length_error)
         model%is_solved = model%optimality <= search_tolerance
      else
         model%optimality = max(optimality_residual(request%correlation, kappa), length_error)
         model%is_solved = sums%is_nonnegative .and. length_error <= length_tolerance .and. &
                           model%optimality <= optimality_tolerance
      end if
      if (.not. model%is_solved) &
         call raise(error, exit_no_solution, 'autoregressive process of order '// &
                    to_text(request%order)//' with '//lengths_of(request)// &
                    ': the search ended at L0 = '//to_text(sums%l0)//', L1 = '// &
                    to_text(sums%l1)//' with optimality residual '//to_text(model%optimality)// &
                    advice(request))
   end subroutine fit_ar

   !> Advice on a lower order with both lengths, or on the lengths that are feasible; may be empty.
   function advice(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = ''
      if (request%correlation /= 'both') return
      associate (kappa => nonnegative_reflection(request), l0 => request%correlation_length, &
                 l1 => request%second_length)
         if (size(kappa) > 0) then
            text = '; order = '//to_text(size(kappa))//' has both with K(m) >= 0'
         else if (broken_rule(request) /= '') then
            text = '; '//broken_rule(request)
         else if (l1 > request%order*l0) then
            text = '; K(m) >= 0 needs L1 <= order*L0'
         end if
      end associate
   end function advice

   !> Rule on both lengths that no process breaks; '' if the request keeps it.
   pure function broken_rule(request) result(rule)
      type(process_request), intent(in) :: request
      character(:), allocatable :: rule

      rule = ''
      associate (l0 => request%correlation_length, l1 => request%second_length)
         if (l1*(1.0_wp + l0) < l0) rule = 'every process has L1 >= L0/(1 + L0)'
      end associate
   end function broken_rule

   !> Reflection coefficients of the maximum with K(m) >= 0 for both lengths, of the highest order
   !> up to that of the request that has one; empty if there is none.
   function nonnegative_reflection(request) result(kappa)
      type(process_request), intent(in) :: request
      real(wp), allocatable :: kappa(:)
      type(process_request) :: lower
      type(correlation_sums) :: sums
      type(error_type), allocatable :: error

      lower = request
      do while (lower%order >= 2)
         call optimal_reflection(lower, kappa, error)
         if (.not. allocated(error)) call sum_correlation(kappa, sums, error)
         if (allocated(error)) exit
         if (sums%is_nonnegative .and. length_error_of(lower, sums) <= length_tolerance) return
         lower%order = lower%order - 1
      end do
      kappa = [real(wp) ::]
   end function nonnegative_reflection

   !> Largest relative error of the imposed lengths.
   pure real(wp) function length_error_of(request, sums) result(distance)
      type(process_request), intent(in) :: request
      type(correlation_sums), intent(in) :: sums

      distance = abs(merge(sums%l1, sums%l0, request%correlation == 'L1') &
                     - request%correlation_length)/max(request%correlation_length, tiny(1.0_wp))
      if (request%correlation == 'both') &
         distance = max(distance, abs(sums%l1 - request%second_length) &
                        /max(request%second_length, tiny(1.0_wp)))
   end function length_error_of

   !> Reflection coefficients of the maximum for L0 alone: all are equal.
   pure function equal_reflection(length, order) result(kappa)
      real(wp), intent(in) :: length   !! L0 [lags]
      integer, intent(in) :: order
      real(wp) :: kappa(order)

      kappa = -tanh(log_one_plus(2.0_wp*length)/(2*order))
   end function equal_reflection

   !> Finds the reflection coefficients of the maximum by the closed forms for K(m) >= 0. The caller
   !> must check that they have the length and K(m) >= 0. Fails if the request is invalid.
   subroutine optimal_reflection(request, kappa, error)
      type(process_request), intent(in) :: request
      real(wp), allocatable, intent(out) :: kappa(:)
      type(error_type), allocatable, intent(out) :: error

      associate (length => request%correlation_length, second => request%second_length, &
                 order => request%order)
         if (.not. (length >= 0.0_wp .and. length <= longest_length)) then
            call raise(error, exit_bad_input, 'correlation_length = '//to_text(length)// &
                       ': must not be negative, and at most '//to_text(longest_length)// &
                       ': poles come too near the unit circle')
            return
         end if
         allocate (kappa(order), source=0.0_wp)
         if (.not. length > 0.0_wp .and. request%correlation /= 'both') return   ! white noise
         select case (request%correlation)
         case ('L0')
            kappa = equal_reflection(length, order)
         case ('L1')
            call match_l1(length, kappa)
         case default
            if (order < 2 .or. .not. min(length, second) > 0.0_wp .or. second > longest_length) then
               call raise(error, exit_bad_input, 'second_length = '//to_text(second)// &
                          ', order = '//to_text(order)//': both lengths must be positive, at '// &
                          'most '//to_text(longest_length)//', and order at least 2')
               return
            end if
            call match_l1(second, kappa, log_one_plus(2.0_wp*length))
         end select
      end associate
   end subroutine optimal_reflection

   !> Finds the reflection coefficients of the maximum for L1, with v_0 free or fixed, by a search
   !> for v_(M-1), with which L1 grows. If none has this L1, they are those for L0 alone.
   subroutine match_l1(target, kappa, v_0)
      real(wp), intent(in) :: target           !! L1 [lags]
      real(wp), intent(out) :: kappa(:)
      real(wp), intent(in), optional :: v_0    !! ln(1 + 2 L0), fixed if present
      real(wp) :: last, scale, share, v(0:size(kappa))
      type(root_search) :: search
      integer :: order, step

      order = size(kappa)
      scale = log_one_plus(2.0_wp*target)/(2*order)
      if (present(v_0)) scale = v_0/(2*order)
      kappa = -tanh(scale)
      share = 1.0_wp
      search%step = first_step
      do step = 1, max_steps
         last = share
         call find_multiplier(target, scale, share*scale, v, v_0)
         associate (l1 => sum(sinh(v(:order - 1)))/(1.0_wp + exp(-v(0))))
            call search%advance(share, log(max(l1, tiny(l1))) - log(target))
            if (abs(l1 - target) <= length_tolerance*target) &
               kappa = -tanh(0.5_wp*(v(:order - 1) - v(1:)))
         end associate
         if (.not. abs(share - last) > spacing(last)) exit
      end do
   end subroutine match_l1

   !> Finds all v_m from v_(M-1) by a search for the multiplier nu, such that the optimality
   !> condition of v_0 holds or, if v_0 is fixed, such that it has its value.
   subroutine find_multiplier(target, scale, half, v, v_0)
      real(wp), intent(in) :: target, scale   !! L1; scale of nu
      real(wp), intent(in) :: half            !! v_(M-1)/2
      real(wp), intent(out) :: v(0:)
      real(wp), intent(in), optional :: v_0
      type(root_search) :: search
      real(wp) :: excess, last, share, t
      integer :: step

      share = 0.0_wp
      search%step = first_step
      do step = 1, max_steps
         last = share
         call find_v(half, share*scale, v, t)
         excess = share - 0.5_wp*(t/scale)/(cosh(v(0)) + target*exp(-v(0)))
         if (present(v_0)) excess = v_0 - v(0)
         call search%advance(share, excess)
         if (.not. abs(share - last) > epsilon(last)*abs(last)) exit
      end do
   end subroutine find_multiplier

   !> Computes v_m from m = order down to 0 by the optimality conditions, t_m = t_(m+1)
   !> - 2 nu cosh(v_m), 0 < m < order, with t_m = -kappa_m = tanh((v_(m-1) - v_m)/2).
   pure subroutine find_v(half, nu, v, t)
      real(wp), intent(in) :: half     !! v_(order-1)/2 = atanh(t_order)
      real(wp), intent(in) :: nu       !! multiplier
      real(wp), intent(out) :: v(0:)   !! (0:order)
      real(wp), intent(out) :: t       !! t_1
      real(wp), parameter :: largest_t = 1.0_wp - 1.0e-15_wp, largest_v = 300.0_wp   ! no overflow
      integer :: m, order

      order = ubound(v, 1)
      v(order) = 0.0_wp
      t = tanh(half)
      v(order - 1) = 2.0_wp*half
      do m = order - 1, 1, -1
         t = max(-largest_t, min(t - 2.0_wp*nu*cosh(v(m)), largest_t))
         v(m - 1) = max(-largest_v, min(v(m) + 2.0_wp*atanh(t), largest_v))
      end do
   end subroutine find_v

   !> Residual of the optimality conditions: largest component of the entropy's gradient in
   !> atanh(kappa), which is -kappa, without its part along the gradients of the lengths; over the
   !> largest component of the whole gradient.
   real(wp) function optimality_residual(correlation, kappa) result(residual)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: kappa(:)   !! coefficients with K(m) >= 0
      real(wp) :: slopes(2, size(kappa))
      integer :: first, last   ! numbers of the imposed lengths

      residual = 0.0_wp
      if (.not. any(abs(kappa) > 0.0_wp)) return
      slopes = positive_gradient(kappa)
      first = merge(2, 1, correlation == 'L1')
      last = merge(1, 2, correlation == 'L0')
      residual = maxval(abs(projected_gradient(kappa, slopes(first:last, :))))/maxval(abs(kappa))
   end function optimality_residual

end module process_autoregressive_fit
