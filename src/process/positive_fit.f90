!> The positive process of given mean, std and correlation length with the largest entropy (Sec.
!> 2.4.1), under the law of one-at-a-time rejection or under that of Eq. (25).
!>
!> Its moments have no closed form. They are averages over simulated values, the same random numbers
!> at every trial, so that what is solved is a smooth problem; its answer differs from the true one
!> by the standard errors that are handed back.
module process_positive_fit
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: to_text
   use numerics_constrained_maximum, only: maximize, search_result, solve_along
   use process_ar_model, only: coefficients_of, find_poles, innovation_std
   use process_correlation, only: constraint_weights, &
      correlation_length_l0, correlation_length_l1
   use process_entropy, only: white_noise_entropy
   use process_model, only: process_model_type, process_request
   use process_positive_exact, only: precision_of
   use process_positive_first_order, only: describe_first_order, match_first_order
   use process_positive_kernel, only: first_order_law
   use process_positive_law, only: exact_law, n_constraints, positive_law, prepare_law, &
      sequential_law
   use process_positive_limit, only: follow_family
   use process_positive_moments, only: estimate_autocovariance
   use process_positive_partition, only: log_sqrt_two_pi
   use process_truncated_normal, only: fit_truncated_normal, hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: fit_positive, foresee_positive

   integer, parameter :: quick_steps = 128     !! of a batch on the way to a first solution
   integer, parameter :: limit_steps = 1024    !! of a batch where std/mean may end
   integer, parameter :: shape_steps = 512     !! of a batch while the shape is sought
   integer, parameter :: final_steps = 4096    !! of a batch of the final solution, at least
   integer, parameter :: most_refinement = 16  !! times as many where the errors want it
   !> relative standard errors
   real(wp), parameter :: ratio_goal = 2.5e-4_wp, length_goal = 2.5e-3_wp
   !> relative, of ratio and length on the simulated values
   real(wp), parameter :: matched = 1.0e-7_wp
   real(wp), parameter :: close_enough = 1.0e-5_wp  !! as matched, on the way
   !> gradient of the entropy left, over its largest component
   real(wp), parameter :: stationary = 0.02_wp

