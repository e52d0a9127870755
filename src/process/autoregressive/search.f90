!> The autoregressive process of largest entropy with both correlation lengths, whatever the signs
!> of K(m) (Sec. 2.3).
!>
!> `process_autoregressive_fit` knows the maximum where all K(m) > 0. Elsewhere it often has some
!> K(m) = 0, where the lengths have a kink. With e the width of a smoothed kink, each |K(m)|/K(0) is
!> replaced by
!>    sqrt(rho_m^2 + e^2) - e,    whose slope s_m = rho_m/sqrt(rho_m^2 + e^2) lies in (-1, 1),
!> and NLopt follows the maximum, in atanh(kappa), from a large width, where there is hardly a kink,
!> to a negligible one. There the smoothed targets are moved until the lengths themselves are met.
module process_autoregressive_search
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_constrained_maximum, only: rest_of_gradient, step_to_maximum
   use numerics_elementary, only: log_cosh
   use numerics_lapack, only: unit_matrix
   use numerics_nlopt, only: minimization_problem, minimize
   use process_autoregressive_model, only: autocovariance_of, innovation_std
   use process_autoregressive_sums, only: correlation_sums, lag_sum_gradient, sum_correlation
   use process_entropy, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: both_lengths_maximum, find_maximum

   !> Where the search ended.
   type :: both_lengths_maximum
      real(wp), allocatable :: kappa(:)    !! (order)
      real(wp) :: entropy = -huge(1.0_wp)  !! per point, of unit std [nat]
      real(wp) :: residual = huge(1.0_wp)  !! of the smoothed optimality conditions, relative
      logical :: is_feasible = .false.     !! the lengths are the wanted ones
   end type both_lengths_maximum

   !> Minus the entropy under smoothed lengths; x = atanh(kappa).
   type, extends(minimization_problem) :: smoothed_problem
      real(wp) :: lengths(2) = 0.0_wp   !! L0 and L1 [lags]
      real(wp) :: width = 0.0_wp        !! of the kinks, over K(0)
      real(wp) :: scale = 1.0_wp        !! brings the entropy lost to order 1 for the search
      integer :: n_lags = 0             !! that are summed
   contains
      procedure :: objective => entropy_lost
      procedure :: equalities => length_defect
   end type smoothed_problem

   real(wp), parameter :: close = 1.0e-6_wp   !! relative, of the lengths to the wanted ones

