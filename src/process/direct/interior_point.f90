!> Which lags are held at K(m) = 0, for one sequence of signs (Sec. 2.2).
!>
!> Lags with a_m > 0 have -delta <= x_m <= delta, and K(m) = 0 where x_m is inside. A primal-dual
!> interior-point method on D of `process_direct_climb` moves all of them at once.
module process_direct_interior_point
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: solve_positive_definite
   use process_direct_climb, only: begin_climb, climb_state, evaluate_climb, steepest, &
      weak_multiplier
   use process_direct_constraint, only: length_constraint
   use process_direct_reciprocal_symbol, only: reciprocal_workspace
   implicit none(type, external)
   private
   public :: hold_at_zero

   integer, parameter :: max_steps = 200
   integer, parameter :: max_halvings = 50

contains

   !> Finds which penalized lags have K(m) = 0, with s_m and delta to start from, by an
   !> interior-point method that moves all of them at once.
   subroutine hold_at_zero(constraint, s, is_free, delta, workspace)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(inout) :: s(:)          !! (m_max) found where penalized
      logical, intent(out) :: is_free(:)       !! (m_max) K(m) = 0
      real(wp), intent(out) :: delta           !! 0: no solution
      type(reciprocal_workspace), intent(inout) :: workspace
      real(wp), parameter :: closing = 0.1_wp, final_gap = 1.0e-10_wp
      type(climb_state) :: state
      ! slacks delta -+ x_m and their multipliers
      real(wp), allocatable :: upper(:), lower(:), p(:), q(:)
      real(wp) :: mu
      logical :: is_moving
      integer :: iteration

      is_free = .false.
      is_free(constraint%penalized) = .true.
      call begin_climb(constraint, s, is_free, state)
      delta = 0.0_wp
      state%x(0) = min(weak_multiplier(state%along), 0.5_wp/sum(abs(constraint%weights)))
      state%x(1:) = state%x(0)*state%s
      call evaluate_climb(constraint, workspace, state)
      mu = closing*state%x(0)*constraint%weights(0)/size(state%free)
      allocate (p(size(state%free)), source=mu/state%x(0))
      q = p
      do iteration = 1, max_steps
         if (.not. state%value%is_positive .or. state%x(0)*constraint%weights(0) > steepest) return
         if (is_hopeless(constraint, state%x, workspace)) return
         upper = state%x(0) - state%x(state%free)
         lower = state%x(0) + state%x(state%free)
         mu = closing*(dot_product(p, upper) + dot_product(q, lower))/(2*size(p))
         if (mu*size(p) < final_gap .and. &
             abs(state%value%gradient(0) + sum(p + q))*state%x(0) < 1.0e-6_wp) exit
         call take_interior_step(constraint, workspace, mu, upper, lower, p, q, state, is_moving)
         if (.not. is_moving) exit
      end do
      if (mu*size(p) > 1.0e-5_wp) return   ! not even near a solution
      delta = state%x(0)
      s(state%free) = state%x(state%free)/delta
      is_free(state%free) = 1.0_wp - abs(s(state%free)) > &
                            abs(state%value%reciprocal(state%free))/state%value%reciprocal(0)
      where (.not. is_free) s = sign(1.0_wp, s)
   end subroutine hold_at_zero

   !> True if g stays positive however far x is followed: then D has no maximum.
   function is_hopeless(constraint, x, workspace)
      type(length_constraint), intent(in) :: constraint
      real(wp), intent(in) :: x(0:)
      type(reciprocal_workspace), intent(inout) :: workspace
      logical :: is_hopeless
      real(wp), allocatable :: values(:)

      is_hopeless = .false.
      if (x(0)*constraint%weights(0) < 10.0_wp) return   ! it shows later than that
      call workspace%values_on_circle([constraint%weights(0)*x(0), &
                                       0.5_wp*constraint%weights(1:)*x(1:)], values)
      is_hopeless = minval(values) >= 0.0_wp
   end function is_hopeless

   !> Takes a primal-dual step on D + mu sum ln(upper lower), halved until that rises; `is_moving`
   !> is false where it never does.
   subroutine take_interior_step(constraint, workspace, mu, upper, lower, p, q, state, is_moving)
      type(length_constraint), intent(in) :: constraint
      type(reciprocal_workspace), intent(inout) :: workspace
      real(wp), intent(in) :: mu, upper(:), lower(:)
      real(wp), intent(inout) :: p(:), q(:)
      type(climb_state), intent(inout) :: state
      logical, intent(out) :: is_moving
      real(wp), parameter :: keep = 0.01_wp   ! share of a slack that stays at least
      type(error_type), allocatable :: error
      real(wp) :: gradient(0:size(p)), curvature(0:size(p), 0:size(p))
      real(wp) :: start(0:constraint%m_max), direction(0:constraint%m_max)
      real(wp) :: upper_step(size(p)), lower_step(size(p)), p_step(size(p)), q_step(size(p))
      real(wp) :: height, length, rise
      real(wp) :: step(0:size(p), 1)
      integer :: i

      gradient = state%value%gradient
      gradient(0) = gradient(0) + sum(mu/upper + mu/lower)
      gradient(1:) = gradient(1:) - mu/upper + mu/lower
      curvature = state%value%curvature
      curvature(0, 0) = curvature(0, 0) + sum(p/upper + q/lower)
      curvature(1:, 0) = curvature(1:, 0) - p/upper + q/lower
      curvature(0, 1:) = curvature(1:, 0)
      do i = 1, size(p)
         curvature(i, i) = curvature(i, i) + p(i)/upper(i) + q(i)/lower(i)
      end do
      step(:, 1) = gradient
      call solve_positive_definite(curvature, step, error)
      is_moving = .not. allocated(error)
      if (.not. is_moving) return
      rise = dot_product(step(:, 1), gradient)
      direction = step(0, 1)*[1.0_wp, state%s]
      direction(state%free) = step(1:, 1)
      upper_step = step(0, 1) - step(1:, 1)
      lower_step = step(0, 1) + step(1:, 1)
      p_step = (mu - p*upper_step)/upper - p
      q_step = (mu - q*lower_step)/lower - q
      height = state%value%log_mean + mu*sum(log(upper) + log(lower))
      start = state%x
      length = min(1.0_wp, (1.0_wp - keep)/max(tiny(1.0_wp), maxval(-upper_step/upper), &
                                               maxval(-lower_step/lower)))
      do i = 0, max_halvings
         state%x = start + length*direction
         call evaluate_climb(constraint, workspace, state)
         if (state%value%is_positive) then
            is_moving = state%value%log_mean + mu*sum(log(state%x(0) - state%x(state%free)) + &
                                                      log(state%x(0) + state%x(state%free))) &
                        >= height + 1.0e-4_wp*length*rise - 1.0e-13_wp*(1.0_wp + abs(height))
            if (is_moving) exit
         end if
         is_moving = .false.
         length = 0.5_wp*length
      end do
      length = min(1.0_wp, (1.0_wp - keep)/max(tiny(1.0_wp), maxval(-p_step/p), maxval(-q_step/q)))
      p = p + length*p_step
      q = q + length*q_step
   end subroutine take_interior_step

end module process_direct_interior_point
