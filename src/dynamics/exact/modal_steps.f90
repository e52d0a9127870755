!> Loops over modes and joints of eight samples side by side, for one part of a step in the modal
!> form.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_modal_sliders, only: groups, lanes
   use numerics_dense_product, only: packed_matrix
   implicit none(type, external)
   private
   public :: rows_ahead
   public :: put_free_paths, put_load, put_rest, rotate, take_motion

   !> Rows of numbers later in the part, from those of all modes at its start.
   type :: rows_ahead
      type(packed_matrix) :: from            !! from q, q', f(0)
      real(wp), allocatable :: rise(:, :)    !! (row, force) from f'
   contains
      procedure :: find
   end type rows_ahead

contains

   !> Finds the rows.
   pure subroutine find(self, now, force, y)
      class(rows_ahead), intent(in) :: self
      real(wp), intent(in) :: now(lanes, *)                    !! q, q', f(0) (mode)
      real(wp), intent(in) :: force(lanes, size(self%rise, 2), 0:1)   !! value and rise [N]
      real(wp), intent(inout) :: y(lanes, *)                   !! (.., padded row)
      integer :: f, row

      call self%from%multiply(now, y)
      do f = 1, size(self%rise, 2)
         do row = 1, size(self%rise, 1)
            y(:, row) = y(:, row) + force(:, f, 1)*self%rise(row, f)
         end do
      end do
   end subroutine find

   !> Puts f(0) = S z + h^2 Phi' b F.
   pure subroutine put_load(rows, load, force, pushed, push)
      integer, intent(in) :: rows
      real(wp), intent(in) :: load(:, :)                         !! (mode, force)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: pushed(lanes, rows)                !! S z
      real(wp), intent(inout) :: push(lanes, rows)
      integer :: f, r

      do r = 1, size(load, 1)
         push(:, r) = pushed(:, r)
         do f = 1, size(load, 2)
            push(:, r) = push(:, r) + load(r, f)*force(:, f, 0)
         end do
      end do
   end subroutine put_load

   !> Takes the modes ahead, one by one: the end of the part, and what its middle adds to the cubic
   !> through both ends, from the first mode on where that counts (M3), (M4).
   pure subroutine rotate(rows, first_read, rotation, load, force, now, pushed, ahead)
      integer, intent(in) :: rows
      integer, intent(in) :: first_read(3:4)               !! modes, see modal_terms
      real(wp), intent(in), contiguous :: rotation(:, :, :)   !! (entry, row of ahead, mode)
      real(wp), intent(in), contiguous :: load(:, :)          !! (mode, force)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(in) :: now(lanes, rows, 2)          !! q, q'
      real(wp), intent(in) :: pushed(lanes, rows)          !! S z
      real(wp), intent(inout) :: ahead(lanes, rows, 4)     !! q, q' at 1; see modal_operators
      real(wp) :: push, rise
      integer :: f, i, l, r

      do r = 1, size(load, 1)
         !$omp simd private(push, rise)
         do l = 1, lanes
            push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
            rise = load(r, 1)*force(l, 1, 1)
            ahead(l, r, 1) = (rotation(1, 1, r)*now(l, r, 1) + rotation(2, 1, r)*now(l, r, 2)) &
                             + (rotation(3, 1, r)*push + rotation(4, 1, r)*rise)
            ahead(l, r, 2) = (rotation(1, 2, r)*now(l, r, 1) + rotation(2, 2, r)*now(l, r, 2)) &
                             + (rotation(3, 2, r)*push + rotation(4, 2, r)*rise)
         end do
         do i = 3, 4
            if (r < first_read(i)) exit
            !$omp simd private(push, rise)
            do l = 1, lanes
               push = pushed(l, r) + load(r, 1)*force(l, 1, 0)
               rise = load(r, 1)*force(l, 1, 1)
               ahead(l, r, i) = (rotation(1, i, r)*now(l, r, 1) + rotation(2, i, r)*now(l, r, 2)) &
                                + (rotation(3, i, r)*push + rotation(4, i, r)*rise)
            end do
         end do
         do f = 2, size(load, 2)
            do i = 1, 4
               ahead(:, r, i) = ahead(:, r, i) + load(r, f)*(rotation(3, i, r)*force(:, f, 0) &
                                                             + rotation(4, i, r)*force(:, f, 1))
            end do
         end do
      end do
   end subroutine rotate

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

   !> Gives the modes at the end of the part the motion of the sliders (M6).
   pure subroutine take_motion(rows, weight, ahead, taken, now, pushed)
      integer, intent(in) :: rows
      real(wp), intent(in), contiguous :: weight(0:, :, :)   !! (moment, q or q', mode)
      real(wp), intent(in) :: ahead(lanes, rows, 2)
      real(wp), intent(in) :: taken(lanes, rows, 0:ubound(weight, 1))   !! S I
      real(wp), intent(inout) :: now(lanes, rows, 2)
      real(wp), intent(inout) :: pushed(lanes, rows)         !! S z
      integer :: i, k, l, r

      do r = 1, size(weight, 3)
         !$omp simd
         do l = 1, lanes
            now(l, r, 1) = (ahead(l, r, 1) + weight(0, 1, r)*taken(l, r, 0)) &
                           + (weight(1, 1, r)*taken(l, r, 1) + weight(2, 1, r)*taken(l, r, 2))
            now(l, r, 2) = (ahead(l, r, 2) + weight(0, 2, r)*taken(l, r, 0)) &
                           + (weight(1, 2, r)*taken(l, r, 1) + weight(2, 2, r)*taken(l, r, 2))
            pushed(l, r) = pushed(l, r) + taken(l, r, 0)
         end do
         do k = 3, ubound(weight, 1)
            do i = 1, 2
               now(:, r, i) = now(:, r, i) + weight(k, i, r)*taken(:, r, k)
            end do
         end do
      end do
   end subroutine take_motion

   !> Adds of the sliders' motion to the modes at the end, less those of the uniform motion to its
   !> end: what take_motion adds less what f' = S zeta(1) does.
   pure subroutine put_rest(rows, weight, rotation, taken, rest)
      integer, intent(in) :: rows
      real(wp), intent(in) :: weight(0:, :, :)       !! (moment, q or q', mode)
      real(wp), intent(in) :: rotation(:, :, :)      !! (entry, row, mode)
      real(wp), intent(in) :: taken(lanes, rows, 0:ubound(weight, 1))   !! S I
      real(wp), intent(inout) :: rest(lanes, rows, 2)                   !! q, q'
      integer :: i, k, r

      do i = 1, 2
         do r = 1, size(weight, 3)
            rest(:, r, i) = (weight(0, i, r) - rotation(4, i, r))*taken(:, r, 0)
            do k = 1, ubound(weight, 1)
               rest(:, r, i) = rest(:, r, i) + weight(k, i, r)*taken(:, r, k)
            end do
         end do
      end do
   end subroutine put_rest

end module dynamics_exact_modal_steps
