!> Request and solution of a maximum-entropy process (Sec. 2).
module process_model
   use core_kinds, only: long, two_pi, wp
   use core_random, only: label_of
   use core_text, only: rounded_text, to_text
   implicit none(type, external)
   private
   public :: process_moments, process_request, process_model_type, inversion_check, branch_note, &
             gaussian_entropy, innovation_scale, is_fitted_by_simulation, lengths_of, &
             positive_name, request_label, take_law, take_other_law

   !> Process that is asked for. Lengths are in lags; mean and std in the unit of X.
   type :: process_request
      character(16) :: method = 'autoregressive'   !! or 'direct', 'values'
      character(16) :: correlation = 'L0'        !! imposed: 'L0' Eq. (8), 'L1' Eq. (9), 'both'
      real(wp) :: correlation_length = 0.0_wp    !! imposed length; L0 of 'both'
      real(wp) :: second_length = 0.0_wp         !! L1 of 'both'
      integer :: order = 0                       !! M, or m_max of 'direct'; 0: chosen
      !> with order = 0: bound of the length that is not imposed, or both ends of its range; 0: none
      real(wp) :: bounds(2) = 0.0_wp
      character(16) :: bound_side = 'automatic'  !! side of a single bound: or 'upper', 'lower'
      integer :: max_order = 30                  !! highest order tried, with order = 0
      logical :: all_signs = .false.             !! direct: search all sequences of signs
      integer :: inversion_half_width = 0        !! direct: M of Eq. (35) for a check; 0: no check
      real(wp) :: mean = 0.0_wp
      real(wp) :: std = 0.0_wp
      logical :: positive = .false.
      character(16) :: sampler = 'sequential'    !! Sec. 2.4; or 'exact', Eq. (25)
      character(16) :: branch = 'any'            !! positive: or 'nonnegative', K(m) >= 0 alone
      integer :: fit_steps = 0                   !! positive: steps of a batch in the fit; 0: chosen
      !> of any sign: Eq. (39) from the 'stationary' law or 'from_rest', or Eq. (38), 'matrix'
      character(16) :: simulation = 'stationary'
   end type process_request

   !> Check of the autocovariance by the paper's method, the inverse of a finite matrix.
   type :: inversion_check
      integer :: half_width = 0                    !! M of Eq. (35); 0: no check
      real(wp), allocatable :: autocovariance(:)   !! Eq. (35), lags 0..order [unit of X squared]
      real(wp) :: error = 0.0_wp                   !! largest difference from the model, over K(0)
      real(wp) :: expected_error = 0.0_wp          !! |largest pole|^(2 half_width)
      real(wp) :: seconds = 0.0_wp                 !! CPU time of the inversion
      real(wp) :: seconds_of_fit = 0.0_wp          !! CPU time of the direct method
   end type inversion_check

   !> Moments of a law, with standard errors.
   type :: process_moments
      real(wp) :: mean = 0.0_wp, mean_error = 0.0_wp
      real(wp) :: std = 0.0_wp, std_error = 0.0_wp
      real(wp) :: l0 = 0.0_wp, l0_error = 0.0_wp       !! infinite sums [lags]
      real(wp) :: l1 = 0.0_wp, l1_error = 0.0_wp
      real(wp) :: entropy = 0.0_wp, entropy_error = 0.0_wp   !! per point [nat]
      real(wp) :: lambda = 1.0_wp, lambda_error = 0.0_wp     !! exact law: limit of p_acc^(s), (45)
      !> one-at-a-time rejection: accepted/proposed = 1/E[1/alpha], E[alpha], exp E[ln alpha]
      real(wp) :: acceptance_ratio = 1.0_wp, acceptance_mean = 1.0_wp, acceptance_geometric = 1.0_wp
   end type process_moments

   !> Process that was solved or refused, with the moments achieved.
   type, extends(process_moments) :: process_model_type
      type(process_request) :: request
      logical :: is_solved = .false.
      character(:), allocatable :: reason        !! why it was refused or what was not searched
      integer :: order = 0                       !! M of the recursion below
      real(wp), allocatable :: a(:)              !! a_q, Eq. (39): z_n = b0 w_n - sum a_q z_(n-q)
      real(wp) :: b0 = 0.0_wp
      real(wp) :: mu = 0.0_wp                    !! mean of the underlying Gaussian process
      complex(wp), allocatable :: poles(:)       !! (order), Eq. (40)
      real(wp), allocatable :: autocovariance(:) !! K_XX(lag), lag = 0.. [unit of X squared]
      real(wp), allocatable :: autocovariance_error(:)   !! standard error where sampled, else 0
      real(wp) :: l0_cut = 0.0_wp, l1_cut = 0.0_wp   !! sums cut at the order, Eq. (11)
      real(wp) :: entropy_bound = 0.0_wp         !! entropy of white noise, Eq. (42)
      real(wp) :: optimality = 0.0_wp            !! largest residual of the optimality conditions
      real(wp) :: seconds = 0.0_wp               !! processor time of the fit
      !> positive: signs of K(m), 'nonnegative', 'alternating' or 'mixed'; of a forecast 'open' if
      !> it did not find them, 'two' if a fit may search two branches; else unallocated
      character(:), allocatable :: branch
      !> exact law with alternating K(m): row of the matrix G [1/unit of X squared]. As G may be
      !> indefinite, there are no a, poles and Lambda; b0 = 1/sqrt(G_0), and mu is the centre of the
      !> law
      real(wp), allocatable :: g(:)
      !> the same at order 1: nodes x_j [unit of X] and weights w_j of the transition density
      !> p(y|x) ~ exp(-G_0 y^2/2 + (field - G_1 x) y) sum w_j exp(-G_1 x_j y),
      !> field = mu (G_0 + 2 G_1)
      real(wp), allocatable :: nodes(:), weights(:)
      !> alternating: entropy of the process with K(m) >= 0 under the other law, if larger; else 0
      real(wp) :: nonnegative_entropy = 0.0_wp
      integer :: memory = 0                      !! positive: steps that forget a start, to 1e-9
      !> positive: statistics of the other law with the same a_q, b0 and mu
      type(process_moments) :: other
      integer, allocatable :: signs(:)           !! direct: s_m
      real(wp) :: delta = 0.0_wp, lambda_3 = 0.0_wp   !! direct: multipliers of Sec. 2.2
      !> direct: the best consistent solutions of the sign search, at most 100
      integer, allocatable :: solutions_signs(:, :)   !! (m, solution)
      real(wp), allocatable :: solutions_delta(:), solutions_lambda_3(:), solutions_entropy(:)
      integer :: n_examined = 0                  !! direct: sequences of signs examined
      integer :: n_consistent = 0                !! direct: solutions among them; 0: not counted
      real(wp) :: entropy_ceiling = 0.0_wp       !! direct: proven upper bound for all sequences
      character(:), allocatable :: search        !! direct: which sequences were searched
      type(inversion_check) :: inversion         !! direct
   end type process_model_type

