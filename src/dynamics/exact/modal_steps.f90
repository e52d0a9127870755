!> Loops over modes and joints of eight samples side by side, for one part of a step in the modal
!> form. Sums of four rows stay in registers.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_modal_operators, only: four, modal_operators
   use dynamics_exact_modal_terms, only: groups, lanes
   implicit none(type, external)
   private
   public :: multiply, push_motion, read_paths, rotate_modes, rotate_pairs

contains

   !> Takes modes to the end of the part, one by one, and finds what their middle adds to the cubic
   !> through both ends, from the first mode on where that counts (M3), (M4).
   pure subroutine rotate_modes(rows, first_read, rotation, load, force, modes, middle)
      integer, intent(in) :: rows
      integer, intent(in) :: first_read(4)                 !! see modal_terms
      real(wp), intent(in), contiguous :: load(:, :)       !! (mode, force)
      real(wp), intent(in) :: rotation(4, 4, size(load, 1))   !! see modal_operators
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(inout) :: modes(lanes, rows, 3)     !! q, q', S z
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp), dimension(lanes) :: push, q, rise, v
      integer :: f, i, r

      do r = 1, size(load, 1)
         push = modes(:, r, 3) + load(r, 1)*force(:, 1, 0)
         rise = load(r, 1)*force(:, 1, 1)
         do f = 2, size(load, 2)
            push = push + load(r, f)*force(:, f, 0)
            rise = rise + load(r, f)*force(:, f, 1)
         end do
         q = modes(:, r, 1)
         v = modes(:, r, 2)
         do i = 1, 4
            if (i > 2 .and. r < first_read(i)) cycle
            if (i <= 2) then
               modes(:, r, i) = rotation(1, i, r)*q + (rotation(2, i, r)*v &
                                + (rotation(3, i, r)*push + rotation(4, i, r)*rise))
            else
               middle(:, r, i - 2) = rotation(1, i, r)*q + (rotation(2, i, r)*v &
                                     + (rotation(3, i, r)*push + rotation(4, i, r)*rise))
            end if
         end do
      end do
   end subroutine rotate_modes

   !> Does the same to blocks of two ports.
   pure subroutine rotate_pairs(rows, first_read, rotation, load, force, modes, middle)
      integer, intent(in) :: rows
      integer, intent(in) :: first_read(4)                 !! blocks, see modal_terms
      real(wp), intent(in), contiguous :: load(:, :)       !! (row, force)
      real(wp), intent(in) :: rotation(6, 6, size(load, 1)/2)   !! see modal_operators
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)   !! value and rise [N]
      real(wp), intent(inout) :: modes(lanes, rows, 2)     !! p, S z
      real(wp), intent(inout) :: middle(lanes, rows, 2)    !! see modal_form
      real(wp), dimension(lanes, 2) :: number, push, rise
      integer :: b, f, l, port, row

      do b = 1, size(load, 1)/2
         do port = 1, 2
            row = 2*b - 2 + port
            !$omp simd
            do l = 1, lanes
               number(l, port) = modes(l, row, 1)
               push(l, port) = modes(l, row, 2) + load(row, 1)*force(l, 1, 0)
               rise(l, port) = load(row, 1)*force(l, 1, 1)
            end do
            do f = 2, size(load, 2)
               push(:, port) = push(:, port) + load(row, f)*force(:, f, 0)
               rise(:, port) = rise(:, port) + load(row, f)*force(:, f, 1)
            end do
         end do
         do port = 1, 2
            row = 2*b - 2 + port
            call add_up(rotation(1, port, b), number, push, rise, modes(1, row, 1))
            if (b >= first_read(3)) &
               call add_up(rotation(1, 2 + port, b), number, push, rise, middle(1, row, 1))
            if (b >= first_read(4)) &
               call add_up(rotation(1, 4 + port, b), number, push, rise, middle(1, row, 2))
         end do
      end do
   end subroutine rotate_pairs

   pure subroutine add_up(factor, number, push, rise, total)
      real(wp), intent(in) :: factor(6)
      real(wp), intent(in), dimension(lanes, 2) :: number, push, rise
      real(wp), intent(inout) :: total(lanes)
      integer :: l

      !$omp simd
      do l = 1, lanes
         total(l) = (factor(1)*number(l, 1) + (factor(2)*number(l, 2) + factor(3)*push(l, 1))) &
                    + (factor(4)*push(l, 2) + (factor(5)*rise(l, 1) + factor(6)*rise(l, 2)))
      end do
   end subroutine add_up

   !> Finds y = A x.
   pure subroutine multiply(fours, columns, a, x, y)
      integer, intent(in) :: fours, columns
      real(wp), intent(in) :: a(four, columns, fours), x(lanes, columns)
      real(wp), intent(inout) :: y(lanes, four, fours)
      real(wp) :: total(lanes, four)
      integer :: i, l, q, r

      do q = 1, fours
         total = 0.0_wp
         do i = 1, columns
            do r = 1, four
               do l = 1, lanes
                  total(l, r) = total(l, r) + a(r, i, q)*x(l, i)
               end do
            end do
         end do
         y(:, :, q) = total
      end do
   end subroutine multiply

   !> Reads the free paths of joints, powers 2 .. 5 of the polynomial through values and slopes at 0
   !> and 1 and what the middle adds, from the first row on where that counts (M4):
   !> 16 e t^2 (1 - t)^2 by its value, 16 s t^2 (1 - t)^2 (t - 1/2) by its slope, which alone has
   !> power 5.
   pure subroutine read_paths(operators, joints, rows, modes, middle, x0, x1, x)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: joints, rows
      real(wp), intent(in) :: modes(lanes, rows, *), middle(lanes, rows, 2)   !! see modal_form
      real(wp), intent(in), dimension(lanes, groups, joints) :: x0, x1   !! u(0), u'(0)
      real(wp), intent(inout) :: x(lanes, groups, joints, 2:5)           !! (.., joint, power)
      real(wp), dimension(lanes, four) :: e, s, u, v
      real(wp) :: change, start
      integer :: i, j, l, ports, q, r

      ports = operators%blocks%ports
      associate (place => operators%reads(:, :, :, 1), &
                 velocity => operators%reads(:, :, :, ports), &
                 now => modes(:, :, 1), rate => modes(:, :, 3 - ports), n => operators%n_rows, &
                 first => ports*(operators%first_read(3:) - 1) + 1)
         do q = 1, size(place, 3)
            u = 0.0_wp
            v = 0.0_wp
            i = 1
            do   ! with the exit at the end: sums stay in registers
               do r = 1, four
                  do l = 1, lanes
                     u(l, r) = u(l, r) + place(r, i, q)*now(l, i)
                     v(l, r) = v(l, r) + velocity(r, i, q)*rate(l, i)
                  end do
               end do
               i = i + 1
               if (i > n) exit
            end do
            e = 0.0_wp
            do i = first(1), n
               do r = 1, four
                  do l = 1, lanes
                     e(l, r) = e(l, r) + place(r, i, q)*middle(l, i, 1)
                  end do
               end do
            end do
            s = 0.0_wp
            do i = first(2), n
               do r = 1, four
                  do l = 1, lanes
                     s(l, r) = s(l, r) + place(r, i, q)*middle(l, i, 2)
                  end do
               end do
            end do
            do r = 1, four
               j = four*(q - 1) + r
               !$omp simd private(change, start)
               do l = 1, lanes
                  change = u(l, r) - x0(l, 1, j)
                  start = x1(l, 1, j)
                  e(l, r) = e(l, r) - (operators%square/384.0_wp)*(v(l, r) - start)
                  x(l, 1, j, 2) = (3.0_wp*change - (2.0_wp*start + v(l, r))) &
                                  + (16.0_wp*e(l, r) - 8.0_wp*s(l, r))
                  x(l, 1, j, 3) = ((start + v(l, r)) - 2.0_wp*change) &
                                  + (32.0_wp*s(l, r) - 32.0_wp*e(l, r))
                  x(l, 1, j, 4) = 16.0_wp*e(l, r) - 40.0_wp*s(l, r)
                  x(l, 1, j, 5) = 16.0_wp*s(l, r)
               end do
            end do
         end do
      end associate
   end subroutine read_paths

   !> Gives the blocks at the end of the part the motion of the sliders (M6): of those listed, the
   !> others stand.
   pure subroutine push_motion(operators, moved, moments, keeps, rows, taken, modes)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: moved(:), rows
      real(wp), intent(in), contiguous :: moments(:, :, 0:)   !! (lane, joint, moment)
      logical, intent(in) :: keeps                            !! S I, for the ledger
      real(wp), intent(inout) :: taken(lanes, rows, 0:*)      !! S I (.., moment)
      real(wp), intent(inout) :: modes(lanes, rows, *)        !! see modal_form
      real(wp), dimension(lanes, four) :: a, b, c
      integer :: first, i, j, k, l, plane, ports, q, r, second

      if (keeps) taken(:, :, :operators%n_moments) = 0.0_wp
      if (size(moved) == 0) return
      ports = operators%blocks%ports
      plane = 3 - ports   ! of the second number; then that of S z
      associate (push => operators%push, weight => operators%weight)
         do q = 0, rows - four, four
            j = moved(1)
            do r = 1, four
               do l = 1, lanes
                  a(l, r) = push(q + r, j)*moments(l, j, 0)
                  b(l, r) = push(q + r, j)*moments(l, j, 1)
                  c(l, r) = push(q + r, j)*moments(l, j, 2)
               end do
            end do
            do i = 2, size(moved)
               j = moved(i)
               do r = 1, four
                  do l = 1, lanes
                     a(l, r) = a(l, r) + push(q + r, j)*moments(l, j, 0)
                     b(l, r) = b(l, r) + push(q + r, j)*moments(l, j, 1)
                     c(l, r) = c(l, r) + push(q + r, j)*moments(l, j, 2)
                  end do
               end do
            end do
            if (keeps) then
               taken(:, q + 1:q + four, 0) = a
               taken(:, q + 1:q + four, 1) = b
               taken(:, q + 1:q + four, 2) = c
            end if
            !GCC$ unroll 4
            do r = 1, four
               first = q + r - modulo(r - 1, ports)
               second = first + ports - 1
               !$omp simd
               do l = 1, lanes
                  modes(l, q + r, plane + 1) = modes(l, q + r, plane + 1) + a(l, r)
                  modes(l, first, 1) = modes(l, first, 1) &
                                       + (weight(0, 1, q + r)*a(l, r) &
                                          + (weight(1, 1, q + r)*b(l, r) &
                                             + weight(2, 1, q + r)*c(l, r)))
                  modes(l, second, plane) = modes(l, second, plane) &
                                            + (weight(0, 2, q + r)*a(l, r) &
                                               + (weight(1, 2, q + r)*b(l, r) &
                                                  + weight(2, 2, q + r)*c(l, r)))
               end do
            end do
            do k = 3, operators%n_moments
               a = 0.0_wp
               do i = 1, size(moved)
                  j = moved(i)
                  do r = 1, four
                     do l = 1, lanes
                        a(l, r) = a(l, r) + push(q + r, j)*moments(l, j, k)
                     end do
                  end do
               end do
               if (keeps) taken(:, q + 1:q + four, k) = a
               do r = 1, four
                  first = q + r - modulo(r - 1, ports)
                  second = first + ports - 1
                  !$omp simd
                  do l = 1, lanes
                     modes(l, first, 1) = modes(l, first, 1) + weight(k, 1, q + r)*a(l, r)
                     modes(l, second, plane) = modes(l, second, plane) + weight(k, 2, q + r)*a(l, r)
                  end do
               end do
            end do
         end do
      end associate
   end subroutine push_motion

end module dynamics_exact_modal_steps
