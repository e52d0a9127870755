!> The autoregressive process of given order, std and correlation length with the largest entropy
!> (Sec. 2.3).
!>
!> In terms of the reflection coefficients the entropy is ln std + 0.5 sum ln(1 - kappa^2) plus a
!> constant, and where K(m) >= 0 at every lag both infinite lengths are closed forms of the
!> v_m = ln(R_M/R_m) of `process_autoregressive_sums`:
!>    L0 = (exp(v_0) - 1)/2,      L1 = sum_(m<M) sinh(v_m)/(1 + exp(-v_0)).
!> For L0 all kappa are then equal at the maximum. For L1, and for both lengths at once, which hold
!> v_0 too, the optimality conditions are solved by Newton's method along a path of targets that
!> starts where they are linear, or at the maximum for L0 alone. That K(m) >= 0 holds is checked on
!> the result. Where no such process has both lengths, `process_autoregressive_search` looks for one
!> whose K(m) change their sign or are 0; the tests look for one that does better than the closed
!> forms.
module process_autoregressive_fit
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: rest_of_gradient
   use numerics_elementary, only: log_one_plus
   use numerics_lapack, only: solve_linear_system
   use process_autoregressive_description, only: describe_ar
   use process_autoregressive_model, only: coefficients_of, innovation_std
   use process_autoregressive_search, only: both_lengths_maximum, find_maximum
   use process_autoregressive_sums, only: correlation_sums, length_gradient, sum_correlation
   use process_entropy, only: gaussian_entropy
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: fit_ar, nonnegative_reflection, optimal_reflection

   real(wp), parameter :: length_tolerance = 1.0e-10_wp      !! relative, of the length reached
   real(wp), parameter :: optimality_tolerance = 1.0e-8_wp   !! relative, of its conditions
   real(wp), parameter :: search_tolerance = 1.0e-2_wp       !! the same, of a smoothed maximum
   real(wp), parameter :: entropy_tolerance = 1.0e-5_wp      !! of its entropy [nat]
   real(wp), parameter :: longest = 1.0e6_wp                 !! [lags]

