!> Loops over modes and joints of eight samples side by side, for one part of a step in the modal
!> form.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_modal_sliders, only: groups, lanes
   implicit none(type, external)
   private
   public :: put_free_paths, rotate_modes, rotate_pairs, take_motion

contains

   !> Takes modes to the end of the part, one by one, and finds what its middle adds to the cubic
   !> through both ends, from the first mode on where that counts (M3), (M4).
   pure subroutine rotate_modes(rows, first_read, rotation, load, force, pushed, now, middle)
      integer, intent(in) :: rows
      integer, intent(in) :: first_read(4)                 !! modes, see modal_terms
      real(wp), intent(in), contiguous :: rotation(:, :, :)   !! (entry, 1:4, mode)
      real(wp), intent(in), contiguous :: load(:, :)          !! (mode, force)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: pushed(lanes, rows)          !! S z
      real(wp), intent(inout) :: now(lanes, rows, 2)       !! q, q'
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp) :: push, q, rise, v
      integer :: f, i, l, r

      do r = 1, size(load, 1)
         do i = 3, 4
            if (r < first_read(i)) exit
            !$omp simd private(push, rise)
            do l = 1, lanes
               push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
               rise = load(r, 1)*force(l, 1, 1)
               middle(l, r, i - 2) = (rotation(1, i, r)*now(l, r, 1) &
                                      + rotation(2, i, r)*now(l, r, 2)) &
                                     + (rotation(3, i, r)*push + rotation(4, i, r)*rise)
            end do
         end do
         !$omp simd private(push, q, rise, v)
         do l = 1, lanes
            push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
            rise = load(r, 1)*force(l, 1, 1)
            q = now(l, r, 1)
            v = now(l, r, 2)
            now(l, r, 1) = (rotation(1, 1, r)*q + rotation(2, 1, r)*v) &
                           + (rotation(3, 1, r)*push + rotation(4, 1, r)*rise)
            now(l, r, 2) = (rotation(1, 2, r)*q + rotation(2, 2, r)*v) &
                           + (rotation(3, 2, r)*push + rotation(4, 2, r)*rise)
         end do
         do f = 2, size(load, 2)
            do i = 1, 2
               now(:, r, i) = now(:, r, i) + load(r, f)*(rotation(3, i, r)*force(:, f, 0) &
                                                         + rotation(4, i, r)*force(:, f, 1))
               middle(:, r, i) = middle(:, r, i) &
                                 + load(r, f)*(rotation(3, i + 2, r)*force(:, f, 0) &
                                               + rotation(4, i + 2, r)*force(:, f, 1))
            end do
         end do
      end do
   end subroutine rotate_modes

   !> Does the same to blocks of two ports.
   pure subroutine rotate_pairs(rows, first_read, rotation, load, force, pushed, now, middle)
      integer, intent(in) :: rows
      integer, intent(in) :: first_read(4)                 !! blocks, see modal_terms
      real(wp), intent(in), contiguous :: rotation(:, :, :)   !! (entry, 1:4, row)
      real(wp), intent(in), contiguous :: load(:, :)          !! (row, force)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: pushed(lanes, rows)          !! S z
      real(wp), intent(inout) :: now(lanes, rows, 2)       !! p, p'
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp) :: start(lanes, 6)   ! of a block: its numbers, pushes and rises
      integer :: f, i, port, r, row

      do r = 1, size(load, 1), 2
         do port = 1, 2
            row = r + port - 1
            start(:, port) = now(:, row, 1)
            start(:, 2 + port) = pushed(:, row)
            start(:, 4 + port) = 0.0_wp
            do f = 1, size(load, 2)
               start(:, 2 + port) = start(:, 2 + port) + load(row, f)*force(:, f, 0)
               start(:, 4 + port) = start(:, 4 + port) + load(row, f)*force(:, f, 1)
            end do
         end do
         do row = r, r + 1
            do i = 1, 2
               call add_up(rotation(:, i, row), start, now(:, row, i))
               if (r > 2*(first_read(i + 2) - 1)) &
                  call add_up(rotation(:, i + 2, row), start, middle(:, row, i))
            end do
         end do
      end do
   end subroutine rotate_pairs

   pure subroutine add_up(factor, from, total)
      real(wp), intent(in) :: factor(6), from(lanes, 6)
      real(wp), intent(inout) :: total(lanes)
      integer :: l

      !$omp simd
      do l = 1, lanes
         total(l) = ((factor(1)*from(l, 1) + factor(2)*from(l, 2)) &
                     + (factor(3)*from(l, 3) + factor(4)*from(l, 4))) &
                    + (factor(5)*from(l, 5) + factor(6)*from(l, 6))
      end do
   end subroutine add_up

   !> Finds powers 2 .. 5 of the cubic through values and slopes at 0 and 1 and what the middle adds
   !> (M4): d = 16 e t^2 (1 - t)^2 by its value, 16 s t^2 (1 - t)^2 (t - 1/2) by its slope. Power 6
   !> is zero.
   pure subroutine put_free_paths(joints, rows, has_slope, value, x0, x1, x)
      integer, intent(in) :: joints, rows
      logical, intent(in) :: has_slope                    !! s counts
      real(wp), intent(in) :: value(lanes, joints, 4)     !! u(1), u'(1), e, s
      real(wp), intent(in), dimension(lanes, groups, rows) :: x0, x1   !! u(0), u'(0)
      real(wp), intent(inout) :: x(lanes, groups, rows, 2:6)           !! (.., joint, power)
      real(wp) :: change, finish, middle, slope, start
      integer :: j, l

      do j = 1, joints
         !$omp simd private(change, finish, middle, start)
         do l = 1, lanes
            change = value(l, j, 1) - x0(l, 1, j)
            start = x1(l, 1, j)
            finish = value(l, j, 2)
            middle = 16.0_wp*value(l, j, 3)
            x(l, 1, j, 2) = (3.0_wp*change - (2.0_wp*start + finish)) + middle
            x(l, 1, j, 3) = ((start + finish) - 2.0_wp*change) - 2.0_wp*middle
            x(l, 1, j, 4) = middle
            x(l, 1, j, 5) = 0.0_wp
            x(l, 1, j, 6) = 0.0_wp
         end do
         if (.not. has_slope) cycle
         !$omp simd private(slope)
         do l = 1, lanes
            slope = 8.0_wp*value(l, j, 4)
            x(l, 1, j, 2) = x(l, 1, j, 2) - slope
            x(l, 1, j, 3) = x(l, 1, j, 3) + 4.0_wp*slope
            x(l, 1, j, 4) = x(l, 1, j, 4) - 5.0_wp*slope
            x(l, 1, j, 5) = 2.0_wp*slope
         end do
      end do
   end subroutine put_free_paths

   !> Gives the blocks at the end of the part the motion of the sliders (M6).
   pure subroutine take_motion(rows, weight, taken, now, pushed)
      integer, intent(in) :: rows
      real(wp), intent(in), contiguous :: weight(0:, :, :, :)   !! (moment, port, p or p', row)
      real(wp), intent(in) :: taken(lanes, rows, 0:ubound(weight, 1))   !! S I
      real(wp), intent(inout) :: now(lanes, rows, 2)
      real(wp), intent(inout) :: pushed(lanes, rows)         !! S z
      integer :: i, k, l, other, port, ports, row

      ports = size(weight, 2)
      do port = 1, ports
         do row = 1, size(weight, 4)
            other = row - iand(row - 1, ports - 1) + port - 1   ! row of that port of the block
            !$omp simd
            do l = 1, lanes
               now(l, row, 1) = (now(l, row, 1) + weight(0, port, 1, row)*taken(l, other, 0)) &
                                + (weight(1, port, 1, row)*taken(l, other, 1) &
                                   + weight(2, port, 1, row)*taken(l, other, 2))
               now(l, row, 2) = (now(l, row, 2) + weight(0, port, 2, row)*taken(l, other, 0)) &
                                + (weight(1, port, 2, row)*taken(l, other, 1) &
                                   + weight(2, port, 2, row)*taken(l, other, 2))
            end do
            do k = 3, ubound(weight, 1)
               do i = 1, 2
                  now(:, row, i) = now(:, row, i) + weight(k, port, i, row)*taken(:, other, k)
               end do
            end do
         end do
      end do
      pushed(:, :size(weight, 4)) = pushed(:, :size(weight, 4)) + taken(:, :size(weight, 4), 0)
   end subroutine take_motion

end module dynamics_exact_modal_steps
