!> Kernels of the modal form for one part of a step: loops over modes and joints of eight samples
!> side by side. The sums of a strip of four rows stay in registers.
module dynamics_exact_modal_steps
   use core_kinds, only: wp
   use dynamics_exact_modal_operators, only: strip, modal_operators
   use dynamics_exact_modal_terms, only: groups, lanes
   implicit none(type, external)
   private
   public :: multiply_strips, add_slider_motion, find_paths, advance_blocks

contains

   !> Advances all blocks to the end of the part (M3), and finds what they add to the cubic through
   !> both ends at its midpoint, from the first block that matters (M4). For a ledger also finds p'
   !> at the start.
   pure subroutine advance_blocks(operators, rows, force, with_ledger, modes, midpoint, rates)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: rows
      real(wp), intent(in) :: force(lanes, operators%n_forces, 0:1)   !! value and rise [N]
      logical, intent(in) :: with_ledger                  !! True: finds rates
      real(wp), intent(inout) :: modes(lanes, rows, *)    !! q, q', S z; or p, S z
      real(wp), intent(inout) :: midpoint(lanes, rows, 2)   !! see modal_form
      real(wp), intent(inout) :: rates(lanes, 2, *)       !! p' (.., number, block)
      integer :: first(3)   ! first blocks whose p at 1/2, p' at 1/2 and p' at 0 are wanted

      first = [operators%first_midpoint, merge(1, operators%n_modes + 1, with_ledger)]
      associate (propagator => operators%propagator, load => operators%load)
         if (operators%blocks%ports == 1) then   ! a constant unrolls the loops over a block
            call advance_ports(1, rows, first, propagator, load, force, modes, midpoint, rates)
         else
            call advance_ports(2, rows, first, propagator, load, force, modes, midpoint, rates)
         end if
      end associate
   end subroutine advance_blocks

   !> See advance_blocks.
   pure subroutine advance_ports(ports, rows, first, propagator, load, force, modes, midpoint, &
                                 rates)
      integer, value :: ports
      integer, intent(in) :: rows, first(3)
      real(wp), intent(in), contiguous :: load(:, :)   !! (row, force)
      real(wp), intent(in) :: propagator(2 + 2*ports, 4 + 2*ports, size(load, 1)/ports)
      real(wp), intent(in) :: force(lanes, size(load, 2), 0:1)
      real(wp), intent(inout) :: modes(lanes, rows, 4 - ports), midpoint(lanes, rows, 2)
      real(wp), intent(inout) :: rates(lanes, 2, *)
      real(wp) :: now(lanes, 6)   ! p of the block, forces and rises of its ports
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
            total = propagator(1, i, b)*now(:, 1)
            do k = 2, 2 + 2*ports
               total = total + propagator(k, i, b)*now(:, k)
            end do
            if (i == 1) then
               modes(:, row + 1, 1) = total
            else if (i == 2) then
               modes(:, row + ports, 3 - ports) = total
            else if (i <= 2 + ports) then
               midpoint(:, row + i - 2, 1) = total
            else if (i <= 2 + 2*ports) then
               midpoint(:, row + i - 2 - ports, 2) = total
            else
               rates(:, i - 2 - 2*ports, b) = total
            end if
         end do
      end do
   end subroutine advance_ports

   !> Finds y = A x, A by strips of rows.
   pure subroutine multiply_strips(n_strips, columns, a, x, y)
      integer, intent(in) :: n_strips, columns
      real(wp), intent(in) :: a(strip, columns, n_strips), x(lanes, columns)
      real(wp), intent(inout) :: y(lanes, strip, n_strips)
      real(wp) :: total(lanes, strip)
      integer :: i, q, r

      do q = 1, n_strips
         total = 0.0_wp
         do i = 1, columns
            do r = 1, strip
               total(:, r) = total(:, r) + a(r, i, q)*x(:, i)
            end do
         end do
         y(:, :, q) = total
      end do
   end subroutine multiply_strips

   !> Finds powers 2 .. 5 of the joints' free paths (M4): the cubic through values and slopes at 0
   !> and 1, and what the midpoint adds, 16 e t^2 (1 - t)^2 by its value and 16 s t^2 (1 - t)^2
   !> (t - 1/2) by its slope, which alone has power 5.
   pure subroutine find_paths(operators, joints, rows, force, modes, midpoint, x0, x1, x)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: joints, rows
      real(wp), intent(in) :: force(lanes, operators%n_forces, 0:1)   !! value and rise [N]
      real(wp), intent(in) :: modes(lanes, rows, *), midpoint(lanes, rows, 2)   !! see modal_form
      real(wp), intent(in), dimension(lanes, groups, joints) :: x0, x1   !! u(0), u'(0)
      real(wp), intent(inout) :: x(lanes, groups, joints, 2:5)           !! (.., joint, power)
      real(wp), dimension(lanes, strip) :: e, s, u, v
      real(wp), dimension(lanes) :: change, start
      integer :: i, j, ports, q, r

      ports = operators%blocks%ports
      associate (place => operators%outputs(:, :, :, 1), &
                 velocity => operators%outputs(:, :, :, ports), &
                 now => modes(:, :, 1), rate => modes(:, :, 3 - ports), n => operators%n_rows, &
                 first => ports*(operators%first_midpoint - 1) + 1)
         do q = 1, size(place, 3)
            u = 0.0_wp
            v = 0.0_wp
            i = 1
            do   ! with the exit at the end: sums stay in registers
               do r = 1, strip
                  u(:, r) = u(:, r) + place(r, i, q)*now(:, i)
                  v(:, r) = v(:, r) + velocity(r, i, q)*rate(:, i)
               end do
               i = i + 1
               if (i > n) exit
            end do
            e = 0.0_wp
            s = 0.0_wp
            do i = 1, operators%n_forces
               do r = 1, strip
                  e(:, r) = e(:, r) + operators%rise(r, i, q, 1)*force(:, i, 1)
                  s(:, r) = s(:, r) + operators%rise(r, i, q, 2)*force(:, i, 1)
               end do
            end do
            do i = first(1), n
               do r = 1, strip
                  e(:, r) = e(:, r) + place(r, i, q)*midpoint(:, i, 1)
               end do
            end do
            do i = first(2), n
               do r = 1, strip
                  s(:, r) = s(:, r) + place(r, i, q)*midpoint(:, i, 2)
               end do
            end do
            do r = 1, strip
               j = strip*(q - 1) + r
               change = u(:, r) - x0(:, 1, j)
               start = x1(:, 1, j)
               e(:, r) = e(:, r) - (operators%square/384.0_wp)*(v(:, r) - start)
               x(:, 1, j, 2) = (3.0_wp*change - (2.0_wp*start + v(:, r))) &
                               + (16.0_wp*e(:, r) - 8.0_wp*s(:, r))
               x(:, 1, j, 3) = ((start + v(:, r)) - 2.0_wp*change) &
                               + (32.0_wp*s(:, r) - 32.0_wp*e(:, r))
               x(:, 1, j, 4) = 16.0_wp*e(:, r) - 40.0_wp*s(:, r)
               x(:, 1, j, 5) = 16.0_wp*s(:, r)
            end do
         end do
      end associate
   end subroutine find_paths

   !> Adds the motion of the listed sliders to the blocks at the end of the part (M6). The sums of
   !> three moments of a strip of rows stay in registers.
   pure subroutine add_slider_motion(operators, moving, moments, with_ledger, rows, &
                                     slider_moments, modes)
      type(modal_operators), intent(in) :: operators
      integer, intent(in) :: moving(:), rows
      real(wp), intent(in), contiguous :: moments(:, :, 0:)   !! (lane, joint, moment)
      logical, intent(in) :: with_ledger                      !! True: finds slider_moments
      real(wp), intent(inout) :: slider_moments(lanes, rows, 0:*)   !! S I (lane, row, moment)
      real(wp), intent(inout) :: modes(lanes, rows, *)        !! see modal_form
      real(wp), dimension(lanes, strip) :: a, b, c
      real(wp) :: shift   ! 1 for I_0, which changes S z; else 0
      integer :: first, i, j, k, l, plane, ports, q, r, second

      if (with_ledger) slider_moments(:, :, :operators%n_moments) = 0.0_wp
      if (size(moving) == 0) return
      ports = operators%blocks%ports
      plane = 3 - ports   ! plane of the second variable; the next is that of S z
      shift = 1.0_wp
      associate (push => operators%push, weight => operators%weight)
         do k = 0, operators%n_moments, 3
            do q = 0, rows - strip, strip
               a = 0.0_wp
               b = 0.0_wp
               c = 0.0_wp
               i = 1
               do   ! with the exit at the end: sums stay in registers
                  j = moving(i)
                  do r = 1, strip
                     a(:, r) = a(:, r) + push(q + r, j)*moments(:lanes, j, k)
                     b(:, r) = b(:, r) + push(q + r, j)*moments(:lanes, j, k + 1)
                     c(:, r) = c(:, r) + push(q + r, j)*moments(:lanes, j, k + 2)
                  end do
                  i = i + 1
                  if (i > size(moving)) exit
               end do
               if (with_ledger) then
                  slider_moments(:, q + 1:q + strip, k) = a
                  slider_moments(:, q + 1:q + strip, k + 1) = b
                  slider_moments(:, q + 1:q + strip, k + 2) = c
               end if
               !GCC$ unroll 4
               do r = 1, strip
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
   end subroutine add_slider_motion

end module dynamics_exact_modal_steps