contains

   !> Fits and describes. Fails for bad numbers and where no maximum could be proved.
   subroutine fit_ar(correlation, correlation_length, order, std, model, error, second_length)
      character(*), intent(in) :: correlation        !! 'L0' Eq. (8), 'L1' Eq. (9), or 'both'
      real(wp), intent(in) :: correlation_length     !! [lags], not negative
      integer, intent(in) :: order                   !! M >= 1
      real(wp), intent(in) :: std                    !! sigma_X [unit of X]
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: second_length   !! 'both': L1, the other one being L0
      type(correlation_sums) :: sums
      type(both_lengths_maximum) :: best
      real(wp), allocatable :: kappa(:)
      real(wp) :: missed

      if (.not. (std > 0.0_wp .and. std <= huge(1.0_wp))) then
         call raise(error, exit_bad_input, 'std = '//to_text(std)//': must be finite and positive')
         return
      end if
      call optimal_reflection(correlation, correlation_length, order, kappa, error, second_length)
      if (allocated(error)) return
      call sum_correlation(kappa, sums, error)
      if (allocated(error)) return
      missed = distance_from(correlation, correlation_length, sums, second_length)
      if (correlation == 'both' .and. .not. (sums%is_nonnegative .and. &
                                             missed <= length_tolerance)) then
         call find_maximum(correlation_length, second_length, equal_reflection(correlation_length, &
                                                                               order), best)
         associate (lower => nonnegative_reflection(correlation_length, second_length, order - 1))
            if (size(lower) > 0) &   ! which every order contains
               best%is_feasible = best%is_feasible .and. &
                                  best%entropy > gaussian_entropy(innovation_std(lower, 1.0_wp)) - &
                                  entropy_tolerance
         end associate
         if (best%is_feasible) then
            kappa = best%kappa
            call sum_correlation(kappa, sums, error)
            if (allocated(error)) return
            missed = distance_from(correlation, correlation_length, sums, second_length)
         end if
      end if
      call describe_ar(coefficients_of(kappa), innovation_std(kappa, std), model, error, sums)
      if (allocated(error)) return
      if (best%is_feasible) then
         model%optimality = max(best%residual, missed)
         model%is_solved = model%optimality <= search_tolerance
      else
         model%optimality = max(optimality_residual(correlation, kappa, sums), missed)
         model%is_solved = sums%is_nonnegative .and. missed <= length_tolerance .and. &
                           model%optimality <= optimality_tolerance
      end if
      if (.not. model%is_solved) &
         call raise(error, exit_no_solution, 'autoregressive process of order '// &
                    to_text(order)//' with '// &
                    name_of_lengths(correlation, correlation_length, second_length)// &
                    ': the search ended at L0 = '//to_text(sums%l0)//', L1 = '// &
                    to_text(sums%l1)//' with optimality residual '//to_text(model%optimality)// &
                    lower_order(correlation, correlation_length, order, second_length))
   end subroutine fit_ar

   !> '; order = .. has both with K(m) >= 0', the highest one; or what all need.
   function lower_order(correlation, length, order, second_length) result(advice)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      integer, intent(in) :: order
      real(wp), intent(in), optional :: second_length
      character(:), allocatable :: advice

      advice = ''
      if (correlation /= 'both') return
      associate (kappa => nonnegative_reflection(length, second_length, order - 1))
         if (size(kappa) > 0) then
            advice = '; order = '//to_text(size(kappa))//' has both with K(m) >= 0'
         else if (second_length*(1.0_wp + length) < length) then
            advice = '; every process has L1 >= L0/(1 + L0)'
         else if (second_length > order*length) then
            advice = '; K(m) >= 0 needs L1 <= order*L0'
         end if
      end associate
   end function lower_order

   !> kappa_m of the maximum with K(m) >= 0 for both lengths, of the highest order up to one; none
   !> where no order has it.
   function nonnegative_reflection(length, second_length, highest) result(kappa)
      real(wp), intent(in) :: length, second_length   !! L0 and L1 [lags]
      integer, intent(in) :: highest
      real(wp), allocatable :: kappa(:)
      type(correlation_sums) :: sums
      type(error_type), allocatable :: error
      integer :: order

      do order = highest, 2, -1
         call optimal_reflection('both', length, order, kappa, error, second_length)
         if (.not. allocated(error)) call sum_correlation(kappa, sums, error)
         if (allocated(error)) exit
         if (sums%is_nonnegative .and. distance_from('both', length, sums, second_length) &
             <= length_tolerance) return
      end do
      kappa = [real(wp) ::]
   end function nonnegative_reflection

   !> Largest relative distance from the imposed lengths.
   pure function distance_from(correlation, length, sums, second_length) result(distance)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      type(correlation_sums), intent(in) :: sums
      real(wp), intent(in), optional :: second_length
      real(wp) :: distance

      distance = abs(merge(sums%l1, sums%l0, correlation == 'L1') - length) &
                 /max(length, tiny(length))
      if (present(second_length) .and. correlation == 'both') &
         distance = max(distance, abs(sums%l1 - second_length)/max(second_length, tiny(length)))
   end function distance_from

   !> 'L0 = 1.0' or 'L0 = 1.0, L1 = 2.0', for messages.
   pure function name_of_lengths(correlation, length, second_length) result(name)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: length
      real(wp), intent(in), optional :: second_length
      character(:), allocatable :: name

      name = merge('L1', 'L0', correlation == 'L1')//' = '//to_text(length)
      if (present(second_length) .and. correlation == 'both') &
         name = name//', L1 = '//to_text(second_length)
   end function name_of_lengths

   !> kappa_m of the maximum for L0 alone: all are equal.
   pure function equal_reflection(length, order) result(kappa)
      real(wp), intent(in) :: length   !! L0 [lags]
      integer, intent(in) :: order
      real(wp) :: kappa(order)

      kappa = -tanh(log_one_plus(2.0_wp*length)/(2*order))
   end function equal_reflection

   !> Finds the kappa_m of the maximum by the closed forms, which are those of K(m) >= 0. Whether
   !> they reach the length, and whether K(m) >= 0, is for `fit_ar` to check.
   subroutine optimal_reflection(correlation, correlation_length, order, kappa, error, &
                                 second_length)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: correlation_length
      integer, intent(in) :: order
      real(wp), allocatable, intent(out) :: kappa(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: second_length   !! see `fit_ar`

      if (.not. (correlation_length >= 0.0_wp .and. correlation_length <= longest)) then
         call raise(error, exit_bad_input, 'correlation_length = '//to_text(correlation_length)// &
                    ': must not be negative, and at most '//to_text(longest)// &
                    ': poles come too near the unit circle')
         return
      end if
      if (order < 1) then
         call raise(error, exit_bad_input, 'order = '//to_text(order)//': must be at least 1')
         return
      end if
      allocate (kappa(order), source=0.0_wp)
      if (.not. correlation_length > 0.0_wp .and. correlation /= 'both') return   ! white noise
      select case (correlation)
      case ('L0')
         kappa = equal_reflection(correlation_length, order)
      case ('L1')
         call follow_targets(correlation_length, kappa)
      case ('both')
         if (order < 2 .or. .not. min(correlation_length, second_length) > 0.0_wp .or. &
             second_length > longest) then
            call raise(error, exit_bad_input, 'second_length = '//to_text(second_length)// &
                       ', order = '//to_text(order)//': both lengths must be positive, at '// &
                       'most '//to_text(longest)//', and order at least 2')
            return
         end if
         call follow_targets(second_length, kappa, log_one_plus(2.0_wp*correlation_length))
      case default
         call raise(error, exit_bad_input, &
                    "correlation = '"//correlation//"': must be 'L0', 'L1' or 'both'")
      end select
   end subroutine optimal_reflection

   !> Follows the maximum along targets, by Newton's method at each, to the wanted L1. It starts
   !> where the maximum is known: at a small L1, where kappa_m is proportional to m, or with v_0
   !> held at the maximum for L0 alone, where the multiplier is 0.
   subroutine follow_targets(target, kappa, v_0)
      real(wp), intent(in) :: target             !! L1 [lags]
      real(wp), intent(out) :: kappa(:)          !! of the last target on the path that was solved
      real(wp), intent(in), optional :: v_0      !! ln (1 + 2 L0), held
      real(wp), parameter :: widest_step = 4.0_wp      !! ratio of two targets
      real(wp), parameter :: narrowest_step = 1.01_wp
      real(wp) :: reached, step, v(0:size(kappa)), trial(0:size(kappa)), wanted
      logical :: is_converged
      integer :: m, order

      order = size(kappa)
      if (present(v_0)) then
         v = [(v_0*(order - m)/order, m=0, order)]   ! the last one, the multiplier, is 0
         reached = sum(sinh(v(:order - 1)))/(1.0_wp + exp(-v_0))
      else
         reached = min(target, 0.1_wp*(2*order + 1)/6)   ! v_0 = 0.1: nearly linear still
         v(:order - 1) = [(3*reached/(order*(order + 1.0_wp)*(0.5_wp + order))* &
                           (order*(order + 1.0_wp) - m*(m + 1.0_wp)), m=0, order - 1)]
         v(order) = 2.0_wp*v(0)/(order*(order + 1.0_wp))   ! the multiplier: half of kappa_1
      end if
      wanted = reached
      step = widest_step
      do
         trial = v
         call solve_optimality(wanted, trial, is_converged, v_0)
         if (is_converged) then
            v = trial
            reached = wanted
            if (.not. abs(reached - target) > 0.0_wp) exit
         else
            step = sqrt(step)
            if (step < narrowest_step) exit
         end if
         wanted = max(min(step*reached, target), reached/step)
      end do
      kappa(:order - 1) = -tanh(0.5_wp*(v(:order - 2) - v(1:order - 1)))
      kappa(order) = -tanh(0.5_wp*v(order - 1))
   end subroutine follow_targets

   !> Solves the optimality conditions of L1 at one target by Newton's method.
   subroutine solve_optimality(target, unknowns, is_converged, v_0)
      real(wp), intent(in) :: target
      real(wp), intent(inout) :: unknowns(:)   !! v_m, m = 0..order-1, and the multiplier nu
      logical, intent(out) :: is_converged
      real(wp), intent(in), optional :: v_0    !! held in place of its condition
      integer, parameter :: max_steps = 20
      type(error_type), allocatable :: error
      real(wp) :: jacobian(size(unknowns), size(unknowns)), residual(size(unknowns))
      real(wp), allocatable :: change(:)
      logical :: is_close
      integer :: step

      is_converged = .false.
      is_close = .false.
      do step = 1, max_steps
         call optimality_conditions(target, unknowns, residual, jacobian)
         if (present(v_0)) then
            residual(1) = unknowns(1) - v_0
            jacobian(1, :) = 0.0_wp
            jacobian(1, 1) = 1.0_wp
         end if
         if (.not. all(abs(residual) < huge(1.0_wp))) return
         call solve_linear_system(jacobian, residual, change, error)
         if (allocated(error)) return
         unknowns = unknowns - change
         is_converged = is_close   ! quadratic convergence: one step more reaches rounding
         if (is_converged) exit
         is_close = maxval(abs(change)) <= 1.0e-7_wp*maxval(abs(unknowns))
         if (maxval(abs(unknowns)) > 0.25_wp*log(huge(1.0_wp))) return
      end do
      if (.not. present(v_0)) is_converged = is_converged .and. all(unknowns > 0.0_wp)
   end subroutine solve_optimality

   !> Evaluates the gradient of - sum ln cosh((v_(m-1) - v_m)/2) + nu (sum sinh v_m - L (1 +
   !> exp(-v_0))) in v and nu, and its Jacobian.
   pure subroutine optimality_conditions(target, unknowns, residual, jacobian)
      real(wp), intent(in) :: target
      real(wp), intent(in) :: unknowns(0:)
      real(wp), intent(out) :: residual(0:)
      real(wp), intent(out) :: jacobian(0:, 0:)
      real(wp) :: curvature, nu, slope
      integer :: m, order

      order = ubound(unknowns, 1)
      nu = unknowns(order)
      jacobian = 0.0_wp
      associate (v => unknowns(:order - 1))
         residual(:order - 1) = nu*cosh(v)
         residual(0) = residual(0) + nu*target*exp(-v(1))
         residual(order) = sum(sinh(v)) - target*(1.0_wp + exp(-v(1)))
         jacobian(:order - 1, order) = cosh(v)
         jacobian(0, order) = jacobian(0, order) + target*exp(-v(1))
         jacobian(order, :order - 1) = jacobian(:order - 1, order)
         do m = 0, order - 1
            jacobian(m, m) = nu*sinh(v(m + 1))
         end do
         jacobian(0, 0) = jacobian(0, 0) - nu*target*exp(-v(1))
      end associate
      do m = 1, order   ! the term with v_(m-1) - v_m; v_order = 0
         slope = 0.5_wp*unknowns(m - 1)
         if (m < order) slope = slope - 0.5_wp*unknowns(m)
         curvature = 0.25_wp/cosh(slope)**2
         slope = 0.5_wp*tanh(slope)
         residual(m - 1) = residual(m - 1) - slope
         jacobian(m - 1, m - 1) = jacobian(m - 1, m - 1) - curvature
         if (m == order) exit
         residual(m) = residual(m) + slope
         jacobian(m, m) = jacobian(m, m) - curvature
         jacobian(m - 1, m) = curvature
         jacobian(m, m - 1) = curvature
      end do
   end subroutine optimality_conditions

   !> Residual of the entropy's gradient in atanh(kappa), which is -kappa, when its part along
   !! the gradients of the lengths is taken away: largest component, relative to the largest of all.
   pure function optimality_residual(correlation, kappa, sums) result(residual)
      character(*), intent(in) :: correlation
      real(wp), intent(in) :: kappa(:)
      type(correlation_sums), intent(in) :: sums   !! of this very process
      real(wp) :: residual
      real(wp), allocatable :: slopes(:, :)   ! (length, variable)

      residual = 0.0_wp
      if (.not. any(abs(kappa) > 0.0_wp)) return
      slopes = reshape(length_gradient(merge('L1', 'L0', correlation == 'L1'), kappa, sums), &
                       [1, size(kappa)])
      if (correlation == 'both') &
         slopes = reshape([slopes, length_gradient('L1', kappa, sums)], [2, size(kappa)], &
                          order=[2, 1])
      residual = maxval(abs(rest_of_gradient(kappa, slopes)))/maxval(abs(kappa))
   end function optimality_residual

end module process_autoregressive_fit
