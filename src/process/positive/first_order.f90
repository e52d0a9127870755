!> Solves the positive process of order 1 of given mean, std and correlation length by quadrature.
!>
!> There are two branches: K(m) >= 0 and, at larger std/mean, alternating K(m). On each one the
!> length grows with an inner parameter; at given length std/mean grows as an outer parameter falls
!> to minus infinity, where it has a limit or none.
module process_positive_first_order
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_roots, only: root_search
   use process_correlation, only: correlation_length
   use process_model, only: lengths_of, positive_name, process_model_type, process_request, &
                            take_law, take_other_law
   use process_positive_kernel, only: first_order_law, new_first_order_law
   use process_positive_sequential, only: memory_of
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: match_first_order, match_branch, find_limit, describe_first_order

   !> longest length [lags], whose matrices of order 800 take seconds
   real(wp), parameter :: longest_first_order = 1000.0_wp
   real(wp), parameter :: length_tolerance = 1.0e-10_wp              !! relative error of the length
   real(wp), parameter :: ratio_tolerance = 1.0e-9_wp         !! relative error of std/mean
   real(wp), parameter :: least_limit = 0.447_wp           !! below every limit: 1/sqrt(5)
   real(wp), parameter :: farthest = 60.0_wp                !! - farthest stands for -infinity
   integer, parameter :: max_steps = 80

   !> Processes of one length on one branch. K(m) >= 0: the outer parameter is mu over the std of
   !> the Gaussian process with the same coefficients, the inner one ln (r/(1 - r)). Alternating:
   !> the outer one is - ln of the relative excess of -r over that of the Gaussian process of the
   !> wanted length, the inner one the field.
   type :: branch_type
      type(process_request) :: request
      logical :: is_alternating = .false.
      real(wp) :: outer = 0.0_wp
   end type branch_type

