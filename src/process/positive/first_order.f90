!> The positive process of first order of given mean, std and correlation length: two equations for
!> a_1 and mu, solved by quadrature without statistical error.
!>
!> With the length held, std/mean grows as mu falls, up to a limit that is reached at mu = minus
!> infinity and a_1 = -1.
module process_positive_first_order
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_root_search, only: new_root_search, root_search
   use process_correlation, only: correlation_length_l0, correlation_length_l1
   use process_entropy, only: white_noise_entropy
   use process_model, only: process_model_type, process_request
   use process_positive_alternating, only: alternating_limit, match_alternating
   use process_positive_kernel, only: first_order_law, new_alternating_law, new_first_order_law
   use process_positive_sequential, only: memory_of
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: match_first_order, first_order_limit, describe_first_order

   !> [lags] seconds of matrices of order 800
   real(wp), parameter :: longest_first_order = 1000.0_wp
   real(wp), parameter :: matched = 1.0e-10_wp              !! relative, of the length
   real(wp), parameter :: ratio_matched = 1.0e-9_wp         !! relative
   real(wp), parameter :: always_below = 0.447_wp           !! the limits of std/mean: 1/sqrt(5)
   integer, parameter :: max_steps = 60

   !> Processes of one wanted length; `location` is mu over the std of the Gaussian below.
   type :: family_type
      character(:), allocatable :: correlation
      real(wp) :: length = 0.0_wp
      logical :: is_sequential = .false.
      logical :: is_limit = .false.         !! location = minus infinity
      real(wp) :: location = 0.0_wp
   end type family_type

