!> Loops over modes and joints of eight samples side by side, for one part of a step in the modal
!> form. Sums of four rows stay in registers.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_modal_operators, only: four, modal_operators
   use dynamics_exact_modal_terms, only: groups, lanes
   implicit none(type, external)
   private
   public :: multiply, push_motion, read_paths, rotate

contains

   !> Takes blocks to the end of the part, and finds what their middle adds to the cubic through
   !> both ends, from the first block on where that counts (M3), (M4). For a ledger also p' now.
   pure subroutine rotate(operators, rows, force, keeps, modes, middle, rates)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: rows
      real(wp), intent(in) :: force(lanes, operators%n_forces, 0:1)   !! value and rise [N]
      logical, intent(in) :: keeps                                    !! rates
      real(wp), intent(inout) :: modes(lanes, rows, *)    !! q, q', S z; or p, S z
      real(wp), intent(inout) :: middle(lanes, rows, 2)   !! see modal_form
      real(wp), intent(inout) :: rates(lanes, 2, *)       !! p' (.., number, block)
      integer :: first(3)   ! block whose p and p' at 1/2 and p' now are wanted

      first = [operators%first_read(3:), merge(1, operators%n_modes + 1, keeps)]
      associate (rotation => operators%rotation, load => operators%load)
         if (operators%blocks%ports == 1) then   ! constants make loops over numbers straight
            call rotate_blocks(1, rows, first, rotation, load, force, modes, middle, rates)
         else
            call rotate_blocks(2, rows, first, rotation, load, force, modes, middle, rates)
         end if
      end associate
   end subroutine rotate

   pure subroutine rotate_blocks(ports, rows, first, rotation, load, force, modes, middle, rates)
      integer, value :: ports
      integer, intent(in) :: rows, first(3)
      real(wp), intent(in), contiguous :: load(:, :)   !! (row, force)
      real(wp), intent(in) :: rotation(2 + 2*ports, 4 + 2*ports, size(load, 1)/ports)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)
      real(wp), intent(inout) :: modes(lanes, rows, 4 - ports), middle(lanes, rows, 2)
      real(wp), intent(inout) :: rates(lanes, 2, *)
      real(wp) :: now(lanes, 6)   ! both numbers, pushes and rises of the ports
      real(wp) :: total(lanes)
      integer :: b, f, i, k, port, row

      do b = 1, size(load, 1)/ports
         row = ports*(b - 1)
         now(:, 1) = modes(:, row + 1, 1)
         now(:, 2) = modes(:, row + ports, 3 - ports)
         do port = 1, ports
            associate (push => now(:, 2 + port), rise => now(:, 2 + ports + port))
               push = modes(:, row + port, 4 - ports) + load(row + port, 1)*force(:, 1, 0)
               rise = load(row + port, 1)*force(:, 1, 1)
               do f = 2, size(load, 2)
                  push = push + load(row + port, f)*force(:, f, 0)
                  rise = rise + load(row + port, f)*force(:, f, 1)
               end do
            end associate
         end do
         do i = 1, 4 + 2*ports
            if (i > 2 .and. i <= 2 + ports .and. b < first(1)) cycle
            if (i > 2 + ports .and. i <= 2 + 2*ports .and. b < first(2)) cycle
            if (i > 2 + 2*ports .and. b < first(3)) exit
            total = rotation(1, i, b)*now(:, 1)
            do k = 2, 2 + 2*ports
               total = total + rotation(k, i, b)*now(:, k)
            end do
            if (i == 1) then
               modes(:, row + 1, 1) = total
            else if (i == 2) then
               modes(:, row + ports, 3 - ports) = total
            else if (i <= 2 + ports) then
               middle(:, row + i - 2, 1) = total
            else if (i <= 2 + 2*ports) then
               middle(:, row + i - 2 - ports, 2) = total
            else
               rates(:, i - 2 - 2*ports, b) = total
            end if
         end do
      end do
   end subroutine rotate_blocks

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
   !> others stand. The sums of three moments of four rows stay in registers.
   pure subroutine push_motion(operators, moved, moments, keeps, rows, taken, modes)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: moved(:), rows
      real(wp), intent(in), contiguous :: moments(:, :, 0:)   !! (lane, joint, moment)
      logical, intent(in) :: keeps                            !! S I, for the ledger
      real(wp), intent(inout) :: taken(lanes, rows, 0:*)      !! S I (.., moment)
      real(wp), intent(inout) :: modes(lanes, rows, *)        !! see modal_form
      real(wp), dimension(lanes, four) :: a, b, c
      real(wp) :: shift   ! of the base, by the first of them
      integer :: first, i, j, k, l, plane, ports, q, r, second

      if (keeps) taken(:, :, :operators%n_moments) = 0.0_wp
      if (size(moved) == 0) return
      ports = operators%blocks%ports
      plane = 3 - ports   ! of the second number; then that of S z
      shift = 1.0_wp
      associate (push => operators%push, weight => operators%weight)
         do k = 0, operators%n_moments, 3
            do q = 0, rows - four, four
               a = 0.0_wp
               b = 0.0_wp
               c = 0.0_wp
               i = 1
               do   ! with the exit at the end: sums stay in registers
                  j = moved(i)
                  do r = 1, four
                     do l = 1, lanes
                        a(l, r) = a(l, r) + push(q + r, j)*moments(l, j, k)
                        b(l, r) = b(l, r) + push(q + r, j)*moments(l, j, k + 1)
                        c(l, r) = c(l, r) + push(q + r, j)*moments(l, j, k + 2)
                     end do
                  end do
                  i = i + 1
                  if (i > size(moved)) exit
               end do
               if (keeps) then
                  taken(:, q + 1:q + four, k) = a
                  taken(:, q + 1:q + four, k + 1) = b
                  taken(:, q + 1:q + four, k + 2) = c
               end if
               !GCC$ unroll 4
               do r = 1, four
                  first = q + r - modulo(r - 1, ports)
                  second = first + ports - 1
                  !$omp simd
                  do l = 1, lanes
                     modes(l, q + r, plane + 1) = modes(l, q + r, plane + 1) + shift*a(l, r)
                     modes(l, first, 1) = modes(l, first, 1) &
                                          + (weight(k, 1, q + r)*a(l, r) &
                                             + (weight(k + 1, 1, q + r)*b(l, r) &
                                                + weight(k + 2, 1, q + r)*c(l, r)))
                     modes(l, second, plane) = modes(l, second, plane) &
                                               + (weight(k, 2, q + r)*a(l, r) &
                                                  + (weight(k + 1, 2, q + r)*b(l, r) &
                                                     + weight(k + 2, 2, q + r)*c(l, r)))
                  end do
               end do
            end do
            shift = 0.0_wp
         end do
      end associate
   end subroutine push_motion

end module dynamics_exact_modal_steps
