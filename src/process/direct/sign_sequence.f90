!> Maximum of the entropy for one sequence of signs (Sec. 2.2), for sigma_X = 1.
!>
!> With g(t) = 1 + sum a_m x_m cos(mt), x_0 = delta and x_m = delta s_m, let K(m) be the Fourier
!> coefficients of 1/g and D the mean of ln g, which is concave. Eq. (11) is the condition of the
!> maximum of D along delta: so a sequence has at most one solution, and 0.5 (1 + ln 2 pi - D) is an
!> upper bound of the entropy for every x. If g stays positive for every delta, there is none.
!>
!> At lags with a_m > 0 (m < L1) the maximum may have K(m) = 0. Then x_m is an unknown of its own,
!> -delta <= x_m <= delta, and the lag is free. An active-set method finds the free lags: at first
!> all are free; those whose x_m leaves the interval are fixed, and become free again if their K(m)
!> has the wrong sign.
module process_direct_sign_sequence
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use numerics_lapack, only: solve_linear_system
   use process_direct_constraint, only: length_constraint
   use process_direct_reciprocal_symbol, only: evaluate_symbol, symbol_evaluation, &
                                               touching_multiplier
   use process_direct_touching_symbol, only: solve_touching
   use process_model, only: gaussian_entropy
   implicit none(type, external)
   private
   public :: sequence_solution, solve_sequence

   !> Solution for given signs of the rewarded lags; K(0) = 1.
   type :: sequence_solution
      logical :: is_feasible = .false.         !! else the rest is undefined
      logical :: is_consistent = .false.       !! all K(m) have the signs s_m
      real(wp), allocatable :: s(:)            !! s_m, m = 1..m_max; inside (-1, 1) where K(m) = 0
      real(wp) :: delta = 0.0_wp               !! lambda_2/lambda_3
      real(wp) :: lambda_3 = 0.0_wp            !! 0.5 at every solution
      real(wp), allocatable :: correlation(:)  !! K(m)/K(0), m = 0..m_max
      real(wp) :: entropy = 0.0_wp             !! per point [nat]
      integer(long) :: number = 0              !! number of the sequence in a search
      real(wp), allocatable :: a(:)            !! a_q, q = 1..m_max, of Eq. (39)
   end type sequence_solution

   !> State of a maximization of D. Its derivatives are a_m K(m) along the x_m of a free lag, and
   !> the left side of Eq. (11) along delta.
   type :: maximization
      integer, allocatable :: free(:)            !! free lags
      real(wp), allocatable :: s(:)              !! (m_max) s_m of fixed lags; 0 of free ones
      !> (0:m_max, 0:n_free) derivatives of the symbol by delta and by the x_m of free lags
      real(wp), allocatable :: directions(:, :)
      real(wp), allocatable :: x(:)              !! (0:n_free) delta, then x_m of free lags
      type(symbol_evaluation) :: value
   end type maximization

   !> upper limit of delta a_0: beyond it double precision has no solution
   real(wp), parameter :: largest_growth = 1.0e10_wp
   real(wp), parameter :: sign_rounding = 1.0e-12_wp   !! rounding of K(m)/K(0)
   !> an |s_m| above the second one is outside once the decrement is below the first one
   real(wp), parameter :: small_decrement = 1.0e-3_wp, largest_s = 1.1_wp
   real(wp), parameter :: final_decrement = 1.0e-9_wp   !! D is nearly quadratic below it
   integer, parameter :: max_steps = 200
   integer, parameter :: max_halvings = 50

