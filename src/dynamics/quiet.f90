!> Exact steps of many samples, one or two at once, and whether they were quiet: the innermost
!> kernel of the march, without a branch.
module dynamics_quiet
   use core_kinds, only: long, wp
   use dynamics_propagator, only: column_force, columns, longest_stride, width
   use dynamics_schedule, only: book_size, of_pattern, of_place, of_position
   implicit none(type, external)
   private
   public :: take_steps, find_slacks, kink_of, set_anchors, set_shift
   public :: sample_size, at_state, at_slider, at_reach, at_direction, at_anchor, at_slack

   !> All numbers of a sample, side by side: columns of sample(mass, :), each a vector of the
   !> masses.
   integer, parameter :: at_state = 1       !! to 4: x and u = h v, in two places, one in use
   integer, parameter :: at_slider = 5      !! [m]; kept for stuck masses
   integer, parameter :: at_reach = 6       !! mu N/k: extension at which the contact slips [m]
   integer, parameter :: at_direction = 7   !! 0: stuck, +1 or -1: slipping that way
   integer, parameter :: at_slack = 8       !! lower bound of the guard over the steps just taken
   integer, parameter :: at_anchor = 9      !! contact force over its stiffness, at x = 0 [m]
   integer, parameter :: at_shift = 10      !! and next: what the anchors add to x and u; per stride
   integer, parameter :: at_start = at_shift + 2*longest_stride   !! and next: that and more
   integer, parameter :: sample_size = at_start + 1

   integer, parameter :: written_out = 5   !! masses of the product in take_steps

