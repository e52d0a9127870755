!> Last step of a search on simulated values, and the standard errors of the shape K(m)/K(0) that it
!> finds.
!>
!> The maximum is flat, so that noise of the gradient moves it far. Each independent run of chains
!> has a gradient and a step of its own; these steps scatter as the maximum does (sandwich formula,
!> with the inverse Hessian of the search).
module process_positive_refinement
   use core_kinds, only: wp
   use numerics_constrained_maximum, only: step_to_maximum
   use process_autoregressive_model, only: autocovariance_of, step_up
   use process_positive_family, only: by_symbol
   use process_positive_moments, only: error_of_runs
   use process_positive_objective, only: sampled_objective, step => difference_step
   use process_positive_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: refine, shape_uncertainty

   integer, parameter :: refinement_steps = 2048   !! steps of a batch
   real(wp), parameter :: longest = 0.1_wp         !! longest step of a refinement

   !> Steps of the runs, and derivatives of the correlation by the variables; not allocated where
   !> the shape is given.
   type :: shape_uncertainty
      real(wp), allocatable :: run_steps(:, :)           !! (run, variable)
      real(wp), allocatable :: correlation(:)         !! (0:order) K(m)/K(0)
      !> (0:order, variable) derivatives of K(m)/K(0)
      real(wp), allocatable :: by_correlation(:, :)
      real(wp), allocatable :: by_length(:, :)        !! (2, variable) derivatives of L0 and L1
   contains
      procedure :: length_errors
      procedure :: correlation_errors
   end type shape_uncertainty

