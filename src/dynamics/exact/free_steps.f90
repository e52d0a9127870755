!> Free motion of 32 samples over one part of a step: the power series of all paths, their values at
!> the end, and the candidates for transitions: joints whose guards may have a zero in the part.
!>
!> Loops over lanes have constant length, and all arrays are aligned to 64 bytes.
module dynamics_exact_free_steps
   use core_kinds, only: long, wp
   use dynamics_exact_joint_paths, only: joint_paths, n_spare, regime_reach, regime_side, &
                                         regime_slider, width
   use dynamics_exact_powers, only: find_powers
   use dynamics_exact_series, only: most_degree, series_type
   implicit none(type, external)
   private
   public :: expand_series, find_candidates, find_link_paths

   integer, private :: i_   ! index of the constructors
   integer(long), parameter :: bit(width) = [(shiftl(1_long, i_), i_=0, width - 1)]
   real(wp), parameter :: margin = 1.0e-6_wp   !! guard of a candidate over its reach, at most (5)
   real(wp), parameter :: power(most_degree) = [(i_, i_=1, most_degree)]
   !> k (k - 1)(k - 2)/8 of (3)
   real(wp), parameter :: bend(most_degree) = 0.125_wp*power*(power - 1.0_wp)*(power - 2.0_wp)