contains

   !> The law with the wanted ratio and length: that with K(m) >= 0 where there is one (its entropy
   !> is the larger one), else the alternating one. Fails with the limits where there is none.
   subroutine match_first_order(request, law, error)
      type(process_request), intent(in) :: request   !! order 1
      type(first_order_law), intent(out) :: law      !! in units of b0
      type(error_type), allocatable, intent(out) :: error
      type(family_type) :: family
      type(root_search) :: search
      real(wp) :: excess, guess, limit, mu, parameter, sigma, wanted
      integer :: step

      call begin_family(request, family, error)
      if (allocated(error)) return
      if (.not. (request%mean > 0.0_wp .and. request%std > 0.0_wp)) then   ! refused in its words
         call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
         return
      end if
      wanted = request%std/request%mean
      if (wanted > always_below) then
         call limit_of_family(family, limit, error)
         if (allocated(error)) return
         if (wanted >= limit) then
            call match_beyond(request, limit, law, error)
            return
         end if
      end if
      call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      if (allocated(error)) return
      guess = log(family%length)
      parameter = parameter_of(mu/sigma)
      search = new_root_search(0.1_wp)
      do step = 1, max_steps
         family%location = location_of(parameter)
         call match_length(family, guess, law, error)
         if (allocated(error)) return
         excess = log(wanted*law%mean/law%std)   ! the ratio falls with the location
         if (abs(excess) <= ratio_matched) return
         call search%advance(parameter, excess)
      end do
      call raise(error, exit_no_solution, named(request)//': the search ended '// &
                 to_text(excess)//' (relative) from std/mean')
   end subroutine match_first_order

   !> The law with alternating K(m), beyond the largest std/mean of those with K(m) >= 0.
   subroutine match_beyond(request, limit, law, error)
      type(process_request), intent(in) :: request
      real(wp), intent(in) :: limit   !! with K(m) >= 0
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: failure
      character(:), allocatable :: reason
      real(wp) :: farther, wanted
      logical :: is_sequential

      wanted = request%std/request%mean
      is_sequential = request%sampler == 'sequential'
      reason = named(request)//': std/mean must be below '//to_text(rounded_down(limit))// &
               ' with K(m) >= 0'
      if (request%branch == 'nonnegative') then
         call raise(error, exit_no_solution, reason)
         return
      end if
      call alternating_limit(request%correlation, request%correlation_length, is_sequential, &
                             farther, error)
      if (allocated(error)) return
      if (wanted >= farther) then
         call raise(error, exit_no_solution, reason//' and below '// &
                    to_text(rounded_down(farther))//' with alternating K(m)')
         return
      end if
      call match_alternating(request%correlation, request%correlation_length, wanted, &
                             is_sequential, law, failure)
      if (allocated(failure)) call raise(error, exit_no_solution, reason//'; '//failure%message)
   end subroutine match_beyond

   !> The largest std/mean of order 1 and K(m) >= 0 at the request's length, rounded down.
   subroutine first_order_limit(request, limit, error)
      type(process_request), intent(in) :: request   !! of any order
      real(wp), intent(out) :: limit
      type(error_type), allocatable, intent(out) :: error
      type(family_type) :: family

      limit = 0.0_wp
      call begin_family(request, family, error)
      if (.not. allocated(error)) call limit_of_family(family, limit, error)
      limit = rounded_down(limit)
   end subroutine first_order_limit

   subroutine begin_family(request, family, error)
      type(process_request), intent(in) :: request
      type(family_type), intent(out) :: family
      type(error_type), allocatable, intent(out) :: error

      family%correlation = request%correlation
      family%length = request%correlation_length
      family%is_sequential = request%sampler == 'sequential'
      if (family%length > longest_first_order) &
         call raise(error, exit_no_solution, named(request)//': lengths up to '// &
                    to_text(longest_first_order)//' can be resolved')
   end subroutine begin_family

   !> std/mean at mu = minus infinity.
   subroutine limit_of_family(family, ratio, error)
      type(family_type), intent(in) :: family
      real(wp), intent(out) :: ratio
      type(error_type), allocatable, intent(out) :: error
      type(family_type) :: limit
      type(first_order_law) :: law
      real(wp) :: parameter

      ratio = 0.0_wp
      limit = family
      limit%is_limit = .true.
      parameter = 0.5_wp*log(family%length)   ! so it is at any length, but under the exact law
      if (.not. family%is_sequential) parameter = max(parameter, 3.0_wp*parameter + 0.6_wp)
      call match_length(limit, parameter, law, error)
      if (.not. allocated(error)) ratio = law%std/law%mean
   end subroutine limit_of_family

   !> A ratio that is named is itself within the limit.
   elemental function rounded_down(ratio) result(rounded)
      real(wp), intent(in) :: ratio
      real(wp) :: rounded

      rounded = floor(1.0e4_wp*ratio)/1.0e4_wp
   end function rounded_down

   !> Locations as exp far below zero, so that few doublings reach any limit.
   elemental function location_of(parameter) result(location)
      real(wp), intent(in) :: parameter
      real(wp) :: location

      location = parameter
      if (parameter < 0.0_wp) location = 1.0_wp - exp(min(-parameter, 60.0_wp))
   end function location_of

   elemental function parameter_of(location) result(parameter)
      real(wp), intent(in) :: location
      real(wp) :: parameter

      parameter = location
      if (location < 0.0_wp) parameter = -log(1.0_wp - location)
   end function parameter_of

   !> The member of a family that has its length: its parameter is ln (r/(1 - r)), or at the limit
   !> -ln of the field; the length grows with it.
   subroutine match_length(family, parameter, law, error)
      type(family_type), intent(in) :: family
      real(wp), intent(inout) :: parameter         !! a guess; then that of the law
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      type(root_search) :: search
      real(wp) :: excess, trial
      integer :: step

      search = new_root_search(0.05_wp)
      trial = parameter
      do step = 1, max_steps
         parameter = trial
         call evaluate(family, parameter, law, error)
         if (allocated(error)) return
         excess = log(length_of(law, family%correlation)/family%length)
         if (abs(excess) <= matched) return
         call search%advance(trial, excess)
         if (.not. abs(trial - parameter) > spacing(parameter)) return
      end do
      call raise(error, exit_no_solution, 'positive process of order 1: the search ended '// &
                 to_text(excess)//' (relative) from '//family%correlation//' = '// &
                 to_text(family%length))
   end subroutine match_length

   subroutine evaluate(family, parameter, law, error)
      type(family_type), intent(in) :: family
      real(wp), intent(in) :: parameter
      type(first_order_law), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: coordinate, r, slack

      if (family%is_limit) then
         r = 1.0_wp
         slack = 0.0_wp
         coordinate = -exp(-parameter)
      else
         r = 1.0_wp/(1.0_wp + exp(-parameter))
         slack = 1.0_wp/(1.0_wp + exp(parameter))
         coordinate = family%location*slack**merge(1, 2, family%is_sequential) &
                      /sqrt(slack*(1.0_wp + r))
      end if
      call new_first_order_law(r, slack, coordinate, family%is_sequential, law, error)
   end subroutine evaluate

   !> Everything that is known of the process, in the unit of X.
   subroutine describe_first_order(request, law, model, error)
      type(process_request), intent(in) :: request
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(first_order_law) :: other
      real(wp) :: mu

      model%branch = trim(merge('alternating', 'nonnegative', law%is_alternating))
      if (law%is_alternating) then
         call describe_alternating(request, law, model, error)
         return
      end if
      mu = law%coordinate/law%slack**merge(1, 2, law%is_sequential)
      call new_first_order_law(law%r, law%slack, &
                               mu*law%slack**merge(2, 1, law%is_sequential), &
                               .not. law%is_sequential, other, error)
      if (allocated(error)) return
      model%a = [-law%r]
      call describe_law(request, law, model)
      model%mu = model%b0*mu
      model%poles = [cmplx(law%r, 0.0_wp, wp)]
      call describe_other(other, model)
   end subroutine describe_first_order

   !> Where K(m) alternates: the recursion of the sequential law, the matrix G of the exact one.
   subroutine describe_alternating(request, law, model, error)
      type(process_request), intent(in) :: request
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(first_order_law) :: nonnegative, other
      type(error_type), allocatable :: refusal
      type(process_request) :: request_of_other

      call describe_law(request, law, model)
      if (law%is_sequential) then
         model%a = [law%coupling]
         model%mu = model%b0*law%field/(1.0_wp + law%coupling)
         model%poles = [cmplx(-law%coupling, 0.0_wp, wp)]
         call new_alternating_law(1.0_wp + law%coupling**2, law%coupling, &
                                  law%field*(1.0_wp + law%coupling), .false., other, error)
         if (allocated(error)) return
         call describe_other(other, model)
      else
         allocate (model%a(0), model%poles(0), model%g(0:1))
         model%mu = model%b0*law%field/(1.0_wp + 2.0_wp*law%coupling)
         model%g(:) = [1.0_wp, law%coupling]/model%b0**2
         model%nodes = model%b0*law%nodes
         model%weights = law%ahead
      end if
      request_of_other = request
      request_of_other%sampler = trim(merge('exact     ', 'sequential', law%is_sequential))
      request_of_other%branch = 'nonnegative'
      call match_first_order(request_of_other, nonnegative, refusal)
      if (allocated(refusal)) return
      nonnegative%entropy = nonnegative%entropy + log(request%std/nonnegative%std)
      if (nonnegative%entropy > model%entropy) model%nonnegative_entropy = nonnegative%entropy
   end subroutine describe_alternating

   !> What is said of every law, in the unit of X.
   subroutine describe_law(request, law, model)
      type(process_request), intent(in) :: request
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model

      model%order = 1
      model%b0 = request%std/law%std
      call describe_correlation(request, law, model)
      model%mean = model%b0*law%mean
      model%std = request%std
      model%entropy = law%entropy + log(model%b0)
      model%entropy_bound = white_noise_entropy(request%std)
      model%optimality = max(abs(model%mean/request%mean - 1.0_wp), &
                             abs(length_of(law, request%correlation)/request%correlation_length &
                                 - 1.0_wp))
      call note_acceptances(law, model)
   end subroutine describe_law

   !> The other law of the same parameters.
   subroutine describe_other(other, model)
      type(first_order_law), intent(in) :: other
      type(process_model_type), intent(inout) :: model

      model%other_mean = model%b0*other%mean
      model%other_std = model%b0*other%std
      model%other_l0 = other%l0
      model%other_entropy = other%entropy + log(model%b0)
      call note_acceptances(other, model)
   end subroutine describe_other

   subroutine describe_correlation(request, law, model)
      type(process_request), intent(in) :: request
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      integer, parameter :: max_lags = 600
      complex(wp) :: pole
      integer :: n_lags

      ! the unconstrained process of the wanted length remembers longer than a positive one with
      ! K(m) >= 0; an alternating one of that |K(1)| may remember longer
      pole = request%correlation_length/(1.0_wp + request%correlation_length)
      if (law%is_alternating) pole = law%memory
      model%memory = ceiling(1.5_wp*memory_of([pole], 1.0e-9_wp))
      n_lags = min(memory_of([pole], 1.0e-6_wp), max_lags)
      allocate (model%autocovariance(0:n_lags), model%autocovariance_error(0:n_lags), &
                source=0.0_wp)
      model%autocovariance(:) = model%b0**2*law%autocovariance(n_lags)
      model%l0 = law%l0
      model%l1 = law%l1
      model%l0_cut = correlation_length_l0(model%autocovariance(0:1))
      model%l1_cut = correlation_length_l1(model%autocovariance(0:1))
   end subroutine describe_correlation

   !> Lambda belongs to the exact law, the other three to one-at-a-time rejection.
   subroutine note_acceptances(law, model)
      type(first_order_law), intent(in) :: law
      type(process_model_type), intent(inout) :: model

      if (law%is_sequential) then
         model%acceptance_ratio = law%acceptance_ratio
         model%acceptance_mean = law%acceptance_mean
         model%acceptance_geometric = law%acceptance_geometric
      else if (.not. law%is_alternating) then
         model%lambda = exp(max(law%log_lambda, log(tiny(1.0_wp))))
      end if
   end subroutine note_acceptances

   elemental function length_of(law, correlation) result(length)
      type(first_order_law), intent(in) :: law
      character(*), intent(in) :: correlation
      real(wp) :: length

      length = merge(law%l0, law%l1, correlation == 'L0')
   end function length_of

   !> For messages.
   pure function named(request) result(name)
      type(process_request), intent(in) :: request
      character(:), allocatable :: name

      name = 'positive process ('//request%sampler//' law) with std/mean = '// &
             to_text(request%std/request%mean)//', '//request%correlation//' = '// &
             to_text(request%correlation_length)//', order = 1'
   end function named

end module process_positive_first_order
