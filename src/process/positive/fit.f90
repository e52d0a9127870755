!> The positive process of given mean, std and correlation length with the largest entropy (Sec.
!> 2.4.1), under the law of one-at-a-time rejection or under that of Eq. (25).
!>
!> Its moments have no closed form. They are averages over simulated values, the same random numbers
!> at every trial, so that what is solved is a smooth problem; its answer differs from the true one
!> by the standard errors that are handed back.
module process_positive_fit
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: solve_along
   use process_direct_fit, only: fit_unconstrained, integer_signs
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_model_type, process_request
   use process_positive_description, only: compare_laws, describe_far_from_zero, describe_sampled, &
      outline_sampled
   use process_positive_first_order, only: describe_first_order, match_first_order
   use process_positive_kernel, only: first_order_law
   use process_positive_objective, only: sampled_objective
   use process_positive_refinement, only: refine, shape_spread
   use process_positive_search, only: follow_alternating, follow_unconstrained
   use process_positive_sign_search, only: multipliers_of, search_signs
   use process_positive_signs, only: difference, sharpen
   implicit none(type, external)
   private
   public :: fit_positive, foresee_positive

   integer, parameter :: final_steps = 4096    !! of a batch of the final solution, at least
   integer, parameter :: most_refinement = 16  !! times as many where the errors want it
   !> relative standard errors
   real(wp), parameter :: ratio_goal = 2.5e-4_wp, length_goal = 2.5e-3_wp
   !> relative, of ratio and length on the simulated values
   real(wp), parameter :: matched = 1.0e-7_wp, missed = 1.0e-5_wp

