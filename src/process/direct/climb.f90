!> The concave function of the multipliers whose maximum is the maximum of the entropy (Sec. 2.2).
!>
!> With g(t) = 1 + sum a_m x_m cos(mt), x_0 = delta, x_m = delta s_m, it is D, the mean of ln g. Its
!> derivatives are a_m K(m), K(m) the Fourier coefficients of 1/g, where x_m moves by itself, and
!> the left side of Eq. (11) along delta.
module process_direct_climb
   use core_kinds, only: two_pi, wp
   use process_direct_constraint, only: length_constraint
   use process_direct_reciprocal_symbol, only: evaluate_symbol, symbol_evaluation
   implicit none(type, external)
   private
   public :: climb_state, begin_climb, evaluate_climb, steepest, touching_multiplier, &
             weak_multiplier

   !> One concave maximization: which x_m move, and where they are.
   type :: climb_state
      integer, allocatable :: free(:)       !! lags whose x_m moves by itself
      real(wp), allocatable :: s(:)         !! (m_max) x_m = delta s_m of the others; 0 where free
      real(wp), allocatable :: along(:)     !! the symbol that grows with delta, (0:m_max)
      real(wp), allocatable :: x(:)         !! (0:m_max)
      type(symbol_evaluation) :: value
      real(wp), allocatable :: scale(:)     !! 1 of delta, then a_m of the free lags
   end type climb_state

   !> delta a_0 beyond this: no solution, or none that doubles can hold
   real(wp), parameter :: steepest = 1.0e10_wp

contains

   !> Prepares a maximization with given signs s and free lags; its x is still 0.
   subroutine begin_climb(constraint, s, is_free, state)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: s(:)
      logical, intent(in) :: is_free(:)
      type(climb_state), intent(out) :: state
      integer :: m

      ! not by =, which would read bounds that these do not have yet
      allocate (state%free, source=pack([(m, m=1, constraint%m_max)], is_free))
      allocate (state%s, source=merge(0.0_wp, s, is_free))
      allocate (state%scale, source=[1.0_wp, constraint%weights(state%free)])
      allocate (state%along(0:constraint%m_max), state%x(0:constraint%m_max), source=0.0_wp)
      state%along(0) = constraint%weights(0)
      state%along(1:) = 0.5_wp*constraint%weights(1:)*state%s
   end subroutine begin_climb

   !> Evaluates D at state%x, with its derivatives in delta and in the free x_m.
   pure subroutine evaluate_climb(constraint, state)
      type(length_constraint), intent(in) :: constraint
      type(climb_state), intent(inout) :: state
      real(wp) :: symbol(0:constraint%m_max)

      symbol(0) = 1.0_wp + constraint%weights(0)*state%x(0)
      symbol(1:) = 0.5_wp*constraint%weights(1:)*state%x(1:)
      call evaluate_symbol(symbol, state%along, state%free, state%value)
      if (.not. state%value%is_positive) return
      associate (value => state%value, n => size(state%scale))
         value%gradient(:) = state%scale*value%gradient
         value%curvature(:, :) = spread(state%scale, 2, n)*spread(state%scale, 1, n)*value%curvature
      end associate
   end subroutine evaluate_climb

   !> delta in the limit of weak correlation.
   pure function weak_multiplier(along) result(delta)
      real(wp), intent(in) :: along(0:)
      real(wp) :: delta

      delta = along(0)/(along(0)**2 + 2.0_wp*sum(along(1:)**2))
   end function weak_multiplier

   !> delta at which 1 + delta A(t) first touches zero; huge when A is nowhere negative.
   pure function touching_multiplier(along) result(delta)
      real(wp), intent(in) :: along(0:)   !! symbol of A
      real(wp) :: delta
      real(wp) :: bend, lowest, t
      integer :: j, m, n, step

      n = max(64, 8*ubound(along, 1))   ! points on the circle, of which the lowest is refined
      t = two_pi/n*(minloc([(rough_value(along, two_pi*j/n), j=0, n/2)], dim=1) - 1)
      lowest = huge(1.0_wp)
      do step = 1, 5
         lowest = min(lowest, along(0) + 2.0_wp*sum([(along(m)*cos(m*t), m=1, ubound(along, 1))]))
         bend = sum([(m**2*along(m)*cos(m*t), m=1, ubound(along, 1))])
         if (.not. abs(bend) > 0.0_wp) exit
         t = t - sum([(m*along(m)*sin(m*t), m=1, ubound(along, 1))])/bend
      end do
      delta = huge(1.0_wp)
      if (lowest < -1.0e-13_wp*sum(abs(along))) delta = -1.0_wp/lowest
   end function touching_multiplier

   !> A(t) = A_0 + 2 sum A_m cos(mt), by Clenshaw's recurrence: fast, with the rounding of its sums.
   pure real(wp) function rough_value(along, t) result(value)
      real(wp), intent(in) :: along(0:), t
      real(wp) :: b(0:2)
      integer :: m

      b = 0.0_wp
      do m = ubound(along, 1), 1, -1
         b(1:2) = b(0:1)
         b(0) = 2.0_wp*(along(m) + cos(t)*b(1)) - b(2)
      end do
      value = along(0) + cos(t)*b(0) - b(1)
   end function rough_value

end module process_direct_climb
