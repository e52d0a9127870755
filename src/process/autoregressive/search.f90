!> Search for the autoregressive process of largest entropy with both correlation lengths and with
!> K(m) of any sign (Sec. 2.3). The maximum with K(m) >= 0 is in `process_autoregressive_fit`.
!>
!> The maximum often has some K(m) = 0, where |K(m)| is not differentiable. So rho_m = K(m)/K(0) has
!> its modulus replaced by the smooth
!>    sqrt(rho_m^2 + e^2) - e    with the slope rho_m/sqrt(rho_m^2 + e^2).
!> A search follows the maximum, in atanh(kappa), as the width e is reduced to a negligible one.
!> Then the targets of the smoothed lengths are moved until the exact lengths are reached.
module process_autoregressive_search
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_constrained_maximum, only: maximize, objective_type, projected_gradient, &
                                           step_to_maximum
   use numerics_elementary, only: log_cosh
   use numerics_lapack, only: unit_matrix
   use process_autoregressive_model, only: autocovariance_of, innovation_std
   use process_autoregressive_sums, only: correlation_sums, lag_sum_gradient, sum_correlation
   use process_model, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: both_lengths_maximum, find_feasible_maximum

   !> Result of the search.
   type :: both_lengths_maximum
      real(wp), allocatable :: kappa(:)    !! (order)
      real(wp) :: entropy = -huge(1.0_wp)  !! per point, of unit std [nat]
      real(wp) :: residual = huge(1.0_wp)  !! relative residual of its conditions
      logical :: is_feasible = .false.     !! the lengths are reached
   end type both_lengths_maximum

   !> Maximum of the entropy for given smoothed lengths; the point is x = atanh(kappa). A state has
   !> ln(smoothed length/target) of both lengths, then the loss of entropy.
   type, extends(objective_type) :: smoothed_problem
      real(wp) :: lengths(2) = 0.0_wp   !! L0 and L1 [lags]
      real(wp) :: width = 0.0_wp        !! e
      real(wp) :: scale = 1.0_wp        !! factor on the loss of entropy: order 1
      integer :: n_lags = 0             !! lags in the sums
   contains
      procedure :: evaluate
      procedure :: gain
      procedure :: differentiate
   end type smoothed_problem

   real(wp), parameter :: length_tolerance = 1.0e-6_wp   !! relative error of a length

