!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> 3 rows by 4 vectors of samples make 12 sums, each an array of its own; loops over lanes are one
!> or two vector operations. A room by itself: inlined where powers are expanded, the sums do not
!> stay in registers (154 ns a step of 5 masses instead of 55).
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_series, only: damping_type, rows_together, spring_type
   implicit none(type, external)
   private
   public :: next_power

   integer, parameter :: lanes = 4, vectors = 4, groups = width/(lanes*vectors)

contains

   !> x_(k+2) = -(K^ x_k + (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs. The arrays must not
   !> overlap.
   pure subroutine next_power(top, springs, damping, scale, x0, x1, stiffness, x2)
      integer, intent(in) :: top   !! rows
      type(spring_type), intent(in) :: springs
      type(damping_type), intent(in) :: damping
      real(wp), intent(in) :: scale   !! -1/((k + 1)(k + 2))
      real(wp), intent(in), dimension(lanes, vectors, groups, top) :: x0, x1, stiffness
      real(wp), intent(inout) :: x2(lanes, vectors, groups, top)
      real(wp), dimension(lanes) :: a1, a2, a3, a4, b1, b2, b3, b4, c1, c2, c3, c4
      real(wp) :: d1, d2, d3, d4, weight
      integer :: e, g, i, j, l, q

      do q = 1, size(damping%first) - 1
         do g = 1, groups
            a1 = 0.0_wp
            a2 = 0.0_wp
            a3 = 0.0_wp
            a4 = 0.0_wp
            b1 = 0.0_wp
            b2 = 0.0_wp
            b3 = 0.0_wp
            b4 = 0.0_wp
            c1 = 0.0_wp
            c2 = 0.0_wp
            c3 = 0.0_wp
            c4 = 0.0_wp
            do e = damping%first(q), damping%first(q + 1) - 1
               j = damping%column(e)
               do l = 1, lanes
                  d1 = x1(l, 1, g, j)
                  d2 = x1(l, 2, g, j)
                  d3 = x1(l, 3, g, j)
                  d4 = x1(l, 4, g, j)
                  a1(l) = a1(l) + damping%value(1, e)*d1
                  a2(l) = a2(l) + damping%value(1, e)*d2
                  a3(l) = a3(l) + damping%value(1, e)*d3
                  a4(l) = a4(l) + damping%value(1, e)*d4
                  b1(l) = b1(l) + damping%value(2, e)*d1
                  b2(l) = b2(l) + damping%value(2, e)*d2
                  b3(l) = b3(l) + damping%value(2, e)*d3
                  b4(l) = b4(l) + damping%value(2, e)*d4
                  c1(l) = c1(l) + damping%value(3, e)*d1
                  c2(l) = c2(l) + damping%value(3, e)*d2
                  c3(l) = c3(l) + damping%value(3, e)*d3
                  c4(l) = c4(l) + damping%value(3, e)*d4
               end do
            end do
            i = rows_together*(q - 1)
            i = i + 1
            do e = springs%first(i), springs%first(i + 1) - 1
               j = springs%column(e)
               weight = scale*springs%value(e)
               do l = 1, lanes
                  a1(l) = a1(l) + weight*x0(l, 1, g, j)
                  a2(l) = a2(l) + weight*x0(l, 2, g, j)
                  a3(l) = a3(l) + weight*x0(l, 3, g, j)
                  a4(l) = a4(l) + weight*x0(l, 4, g, j)
               end do
            end do
            do l = 1, lanes
               x2(l, 1, g, i) = a1(l) + scale*stiffness(l, 1, g, i)*x0(l, 1, g, i)
               x2(l, 2, g, i) = a2(l) + scale*stiffness(l, 2, g, i)*x0(l, 2, g, i)
               x2(l, 3, g, i) = a3(l) + scale*stiffness(l, 3, g, i)*x0(l, 3, g, i)
               x2(l, 4, g, i) = a4(l) + scale*stiffness(l, 4, g, i)*x0(l, 4, g, i)
            end do
            i = i + 1
            do e = springs%first(i), springs%first(i + 1) - 1
               j = springs%column(e)
               weight = scale*springs%value(e)
               do l = 1, lanes
                  b1(l) = b1(l) + weight*x0(l, 1, g, j)
                  b2(l) = b2(l) + weight*x0(l, 2, g, j)
                  b3(l) = b3(l) + weight*x0(l, 3, g, j)
                  b4(l) = b4(l) + weight*x0(l, 4, g, j)
               end do
            end do
            do l = 1, lanes
               x2(l, 1, g, i) = b1(l) + scale*stiffness(l, 1, g, i)*x0(l, 1, g, i)
               x2(l, 2, g, i) = b2(l) + scale*stiffness(l, 2, g, i)*x0(l, 2, g, i)
               x2(l, 3, g, i) = b3(l) + scale*stiffness(l, 3, g, i)*x0(l, 3, g, i)
               x2(l, 4, g, i) = b4(l) + scale*stiffness(l, 4, g, i)*x0(l, 4, g, i)
            end do
            i = i + 1
            do e = springs%first(i), springs%first(i + 1) - 1
               j = springs%column(e)
               weight = scale*springs%value(e)
               do l = 1, lanes
                  c1(l) = c1(l) + weight*x0(l, 1, g, j)
                  c2(l) = c2(l) + weight*x0(l, 2, g, j)
                  c3(l) = c3(l) + weight*x0(l, 3, g, j)
                  c4(l) = c4(l) + weight*x0(l, 4, g, j)
               end do
            end do
            do l = 1, lanes
               x2(l, 1, g, i) = c1(l) + scale*stiffness(l, 1, g, i)*x0(l, 1, g, i)
               x2(l, 2, g, i) = c2(l) + scale*stiffness(l, 2, g, i)*x0(l, 2, g, i)
               x2(l, 3, g, i) = c3(l) + scale*stiffness(l, 3, g, i)*x0(l, 3, g, i)
               x2(l, 4, g, i) = c4(l) + scale*stiffness(l, 4, g, i)*x0(l, 4, g, i)
            end do
         end do
      end do
   end subroutine next_power

end module dynamics_exact_powers
