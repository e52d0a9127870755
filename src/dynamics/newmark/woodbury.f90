!> One step of Newmark's scheme for any structure, any beta and gamma.
!>
!> S^-1 = (M + gamma h C + beta h^2 K_s)^-1 is at hand with all joints stuck. Where joints slip,
!> their springs are missing, which is a correction of as low a rank as there are such joints
!> (Woodbury).
module dynamics_newmark_woodbury
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_newmark_block, only: newmark_block
   use dynamics_alignment, only: register_width, whole_registers
   use numerics_lapack, only: solve_positive_definite
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_level, newmark_system, inverse_of, new_newmark_system, try_woodbury

   !> Matrices of one length of step.
   type :: newmark_level
      real(wp) :: share = 1.0_wp                   !! h/dt
      real(wp) :: weight(5) = 0.0_wp               !! of a0, a1 in v1; of v0 (so h), a0, a1 in x1
      real(wp), allocatable :: inverse(:, :)       !! S^-1 (rows, dof)
      integer, allocatable :: span(:, :)           !! (2, dof) rows in which a column of it counts
      real(wp), allocatable :: at_joints(:, :)     !! S^-1 W (rows, joint)
      real(wp), allocatable :: between(:, :)       !! W' S^-1 W (joint, joint)
   end type newmark_level

   !> A structure with all joints stuck, at every level of halving.
   type :: newmark_system
      type(sparse_matrix) :: mass, stiffness       !! M, K_s
      real(wp) :: beta = 0.0_wp, gamma = 0.0_wp
      type(newmark_level), allocatable :: level(:)   !! from 0
   end type newmark_system

