!> Entropy of a simulated positive process as the function that a search maximizes, with std/mean
!> and the correlation length as constraints.
!>
!> A family turns a point into the parameters of a law. Each evaluation simulates that law with the
!> same random numbers, so that the function is smooth. Everything is in units of b0.
module process_positive_objective
   use core_kinds, only: wp
   use numerics_constrained_maximum, only: objective_type
   use process_autoregressive_model, only: reflection_of
   use process_correlation, only: constraint_weights
   use process_positive_exact, only: log_partition, sample_exact, sweeps_to_forget
   use process_positive_family, only: by_symbol, law_estimate, parameter_family
   use process_positive_moments, only: estimate_autocovariance, estimate_moments, new_batches, &
                                       positive_moments
   use process_positive_problem, only: sampled_problem
   use process_positive_sequential, only: sample_sequential
   use process_positive_truncated_normal, only: lanes, log_sqrt_two_pi
   implicit none(type, external)
   private
   public :: sampled_objective, new_objective

   real(wp), parameter, public :: difference_step = 1.0e-5_wp   !! step of finite differences
   integer, parameter :: n_batches = 16*lanes       !! batches of a simulation
   real(wp), parameter :: largest_ratio = 20.0_wp   !! std/mean of chains that diverge

   !> State of a search: problem, family of its points, length of simulations, last evaluation.
   !> Constraints are std/mean, the length (or L0 and L1), and K(m)/K(0) of lags where it is 0.
   type, extends(objective_type) :: sampled_objective
      type(sampled_problem) :: problem
      type(parameter_family) :: family
      integer, allocatable :: zeros(:)               !! lags where K(m) is held at 0
      real(wp), allocatable :: signs(:)              !! (0:n_lags) assumed signs of K(m)
      integer :: n_burn_in = 0                       !! steps (exact law: sweeps) of the burn-in
      integer :: n_steps = 0                         !! steps of a batch
      !> start of chains and origin of products, near the mean, which keeps the terms at the ends of
      !> a batch small
      real(wp) :: centre = 1.0_wp
      !> simulated values, weighted by their cost, and their bound, some 40 s of a processor
      real(wp) :: effort = 0.0_wp, max_effort = 4.0e9_wp
      type(law_estimate) :: last                     !! law and moments of the last evaluation
      !> (batch, component) deviations of the batches from the state, less what controls explain;
      !> of the multipliers' components only the first one has any
      real(wp), allocatable :: residuals(:, :)
      real(wp), allocatable :: state(:)              !! state of the last evaluation
      real(wp) :: psi_error = 0.0_wp   !! exact law: see `log_partition`
   contains
      procedure :: evaluate
      procedure :: gain
      procedure :: set_burn_in
      procedure :: set_single_lags
      procedure :: hold_at_zero
      procedure :: is_exhausted
      procedure :: find_entropy
      procedure :: estimate_lags
   end type sampled_objective

