!> The two laws of a positive process as sampled problems: entropy to be maximized under a wanted
!> std/mean and correlation length, by averages over the same random numbers at every trial.
!>
!> Points are atanh(kappa_m) over a common factor, m = 1..order, and asinh of one coordinate for mu.
!> All is in units of b0.
module process_positive_law
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: objective_type
   use process_autoregressive_model, only: coefficients_of, reflection_of
   use process_autoregressive_spectral_factor, only: factor_symbol, symbol_of_process
   use process_positive_exact, only: sample_exact, sweeps_to_forget
   use process_positive_moments, only: batch_averages, estimate_autocovariance, estimate_moments, &
      new_batches, positive_moments
   use process_positive_numbers, only: shared_numbers
   use process_positive_partition, only: entropy_of_exact_law, log_partition
   use process_positive_sequential, only: numbers_needed, sample_sequential
   use process_positive_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: positive_law, sequential_law, exact_law

   integer, parameter, public :: n_constraints = 2

   integer, parameter, public :: n_batches = 16*lanes
   real(wp), parameter :: largest_kappa = 0.9999_wp

   !> A law, its targets, and the random numbers that every trial shares.
   type, abstract, extends(objective_type) :: positive_law
      character(:), allocatable :: correlation
      real(wp) :: wanted_ratio = 0.0_wp              !! std/mean
      real(wp) :: wanted_length = 0.0_wp
      real(wp) :: wanted_l0 = 0.0_wp                 !! the companion's where L1 is wanted
      !> allocated: points are (ln of a factor of this shape, coordinate)
      real(wp), allocatable :: shape(:)
      real(wp) :: factor = 1.0_wp                    !! else: by which points are multiplied
      !> allocated for the direct method: G_m/G_0 of the unconstrained solution; points are (ln of a
      !> factor of these, coordinate)
      real(wp), allocatable :: symbol(:)
      integer :: cut = 0                             !! lags of imposed sums, Eq. (11); 0: all
      real(wp), allocatable :: companion(:)          !! coefficients of the linear companion
      real(wp), allocatable :: companion_autocovariance(:)   !! (0:n_lags), unit innovations
      !> of the companion's sums, beyond n_lags
      real(wp) :: tail_l0 = 0.0_wp, tail_moment = 0.0_wp
      integer :: power = 1                           !! coordinate = mu (1 + sum a_q)**power/b0
      integer :: max_lags = 0                        !! that a fit carries in a minute or two
      real(wp) :: longest = huge(1.0_wp)             !! L0, likewise
      integer :: n_lags = 0
      integer :: memory = 0                          !! steps beyond which nothing is felt, to 1e-9
      integer :: n_burn_in = 0                       !! steps, or sweeps
      integer :: n_steps = 0                         !! of a batch
      !> values simulated so far, in units of those of low order, and how many at most: a bound
      !> that does not depend on the machine, some 30 s of a processor
      real(wp) :: effort = 0.0_wp, most_effort = 3.0e9_wp
      type(shared_numbers) :: numbers
      real(wp), allocatable :: a(:)                  !! of the last evaluation, as all that follows
      real(wp) :: coordinate = 0.0_wp
      !> near the mean [b0]: where chains start, and products are taken about it, so that hardly
      !> anything is left of what enters and leaves at the ends of a batch
      real(wp) :: centre = 1.0_wp
      type(batch_averages) :: batches
      type(positive_moments) :: moments
   contains
      procedure :: evaluate
      procedure :: unfold
      procedure :: imposed_length
      procedure :: keep_every_lag
      procedure :: name => name_of_law
      procedure :: is_exhausted
      procedure, private :: count_values
      procedure :: state_rests
      procedure(sample_law), deferred :: sample
      procedure(settle_law), deferred :: settle
      procedure(features_of_law), deferred :: features
      procedure(rests_of_law), deferred :: feature_rests
      procedure(entropy_of_law), deferred :: find_entropy
   end type positive_law

   abstract interface
      !> Fills `batches` for `a` and `coordinate`.
      subroutine sample_law(self)
         import :: positive_law
         class(positive_law), intent(inout) :: self
      end subroutine sample_law

      !> Chooses the burn-in for points near these coefficients.
      subroutine settle_law(self, a)
         import :: positive_law, wp
         class(positive_law), intent(inout) :: self
         real(wp), intent(in) :: a(:)
      end subroutine settle_law

      !> What `gain` needs of a point, from `batches` and `moments`.
      function features_of_law(self) result(features)
         import :: positive_law, wp
         class(positive_law), intent(in) :: self
         real(wp), allocatable :: features(:)
      end function features_of_law

      !> (batch, feature) What is left of each batch's deviation from the features.
      function rests_of_law(self) result(rests)
         import :: positive_law, wp
         class(positive_law), intent(in) :: self
         real(wp), allocatable :: rests(:, :)
      end function rests_of_law

      !> Entropy per point of x/b0 at the point of the last evaluation, and its standard error.
      subroutine entropy_of_law(self, entropy, standard_error)
         import :: positive_law, wp
         class(positive_law), intent(inout) :: self
         real(wp), intent(out) :: entropy, standard_error
      end subroutine entropy_of_law
   end interface

   !> One-at-a-time rejection (Sec. 2.4); coordinate: mu (1 + sum a_q)/b0. Its entropy is an
   !> average.
   type, extends(positive_law) :: sequential_law
   contains
      procedure, nopass :: gain => gain_by_difference
      procedure :: sample => sample_sequential_law
      procedure :: settle => settle_sequential
      procedure :: features => entropy_feature
      procedure :: feature_rests => entropy_rests
      procedure :: find_entropy => averaged_entropy
   end type sequential_law

   !> Eq. (25); coordinate: mu (1 + sum a_q)^2/b0. Its entropy is known by its differences: along a
   !> change of the multipliers, dh = - sum (multiplier) d(moment).
   type, extends(positive_law) :: exact_law
   contains
      procedure, nopass :: gain => gain_by_multipliers
      procedure :: sample => sample_exact_law
      procedure :: settle => settle_exact
      procedure :: features => multiplier_features
      procedure :: feature_rests => multiplier_rests
      procedure :: find_entropy => integrated_entropy
      procedure :: ring_length
   end type exact_law

