!> Maxima of the entropy whose K(m) have the signs by which their lengths are summed.
!>
!> Lengths are sums of |K(m)|: a search assumes the sign of each K(m), or keeps K(m) = 0. By the
!> direct method (Sec. 2.4.2) G_m = lambda_2 a_m s_m, where s_m is the sign of K(m) under the
!> positive law, or lies in [-1, 1] where K(m) = 0.
module process_positive_signs
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: maximize
   use process_positive_family, only: by_symbol, by_reflection
   use process_positive_moments, only: error_of_residual
   use process_positive_objective, only: difference_step, sampled_objective
   implicit none(type, external)
   private
   public :: find_maximum, has_assumed_signs, has_decayed, match_signs, require_signs, search_finer

   real(wp), parameter :: gradient_tolerance = 1.0e-3_wp   !! largest gradient at a maximum [nat]
   real(wp), parameter :: sign_threshold = 1.0e-3_wp       !! |K(m)/K(0)| that shows a sign

contains

   !> Finds the maximum. Keeps the shape of a weak correlation.
   subroutine find_maximum(search)
      type(sampled_objective), intent(inout) :: search   !! its inverse Hessian is used, if it fits
      real(wp), parameter :: stationary = 0.01_wp   ! gradient over the size of the shape
      real(wp) :: tolerance
      integer :: max_iterations

      tolerance = gradient_tolerance
      if (search%family%kind == by_reflection) &
         tolerance = min(gradient_tolerance, &
                         stationary*norm2(search%point(:size(search%point) - 1)))
      if (search%family%is_weakly_correlated(search%point)) tolerance = huge(1.0_wp)
      max_iterations = 80
      if (any(search%family%kind == [by_symbol, by_reflection])) max_iterations = 25
      call maximize(search, difference_step, tolerance, max_iterations)
   end subroutine find_maximum

   !> Finds the maximum whose K(m) have the assumed signs, by turning signs and searching again. If
   !> signs keep turning, or a search fails, it is the last process on the way whose signs were
   !> right, though entropy is gained by releasing one of its K(m) = 0; not converged if there was
   !> none.
   subroutine match_signs(search)
      type(sampled_objective), intent(inout) :: search
      type(sampled_objective), allocatable :: consistent
      real(wp) :: effort

      call turn_signs(search, consistent)
      if (search%found%is_converged .or. .not. allocated(consistent)) return
      effort = search%effort
      search = consistent
      search%effort = effort
      associate (n => search%n_constraints - size(search%zeros))   ! they need not be 0 any more
         search%found%jacobian = search%found%jacobian(:n, :)
         search%found%multipliers = search%found%multipliers(:n)
      end associate
      call search%hold_at_zero([integer ::])
      call search%set_single_lags()
   end subroutine match_signs

   !> Turns signs and searches again until K(m) have the assumed ones; not converged if signs keep
   !> turning or come back to those that failed. K(m) = 0 becomes a constraint where its sign must
   !> not turn or has turned before, until entropy is gained by releasing it to an allowed side. If
   !> a search fails, K(m) that is farthest on the wrong side is held at 0, and all others stay as
   !> they were. By the direct method the signs of lags with a_m = 0 may turn; those with a_m < 0
   !> may not, because another sign belongs to another sequence.
   subroutine turn_signs(search, consistent)
      type(sampled_objective), intent(inout) :: search
      type(sampled_objective), allocatable, intent(out) :: consistent   !! see `match_signs`
      integer, parameter :: max_passes = 12
      integer, parameter :: sign_steps = 16     ! steps that tell the signs, over those of a search
      integer, parameter :: zero_steps = 1024   ! steps of a batch, if some K(m) = 0
      real(wp), allocatable :: assumed(:), before(:), failed(:)   ! (0:n_lags) signs
      real(wp), allocatable :: autocovariance(:), gains(:), reached(:)
      integer, allocatable :: lags(:)
      logical, allocatable :: is_fixed(:), is_held(:), is_wrong(:)
      integer :: n_steps, pass, worst

      n_steps = search%n_steps
      failed = 0.0_wp*search%signs
      allocate (is_held(size(search%signs)), source=search%problem%request%branch == 'nonnegative')
      allocate (is_fixed(size(search%signs)), source=.false.)
      if (search%family%kind == by_symbol) then
         associate (a => search%family%direction(:min(search%problem%n_lags, search%problem%cut)))
            is_held(2:size(a) + 1) = is_held(2:size(a) + 1) .or. a > 0.0_wp
            is_fixed(2:size(a) + 1) = a < 0.0_wp
         end associate
      end if
      do pass = 1, max_passes
         call compare_signs(search, sign_steps*n_steps, autocovariance, is_wrong)
         search%n_steps = n_steps
         if (.not. search%found%is_converged) return
         is_wrong(search%zeros + 1) = .false.
         gains = release_gains(search)
         search%found%is_converged = .not. any(is_wrong .and. is_fixed)
         if (.not. search%found%is_converged) return
         if (.not. (any(is_wrong) .or. any(abs(gains) > gradient_tolerance))) exit
         if (.not. (any(is_wrong) .or. search%family%kind == by_symbol)) then
            consistent = search
            consistent%found%residual = max(search%found%residual, maxval(abs(gains)))
         end if
         search%found%is_converged = pass < max_passes
         if (.not. search%found%is_converged) return
         before = search%signs
         reached = search%point
         lags = pack(search%zeros, abs(gains) <= gradient_tolerance)
         if (any(is_wrong .and. is_held)) &   ! one at a time: the others may turn with it
            lags = [lags, minloc(search%signs*autocovariance, 1, is_wrong .and. is_held) - 1]
         search%signs(search%zeros) = merge(sign(1.0_wp, gains), search%signs(search%zeros), &
                                            abs(gains) > gradient_tolerance)
         where (is_wrong .and. .not. is_held) search%signs = -search%signs
         worst = minloc(before*autocovariance, 1, is_wrong) - 1
         is_held = is_held .or. is_wrong
         do
            if (size(lags) > 0) search%n_steps = max(n_steps, zero_steps)
            assumed = search%signs
            assumed(lags) = 0.0_wp
            search%found%is_converged = .false.
            if (all(assumed == failed)) return
            call search%hold_at_zero(lags)
            call search%set_single_lags()
            call find_maximum(search)
            if (search%found%is_converged .or. worst < 1) exit
            if (search%family%kind == by_symbol) exit
            failed = assumed
            lags = [worst]   ! and nothing else changes
            search%signs = before
            search%point = reached
            worst = 0
         end do
         if (.not. search%found%is_converged) return
      end do
   end subroutine turn_signs

   !> Compares the assumed signs with those of K(m) on many values; not converged if the law leaves
   !> the domain on these.
   subroutine compare_signs(search, n_steps, autocovariance, is_wrong)
      type(sampled_objective), intent(inout) :: search
      integer, intent(in) :: n_steps    !! steps of a batch
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags)
      logical, allocatable, intent(out) :: is_wrong(:)          !! (0:n_lags)
      real(wp), allocatable :: standard_error(:), state(:)

      call search%set_single_lags(search%problem%n_lags)
      search%n_steps = n_steps
      call search%evaluate(search%point, state, search%found%is_converged)
      if (.not. search%found%is_converged) return
      call search%estimate_lags(search%problem%n_lags, autocovariance, standard_error)
      is_wrong = search%signs*autocovariance < -max(3.0_wp*standard_error, &
                                                    0.5_wp*sign_threshold*autocovariance(0))
   end subroutine compare_signs

   !> Derivative of the entropy by a |K(m)|/K(0) that is held at 0, on the allowed side where it is
   !> positive, with the sign of that side; 0: it is positive on none. With w the derivative by the
   !> targets and T that by K(m)/K(0) and the targets together, it is s T - w on the side of s. By
   !> the direct method T/w is s_m.
   function release_gains(search) result(gains)
      type(sampled_objective), intent(in) :: search
      real(wp) :: gains(size(search%zeros))
      real(wp) :: lengths(2), total, weight
      integer :: i, m, n_targets

      if (search%family%kind == by_symbol) then
         associate (s => search%point(2:size(gains) + 1))
            gains = merge(s, 0.0_wp, abs(s) > 1.0_wp)
         end associate
         return
      end if
      n_targets = search%n_constraints - size(search%zeros)
      associate (moments => search%last%moments, request => search%problem%request, &
                 multipliers => search%found%multipliers)   ! multipliers of ratio, length(s), zeros
         lengths = 0.0_wp   ! multipliers of L0 and L1
         lengths(merge(2, 1, request%correlation == 'L1')) = &
            multipliers(2)/request%correlation_length
         if (n_targets == 3) lengths(2) = multipliers(3)/request%second_length
         do i = 1, size(gains)
            m = search%zeros(i)
            weight = lengths(1) + lengths(2)*(m - moments%l1)/(1.0_wp + moments%l0)
            total = search%signs(m)*weight + multipliers(n_targets + i)
            gains(i) = max(total - weight, 0.0_wp)
            if (-total - weight > gains(i) .and. request%branch /= 'nonnegative') &
               gains(i) = total + weight
         end do
      end associate
   end function release_gains

   !> Finds the maximum on more simulated values than before, with the signs of K(m) there. The
   !> search stays as it was if none is found.
   subroutine search_finer(search, is_finer)
      type(sampled_objective), intent(inout) :: search
      logical, intent(out) :: is_finer
      integer, parameter :: finer_steps = 2048      ! steps of a batch
      real(wp), parameter :: allowance = 2.0e9_wp   ! further effort, see `max_effort`
      type(sampled_objective) :: before

      before = search
      search%max_effort = search%effort + allowance
      search%n_steps = finer_steps
      call search%set_single_lags()
      call search%set_burn_in()
      call find_maximum(search)
      if (search%found%is_converged) call match_signs(search)
      search%max_effort = before%max_effort
      is_finer = search%found%is_converged
      if (.not. is_finer) search = before
   end subroutine search_finer

   !> True if the sum of |K(m)| over the last fifth of the lags is small, or no more than noise.
   logical function has_decayed(search) result(is_so)
      type(sampled_objective), intent(in) :: search   !! evaluated with averages of every single lag
      real(wp), parameter :: little = 5.0e-3_wp, standard_errors = 3.0_wp
      real(wp), allocatable :: k(:), residuals(:, :)
      integer :: first

      associate (n => search%problem%n_lags, batches => search%last%batches)
         allocate (residuals(size(batches%x, 2), 0:n))
         call search%estimate_lags(n, k, residuals=residuals)
         k = search%signs*k
         first = n + 1 - n/5
         is_so = abs(sum(k(first:))) <= &
                 max(little*sum(k(2:)), standard_errors &
                     *error_of_residual(matmul(residuals(:, first:), search%signs(first:))))
      end associate
   end function has_decayed

   !> True if K(m) up to the order have the assumed signs at the last evaluation.
   pure logical function has_assumed_signs(search)
      type(sampled_objective), intent(in) :: search
      real(wp), allocatable :: autocovariance(:), standard_error(:)
      type(error_type), allocatable :: error

      call search%estimate_lags(ubound(search%last%g, 1), autocovariance, standard_error)
      call require_signs(search, autocovariance, standard_error, error)
      has_assumed_signs = .not. allocated(error)
   end function has_assumed_signs

   !> Fails if a K(m) has not the assumed sign, by 5 standard errors and a thousandth of K(0).
   pure subroutine require_signs(search, autocovariance, standard_error, error)
      type(sampled_objective), intent(in) :: search
      real(wp), intent(in) :: autocovariance(0:)    !! K(m), to any lag, with its standard errors
      real(wp), intent(in) :: standard_error(0:)
      type(error_type), allocatable, intent(out) :: error
      integer :: m

      do m = 1, ubound(autocovariance, 1)
         if (search%signs(m)*autocovariance(m) >= &
             -max(5.0_wp*standard_error(m), sign_threshold*autocovariance(0))) cycle
         call raise(error, exit_no_solution, search%problem%name// &
                    ': the search ended where K('//to_text(m)//') has changed its sign')
         return
      end do
   end subroutine require_signs

end module process_positive_signs
