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
   pure subroutine rotate_modes(rows, first_slope, rotation, load, force, pushed, now, middle)
      integer, intent(in) :: rows
      integer, intent(in) :: first_slope                   !! mode whose slope counts
      real(wp), intent(in), contiguous :: load(:, :)       !! (mode, force)
      real(wp), intent(in) :: rotation(4, 4, size(load, 1))   !! see modal_operators
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: pushed(lanes, rows)          !! S z
      real(wp), intent(inout) :: now(lanes, rows, 2)       !! q, q'
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp) :: push, q, rise, v
      integer :: f, i, l, r

      do r = 1, size(load, 1)
         if (r >= first_slope) then
            !$omp simd private(push, rise)
            do l = 1, lanes
               push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
               rise = load(r, 1)*force(l, 1, 1)
               middle(l, r, 2) = rotation(1, 4, r)*now(l, r, 1) + (rotation(2, 4, r)*now(l, r, 2) &
                                 + (rotation(3, 4, r)*push + rotation(4, 4, r)*rise))
            end do
         end if
         !$omp simd private(push, q, rise, v)
         do l = 1, lanes
            push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
            rise = load(r, 1)*force(l, 1, 1)
            q = now(l, r, 1)
            v = now(l, r, 2)
            now(l, r, 1) = rotation(1, 1, r)*q + (rotation(2, 1, r)*v &
                           + (rotation(3, 1, r)*push + rotation(4, 1, r)*rise))
            now(l, r, 2) = rotation(1, 2, r)*q + (rotation(2, 2, r)*v &
                           + (rotation(3, 2, r)*push + rotation(4, 2, r)*rise))
            middle(l, r, 1) = rotation(1, 3, r)*q + (rotation(2, 3, r)*v &
                              + (rotation(3, 3, r)*push + rotation(4, 3, r)*rise))
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
      real(wp), intent(in), contiguous :: load(:, :)       !! (row, force)
      real(wp), intent(in) :: rotation(6, 6, size(load, 1)/2)   !! see modal_operators
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: pushed(lanes, rows)          !! S z
      real(wp), intent(inout) :: now(lanes, rows)          !! p
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp) :: start(lanes, 6)   ! of a block: its numbers, pushes and rises
      integer :: b, f, l, port, row

      do b = 1, size(load, 1)/2
         do port = 1, 2
            row = 2*b - 2 + port
            !$omp simd
            do l = 1, lanes
               start(l, port) = now(l, row)
               start(l, 2 + port) = pushed(l, row) + load(row, 1)*force(l, 1, 0)
               start(l, 4 + port) = load(row, 1)*force(l, 1, 1)
            end do
            do f = 2, size(load, 2)
               start(:, 2 + port) = start(:, 2 + port) + load(row, f)*force(:, f, 0)
               start(:, 4 + port) = start(:, 4 + port) + load(row, f)*force(:, f, 1)
            end do
         end do
         call add_up(rotation(1, 1, b), start, now(1, 2*b - 1))
         if (b >= first_read(3)) call add_up(rotation(1, 3, b), start, middle(1, 2*b - 1, 1))
         if (b >= first_read(4)) call add_up(rotation(1, 5, b), start, middle(1, 2*b - 1, 2))
      end do
   end subroutine rotate_pairs

   pure subroutine add_up(factor, from, total)
      real(wp), intent(in) :: factor(6, 2), from(lanes, 6)
      real(wp), intent(inout) :: total(lanes, 2)
      real(wp) :: a, b, c, d, e, f
      integer :: l

      !$omp simd private(a, b, c, d, e, f)
      do l = 1, lanes
         a = from(l, 1)
         b = from(l, 2)
         c = from(l, 3)
         d = from(l, 4)
         e = from(l, 5)
         f = from(l, 6)
         total(l, 1) = (factor(1, 1)*a + (factor(2, 1)*b + factor(3, 1)*c)) &
                       + (factor(4, 1)*d + (factor(5, 1)*e + factor(6, 1)*f))
         total(l, 2) = (factor(1, 2)*a + (factor(2, 2)*b + factor(3, 2)*c)) &
                       + (factor(4, 2)*d + (factor(5, 2)*e + factor(6, 2)*f))
      end do
   end subroutine add_up

   !> Finds powers 2 .. 5 of the cubic through values and slopes at 0 and 1 and what the middle adds
   !> (M4): d = 16 e t^2 (1 - t)^2 by its value, 16 s t^2 (1 - t)^2 (t - 1/2) by its slope, which
   !> alone has power 5.
   pure subroutine put_free_paths(joints, rows, has_slope, value, x0, x1, x)
      integer, intent(in) :: joints, rows
      logical, intent(in) :: has_slope                    !! s counts
      real(wp), intent(in) :: value(lanes, joints, 4)     !! u(1), u'(1), e, s
      real(wp), intent(in), dimension(lanes, groups, rows) :: x0, x1   !! u(0), u'(0)
      real(wp), intent(inout) :: x(lanes, groups, rows, 2:5)           !! (.., joint, power)
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
   pure subroutine take_motion(rows, n, ports, last, weight, taken, now, pushed)
      integer, intent(in) :: rows, n, ports, last
      real(wp), intent(in) :: weight(0:last, ports, 2, n)   !! (moment, port, number, block)
      real(wp), intent(in) :: taken(lanes, rows, 0:last)    !! S I
      real(wp), intent(inout) :: now(lanes, rows, 3 - ports)
      real(wp), intent(inout) :: pushed(lanes, rows)        !! S z
      real(wp) :: a, b, c
      integer :: k, l, plane, port, r, row

      plane = 3 - ports   ! of the second number
      do port = 1, ports
         do r = 1, n
            row = ports*(r - 1)
            !$omp simd private(a, b, c)
            do l = 1, lanes
               a = taken(l, row + port, 0)
               b = taken(l, row + port, 1)
               c = taken(l, row + port, 2)
               pushed(l, row + port) = pushed(l, row + port) + a
               now(l, row + 1, 1) = now(l, row + 1, 1) &
                                    + (weight(0, port, 1, r)*a &
                                       + (weight(1, port, 1, r)*b + weight(2, port, 1, r)*c))
               now(l, row + ports, plane) = now(l, row + ports, plane) &
                                            + (weight(0, port, 2, r)*a &
                                               + (weight(1, port, 2, r)*b &
                                                  + weight(2, port, 2, r)*c))
            end do
            do k = 3, last
               now(:, row + 1, 1) = now(:, row + 1, 1) &
                                    + weight(k, port, 1, r)*taken(:, row + port, k)
               now(:, row + ports, plane) = now(:, row + ports, plane) &
                                            + weight(k, port, 2, r)*taken(:, row + port, k)
            end do
         end do
      end do
   end subroutine take_motion

end module dynamics_exact_modal_steps