contains

   !> Finds the maximum for given signs of the rewarded lags.
   subroutine solve_sequence(constraint, signs, solution)
      type(length_constraint), intent(in) :: constraint
      integer, intent(in) :: signs(:)   !! +1 or -1, one per rewarded lag
      type(sequence_solution), intent(out) :: solution
      integer, parameter :: max_passes = 20
      logical :: is_free(constraint%m_max), was_free(constraint%m_max)
      real(wp) :: delta, s(constraint%m_max)
      integer :: pass

      delta = 0.0_wp
      s = 1.0_wp   ! the sign has no effect where a_m = 0
      s(constraint%rewarded) = signs
      is_free = .false.
      is_free(constraint%penalized) = any(signs < 0)   ! not for all +, whose K(m) > 0
      do pass = 1, max_passes
         call solve_active_set(constraint, is_free, s, delta, solution)
         if (pass == 1 .and. all(signs > 0)) call solve_near_touching(constraint, solution)
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

   !> Solves for delta and the x_m of free lags by Newton's method, with the other signs given. Ends
   !> without a solution if an x_m is clearly outside its interval.
   subroutine solve_active_set(constraint, is_free, s, delta, solution)
      type(length_constraint), intent(in) :: constraint
      logical, intent(in) :: is_free(:)      !! (m_max) free lags
      real(wp), intent(inout) :: s(:)        !! (m_max) of free lags also without a solution
      real(wp), intent(inout) :: delta       !! start, with s; on return the last one; 0: none
      type(sequence_solution), intent(out) :: solution
      type(maximization) :: state
      real(wp) :: decrement, last_decrement, limit, first_delta
      real(wp), allocatable :: step(:)
      integer :: iteration
      logical :: is_done, has_risen

      call start_maximization(constraint, s, is_free, state)
      limit = huge(1.0_wp)
      associate (symbol => state%directions(:, 0))
         ! solution for weak correlation
         first_delta = symbol(1)/(symbol(1)**2 + 2.0_wp*sum(symbol(2:)**2))
      end associate
      if (size(state%free) == 0) then
         limit = touching_multiplier(state%directions(:, 0))
         if (.not. limit < largest_growth/constraint%weights(0)) return
         first_delta = min(first_delta, 0.75_wp*limit)
      else
         first_delta = min(first_delta, 0.5_wp/sum(abs(constraint%weights)))
      end if
      if (delta > 0.0_wp) then
         state%x(:) = delta*[1.0_wp, s(state%free)]
         call evaluate(state)
      end if
      delta = 0.0_wp
      if (.not. state%value%is_positive) then
         state%x(0) = first_delta
         state%x(1:) = 0.0_wp
         call evaluate(state)
      end if
      last_decrement = huge(1.0_wp)
      do iteration = 1, max_steps
         s(state%free) = state%x(1:)/state%x(0)
         if (.not. state%value%is_positive) return
         if (has_no_maximum(constraint, state)) return
         call find_step(state, limit, step, decrement)
         if (decrement <= small_decrement .and. any(abs(s(state%free)) > largest_s)) then
            delta = state%x(0)
            return
         end if
         is_done = abs(decrement) <= final_decrement .and. &   ! D is quadratic to rounding
                   (decrement <= 1.0e-22_wp .or. decrement > 0.25_wp*last_decrement)
         last_decrement = decrement
         call move(step, decrement, state, has_risen)
         if (.not. has_risen) return
         if (is_done) exit
      end do
      s(state%free) = state%x(1:)/state%x(0)
      delta = state%x(0)
      if (is_done) call describe(constraint, state, solution)
   end subroutine solve_active_set

   !> Starts a maximization with given signs s and free lags, at x = 0.
   subroutine start_maximization(constraint, s, is_free, state)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: s(:)
      logical, intent(in) :: is_free(:)
      type(maximization), intent(out) :: state
      integer :: i, m, n

      ! not by assignment, which would read bounds that are not defined yet
      allocate (state%free, source=pack([(m, m=1, constraint%m_max)], is_free))
      allocate (state%s, source=merge(0.0_wp, s, is_free))
      n = size(state%free)
      allocate (state%directions(0:constraint%m_max, 0:n), state%x(0:n), source=0.0_wp)
      state%directions(:, 0) = constraint%weights*[1.0_wp, 0.5_wp*state%s]
      do i = 1, n
         state%directions(state%free(i), i) = 0.5_wp*constraint%weights(state%free(i))
      end do
   end subroutine start_maximization

   !> Evaluates D and its derivatives at x.
   pure subroutine evaluate(state)
      type(maximization), intent(inout) :: state

      associate (symbol => matmul(state%directions, state%x))
         call evaluate_symbol([1.0_wp + symbol(1), symbol(2:)], state%directions, state%value)
      end associate
   end subroutine evaluate

   !> True if g stays positive along x to any distance, with free lags: then D has no maximum.
   pure logical function has_no_maximum(constraint, state)
      type(length_constraint), intent(in) :: constraint
      type(maximization), intent(in) :: state

      associate (growth => constraint%weights(0)*state%x(0))
         has_no_maximum = size(state%free) > 0 .and. growth > 10.0_wp   ! not before
         if (has_no_maximum) &
            has_no_maximum = .not. touching_multiplier(matmul(state%directions, state%x)) &
                             < largest_growth/growth
      end associate
   end function has_no_maximum

   !> Solves for all signs + by `solve_touching` if g(0) is too small for the accuracy of g_0.
   subroutine solve_near_touching(constraint, solution)
      type(length_constraint), intent(in) :: constraint
      type(sequence_solution), intent(inout) :: solution
      real(wp), parameter :: least_share = 1.0e-4_wp
      real(wp) :: delta, factor(0:constraint%m_max), k(0:constraint%m_max)
      logical :: is_solved

      associate (weights => constraint%weights, touch => sum(constraint%weights))
         if (.not. touch < 0.0_wp) return
         if (solution%is_feasible .and. 1.0_wp + solution%delta*touch > &
             least_share*(1.0_wp + solution%delta*weights(0))) return
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
   end subroutine solve_near_touching

   !> Finds Newton's step and its decrement, twice the expected increase of D.
   subroutine find_step(state, limit, step, decrement)
      type(maximization), intent(in) :: state
      real(wp), intent(in) :: limit   !! upper limit of delta without free lags
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
      if (.not. (limit < huge(1.0_wp) .and. state%x(0) < limit)) return
      if (.not. decrement > final_decrement) return
      ! D' (1 + a_0 delta) is nearly linear in y = (1 - delta/limit)**(-1/2) up to the limit; steps
      ! in delta alone take two to three times as long at m_max = 1000
      y = 1.0_wp/sqrt(1.0_wp - state%x(0)/limit)
      rate = state%directions(0, 0)   ! a_0
      growth = 1.0_wp + rate*state%x(0)
      slope = (state%value%curvature(0, 0)*growth - rate*state%value%gradient(0))*2.0_wp*limit/y**3
      if (.not. slope > 0.0_wp) return
      y = max(y + state%value%gradient(0)*growth/slope, 0.5_wp*(1.0_wp + y))
      step = limit*(1.0_wp - 1.0_wp/y**2) - state%x(0)
   end subroutine find_step

   !> Moves along the step, which is halved until D rises enough and, if it has left the region of
   !> g > 0, once more: steps along its edge would be short. `has_risen` is false if D does not
   !> rise.
   subroutine move(step, decrement, state, has_risen)
      real(wp), intent(in) :: step(:)
      real(wp), intent(in) :: decrement
      type(maximization), intent(inout) :: state
      logical, intent(out) :: has_risen
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
            call evaluate(state)
            is_outside = .not. state%value%is_positive
         end if
         has_risen = .not. is_outside
         if (has_risen) has_risen = state%value%log_mean >= height + 1.0e-4_wp*length*decrement &
                                    .or. decrement <= final_decrement
         if (has_risen .and. .not. was_outside) return
         length = 0.5_wp*length
      end do
   end subroutine move

   pure subroutine describe(constraint, state, solution)
      type(length_constraint), intent(in) :: constraint
      type(maximization), intent(in) :: state
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
