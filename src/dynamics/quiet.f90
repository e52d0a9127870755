!> Exact steps of many samples, several at once, and whether they were quiet: the innermost kernel
!> of the march, without a branch.
module dynamics_quiet
   use core_kinds, only: long, wp
   use dynamics_propagator, only: column_force, columns, width
   use dynamics_schedule, only: book_size, of_pattern, of_place, of_position
   use dynamics_workspace, only: at_direction, at_reach, at_slider, at_start, at_state, sample_size
   implicit none(type, external)
   private
   public :: take_steps, find_suspects, find_kinks, sum_kinks

   integer, parameter :: written_out = 5   !! masses of the product in take_steps

contains

   !> Takes a stretch of every listed sample: the state after it, in the place that is not in use,
   !> and the masses whose guard may have been crossed. What follows from that is decided elsewhere,
   !> so that nothing here waits for the end of a product.
   pure subroutine take_steps(n, stride, shift, n_listed, list, n_samples, n_forces, force, bend, &
                              table, floor, book, sample, suspects)
      integer, intent(in) :: n, stride, n_listed, n_samples, n_forces, list(n_listed)
      integer, intent(in) :: shift                    !! column of what the anchors add
      real(wp), intent(in) :: force(0:n_forces - 1)   !! [N]
      real(wp), intent(in) :: bend(0:n_forces - 1)    !! sum_kinks of the stretch from a position
      real(wp), intent(in) :: table(width, 2, columns, 0:2**n - 1)   !! of the stride
      real(wp), intent(in) :: floor                   !! see bound_slack
      integer, intent(in) :: book(book_size, n_samples)
      real(wp), intent(inout) :: sample(width, sample_size, n_samples)
      integer, intent(out) :: suspects(n_listed)      !! bit i-1: mass i
      integer, parameter :: f = column_force, v = width
      real(wp) :: f0, f1, f2, f3, f4, kink, span, z(width, 2)
      integer(long) :: negative
      integer :: a, half, i, p, start, w, x0, x1

      start = shift
      if (n > written_out) then
         call start_with_further_masses(n, shift, n_listed, list, n_samples, table, book, sample)
         start = at_start
      end if
      span = stride
      do a = 1, n_listed
         w = list(a)
         p = book(of_position, w)
         kink = bend(p)
         f0 = force(p)
         f1 = force(p + 1)
         f2 = force(p + min(2, stride))   ! a table for fewer steps has zeros in the last columns
         f3 = force(p + min(3, stride))
         f4 = force(p + stride)
         p = book(of_pattern, w)
         x0 = at_state + 2*book(of_place, w)
         x1 = at_state + 2 - 2*book(of_place, w)
         !GCC$ unroll 2
         do half = 1, 2   ! 15 columns in five independent sums
            !$omp simd
            do i = 1, width
               z(i, half) = &
                  ((sample(i, start + half - 1, w) + table(i, half, 1, p)*sample(1, x0, w) + &
                    table(i, half, 2, p)*sample(2, x0, w)) + &
                   (table(i, half, 3, p)*sample(3, x0, w) + &
                    table(i, half, 4, p)*sample(4, x0, w) + &
                    table(i, half, 5, p)*sample(5, x0, w))) + &
                  ((table(i, half, v + 1, p)*sample(1, x0 + 1, w) + &
                    table(i, half, v + 2, p)*sample(2, x0 + 1, w) + &
                    table(i, half, v + 3, p)*sample(3, x0 + 1, w)) + &
                   (table(i, half, v + 4, p)*sample(4, x0 + 1, w) + &
                    table(i, half, v + 5, p)*sample(5, x0 + 1, w) + table(i, half, f, p)*f0) + &
                   (table(i, half, f + 1, p)*f1 + table(i, half, f + 2, p)*f2 + &
                    table(i, half, f + 3, p)*f3 + table(i, half, f + 4, p)*f4))
            end do
         end do
         negative = 0
         !$omp simd reduction(ior: negative)
         do i = 1, width
            block
               real(wp) :: bound
               bound = bound_slack(floor, kink, sample(i, x0, w), span*sample(i, x0 + 1, w), &
                                   z(i, 1), span*z(i, 2), sample(i, at_slider, w), &
                                   sample(i, at_reach, w), sample(i, at_direction, w))
               negative = ior(negative, flag(i, bound))
               sample(i, x1, w) = z(i, 1)
               sample(i, x1 + 1, w) = z(i, 2)
            end block
         end do
         suspects(a) = int(negative)
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

   !> The masses whose guard may have been crossed in the stretch of one sample between its two
   !> places; bit i-1: mass i.
   pure function find_suspects(stride, bend, floor, place, sample) result(suspects)
      integer, intent(in) :: stride, place
      real(wp), intent(in) :: bend, floor   !! see bound_slack
      real(wp), intent(in) :: sample(width, sample_size)
      integer :: suspects
      integer(long) :: negative
      real(wp) :: span
      integer :: i, x0, x1

      span = stride
      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      negative = 0
      !$omp simd reduction(ior: negative)
      do i = 1, width
         block
            real(wp) :: bound
            bound = bound_slack(floor, bend, sample(i, x0), span*sample(i, x0 + 1), &
                                sample(i, x1), span*sample(i, x1 + 1), sample(i, at_slider), &
                                sample(i, at_reach), sample(i, at_direction))
            negative = ior(negative, flag(i, bound))
         end block
      end do
      suspects = int(negative)
   end function find_suspects

   !> Bit i-1 if a number is negative, by its sign bit, without a branch.
   elemental function flag(i, x)
      integer, intent(in) :: i
      real(wp), intent(in) :: x
      integer(long) :: flag
      integer(long), parameter :: bit(width) = [1_long, 2_long, 4_long, 8_long, 16_long, 32_long, &
                                                64_long, 128_long]

      flag = iand(bit(i), shifta(transfer(x, 0_long), 63))
   end function flag

   !> The kinks of the force at every position, by which they change the third derivative of the
   !> forced mass, per step cubed [m].
   pure subroutine find_kinks(force, scale, kink)
      real(wp), intent(in) :: force(0:)   !! [N]
      real(wp), intent(in) :: scale       !! h^2/m of the forced mass [m/N]
      real(wp), intent(out) :: kink(0:)
      integer :: last

      kink = 0.0_wp
      last = ubound(force, 1) - 1
      kink(1:last) = scale*((force(:last - 1) - force(1:last)) + (force(2:) - force(1:last)))
   end subroutine find_kinks

   !> The sum of the magnitudes of those within a stretch, per stretch cubed, for stretches from
   !> every position that has a whole one left.
   pure subroutine sum_kinks(stride, kink, bend)
      integer, intent(in) :: stride
      real(wp), intent(in) :: kink(0:)   !! [m]
      real(wp), intent(out) :: bend(0:)
      integer :: k, last

      bend = 0.0_wp
      last = ubound(kink, 1) - stride
      do k = 1, stride - 1
         bend(:last) = bend(:last) + stride**3*abs(kink(k:last + k))
      end do
   end subroutine sum_kinks

   !> A lower bound of a mass's guard over a stretch from its ends; negative: a transition may lie
   !> inside. Velocities are per stretch.
   !>
   !> Displacement is taken as the cubic through both ends. Where it starts outwards it passes
   !> neither end by more than e/4, e = max|u - chord|; where it starts inwards it passes its start
   !> never, and its end by less than e/2. Velocity, the derivative, leaves its chord by 3/4 |u0 +
   !> u1 - 2 chord|; an eighth more, and `floor` times the reach, cover what a cubic leaves out.
   !> A kink of the force takes the forced mass off its cubic by at most a 192nd of it, and its
   !> velocity by a 64th (in the middle; elsewhere, and others, by less).
   elemental function bound_slack(floor, kink, x0, u0, x1, u1, centre, limit, way) result(bound)
      real(wp), intent(in) :: floor, kink, x0, u0, x1, u1, centre, limit, way
      real(wp) :: bound
      real(wp), parameter :: bulge = 0.5_wp, sag = 1.125_wp*0.75_wp
      real(wp), parameter :: kink_x = 1.0_wp/192.0_wp, kink_u = 1.0_wp/64.0_wp
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

end module dynamics_quiet
