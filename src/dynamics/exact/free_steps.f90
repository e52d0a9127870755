!> One part of a step of 32 samples without transitions: the powers of all paths, their ends, and
!> the joints whose guards may have a zero on the way.
!>
!> Loops over lanes have constant length. All data begins at multiples of 64 bytes.
module dynamics_exact_free_steps
   use core_kinds, only: long, wp
   use dynamics_exact_joint_paths, only: joint_paths, layer_hold, layer_lift, layer_side, &
                                         layer_slider, width
   use dynamics_exact_powers, only: next_power
   use dynamics_exact_series, only: series_type
   implicit none(type, external)
   private
   public :: expand_block, finish_part, follow_links

   integer, private :: b   ! of the constructor that follows
   integer(long), parameter :: bit(width) = [(shiftl(1_long, b), b=0, width - 1)]

contains

   !> Powers 2 .. P of all rows.
   subroutine expand_block(series, push, paths)
      type(series_type), intent(in) :: series
      !> (lane, loaded dof, power) force now and its rise
      real(wp), intent(in), contiguous :: push(:, :, 0:)
      type(joint_paths), intent(inout) :: paths
      integer :: k

      do k = 0, series%degree - 2
       call add_power(size(paths%x, 2), series, k, paths%layer(k:k + 2), ubound(paths%x, 3), push, &
                        paths%stiffness, paths%pull, paths%x)
      end do
   end subroutine expand_block

   !> Power k + 2 of all rows. Layers of one array become arrays of their own, which do not overlap.
   subroutine add_power(top, series, k, layer, last, push, stiffness, pull, x)
      integer, intent(in) :: top, k, layer(0:2), last   !! rows; power; layers of k ..; last layer
      type(series_type), intent(in) :: series
      real(wp), intent(in) :: push(width, size(series%loaded), 0:1)
      real(wp), intent(in), dimension(width, top) :: stiffness, pull
      real(wp), intent(inout) :: x(width, top, 0:last)
      real(wp) :: scale
      integer :: i, l

      scale = 1.0_wp/((k + 1)*(k + 2))
      call next_power(top, series%springs, series%damping(k), -scale, x(1, 1, layer(0)), &
                      x(1, 1, layer(1)), stiffness, x(1, 1, layer(2)))
      if (k == 0) then
         do i = 1, series%n_dof
            do l = 1, width
               x(l, i, 2) = x(l, i, 2) + scale*pull(l, i)
            end do
         end do
      end if
      if (series%n_links > 0) call push_links(top, series, k, x(1, 1, layer(0)), stiffness, pull, &
                                              x(1, 1, layer(2)))
      if (k <= 1) then
         do i = 1, size(series%loaded)
            associate (dof => series%loaded(i))
               do l = 1, width
                  x(l, dof, k + 2) = x(l, dof, k + 2) + scale*push(l, i, k)
               end do
            end associate
         end do
      end if
      if (series%n_links > 0) call follow_links(top, series, x(1, 1, layer(2)))
   end subroutine add_power

   !> Adds the forces of the links to x_(k+2) of the dofs that they join.
   subroutine push_links(top, series, k, x0, stiffness, pull, x2)
      integer, intent(in) :: top, k
      type(series_type), intent(in) :: series
      real(wp), intent(in), dimension(width, top) :: x0, stiffness, pull
      real(wp), intent(inout) :: x2(width, top)
      real(wp) :: force(width), pulls
      integer :: e, g, l, row

      pulls = merge(1.0_wp, 0.0_wp, k == 0)
      do g = 1, series%n_links
         row = series%n_dof + g
         do l = 1, width
            force(l) = (stiffness(l, row)*x0(l, row) - pulls*pull(l, row)) &
                       *(1.0_wp/((k + 1)*(k + 2)))
         end do
         do e = series%first_end(g), series%first_end(g + 1) - 1
            associate (dof => series%end_dof(e))
               do l = 1, width
                  x2(l, dof) = x2(l, dof) - series%mobility(e)*force(l)
               end do
            end associate
         end do
      end do
   end subroutine push_links

   !> Paths of the links from those of the dofs, one power.
   subroutine follow_links(top, series, x)
      integer, intent(in) :: top   !! rows
      type(series_type), intent(in) :: series
      real(wp), intent(inout) :: x(width, top)
      real(wp) :: path(width)
      integer :: e, g, l

      do g = 1, series%n_links
         path = 0.0_wp
         do e = series%first_end(g), series%first_end(g + 1) - 1
            do l = 1, width
               path(l) = path(l) + series%direction(e)*x(l, series%end_dof(e))
            end do
         end do
         do l = 1, width
            x(l, series%n_dof + g) = path(l)
         end do
      end do
   end subroutine follow_links

   !> Ends of all paths, and a list of the suspects: joints whose guards may have a zero, as
   !> 32 (joint - 1) + lane.
   subroutine finish_part(paths, list, found)
      type(joint_paths), intent(inout) :: paths
      integer, intent(inout) :: list(:)
      integer, intent(out) :: found

      associate (x => paths%x, start => paths%layer, finish => paths%finish)
         call finish_rows(size(x, 2), paths%degree, paths, x(:, :, start(0)), x(:, :, start(1)), &
                          x(:, :, 2:paths%degree), x(:, :, finish(0):finish(1)), list, found)
      end associate
   end subroutine finish_part

   !> A path leaves its chord by at most max |x''|/8 <= sum k (k - 1)/8 |x_k|, a velocity by sum k
   !> (k - 1)(k - 2)/8 |x_k| (3); the guards of the chords have their least values at its ends.
   subroutine finish_rows(top, degree, paths, x0, x1, x, finish, list, found)
      integer, intent(in) :: top, degree
      type(joint_paths), intent(in) :: paths
      real(wp), intent(in), dimension(width, top) :: x0, x1
      real(wp), intent(in) :: x(width, top, 2:degree)
      real(wp), intent(inout) :: finish(width, top, 0:1)
      integer, intent(inout) :: list(:)
      integer, intent(out) :: found
      real(wp) :: more(width, 3)   ! of powers beyond 6: end, its velocity, turn
      real(wp) :: offset, path, turn, velocity
      integer(long) :: word
      integer :: e, i, j, k, l

      found = 0
      more = 0.0_wp
      do e = 1, paths%first(paths%n_rows + 1) - 1
         i = paths%joint_row(e)
         j = paths%joint(e)
         if (degree > 6) then
            more = 0.0_wp
            do k = 7, degree
               do l = 1, width
                  more(l, 1) = more(l, 1) + x(l, i, k)
                  more(l, 2) = more(l, 2) + k*x(l, i, k)
                  more(l, 3) = more(l, 3) + (0.125_wp*k*(k - 1)*(k - 2))*abs(x(l, i, k))
               end do
            end do
         end if
         word = 0
         do l = 1, width
            path = x(l, i, 5) + (x(l, i, 6) + more(l, 1))
            velocity = 5.0_wp*x(l, i, 5) + (6.0_wp*x(l, i, 6) + more(l, 2))
            turn = 7.5_wp*abs(x(l, i, 5)) + (15.0_wp*abs(x(l, i, 6)) + more(l, 3))
            path = x(l, i, 2) + (x(l, i, 3) + (x(l, i, 4) + path))
            path = x0(l, i) + (x1(l, i) + path)
            velocity = 3.0_wp*x(l, i, 3) + (4.0_wp*x(l, i, 4) + velocity)
            velocity = x1(l, i) + (2.0_wp*x(l, i, 2) + velocity)
            turn = 0.75_wp*abs(x(l, i, 3)) + (3.0_wp*abs(x(l, i, 4)) + turn)
            finish(l, i, 0) = path
            finish(l, i, 1) = velocity
            associate (regime => paths%regime)
               offset = max(abs(x0(l, i) - regime(l, j, layer_slider)), &
                            abs(path - regime(l, j, layer_slider)))
               offset = regime(l, j, layer_hold) - offset - 0.25_wp*abs(x(l, i, 2))
               velocity = min(regime(l, j, layer_side)*x1(l, i), &
                              regime(l, j, layer_side)*velocity) + regime(l, j, layer_lift)
            end associate
            word = ior(word, merge(bit(l), 0_long, min(offset, velocity) - turn < 0.0_wp))
         end do
         do while (word /= 0_long)
            found = found + 1
            list(found) = width*(j - 1) + trailz(word) + 1
            word = iand(word, word - 1_long)
         end do
      end do
   end subroutine finish_rows

end module dynamics_exact_free_steps