contains

   !> Entropy rate of a Gaussian process, 0.5 ln(2 pi e b0^2) [nat]: limit of Eq. (37) per point.
   !> With b0 = sigma_X it is that of white noise, Eq. (42), the largest one for this std.
   elemental real(wp) function gaussian_entropy(b0) result(entropy)
      real(wp), intent(in) :: b0   !! std of the innovations [unit of X]
      real(wp), parameter :: log_two_pi_e = 1.0_wp + log(two_pi)

      entropy = 0.5_wp*log_two_pi_e + log(b0)
   end function gaussian_entropy

   !> Fills the model of a positive process with this std by its law.
   pure subroutine take_law(law, std, model)
      class(process_moments), intent(in) :: law   !! moments of x/b0, but the entropy of x/std
      real(wp), intent(in) :: std                 !! [unit of X]
      type(process_model_type), intent(inout) :: model

      model%b0 = std/law%std
      model%process_moments = moments_in_unit(law, model%b0, std)
      model%entropy_bound = gaussian_entropy(std)
   end subroutine take_law

   !> Adds to the model of a positive process the other law with the same a_q, b0 and mu.
   pure subroutine take_other_law(law, model)
      class(process_moments), intent(in) :: law   !! see `take_law`
      type(process_model_type), intent(inout) :: model

      model%other = moments_in_unit(law, model%b0, model%b0*law%std)
      if (model%request%sampler == 'exact') then
         model%acceptance_ratio = law%acceptance_ratio
         model%acceptance_mean = law%acceptance_mean
         model%acceptance_geometric = law%acceptance_geometric
      else
         model%lambda = law%lambda
         model%lambda_error = law%lambda_error
      end if
   end subroutine take_other_law

   !> Moments of a law in the unit of X.
   pure function moments_in_unit(law, b0, std) result(moments)
      class(process_moments), intent(in) :: law   !! see `take_law`
      real(wp), intent(in) :: b0, std             !! [unit of X]
      type(process_moments) :: moments

      moments = law
      moments%mean = b0*law%mean
      moments%mean_error = b0*law%mean_error
      moments%std = std
      moments%std_error = b0*law%std_error
      moments%entropy = law%entropy + log(std)
   end function moments_in_unit

   !> True if the fit simulates values and takes seconds, not milliseconds.
   elemental logical function is_fitted_by_simulation(request)
      type(process_request), intent(in) :: request

      is_fitted_by_simulation = request%positive .and. request%order /= 1
   end function is_fitted_by_simulation

   !> Note on a process whose K(m) alternates or whose branch is not known for sure; else empty.
   pure function branch_note(model) result(note)
      type(process_model_type), intent(in) :: model
      character(:), allocatable :: note

      note = ''
      if (.not. (model%is_solved .and. allocated(model%branch))) return
      if (allocated(model%reason)) note = model%reason
      if (model%branch == 'open') &
         note = 'not found in a short search: a run searches further'
      if (model%branch == 'two') &
         note = 'alternating K(m) may be searched too, for up to a minute or two: '// &
                "branch = 'nonnegative' leaves them out"
      if (model%branch /= 'alternating') return
      if (len(note) > 0) note = note//'; '
      note = note//'K(m) alternates: neighbours are anticorrelated; '// &
             "branch = 'nonnegative' refuses it"
      if (abs(model%nonnegative_entropy) > 0.0_wp) &
         note = note//"; sampler = '"//trim(merge('exact     ', 'sequential', &
                                                  model%request%sampler == 'sequential'))// &
                "' has one with K(m) >= 0 and "// &
                to_text(nint(1.0e4_wp*(model%nonnegative_entropy - model%entropy))/1.0e4_wp)// &
                ' nat more entropy'
   end function branch_note

   !> Description of a positive request, for messages.
   pure function positive_name(request) result(name)
      type(process_request), intent(in) :: request
      character(:), allocatable :: name

      name = 'positive process ('//trim(request%sampler)//' law) with std/mean = '// &
             rounded_text(request%std/request%mean, 6)//', '//lengths_of(request)// &
             ', order = '//to_text(request%order)
   end function positive_name

   !> 'L0 = 1.0' or 'L0 = 1.0, L1 = 2.0', for messages.
   pure function lengths_of(request) result(text)
      type(process_request), intent(in) :: request
      character(:), allocatable :: text

      text = merge('L1', 'L0', request%correlation == 'L1')//' = '// &
             to_text(request%correlation_length)
      if (request%correlation == 'both') text = text//', L1 = '//to_text(request%second_length)
   end function lengths_of

   !> Scale b0 = 1/sqrt(G_0) of the law with this row of G, Eq. (25); 0 unless G_0 is positive.
   pure real(wp) function innovation_scale(g) result(b0)
      real(wp), intent(in) :: g(0:)   !! [1/unit of X squared]

      b0 = 0.0_wp
      if (size(g) == 0) return
      if (g(0) > 0.0_wp) b0 = 1.0_wp/sqrt(g(0))
   end function innovation_scale

   !> Label of the random streams of a process. It depends on the process alone, not on the rest of
   !> the scene.
   pure integer(long) function request_label(request) result(label)
      type(process_request), intent(in) :: request

      label = label_of(trim(request%method)//' '//trim(request%correlation)//' '// &
                       trim(request%sampler))
      label = label_of(label, request%correlation_length)
      label = label_of(label, request%order)
      label = label_of(label, merge(request%bounds(1), 0.0_wp, request%correlation == 'L1'))
      label = label_of(label, merge(request%bounds(1), 0.0_wp, request%correlation == 'L0'))
      label = label_of(label, request%max_order)
      label = label_of(label, request%mean)
      label = label_of(label, request%std)
      label = label_of(label, merge(1, 0, request%positive))
      if (request%correlation == 'both') label = label_of(label, request%second_length)
      if (request%bounds(2) > 0.0_wp) label = label_of(label, request%bounds(2))
   end function request_label

end module process_model
