!> One step of Newmark's scheme for any structure, any beta and gamma.
!>
!> S^-1 = (M + gamma h C + beta h^2 K_s)^-1 is at hand with all joints stuck. Where joints slip,
!> their springs are missing, which is a correction of as low a rank as there are such joints
!> (Woodbury).
module dynamics_newmark_woodbury
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_alignment, only: register_width, whole_registers
   use dynamics_newmark_block, only: newmark_block
   use dynamics_newmark_diagonals, only: diagonal_matrix, diagonals_of, put_product
   use numerics_lapack, only: solve_positive_definite
   use numerics_sparse, only: sparse_matrix
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: newmark_level, newmark_system, inverse_of, new_newmark_system, try_woodbury

   !> Matrices of one length of step.
   type :: newmark_level
      !> of a0, a1 in v1; of v0 (so h), a0, a1 in x1; (1 - gamma)/gamma
      real(wp) :: weight(6) = 0.0_wp
      real(wp), allocatable :: inverse(:, :)       !! S^-1 (rows, dof)
      integer, allocatable :: span(:, :)           !! (2, dof) rows in which a column of it counts
      real(wp), allocatable :: at_joints(:, :)     !! S^-1 W (rows, joint)
      integer, allocatable :: joint_span(:, :)     !! (2, joint) rows in which a column of it counts
      real(wp), allocatable :: between(:, :)       !! W' S^-1 W (joint, joint)
      real(wp), allocatable :: compliance(:)       !! 1/(beta h^2 k) (joint)
   end type newmark_level

   !> A structure at every level of halving.
   type :: newmark_system
      type(diagonal_matrix) :: forces                !! [M/gamma K W b]
      type(diagonal_matrix) :: directions            !! W'
      type(diagonal_matrix) :: both                  !! W' of a column v and of the next one, x
      real(wp) :: beta = 0.0_wp, gamma = 0.0_wp
      type(newmark_level), allocatable :: level(:)   !! from 0
   contains
      procedure :: work
   end type newmark_system

