!> Loops over modes and joints of 32 samples side by side, for one part of a step in the modal form.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   implicit none(type, external)
   private
   public :: follow, integrate_motion, mask, put_free_paths, rotate, take_motion

contains

   !> Modes ahead, one by one (M3).
   pure subroutine rotate(rows, rotation, load, force, now, pushed, ahead)
      integer, intent(in) :: rows
      real(wp), intent(in) :: rotation(:, :)               !! (entry, mode)
      real(wp), intent(in) :: load(:, :)                   !! (mode, force)
      real(wp), intent(in) :: force(:, :, 0:)              !! (lane, force, power) [N]
      real(wp), intent(in) :: now(width, rows, 2)          !! q, q'
      real(wp), intent(in) :: pushed(width, rows)          !! S z
      real(wp), intent(inout) :: ahead(width, rows, 4)     !! q, q' at 1, at 1/2
      real(wp), dimension(width) :: push, rise
      real(wp) :: c(16)
      integer :: f, l, r

      do r = 1, size(rotation, 2)
         do l = 1, width
            push(l) = pushed(l, r)
            rise(l) = 0.0_wp
         end do
         do f = 1, size(load, 2)
            do l = 1, width
               push(l) = push(l) + load(r, f)*force(l, f, 0)
               rise(l) = rise(l) + load(r, f)*force(l, f, 1)
            end do
         end do
         c = rotation(:, r)
         do l = 1, width
            ahead(l, r, 1) = (c(1)*now(l, r, 1) + c(2)*now(l, r, 2)) + (c(3)*push(l) + c(4)*rise(l))
            ahead(l, r, 2) = (c(5)*now(l, r, 1) + c(6)*now(l, r, 2)) + (c(7)*push(l) + c(8)*rise(l))
            ahead(l, r, 3) = (c(9)*now(l, r, 1) + c(10)*now(l, r, 2)) &
                             + (c(11)*push(l) + c(12)*rise(l))
            ahead(l, r, 4) = (c(13)*now(l, r, 1) + c(14)*now(l, r, 2)) &
                             + (c(15)*push(l) + c(16)*rise(l))
         end do
      end do
   end subroutine rotate

   !> Powers 2 .. 5 of the polynomial through values and slopes at 0, 1/2 and 1, or without the
   !> slope at 1/2 (M4). Power 6 is zero.
   pure subroutine put_free_paths(joints, rows, n_reads, value, x0, x1, x)
      integer, intent(in) :: joints, rows, n_reads
      real(wp), intent(in) :: value(width, joints, 4)         !! u(1), u'(1), u(1/2), u'(1/2)
      real(wp), intent(in), dimension(width, rows) :: x0, x1  !! u(0), u'(0)
      real(wp), intent(inout) :: x(width, rows, 2:6)          !! (lane, joint, power)
      real(wp) :: full, half, start, slope, turn
      integer :: j, l

      do j = 1, joints
         if (n_reads == 3) then
            do l = 1, width
               half = value(l, j, 3) - x0(l, j)
               full = value(l, j, 1) - x0(l, j)
               start = x1(l, j)
               slope = value(l, j, 2)
               x(l, j, 2) = (16.0_wp*half - 5.0_wp*full) - (4.0_wp*start - slope)
               x(l, j, 3) = (14.0_wp*full - 32.0_wp*half) + (5.0_wp*start - 3.0_wp*slope)
               x(l, j, 4) = (16.0_wp*half - 8.0_wp*full) - 2.0_wp*(start - slope)
               x(l, j, 5) = 0.0_wp
               x(l, j, 6) = 0.0_wp
            end do
         else
            do l = 1, width
               half = value(l, j, 3) - x0(l, j)
               full = value(l, j, 1) - x0(l, j)
               start = x1(l, j)
               slope = value(l, j, 2)
               turn = value(l, j, 4)
               x(l, j, 2) = (16.0_wp*half + 7.0_wp*full) - (6.0_wp*start + 8.0_wp*turn + slope)
               x(l, j, 3) = (13.0_wp*start + 32.0_wp*turn + 5.0_wp*slope) &
                            - (32.0_wp*half + 34.0_wp*full)
               x(l, j, 4) = (16.0_wp*half + 52.0_wp*full) &
                            - (12.0_wp*start + 40.0_wp*turn + 8.0_wp*slope)
               x(l, j, 5) = (4.0_wp*start + 16.0_wp*turn + 4.0_wp*slope) - 24.0_wp*full
               x(l, j, 6) = 0.0_wp
            end do
         end if
      end do
   end subroutine put_free_paths

   !> Which sliders move with their joints: those of slipping joints, and of joints without
   !> friction, which have no spring and slip for ever.
   pure subroutine follow(joints, side, spring, moves)
      integer, intent(in) :: joints
      real(wp), intent(in), dimension(width, joints) :: side, spring
      real(wp), intent(inout) :: moves(width, joints)   !! 1 or 0
      integer :: j, l

      do j = 1, joints
         do l = 1, width
            moves(l, j) = merge(1.0_wp, 0.0_wp, abs(side(l, j)) + (1.0_wp - spring(l, j)) > 0.0_wp)
         end do
      end do
   end subroutine follow

   !> One power of the motion of the sliders.
   pure subroutine mask(joints, moves, x, motion)
      integer, intent(in) :: joints
      real(wp), intent(in) :: moves(width, joints), x(width, joints)
      real(wp), intent(inout) :: motion(width, joints)
      integer :: j, l

      do j = 1, joints
         do l = 1, width
            motion(l, j) = moves(l, j)*x(l, j)
         end do
      end do
   end subroutine mask

   !> Motion of the sliders over the part and its integrals: I_s of t^k is k!/(k + s)! (M6).
   pure subroutine integrate_motion(joints, rows, n_moments, moves, x1, x, moments)
      integer, intent(in) :: joints, rows, n_moments
      real(wp), intent(in) :: moves(width, joints), x1(width, rows), x(width, rows, 2:6)
      real(wp), intent(inout) :: moments(width, joints, 0:n_moments)
      real(wp) :: share(6, 0:n_moments), total
      integer :: j, k, l, s

      do k = 1, 6
         share(k, 0) = 1.0_wp
         do s = 1, n_moments
            share(k, s) = share(k, s - 1)/(k + s)
         end do
      end do
      do s = 0, n_moments
         do j = 1, joints
            do l = 1, width
               total = share(6, s)*x(l, j, 6) + share(5, s)*x(l, j, 5)
               total = total + (share(4, s)*x(l, j, 4) + share(3, s)*x(l, j, 3))
               total = total + (share(2, s)*x(l, j, 2) + share(1, s)*x1(l, j))
               moments(l, j, s) = moves(l, j)*total
            end do
         end do
      end do
   end subroutine integrate_motion

   !> The modes at the end of the part take the motion of the sliders (M6).
   pure subroutine take_motion(rows, n_moments, weight, ahead, taken, now)
      integer, intent(in) :: rows, n_moments
      real(wp), intent(in) :: weight(0:, :, :)                 !! (moment, q or q', mode)
      real(wp), intent(in) :: ahead(width, rows, 2)
      real(wp), intent(in) :: taken(width, rows, 0:n_moments)  !! S I
      real(wp), intent(inout) :: now(width, rows, 2)
      real(wp) :: q(width), p(width)
      integer :: k, l, r

      do r = 1, size(weight, 3)
         do l = 1, width
            q(l) = ahead(l, r, 1)
            p(l) = ahead(l, r, 2)
         end do
         do k = 0, n_moments
            do l = 1, width
               q(l) = q(l) + weight(k, 1, r)*taken(l, r, k)
               p(l) = p(l) + weight(k, 2, r)*taken(l, r, k)
            end do
         end do
         do l = 1, width
            now(l, r, 1) = q(l)
            now(l, r, 2) = p(l)
         end do
      end do
   end subroutine take_motion

end module dynamics_exact_modal_steps