contains

   !> Reflection coefficients and coordinate of a point. Where no process is, a coefficient is 1.
   subroutine unfold(self, point, kappa, coordinate)
      class(positive_law), intent(in) :: self
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: kappa(:)
      real(wp), intent(out) :: coordinate
      real(wp), parameter :: outside = 40.0_wp   ! of any process: nothing overflows

      if (allocated(self%symbol)) then
         kappa = reflection_of_symbol([1.0_wp, exp(min(point(1), outside))*self%symbol])
      else if (allocated(self%shape)) then
         kappa = tanh(exp(min(point(1), outside))*self%shape)
      else
         kappa = tanh(self%factor*point(:size(point) - 1))
      end if
      coordinate = sinh(max(-outside, min(point(size(point)), outside)))
   end subroutine unfold

   pure function reflection_of_symbol(symbol) result(kappa)
      real(wp), intent(in) :: symbol(0:)
      real(wp) :: kappa(ubound(symbol, 1))
      real(wp) :: a(ubound(symbol, 1)), b0
      logical :: is_positive

      a = 0.0_wp
      b0 = 1.0_wp/sqrt(symbol(0))
      call factor_symbol(symbol, a, b0, is_positive)
      kappa = 1.0_wp
      if (is_positive) kappa = reflection_of(a)
   end function reflection_of_symbol

   !> Ratio and length relative to what is wanted, then the features.
   subroutine evaluate(self, point, state, is_inside)
      class(positive_law), intent(inout) :: self
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: state(:)
      logical, intent(out) :: is_inside
      real(wp), allocatable :: kappa(:)
      real(wp) :: length

      call self%unfold(point, kappa, self%coordinate)
      is_inside = all(abs(kappa) < largest_kappa) .and. abs(self%coordinate) < 1.0e6_wp &
                  .and. .not. self%is_exhausted()
      if (.not. is_inside) return
      self%a = coefficients_of(kappa)
      call self%sample()
      self%moments = estimate_moments(self%batches, self%companion_autocovariance, size(self%a), &
                                      self%tail_l0, self%tail_moment)
      is_inside = self%moments%std > 0.0_wp
      if (.not. is_inside) return
      length = self%imposed_length()
      state = [self%moments%ratio/self%wanted_ratio - 1.0_wp, length/self%wanted_length - 1.0_wp, &
               self%features()]
   end subroutine evaluate

   pure function is_exhausted(self)
      class(positive_law), intent(in) :: self
      logical :: is_exhausted

      is_exhausted = self%effort >= self%most_effort
   end function is_exhausted

   !> A value of high order costs more, and so does each lag that is kept.
   pure subroutine count_values(self, n_steps)
      class(positive_law), intent(inout) :: self
      integer, intent(in) :: n_steps   !! of all lanes

      self%effort = self%effort + real(lanes, wp)*n_steps &
                    *(1.0_wp + 0.05_wp*(size(self%a) + self%batches%n_single))
   end subroutine count_values

   !> (batch, component) What is left of each batch's deviation from the state of the last
   !> evaluation; lengths as infinite sums.
   function state_rests(self) result(rests)
      class(positive_law), intent(in) :: self
      real(wp), allocatable :: rests(:, :)

      associate (from => self%moments%rests)
         rests = reshape([from(:, 2)/self%wanted_ratio, &
                          from(:, merge(3, 4, self%correlation == 'L0'))/self%wanted_length, &
                          self%feature_rests()], &
                         [size(from, 1), n_constraints + size(self%features())])
      end associate
   end function state_rests

   !> The length of the last evaluation as it is imposed, infinite or cut.
   pure function imposed_length(self) result(length)
      class(positive_law), intent(in) :: self
      real(wp) :: length
      type(positive_moments) :: moments

      moments = self%moments
      if (self%cut > 0) moments = estimate_moments(self%batches, &
                                                   self%companion_autocovariance(:self%cut), &
                                                   self%cut, 0.0_wp, 0.0_wp)
      length = merge(moments%l0, moments%l1, self%correlation == 'L0')
   end function imposed_length

   !> For messages.
   pure function name_of_law(self, order) result(name)
      class(positive_law), intent(in) :: self
      integer, intent(in) :: order
      character(:), allocatable :: name

      name = 'positive process ('//trim(merge('exact     ', 'sequential', self%power == 2))// &
             ' law) with std/mean = '//to_text(self%wanted_ratio)//', '//self%correlation//' = '// &
             to_text(self%wanted_length)//', order = '//to_text(order)
   end function name_of_law

   !> From now on averages of every lag, at the cost of every lag.
   subroutine keep_every_lag(self)
      class(positive_law), intent(inout) :: self

      self%batches = new_batches(self%n_lags, self%n_lags, n_batches)
   end subroutine keep_every_lag

   subroutine sample_sequential_law(self)
      class(sequential_law), intent(inout) :: self
      integer :: n_steps

      n_steps = max(self%n_steps, self%n_lags)
      call self%count_values(self%n_burn_in + n_batches/lanes*n_steps)
      call self%numbers%rewind(numbers_needed(self%n_burn_in, n_steps, n_batches/lanes))
      call sample_sequential(self%a, self%coordinate, self%companion, self%centre, &
                             self%n_burn_in, n_steps, self%numbers, self%batches)
   end subroutine sample_sequential_law

   !> The companion's memory measures that of every process of the wanted length.
   subroutine settle_sequential(self, a)
      class(sequential_law), intent(inout) :: self
      real(wp), intent(in) :: a(:)

      self%n_burn_in = max(self%memory, size(a))
      if (self%moments%mean > 0.0_wp) self%centre = self%moments%mean
   end subroutine settle_sequential

   function entropy_feature(self) result(features)
      class(sequential_law), intent(in) :: self
      real(wp), allocatable :: features(:)

      features = [self%moments%entropy]
   end function entropy_feature

   function entropy_rests(self) result(rests)
      class(sequential_law), intent(in) :: self
      real(wp), allocatable :: rests(:, :)

      rests = self%moments%rests(:, 5:)
   end function entropy_rests

   subroutine averaged_entropy(self, entropy, standard_error)
      class(sequential_law), intent(inout) :: self
      real(wp), intent(out) :: entropy, standard_error

      entropy = self%moments%entropy + log(self%moments%std)
      standard_error = self%moments%entropy_error
   end subroutine averaged_entropy

   pure real(wp) function gain_by_difference(from, to) result(gain)
      real(wp), intent(in) :: from(:), to(:)

      gain = to(n_constraints + 1) - from(n_constraints + 1)
   end function gain_by_difference

   subroutine sample_exact_law(self)
      class(exact_law), intent(inout) :: self
      integer :: n_sweeps

      n_sweeps = max(self%n_steps/self%ring_length(), 2)
      call self%numbers%rewind(real(lanes, wp)*self%ring_length()*(self%n_burn_in + &
                                                                   n_batches/lanes*n_sweeps))
      call self%count_values((self%n_burn_in + n_batches/lanes*n_sweeps)*self%ring_length())
      call sample_exact(self%a, self%coordinate, self%companion, self%centre, &
                        self%ring_length(), self%n_burn_in, n_sweeps, self%numbers, self%batches)
   end subroutine sample_exact_law

   !> Values per ring: K has fallen below 1e-8 before it comes around.
   pure function ring_length(self) result(length)
      class(exact_law), intent(in) :: self
      integer :: length

      length = max(3*self%n_lags, 64)
   end function ring_length

   !> By the variance of the last evaluation; before the first one, by the companion's.
   subroutine settle_exact(self, a)
      class(exact_law), intent(inout) :: self
      real(wp), intent(in) :: a(:)
      real(wp) :: variance

      variance = self%companion_autocovariance(0)
      if (self%moments%std > 0.0_wp) then
         variance = self%moments%std**2
         self%centre = self%moments%mean
      end if
      self%n_burn_in = sweeps_to_forget(a, variance, self%wanted_l0, 1.0e-5_wp)
   end subroutine settle_exact

   !> Moments m, K(0..order), and their multipliers.
   function multiplier_features(self) result(features)
      class(exact_law), intent(in) :: self
      real(wp), allocatable :: features(:)
      real(wp), allocatable :: k(:), unused(:)
      real(wp) :: g(0:size(self%a))

      call estimate_autocovariance(self%batches, self%companion_autocovariance, size(self%a), k, &
                                   unused)
      g = symbol_of_process(self%a, 1.0_wp)
      g(0) = 0.5_wp*g(0)
      features = [self%moments%mean, k, self%moments%mean*(1.0_wp + sum(self%a))**2 &
                  - self%coordinate, g]
   end function multiplier_features

   !> Multipliers are known but for the mean in the first one.
   function multiplier_rests(self) result(rests)
      class(exact_law), intent(in) :: self
      real(wp), allocatable :: rests(:, :)
      real(wp), allocatable :: unused_k(:), unused(:)
      integer :: n

      n = size(self%a)
      allocate (rests(size(self%batches%x, 2), 2*n + 4), source=0.0_wp)
      rests(:, 1) = self%moments%rests(:, 1)
      call estimate_autocovariance(self%batches, self%companion_autocovariance, n, unused_k, &
                                   unused, rests(:, 2:n + 2))
      rests(:, n + 3) = rests(:, 1)*(1.0_wp + sum(self%a))**2
   end function multiplier_rests

   !> Of the entropy of x/std; the trapezoidal rule along the change.
   pure real(wp) function gain_by_multipliers(from, to) result(gain)
      real(wp), intent(in) :: from(:), to(:)
      integer :: first, n

      first = n_constraints + 1
      n = (size(from) - n_constraints)/2
      gain = 0.5_wp*dot_product(from(first + n:) + to(first + n:), to(first:first + n - 1) &
                                - from(first:first + n - 1)) &
             - 0.5_wp*log(to(first + 1)/from(first + 1))
   end function gain_by_multipliers

   !> See `process_positive_partition`.
   subroutine integrated_entropy(self, entropy, standard_error)
      class(exact_law), intent(inout) :: self
      real(wp), intent(out) :: entropy, standard_error
      integer, parameter :: enough = 8192   ! steps of a batch: each node has as many
      real(wp) :: psi, psi_error

      call self%numbers%rewind(huge(1.0_wp))
      call log_partition(self%a, self%coordinate, self%ring_length(), self%n_burn_in, &
                         max(min(self%n_steps, enough)/self%ring_length(), 2), self%numbers, psi, &
                         psi_error)
      entropy = entropy_of_exact_law(psi, self%coordinate, self%moments%mean)
      standard_error = norm2([psi_error, 0.5_wp*self%coordinate*self%moments%mean_error])
   end subroutine integrated_entropy

end module process_positive_law
