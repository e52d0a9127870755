!> One exact step of one sample, and whether it was quiet: the innermost kernel of the march,
!> without a branch.
module dynamics_quiet
   use core_kinds, only: wp
   use dynamics_propagator, only: column_force, width
   implicit none(type, external)
   private
   public :: take_step, add_further_masses, written_out
   public :: sample_size, at_state, at_shift, at_slider, at_reach, at_direction, at_anchor, at_slack

   !> All numbers of a sample, side by side: columns of sample(mass, :), each a vector of the
   !> masses.
   integer, parameter :: at_state = 1       !! to 4: x and u = h v, in two places, one in use
   integer, parameter :: at_shift = 5       !! and 6: what the anchors add to x and u in each step
   integer, parameter :: at_slider = 7      !! [m]; kept for stuck masses
   integer, parameter :: at_reach = 8       !! mu N/k: extension at which the contact slips [m]
   integer, parameter :: at_direction = 9   !! 0: stuck, +1 or -1: slipping that way
   integer, parameter :: at_anchor = 10     !! contact force over its stiffness, at x = 0 [m]
   integer, parameter :: at_slack = 11      !! lower bound of the guard over the step just taken
   integer, parameter :: sample_size = 12

   integer, parameter :: written_out = 5   !! masses of the product in take_step

contains

   !> The state after a step, put in the place that is not in use, and the bounds of the guards: 12
   !> columns times 16 rows in four independent sums each.
   pure subroutine take_step(table, force, floor, place, start, sample)
      real(wp), intent(in) :: table(width, 2, 2*width + 2)   !! of the sample's pattern
      real(wp), intent(in) :: force(0:1)                     !! at both ends of the step [N]
      real(wp), intent(in) :: floor                          !! see bound_slack
      integer, intent(in) :: place
      real(wp), intent(in) :: start(width, 2)                !! the anchors' part, and whatever more
      real(wp), intent(inout) :: sample(width, sample_size)
      integer :: i, u0, u1, x0, x1

      x0 = at_state + 2*place
      u0 = x0 + 1
      x1 = at_state + 2 - 2*place
      u1 = x1 + 1
      !$omp simd
      do i = 1, width
         block
            real(wp) :: x, u
            x = ((start(i, 1) + table(i, 1, 1)*sample(1, x0) + table(i, 1, 2)*sample(2, x0)) + &
                 (table(i, 1, 3)*sample(3, x0) + table(i, 1, 4)*sample(4, x0) + &
                  table(i, 1, 5)*sample(5, x0))) + &
                ((table(i, 1, width + 1)*sample(1, u0) + table(i, 1, width + 2)*sample(2, u0) + &
                  table(i, 1, width + 3)*sample(3, u0) + table(i, 1, width + 4)*sample(4, u0)) + &
                 (table(i, 1, width + 5)*sample(5, u0) + &
                  table(i, 1, column_force)*force(0) + table(i, 1, column_force + 1)*force(1)))
            u = ((start(i, 2) + table(i, 2, 1)*sample(1, x0) + table(i, 2, 2)*sample(2, x0)) + &
                 (table(i, 2, 3)*sample(3, x0) + table(i, 2, 4)*sample(4, x0) + &
                  table(i, 2, 5)*sample(5, x0))) + &
                ((table(i, 2, width + 1)*sample(1, u0) + table(i, 2, width + 2)*sample(2, u0) + &
                  table(i, 2, width + 3)*sample(3, u0) + table(i, 2, width + 4)*sample(4, u0)) + &
                 (table(i, 2, width + 5)*sample(5, u0) + &
                  table(i, 2, column_force)*force(0) + table(i, 2, column_force + 1)*force(1)))
            sample(i, at_slack) = bound_slack(floor, sample(i, x0), sample(i, u0), x, u, &
                                              sample(i, at_slider), sample(i, at_reach), &
                                              sample(i, at_direction))
            sample(i, x1) = x
            sample(i, u1) = u
         end block
      end do
   end subroutine take_step

   !> Adds the columns of the masses that take_step has not written out.
   pure subroutine add_further_masses(n, table, x, u, start)
      integer, intent(in) :: n
      real(wp), intent(in) :: table(width, 2, 2*width + 2), x(width), u(width)
      real(wp), intent(inout) :: start(width, 2)
      integer :: i, j

      do j = written_out + 1, n
         !$omp simd
         do i = 1, width
            start(i, 1) = start(i, 1) + table(i, 1, j)*x(j) + table(i, 1, width + j)*u(j)
            start(i, 2) = start(i, 2) + table(i, 2, j)*x(j) + table(i, 2, width + j)*u(j)
         end do
      end do
   end subroutine add_further_masses

   !> A lower bound of a mass's guard over the step from its ends; negative: a transition may lie
   !> inside.
   !>
   !> Displacement is taken as the cubic through both ends. Where it starts outwards it passes
   !> neither end by more than e/4, e = max|u - chord|; where it starts inwards it passes its start
   !> never, and its end by less than e/2. Velocity, the derivative, leaves its chord by 3/4 |u0 +
   !> u1 - 2 chord|; an eighth more, and `floor` times the reach, cover what a cubic leaves out.
   elemental function bound_slack(floor, x0, u0, x1, u1, centre, limit, way) result(bound)
      real(wp), intent(in) :: floor, x0, u0, x1, u1, centre, limit, way
      real(wp) :: bound
      real(wp), parameter :: bulge = 0.5_wp, sag = 1.125_wp*0.75_wp
      real(wp) :: chord, off0, off1, start, clear, stuck, slipping

      clear = floor*limit
      start = merge(abs(x0 - centre), 0.0_wp, (x0 - centre)*u0 > 0.0_wp)
      chord = x1 - x0
      off0 = u0 - chord
      off1 = u1 - chord
      stuck = ((limit - clear) - max(start, abs(x1 - centre))) - bulge*max(abs(off0), abs(off1))
      slipping = (min(way*u0, way*u1) - clear) - sag*abs(off0 + off1)
      bound = merge(slipping, stuck, abs(way) > 0.5_wp)
   end function bound_slack

end module dynamics_quiet