contains

   !> Takes `stride` steps of every listed sample: the state after them, in the place that is not in
   !> use, and whether they were quiet. What follows from that is decided elsewhere, so that nothing
   !> here waits for the end of a product.
   pure subroutine take_steps(n, stride, n_listed, list, n_samples, n_forces, force, kink_scale, &
                              table, floor, book, sample, is_quiet)
      integer, intent(in) :: n, stride, n_listed, n_samples, n_forces, list(n_listed)
      real(wp), intent(in) :: force(0:n_forces - 1)   !! [N]
      real(wp), intent(in) :: kink_scale              !! h^2/m of the forced mass [m/N]
      real(wp), intent(in) :: table(width, 2, columns, 0:2**n - 1)   !! of the stride
      real(wp), intent(in) :: floor                   !! see bound_slack
      integer, intent(in) :: book(book_size, n_samples)
      real(wp), intent(inout) :: sample(width, sample_size, n_samples)
      integer, intent(out) :: is_quiet(n_listed)      !! 1 or 0
      integer, parameter :: f = column_force, v = width
      real(wp) :: begin, kink, middle, end, span
      integer(long) :: signs
      integer :: a, i, p, start, w, x0, x1

      start = at_shift + 2*(stride - 1)
      if (n > written_out) then
         call start_with_further_masses(n, start, n_listed, list, n_samples, table, book, sample)
         start = at_start
      end if
      span = stride
      do a = 1, n_listed
         w = list(a)
         p = book(of_pattern, w)
         begin = force(book(of_position, w))
         middle = force(book(of_position, w) + 1)
         end = force(book(of_position, w) + stride)
         kink = abs(kink_of(stride, begin, middle, end, kink_scale))
         x0 = at_state + 2*book(of_place, w)
         x1 = at_state + 2 - 2*book(of_place, w)
         ! 13 columns times 16 rows, in four independent sums each. A table for one step has zeros
         ! in the last column.
         !$omp simd
         do i = 1, width
            block
               real(wp) :: x, u
               x = ((sample(i, start, w) + table(i, 1, 1, p)*sample(1, x0, w) + &
                     table(i, 1, 2, p)*sample(2, x0, w)) + &
                    (table(i, 1, 3, p)*sample(3, x0, w) + table(i, 1, 4, p)*sample(4, x0, w) + &
                     table(i, 1, 5, p)*sample(5, x0, w))) + &
                   ((table(i, 1, v + 1, p)*sample(1, x0 + 1, w) + &
                     table(i, 1, v + 2, p)*sample(2, x0 + 1, w) + &
                     table(i, 1, v + 3, p)*sample(3, x0 + 1, w) + &
                     table(i, 1, v + 4, p)*sample(4, x0 + 1, w)) + &
                    (table(i, 1, v + 5, p)*sample(5, x0 + 1, w) + table(i, 1, f, p)*begin + &
                     table(i, 1, f + 1, p)*middle + table(i, 1, f + 2, p)*end))
               u = ((sample(i, start + 1, w) + table(i, 2, 1, p)*sample(1, x0, w) + &
                     table(i, 2, 2, p)*sample(2, x0, w)) + &
                    (table(i, 2, 3, p)*sample(3, x0, w) + table(i, 2, 4, p)*sample(4, x0, w) + &
                     table(i, 2, 5, p)*sample(5, x0, w))) + &
                   ((table(i, 2, v + 1, p)*sample(1, x0 + 1, w) + &
                     table(i, 2, v + 2, p)*sample(2, x0 + 1, w) + &
                     table(i, 2, v + 3, p)*sample(3, x0 + 1, w) + &
                     table(i, 2, v + 4, p)*sample(4, x0 + 1, w)) + &
                    (table(i, 2, v + 5, p)*sample(5, x0 + 1, w) + table(i, 2, f, p)*begin + &
                     table(i, 2, f + 1, p)*middle + table(i, 2, f + 2, p)*end))
               sample(i, at_slack, w) = bound_slack(floor, kink, sample(i, x0, w), &
                  span*sample(i, x0 + 1, w), x, span*u, sample(i, at_slider, w), &
                  sample(i, at_reach, w), sample(i, at_direction, w))
               sample(i, x1, w) = x
               sample(i, x1 + 1, w) = u
            end block
         end do
      end do
      do a = 1, n_listed
         w = list(a)
         signs = 0
         !$omp simd reduction(ior: signs)
         do i = 1, width
            signs = ior(signs, transfer(sample(i, at_slack, w), 0_long))
         end do
         is_quiet(a) = 1 - int(shiftr(signs, bit_size(signs) - 1))
      end do
   end subroutine take_steps

   !> What the masses that take_steps has not written out add to the anchors' part, and that.
   pure subroutine start_with_further_masses(n, shift, n_listed, list, n_samples, table, book, &
                                             sample)
      integer, intent(in) :: n, shift, n_listed, n_samples, list(n_listed)
      real(wp), intent(in) :: table(width, 2, columns, 0:2**n - 1)
      integer, intent(in) :: book(book_size, n_samples)
      real(wp), intent(inout) :: sample(width, sample_size, n_samples)
      real(wp) :: x(width), u(width)
      integer :: a, i, j, p, w, x0

      do a = 1, n_listed
         w = list(a)
         p = book(of_pattern, w)
         x0 = at_state + 2*book(of_place, w)
         x = sample(:, shift, w)
         u = sample(:, shift + 1, w)
         do j = written_out + 1, n
            !$omp simd
            do i = 1, width
               x(i) = x(i) + table(i, 1, j, p)*sample(j, x0, w) + &
                      table(i, 1, width + j, p)*sample(j, x0 + 1, w)
               u(i) = u(i) + table(i, 2, j, p)*sample(j, x0, w) + &
                      table(i, 2, width + j, p)*sample(j, x0 + 1, w)
            end do
         end do
         sample(:, at_start, w) = x
         sample(:, at_start + 1, w) = u
      end do
   end subroutine start_with_further_masses

   !> The bounds of the guards of one sample over the steps between its two places.
   pure subroutine find_slacks(stride, kink, floor, place, sample)
      integer, intent(in) :: stride, place
      real(wp), intent(in) :: kink, floor   !! see bound_slack
      real(wp), intent(inout) :: sample(width, sample_size)
      real(wp) :: bend, span
      integer :: i, x0, x1

      span = stride
      bend = abs(kink)
      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      !$omp simd
      do i = 1, width
         sample(i, at_slack) = bound_slack(floor, bend, sample(i, x0), span*sample(i, x0 + 1), &
                                           sample(i, x1), span*sample(i, x1 + 1), &
                                           sample(i, at_slider), sample(i, at_reach), &
                                           sample(i, at_direction))
      end do
   end subroutine find_slacks

   !> By how much the force bends between two steps, in units of displacement; 0 within one step.
   elemental function kink_of(stride, begin, middle, end, scale) result(kink)
      integer, intent(in) :: stride
      real(wp), intent(in) :: begin, middle, end   !! force [N]
      real(wp), intent(in) :: scale                !! h^2/m of the forced mass [m/N]
      real(wp) :: kink

      kink = (stride - 1)*scale*((begin - middle) + (end - middle))
   end function kink_of

   !> A lower bound of a mass's guard over a stretch from its ends; negative: a transition may lie
   !> inside. Velocities are per stretch.
   !>
   !> Displacement is taken as the cubic through both ends. Where it starts outwards it passes
   !> neither end by more than e/4, e = max|u - chord|; where it starts inwards it passes its start
   !> never, and its end by less than e/2. Velocity, the derivative, leaves its chord by 3/4 |u0 +
   !> u1 - 2 chord|; an eighth more, and `floor` times the reach, cover what a cubic leaves out.
   !> A force that bends in the middle takes the forced mass off its cubic by a 24th of `kink`, and
   !> its velocity by an 8th; others by less.
   elemental function bound_slack(floor, kink, x0, u0, x1, u1, centre, limit, way) result(bound)
      real(wp), intent(in) :: floor, kink, x0, u0, x1, u1, centre, limit, way
      real(wp) :: bound
      real(wp), parameter :: bulge = 0.5_wp, sag = 1.125_wp*0.75_wp
      real(wp), parameter :: kink_x = 1.0_wp/24.0_wp, kink_u = 1.0_wp/8.0_wp
      real(wp) :: chord, off0, off1, start, clear, stuck, slipping

      clear = floor*limit
      start = merge(abs(x0 - centre), 0.0_wp, (x0 - centre)*u0 > 0.0_wp)
      chord = x1 - x0
      off0 = u0 - chord
      off1 = u1 - chord
      stuck = ((limit - clear) - max(start, abs(x1 - centre))) - &
              (bulge*max(abs(off0), abs(off1)) + kink_x*kink)
      slipping = (min(way*u0, way*u1) - clear) - (sag*abs(off0 + off1) + kink_u*kink)
      bound = merge(slipping, stuck, abs(way) > 0.5_wp)
   end function bound_slack

   !> The anchors of a sample.
   pure subroutine set_anchors(sample)
      real(wp), intent(inout) :: sample(width, sample_size)
      integer :: i

      !$omp simd
      do i = 1, width
         sample(i, at_anchor) = merge(-sample(i, at_direction)*sample(i, at_reach), &
                                      sample(i, at_slider), abs(sample(i, at_direction)) > 0.5_wp)
      end do
   end subroutine set_anchors

   !> What its anchors add to every stretch while the pattern lasts.
   pure subroutine set_shift(n, stride, load, sample)
      integer, intent(in) :: n, stride
      real(wp), intent(in) :: load(width, 2, width)
      real(wp), intent(inout) :: sample(width, sample_size)
      real(wp) :: shift(width, 2)
      integer :: i, j

      shift = 0.0_wp
      do j = 1, n
         !$omp simd
         do i = 1, width
            shift(i, 1) = shift(i, 1) + load(i, 1, j)*sample(j, at_anchor)
            shift(i, 2) = shift(i, 2) + load(i, 2, j)*sample(j, at_anchor)
         end do
      end do
      sample(:, at_shift + 2*(stride - 1):at_shift + 2*stride - 1) = shift
   end subroutine set_shift

end module dynamics_quiet