contains

   !> Finds the maximum; not feasible where the search ends elsewhere, or lengths are too great to
   !> be summed lag by lag.
   subroutine find_maximum(length, second_length, start, best)
      real(wp), intent(in) :: length, second_length   !! L0 and L1 [lags], positive
      real(wp), intent(in) :: start(:)                !! kappa to begin with
      type(both_lengths_maximum), intent(out) :: best
      real(wp), parameter :: farthest = 8.0_wp       ! atanh(kappa): kappa = 1 - 2e-7
      real(wp), parameter :: stationary = 1.0e-5_wp  ! relative, of the gradient
      real(wp), parameter :: widest = 3.0e-2_wp, narrowest = 1.0e-5_wp, narrowing = 0.3_wp
      real(wp), parameter :: longest = 1.0e3_wp      ! [lags]
      integer, parameter :: max_evaluations = 400, max_passes = 12
      type(smoothed_problem) :: problem
      real(wp), dimension(size(start)) :: settled, x
      real(wp) :: defect(2), gradients(size(start), 2), residual, unused(2)
      integer :: pass
      logical :: is_met

      if (max(length, second_length) > longest) return
      problem%n_equalities = 2
      problem%lengths = [length, second_length]
      problem%n_lags = 200 + 20*size(start) + ceiling(60.0_wp*max(length, second_length))
      problem%width = widest
      x = atanh(start)
      problem%scale = 1.0_wp/sum(log_cosh(x))
      do while (problem%width > narrowest)
         call minimize(problem, farthest, close, max_evaluations, x, is_met)
         problem%width = max(narrowing*problem%width, narrowest)
      end do
      settled = x
      do pass = 1, max_passes
         call minimize(problem, farthest, close, max_evaluations, x, is_met)
         defect = defect_of(x, length, second_length)
         if (.not. maxval(abs(defect)) < 1.0_wp) exit
         ! of the entropy's gradient, without its parts along those of the smoothed lengths
         call problem%equalities(x, unused, gradients)
         residual = maxval(abs(rest_of_gradient(tanh(x), transpose(gradients)))) &
                    /maxval(abs(tanh(x)))
         if (maxval(abs(defect)) <= close .and. residual < best%residual) then
            best%residual = residual
            settled = x
         end if
         if (best%residual <= stationary) exit
         problem%lengths = problem%lengths*exp(-defect)
      end do
      problem%width = tiny(1.0_wp)   ! the kinks themselves
      call lead_to_lengths(problem, length, second_length, settled, best%is_feasible)
      best%kappa = tanh(settled)
      best%entropy = gaussian_entropy(innovation_std(best%kappa, 1.0_wp))
   end subroutine find_maximum

   !> Leads x to the lengths themselves by the shortest steps.
   subroutine lead_to_lengths(problem, length, second_length, x, is_met)
      type(smoothed_problem), intent(inout) :: problem   !! for gradients
      real(wp), intent(in) :: length, second_length
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_met
      real(wp), parameter :: met = 1.0e-9_wp   ! relative: where many K(m) are 0 less is reached
      integer, parameter :: max_steps = 40
      real(wp) :: change(size(x)), defect(2), gradients(size(x), 2), unused(2)
      integer :: step
      logical :: is_regular

      do step = 1, max_steps
         defect = defect_of(x, length, second_length)
         is_met = maxval(abs(defect)) <= close
         if (maxval(abs(defect)) <= met .or. .not. maxval(abs(defect)) < 1.0_wp) return
         call problem%equalities(x, unused, gradients)
         call step_to_maximum(unit_matrix(size(x)), transpose(gradients), 0.0_wp*x, defect, &
                              change, unused, is_regular)
         if (.not. is_regular) return
         x = x + change
      end do
   end subroutine lead_to_lengths

   !> ln(length/wanted length) of both, summed to infinity; huge where too many lags count.
   function defect_of(x, length, second_length) result(defect)
      real(wp), intent(in) :: x(:), length, second_length
      real(wp) :: defect(2)
      type(correlation_sums) :: sums
      type(error_type), allocatable :: error

      defect = huge(1.0_wp)
      call sum_correlation(tanh(x), sums, error)
      if (allocated(error)) return
      if (min(sums%l0, sums%l1) > 0.0_wp) defect = log([sums%l0, sums%l1]/[length, second_length])
   end function defect_of

   !> Computes - 0.5 sum ln(1 - kappa^2) = sum ln cosh x, scaled, and its gradient.
   subroutine entropy_lost(self, x, value, gradient)
      class(smoothed_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: value
      real(wp), optional, intent(out) :: gradient(:)

      value = self%scale*sum(log_cosh(x))
      if (present(gradient)) gradient = self%scale*tanh(x)
   end subroutine entropy_lost

   !> Computes ln(smoothed length/wanted length) for both, and its gradient.
   subroutine length_defect(self, x, values, jacobian)
      class(smoothed_problem), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: values(:)
      real(wp), optional, intent(out) :: jacobian(:, :)
      real(wp), dimension(self%n_lags) :: lag, modulus, slope
      real(wp) :: kappa(size(x)), lengths(2), rho(0:self%n_lags)
      integer :: m

      kappa = tanh(x)
      lag = [(real(m, wp), m=1, self%n_lags)]
      rho = autocovariance_of(kappa, self%n_lags)
      modulus = hypot(rho(1:), self%width)
      slope = rho(1:)/modulus
      modulus = rho(1:)**2/(modulus + self%width)   ! less the width, without cancellation
      lengths(1) = max(sum(modulus), tiny(1.0_wp))
      lengths(2) = max(sum(lag*modulus)/(1.0_wp + lengths(1)), tiny(1.0_wp))
      values = log(lengths/self%lengths)
      if (.not. present(jacobian)) return
      jacobian(:, 1) = lag_sum_gradient(kappa, rho, slope)/lengths(1)
      jacobian(:, 2) = lag_sum_gradient(kappa, rho, (lag - lengths(2))*slope) &
                       /((1.0_wp + lengths(1))*lengths(2))
   end subroutine length_defect

end module process_autoregressive_search
