!> The maximum of the entropy for one sequence of signs (Sec. 2.2), for sigma_X = 1.
!>
!> With g(t) = 1 + sum a_m x_m cos(mt), x_0 = delta, x_m = delta s_m, let K(m) be the Fourier
!> coefficients of 1/g and D the mean of ln g. Eq. (11) says that D, which is concave, has its
!> maximum along delta: a sequence has at most one solution, and 0.5 (1 + ln 2 pi - D) is an upper
!> bound of the entropy for every x. Lags with a_m > 0 (m < L1) push K(m) towards zero and can hold
!> it there: x_m is then an unknown of its own, -delta <= x_m <= delta. Which lags are held is found
!> by holding all of them at first, then no longer those whose x_m leaves that interval, and again
!> those whose K(m) then has the other sign. There is no solution where g stays positive for every
!> delta.
module process_direct_sign_sequence
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use numerics_lapack, only: solve_linear_system
   use process_direct_constraint, only: length_constraint
   use process_direct_reciprocal_symbol, only: evaluate_symbol, symbol_evaluation, &
      touching_multiplier
   use process_direct_touching_symbol, only: solve_touching
   use process_entropy, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: sequence_solution, solve_sequence

   !> The largest entropy for given signs of the rewarded lags; K(0) = 1.
   type :: sequence_solution
      logical :: is_feasible = .false.         !! all else holds only then
      logical :: is_consistent = .false.       !! K(m) has the sign s_m
      real(wp), allocatable :: s(:)            !! s_m, m = 1..m_max; inside (-1, 1) where K(m) = 0
      real(wp) :: delta = 0.0_wp               !! lambda_2/lambda_3
      real(wp) :: lambda_3 = 0.0_wp            !! 0.5 at every solution
      real(wp), allocatable :: correlation(:)  !! K(m)/K(0), m = 0..m_max
      real(wp) :: entropy = 0.0_wp             !! per point [nat]
      integer(long) :: number = 0              !! among the sequences of a search
      real(wp), allocatable :: a(:)            !! a_q, q = 1..m_max, of Eq. (39)
   end type sequence_solution

   !> One concave maximization of D: which x_m move by themselves, and where they are. Derivatives
   !> of D are a_m K(m) along such an x_m, and the left side of Eq. (11) along delta.
   type :: climb_state
      integer, allocatable :: free(:)            !! lags whose x_m moves by itself
      real(wp), allocatable :: s(:)              !! (m_max) x_m = delta s_m of the others; else 0
      !> (0:m_max, 0:n_free) symbols that grow with delta and with these x_m
      real(wp), allocatable :: directions(:, :)
      real(wp), allocatable :: x(:)              !! (0:n_free) delta, then these x_m
      type(symbol_evaluation) :: value
   end type climb_state

   !> delta a_0 beyond this: no solution, or none that doubles can hold
   real(wp), parameter :: steepest = 1.0e10_wp
   real(wp), parameter :: sign_rounding = 1.0e-12_wp   !! of K(m)/K(0)
   real(wp), parameter :: near = 1.0e-3_wp, beyond = 1.1_wp   !! decrement, |s_m|: outside for sure
   real(wp), parameter :: end_game = 1.0e-9_wp         !! Newton's decrement: D is nearly quadratic
   integer, parameter :: max_steps = 200
   integer, parameter :: max_halvings = 50