contains

   !> Prepares every level.
   subroutine new_newmark_system(structure, weight, beta, gamma, system, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: weight(:, 0:)   !! (6, level) see newmark_level
      real(wp), intent(in) :: beta, gamma
      type(newmark_system), intent(out) :: system
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: both(:, :), forces(:, :), inverse(:, :), stuck(:, :)
      logical, allocatable :: is_felt(:, :)   ! (dof, joint)
      integer :: j, joint_rows, l, m, n, rows

      n = structure%n_dof
      m = structure%n_joints
      rows = whole_registers(n)
      system%beta = beta
      system%gamma = gamma
      allocate (forces(n, 2*n + m + structure%n_forces))
      forces(:, :n) = structure%mass/gamma
      forces(:, n + 1:2*n) = structure%stiffness
      forces(:, 2*n + 1:2*n + m) = structure%direction
      forces(:, 2*n + m + 1:) = structure%load
      call diagonals_of(forces, system%forces)
      call diagonals_of(transpose(structure%direction), system%directions)
      joint_rows = whole_registers(max(1, m))
      allocate (both(2*joint_rows, 2*rows), source=0.0_wp)
      both(:m, :n) = transpose(structure%direction)
      both(joint_rows + 1:joint_rows + m, rows + 1:rows + n) = transpose(structure%direction)
      call diagonals_of(both, system%both)
      is_felt = abs(structure%direction) > 0.0_wp
      stuck = structure%stuck_stiffness([(.true., j=1, m)])
      allocate (system%level(0:ubound(weight, 2)))
      do l = 0, ubound(weight, 2)
         associate (level => system%level(l))
            level%weight = weight(:, l)
            call inverse_of(structure, stuck, weight(3, l), beta, gamma, inverse, error)
            if (allocated(error)) return
            allocate (level%inverse(rows, n), level%at_joints(rows, m), source=0.0_wp)
            level%inverse(:n, :) = inverse
            level%span = span_of(inverse)
            level%at_joints(:n, :) = matmul(inverse, structure%direction)
            allocate (level%joint_span(2, m))
            level%joint_span(1, :) = [(minval(level%span(1, :), is_felt(:, j)), j=1, m)]
            level%joint_span(2, :) = [(maxval(level%span(2, :), is_felt(:, j)), j=1, m)]
            level%between = matmul(transpose(structure%direction), level%at_joints(:n, :))
            if (beta > 0.0_wp) &
               level%compliance = 1.0_wp/(weight(5, l)*structure%joint_stiffness)
         end associate
      end do
   end subroutine new_newmark_system

   !> Work of a try of the longest step with all joints stuck, in multiplications of the exact
   !> march: one takes as long as two of those.
   pure real(wp) function work(self)
      class(newmark_system), intent(in) :: self
      real(wp), parameter :: of_try = 1800.0_wp   ! that are no products

      associate (span => self%level(0)%span)
         work = of_try + 2*(entries(self%forces) + entries(self%directions) + entries(self%both) &
                            + sum(span(2, :) - span(1, :) + 1) + 10*size(span, 2))
      end associate

   contains

      pure integer function entries(matrix)
         type(diagonal_matrix), intent(in) :: matrix

         entries = sum(matrix%span(2, :) - matrix%span(1, :) + 1)
      end function entries

   end function work

   !> Finds S^-1 for one stiffness and length of step.
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

   !> Tries a step of sample w: a1 = S^-1 [b dF + M a0/gamma - h K_s u] - share a0 with u = v0 + lag
   !> a0, lag = h (1/2 - beta/gamma), share = (1 - gamma)/gamma; then v1 and x1. has_passed is 1
   !> where a joint is beyond its limit at the end, else 0.
   pure subroutine try_woodbury(system, k, block, has_passed)
      type(newmark_system), intent(in) :: system
      integer, intent(in) :: k   !! number of the try
      type(newmark_block), intent(inout) :: block
      integer(long), intent(out) :: has_passed
      integer :: j, m, w

      w = block%tries(k)%sample
      associate (level => system%level(block%tries(k)%level), n => block%n_dof, &
                 h => system%level(block%tries(k)%level)%weight(3), room => block%room, &
                 old => block%motion(:, :, block%slot(w), w), &
                 new => block%motion(:, :, 1 - block%slot(w), w), &
                 bounds => block%bounds(:, :, w))
         m = 0
         do j = 1, block%n_joints   ! without a branch, for nobody can guess it
            block%list(m + 1) = j
            m = m + merge(0, 1, bounds(j, 4) > 0.0_wp)
         end do

         associate (u => room(:n, 1))
            u = old(:n, 2) + (h*(0.5_wp - system%beta/system%gamma))*old(:n, 1)
            call put_product(system%directions, u, room(:, 2))
            block%parts(:n) = old(:n, 1)
            block%parts(n + 1:2*n) = -h*u
         end associate
         associate (springs => block%parts(2*n + 1:2*n + block%n_joints))
            springs = -h*(bounds(:size(springs), 4)*room(:size(springs), 2))
         end associate
         block%parts(2*n + block%n_joints + 1:) = block%change(k, :)
         call put_product(system%forces, block%parts, room(:, 1))
         call multiply(size(level%inverse, 1), n, level%span, level%inverse, room(:, 1), room(:, 2))
         if (m > 0 .and. system%beta > 0.0_wp) then
            call release(size(level%inverse, 1), block%n_joints, m, block%list, level, &
                         block%frame%directions, level%at_joints, room(:, 2), block%factor)
         end if
         call move_on(size(old, 1), level%weight, room(:, 2), old, new)
         call join_paths(system, size(old, 1), new(:, 2:3), block%paths)
         call judge(size(bounds, 1), block%paths, bounds, has_passed)
      end associate
   end subroutine try_woodbury

   !> Finds a = A f, four columns at a time.
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

   !> Goes from u = S^-1 q with all joints stuck to that with the m listed ones slipping: u + S^-1 W
   !> y with (1/(beta h^2 k) - W' S^-1 W) y = W' u, rows and columns of the listed joints. By
   !> factors L D L' made here and not by LAPACK, whose calls cost more than these few rows.
   pure subroutine release(rows, joints, m, list, level, directions, at_joints, u, factor)
      integer, intent(in) :: rows, joints, m, list(m)
      type(newmark_level), intent(in) :: level
      type(sparse_matrix), intent(in) :: directions   !! W'
      real(wp), intent(in) :: at_joints(rows, joints)
      real(wp), intent(inout) :: u(rows)
      real(wp), intent(inout) :: factor(joints, 0:m)   !! room; y in column 0
      real(wp) :: pivot, share
      integer :: e, i, j, k

      do j = 1, m
         do i = j, m
            factor(i, j) = -level%between(list(i), list(j))
         end do
         factor(j, j) = factor(j, j) + level%compliance(list(j))
         factor(j, 0) = 0.0_wp
         do e = directions%start(list(j)), directions%start(list(j) + 1) - 1
            factor(j, 0) = factor(j, 0) + directions%value(e)*u(directions%column(e))
         end do
      end do
      do j = 1, m
         pivot = 1.0_wp/factor(j, j)
         do i = j + 1, m
            share = factor(i, j)*pivot
            do k = i, m
               factor(k, i) = factor(k, i) - factor(k, j)*share
            end do
            factor(i, 0) = factor(i, 0) - factor(j, 0)*share
         end do
         factor(j, 0) = factor(j, 0)*pivot
         do k = j + 1, m
            factor(k, j) = factor(k, j)*pivot
         end do
      end do
      do j = m, 1, -1
         do i = j + 1, m
            factor(j, 0) = factor(j, 0) - factor(i, j)*factor(i, 0)
         end do
         do i = level%joint_span(1, list(j)), level%joint_span(2, list(j))
            u(i) = u(i) + at_joints(i, list(j))*factor(j, 0)
         end do
      end do
   end subroutine release

   !> Finds a1 = a - share a0, v1 and x1.
   pure subroutine move_on(rows, weight, a, old, new)
      integer, intent(in) :: rows
      real(wp), intent(in) :: weight(6), a(rows), old(rows, 3)
      real(wp), intent(out) :: new(rows, 3)
      integer :: i

      do i = 1, rows
         new(i, 1) = a(i) - weight(6)*old(i, 1)
         new(i, 2) = old(i, 2) + weight(1)*old(i, 1) + weight(2)*new(i, 1)
         new(i, 3) = old(i, 3) + weight(3)*old(i, 2) + weight(4)*old(i, 1) + weight(5)*new(i, 1)
      end do
   end subroutine move_on

   !> Finds w.v and w.x of all joints.
   pure subroutine join_paths(system, rows, motion, paths)
      type(newmark_system), intent(in) :: system
      integer, intent(in) :: rows
      real(wp), intent(in) :: motion(2*rows)   !! v and x
      real(wp), intent(out), contiguous :: paths(:)

      call put_product(system%both, motion, paths)
   end subroutine join_paths

   !> Finds if a joint is beyond its limit: 1 then.
   pure subroutine judge(rows, paths, bounds, has_passed)
      integer, intent(in) :: rows
      real(wp), intent(in) :: paths(rows, 2), bounds(rows, 4)   !! w.v and w.x of the joints
      integer(long), intent(out) :: has_passed
      integer(long) :: is_back, is_out
      integer :: j

      has_passed = 0
      !$omp simd private(is_back, is_out) reduction(ior:has_passed)
      do j = 1, rows
         is_out = merge(1_long, 0_long, abs(paths(j, 2) - bounds(j, 1)) > bounds(j, 2))
         is_back = merge(1_long, 0_long, bounds(j, 3)*paths(j, 1) < 0.0_wp)
         has_passed = ior(has_passed, ior(is_out, is_back))
      end do
   end subroutine judge

end module dynamics_newmark_woodbury
