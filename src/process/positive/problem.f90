!> Problem of a positive process that is solved on simulated values: targets, linear companion and
!> random numbers. A search changes `ratio` and, of both lengths, `request%second_length` on the way
!> to the wanted ones, and `request%branch`. Everything is in units of b0.
module process_positive_problem
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_random, only: stream_type
   use core_text, only: to_text
   use process_autoregressive_description, only: describe_ar
   use process_autoregressive_fit, only: broken_rule, equal_reflection, &
                                         nonnegative_reflection, optimal_reflection
   use process_autoregressive_model, only: autocovariance_of, coefficients_of, innovation_std, &
                                           reflection_of
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_autoregressive_sums, only: correlation_sums, sum_correlation
   use process_direct_fit, only: fit_unconstrained
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: positive_name, process_model_type, process_request
   use process_positive_sequential, only: memory_of
   implicit none(type, external)
   private
   public :: sampled_problem, is_out_of_reach, new_problem

   !> Targets under the law of one-at-a-time rejection (Sec. 2.4) or of Eq. (25), and the companion:
   !> the unconstrained process of the wanted length, driven by the same noise.
   type :: sampled_problem
      type(process_request) :: request
      character(:), allocatable :: name              !! name in messages
      logical :: is_exact = .false.                  !! true: Eq. (25); false: sequential law
      real(wp) :: ratio = 0.0_wp                     !! std/mean, wanted or on the way there
      integer :: cut = 0                             !! last lag of imposed sums; 0: none
      type(stream_type) :: stream                    !! random numbers of every trial
      real(wp), allocatable :: companion(:)          !! a_q of the companion
      real(wp), allocatable :: autocovariance(:)     !! (0:n_lags) autocovariance of the companion
      real(wp), allocatable :: symbol(:)             !! (m_max) direct method: its G_m/G_0
      real(wp) :: l0 = 0.0_wp                        !! L0 of the companion [lags]
      real(wp) :: l1 = 0.0_wp                        !! both lengths: L1 of the companion [lags]
      !> companion's sums of |rho(m)| and of m |rho(m)| beyond n_lags
      real(wp) :: tail_l0 = 0.0_wp, tail_moment = 0.0_wp
      integer :: n_lags = 0                          !! last lag that is simulated
      integer :: memory = 0                          !! steps after which correlation is below 1e-9
      real(wp) :: decay = 0.0_wp                     !! alternating: |K(m + 1)/K(m)| at order 1
   end type sampled_problem

contains

   !> Makes the problem of a request. Fails if the unconstrained process does, and if more lags
   !> count than a search can carry in a minute or two.
   subroutine new_problem(request, stream, problem, error, decay, sequence)
      type(process_request), intent(in) :: request
      type(stream_type), intent(in) :: stream
      type(sampled_problem), intent(out) :: problem
      type(error_type), allocatable, intent(out) :: error
      !> alternating K(m): |K(m + 1)/K(m)| of order 1 for large m; the companion is then the mirror
      !> image, and lags of twice that memory count
      real(wp), intent(in), optional :: decay
      !> direct method: the companion has these signs (default: those of the largest entropy)
      type(sequence_solution), intent(in), optional :: sequence
      type(process_model_type) :: unconstrained
      type(correlation_sums) :: sums
      real(wp), allocatable :: g(:), kappa(:), rho(:)
      integer :: m

      problem%request = request
      problem%is_exact = request%sampler == 'exact'
      problem%name = positive_name(request)
      if (present(sequence)) then
         call describe_ar(sequence%a, 1.0_wp, unconstrained, error)
      else if (request%correlation == 'both') then
         call match_both_lengths(request, problem%l1, unconstrained, error)
      else
         call fit_unconstrained(request, unconstrained, error)
      end if
      if (allocated(error)) return
      kappa = reflection_of(unconstrained%a)
      call sum_correlation(kappa, sums, error)
      if (allocated(error)) return
      kappa = [kappa, spread(0.0_wp, 1, request%order - size(kappa))]
      problem%ratio = request%std/request%mean
      problem%l0 = sums%l0
      problem%stream = stream
      problem%n_lags = max(size(kappa), memory_of(abs(unconstrained%poles(1)), 1.0e-4_wp))
      problem%memory = ceiling(1.5_wp*memory_of(abs(unconstrained%poles(1)), 1.0e-9_wp))
      if (present(decay)) problem%decay = decay
      if (problem%decay > 0.0_wp) then
         kappa(1::2) = -kappa(1::2)
         ! the more lags L1 counts, the more noise it has
         problem%n_lags = max(problem%n_lags, merge(1, 2, request%correlation == 'both') &
                              *memory_of(problem%decay, 1.0e-4_wp))
         problem%memory = max(problem%memory, 3*memory_of(problem%decay, 1.0e-9_wp))
      end if
      problem%companion = coefficients_of(kappa)
      if (is_out_of_reach(problem)) then
         call raise(error, exit_no_solution, problem%name//': '//to_text(problem%n_lags)// &
                    ' lags count; the sequential law is sampled to 4000 of them, the exact one '// &
                    'to 600 and to L0 = 10; order 1 is solved without sampling')
         return
      end if
      if (request%method == 'direct') then
         g = symbol_of_process(unconstrained%a, 1.0_wp)
         problem%symbol = g(2:)/g(1)
         problem%cut = request%order
      end if
      rho = autocovariance_of(kappa, problem%n_lags)
      problem%tail_l0 = sums%l0 - sum(abs(rho(2:)))
      problem%tail_moment = sums%l1*(1.0_wp + sums%l0) &
                            - sum([(m*abs(rho(m + 1)), m=1, problem%n_lags)])
      allocate (problem%autocovariance(0:problem%n_lags))
      problem%autocovariance(:) = rho/innovation_std(kappa, 1.0_wp)**2
   end subroutine new_problem

   !> Finds the companion of both lengths: the process of the highest order that has both with
   !> K(m) >= 0, else that of this L0 alone. Fails if the request is invalid or no process has both.
   subroutine match_both_lengths(request, l1, companion, error)
      type(process_request), intent(in) :: request
      real(wp), intent(out) :: l1   !! of the companion [lags]
      type(process_model_type), intent(out) :: companion
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: kappa(:)
      logical :: has_both

      l1 = request%second_length
      call optimal_reflection(request, kappa, error)
      if (allocated(error)) return
      if (broken_rule(request) /= '') then
         call raise(error, exit_no_solution, positive_name(request)//': '//broken_rule(request))
         return
      end if
      kappa = nonnegative_reflection(request)
      has_both = size(kappa) > 0
      if (.not. has_both) kappa = equal_reflection(request%correlation_length, request%order)
      call describe_ar(coefficients_of(kappa), 1.0_wp, companion, error)
      if (.not. (has_both .or. allocated(error))) l1 = companion%l1
   end subroutine match_both_lengths

   !> True if more lags count than a law is simulated with; sweeps of the exact one grow as L0^2.
   pure logical function is_out_of_reach(problem)
      type(sampled_problem), intent(in) :: problem
      integer, parameter :: most_lags(2) = [4000, 600]   ! sequential, exact
      real(wp), parameter :: longest = 10.0_wp*(1.0_wp + 1.0e-9_wp)

      is_out_of_reach = problem%n_lags > most_lags(merge(2, 1, problem%is_exact)) .or. &
                        problem%is_exact .and. problem%l0 > longest
   end function is_out_of_reach

end module process_positive_problem
