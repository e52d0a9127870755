!> One step of Newmark's scheme for chains too long for tables, and for any beta and gamma.
!>
!> S^-1 is at hand for the stuck chain. Where sliders slip, the stiffness of their contact springs
!> is missing, which is a correction of as low a rank as there are such sliders (Woodbury).
module dynamics_newmark_long
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: try_long

contains

   !> a1 = S^-1 [b dF + M a0/gamma - h K (v0 + lag a0)] - share a0, then v1 and x1; has_passed is 1
   !> where a slider is beyond its limit at the end, else 0.
   pure subroutine try_long(n, rows, change, lag, share, missing, weight, rigid, span, inverse, &
                            bounds, slot, motion, room, list, has_passed)
      integer, intent(in) :: n, rows
      real(wp), intent(in) :: change             !! dF [N]
      real(wp), intent(in) :: lag                !! h (1/2 - beta/gamma) [s]
      real(wp), intent(in) :: share              !! (1 - gamma)/gamma
      real(wp), intent(in) :: missing            !! beta h^2; times k: what a slipping slider lacks
      real(wp), intent(in) :: weight(5)          !! of a0, a1 in v1; of v0 (so h), a0, a1 in x1
      real(wp), intent(in) :: rigid(rows, 6)     !! b, M/gamma, coupling by diagonals (3), k
      integer, intent(in) :: span(2, n)          !! the rows in which a column of S^-1 counts
      real(wp), intent(in) :: inverse(rows, n)   !! S^-1 of the stuck chain
      real(wp), intent(in) :: bounds(rows, 4)    !! slider, reach, way, stiffness
      integer(long), intent(in) :: slot
      real(wp), intent(inout) :: motion(rows, 3, 0:1)
      real(wp), intent(inout) :: room(rows, n + 2)
      integer, intent(out) :: list(n)
      integer(long), intent(out) :: has_passed
      real(wp) :: a1, v1, x1
      integer(long) :: is_out, is_back
      integer :: i, m

      associate (a0 => motion(:, 1, slot), v0 => motion(:, 2, slot), x0 => motion(:, 3, slot), &
                 h => weight(3), load => room(:, 1), a => room(:, 2))
         m = 0
         do i = 1, n   ! without a branch, for nobody can guess it
            list(m + 1) = i
            m = m + merge(0, 1, bounds(i, 4) > 0.0_wp)
         end do
         do i = 1, n
            a(i) = v0(i) + lag*a0(i)
         end do
         do i = 1, n
            load(i) = rigid(i, 1)*change + rigid(i, 2)*a0(i) - h*(rigid(i, 4) + bounds(i, 4))*a(i)
         end do
         do i = 2, n
            load(i) = load(i) - h*rigid(i, 3)*a(i - 1)
         end do
         do i = 1, n - 1
            load(i) = load(i) - h*rigid(i, 5)*a(i + 1)
         end do
         call multiply(rows, n, span, inverse, load, a)
         if (m > 0 .and. missing > 0.0_wp) &
            call release(rows, n, m, list, missing, rigid(:, 6), span, inverse, a, load, &
                         room(:, 3:))
         has_passed = 0
         !$omp simd private(a1, v1, x1, is_out, is_back) reduction(ior:has_passed)
         do i = 1, rows
            a1 = a(i) - share*a0(i)
            v1 = v0(i) + weight(1)*a0(i) + weight(2)*a1
            x1 = x0(i) + weight(3)*v0(i) + weight(4)*a0(i) + weight(5)*a1
            motion(i, 1, 1 - slot) = a1
            motion(i, 2, 1 - slot) = v1
            motion(i, 3, 1 - slot) = x1
            is_out = merge(1_long, 0_long, abs(x1 - bounds(i, 1)) > bounds(i, 2))
            is_back = merge(1_long, 0_long, bounds(i, 3)*v1 < 0.0_wp)
            has_passed = ior(has_passed, ior(is_out, is_back))
         end do
      end associate
   end subroutine try_long

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

   !> From u = S^-1 q of the stuck chain to that with the listed sliders slipping: u + A y with
   !> (1/(missing k) - A') y = u', A the listed columns of S^-1, ' the listed rows. By factors
   !> L D L' made here and not by LAPACK, whose calls cost more than these few rows.
   pure subroutine release(rows, n, m, list, missing, stiffness, span, inverse, u, y, factor)
      integer, intent(in) :: rows, n, m, list(n), span(2, n)
      real(wp), intent(in) :: missing, stiffness(rows), inverse(rows, n)
      real(wp), intent(inout) :: u(rows)
      real(wp), intent(inout) :: y(n), factor(rows, n)   !! room
      real(wp) :: pivot, share
      integer :: i, j

      do j = 1, m
         do i = j, m
            factor(i, j) = -inverse(list(i), list(j))
         end do
         factor(j, j) = factor(j, j) + 1.0_wp/(missing*stiffness(list(j)))
         y(j) = u(list(j))
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
         do i = span(1, list(j)), span(2, list(j))
            u(i) = u(i) + inverse(i, list(j))*y(j)
         end do
      end do
   end subroutine release

end module dynamics_newmark_long
