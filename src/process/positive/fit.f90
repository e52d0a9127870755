!> Fits the positive process of given mean, std and correlation length with the largest entropy
!> (Sec. 2.4.1), under the law of one-at-a-time rejection or under that of Eq. (25).
!>
!> Order 1 is solved by quadrature. Moments of higher orders are averages over simulated values,
!> with the same random numbers at every trial, so that the problem is smooth; its solution has the
!> standard errors that are returned.
module process_positive_fit
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: restore_constraints
   use process_direct_fit, only: fit_unconstrained, integer_signs
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: gaussian_entropy, process_model_type, process_request
   use process_positive_description, only: compare_laws, describe_evaluation, &
                                           describe_far_from_zero, describe_solution
   use process_positive_first_order, only: describe_first_order, find_limit, match_first_order
   use process_positive_kernel, only: first_order_law
   use process_positive_objective, only: sampled_objective
   use process_positive_refinement, only: refine, shape_uncertainty
   use process_positive_search, only: follow_from_order_1, follow_unconstrained
   use process_positive_sign_search, only: multipliers_of, search_signs
   use process_positive_signs, only: search_finer
   use process_positive_truncated_normal, only: fit_truncated_normal, hazard_ratio, log_acceptance
   implicit none(type, external)
   private
   public :: alternating_bound, fit_positive, predict_positive

   integer, parameter :: final_steps = 4096              !! least steps of a batch for the solution
   integer, parameter :: most_steps = 16*final_steps     !! most of them, if errors are large
   !> wanted relative standard errors of std/mean and length
   real(wp), parameter :: ratio_goal = 2.5e-4_wp, length_goal = 2.5e-3_wp
   !> relative misses of std/mean and length on the simulated values: aimed at, and allowed
   real(wp), parameter :: target_tolerance = 1.0e-6_wp, largest_miss = 1.0e-5_wp