contains

   !> Prepares every level.
   subroutine new_newmark_system(structure, weight, beta, gamma, system, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: weight(:, 0:)   !! (5, level) as in newmark_level
      real(wp), intent(in) :: beta, gamma
      type(newmark_system), intent(out) :: system
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), stuck(:, :)
      integer :: j, l, n, rows

      n = structure%n_dof
      rows = whole_registers(n)
      system%beta = beta
      system%gamma = gamma
      stuck = structure%stuck_stiffness([(.true., j=1, structure%n_joints)])
      system%mass = sparse_of(structure%mass)
      system%stiffness = sparse_of(stuck)
      allocate (system%level(0:ubound(weight, 2)))
      do l = 0, ubound(weight, 2)
         associate (level => system%level(l))
            level%share = 0.5_wp**l
            level%weight = weight(:, l)
            call inverse_of(structure, stuck, weight(3, l), beta, gamma, inverse, error)
            if (allocated(error)) return
            allocate (level%inverse(rows, n), level%at_joints(rows, structure%n_joints), &
                      source=0.0_wp)
            level%inverse(:n, :) = inverse
            level%span = span_of(inverse)
            level%at_joints(:n, :) = matmul(inverse, structure%direction)
            level%between = matmul(transpose(structure%direction), level%at_joints(:n, :))
         end associate
      end do
   end subroutine new_newmark_system

   !> S^-1 for one stiffness and length of step.
   subroutine inverse_of(structure, stiffness, h, beta, gamma, inverse, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: stiffness(:, :)   !! (dof, dof)
      real(wp), intent(in) :: h, beta, gamma
      real(wp), allocatable, intent(out) :: inverse(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: s(:, :)
      integer :: i

      s = structure%mass + gamma*h*structure%damping + beta*h**2*stiffness
      allocate (inverse(size(s, 1), size(s, 1)), source=0.0_wp)
      do i = 1, size(s, 1)
         inverse(i, i) = 1.0_wp
      end do
      call solve_positive_definite(s, inverse, error)
   end subroutine inverse_of

   !> From the first to the last row, in whole registers, in which a column of S^-1 counts, or one
   !> of the four that are taken together; what is left out changes no product beyond rounding,
   !> measured by the energy that S stands for.
   pure function span_of(inverse) result(span)
      real(wp), intent(in) :: inverse(:, :)
      integer :: span(2, size(inverse, 2))
      real(wp) :: least
      integer :: i, j, n

      n = size(inverse, 1)
      least = 0.1_wp*epsilon(1.0_wp)/n
      do j = 1, n
         span(:, j) = j
         do i = 1, n
            if (abs(inverse(i, j)) <= least*sqrt(inverse(i, i)*inverse(j, j))) cycle
            span(1, j) = min(span(1, j), i)
            span(2, j) = max(span(2, j), i)
         end do
         span(1, j) = span(1, j) - modulo(span(1, j) - 1, register_width)
         span(2, j) = whole_registers(span(2, j))
      end do
      do j = 1, n - 3, 4
         span(1, j:j + 3) = minval(span(1, j:j + 3))
         span(2, j:j + 3) = maxval(span(2, j:j + 3))
      end do
   end function span_of

   !> Tries a step of sample w: a1 = S^-1 [b dF + M a0/gamma - h K (v0 + lag a0)] - share a0 with
   !> lag = h (1/2 - beta/gamma), share = (1 - gamma)/gamma; then v1 and x1. has_passed is 1 where a
   !> joint is beyond its limit at the end, else 0.
   pure subroutine try_woodbury(system, l, block, w, has_passed)
      type(newmark_system), intent(in) :: system
      integer, intent(in) :: l, w
      type(newmark_block), intent(inout) :: block
      integer(long), intent(out) :: has_passed
      real(wp), dimension(size(block%motion, 1)) :: a, load, pull
      real(wp), dimension(block%n_joints) :: place, velocity
      real(wp) :: lag, missing, share
      integer :: i, j, m

      associate (level => system%level(l), weight => system%level(l)%weight, &
                 n => block%n_dof, h => system%level(l)%weight(3), w_ => block%frame%directions, &
                 old => block%motion(:, :, block%slot(w), w), &
                 new => block%motion(:, :, 1 - block%slot(w), w), &
                 bounds => block%bounds(:, :, w))
         lag = h*(0.5_wp - system%beta/system%gamma)
         share = (1.0_wp - system%gamma)/system%gamma
         missing = system%beta*h**2
         m = 0
         do j = 1, block%n_joints   ! without a branch, for nobody can guess it
            block%list(m + 1) = j
            m = m + merge(0, 1, bounds(j, 4) > 0.0_wp)
         end do
         a(:n) = old(:n, 2) + lag*old(:n, 1)
         call system%mass%multiply(old(:, 1), load)
         call system%stiffness%multiply(a, pull)
         load(:n) = load(:n)/system%gamma - h*pull(:n)
         load(:n) = load(:n) &
                    + level%share*matmul(block%frame%structure%load, block%change_of_force(w))
         do i = 1, m
            j = block%list(i)
            call w_%add_row(j, h*block%stiffness(j)*w_%row_times(j, a), load)
         end do
         call multiply(size(a), n, level%span, level%inverse, load, a)
         if (m > 0 .and. missing > 0.0_wp) call release(level, missing, m, block, a)
         new(:n, 1) = a(:n) - share*old(:n, 1)
         new(:n, 2) = old(:n, 2) + weight(1)*old(:n, 1) + weight(2)*new(:n, 1)
         new(:n, 3) = old(:n, 3) + weight(3)*old(:n, 2) + weight(4)*old(:n, 1) &
                      + weight(5)*new(:n, 1)
         call w_%multiply(new(:, 3), place)
         call w_%multiply(new(:, 2), velocity)
         has_passed = 0
         do j = 1, block%n_joints
            if (abs(place(j) - bounds(j, 1)) > bounds(j, 2) .or. &
                bounds(j, 3)*velocity(j) < 0.0_wp) has_passed = 1
         end do
      end associate
   end subroutine try_woodbury

   !> a = A f, four columns at a time.
   pure subroutine multiply(rows, n, span, matrix, f, a)
      integer, intent(in) :: rows, n, span(2, n)
      real(wp), intent(in) :: matrix(rows, n), f(n)
      real(wp), intent(out) :: a(rows)
      integer :: i, j

      a = 0.0_wp
      do j = 1, n - 3, 4
         do i = span(1, j), span(2, j)   ! the same for these four
            a(i) = a(i) + ((matrix(i, j)*f(j) + matrix(i, j + 1)*f(j + 1)) &
                           + (matrix(i, j + 2)*f(j + 2) + matrix(i, j + 3)*f(j + 3)))
         end do
      end do
      do j = n - modulo(n, 4) + 1, n
         do i = span(1, j), span(2, j)
            a(i) = a(i) + matrix(i, j)*f(j)
         end do
      end do
   end subroutine multiply

   !> From u = S^-1 q with all joints stuck to that with the m listed ones slipping: u + S^-1 W y
   !> with (1/(beta h^2 k) - W' S^-1 W) y = W' u, rows and columns of the listed joints. By factors
   !> L D L' made here and not by LAPACK, whose calls cost more than these few rows.
   pure subroutine release(level, missing, m, block, u)
      type(newmark_level), intent(in) :: level
      real(wp), intent(in) :: missing   !! beta h^2
      integer, intent(in) :: m
      type(newmark_block), intent(inout) :: block
      real(wp), intent(inout) :: u(:)
      real(wp) :: pivot, share
      integer :: i, j

      associate (list => block%list, factor => block%factor, y => block%release)
         do j = 1, m
            do i = j, m
               factor(i, j) = -level%between(list(i), list(j))
            end do
            factor(j, j) = factor(j, j) + 1.0_wp/(missing*block%stiffness(list(j)))
            y(j) = block%frame%directions%row_times(list(j), u)
         end do
         do j = 1, m
            pivot = 1.0_wp/factor(j, j)
            do i = j + 1, m
               share = factor(i, j)*pivot
               factor(i:m, i) = factor(i:m, i) - factor(i:m, j)*share
               y(i) = y(i) - y(j)*share
            end do
            y(j) = y(j)*pivot
            factor(j + 1:m, j) = factor(j + 1:m, j)*pivot
         end do
         do j = m, 1, -1
            do i = j + 1, m
               y(j) = y(j) - factor(i, j)*y(i)
            end do
            u = u + level%at_joints(:, list(j))*y(j)
         end do
      end associate
   end subroutine release

end module dynamics_newmark_woodbury