contains

   !> Solves for given signs of the rewarded lags.
   subroutine solve_sequence(constraint, signs, solution)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: signs(:)   !! +1 or -1, one per rewarded lag
      type(sequence_solution), intent(out) :: solution
      integer, parameter :: max_passes = 20
      logical :: is_free(constraint%m_max), was_free(constraint%m_max)
      real(wp) :: delta, s(constraint%m_max)
      integer :: pass

      delta = 0.0_wp
      s = 1.0_wp   ! also where a_m = 0, and the sign does not matter
      s(constraint%rewarded) = signs
      is_free = .false.
      is_free(constraint%penalized) = any(signs < 0)   ! all plus holds none, far from the limits
      do pass = 1, max_passes
         call solve_active_set(constraint, is_free, s, delta, solution)
         if (pass == 1 .and. all(signs > 0)) call approach_touch(constraint, solution)
         was_free = is_free
         is_free = is_free .and. abs(s) <= 1.0_wp
         if (solution%is_feasible) then
            associate (low => constraint%penalized)
               is_free(low) = is_free(low) .or. &
                              .not. was_free(low) .and. &
                                 s(low)*solution%correlation(low) < -sign_rounding
            end associate
         end if
         if (all(is_free .eqv. was_free)) return
         where (.not. is_free) s = sign(1.0_wp, s)
      end do
      solution%is_feasible = .false.
   end subroutine solve_sequence

   !> Solves for delta and for x_m of the free lags by Newton's method, the other signs given. Ends
   !> without a solution where x_m surely leave their interval.
   subroutine solve_active_set(constraint, is_free, s, delta, solution)
      type(length_constraint), intent(in) :: constraint
      logical, intent(in) :: is_free(:)      !! (m_max) K(m) = 0 is wanted there
      real(wp), intent(inout) :: s(:)        !! (m_max) found where free, also without a solution
      real(wp), intent(inout) :: delta       !! with s a start, then where it ended; 0: none
      type(sequence_solution), intent(out) :: solution
      type(climb_state) :: state
      real(wp) :: decrement, last_decrement, limit, start
      real(wp), allocatable :: step(:)
      integer :: iteration
      logical :: is_done, is_higher

      call begin_climb(constraint, s, is_free, state)
      limit = huge(1.0_wp)
      associate (along => state%directions(:, 0))
         ! in the limit of weak correlation
         start = along(1)/(along(1)**2 + 2.0_wp*sum(along(2:)**2))
      end associate
      if (size(state%free) == 0) then
         limit = touching_multiplier(state%directions(:, 0))
         if (.not. limit < steepest/constraint%weights(0)) return
         start = min(start, 0.75_wp*limit)
      else
         start = min(start, 0.5_wp/sum(abs(constraint%weights)))
      end if
      if (delta > 0.0_wp) then
         state%x(:) = delta*[1.0_wp, s(state%free)]
         call evaluate_climb(state)
      end if
      delta = 0.0_wp
      if (.not. state%value%is_positive) then
         state%x(0) = start
         state%x(1:) = 0.0_wp
         call evaluate_climb(state)
      end if
      last_decrement = huge(1.0_wp)
      do iteration = 1, max_steps
         s(state%free) = state%x(1:)/state%x(0)
         if (.not. state%value%is_positive) return
         if (is_hopeless(constraint, state)) return
         call find_step(state, limit, step, decrement)
         if (decrement <= near .and. any(abs(s(state%free)) > beyond)) then
            delta = state%x(0)
            return
         end if
         is_done = abs(decrement) <= end_game .and. &   ! rounding is left, or not even that
                   (decrement <= 1.0e-22_wp .or. decrement > 0.25_wp*last_decrement)
         last_decrement = decrement
         call take_step(step, decrement, state, is_higher)
         if (.not. is_higher) return
         if (is_done) exit
      end do
      s(state%free) = state%x(1:)/state%x(0)
      delta = state%x(0)
      if (is_done) call describe(constraint, state, solution)
   end subroutine solve_active_set

   !> Prepares a maximization with given signs s and free lags; its x is still 0.
   subroutine begin_climb(constraint, s, is_free, state)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: s(:)
      logical, intent(in) :: is_free(:)
      type(climb_state), intent(out) :: state
      integer :: i, m, n

      ! not by =, which would read bounds that these do not have yet
      allocate (state%free, source=pack([(m, m=1, constraint%m_max)], is_free))
      allocate (state%s, source=merge(0.0_wp, s, is_free))
      n = size(state%free)
      allocate (state%directions(0:constraint%m_max, 0:n), state%x(0:n), source=0.0_wp)
      state%directions(:, 0) = constraint%weights*[1.0_wp, 0.5_wp*state%s]
      do i = 1, n
         state%directions(state%free(i), i) = 0.5_wp*constraint%weights(state%free(i))
      end do
   end subroutine begin_climb

   !> Evaluates D at x, with its derivatives.
   pure subroutine evaluate_climb(state)
      type(climb_state), intent(inout) :: state

      associate (along => matmul(state%directions, state%x))
         call evaluate_symbol([1.0_wp + along(1), along(2:)], state%directions, state%value)
      end associate
   end subroutine evaluate_climb

   !> True if g stays positive however far x is followed, with free lags: then D has no maximum.
   pure function is_hopeless(constraint, state)
      type(length_constraint), intent(in) :: constraint
      type(climb_state), intent(in) :: state
      logical :: is_hopeless

      associate (growth => constraint%weights(0)*state%x(0))
         is_hopeless = size(state%free) > 0 .and. growth > 10.0_wp   ! it shows later
         if (is_hopeless) &
            is_hopeless = .not. touching_multiplier(matmul(state%directions, state%x)) &
                          < steepest/growth
      end associate
   end function is_hopeless

   !> Solves all plus once more where g(0) is lost in the rounding of g_0.
   subroutine approach_touch(constraint, solution)
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(inout) :: solution
      real(wp), parameter :: lost = 1.0e-4_wp
      real(wp) :: delta, factor(0:constraint%m_max), k(0:constraint%m_max)
      logical :: is_solved

      associate (weights => constraint%weights, touch => sum(constraint%weights))
         if (.not. touch < 0.0_wp) return
         if (solution%is_feasible .and. 1.0_wp + solution%delta*touch > &
             lost*(1.0_wp + solution%delta*weights(0))) return
         call solve_touching(weights, delta, factor, k, is_solved)
      end associate
      if (.not. (is_solved .and. all(k > 0.0_wp))) return
      if (.not. solution%is_feasible) &
         allocate (solution%s(constraint%m_max), solution%correlation(0:constraint%m_max), &
                   source=1.0_wp)
      solution%is_feasible = .true.
      solution%is_consistent = .true.
      solution%delta = delta
      solution%lambda_3 = 0.5_wp*k(0)
      solution%correlation(:) = k/k(0)
      solution%entropy = gaussian_entropy(1.0_wp) - log(factor(0))
      solution%a = factor(1:)/factor(0)
   end subroutine approach_touch

   !> Finds Newton's step; the decrement is twice the rise of D that it promises.
   subroutine find_step(state, limit, step, decrement)
      type(climb_state), intent(in) :: state
      real(wp), intent(in) :: limit   !! of delta, where nothing but delta moves
      real(wp), allocatable, intent(out) :: step(:)   !! (size(free) + 1)
      real(wp), intent(out) :: decrement
      type(error_type), allocatable :: error
      real(wp) :: growth, rate, slope, y

      if (size(state%free) > 0) then
         call solve_linear_system(state%value%curvature, state%value%gradient, step, error)
         if (allocated(error)) step = 0.0_wp*state%value%gradient
         decrement = dot_product(step, state%value%gradient)
         return
      end if
      step = [state%value%gradient(0)/state%value%curvature(0, 0)]
      decrement = step(1)*state%value%gradient(0)
      if (.not. (limit < huge(1.0_wp) .and. state%x(0) < limit .and. decrement > end_game)) return
      ! D' (1 + a_0 delta) is nearly linear in y = (1 - delta/limit)**(-1/2), all the way to the
      ! limit
      y = 1.0_wp/sqrt(1.0_wp - state%x(0)/limit)
      rate = state%directions(0, 0)   ! a_0
      growth = 1.0_wp + rate*state%x(0)
      slope = (state%value%curvature(0, 0)*growth - rate*state%value%gradient(0))*2.0_wp*limit/y**3
      if (.not. slope > 0.0_wp) return
      y = max(y + state%value%gradient(0)*growth/slope, 0.5_wp*(1.0_wp + y))
      step = limit*(1.0_wp - 1.0_wp/y**2) - state%x(0)
   end subroutine find_step

   !> Goes along the step as far as D rises, and no more than half of the way to where g touches
   !> zero: D is finite there, and steps along that edge are short. Not at all (`is_higher` false)
   !> where D does not rise.
   subroutine take_step(step, decrement, state, is_higher)
      real(wp), intent(in) :: step(:)
      real(wp), intent(in) :: decrement
      type(climb_state), intent(inout) :: state
      logical, intent(out) :: is_higher
      real(wp) :: start(size(step)), height, length
      integer :: i
      logical :: is_outside, was_outside

      start = state%x
      height = state%value%log_mean
      length = 1.0_wp
      is_outside = .false.
      do i = 0, max_halvings
         state%x(:) = start + length*step
         was_outside = is_outside
         is_outside = .not. state%x(0) > 0.0_wp
         if (.not. is_outside) then
            call evaluate_climb(state)
            is_outside = .not. state%value%is_positive
         end if
         is_higher = .not. is_outside
         if (is_higher) is_higher = state%value%log_mean >= height + 1.0e-4_wp*length*decrement &
                                    .or. decrement <= end_game
         if (is_higher .and. .not. was_outside) return
         length = 0.5_wp*length
      end do
   end subroutine take_step

   pure subroutine describe(constraint, state, solution)
      type(length_constraint), intent(in) :: constraint
      type(climb_state), intent(in) :: state
      type(sequence_solution), intent(inout) :: solution

      associate (k => state%value%reciprocal)
         solution%is_feasible = .true.
         solution%delta = state%x(0)
         solution%lambda_3 = 0.5_wp*k(0)
         solution%s = state%s
         solution%s(state%free) = state%x(1:)/state%x(0)
         where (.not. abs(constraint%weights(1:)) > 0.0_wp) solution%s = sign(1.0_wp, k(1:))
         solution%a = state%value%a
         allocate (solution%correlation(0:constraint%m_max))
         solution%correlation(:) = k/k(0)
         solution%entropy = gaussian_entropy(1.0_wp) - 0.5_wp*state%value%log_mean
         associate (lags => constraint%rewarded)
            solution%is_consistent = all(solution%s(lags)*k(lags) >= -sign_rounding*k(0))
         end associate
      end associate
   end subroutine describe

end module process_direct_sign_sequence
