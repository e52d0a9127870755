!> Maxima of a sampled process with the signs that its autocovariance has.
!>
!> Lengths are sums of |K(m)|: each K(m) is counted by an assumed sign, or held at 0. By the direct
!> method (Sec. 2.4.2) G_m = lambda_2 a_m s_m, where s_m is the sign of K(m) under the positive law
!> itself, or anything in [-1, 1] where that K(m) = 0.
module process_positive_signs
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_constrained_maximum, only: maximize
   use process_positive_family, only: by_symbol, free
   use process_positive_moments, only: estimate_autocovariance
   use process_positive_objective, only: sampled_objective
   implicit none(type, external)
   private
   public :: adopt_signs, difference, fades, find_maximum, has_wanted_signs, require_signs, sharpen

   real(wp), parameter :: acceptable = 1.0e-3_wp   !! gradient of the entropy left
   real(wp), parameter :: difference = 1.0e-5_wp   !! step of a difference
   real(wp), parameter :: clear = 1.0e-3_wp        !! of K(m)/K(0): a sign is another one

contains

   !> Finds the maximum in the interior, or on the faces that the search runs into: it often lies
   !> where positive values just keep the law finite, and every other one could just grow. Of a weak
   !> correlation the shape is kept: the targets can be met from any point.
   subroutine find_maximum(law)
      type(sampled_objective), intent(inout) :: law   !! begun with its metric, where that fits
      real(wp), parameter :: near = 0.05_wp, stationary = 0.01_wp
      integer, parameter :: max_iterations(2) = [25, 80]   ! with a Gaussian process, and without
      real(wp), allocatable :: room(:)
      real(wp) :: tolerance
      integer :: p
      logical :: is_gaussian

      is_gaussian = law%family%kind == free .or. law%family%kind == by_symbol
      tolerance = acceptable
      if (law%family%kind == free) &
         tolerance = min(acceptable, stationary*norm2(law%point(:size(law%point) - 1)))
      if (law%family%is_weak(law%point)) tolerance = huge(1.0_wp)
      do
         call maximize(law, difference, tolerance, max_iterations(merge(1, 2, is_gaussian)))
         if (law%found%is_converged .or. is_gaussian .or. law%is_exhausted() .or. &
             size(law%point) <= law%n_constraints) return
         room = law%family%room(law%point)
         room(law%family%faces) = huge(near)
         p = minloc(room, 1)
         if (room(p) > near) return
         call law%family%add_face(p, law%point)
      end do
   end subroutine find_maximum

   !> Adopts the signs that K(m) have at the maximum and finds the maximum with them; not converged
   !> where they do not come to rest. Where a sign must not turn, or K(m) has the other sign with
   !> either one, K(m) = 0 is a constraint, as long as its multiplier does not pull K(m) to a side
   !> that is allowed. By the direct method the signs may turn that do not count. Where a_m < 0 the
   !> entropy has its least value at K(m) = 0, not its largest: another sign belongs to another
   !> sequence.
   subroutine adopt_signs(law)
      type(sampled_objective), intent(inout) :: law   !! from now on with averages of every lag
      integer, parameter :: max_passes = 12
      integer, parameter :: surer = 16          ! times as many steps tell the signs
      integer, parameter :: zero_steps = 1024   ! of a batch where some K(m) = 0
      real(wp), allocatable :: autocovariance(:), pulls(:), reached(:)
      integer, allocatable :: lags(:)
      logical, allocatable :: is_barred(:), is_held(:), is_wrong(:)
      integer :: n_steps, pass

      n_steps = law%n_steps
      allocate (is_held(size(law%signs)), source=law%problem%request%branch == 'nonnegative')
      allocate (is_barred(size(law%signs)), source=.false.)
      if (law%family%kind == by_symbol) then
         associate (a => law%family%direction(:min(law%problem%n_lags, law%problem%cut)))
            is_held(2:size(a) + 1) = is_held(2:size(a) + 1) .or. a > 0.0_wp
            is_barred(2:size(a) + 1) = a < 0.0_wp
         end associate
      end if
      do pass = 1, max_passes
         call compare_signs(law, surer*n_steps, autocovariance, is_wrong)
         law%n_steps = n_steps
         if (.not. law%found%is_converged) return
         is_wrong(law%zeros + 1) = .false.
         pulls = pulls_of(law)
         law%found%is_converged = .not. any(is_wrong .and. is_barred)
         if (.not. law%found%is_converged) return
         if (.not. (any(is_wrong) .or. any(abs(pulls) > acceptable))) exit
         law%found%is_converged = pass < max_passes
         if (.not. law%found%is_converged) return
         lags = pack(law%zeros, abs(pulls) <= acceptable)
         if (any(is_wrong .and. is_held)) &   ! the others may follow
            lags = [lags, minloc(law%signs*autocovariance, 1, is_wrong .and. is_held) - 1]
         law%signs(law%zeros) = merge(sign(1.0_wp, pulls), law%signs(law%zeros), &
                                      abs(pulls) > acceptable)
         where (is_wrong .and. .not. is_held) law%signs = -law%signs
         is_held = is_held .or. is_wrong
         if (size(lags) > 0) law%n_steps = max(n_steps, zero_steps)
         reached = law%point
         do
            call law%hold_at_zero(lags)
            call law%keep_lags()
            call find_maximum(law)
            if (law%found%is_converged .or. size(lags) < 2 .or. law%family%kind == by_symbol) exit
            lags = lags(size(lags):)   ! the newest alone
            law%point = reached
         end do
         if (.not. law%found%is_converged) return
      end do
   end subroutine adopt_signs

   !> Compares the signs by which lengths are summed with those of K(m) on many values; not
   !> converged where these have no process.
   subroutine compare_signs(law, n_steps, autocovariance, is_wrong)
      type(sampled_objective), intent(inout) :: law
      integer, intent(in) :: n_steps    !! of a batch
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags)
      logical, allocatable, intent(out) :: is_wrong(:)          !! (0:n_lags)
      real(wp), parameter :: unclear = 0.5_wp*clear
      real(wp), allocatable :: standard_error(:), state(:)

      call law%keep_lags(law%problem%n_lags)
      law%n_steps = n_steps
      call law%evaluate(law%point, state, law%found%is_converged)
      if (.not. law%found%is_converged) return
      call estimate_autocovariance(law%last%batches, law%known, law%problem%n_lags, &
                                   autocovariance, standard_error)
      is_wrong = law%signs*autocovariance < -max(3.0_wp*standard_error, unclear*autocovariance(0))
   end subroutine compare_signs

   !> Gain of entropy as a K(m)/K(0) that is held at 0 grows to an allowed side, with the sign of
   !> that side; 0: none. With w the gain by the targets as |K(m)|/K(0) grows, and T that by
   !> K(m)/K(0) and the targets together, it is s T - w on the side of s. By the direct method
   !> T/w is s_m.
   function pulls_of(law) result(pulls)
      type(sampled_objective), intent(in) :: law
      real(wp) :: pulls(size(law%zeros))
      real(wp) :: lengths(2), total, weight
      integer :: i, m, n_targets

      if (law%family%kind == by_symbol) then
         associate (s => law%point(2:size(pulls) + 1))
            pulls = merge(s, 0.0_wp, abs(s) > 1.0_wp)
         end associate
         return
      end if
      n_targets = law%n_constraints - size(law%zeros)
      associate (moments => law%last%moments, request => law%problem%request, &
                 multipliers => law%found%multipliers)   ! of ratio, length or lengths, zeros
         lengths = 0.0_wp   ! multipliers of L0 and L1
         lengths(merge(2, 1, request%correlation == 'L1')) = &
            multipliers(2)/request%correlation_length
         if (n_targets == 3) lengths(2) = multipliers(3)/request%second_length
         do i = 1, size(pulls)
            m = law%zeros(i)
            weight = lengths(1) + lengths(2)*(m - moments%l1)/(1.0_wp + moments%l0)
            total = law%signs(m)*weight + multipliers(n_targets + i)
            pulls(i) = max(total - weight, 0.0_wp)
            if (-total - weight > pulls(i) .and. request%branch /= 'nonnegative') &
               pulls(i) = total + weight
         end do
      end associate
   end function pulls_of

   !> Finds the maximum on more simulated values than before, with the signs that K(m) have there;
   !> where none is found the law stays.
   subroutine sharpen(law, is_sharper)
      type(sampled_objective), intent(inout) :: law
      logical, intent(out) :: is_sharper
      integer, parameter :: sharp_steps = 2048      ! of a batch
      real(wp), parameter :: allowance = 2.0e9_wp   ! see `most_effort`
      type(sampled_objective) :: before

      before = law
      law%most_effort = law%effort + allowance
      law%n_steps = sharp_steps
      call law%keep_lags()
      call law%settle()
      call find_maximum(law)
      if (law%found%is_converged) call adopt_signs(law)
      law%most_effort = before%most_effort
      is_sharper = law%found%is_converged
      if (.not. is_sharper) law = before
   end subroutine sharpen

   !> True if hardly anything is left of K(m) in the last fifth of the lags, or no more than noise.
   function fades(law) result(is_so)
      type(sampled_objective), intent(in) :: law   !! evaluated with averages of every lag
      logical :: is_so
      real(wp), parameter :: little = 5.0e-3_wp, standard_errors = 3.0_wp
      real(wp), allocatable :: k(:), rests(:, :), unused(:)
      integer :: first

      associate (n => law%problem%n_lags, batches => law%last%batches)
         allocate (rests(size(batches%x, 2), 0:n))
         call estimate_autocovariance(batches, law%known, n, k, unused, rests)
         k = law%signs*k
         first = n + 1 - n/5
         is_so = abs(sum(k(first:))) <= max(little*sum(k(2:)), standard_errors/size(rests, 1) &
                                            *norm2(matmul(rests(:, first:), law%signs(first:))))
      end associate
   end function fades

   !> True if no K(m) up to the order has clearly another sign at the last evaluation.
   pure logical function has_wanted_signs(law)
      type(sampled_objective), intent(in) :: law
      real(wp), allocatable :: autocovariance(:), standard_error(:)
      type(error_type), allocatable :: error

      call estimate_autocovariance(law%last%batches, law%known, ubound(law%last%g, 1), &
                                   autocovariance, standard_error)
      call require_signs(law, autocovariance, standard_error, error)
      has_wanted_signs = .not. allocated(error)
   end function has_wanted_signs

   !> Fails where a K(m) clearly has another sign: by 5 standard errors and a thousandth of K(0).
   pure subroutine require_signs(law, autocovariance, standard_error, error)
      type(sampled_objective), intent(in) :: law
      real(wp), intent(in) :: autocovariance(0:)    !! K(m), to any lag, with its standard errors
      real(wp), intent(in) :: standard_error(0:)
      type(error_type), allocatable, intent(out) :: error
      integer :: m

      do m = 1, ubound(autocovariance, 1)
         if (law%signs(m)*autocovariance(m) >= &
             -max(5.0_wp*standard_error(m), clear*autocovariance(0))) cycle
         call raise(error, exit_no_solution, law%problem%name// &
                    ': the search ended where K('//to_text(m)//') has changed its sign')
         return
      end do
   end subroutine require_signs

end module process_positive_signs
