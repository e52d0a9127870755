!> The next power of all paths: products with C^ and K^ whose sums stay in registers.
!>
!> The sums of a row fill four arrays of eight lanes, each one or two vector operations. A room by
!> itself: inlined where powers are expanded, the sums do not stay in registers.
module dynamics_exact_powers
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   use numerics_sparse, only: sparse_matrix
   implicit none(type, external)
   private
   public :: next_power

   integer, parameter :: lanes = 8, vectors = width/lanes

contains

   !> x_(k+2) = -(K^ x_k + (k + 1) C^ x_(k+1))/((k + 1)(k + 2)) of the dofs.
   pure subroutine next_power(top, springs, damping, scale, x0, x1, stiffness, x2)
      integer, intent(in) :: top                      !! rows
      type(sparse_matrix), intent(in) :: springs      !! K^ without its diagonal
      type(sparse_matrix), intent(in) :: damping      !! -C^/(k + 2)
      real(wp), intent(in) :: scale                   !! -1/((k + 1)(k + 2))
      real(wp), intent(in), dimension(lanes, vectors, top) :: x0, x1, stiffness
      real(wp), intent(inout) :: x2(lanes, vectors, top)
      real(wp), dimension(lanes) :: a1, a2, a3, a4
      integer :: e, i, j, l

      do i = 1, damping%n_rows
         do l = 1, lanes
            a1(l) = stiffness(l, 1, i)*x0(l, 1, i)
            a2(l) = stiffness(l, 2, i)*x0(l, 2, i)
            a3(l) = stiffness(l, 3, i)*x0(l, 3, i)
            a4(l) = stiffness(l, 4, i)*x0(l, 4, i)
         end do
         do e = springs%start(i), springs%start(i + 1) - 1
            j = springs%column(e)
            do l = 1, lanes
               a1(l) = a1(l) + springs%value(e)*x0(l, 1, j)
               a2(l) = a2(l) + springs%value(e)*x0(l, 2, j)
               a3(l) = a3(l) + springs%value(e)*x0(l, 3, j)
               a4(l) = a4(l) + springs%value(e)*x0(l, 4, j)
            end do
         end do
         do l = 1, lanes
            a1(l) = scale*a1(l)
            a2(l) = scale*a2(l)
            a3(l) = scale*a3(l)
            a4(l) = scale*a4(l)
         end do
         do e = damping%start(i), damping%start(i + 1) - 1
            j = damping%column(e)
            do l = 1, lanes
               a1(l) = a1(l) + damping%value(e)*x1(l, 1, j)
               a2(l) = a2(l) + damping%value(e)*x1(l, 2, j)
               a3(l) = a3(l) + damping%value(e)*x1(l, 3, j)
               a4(l) = a4(l) + damping%value(e)*x1(l, 4, j)
            end do
         end do
         do l = 1, lanes
            x2(l, 1, i) = a1(l)
            x2(l, 2, i) = a2(l)
            x2(l, 3, i) = a3(l)
            x2(l, 4, i) = a4(l)
         end do
      end do
   end subroutine next_power

end module dynamics_exact_powers