contains

   !> Finds powers 2 .. P of the paths of all rows.
   subroutine expand_series(series, paths)
      type(series_type), intent(in) :: series
      type(joint_paths), intent(inout) :: paths
      integer :: k, turn

      turn = merge(0, 1, paths%layer(0) == 0)
      associate (x => paths%x, last => series%degree - 2, powers => series%powers)
         if (series%n_links == 0) then
            call find_powers(powers, 0, last, turn, paths%stiffness, paths%pull, paths%places)
         else
            do k = 0, last
               call find_powers(powers, k, k, turn, paths%stiffness, paths%pull, paths%places)
               call add_link_forces(paths%n_padded, series, k, x(1, 1, paths%layer(k)), &
                                    paths%stiffness, paths%pull, x(1, 1, k + 2))
               call find_link_paths(paths%n_padded, series, x(1, 1, k + 2))
            end do
         end if
      end associate
   end subroutine expand_series

   !> Adds the forces of the links to x_(k+2) of the dofs that they join.
   subroutine add_link_forces(n_padded, series, k, x0, stiffness, pull, x2)
      integer, intent(in) :: n_padded, k
      type(series_type), intent(in) :: series
      real(wp), intent(in), dimension(width, n_padded) :: x0, stiffness, pull
      real(wp), intent(inout) :: x2(width, n_padded)
      real(wp) :: force(width), pulls
      integer :: e, g, row

      pulls = merge(1.0_wp, 0.0_wp, k == 0)
      do g = 1, series%n_links
         row = series%n_dof + g
         force = (stiffness(:, row)*x0(:, row) - pulls*pull(:, row))*(1.0_wp/((k + 1)*(k + 2)))
         do e = series%links%start(g), series%links%start(g + 1) - 1
            associate (dof => series%links%column(e))
               x2(:, dof) = x2(:, dof) - series%mobility(e)*force
            end associate
         end do
      end do
   end subroutine add_link_forces

   !> Finds one power of the paths of the links from that of the dofs.
   subroutine find_link_paths(n_padded, series, x)
      integer, intent(in) :: n_padded   !! rows
      type(series_type), intent(in) :: series
      real(wp), intent(inout) :: x(width, n_padded)
      integer :: e, g

      do g = 1, series%n_links
         associate (path => x(:, series%n_dof + g))
            path = 0.0_wp
            do e = series%links%start(g), series%links%start(g + 1) - 1
               path = path + series%links%value(e)*x(:, series%links%column(e))
            end do
         end associate
      end do
   end subroutine find_link_paths

   !> Finds the values of all paths at the end of the part, and lists the candidates.
   subroutine find_candidates(paths)
      type(joint_paths), intent(inout) :: paths
      integer(long) :: word
      integer :: e, k, n, n_hits

      associate (x => paths%x, start => paths%layer(0), finish => paths%finish(0))
         call find_hits(paths%degree, paths, x(1, 1, start), x(1, 1, 2), paths%regime, &
                        x(1, 1, finish), paths%least_guard, paths%hits)
      end associate
      n = 0
      do e = 1, size(paths%hits)
         word = paths%hits(e)
         n_hits = popcnt(word)
         do k = 1, max(n_spare, n_hits)   ! a branch on n_hits alone would be mispredicted
            paths%candidate(n + k) = width*(paths%joint(e) - 1) + trailz(word) + 1
            word = iand(word, word - 1_long)
         end do
         n = n + n_hits
      end do
      paths%n_candidates = n
   end subroutine find_candidates

   !> Finds the ends of the paths, and lower bounds of the guards of their joints. A path leaves its
   !> chord by at most max |x''|/8 <= sum k (k - 1)/8 |x_k|, a velocity by sum k (k - 1)(k - 2)/8
   !> |x_k| (3). The guard of a chord is least at one of its ends.
   pure subroutine find_hits(degree, paths, start, x, regime, finish, least, hits)
      integer, intent(in) :: degree
      type(joint_paths), intent(in) :: paths
      real(wp), intent(in) :: start(width, paths%n_padded, 0:1)   !! powers 0 and 1
      real(wp), intent(in) :: x(width, paths%n_padded, 2:degree)
      real(wp), intent(in) :: regime(width, paths%n_joints + 1, 4)
      real(wp), intent(inout) :: finish(width, paths%n_padded, 0:1)
      real(wp), intent(out) :: least(width)       !! see joint_paths
      integer(long), intent(out) :: hits(:)       !! see joint_paths
      real(wp), dimension(width) :: guard, path, turn, velocity
      integer(long) :: word
      integer :: e, i, j, k, l

      least = huge(1.0_wp)
      do e = 1, size(hits)
         i = paths%joint_row(e)
         j = paths%joint(e)
         path = x(:, i, degree)
         velocity = power(degree)*path
         turn = bend(degree)*abs(path)
         k = degree - 1
         do   ! with the exit at the end: sums stay in registers
            path = path + x(:, i, k)
            velocity = velocity + power(k)*x(:, i, k)
            turn = turn + bend(k)*abs(x(:, i, k))
            k = k - 1
            if (k < 3) exit
         end do
         word = 0_long
         do l = 1, width
            path(l) = start(l, i, 0) + (start(l, i, 1) + (x(l, i, 2) + path(l)))
            velocity(l) = start(l, i, 1) + (2.0_wp*x(l, i, 2) + velocity(l))
            finish(l, i, 0) = path(l)
            finish(l, i, 1) = velocity(l)
            guard(l) = max(abs(start(l, i, 0) - regime(l, j, regime_slider)), &
                           abs(path(l) - regime(l, j, regime_slider)))
            guard(l) = (1.0_wp - margin)*regime(l, j, regime_reach) - guard(l) &
                       - 0.25_wp*abs(x(l, i, 2))
            velocity(l) = min(regime(l, j, regime_side)*start(l, i, 1), &
                              regime(l, j, regime_side)*velocity(l)) &
                          - margin*regime(l, j, regime_reach)
            guard(l) = merge(guard(l), velocity(l), regime(l, j, regime_side) == 0.0_wp) &
                       - turn(l)
            ! the bit of the lane, if its guard is negative
            word = ior(word, iand(bit(l), shifta(transfer(guard(l), 0_long), 63)))
         end do
         hits(e) = word
         if (allocated(paths%coupling)) &
            least = min(least, merge(guard, huge(1.0_wp), guard >= 0.0_wp))
      end do
   end subroutine find_hits

end module dynamics_exact_free_steps