contains

   !> Finds the law with the wanted ratio and length: that with K(m) >= 0, whose entropy is larger,
   !> if there is one, else the alternating one. Fails with the limits of std/mean.
   subroutine match_first_order(request, law, error)
      type(process_request), intent(in) :: request   !! order 1
      type(first_order_law), intent(out) :: law      !! law in its own units
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: failure
      character(:), allocatable :: reason
      real(wp) :: farther, limit, wanted

      wanted = request%std/request%mean
      limit = least_limit
      if (wanted > least_limit) call find_limit(request, .false., limit, error)
      if (allocated(error)) return
      if (wanted < limit .or. .not. wanted > least_limit) then
         call match_branch(request, .false., law, error)
         return
      end if
      reason = positive_name(request)//': std/mean must be below '//rounded_down(limit)// &
               ' with K(m) >= 0'
      if (request%branch == 'nonnegative') then
         call raise(error, exit_no_solution, reason)
         return
      end if
      call find_limit(request, .true., farther, error)
      if (allocated(error)) return
      if (wanted >= farther) then
         call raise(error, exit_no_solution, reason//' and below '//rounded_down(farther)// &
                    ' with alternating K(m)')
         return
      end if
      call match_branch(request, .true., law, failure)
      if (allocated(failure)) call raise(error, exit_no_solution, reason//'; '//failure%message)
   end subroutine match_first_order

   !> Finds the law of one branch with the wanted ratio and length. Fails if there is none.
   subroutine match_branch(request, is_alternating, law, error)
      type(process_request), intent(in) :: request
      logical, intent(in) :: is_alternating
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      type(branch_type) :: branch
      type(root_search) :: search
      type(error_type), allocatable :: unmatched
      real(wp) :: excess, inner, mu, reached, sigma, unresolved
      integer :: step

      branch = branch_type(request, is_alternating)
      if (is_alternating) then
         branch%outer = -log(0.7_wp)
         inner = 2.0_wp
      else
         call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
         if (allocated(error)) return
         branch%outer = mu/sigma
         if (mu < 0.0_wp) branch%outer = -log(1.0_wp - mu/sigma)   ! see `stretched`
         inner = log(request%correlation_length)
      end if
      search%step = merge(0.5_wp, 0.1_wp, is_alternating)
      reached = 0.0_wp
      unresolved = 1.0_wp   ! unresolved alternating processes are nearly Gaussian at first
      do step = 1, max_steps
         call match_length(branch, inner, law, unmatched)
         if (allocated(unmatched) .and. .not. is_alternating) then
            call move_alloc(unmatched, error)
            return
         end if
         excess = unresolved
         if (.not. allocated(unmatched)) then
            reached = law%std/law%mean
            excess = log(request%std/(request%mean*reached))
            unresolved = -1.0_wp   ! beyond resolved ones they alternate too strongly
         end if
         if (abs(excess) <= ratio_tolerance) return
         call search%advance(branch%outer, excess)
         if (abs(branch%outer) > farthest) exit
      end do
      call raise(error, exit_no_solution, positive_name(request)// &
                 ': the search ended at std/mean = '//rounded_down(reached))
   end subroutine match_branch

   !> Finds the largest std/mean of a branch at the length of the request; `huge` if the strongest
   !> alternation that the nodes resolve still has a shorter length.
   subroutine find_limit(request, is_alternating, limit, error)
      type(process_request), intent(in) :: request   !! request of any order
      logical, intent(in) :: is_alternating
      real(wp), intent(out) :: limit
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: strongest = log(1.0e6_wp)   ! ln (-r/field^2) that the nodes resolve
      type(branch_type) :: branch
      type(first_order_law) :: law
      real(wp) :: inner

      limit = huge(1.0_wp)
      branch = branch_type(request, is_alternating, -farthest)
      inner = log(request%correlation_length)
      if (is_alternating) then
         associate (scale => farthest + log(-gaussian_r(request)))   ! ln -r
            call evaluate(branch, 0.5_wp*(strongest - scale), law, error)
            if (allocated(error)) return
            if (length_of(law, request%correlation) <= request%correlation_length) return
            inner = 0.5_wp*(inner - scale)
         end associate
      else if (request%sampler == 'sequential') then   ! -ln of minus the field is 0.5 ln length
         inner = 2.0_wp*farthest + inner
      else                                  ! or, as the length grows, 1.5 ln length
         inner = (farthest + max(0.5_wp*inner, 1.5_wp*inner + 0.6_wp))/1.5_wp
      end if
      call match_length(branch, inner, law, error)
      if (.not. allocated(error)) limit = law%std/law%mean
   end subroutine find_limit

   !> Text of a limit, rounded down so that the stated ratio is within it.
   pure function rounded_down(limit) result(text)
      real(wp), intent(in) :: limit
      character(:), allocatable :: text

      text = to_text(floor(1.0e4_wp*limit)/1.0e4_wp)
   end function rounded_down

   !> Parameter that grows as exp below zero, so that a search reaches any limit in few doublings.
   elemental real(wp) function stretched(parameter) result(value)
      real(wp), intent(in) :: parameter

      value = parameter
      if (parameter < 0.0_wp) value = 1.0_wp - exp(min(-parameter, farthest))
   end function stretched

   !> Finds the process of a branch that has the length.
   subroutine match_length(branch, inner, law, error)
      type(branch_type), intent(in) :: branch
      real(wp), intent(inout) :: inner         !! in: a guess; out: that of the law
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: widest = 200.0_wp
      type(root_search) :: search
      real(wp) :: excess, last, length, trial
      integer :: step

      search%step = merge(0.25_wp, 0.05_wp, branch%is_alternating)
      trial = inner
      do step = 1, max_steps
         last = trial
         call evaluate(branch, trial, law, error)
         if (allocated(error)) return
         length = length_of(law, branch%request%correlation)
         excess = -1.0_wp
         if (.not. length > 0.0_wp) exit   ! nodes do not resolve the process
         excess = log(length/branch%request%correlation_length)
         if (abs(excess) > length_tolerance) call search%advance(trial, excess)
         if (abs(excess) <= length_tolerance .or. .not. abs(trial - last) > spacing(last)) then
            inner = last
            return
         end if
         if (abs(trial) > widest) exit
      end do
      call raise(error, exit_no_solution, 'positive process of order 1: the search ended '// &
                 to_text(excess)//' (relative) from '//lengths_of(branch%request))
   end subroutine match_length

   !> Computes the law of a branch at an inner parameter.
   subroutine evaluate(branch, inner, law, error)
      type(branch_type), intent(in) :: branch
      real(wp), intent(in) :: inner
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: field, r, slack
      logical :: is_sequential

      if (branch%request%correlation_length > longest_first_order) then
         call raise(error, exit_no_solution, positive_name(branch%request)//': lengths up to '// &
                    to_text(longest_first_order)//' can be resolved')
         return
      end if
      is_sequential = branch%request%sampler == 'sequential'
      if (branch%is_alternating) then
         r = gaussian_r(branch%request)*(1.0_wp + exp(-branch%outer))
         slack = 1.0_wp - r
         field = stretched(inner)
      else
         r = 1.0_wp/(1.0_wp + exp(-inner))
         slack = 1.0_wp/(1.0_wp + exp(inner))
         field = stretched(branch%outer)*slack**merge(1, 2, is_sequential) &
                 /sqrt(slack*(1.0_wp + r))
      end if
      call new_first_order_law(r, slack, 1.0_wp, field, is_sequential, law, error)
   end subroutine evaluate

   !> r of the Gaussian process whose K(m) alternate and have the length, Eq. (39).
   pure real(wp) function gaussian_r(request) result(r)
      type(process_request), intent(in) :: request

      r = -request%correlation_length/(1.0_wp + request%correlation_length)
      if (request%sampler /= 'sequential') r = r/(1.0_wp + r**2)
   end function gaussian_r

   !> Describes the process in the unit of X: by G for the exact law with alternating K(m), else by
   !> a_1.
   subroutine describe_first_order(request, law, model, error)
      type(process_request), intent(in) :: request
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_lags = 600
      type(first_order_law) :: other
      real(wp) :: decay
      real(wp) :: offset   ! conditional mean after 0 [b0]
      integer :: n_lags

      model%branch = trim(merge('alternating', 'nonnegative', law%r < 0.0_wp))
      model%order = 1
      call take_law(law, request%std, model)
      ! the unconstrained process of the wanted length has a longer memory than a positive one with
      ! K(m) >= 0, but not than an alternating one
      decay = request%correlation_length/(1.0_wp + request%correlation_length)
      if (law%r < 0.0_wp) decay = law%memory
      model%memory = ceiling(1.5_wp*memory_of(decay, 1.0e-9_wp))
      n_lags = min(memory_of(decay, 1.0e-6_wp), max_lags)
      allocate (model%autocovariance(0:n_lags), model%autocovariance_error(0:n_lags), &
                source=0.0_wp)
      model%autocovariance(:) = model%b0**2*law%autocovariance(n_lags)
      model%l0_cut = correlation_length('L0', model%autocovariance(0:1))
      model%l1_cut = correlation_length('L1', model%autocovariance(0:1))
      model%optimality = max(abs(model%mean/request%mean - 1.0_wp), &
                             abs(length_of(law, request%correlation)/request%correlation_length &
                                 - 1.0_wp))
      if (law%r < 0.0_wp .and. .not. law%is_sequential) then
         allocate (model%a(0), model%poles(0), model%g(0:1))
         model%mu = model%b0*law%field/(1.0_wp - 2.0_wp*law%r)
         model%g(:) = [1.0_wp, -law%r]/model%b0**2
         model%nodes = model%b0*law%nodes
         model%weights = law%next_weights
         return
      end if
      model%a = [-law%r]
      model%poles = [cmplx(law%r, 0.0_wp, wp)]
      offset = law%field/merge(1.0_wp, law%slack, law%is_sequential)
      model%mu = model%b0*offset/law%slack
      ! where K(m) alternates the exact law of the same a_1 is in its own unit, 1/sqrt(1 + a_1^2)
      call new_first_order_law(law%r, law%slack, 1.0_wp + law%r**2, &
                               offset*merge(law%slack, 1.0_wp, law%is_sequential), &
                               .not. law%is_sequential, other, error)
      if (.not. allocated(error)) call take_other_law(other, model)
   end subroutine describe_first_order

   elemental real(wp) function length_of(law, correlation) result(length)
      type(first_order_law), intent(in) :: law
      character(*), intent(in) :: correlation

      length = merge(law%l0, law%l1, correlation == 'L0')
   end function length_of

end module process_positive_first_order