contains

   !> Solves the request or says why not: `model%is_solved`, `model%reason`.
   subroutine fit_positive(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      class(positive_law), allocatable :: law
      type(first_order_law) :: first_order
      type(search_result) :: found
      type(error_type), allocatable :: error
      real(wp), allocatable :: point(:)
      real(wp) :: mu, sigma, violation

      model%request = request
      if (.not. abs(request%correlation_length) > 0.0_wp) then
         call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
         if (.not. allocated(error)) call describe_white(request, mu, sigma, model)
      else if (is_first_order(request)) then
         call match_first_order(request, first_order, error)
         if (.not. allocated(error)) call describe_first_order(request, first_order, model, error)
      else
         call approach(request, seed, law, point, found, error)
         if (.not. allocated(error)) call find_shape(law, point, found, error)
         if (.not. allocated(error)) then
            call match_targets(law, request%fit_steps, found, point, violation)
            call describe(request, law, model, error)
         end if
         if (.not. allocated(error)) call compare_laws(request, law, point, model)
         if (request%method == 'direct' .and. .not. allocated(error)) &
            call name_multipliers(request, model)
         model%optimality = merge(violation, found%residual, request%method == 'direct')
      end if
      model%is_solved = .not. allocated(error)
      if (allocated(error)) model%reason = error%message
   end subroutine fit_positive

   !> What is known before the fit: fails where `fit_positive` would not even begin.
   subroutine foresee_positive(request, seed, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(error_type), allocatable, intent(out) :: error
      class(positive_law), allocatable :: law
      type(first_order_law) :: first_order
      type(search_result) :: found
      real(wp), allocatable :: point(:)
      real(wp) :: mu, sigma

      if (.not. abs(request%correlation_length) > 0.0_wp) then
         call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      else if (is_first_order(request)) then
         call match_first_order(request, first_order, error)
      else
         call approach(request, seed, law, point, found, error)
      end if
   end subroutine foresee_positive

   !> What quadrature solves.
   pure function is_first_order(request) result(is_so)
      type(process_request), intent(in) :: request
      logical :: is_so

      is_so = request%order == 1 .and. request%method == 'autoregressive' .and. &
              (request%sampler == 'sequential' .or. request%sampler == 'exact')
   end function is_first_order

   !> Without correlation both laws are the univariate one, in closed form.
   subroutine describe_white(request, mu, sigma, model)
      type(process_request), intent(in) :: request
      real(wp), intent(in) :: mu, sigma
      type(process_model_type), intent(inout) :: model
      integer :: order

      order = request%order
      model%is_solved = .true.
      model%order = order
      model%a = spread(0.0_wp, 1, order)
      model%b0 = sigma
      model%mu = mu
      model%poles = spread((0.0_wp, 0.0_wp), 1, order)
      allocate (model%autocovariance(0:order), model%autocovariance_error(0:order), source=0.0_wp)
      model%autocovariance(0) = request%std**2
      model%mean = request%mean
      model%std = request%std
      model%entropy = white_noise_entropy(sigma) + log_acceptance(mu/sigma) &
                      - 0.5_wp*mu/sigma*hazard_ratio(mu/sigma)
      model%entropy_bound = white_noise_entropy(request%std)
      model%lambda = exp(max(log_acceptance(mu/sigma), log(tiny(1.0_wp))))
      model%acceptance_ratio = model%lambda
      model%acceptance_mean = model%lambda
      model%acceptance_geometric = model%lambda
      model%memory = order
      model%other_mean = model%mean
      model%other_std = model%std
      model%other_entropy = model%entropy
   end subroutine describe_white

   !> The unconstrained optimum of another length that has the targets under the law, on few
   !> simulated values: `point` is (factor, coordinate). Fails where that family ends before.
   subroutine approach(request, seed, law, point, found, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      class(positive_law), allocatable, intent(out) :: law
      real(wp), allocatable, intent(out) :: point(:)
      type(search_result), intent(out) :: found
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: kappa(:)
      real(wp) :: coordinate, limit, mu, sigma
      logical :: is_reached

      call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      if (allocated(error)) return
      call prepare_law(request, request%sampler, stream_of(seed), law, kappa, error)
      if (allocated(error)) return
      ! a first guess: the unconstrained optimum and the univariate law
      law%shape = atanh(kappa)
      coordinate = mu/(sigma*innovation_std(kappa, 1.0_wp))*(1.0_wp + sum(law%companion))**law%power
      point = [1.0_wp, coordinate]
      law%n_steps = quick_steps
      call law%settle(law%companion)
      call maximize(law, point, n_constraints, 1.0e-4_wp, close_enough, 8, found)
      if (found%violation > close_enough) then
         point = [1.0_wp, coordinate]
         law%n_steps = limit_steps
         call follow_family(law, point, limit, is_reached)
         if (.not. is_reached) then
            call raise(error, exit_no_solution, name_of(law, size(kappa))//reason_of_end(limit))
            return
         end if
         call maximize(law, point, n_constraints, 1.0e-4_wp, close_enough, 20, found)
      end if
      found%is_converged = found%violation <= close_enough
      call require_converged(law, found, size(kappa), error)
   end subroutine approach

   !> Why a family does not have the wanted ratio.
   pure function reason_of_end(limit) result(reason)
      real(wp), intent(in) :: limit   !! the largest std/mean met; 0: none
      character(:), allocatable :: reason

      if (limit > 0.0_wp) then
         reason = ': with the shape of the unconstrained optimum std/mean ends near '// &
                  to_text(nint(1.0e2_wp*limit)/1.0e2_wp)//', where mu runs away to minus infinity'
      else
         reason = ': nothing was found with the shape of the unconstrained optimum; '// &
                  'a smaller std, or a shorter length, is nearer to what exists'
      end if
   end function reason_of_end

   !> Every coefficient free. The direct method's form is that of the maximum already.
   subroutine find_shape(law, point, found, error)
      class(positive_law), intent(inout) :: law
      real(wp), allocatable, intent(inout) :: point(:)
      type(search_result), intent(inout) :: found
      type(error_type), allocatable, intent(out) :: error

      law%n_steps = shape_steps
      if (allocated(law%symbol)) return
      point = [point(1)*law%shape, point(2)]
      deallocate (law%shape)
      call free_shape(law, point, found)
      call require_converged(law, found, size(point) - 1, error)
   end subroutine find_shape

   subroutine require_converged(law, found, order, error)
      class(positive_law), intent(in) :: law
      type(search_result), intent(in) :: found
      integer, intent(in) :: order
      type(error_type), allocatable, intent(out) :: error

      if (.not. found%is_converged) &
         call raise(error, exit_no_solution, name_of(law, order)//': the search ended '// &
                    to_text(found%violation)//' (relative) from its targets, with '// &
                    to_text(found%residual)//' of the gradient left')
   end subroutine require_converged

   !> The simulated values are the same in every fit of a seed.
   pure function stream_of(seed) result(stream)
      integer(long), intent(in) :: seed
      type(stream_type) :: stream

      stream = new_stream(seed, label_of('positive process'), 0)
   end function stream_of

   !> Every coefficient free. Where correlation is so weak that the entropy does not feel its shape
   !> above the noise of the sample, the shape of the unconstrained optimum is kept, with the
   !> residual it leaves.
   subroutine free_shape(law, point, found)
      class(positive_law), intent(inout) :: law
      real(wp), intent(inout) :: point(:)
      type(search_result), intent(out) :: found
      real(wp), parameter :: weak = 0.02_wp, feeble = 0.001_wp   !! largest reflection coefficient
      real(wp), allocatable :: autocovariance(:), standard_error(:)
      real(wp) :: family(size(point)), strength
      integer :: order

      order = size(point) - 1
      family = point
      call law%settle(coefficients_of(tanh(point(:order))))
      strength = maxval(abs(tanh(point(:order))))
      if (strength > feeble) then
         call maximize(law, point, n_constraints, 1.0e-4_wp, min(1.0e-3_wp, stationary*strength), &
                       30, found)
         if (strength > weak) return
         call estimate_autocovariance(law%batches, law%companion_autocovariance, order, &
                                      autocovariance, &
                                      standard_error)
         associate (companion => law%companion_autocovariance(0:order))
            if (found%is_converged .and. &
                all(autocovariance*sign(1.0_wp, companion) > -4.0_wp*standard_error)) return
         end associate
         point = family
      end if
      call maximize(law, point, n_constraints, 1.0e-4_wp, huge(1.0_wp), 1, found)
   end subroutine free_shape

   !> For messages.
   function name_of(law, order) result(name)
      class(positive_law), intent(in) :: law
      integer, intent(in) :: order
      character(:), allocatable :: name

      select type (law)
      type is (exact_law)
         name = 'exact'
      class default
         name = 'sequential'
      end select
      name = 'positive process ('//name//' law) with std/mean = '//to_text(law%wanted_ratio)// &
         ', '// &
             law%correlation//' = '//to_text(law%wanted_length)//', order = '//to_text(order)
   end function name_of

   !> The constraints once more, on as many values as were asked for or as the standard errors want;
   !> the shape stays.
   subroutine match_targets(law, fit_steps, found, point, violation)
      class(positive_law), intent(inout) :: law
      integer, intent(in) :: fit_steps   !! of a batch; 0: as the errors want
      type(search_result), intent(inout) :: found
      real(wp), intent(inout) :: point(:)
      real(wp), intent(out) :: violation
      real(wp), allocatable :: state(:)
      real(wp) :: excess, length_error
      logical :: is_inside

      law%n_steps = merge(fit_steps, final_steps, fit_steps > 0)
      call solve_along(law, point, found%jacobian, found%metric, matched, 20, violation)
      if (fit_steps > 0) return
      length_error = merge(law%moments%l0_error, law%moments%l1_error, law%correlation == 'L0')
      excess = max(law%moments%ratio_error/(ratio_goal*law%wanted_ratio), &
                   length_error/(length_goal*law%wanted_length))
      if (excess > 1.0_wp) then
         law%n_steps = ceiling(final_steps*min(excess**2, real(most_refinement, wp)))
         call solve_along(law, point, found%jacobian, found%metric, matched, 20, violation)
      end if
      call law%keep_every_lag()
      call law%evaluate(point, state, is_inside)
   end subroutine match_targets

   !> What was found, in the unit of X.
   subroutine describe(request, law, model, error)
      type(process_request), intent(in) :: request
      class(positive_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      integer :: m

      model%order = request%order
      model%a = law%a
      model%b0 = request%std/law%moments%std
      model%mu = model%b0*law%coordinate/(1.0_wp + sum(model%a))**law%power
      call find_poles(model%a, model%poles, error)
      if (allocated(error)) return
      call estimate_autocovariance(law%batches, law%companion_autocovariance, law%n_lags, &
                                   model%autocovariance, model%autocovariance_error)
      model%autocovariance(:) = model%b0**2*model%autocovariance
      model%autocovariance_error(:) = model%b0**2*model%autocovariance_error
      model%l0 = law%moments%l0
      model%l0_error = law%moments%l0_error
      model%l1 = law%moments%l1
      model%l1_error = law%moments%l1_error
      m = min(request%order, law%n_lags)
      model%l0_cut = correlation_length_l0(model%autocovariance(0:m))
      model%l1_cut = correlation_length_l1(model%autocovariance(0:m))
      model%mean = model%b0*law%moments%mean
      model%mean_error = model%b0*law%moments%mean_error
      model%std = request%std
      model%std_error = model%b0*law%moments%std_error
      model%memory = law%memory
      call law%find_entropy(model%entropy, model%entropy_error)
      model%entropy = model%entropy + log(model%b0)
      model%entropy_bound = white_noise_entropy(request%std)
   end subroutine describe

   !> Multipliers of Eq. (30) from the matrix G: G_0 = 2 lambda_3 + 2 lambda_2 a_0, G_m = lambda_2
   !> a_m s_m.
   subroutine name_multipliers(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(inout) :: model
      real(wp) :: g(0:model%order), lambda_2, weights(0:model%order)

      g = precision_of(model%a)/model%b0**2
      weights = constraint_weights(request%correlation, request%correlation_length, model%order)
      model%signs = nint(sign(1.0_wp, model%autocovariance(1:model%order)))
      lambda_2 = g(model%order)/(weights(model%order)*model%signs(model%order))
      model%lambda_3 = 0.5_wp*g(0) - lambda_2*weights(0)
      model%delta = lambda_2/model%lambda_3
   end subroutine name_multipliers

   !> What the same a_q, b0 and mu give under the other law, and the acceptances of both. Of the
   !> exact law, nothing where it remembers more than its fits carry.
   subroutine compare_laws(request, law, point, model)
      type(process_request), intent(in) :: request
      class(positive_law), intent(in) :: law
      real(wp), intent(in) :: point(:)
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable :: error
      class(positive_law), allocatable :: other
      real(wp), allocatable :: kappa(:), state(:)
      real(wp) :: coordinate, location, unused
      logical :: is_inside

      call prepare_law(request, merge('exact     ', 'sequential', &
                                      request%sampler == 'sequential'), law%stream, other, &
                       kappa, error)
      if (allocated(error)) then   ! longer than it is sampled: not known
         deallocate (error)
         call note_acceptances(law, model)
         return
      end if
      location = model%mu/model%b0
      coordinate = location*(1.0_wp + sum(model%a))**other%power
      other%n_steps = final_steps
      call other%settle(model%a)
      call other%evaluate([point(:size(point) - 1), coordinate], state, is_inside)
      call other%find_entropy(model%other_entropy, unused)
      model%other_entropy = model%other_entropy + log(model%b0)
      model%other_mean = model%b0*other%moments%mean
      model%other_std = model%b0*other%moments%std
      model%other_l0 = other%moments%l0
      call note_acceptances(law, model)
      call note_acceptances(other, model)
   end subroutine compare_laws

   !> Lambda belongs to the exact law, the other three to one-at-a-time rejection.
   subroutine note_acceptances(law, model)
      class(positive_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      real(wp) :: entropy, field, psi

      select type (law)
      type is (sequential_law)
         model%acceptance_ratio = law%moments%acceptance_ratio
         model%acceptance_mean = law%moments%acceptance_mean
         model%acceptance_geometric = law%moments%acceptance_geometric
      type is (exact_law)
         entropy = merge(model%entropy, model%other_entropy, model%request%sampler == 'exact') &
            - log(model%b0)
         field = model%mu/model%b0*(1.0_wp + sum(model%a))**2
         psi = entropy - 0.5_wp + 0.5_wp*field*law%moments%mean
         model%lambda = exp(psi - log_sqrt_two_pi - 0.5_wp*field*model%mu/model%b0)
      end select
   end subroutine note_acceptances

end module process_positive_fit
