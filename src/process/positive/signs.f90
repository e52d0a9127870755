!> Signs of the autocovariance of a positive process: those by which its correlation length was
!> summed, and by the direct method (Sec. 2.4.2) those of G_m = lambda_2 a_m s_m, where s_m is the
!> sign of K(m) under the positive law itself, or anything in [-1, 1] where that K(m) = 0.
module process_positive_signs
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: maximize, solve_along
   use process_correlation, only: constraint_weights
   use process_direct_fit, only: integer_signs
   use process_positive_objective, only: sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   implicit none(type, external)
   private
   public :: adopt_far_signs, compare_signs, multipliers_of, require_signs, settle_signs, &
             signs_solution

   !> Signs, multipliers and entropy of a process of the direct method.
   type :: signs_solution
      integer, allocatable :: signs(:)   !! s_m, m = 1..m_max; 0 where |s_m| < 1
      real(wp) :: delta = 0.0_wp         !! lambda_2/lambda_3
      real(wp) :: lambda_3 = 0.0_wp
      real(wp) :: entropy = 0.0_wp       !! per point [nat]
   end type signs_solution

   real(wp), parameter :: matched = 1.0e-7_wp   !! relative, of the targets; of K(m)/K(0) that is 0
   real(wp), parameter :: difference = 1.0e-4_wp   !! step of a difference
   real(wp), parameter :: clear = 1.0e-3_wp     !! of K(m)/K(0): a sign is another one

