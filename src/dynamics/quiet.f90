!> One exact step of one sample, and whether it was quiet: the innermost kernel of the march, without a branch.
module dynamics_quiet
   use core_kinds, only: wp
   use dynamics_propagator, only: column_force, width
   implicit none(type, external)
   private
   public :: take_step, add_further_masses, written_out, regime_size
   public :: shift_x, shift_u, slider, reach, direction, anchor

   !> What a sample carries besides its state; columns of regime(mass, :).
   integer, parameter :: shift_x = 1, shift_u = 2   !! what the anchors add to each step
   integer, parameter :: slider = 3                 !! [m]; kept for stuck masses
   integer, parameter :: reach = 4                  !! mu N/k: extension at which the contact slips [m]
   integer, parameter :: direction = 5              !! 0: stuck, +1 or -1: slipping that way
   integer, parameter :: anchor = 6                 !! contact force over its stiffness, at x = 0 [m]
   integer, parameter :: regime_size = 6

   integer, parameter :: written_out = 5   !! masses of the product in take_step

contains

   !> The state after a step, 12 columns times 16 rows in four independent sums each, and the bounds of the guards.
   pure subroutine take_step(table, force0, force1, floor, shift, regime, from, to, slack)
      real(wp), intent(in) :: table(width, 2, 2*width + 2)   !! of the sample's pattern
      real(wp), intent(in) :: force0, force1                 !! at both ends of the step [N]
      real(wp), intent(in) :: floor                          !! see bound_slack
      real(wp), intent(in) :: shift(width, 2)                !! what is added: the anchors' part and whatever more
      real(wp), intent(in) :: regime(width, regime_size)
      real(wp), intent(in) :: from(width, 2)                 !! x, u = h v
      real(wp), intent(inout) :: to(width, 2)
      real(wp), intent(inout) :: slack(width)
      integer :: i

      !$omp simd
      do i = 1, width
         block
            real(wp) :: x, u
            x = ((shift(i, 1) + table(i, 1, 1)*from(1, 1) + table(i, 1, 2)*from(2, 1)) + &
                 (table(i, 1, 3)*from(3, 1) + table(i, 1, 4)*from(4, 1) + table(i, 1, 5)*from(5, 1))) + &
                ((table(i, 1, width + 1)*from(1, 2) + table(i, 1, width + 2)*from(2, 2) + &
                  table(i, 1, width + 3)*from(3, 2) + table(i, 1, width + 4)*from(4, 2)) + &
                 (table(i, 1, width + 5)*from(5, 2) + &
                  table(i, 1, column_force)*force0 + table(i, 1, column_force + 1)*force1))
            u = ((shift(i, 2) + table(i, 2, 1)*from(1, 1) + table(i, 2, 2)*from(2, 1)) + &
                 (table(i, 2, 3)*from(3, 1) + table(i, 2, 4)*from(4, 1) + table(i, 2, 5)*from(5, 1))) + &
                ((table(i, 2, width + 1)*from(1, 2) + table(i, 2, width + 2)*from(2, 2) + &
                  table(i, 2, width + 3)*from(3, 2) + table(i, 2, width + 4)*from(4, 2)) + &
                 (table(i, 2, width + 5)*from(5, 2) + &
                  table(i, 2, column_force)*force0 + table(i, 2, column_force + 1)*force1))
            to(i, 1) = x
            to(i, 2) = u
            slack(i) = bound_slack(floor, from(i, 1), from(i, 2), x, u, &
                                   regime(i, slider), regime(i, reach), regime(i, direction))
         end block
      end do
   end subroutine take_step

   !> Adds the columns of the masses that take_step has not written out.
   pure subroutine add_further_masses(n, table, from, shift)
      integer, intent(in) :: n
      real(wp), intent(in) :: table(width, 2, 2*width + 2), from(width, 2)
      real(wp), intent(inout) :: shift(width, 2)
      integer :: i, j

      do j = written_out + 1, n
         !$omp simd
         do i = 1, width
            shift(i, 1) = shift(i, 1) + table(i, 1, j)*from(j, 1) + table(i, 1, width + j)*from(j, 2)
            shift(i, 2) = shift(i, 2) + table(i, 2, j)*from(j, 1) + table(i, 2, width + j)*from(j, 2)
         end do
      end do
   end subroutine add_further_masses

   !> A lower bound of a mass's guard over the step from its ends; negative: a transition may lie inside.
   !>
   !> Displacement is taken as the cubic through both ends. Where it starts outwards it passes neither end by more
   !> than e/4, e = max|u - chord|; where it starts inwards it passes its start never, and its end by less than e/2.
   !> Velocity, the derivative, leaves its chord by 3/4 |u0 + u1 - 2 chord|; an eighth more, and `floor` times the
   !> reach, cover what a cubic leaves out.
   elemental function bound_slack(floor, x0, u0, x1, u1, slider, reach, direction) result(slack)
      real(wp), intent(in) :: floor, x0, u0, x1, u1, slider, reach, direction
      real(wp) :: slack
      real(wp), parameter :: bulge = 0.5_wp, sag = 1.125_wp*0.75_wp
      real(wp) :: chord, off0, off1, start, clear, stuck, slipping

      clear = floor*reach
      start = merge(abs(x0 - slider), 0.0_wp, (x0 - slider)*u0 > 0.0_wp)
      chord = x1 - x0
      off0 = u0 - chord
      off1 = u1 - chord
      stuck = ((reach - clear) - max(start, abs(x1 - slider))) - bulge*max(abs(off0), abs(off1))
      slipping = (min(direction*u0, direction*u1) - clear) - sag*abs(off0 + off1)
      slack = merge(slipping, stuck, abs(direction) > 0.5_wp)
   end function bound_slack

end module dynamics_quiet
