!> Loops over modes and joints of 32 samples side by side, for one part of a step in the modal form.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: width
   implicit none(type, external)
   private
   public :: put_free_paths, put_rest, rotate, take_motion

contains

   !> Modes ahead, one by one (M3).
   pure subroutine rotate(rows, n_ahead, rotation, load, force, now, pushed, ahead)
      integer, intent(in) :: rows
      integer, intent(in) :: n_ahead                       !! 3 or 4 of q, q' at 1, at 1/2
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
         end do
         if (n_ahead < 4) cycle
         do l = 1, width
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

   !> Gives the modes at the end of the part the motion of the sliders (M6).
   pure subroutine take_motion(rows, weight, ahead, taken, now, pushed)
      integer, intent(in) :: rows
      real(wp), intent(in) :: weight(0:, :, :)        !! (moment, q or q', mode)
      real(wp), intent(in) :: ahead(width, rows, 2)
      real(wp), intent(in) :: taken(width, rows, 0:ubound(weight, 1))  !! S I
      real(wp), intent(inout) :: now(width, rows, 2)
      real(wp), intent(inout) :: pushed(width, rows)  !! S z
      integer :: k, l, r

      do r = 1, size(weight, 3)
         associate (q => weight(:, 1, r), p => weight(:, 2, r))
            do l = 1, width
               now(l, r, 1) = (ahead(l, r, 1) + q(1)*taken(l, r, 0)) &
                              + (q(2)*taken(l, r, 1) + q(3)*taken(l, r, 2))
               now(l, r, 2) = (ahead(l, r, 2) + p(1)*taken(l, r, 0)) &
                              + (p(2)*taken(l, r, 1) + p(3)*taken(l, r, 2))
               pushed(l, r) = pushed(l, r) + taken(l, r, 0)
            end do
            do k = 3, ubound(weight, 1)
               do l = 1, width
                  now(l, r, 1) = now(l, r, 1) + q(k + 1)*taken(l, r, k)
                  now(l, r, 2) = now(l, r, 2) + p(k + 1)*taken(l, r, k)
               end do
            end do
         end associate
      end do
   end subroutine take_motion

   !> Adds of the sliders' motion to the modes at the end, less those of the uniform motion to its
   !> end: what take_motion adds less what f' = S zeta(1) does.
   pure subroutine put_rest(rows, weight, rotation, taken, rest)
      integer, intent(in) :: rows
      real(wp), intent(in) :: weight(0:, :, :)       !! (moment, q or q', mode)
      real(wp), intent(in) :: rotation(:, :)         !! (entry, mode)
      real(wp), intent(in) :: taken(width, rows, 0:ubound(weight, 1))   !! S I
      real(wp), intent(inout) :: rest(width, rows, 2)                   !! q, q'
      integer :: i, k, r

      do i = 1, 2
         do r = 1, size(weight, 3)
            rest(:, r, i) = (weight(0, i, r) - rotation(4*i, r))*taken(:, r, 0)
            do k = 1, ubound(weight, 1)
               rest(:, r, i) = rest(:, r, i) + weight(k, i, r)*taken(:, r, k)
            end do
         end do
      end do
   end subroutine put_rest

end module dynamics_exact_modal_steps
