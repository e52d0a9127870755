!> Signs of the autocovariance of a positive process: those by which its correlation length was
!> summed, and by the direct method (Sec. 2.4.2) those of G_m = lambda_2 a_m s_m, where s_m is the
!> sign of K(m) under the positive law itself, or anything in [-1, 1] where that K(m) = 0.
module process_positive_signs
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: search_result, solve_along
   use numerics_lapack, only: solve_linear_system
   use process_correlation, only: constraint_weights
   use process_direct_fit, only: integer_signs
   use process_model, only: process_solution
   use process_positive_objective, only: sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   implicit none(type, external)
   private
   public :: adopt_far_signs, compare_signs, multipliers_of, require_signs, settle_signs, zero_lags

   !> Lags whose K(m) is made 0 by s_m; not allocated: nobody has looked yet.
   type :: zero_lags
      integer, allocatable :: lags(:)
      real(wp), allocatable :: jacobian(:, :)   !! (lag, lag) d K(m)/K(0) by d s_m
   end type zero_lags

   real(wp), parameter :: matched = 1.0e-6_wp   !! relative, of the targets
   real(wp), parameter :: zero = 1.0e-6_wp      !! of K(m)/K(0) on the simulated values
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
         call raise(error, exit_no_solution, law%problem%name(ubound(law%last%g, 1))// &
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
   subroutine compare_signs(law, point, autocovariance, is_wrong, is_inside, state)
      type(sampled_objective), intent(inout) :: law   !! from now on with averages of every lag
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags)
      logical, allocatable, intent(out) :: is_wrong(:)          !! (0:n_lags)
      logical, intent(out) :: is_inside
      real(wp), allocatable, intent(out) :: state(:)            !! of the law
      integer, parameter :: sure_steps = 2048      ! of a batch
      real(wp), parameter :: unclear = 0.5_wp*clear
      real(wp), allocatable :: standard_error(:)

      call law%keep_every_lag()
      law%n_steps = sure_steps
      call law%evaluate(point, state, is_inside)
      if (.not. is_inside) return
      call estimate_autocovariance(law%last%batches, law%known, law%problem%n_lags, &
                                   autocovariance, standard_error)
      is_wrong = law%signs*autocovariance < -max(3.0_wp*standard_error, unclear*autocovariance(0))
   end subroutine compare_signs

   !> Direct method: beyond m_max, where no length is imposed, signs are those that K(m) has.
   subroutine adopt_far_signs(law, point, state, error)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(in) :: point(:)
      real(wp), allocatable, intent(out) :: state(:)   !! of the law, on many values
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: unused(:)
      logical, allocatable :: is_wrong(:)
      logical :: is_inside

      call compare_signs(law, point, unused, is_wrong, is_inside, state)
      if (.not. is_inside) then
         call raise(error, exit_no_solution, law%problem%name(law%problem%cut)// &
                    ': the solution on few simulated values is lost on more')
         return
      end if
      is_wrong(:min(law%problem%cut + 1, size(is_wrong))) = .false.
      where (is_wrong) law%signs = -law%signs
      if (.not. any(is_wrong)) call law%keep_lags(law%problem%n_single)
   end subroutine adopt_far_signs

   !> s_m, m = 1..m_max, of the law's symbol, and the G_m/G_0 of s_m = 1. Where a_m = 0 the sign
   !> does not matter and is +.
   pure subroutine signs_of(law, s, unit)
      type(sampled_objective), intent(in) :: law   !! of the direct method
      real(wp), allocatable, intent(out) :: s(:), unit(:)
      real(wp) :: weights(0:size(law%family%direction))

      associate (symbol => law%family%direction, a => weights(1:))
         weights = constraint_weights(law%problem%correlation, law%problem%length, size(symbol))
         ! some |s_m| are 1, and no other lag has a larger |G_m/a_m|
         unit = a*maxval(abs(symbol)/abs(a), abs(a) > 0.0_wp)
         allocate (s(size(unit)), source=1.0_wp)
         where (abs(unit) > 0.0_wp) s = symbol/unit
      end associate
   end subroutine signs_of

   !> Signs and multipliers of Eq. (30) from the matrix G: G_0 = 2 lambda_3 + 2 lambda_2 a_0, G_m =
   !> lambda_2 a_m s_m; sign 0 where |s_m| < 1.
   subroutine multipliers_of(law, b0, solution, residual)
      type(sampled_objective), intent(in) :: law   !! of the direct method
      real(wp), intent(in) :: b0                   !! [unit of X]
      type(process_solution), intent(out) :: solution
      !> largest one of G, relative, and of s_m K(m) >= 0 or, where |s_m| < 1, K(m) = 0, over K(0)
      real(wp), intent(out) :: residual
      real(wp), allocatable :: k(:), s(:), unit(:), unused(:)
      real(wp) :: g(0:size(law%family%direction)), lambda_2, weights(0:size(law%family%direction))
      integer :: m

      g = law%last%g/b0**2
      weights = constraint_weights(law%problem%correlation, law%problem%length, ubound(g, 1))
      call signs_of(law, s, unit)
      solution%signs = integer_signs(s)
      m = maxloc(abs(weights(1:)), 1, solution%signs /= 0)
      lambda_2 = g(m)/(weights(m)*s(m))
      solution%lambda_3 = 0.5_wp*g(0) - lambda_2*weights(0)
      solution%delta = lambda_2/solution%lambda_3
      call estimate_autocovariance(law%last%batches, law%known, size(s), k, unused)
      residual = max(maxval(abs(g(1:) - lambda_2*weights(1:)*s))/g(0), &
                     maxval(merge(max(-s*k(1:), 0.0_wp), abs(k(1:)), solution%signs /= 0)/k(0), &
                            abs(unit) > 0.0_wp))
   end subroutine multipliers_of

   !> The signs of the unconstrained solution made those of the positive law: a lag with a_m > 0
   !> whose K(m) has the other sign is given an s_m in between that makes it 0, and one whose s_m
   !> would leave [-1, 1] is given that sign for good. Where a_m < 0 the entropy has its least value
   !> at K(m) = 0, not its largest: another sign there belongs to another sequence.
   subroutine settle_signs(law, point, found, zeros, error)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(inout) :: point(:)          !! (ln factor, coordinate)
      type(search_result), intent(inout) :: found
      type(zero_lags), intent(inout) :: zeros
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_passes = 16
      real(wp), parameter :: inside = 1.0_wp - 1.0e-9_wp
      real(wp), allocatable :: k(:), s(:), standard_error(:), unit(:)
      logical, allocatable :: is_free(:)
      integer :: pass

      call signs_of(law, s, unit)
      is_free = abs(s) < inside
      do pass = 1, max_passes
         call make_zero(law, is_free, unit, s, point, found, zeros, error)
         if (allocated(error)) return
         if (any(abs(s) > 1.0_wp)) then
            is_free = is_free .and. abs(s) <= 1.0_wp
            s = max(-1.0_wp, min(1.0_wp, s))
            call take_signs(law, s, unit)
            cycle
         end if
         call estimate_autocovariance(law%last%batches, law%known, size(s), k, &
                                      standard_error)
         if (.not. any(is_wrong())) return
         if (any(is_wrong() .and. unit < 0.0_wp)) exit
         is_free = is_free .or. is_wrong()
      end do
      call raise(error, exit_no_solution, law%problem%name(size(s))// &
                 ': no signs s_m were found that are those of its K(m)')

   contains

      pure function is_wrong()
         logical :: is_wrong(size(s))

         is_wrong = .not. is_free .and. abs(unit) > 0.0_wp .and. &
                    is_opposite(s, k(1:), standard_error(1:), k(0))
      end function is_wrong

   end subroutine settle_signs

   !> Newton's method for K(m) = 0 at the free lags, with the slopes of its first step, the targets
   !> met at every step.
   subroutine make_zero(law, is_free, unit, s, point, found, zeros, error)
      type(sampled_objective), intent(inout) :: law
      logical, intent(in) :: is_free(:)
      real(wp), intent(in) :: unit(:)
      real(wp), intent(inout) :: s(:), point(:)
      type(search_result), intent(inout) :: found
      type(zero_lags), intent(inout) :: zeros
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_steps = 12
      real(wp), parameter :: difference = 0.02_wp
      real(wp) :: moved(size(point)), trial(size(s))
      real(wp), dimension(count(is_free)) :: rest, there
      real(wp), allocatable :: change(:)
      integer, allocatable :: lags(:)
      integer :: i, step

      lags = pack([(i, i=1, size(s))], is_free)
      if (allocated(zeros%lags)) then
         if (size(zeros%lags) /= size(lags)) then
            deallocate (zeros%jacobian)
         else if (any(zeros%lags /= lags)) then
            deallocate (zeros%jacobian)
         end if
      end if
      zeros%lags = lags
      do step = 1, max_steps
         call correlate(s, point, rest)
         if (allocated(error)) return
         if (all(abs(rest) <= zero)) return
         if (.not. allocated(zeros%jacobian)) then
            allocate (zeros%jacobian(size(lags), size(lags)))
            do i = 1, size(lags)
               trial = s
               trial(lags(i)) = trial(lags(i)) + difference
               moved = point
               call correlate(trial, moved, there)
               if (allocated(error)) return
               zeros%jacobian(:, i) = (there - rest)/difference
            end do
         end if
         call solve_linear_system(zeros%jacobian, rest, change, error)
         if (allocated(error)) return
         s(lags) = s(lags) - max(-0.5_wp, min(change, 0.5_wp))
         if (any(abs(s) > 1.5_wp)) return   ! these will be held at their bounds
      end do

   contains

      !> K(m)/K(0) of the free lags at the point that has the targets.
      subroutine correlate(signs, at, correlation)
         real(wp), intent(in) :: signs(:)
         real(wp), intent(inout) :: at(:)
         real(wp), intent(out) :: correlation(:)
         real(wp), allocatable :: k(:), unused(:)
         real(wp) :: violation

         call take_signs(law, signs, unit)
         call solve_along(law, at, found%jacobian, found%metric, matched, 20, violation)
         if (.not. violation <= matched) then
            call raise(error, exit_no_solution, law%problem%name(size(s))// &
                       ': the search for s_m ended '//to_text(violation)// &
                       ' (relative) from its targets')
            return
         end if
         call estimate_autocovariance(law%last%batches, law%known, size(s), k, unused)
         correlation = k(lags)/k(0)
      end subroutine correlate

   end subroutine make_zero

   !> G of these signs. A lag without correlation in the companion is summed by its own.
   pure subroutine take_signs(law, s, unit)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(in) :: s(:), unit(:)
      integer :: m

      law%family%direction(:) = s*unit
      do m = 1, min(size(s), law%problem%n_lags)
         if (abs(law%known(m)) <= 1.0e-9_wp*law%known(0)) law%signs(m) = sign(1.0_wp, s(m))
      end do
   end subroutine take_signs

end module process_positive_signs