contains

   !> Fails where a K(m) clearly has another sign: by 5 standard errors and a thousandth of K(0).
   subroutine require_signs(law, autocovariance, standard_error, error)
      type(sampled_objective), intent(in) :: law
      real(wp), intent(in) :: autocovariance(0:)    !! (0:n_lags) K(m), with its standard errors
      real(wp), intent(in) :: standard_error(0:)
      type(error_type), allocatable, intent(out) :: error
      integer :: m

      do m = 1, ubound(autocovariance, 1)
         if (.not. is_opposite(law%signs(m), autocovariance(m), &
                               standard_error(m), autocovariance(0))) cycle
         call raise(error, exit_no_solution, law%problem%name// &
                    ': the search ended where K('//to_text(m)//') has changed its sign')
         return
      end do
   end subroutine require_signs

   elemental function is_opposite(s, k, standard_error, variance) result(is_so)
      real(wp), intent(in) :: s, k, standard_error, variance
      logical :: is_so

      is_so = s*k < -max(5.0_wp*standard_error, clear*variance)
   end function is_opposite

   !> Compares the signs by which lengths are summed with those of K(m) on many values.
   subroutine compare_signs(law, n_steps, autocovariance, is_wrong, is_inside, state)
      type(sampled_objective), intent(inout) :: law   !! from now on with averages of every lag
      integer, intent(in) :: n_steps    !! of a batch
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags)
      logical, allocatable, intent(out) :: is_wrong(:)          !! (0:n_lags)
      logical, intent(out) :: is_inside
      real(wp), allocatable, intent(out) :: state(:)            !! of the law
      real(wp), parameter :: unclear = 0.5_wp*clear
      real(wp), allocatable :: standard_error(:)

      call law%keep_lags(law%problem%n_lags)
      law%n_steps = n_steps
      call law%evaluate(law%point, state, is_inside)
      if (.not. is_inside) return
      call estimate_autocovariance(law%last%batches, law%known, law%problem%n_lags, &
                                   autocovariance, standard_error)
      is_wrong = law%signs*autocovariance < -max(3.0_wp*standard_error, unclear*autocovariance(0))
   end subroutine compare_signs

   !> Adopts the signs that K(m) have beyond the direct method's m_max, where no length is imposed.
   subroutine adopt_far_signs(law, state, error)
      type(sampled_objective), intent(inout) :: law
      real(wp), allocatable, intent(out) :: state(:)   !! of the law, on many values
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: sure_steps = 2048      ! of a batch
      real(wp), allocatable :: unused(:)
      logical, allocatable :: is_wrong(:)
      logical :: is_inside

      call compare_signs(law, sure_steps, unused, is_wrong, is_inside, state)
      if (.not. is_inside) then
         call raise(error, exit_no_solution, law%problem%name// &
                    ': the solution on few simulated values is lost on more')
         return
      end if
      is_wrong(:min(law%problem%cut + 1, size(is_wrong))) = .false.
      where (is_wrong) law%signs = -law%signs
      if (.not. any(is_wrong)) call law%keep_lags(law%problem%n_single)
   end subroutine adopt_far_signs

   !> Computes signs and multipliers of Eq. (30) from the matrix G: G_0 = 2 lambda_3 + 2 lambda_2
   !> a_0, G_m = lambda_2 a_m s_m; sign 0 where |s_m| < 1.
   subroutine multipliers_of(law, b0, solution, residual)
      type(sampled_objective), intent(in) :: law   !! of the direct method
      real(wp), intent(in) :: b0                   !! [unit of X]
      type(signs_solution), intent(out) :: solution
      !> largest one of G, relative, and of s_m K(m) >= 0 or, where |s_m| < 1, K(m) = 0, over K(0)
      real(wp), intent(out) :: residual
      real(wp), allocatable :: k(:), unused(:)
      real(wp) :: g(0:size(law%family%direction)), lambda_2, weights(0:size(law%family%direction))
      integer :: m

      g = law%last%g/b0**2
      associate (request => law%problem%request)
         weights = constraint_weights(request%correlation, request%correlation_length, ubound(g, 1))
      end associate
      solution%signs = integer_signs(law%family%s)
      m = maxloc(abs(weights(1:)), 1, solution%signs /= 0)
      lambda_2 = g(m)/(weights(m)*law%family%s(m))
      solution%lambda_3 = 0.5_wp*g(0) - lambda_2*weights(0)
      solution%delta = lambda_2/solution%lambda_3
      associate (s => law%family%s)
         call estimate_autocovariance(law%last%batches, law%known, size(s), k, unused)
         residual = max(maxval(abs(g(1:) - lambda_2*weights(1:)*s))/g(0), &
                        maxval(merge(max(-s*k(1:), 0.0_wp), abs(k(1:)), &
                                     solution%signs /= 0)/k(0), abs(weights(1:)) > 0.0_wp))
      end associate
   end subroutine multipliers_of

   !> Makes the signs of the unconstrained solution those of the positive law: a lag with a_m > 0
   !> whose K(m) has the other sign is given an s_m in between that makes it 0, and one whose s_m
   !> would leave [-1, 1] is given that sign for good. Where a_m < 0 the entropy has its least value
   !> at K(m) = 0, not its largest: another sign there belongs to another sequence. The targets are
   !> met in the end.
   subroutine settle_signs(law, error)
      type(sampled_objective), intent(inout) :: law   !! by_symbol
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_passes = 16
      real(wp), parameter :: inside = 1.0_wp - 1.0e-9_wp
      real(wp), allocatable :: k(:), standard_error(:)
      logical, allocatable :: is_free(:)
      integer :: pass

      is_free = abs(law%family%s) < inside
      do pass = 1, max_passes
         call free_signs(law, is_free)
         associate (s => law%family%s)
            if (any(abs(s) > 1.0_wp)) then
               is_free = is_free .and. abs(s) <= 1.0_wp
               s = max(-1.0_wp, min(1.0_wp, s))
               cycle
            end if
            if (.not. law%found%violation <= matched) then
               call raise(error, exit_no_solution, law%problem%name// &
                          ': the search for s_m ended '//to_text(law%found%violation)// &
                          ' (relative) from its targets')
               return
            end if
            call estimate_autocovariance(law%last%batches, law%known, size(s), k, standard_error)
            if (.not. any(is_wrong())) return
            if (any(is_wrong() .and. law%family%direction < 0.0_wp)) exit
            is_free = is_free .or. is_wrong()
         end associate
      end do
      call raise(error, exit_no_solution, law%problem%name// &
                 ': no signs s_m were found that are those of its K(m)')

   contains

      pure function is_wrong()
         logical :: is_wrong(size(is_free))

         is_wrong = .not. is_free .and. abs(law%family%direction) > 0.0_wp .and. &
                    is_opposite(law%family%s, k(1:), standard_error(1:), k(0))
      end function is_wrong

   end subroutine settle_signs

   !> Solves for the targets and for K(m) = 0 at the free lags; s_m of these may leave [-1, 1].
   subroutine free_signs(law, is_free)
      type(sampled_objective), intent(inout) :: law
      logical, intent(in) :: is_free(:)
      integer :: m
      logical :: was_free(size(is_free))

      associate (family => law%family, n => size(law%point))
         was_free = .false.
         was_free(family%free) = .true.
         if (all(is_free .eqv. was_free)) then
            call solve_along(law, matched, 20)
         else
            family%free = pack([(m, m=1, size(is_free))], is_free)
            law%point = [law%point(1), family%s(family%free), law%point(n)]
            call law%hold_at_zero(family%free)
            call law%keep_lags(law%problem%n_single)
            do m = 1, min(size(is_free), law%problem%n_lags)   ! summed by its own sign
               if (abs(law%known(m)) <= 1.0e-9_wp*law%known(0)) &
                  law%signs(m) = sign(1.0_wp, family%s(m))
            end do
            call maximize(law, difference, matched, 20)
         end if
         family%s(family%free) = law%point(2:size(law%point) - 1)
      end associate
   end subroutine free_signs

end module process_positive_signs
