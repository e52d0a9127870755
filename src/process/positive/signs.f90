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
   use process_positive_objective, only: sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   implicit none(type, external)
   private
   public :: require_signs, settle_signs, signs_of, zero_lags

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

   !> The signs of the unconstrained solution made those of the positive law: a lag whose K(m) has
   !> the other sign is given an s_m in between that makes it 0, and one whose s_m would leave
   !> [-1, 1] is given that sign for good.
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