contains

   !> Takes one more step, by differences on more simulated values; a whole search on these would
   !> hardly move farther. The point stays, without an uncertainty, if a difference leaves the
   !> domain or the step is too long.
   subroutine refine(search, uncertainty, is_short)
      type(sampled_objective), intent(inout) :: search
      type(shape_uncertainty), intent(out) :: uncertainty
      logical, intent(out) :: is_short          !! false: more values ask for a long step
      type(shape_uncertainty) :: trial
      real(wp), allocatable :: moved_state(:), residuals(:, :), state(:)
      real(wp), dimension(size(search%point)) :: change, gradient, moved
      real(wp) :: jacobian(search%n_constraints, size(moved)), lengths(2), &
                  noise(lanes, size(moved), 0:search%n_constraints)
      real(wp) :: multipliers(search%n_constraints), unused(search%n_constraints)
      integer :: i, n
      logical :: is_inside, is_regular

      is_short = .true.
      if (search%family%kind == by_symbol) return
      if (search%family%is_weakly_correlated(search%point)) return
      n = size(moved)
      search%n_steps = refinement_steps
      call search%set_burn_in()
      call search%evaluate(search%point, state, is_inside)
      if (.not. is_inside) return
      residuals = search%residuals
      trial%correlation = correlation_of(search)
      lengths = [search%last%moments%l0, search%last%moments%l1]
      allocate (trial%by_correlation(0:size(trial%correlation) - 1, n), trial%by_length(2, n))
      do i = 1, n
         moved = search%point
         moved(i) = moved(i) + step
         call search%evaluate(moved, moved_state, is_inside)
         if (.not. is_inside) return
         gradient(i) = search%gain(state, moved_state)/step
         jacobian(:, i) = (moved_state(:search%n_constraints) - state(:search%n_constraints))/step
         noise(:, i, :) = noise_of_runs(search, state, residuals, moved_state, &
                                        search%residuals)/step
         trial%by_correlation(:, i) = (correlation_of(search) - trial%correlation)/step
         trial%by_length(:, i) = ([search%last%moments%l0, search%last%moments%l1] - lengths)/step
      end do
      call step_to_maximum(search%found%metric, jacobian, gradient, state(:search%n_constraints), &
                           change, multipliers, is_regular)
      if (.not. is_regular) return
      is_short = norm2(change) <= longest
      if (.not. is_short) return
      search%point = search%point + change
      search%found%jacobian = jacobian
      search%found%multipliers = multipliers
      allocate (trial%run_steps(lanes, n))
      do i = 1, lanes
         noise(i, :, 0) = noise(i, :, 0) - matmul(noise(i, :, 1:), multipliers)
         call step_to_maximum(search%found%metric, jacobian, noise(i, :, 0), 0.0_wp*multipliers, &
                              trial%run_steps(i, :), unused, is_regular)
      end do
      uncertainty = trial
   end subroutine refine

   !> Errors of each run in the gain (column 0) and in the change of the constraints, from one state
   !> to another.
   function noise_of_runs(search, from, from_residuals, to, to_residuals) result(noise)
      type(sampled_objective), intent(in) :: search
      real(wp), intent(in) :: from(:), to(:)                !! (component of a state)
      real(wp), intent(in) :: from_residuals(:, :), to_residuals(:, :)   !! (batch, component)
      real(wp) :: noise(lanes, 0:search%n_constraints)
      real(wp) :: gain
      integer :: batch, n, run

      noise = 0.0_wp
      n = size(from_residuals, 1)
      gain = search%gain(from, to)
      do batch = 1, n
         run = modulo(batch - 1, lanes) + 1
         noise(run, 0) = noise(run, 0) - gain + search%gain(from + from_residuals(batch, :)/n, &
                                                            to + to_residuals(batch, :)/n)
         noise(run, 1:) = noise(run, 1:) + (to_residuals(batch, :search%n_constraints) &
                                            - from_residuals(batch, :search%n_constraints))/n
      end do
   end function noise_of_runs

   !> K(m)/K(0), m = 0..order, of the last evaluation.
   function correlation_of(search) result(correlation)
      type(sampled_objective), intent(in) :: search
      real(wp) :: correlation(0:ubound(search%last%g, 1))
      real(wp), allocatable :: k(:)

      call search%estimate_lags(ubound(search%last%g, 1), k)
      correlation = k/k(0)
   end function correlation_of

   !> Standard errors of L0 and L1 by the error of the shape [lags].
   pure function length_errors(self) result(errors)
      class(shape_uncertainty), intent(in) :: self
      real(wp) :: errors(2), series(lanes, 2)
      integer :: i

      errors = 0.0_wp
      if (.not. allocated(self%run_steps)) return
      series = matmul(self%run_steps, transpose(self%by_length))
      errors = [(error_of_runs(series(:, i)), i=1, 2)]
   end function length_errors

   !> Standard errors of K(m)/K(0), m = 0..n_lags, by the error of the shape. Beyond the order the
   !> autocovariance is continued by the Yule-Walker equations.
   pure function correlation_errors(self, n_lags) result(errors)
      class(shape_uncertainty), intent(in) :: self
      integer, intent(in) :: n_lags
      real(wp) :: errors(0:n_lags)
      real(wp) :: series(lanes, 0:n_lags)
      real(wp), allocatable :: change(:)
      integer :: m, run

      errors = 0.0_wp
      if (.not. allocated(self%run_steps)) return
      do run = 1, lanes
         change = matmul(self%by_correlation, self%run_steps(run, :))
         series(run, :) = 0.5_wp*(extended_correlation(self%correlation + change, n_lags) &
                                  - extended_correlation(self%correlation - change, n_lags))
      end do
      errors = [(error_of_runs(series(:, m)), m=0, n_lags)]
   end function correlation_errors

   !> rho(0..n_lags): beyond the order by the Yule-Walker equations.
   pure function extended_correlation(rho, n_lags) result(longer)
      real(wp), intent(in) :: rho(0:)
      integer, intent(in) :: n_lags
      real(wp) :: longer(0:n_lags)
      real(wp) :: a(ubound(rho, 1)), kappa(ubound(rho, 1)), variance
      integer :: m

      variance = rho(0)
      do m = 1, size(kappa)
         kappa(m) = -(rho(m) + dot_product(a(:m - 1), rho(m - 1:1:-1)))/variance
         call step_up(a, m, kappa(m))
         variance = variance*(1.0_wp - kappa(m)**2)
      end do
      longer = rho(0)*autocovariance_of(kappa, n_lags)
   end function extended_correlation

end module process_positive_refinement