contains

   !> Makes the objective of a problem, in the family by_symbol (direct method) or by_reflection.
   subroutine new_objective(problem, objective)
      type(sampled_problem), intent(in) :: problem
      type(sampled_objective), intent(out) :: objective
      real(wp), parameter :: inside = 1.0_wp - 1.0e-9_wp   ! |s_m| of a free s_m, at most
      real(wp), allocatable :: weights(:)   ! a_m, m = 0..m_max
      integer :: m

      objective%problem = problem
      objective%n_constraints = merge(3, 2, problem%request%correlation == 'both')
      allocate (objective%signs(0:problem%n_lags), source=sign(1.0_wp, problem%autocovariance))
      allocate (objective%zeros(0))
      allocate (objective%last%g(0:size(problem%companion)), source=0.0_wp)
      if (allocated(problem%symbol)) then
         weights = constraint_weights(problem%request%correlation, &
                                      problem%request%correlation_length, size(problem%symbol))
         ! |s_m| = 1 where |G_m/a_m| is largest; where a_m = 0 the sign does not matter
         associate (a => weights(2:), symbol => problem%symbol, family => objective%family)
            family%kind = by_symbol
            family%direction = a*maxval(abs(symbol)/abs(a), abs(a) > 0.0_wp)
            family%s = spread(1.0_wp, 1, size(a))
            where (abs(a) > 0.0_wp) family%s = symbol/family%direction
            objective%zeros = pack([(m, m=1, size(a))], abs(family%s) < inside)
            ! the companion's K(m) may have other signs than the sequence
            where (abs(a) > 0.0_wp .and. abs(family%s) >= inside) &
               objective%signs(1:size(a)) = sign(1.0_wp, family%s)
            family%free_lags = objective%zeros
            family%start = [0.0_wp, family%s(family%free_lags)]
         end associate
      else
         objective%family%start = atanh(reflection_of(problem%companion))
      end if
      objective%n_constraints = objective%n_constraints + size(objective%zeros)
      call objective%set_single_lags()
   end subroutine new_objective

   !> Evaluates the state of a point: constraints, then the features that `gain` needs.
   subroutine evaluate(self, point, state, is_inside)
      class(sampled_objective), intent(inout) :: self
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: state(:)
      logical, intent(out) :: is_inside

      associate (problem => self%problem, last => self%last)
         call self%family%set_parameters(point, last, is_inside)
         is_inside = is_inside .and. .not. self%is_exhausted()
         if (.not. is_inside) return
         call simulate(self)
         last%moments = estimate_moments(last%batches, problem%autocovariance, ubound(last%g, 1), &
                                         problem%tail_l0, problem%tail_moment, self%signs)
         is_inside = last%moments%std > 0.0_wp .and. last%moments%ratio < largest_ratio
         if (.not. is_inside) return
         call describe_state(self, state)
         self%state = state
      end associate
   end subroutine evaluate

   !> Computes the state of the last simulation, and its residuals. Features of the sequential law:
   !> entropy of x/std; of the exact law: mean, K(0..order), and the multipliers of these moments.
   subroutine describe_state(self, state)
      class(sampled_objective), intent(inout) :: self
      real(wp), allocatable, intent(out) :: state(:)
      type(positive_moments) :: cut   ! where lengths are imposed as finite sums
      real(wp), allocatable :: k(:), lags(:, :)
      real(wp) :: g(0:ubound(self%last%g, 1))
      integer :: i, n, n_features

      associate (problem => self%problem, last => self%last, all => self%last%moments)
         cut = all
         if (problem%cut > 0) &
            cut = estimate_moments(last%batches, problem%autocovariance(:problem%cut), &
                                   problem%cut, 0.0_wp, 0.0_wp, self%signs(:problem%cut))
         n_features = merge(2*size(g) + 2, 1, problem%is_exact)
         n = max(0, maxval(self%zeros), merge(ubound(g, 1), 0, problem%is_exact))
         allocate (state(0), lags(n_batches, 0:n))
         if (n > 0) call self%estimate_lags(n, k, residuals=lags)
         if (allocated(self%residuals)) deallocate (self%residuals)
         allocate (self%residuals(n_batches, self%n_constraints + n_features), source=0.0_wp)
         call add(all%ratio/problem%ratio - 1.0_wp, all%residuals(:, 2)/problem%ratio)
         associate (length => problem%request%correlation_length, &
                    second => problem%request%second_length)
            if (problem%request%correlation == 'L1') then
               call add(cut%l1/length - 1.0_wp, cut%residuals(:, 4)/length)
            else
               call add(cut%l0/length - 1.0_wp, cut%residuals(:, 3)/length)
            end if
            if (self%n_constraints - size(self%zeros) == 3) &
               call add(cut%l1/second - 1.0_wp, cut%residuals(:, 4)/second)
         end associate
         do i = 1, size(self%zeros)
            associate (rho => k(self%zeros(i))/k(0))
               call add(rho, (lags(:, self%zeros(i)) - rho*lags(:, 0))/k(0))
            end associate
         end do
         if (.not. problem%is_exact) then
            call add(all%entropy, all%residuals(:, 5))
            return
         end if
         g = last%g
         g(0) = 0.5_wp*g(0)
         call add(all%mean, all%residuals(:, 1))
         do i = 0, ubound(g, 1)
            call add(k(i), lags(:, i))
         end do
         call add(2.0_wp*all%mean*sum(g) - last%field, 2.0_wp*sum(g)*all%residuals(:, 1))
         state = [state, g]
      end associate

   contains

      subroutine add(value, residual)
         real(wp), intent(in) :: value, residual(:)

         state = [state, value]
         self%residuals(:, size(state)) = residual
      end subroutine add

   end subroutine describe_state

   !> Simulates the law, with the same random numbers at every evaluation, and counts the values,
   !> weighted by what the order and, after the burn-in, the single lags make them cost.
   subroutine simulate(self)
      class(sampled_objective), intent(inout) :: self
      integer, parameter :: most_kept = 2**20   ! random numbers: 8 MB
      integer :: n, n_each     ! steps or sweeps of a batch; values of each
      integer :: n_values(2)   ! values of a lane in the burn-in, and after it

      associate (problem => self%problem, last => self%last, stream => self%problem%stream)
         n_each = merge(ring_length(self), 1, problem%is_exact)
         n = max(self%n_steps/n_each, merge(2, problem%n_lags, problem%is_exact))
         last%n_steps = n*n_each
         n_values = n_each*[self%n_burn_in, n_batches/lanes*n]
         call stream%restart(lanes*min(sum(n_values), most_kept/lanes))
         if (problem%is_exact) then
            call sample_exact(last%g, last%field, problem%companion, self%centre, &
                              ring_length(self), self%n_burn_in, n, stream, last%batches)
         else
            call sample_sequential(last%a, last%field, problem%companion, self%centre, &
                                   self%n_burn_in, n, stream, last%batches)
         end if
         self%effort = self%effort + lanes*(sum(n_values)*(1.0_wp + 0.05_wp*ubound(last%g, 1)) &
                                            + n_values(2)*0.05_wp*last%batches%n_single)
      end associate
   end subroutine simulate

   !> Values per ring (exact law): K(m) is below 1e-8 K(0) half a ring away.
   pure integer function ring_length(self)
      class(sampled_objective), intent(in) :: self

      ring_length = max(3*self%problem%n_lags, 64)
   end function ring_length

   !> True if the search has simulated as many values as it may.
   pure logical function is_exhausted(self)
      class(sampled_objective), intent(in) :: self

      is_exhausted = self%effort >= self%max_effort
   end function is_exhausted

   !> Sets the burn-in for points near that of the search: the companion's memory (sequential law),
   !> or the sweeps that forget a start at the variance of the last evaluation (exact law; at first
   !> at the companion's).
   pure subroutine set_burn_in(self)
      class(sampled_objective), intent(inout) :: self
      type(law_estimate) :: here
      real(wp) :: variance
      logical :: is_inside

      variance = self%problem%autocovariance(0)
      if (self%last%moments%std > 0.0_wp) then
         variance = self%last%moments%std**2
         self%centre = self%last%moments%mean
      end if
      self%n_burn_in = max(self%problem%memory, size(self%problem%companion))
      if (.not. self%problem%is_exact) return
      here%g = self%last%g
      call self%family%set_parameters(self%point, here, is_inside)
      self%n_burn_in = sweeps_to_forget(here%g(0)*variance, self%problem%l0, 1.0e-5_wp)
      if (self%problem%decay > 0.0_wp) &   ! alternating: neighbours pass correlation on
         self%n_burn_in = max(self%n_burn_in, ceiling(12.0_wp/(1.0_wp - self%problem%decay)**2))
   end subroutine set_burn_in

   !> Sets the number of lags with averages of their own: by default what the order, the zeros and
   !> negative signs need.
   pure subroutine set_single_lags(self, n_single)
      class(sampled_objective), intent(inout) :: self
      integer, intent(in), optional :: n_single
      integer :: n

      n = min(max(self%problem%request%order, maxval(self%zeros)), self%problem%n_lags)
      if (any(self%signs(n + 1:) < 0.0_wp)) n = self%problem%n_lags
      if (present(n_single)) n = n_single
      if (n == self%last%batches%n_single) return
      self%last%batches = new_batches(self%problem%n_lags, n, n_batches)
   end subroutine set_single_lags

   !> Sets the lags at which K(m) = 0 is a constraint.
   pure subroutine hold_at_zero(self, lags)
      class(sampled_objective), intent(inout) :: self
      integer, intent(in) :: lags(:)

      self%n_constraints = self%n_constraints - size(self%zeros) + size(lags)
      self%zeros = lags
      if (self%family%kind == by_symbol) call self%family%set_free_lags(lags, self%point)
   end subroutine hold_at_zero

   !> Entropy of x/std gained from one state to another [nat]. Exact law: dh = - sum (multiplier)
   !> d(moment) along the way, by the trapezoidal rule.
   pure real(wp) function gain(self, from, to)
      class(sampled_objective), intent(in) :: self
      real(wp), intent(in) :: from(:), to(:)
      integer :: first, n

      first = self%n_constraints + 1
      gain = to(first) - from(first)
      if (.not. self%problem%is_exact) return
      n = (size(from) - self%n_constraints)/2
      gain = 0.5_wp*dot_product(from(first + n:) + to(first + n:), to(first:first + n - 1) &
                                - from(first:first + n - 1)) &
             - 0.5_wp*log(to(first + 1)/from(first + 1))
   end function gain

   !> Adds the entropy and Lambda of the exact law to the moments of the last evaluation.
   subroutine find_entropy(self)
      class(sampled_objective), intent(inout) :: self
      integer, parameter :: most_steps = 8192   ! steps of a batch at each node of `log_partition`
      real(wp) :: psi   ! ln Z per point

      if (.not. self%problem%is_exact) return
      associate (last => self%last, moments => self%last%moments, stream => self%problem%stream)
         call stream%restart(0)
         call log_partition(last%g, last%field, ring_length(self), self%n_burn_in, &
                            max(min(self%n_steps, most_steps)/ring_length(self), 2), stream, &
                            psi, self%psi_error)
         ! E[x_i (G (x - mu))_i] = 1: Eq. (43) with its factor 1/2
         moments%entropy = psi + 0.5_wp - 0.5_wp*last%field*moments%mean - log(moments%std)
         moments%entropy_error = norm2([self%psi_error, 0.5_wp*last%field*moments%mean_error])
         if (self%problem%decay > 0.0_wp) return   ! the Gaussian process need not exist
         moments%lambda = exp(max(psi - log_sqrt_two_pi - &
                                  0.5_wp*(last%field/(1.0_wp + sum(last%a)))**2, log(tiny(psi))))
         moments%lambda_error = moments%lambda*self%psi_error
      end associate
   end subroutine find_entropy

   !> Estimates K(m), m = 0..last, of the last evaluation.
   pure subroutine estimate_lags(self, last, k, standard_error, residuals)
      class(sampled_objective), intent(in) :: self
      integer, intent(in) :: last
      real(wp), allocatable, intent(out) :: k(:)                          !! (0:last)
      real(wp), allocatable, intent(out), optional :: standard_error(:)   !! (0:last)
      real(wp), intent(out), optional :: residuals(:, 0:)   !! see `estimate_autocovariance`

      call estimate_autocovariance(self%last%batches, self%problem%autocovariance, last, k, &
                                   standard_error, residuals)
   end subroutine estimate_lags

end module process_positive_objective
