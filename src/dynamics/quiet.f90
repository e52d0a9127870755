!> Exact steps of many samples, several at once, and whether they were quiet: the innermost kernel
!> of the march, without a branch.
module dynamics_quiet
   use core_kinds, only: long, wp
   use dynamics_propagator, only: column_force, columns, width
   use dynamics_walker, only: walker_type
   implicit none(type, external)
   private
   public :: take_steps, find_suspects

   integer, parameter :: written_out = 5   !! masses of the product in take_steps

contains

   !> Takes a stretch of every listed sample: the state after it, in the place that is not in use,
   !> and the masses whose guard may have been crossed. What follows from that is decided elsewhere,
   !> so that nothing here waits for the end of a product.
   pure subroutine take_steps(n, stride, force, bend, table, floor, n_listed, list, n_samples, &
                              walker, suspects)
      integer, intent(in) :: n, stride, n_listed, n_samples, list(n_listed)
      real(wp), intent(in) :: force(0:*)              !! of the course, from each position on
      real(wp), intent(in) :: bend(0:*)
      real(wp), intent(in) :: table(width, 2, columns, 0:2**n - 1)   !! of the stride
      real(wp), intent(in) :: floor                   !! see bound_slack
      type(walker_type), intent(inout) :: walker(n_samples)
      integer, intent(out) :: suspects(n_listed)      !! bit i-1: mass i
      integer, parameter :: u = width, a = 2*width, f = column_force
      real(wp) :: kink, span, z(width, 2)
      integer(long) :: negative
      integer :: at, half, i, k, now, p, w

      if (n > written_out) call start_with_further_masses(n, table, n_listed, list, n_samples, &
                                                          walker)
      span = stride
      do k = 1, n_listed
         w = list(k)
         at = walker(w)%position
         kink = bend(at)
         p = walker(w)%pattern
         now = walker(w)%place
         !GCC$ unroll 2
         do half = 1, 2   ! 20 columns in six independent sums
            !$omp simd
            do i = 1, width
               z(i, half) = &
                  (((walker(w)%start(i, half) + table(i, half, a + 1, p)*walker(w)%anchor(1) + &
                     table(i, half, a + 2, p)*walker(w)%anchor(2)) + &
                    (table(i, half, a + 3, p)*walker(w)%anchor(3) + &
                     table(i, half, a + 4, p)*walker(w)%anchor(4) + &
                     table(i, half, a + 5, p)*walker(w)%anchor(5))) + &
                   (table(i, half, 1, p)*walker(w)%x(1, now) + &
                    table(i, half, 2, p)*walker(w)%x(2, now)) + &
                   (table(i, half, 3, p)*walker(w)%x(3, now) + &
                    table(i, half, 4, p)*walker(w)%x(4, now) + &
                    table(i, half, 5, p)*walker(w)%x(5, now))) + &
                  ((table(i, half, u + 1, p)*walker(w)%u(1, now) + &
                    table(i, half, u + 2, p)*walker(w)%u(2, now) + &
                    table(i, half, u + 3, p)*walker(w)%u(3, now)) + &
                   (table(i, half, u + 4, p)*walker(w)%u(4, now) + &
                    table(i, half, u + 5, p)*walker(w)%u(5, now) + &
                    table(i, half, f, p)*force(at)) + &
                   (table(i, half, f + 1, p)*force(at + 1) + &   ! a table for fewer steps
                    table(i, half, f + 2, p)*force(at + 2) + &   ! has zeros in the last
                    table(i, half, f + 3, p)*force(at + 3) + &
                    table(i, half, f + 4, p)*force(at + 4)))
            end do
         end do
         negative = 0
         !$omp simd reduction(ior: negative)
         do i = 1, width
            block
               real(wp) :: bound
               bound = bound_slack(floor, kink, walker(w)%x(i, now), span*walker(w)%u(i, now), &
                                   z(i, 1), span*z(i, 2), walker(w)%slider(i), &
                                   walker(w)%reach(i), walker(w)%direction(i))
               negative = ior(negative, flag(i, bound))
               walker(w)%x(i, 1 - now) = z(i, 1)
               walker(w)%u(i, 1 - now) = z(i, 2)
            end block
         end do
         suspects(k) = int(negative)
      end do
   end subroutine take_steps

   !> What the masses that take_steps has not written out add to the states.
   pure subroutine start_with_further_masses(n, table, n_listed, list, n_samples, walker)
      integer, intent(in) :: n, n_listed, n_samples, list(n_listed)
      real(wp), intent(in) :: table(width, 2, columns, 0:2**n - 1)
      type(walker_type), intent(inout) :: walker(n_samples)
      real(wp) :: x(width), u(width)
      integer :: i, j, k, now, p, w

      do k = 1, n_listed
         w = list(k)
         p = walker(w)%pattern
         now = walker(w)%place
         x = 0.0_wp
         u = 0.0_wp
         do j = written_out + 1, n
            !$omp simd
            do i = 1, width
               x(i) = x(i) + table(i, 1, j, p)*walker(w)%x(j, now) + &
                      table(i, 1, width + j, p)*walker(w)%u(j, now) + &
                      table(i, 1, 2*width + j, p)*walker(w)%anchor(j)
               u(i) = u(i) + table(i, 2, j, p)*walker(w)%x(j, now) + &
                      table(i, 2, width + j, p)*walker(w)%u(j, now) + &
                      table(i, 2, 2*width + j, p)*walker(w)%anchor(j)
            end do
         end do
         walker(w)%start(:, 1) = x
         walker(w)%start(:, 2) = u
      end do
   end subroutine start_with_further_masses

   !> The masses whose guard may have been crossed in the stretch of one sample between its two
   !> places; bit i-1: mass i.
   pure function find_suspects(stride, bend, floor, walker) result(suspects)
      integer, intent(in) :: stride
      real(wp), intent(in) :: bend, floor   !! see bound_slack
      type(walker_type), intent(in) :: walker
      integer :: suspects
      integer(long) :: negative
      real(wp) :: span
      integer :: i, now

      span = stride
      now = walker%place
      negative = 0
      !$omp simd reduction(ior: negative)
      do i = 1, width
         block
            real(wp) :: bound
            bound = bound_slack(floor, bend, walker%x(i, now), span*walker%u(i, now), &
                                walker%x(i, 1 - now), span*walker%u(i, 1 - now), &
                                walker%slider(i), walker%reach(i), walker%direction(i))
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