contains

   !> Solves the request, whose length is not zero, and sets `model%is_solved`; `model%reason` says
   !> why there is no solution.
   subroutine fit_positive(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable :: error

      call fit_far_from_zero(request, model)
      if (.not. model%is_solved) then
         call fit_near_zero(request, seed, model, error)
         if (.not. allocated(error)) call compare_other_law(request, seed, model)
      end if
      model%is_solved = .not. allocated(error)
      if (allocated(error)) model%reason = error%message
   end subroutine fit_positive

   !> Solves the request by quadrature or on simulated values.
   subroutine fit_near_zero(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      type(first_order_law) :: first_order

      model%request = request
      if (is_first_order(request)) then
         call match_first_order(request, first_order, error)
         if (.not. allocated(error)) call describe_first_order(request, first_order, model, error)
      else
         call fit_sampled(request, seed, model, error)
      end if
   end subroutine fit_near_zero

   !> Solves the request on simulated values: on the branch of the unconstrained process and, where
   !> that fails or has less entropy than the alternating one can have, on that one too. Takes the
   !> larger entropy.
   subroutine fit_sampled(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: other
      type(error_type), allocatable :: failure
      type(sampled_objective) :: search, second
      ! largest effort of the second branch over that of the first, if that has a solution: of the
      ! five alternating processes seen with more entropy none took more than 1
      real(wp), parameter :: others = 4.0_wp
      real(wp) :: unused(2)

      other = model
      if (request%method == 'direct') then
         call search_signs(request, seed, search, model, error)
      else
         call follow_unconstrained(request, seed, search, error)
      end if
      if (.not. allocated(error)) call finish_fit(request, search, model, error)
      if (may_be_alternating(request, search, model, error)) then
         if (.not. allocated(error)) &
            second%max_effort = min(second%max_effort, others*search%effort)
         call follow_from_order_1(request, seed, .true., second, unused, failure)
         if (.not. allocated(failure)) call finish_fit(request, second, other, failure)
         if (allocated(failure)) then
            if (allocated(error)) then
               error%message = error%message//'; '//failure%message
            else if (second%is_exhausted()) then
               model%reason = 'alternating K(m) may have more entropy: their search was given '// &
                              'up at its bound; ''nonnegative'' leaves it out'
            end if
         else if (allocated(error) .or. other%entropy > model%entropy) then
            if (allocated(error)) deallocate (error)
            model = other
            search = second
         end if
      end if
      if (allocated(error)) return
      if (allocated(search%last%a)) call compare_laws(search, model)
   end subroutine fit_sampled

   !> True if the alternating branch is to be searched after the other one ended with `error` or
   !> with less entropy than the bound of alternating processes.
   logical function may_be_alternating(request, search, model, error) result(is_so)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(in) :: search   !! search on the other branch
      type(process_model_type), intent(in) :: model   !! its solution
      type(error_type), allocatable, intent(in) :: error
      real(wp), parameter :: least = 1.0e-4_wp, most = 1.0e-3_wp   ! lack of entropy that shows
      real(wp), parameter :: certain = 2.0_wp                      ! the same in standard errors

      is_so = request%branch == 'any' .and. request%method == 'autoregressive' .and. &
              was_searched(request, search)
      if (.not. is_so) return
      if (allocated(error)) then
         is_so = error%exit_code == exit_no_solution
      else if (request%correlation == 'both') then   ! its maxima with K(m) >= 0 come first
         is_so = .false.
      else
         is_so = alternating_bound(request) - model%entropy > &
                 max(least, min(certain*model%entropy_error, most))
      end if
   end function may_be_alternating

   !> Entropy of independent positive values of this mean and std, less what the correlation costs a
   !> Gaussian process, with an allowance [nat]. No alternating process is known to have more.
   real(wp) function alternating_bound(request) result(bound)
      type(process_request), intent(in) :: request
      real(wp), parameter :: allowance = 2.0_wp   ! largest known excess: 1.7 (L0 = 10, order 2)
      type(process_model_type) :: unconstrained
      type(error_type), allocatable :: error
      real(wp) :: c, cost, independent, mu, sigma

      bound = huge(bound)
      call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      if (.not. allocated(error)) call fit_unconstrained(request, unconstrained, error)
      if (allocated(error)) return
      c = mu/sigma
      independent = gaussian_entropy(sigma) + log_acceptance(c) - 0.5_wp*c*hazard_ratio(c)
      associate (gaussian => gaussian_entropy(request%std))
         cost = gaussian - unconstrained%entropy
         bound = independent - cost + allowance*cost**2*(gaussian - independent)
      end associate
   end function alternating_bound

   !> True if the branch of the unconstrained process was searched, or has no process of this
   !> std/mean; false if too many lags count for a search.
   pure logical function was_searched(request, search)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(in) :: search

      was_searched = search%effort > 0.0_wp .or. request%std >= request%mean
   end function was_searched

   !> Checks a request without its fit: fails if a short search shows that there is no process. A
   !> process of order 1 with K(m) >= 0 is one of every order; next to where order 1 ends the branch
   !> is 'two', as the fit may search the alternating one too. If only a long search can tell, the
   !> branch is 'open'.
   subroutine predict_positive(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: quick_effort(2) = [2.0e8_wp, 1.5e8_wp]   ! sequential, exact: 1 to 2 s
      type(sampled_objective) :: search
      type(first_order_law) :: first_order
      type(process_request) :: one
      type(error_type), allocatable :: refusal
      real(wp), parameter :: near = 0.85_wp   ! std/mean over the limit of order 1
      real(wp) :: limit, unused(2)
      real(wp), allocatable :: state(:)
      logical :: has_first_order, has_others, is_inside

      call fit_far_from_zero(request, model)
      if (model%is_solved) return
      if (is_first_order(request)) then
         call fit_near_zero(request, seed, model, error)
         if (.not. allocated(error)) call compare_other_law(request, seed, model)
         return
      end if
      one = request
      one%order = 1
      one%branch = 'nonnegative'
      has_first_order = is_first_order(one)
      if (has_first_order) then
         call match_first_order(one, first_order, refusal)
         has_first_order = .not. allocated(refusal)
      end if
      ! with branch = 'nonnegative' some K(m) may be 0 at the maximum, which a short search can miss
      if (has_first_order .and. request%branch /= 'nonnegative') then
         call find_limit(one, .false., limit, refusal)
         if (request%std > near*limit*request%mean) model%branch = 'two'
         return
      end if
      search%max_effort = quick_effort(merge(2, 1, request%sampler == 'exact'))
      call follow_unconstrained(request, seed, search, error)
      if (allocated(error)) then
         ! the direct method has other signs left than those of the unconstrained process
         has_others = request%method == 'direct' .and. request%branch == 'any' .and. &
                      was_searched(request, search)
         if (may_be_alternating(request, search, model, error) .and. &
             .not. (search%is_exhausted() .or. has_first_order)) then
            call follow_from_order_1(request, seed, .true., search, unused, refusal)
            if (allocated(refusal)) then
               error%message = error%message//'; '//refusal%message
            else
               deallocate (error)
            end if
         end if
         if (allocated(error)) then
            one%branch = request%branch
            if (is_first_order(one) .and. .not. has_first_order) then
               call match_first_order(one, first_order, refusal)
               has_first_order = .not. allocated(refusal)
            end if
            if (.not. (search%is_exhausted() .or. has_first_order .or. has_others)) return
            deallocate (error)
            model%branch = 'open'
            return
         end if
      end if
      search%max_effort = huge(1.0_wp)
      call search%evaluate(search%point, state, is_inside)
      if (search%problem%decay > 0.0_wp) call describe_evaluation(search, model)
      one%method = 'autoregressive'   ! a rough answer
      one%branch = request%branch
      call compare_other_law(one, seed, model)
   end subroutine predict_positive

   !> Fits the process without sign constraint, if mean/std is so large that no value is negative to
   !> all digits: it then has the largest entropy. Solves nothing if mean/std is smaller, there is
   !> no such process, or its K(m) have signs that are refused.
   subroutine fit_far_from_zero(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      real(wp), parameter :: far = 9.0_wp   ! moments change by c phi(c) < 1e-17
      type(process_model_type) :: unconstrained
      type(error_type), allocatable :: error

      model%request = request
      if (.not. (request%std > 0.0_wp .and. request%mean >= far*request%std)) return
      call fit_unconstrained(request, unconstrained, error)
      if (allocated(error)) return
      call describe_far_from_zero(request, unconstrained)
      if (request%branch == 'any' .or. unconstrained%branch == 'nonnegative') model = unconstrained
   end subroutine fit_far_from_zero

   !> Fits the process with K(m) >= 0 under the other law if K(m) alternates; keeps its entropy if
   !> that is larger.
   subroutine compare_other_law(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model
      integer, parameter :: rough_steps = 256
      type(process_request) :: other_request
      type(process_model_type) :: other
      type(error_type), allocatable :: failure

      if (.not. allocated(model%branch) .or. request%std >= request%mean) return
      if (model%branch /= 'alternating') return
      other_request = request
      other_request%sampler = merge('exact     ', 'sequential', request%sampler == 'sequential')
      other_request%branch = 'nonnegative'
      other_request%fit_steps = rough_steps
      call fit_near_zero(other_request, seed, other, failure)
      if (.not. allocated(failure) .and. other%entropy > model%entropy) &
         model%nonnegative_entropy = other%entropy
   end subroutine compare_other_law

   !> True if quadrature solves the request.
   pure logical function is_first_order(request) result(is_so)
      type(process_request), intent(in) :: request

      is_so = request%order == 1 .and. request%method == 'autoregressive' .and. &
              request%correlation /= 'both'
   end function is_first_order

   !> Refines the maximum, meets the targets on many values and describes the process. If that
   !> fails, or the maximum moves far, does so again after a search on more values.
   subroutine finish_fit(request, search, model, error)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(inout) :: search
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: before
      type(shape_uncertainty) :: uncertainty
      type(sequence_solution) :: solution
      integer :: pass
      logical :: is_finer, is_short

      before = model
      do pass = 1, 2
         call refine(search, uncertainty, is_short)
         is_finer = .false.
         if (pass == 1 .and. .not. is_short) call search_finer(search, is_finer)
         if (is_finer) cycle
         call match_targets(search, request%fit_steps, error)
         if (.not. allocated(error)) call describe_solution(search, uncertainty, model, error)
         if (.not. allocated(error)) exit
         model = before
         if (pass == 2) return
         call search_finer(search, is_finer)
         if (.not. is_finer) return
      end do
      model%optimality = search%found%residual
      if (request%method /= 'direct') return
      call multipliers_of(search, model%b0, solution, model%optimality)
      model%optimality = max(model%optimality, search%found%violation)
      model%signs = integer_signs(solution%s)
      model%delta = solution%delta
      model%lambda_3 = solution%lambda_3
   end subroutine finish_fit

   !> Meets the targets, with the shape kept, on as many values as `fit_steps` asks for or as the
   !> wanted standard errors need. Fails if they are missed.
   subroutine match_targets(search, fit_steps, error)
      type(sampled_objective), intent(inout) :: search
      integer, intent(in) :: fit_steps   !! steps of a batch; 0: as the standard errors need
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_iterations = 20
      integer, parameter :: few_lags = 64   ! their averages cost less than one more evaluation
      real(wp) :: bound

      bound = search%max_effort
      search%max_effort = huge(1.0_wp)   ! bounds searches only
      search%n_steps = fit_steps
      if (fit_steps == 0) search%n_steps = steps_needed(search)
      call search%set_single_lags()
      if (search%problem%n_lags <= few_lags) call search%set_single_lags(search%problem%n_lags)
      call restore_constraints(search, target_tolerance, max_iterations)
      if (search%found%violation <= largest_miss) return
      search%max_effort = bound
      call raise(error, exit_no_solution, search%problem%name// &
                 ': the solution meets the targets on few simulated values, not on '// &
                 to_text(search%n_steps)//' in each batch')
   end subroutine match_targets

   !> Steps of a batch that the wanted standard errors need, from those of the last evaluation.
   pure integer function steps_needed(search) result(n)
      type(sampled_objective), intent(in) :: search
      real(wp) :: excess

      associate (moments => search%last%moments, problem => search%problem)
         excess = max(moments%ratio_error/(ratio_goal*problem%ratio), &
                      merge(moments%l1_error, moments%l0_error, &
                            problem%request%correlation == 'L1') &
                      /(length_goal*problem%request%correlation_length))
      end associate
      n = ceiling(min(search%last%n_steps*excess**2, real(most_steps, wp)))
      n = max(n, final_steps)
   end function steps_needed

end module process_positive_fit