contains

   !> Solves the request, whose length is not zero, or says why not: `model%is_solved`,
   !> `model%reason`.
   recursive subroutine fit_positive(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable :: error
      logical :: is_far

      call fit_far_from_zero(request, model, is_far)
      if (.not. is_far) call fit_near_zero(request, seed, model, error)
      model%is_solved = .not. allocated(error)
      if (allocated(error)) model%reason = error%message
   end subroutine fit_positive

   !> Solves by quadrature or on simulated values.
   recursive subroutine fit_near_zero(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(first_order_law) :: first_order

      if (is_first_order(request)) then
         call match_first_order(request, first_order, error)
         if (.not. allocated(error)) call describe_first_order(request, first_order, model, error)
      else
         call fit_sampled(request, seed, model, error)
      end if
      if (allocated(error)) then
         call name_lower_order(request, seed, error)
         return
      end if
      call look_beside(request, seed, model)
   end subroutine fit_near_zero

   !> Adds to a refusal that a lower order, which this order contains, has such a process: order 1,
   !> solved by quadrature, or of both lengths order 2, which they leave nothing to search.
   recursive subroutine name_lower_order(request, seed, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(error_type), intent(inout) :: error
      type(process_request) :: lower
      type(process_model_type) :: other

      lower = request
      lower%order = merge(2, 1, request%correlation == 'both')
      if (request%method == 'direct' .or. request%order <= lower%order) return
      call fit_positive(lower, seed, other)
      if (other%is_solved) error%message = error%message//'; order = '//to_text(lower%order)// &
                                           ' has such a process'
   end subroutine name_lower_order

   !> Solves on simulated values: on the branch of the unconstrained process or, where that has
   !> ended before, on the alternating one; where some K(m) have changed their sign on the way, on
   !> that of the larger entropy.
   subroutine fit_sampled(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: other
      type(error_type), allocatable :: failure
      type(sampled_objective) :: law

      other = model
      if (request%method == 'direct') then
         call search_signs(request, seed, law, model, error)
      else
         call follow_unconstrained(request, seed, law, error)
      end if
      if (.not. allocated(error)) call finish(request, law, model, error)
      if (.not. allocated(error)) then
         if (model%branch /= 'mixed') return
      end if
      if (.not. may_alternate(request, law, error)) return
      law%effort = 0.0_wp
      call follow_alternating(request, seed, law, failure)
      if (.not. allocated(failure)) call finish(request, law, other, failure)
      if (allocated(failure)) then
         if (allocated(error)) error%message = error%message//'; '//failure%message
      else if (allocated(error)) then
         deallocate (error)
         model = other
      else if (other%entropy > model%entropy) then
         model = other
      end if
   end subroutine fit_sampled

   !> True if the alternating branch is to be searched, where the other one was or failed like this.
   pure logical function may_alternate(request, law, error)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(in) :: law   !! of the other branch
      type(error_type), allocatable, intent(in) :: error

      may_alternate = request%branch == 'any' .and. request%method == 'autoregressive' .and. &
                      request%correlation /= 'both' .and. request%mean > 0.0_wp .and. &
                      was_tried(request, law)
      if (allocated(error)) &
         may_alternate = may_alternate .and. error%exit_code == exit_no_solution
   end function may_alternate

   !> True if the branch of the unconstrained process was searched, or its std/mean forbade it: not
   !> where its lags were too many to begin.
   pure logical function was_tried(request, law)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(in) :: law

      was_tried = law%effort > 0.0_wp .or. request%std >= request%mean
   end function was_tried

   !> Foresees a fit: fails where `fit_positive` would not even begin. Of the exact law it also
   !> fills what realizations are drawn by, roughly where it is sampled and found soon. A process of
   !> order 1 with K(m) >= 0 is one of every order. A search that is long is left to the fit: the
   !> branch is then 'open'.
   subroutine foresee_positive(request, seed, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: quick_effort(2) = [2.0e8_wp, 1.5e8_wp]   ! sequential, exact: 1 s or 2
      type(sampled_objective) :: law
      type(first_order_law) :: unused
      type(process_request) :: one
      type(error_type), allocatable :: refusal
      real(wp), allocatable :: state(:)
      logical :: has_first_order, has_others, is_exact, is_feasible, is_inside

      call fit_far_from_zero(request, model, is_inside)
      if (is_inside) return
      if (is_first_order(request)) then
         call fit_near_zero(request, seed, model, error)
         return
      end if
      is_exact = request%sampler == 'exact'
      one = request
      one%order = 1
      one%branch = 'nonnegative'
      has_first_order = is_first_order(one)
      if (has_first_order) then
         call match_first_order(one, unused, refusal)
         has_first_order = .not. allocated(refusal)
      end if
      ! with K(m) >= 0 alone the maximum may lie where some are 0, which a search may miss
      is_feasible = has_first_order .and. request%branch /= 'nonnegative'
      if (is_feasible .and. .not. is_exact) return
      law%most_effort = quick_effort(merge(2, 1, is_exact))
      call follow_unconstrained(request, seed, law, error)
      if (allocated(error)) then
         ! when the direct method has tried the unconstrained process's signs others are left
         has_others = request%method == 'direct' .and. request%branch == 'any' .and. &
                      was_tried(request, law)
         if (may_alternate(request, law, error) .and. &
             .not. (law%is_exhausted() .or. has_first_order)) then
            call follow_alternating(request, seed, law, refusal)
            if (allocated(refusal)) then
               error%message = error%message//'; '//refusal%message
            else
               deallocate (error)
            end if
         end if
         if (allocated(error)) then
            if (.not. (law%is_exhausted() .or. has_first_order .or. has_others)) return
            deallocate (error)
            if (.not. is_feasible) model%branch = 'open'
            return
         end if
      end if
      law%most_effort = huge(1.0_wp)
      call law%evaluate(law%point, state, is_inside)
      if (is_exact .or. law%problem%decay > 0.0_wp) call outline_sampled(law, model)
      one%method = 'autoregressive'   ! tells roughly
      one%branch = request%branch
      call look_beside(one, seed, model)
   end subroutine foresee_positive

   !> Fits the process without sign constraint where its mean is so many std that none of its values
   !> is negative, to all digits: it has the largest entropy then. `is_far` is false, and nothing is
   !> solved, nearer to zero, or where it does not exist or its K(m) have signs that are not wanted.
   subroutine fit_far_from_zero(request, model, is_far)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      logical, intent(out) :: is_far
      real(wp), parameter :: far = 9.0_wp   ! c phi(c), by which moments change, is below 1e-17
      type(process_model_type) :: unconstrained
      type(error_type), allocatable :: error

      model%request = request
      is_far = request%std > 0.0_wp .and. request%mean >= far*request%std
      if (.not. is_far) return
      call fit_unconstrained(request, unconstrained, error)
      is_far = .not. allocated(error)
      if (.not. is_far) return
      call describe_far_from_zero(request, unconstrained)
      is_far = request%branch == 'any' .or. unconstrained%branch == 'nonnegative'
      if (is_far) model = unconstrained
   end subroutine fit_far_from_zero

   !> Fits, where K(m) alternates, the other law's process with K(m) >= 0; its entropy is noted
   !> where it is larger.
   recursive subroutine look_beside(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(inout) :: model
      integer, parameter :: rough_steps = 256
      type(process_request) :: beside
      type(process_model_type) :: other

      if (.not. allocated(model%branch) .or. request%std >= request%mean) return
      if (model%branch /= 'alternating') return
      beside = request
      beside%sampler = merge('exact     ', 'sequential', request%sampler == 'sequential')
      beside%branch = 'nonnegative'
      beside%fit_steps = rough_steps
      call fit_positive(beside, seed, other)
      if (other%is_solved .and. other%entropy > model%entropy) &
         model%nonnegative_entropy = other%entropy
   end subroutine look_beside

   !> True if quadrature solves the request.
   pure function is_first_order(request) result(is_so)
      type(process_request), intent(in) :: request
      logical :: is_so

      is_so = request%order == 1 .and. request%method == 'autoregressive' .and. &
              request%correlation /= 'both' .and. &
              (request%sampler == 'sequential' .or. request%sampler == 'exact')
   end function is_first_order

   !> Refines the maximum, matches the targets on many values and describes the law; where that
   !> fails, or the maximum moves far, once more after a search on more values than before.
   subroutine finish(request, law, model, error)
      type(process_request), intent(in) :: request
      type(sampled_objective), intent(inout) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: before
      type(shape_spread) :: spread
      type(sequence_solution) :: solution
      integer :: pass
      logical :: is_sharper, is_short

      before = model
      do pass = 1, 2
         call refine(law, difference, spread, is_short)
         is_sharper = .false.
         if (pass == 1 .and. .not. is_short) call sharpen(law, is_sharper)
         if (is_sharper) cycle
         call match_targets(law, request%fit_steps, error)
         if (.not. allocated(error)) call describe_sampled(law, spread, model, error)
         if (.not. allocated(error)) exit
         model = before
         if (pass == 2) return
         call sharpen(law, is_sharper)
         if (.not. is_sharper) return
      end do
      if (allocated(law%last%a)) call compare_laws(law, model)
      model%optimality = law%found%residual
      if (request%method /= 'direct') return
      call multipliers_of(law, model%b0, solution, model%optimality)
      model%optimality = max(model%optimality, law%found%violation)
      model%signs = integer_signs(solution%s)
      model%delta = solution%delta
      model%lambda_3 = solution%lambda_3
   end subroutine finish

   !> Meets the targets once more, on as many values as were asked for or as the standard errors
   !> want; the shape stays.
   subroutine match_targets(law, fit_steps, error)
      type(sampled_objective), intent(inout) :: law
      integer, intent(in) :: fit_steps   !! of a batch; 0: as the errors want
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_iterations = 20
      real(wp) :: bound, excess

      bound = law%most_effort
      law%most_effort = huge(1.0_wp)   ! the search has succeeded, and this is not one
      law%n_steps = merge(fit_steps, final_steps, fit_steps > 0)
      call law%keep_lags()
      call solve_along(law, matched, max_iterations)
      associate (moments => law%last%moments, problem => law%problem)
         excess = max(moments%ratio_error/(ratio_goal*problem%ratio), &
                      merge(moments%l1_error, moments%l0_error, &
                            problem%request%correlation == 'L1') &
                      /(length_goal*problem%request%correlation_length))
      end associate
      if (excess > 1.0_wp .and. fit_steps == 0 .and. law%found%violation <= missed) then
         law%n_steps = ceiling(final_steps*min(excess**2, real(most_refinement, wp)))
         call solve_along(law, matched, max_iterations)
      end if
      if (law%found%violation <= missed) return
      law%most_effort = bound
      call raise(error, exit_no_solution, law%problem%name// &
                 ': the solution meets the targets on few simulated values, not on '// &
                 to_text(law%n_steps)//' in each batch')
   end subroutine match_targets

end module process_positive_fit
