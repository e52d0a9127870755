!> One part of a step of 32 samples without transitions: the powers of all paths, their ends, and
!> the joints whose guards may have a zero on the way.
!>
!> Loops over lanes have constant length. All data begins at multiples of 64 bytes.
module dynamics_exact_free_steps
   use core_kinds, only: long, wp
   use dynamics_exact_joint_paths, only: joint_paths, layer_reach, layer_side, layer_slider, width
   use dynamics_exact_powers, only: next_power
   use dynamics_exact_series, only: series_type
   implicit none(type, external)
   private
   public :: expand_block, finish_part, follow_links

   integer, private :: b   ! of the constructor that follows
   integer(long), parameter :: bit(width) = [(shiftl(1_long, b), b=0, width - 1)]
   !> Guards within this share of the reach count as suspect (5)
   real(wp), parameter :: margin = 1.0e-6_wp

contains

   !> Powers 2 .. P of all rows.
   subroutine expand_block(series, push, paths)
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: push(:, :, 0:)   !! (lane, loaded dof, power) force now and its rise
      type(joint_paths), intent(inout) :: paths
      integer :: i, k

      do k = 0, series%degree - 2
         call step_power(size(paths%x, 2), series, k, paths%layer(k), paths%layer(k + 1), &
                         ubound(paths%x, 3), paths%x, paths%stiffness)
         associate (x => paths%x)
            if (k == 0) x(:, :series%n_dof, 2) = x(:, :series%n_dof, 2) &
                                                 + 0.5_wp*paths%pull(:, :series%n_dof)
            if (series%n_links > 0) call push_links(series, k, paths)
            if (k <= 1) then
               do i = 1, size(series%loaded)
                  associate (dof => series%loaded(i))
                     x(:, dof, k + 2) = x(:, dof, k + 2) &
                                        + (1.0_wp/((k + 1)*(k + 2)))*push(:, i, k)
                  end associate
               end do
            end if
            call follow_links(series, x(:, :, k + 2))
         end associate
      end do
   end subroutine expand_block

   !> Gives layers of one array to next_power as arrays of their own, which do not overlap.
   subroutine step_power(top, series, k, now, next, last, x, stiffness)
      integer, intent(in) :: top, k, now, next, last   !! rows; power; layers
      type(series_type), intent(in) :: series
      real(wp), intent(inout) :: x(width, top, 0:last)
      real(wp), intent(in) :: stiffness(width, top)

      call next_power(top, series%springs, series%damping(k), -1.0_wp/((k + 1)*(k + 2)), &
                      x(1, 1, now), x(1, 1, next), stiffness, x(1, 1, k + 2))
   end subroutine step_power

   !> Adds the forces of the links to x_(k+2) of the dofs that they join.
   subroutine push_links(series, k, paths)
      type(series_type), intent(in) :: series
      integer, intent(in) :: k
      type(joint_paths), intent(inout) :: paths
      real(wp) :: force(width)
      integer :: e, g, row

      do g = 1, series%n_links
         row = series%n_padded + g
         force = paths%stiffness(:, row)*paths%x(:, row, paths%layer(k))
         if (k == 0) force = force - paths%pull(:, row)
         force = force*(1.0_wp/((k + 1)*(k + 2)))
         do e = series%first_end(g), series%first_end(g + 1) - 1
            associate (x => paths%x(:, series%end_dof(e), k + 2))
               x = x - series%mobility(e)*force
            end associate
         end do
      end do
   end subroutine push_links

   !> Paths of the links from those of the dofs, one power.
   subroutine follow_links(series, x)
      type(series_type), intent(in) :: series
      real(wp), intent(inout), contiguous :: x(:, :)   !! (lane, row)
      real(wp) :: path(width)
      integer :: e, g

      do g = 1, series%n_links
         path = 0.0_wp
         do e = series%first_end(g), series%first_end(g + 1) - 1
            path = path + series%direction(e)*x(:, series%end_dof(e))
         end do
         x(:, series%n_padded + g) = path
      end do
   end subroutine follow_links

   !> Ends of all paths, and a list of the suspects: joints whose guards may have a zero, as
   !> 32 (joint - 1) + lane.
   !>
   !> A path leaves its chord by at most max |x''|/8 <= sum k (k - 1)/8 |x_k|, a velocity by sum k
   !> (k - 1)(k - 2)/8 |x_k| (3); the guards of the chords have their least values at its ends.
   subroutine finish_part(paths, list, found)
      type(joint_paths), intent(inout) :: paths
      integer, intent(inout) :: list(:)
      integer, intent(out) :: found
      real(wp), dimension(width) :: bend, path, turn, velocity
      real(wp) :: clear_of_limit, clear_of_zero, least, offset, reach, side
      integer(long) :: word
      integer :: e, i, j, k, l

      found = 0
      associate (x => paths%x, regime => paths%regime, start => paths%layer(0), &
                 speed => paths%layer(1))
         do i = 1, paths%n_rows
            do l = 1, width
               path(l) = x(l, i, 5) + x(l, i, 6)
               velocity(l) = 5.0_wp*x(l, i, 5) + 6.0_wp*x(l, i, 6)
               bend(l) = 2.5_wp*abs(x(l, i, 5)) + 3.75_wp*abs(x(l, i, 6))
               turn(l) = 7.5_wp*abs(x(l, i, 5)) + 15.0_wp*abs(x(l, i, 6))
            end do
            do k = 7, paths%degree
               do l = 1, width
                  path(l) = path(l) + x(l, i, k)
                  velocity(l) = velocity(l) + k*x(l, i, k)
                  bend(l) = bend(l) + 0.125_wp*k*(k - 1)*abs(x(l, i, k))
                  turn(l) = turn(l) + 0.125_wp*k*(k - 1)*(k - 2)*abs(x(l, i, k))
               end do
            end do
            do l = 1, width
               path(l) = x(l, i, 2) + (x(l, i, 3) + (x(l, i, 4) + path(l)))
               path(l) = x(l, i, start) + (x(l, i, speed) + path(l))
               velocity(l) = 3.0_wp*x(l, i, 3) + (4.0_wp*x(l, i, 4) + velocity(l))
               velocity(l) = x(l, i, speed) + (2.0_wp*x(l, i, 2) + velocity(l))
               bend(l) = 0.75_wp*abs(x(l, i, 3)) + (1.5_wp*abs(x(l, i, 4)) + bend(l))
               bend(l) = 0.25_wp*abs(x(l, i, 2)) + bend(l)
               turn(l) = 0.75_wp*abs(x(l, i, 3)) + (3.0_wp*abs(x(l, i, 4)) + turn(l))
            end do
            do e = paths%first(i), paths%first(i + 1) - 1
               j = paths%joint(e)
               word = 0
               do l = 1, width
                  side = regime(l, j, layer_side)
                  reach = regime(l, j, layer_reach)
                  offset = max(abs(x(l, i, start) - regime(l, j, layer_slider)), &
                               abs(path(l) - regime(l, j, layer_slider)))
                  clear_of_limit = reach*(1.0_wp - margin) - offset - bend(l)
                  clear_of_zero = min(side*x(l, i, speed), side*velocity(l)) - turn(l) &
                                  - margin*reach
                  least = merge(clear_of_zero, clear_of_limit, abs(side) > 0.0_wp)
                  word = ior(word, merge(bit(l), 0_long, least < 0.0_wp))
               end do
               do while (word /= 0_long)
                  found = found + 1
                  list(found) = width*(j - 1) + trailz(word) + 1
                  word = iand(word, word - 1_long)
               end do
            end do
            x(:, i, paths%finish(0)) = path
            x(:, i, paths%finish(1)) = velocity
         end do
      end associate
   end subroutine finish_part

end module dynamics_exact_free_steps