contains

   !> Finds the maximum. It is not feasible if the search does not reach the lengths, or if they are
   !> too large to be summed lag by lag.
   subroutine find_feasible_maximum(lengths, start, best)
      real(wp), intent(in) :: lengths(2)   !! L0 and L1 [lags], positive
      real(wp), intent(in) :: start(:)     !! first kappa
      type(both_lengths_maximum), intent(out) :: best
      real(wp), parameter :: small_residual = 1.0e-5_wp    ! ends the passes
      real(wp), parameter :: widest = 3.0e-2_wp, narrowest = 1.0e-5_wp, narrowing = 0.3_wp   ! e
      real(wp), parameter :: longest = 1.0e3_wp            ! length [lags]
      integer, parameter :: max_iterations = 400, max_passes = 12
      type(smoothed_problem) :: problem
      real(wp) :: best_x(size(start)), gradients(2, size(start))
      real(wp) :: length_error(2), residual, unused(2)
      integer :: pass

      if (maxval(lengths) > longest) return
      problem%n_constraints = 2
      problem%lengths = lengths
      problem%n_lags = 200 + 20*size(start) + ceiling(60.0_wp*maxval(lengths))
      problem%width = widest
      problem%point = atanh(start)
      problem%scale = 1.0_wp/sum(log_cosh(problem%point))
      do while (problem%width > narrowest)
         call maximize(problem, 0.0_wp, length_tolerance, max_iterations)
         problem%width = max(narrowing*problem%width, narrowest)
      end do
      best_x = problem%point
      do pass = 1, max_passes
         call maximize(problem, 0.0_wp, length_tolerance, max_iterations)
         associate (x => problem%point)
            length_error = length_error_of(x, lengths)
            if (.not. maxval(abs(length_error)) < 1.0_wp) exit
            ! gradient of the entropy, without its part along those of the smoothed lengths
            call find_length_errors(problem, x, unused, gradients)
            residual = maxval(abs(projected_gradient(tanh(x), gradients)))/maxval(abs(tanh(x)))
            if (maxval(abs(length_error)) <= length_tolerance .and. residual < best%residual) then
               best%residual = residual
               best_x = x
            end if
         end associate
         if (best%residual <= small_residual) exit
         problem%lengths = problem%lengths*exp(-length_error)
      end do
      problem%width = tiny(1.0_wp)   ! exact lengths
      call correct_lengths(problem, lengths, best_x, best%is_feasible)
      best%kappa = tanh(best_x)
      best%entropy = gaussian_entropy(innovation_std(best%kappa, 1.0_wp))
   end subroutine find_feasible_maximum

   !> Changes x by the shortest steps until the exact lengths are reached.
   subroutine correct_lengths(problem, lengths, x, is_met)
      type(smoothed_problem), intent(in) :: problem   !! its gradients are used
      real(wp), intent(in) :: lengths(2)
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_met
      real(wp), parameter :: target_error = 1.0e-9_wp   ! relative; not always reached
      integer, parameter :: max_steps = 40
      real(wp) :: change(size(x)), length_error(2), gradients(2, size(x)), unused(2)
      integer :: step
      logical :: is_regular

      do step = 1, max_steps
         length_error = length_error_of(x, lengths)
         is_met = maxval(abs(length_error)) <= length_tolerance
         if (maxval(abs(length_error)) <= target_error) return
         if (.not. maxval(abs(length_error)) < 1.0_wp) return
         call find_length_errors(problem, x, unused, gradients)
         call step_to_maximum(unit_matrix(size(x)), gradients, 0.0_wp*x, length_error, change, &
                              unused, is_regular)
         if (.not. is_regular) return
         x = x + change
      end do
   end subroutine correct_lengths

   !> ln(length/target) of both infinite lengths; huge if they need too many lags.
   function length_error_of(x, lengths) result(length_error)
      real(wp), intent(in) :: x(:), lengths(2)
      real(wp) :: length_error(2)
      type(correlation_sums) :: sums
      type(error_type), allocatable :: error

      length_error = huge(1.0_wp)
      call sum_correlation(tanh(x), sums, error)
      if (allocated(error)) return
      if (min(sums%l0, sums%l1) > 0.0_wp) length_error = log([sums%l0, sums%l1]/lengths)
   end function length_error_of

   !> See objective_type. The loss of entropy is -0.5 sum ln(1 - kappa^2) = sum ln cosh x, scaled.
   subroutine evaluate(self, point, state, is_inside)
      class(smoothed_problem), intent(inout) :: self
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: state(:)
      logical, intent(out) :: is_inside
      real(wp), parameter :: largest_x = 8.0_wp   ! kappa = 1 - 2e-7
      real(wp) :: length_error(2)

      is_inside = maxval(abs(point)) <= largest_x
      if (.not. is_inside) return
      call find_length_errors(self, point, length_error)
      state = [length_error, self%scale*sum(log_cosh(point))]
   end subroutine evaluate

   !> See objective_type.
   pure real(wp) function gain(self, from, to)
      class(smoothed_problem), intent(in) :: self
      real(wp), intent(in) :: from(:), to(:)

      associate (loss => self%n_constraints + 1)
         gain = from(loss) - to(loss)
      end associate
   end function gain

   !> Finds the exact gradients.
   subroutine differentiate(self, state, step, gradient, jacobian, is_inside)
      class(smoothed_problem), intent(inout) :: self
      real(wp), intent(in) :: state(:), step
      real(wp), intent(out) :: gradient(:), jacobian(:, :)
      logical, intent(out) :: is_inside
      real(wp) :: unused(2)

      gradient = -self%scale*tanh(self%point)
      call find_length_errors(self, self%point, unused, jacobian)
      is_inside = .true.
      associate (unused_state => state, unused_step => step)
      end associate
   end subroutine differentiate

   !> Finds ln(smoothed length/target) of both lengths, and its gradients.
   subroutine find_length_errors(self, x, values, jacobian)
      class(smoothed_problem), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: values(2)
      real(wp), optional, intent(out) :: jacobian(:, :)   !! (length, coefficient)
      real(wp), dimension(self%n_lags) :: lag, modulus, slope
      real(wp) :: kappa(size(x)), lengths(2), rho(0:self%n_lags)
      integer :: m

      kappa = tanh(x)
      lag = [(real(m, wp), m=1, self%n_lags)]
      rho = autocovariance_of(kappa, self%n_lags)
      modulus = hypot(rho(1:), self%width)
      slope = rho(1:)/modulus
      modulus = rho(1:)**2/(modulus + self%width)   ! minus e, without cancellation
      lengths(1) = max(sum(modulus), tiny(1.0_wp))
      lengths(2) = max(sum(lag*modulus)/(1.0_wp + lengths(1)), tiny(1.0_wp))
      values = log(lengths/self%lengths)
      if (.not. present(jacobian)) return
      jacobian(1, :) = lag_sum_gradient(kappa, rho, slope)/lengths(1)
      jacobian(2, :) = lag_sum_gradient(kappa, rho, (lag - lengths(2))*slope) &
                       /((1.0_wp + lengths(1))*lengths(2))
   end subroutine find_length_errors

end module process_autoregressive_search
