!> The last step of a search on simulated values, and how far other random numbers would have led
!> it.
!>
!> The maximum is flat: the noise of a gradient moves it far. Each independent run of chains has a
!> gradient of its own, and the step that it asks for is its share of the distance from the true
!> maximum (the sandwich formula, the metric of the search in place of the inverse curvature).
module process_positive_refinement
   use core_kinds, only: wp
   use numerics_constrained_maximum, only: step_to_maximum
   use process_autoregressive_model, only: autocovariance_of, step_up
   use process_positive_family, only: by_symbol
   use process_positive_objective, only: sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   use process_positive_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: error_of_runs, refine, shape_spread

   integer, parameter :: refinement_steps = 2048   !! of a batch
   real(wp), parameter :: longest = 0.1_wp         !! a longer step is more than a refinement

   !> Shares of the runs, and how the correlation depends on the variables. Not allocated: the shape
   !> is given.
   type :: shape_spread
      real(wp), allocatable :: shares(:, :)           !! (run, variable)
      real(wp), allocatable :: correlation(:)         !! (0:order) K(m)/K(0)
      real(wp), allocatable :: by_correlation(:, :)   !! (0:order, variable) its derivatives
      real(wp), allocatable :: by_length(:, :)        !! (2, variable) derivatives of L0 and L1
   contains
      procedure :: length_errors
      procedure :: correlation_errors
   end type shape_spread

contains

   !> Takes one step more, on more simulated values: as good as a whole search on them. Where a
   !> difference leaves the domain, or the maximum is too flat for the step to be a short one, the
   !> point stays, and its spread is not known.
   subroutine refine(law, step, spread, is_short)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(in) :: step               !! of the differences
      type(shape_spread), intent(out) :: spread
      logical, intent(out) :: is_short          !! false: more values ask for a long step
      type(shape_spread) :: trial
      real(wp), allocatable :: moved_state(:), rests(:, :), state(:)
      real(wp), dimension(size(law%point)) :: change, gradient, moved
      real(wp) :: jacobian(law%n_constraints, size(moved)), lengths(2), &
         noise(lanes, size(moved), 0:law%n_constraints)
      real(wp) :: multipliers(law%n_constraints), unused(law%n_constraints)
      integer :: i, n
      logical :: is_inside, is_regular

      is_short = .true.
      if (law%family%kind == by_symbol .or. law%family%is_weak(law%point)) return
      n = size(moved)
      law%n_steps = refinement_steps
      call law%settle()
      call law%evaluate(law%point, state, is_inside)
      if (.not. is_inside) return
      rests = law%rests
      trial%correlation = correlation_of(law)
      lengths = [law%last%moments%l0, law%last%moments%l1]
      allocate (trial%by_correlation(0:size(trial%correlation) - 1, n), trial%by_length(2, n))
      do i = 1, n
         moved = law%point
         moved(i) = moved(i) + step
         call law%evaluate(moved, moved_state, is_inside)
         if (.not. is_inside) return
         gradient(i) = law%gain(state, moved_state)/step
         jacobian(:, i) = (moved_state(:law%n_constraints) - state(:law%n_constraints))/step
         noise(:, i, :) = noise_of(law, state, rests, moved_state, law%rests)/step
         trial%by_correlation(:, i) = (correlation_of(law) - trial%correlation)/step
         trial%by_length(:, i) = ([law%last%moments%l0, law%last%moments%l1] - lengths)/step
      end do
      call step_to_maximum(law%found%metric, jacobian, gradient, state(:law%n_constraints), &
                           change, multipliers, is_regular)
      if (.not. is_regular) return
      is_short = norm2(change) <= longest
      if (.not. is_short) return
      law%point = law%point + change
      law%found%jacobian = jacobian
      law%found%multipliers = multipliers
      allocate (trial%shares(lanes, n))
      do i = 1, lanes
         noise(i, :, 0) = noise(i, :, 0) - matmul(noise(i, :, 1:), multipliers)
         call step_to_maximum(law%found%metric, jacobian, noise(i, :, 0), 0.0_wp*multipliers, &
                              trial%shares(i, :), unused, is_regular)
      end do
      spread = trial
   end subroutine refine

   !> Shares of the runs in the errors of a gain and of the constraints' changes, from one state to
   !> another.
   function noise_of(law, from, from_rests, to, to_rests) result(noise)
      type(sampled_objective), intent(in) :: law
      real(wp), intent(in) :: from(:), to(:)                !! (component of a state)
      real(wp), intent(in) :: from_rests(:, :), to_rests(:, :)   !! (batch, component)
      real(wp) :: noise(lanes, 0:law%n_constraints)
      real(wp) :: gain
      integer :: batch, n, run

      noise = 0.0_wp
      n = size(from_rests, 1)
      gain = law%gain(from, to)
      do batch = 1, n
         run = modulo(batch - 1, lanes) + 1
         noise(run, 0) = noise(run, 0) - gain + law%gain(from + from_rests(batch, :)/n, &
                                                         to + to_rests(batch, :)/n)
         noise(run, 1:) = noise(run, 1:) + (to_rests(batch, :law%n_constraints) &
                                            - from_rests(batch, :law%n_constraints))/n
      end do
   end function noise_of

   !> K(m)/K(0), m = 0..order, of the last evaluation.
   function correlation_of(law) result(correlation)
      type(sampled_objective), intent(in) :: law
      real(wp) :: correlation(0:ubound(law%last%g, 1))
      real(wp), allocatable :: k(:), unused(:)

      call estimate_autocovariance(law%last%batches, law%known, ubound(law%last%g, 1), k, unused)
      correlation = k/k(0)
   end function correlation_of

   !> Standard errors of L0 and L1 by the shape alone [lags].
   pure function length_errors(self) result(errors)
      class(shape_spread), intent(in) :: self
      real(wp) :: errors(2)

      errors = 0.0_wp
      if (allocated(self%shares)) &
         errors = error_of_runs(matmul(self%shares, transpose(self%by_length)))
   end function length_errors

   !> Standard errors of K(m)/K(0), m = 0..n_lags, by the shape alone. Beyond the order the
   !> autocovariance is carried on as a linear process would (Yule and Walker): enough for an error.
   pure function correlation_errors(self, n_lags) result(errors)
      class(shape_spread), intent(in) :: self
      integer, intent(in) :: n_lags
      real(wp) :: errors(0:n_lags)
      real(wp) :: series(lanes, 0:n_lags)
      real(wp), allocatable :: change(:)
      integer :: run

      errors = 0.0_wp
      if (.not. allocated(self%shares)) return
      do run = 1, lanes
         change = matmul(self%by_correlation, self%shares(run, :))
         series(run, :) = 0.5_wp*(carried_on(self%correlation + change, n_lags) &
                                  - carried_on(self%correlation - change, n_lags))
      end do
      errors = error_of_runs(series)
   end function correlation_errors

   !> Standard errors of sums over independent runs.
   pure function error_of_runs(shares) result(errors)
      real(wp), intent(in) :: shares(:, :)   !! (run, sum)
      real(wp) :: errors(size(shares, 2))

      errors = sqrt(sum(shares**2, dim=1)*lanes/(lanes - 1.0_wp))
   end function error_of_runs

   !> rho(0..order) to n_lags by its own predictor.
   pure function carried_on(rho, n_lags) result(longer)
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
   end function carried_on

end module process_positive_refinement
