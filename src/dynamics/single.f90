!> Steps with one transition, eight at a time: located on the tabulated series of its mass, and what it
!> changes for all masses added to the step that was taken as if there were none.
!>
!> From the transition on, the new regime differs from the old one by a force on that mass that is known,
!> the contact force it no longer feels (or feels again): phi(r) = +-(h^2 k/m) (x(tau + r) - x(tau)) of the old
!> motion. The answer to phi = sum phi_k r^k is sum_m A^m b psi_m with psi_m the (m+1)-fold integral of phi.
module dynamics_single
   use core_kinds, only: wp
   use dynamics_propagator, only: column_anchor, column_force, row_columns, series_order, width
   use dynamics_quiet, only: add_further_masses, anchor, direction, reach, regime_size, shift_u, shift_x, &
                             slider, take_step
   implicit none(type, external)
   private
   public :: lanes, single_batch, clear_lane, read_series, locate, step_across

   integer, parameter :: lanes = 8

   !> One transition in each lane; mass 0: none, the lane carries harmless numbers.
   type :: single_batch
      integer :: mass(lanes) = 0
      logical :: is_stick(lanes) = .false.          !! a slip that ends, else one that starts
      real(wp) :: sense(lanes) = 0.0_wp             !! +1 or -1: way of the slip
      real(wp) :: series(lanes, 0:series_order)     !! x of the mass, first from the step's start, then from tau
      real(wp) :: guard(lanes, 0:series_order)
      real(wp) :: gain(lanes) = 0.0_wp              !! +h^2 k/m when a slip starts, - when it ends
      real(wp) :: tau(lanes) = 0.0_wp               !! of the transition [steps]
      real(wp) :: is_located(lanes) = 0.0_wp        !! 1: to rounding
      real(wp) :: psi(lanes, 0:width - 1) = 0.0_wp
   end type single_batch

contains

   !> Reads the transition of one sample into a lane, when there is but one and it shows at the step's end.
   pure subroutine read_series(batch, l, n, row, contact, force, regime, from, to, slack)
      type(single_batch), intent(inout) :: batch
      integer, intent(in) :: l, n
      real(wp), intent(in) :: row(2:series_order, row_columns, width)   !! of the sample's pattern
      real(wp), intent(in) :: contact(width), force(2)
      real(wp), intent(in) :: regime(width, regime_size), from(width, 2), to(width, 2), slack(width)
      integer :: i, k

      call clear_lane(batch, l)
      if (count(slack < 0.0_wp) /= 1) return
      i = minloc(slack, 1)
      associate (way => regime(i, direction), extension => to(i, 1) - regime(i, slider))
         batch%is_stick(l) = abs(way) > 0.0_wp
         if (batch%is_stick(l)) then
            if (.not. way*to(i, 2) < 0.0_wp) return
            batch%sense(l) = way
         else
            if (.not. abs(extension) > regime(i, reach)) return
            if (.not. abs(to(i, 1) - from(i, 1)) < regime(i, reach)) return   ! it might touch the other side
            batch%sense(l) = sign(1.0_wp, extension)
         end if
      end associate
      batch%mass(l) = i
      batch%gain(l) = merge(-contact(i), contact(i), batch%is_stick(l))
      batch%series(l, 0:1) = from(i, :)
      batch%series(l, 2:) = series_of(n, row(:, :, i), from, force, regime)
      if (batch%is_stick(l)) then
         do k = 1, series_order
            batch%guard(l, k - 1) = batch%sense(l)*k*batch%series(l, k)
         end do
      else
         batch%guard(l, :) = -batch%sense(l)*batch%series(l, :)
         batch%guard(l, 0) = regime(i, reach) - batch%sense(l)*(from(i, 1) - regime(i, slider))
      end if
   end subroutine read_series

   !> Harmless numbers for a lane without a transition.
   pure subroutine clear_lane(batch, l)
      type(single_batch), intent(inout) :: batch
      integer, intent(in) :: l

      batch%mass(l) = 0
      batch%is_stick(l) = .false.
      batch%gain(l) = 0.0_wp
      batch%series(l, :) = 0.0_wp
      batch%guard(l, 0:1) = [1.0_wp, -2.0_wp]
      batch%guard(l, 2:) = 0.0_wp
   end subroutine clear_lane

   !> Taylor coefficients 2 .. 9 of the displacement of one mass.
   pure function series_of(n, row, from, force, regime) result(series)
      integer, intent(in) :: n
      real(wp), intent(in) :: row(2:series_order, row_columns), from(width, 2), force(2)
      real(wp), intent(in) :: regime(width, regime_size)
      real(wp), dimension(2:series_order) :: series, by_velocity, by_anchor
      integer :: j, k

      series = row(:, column_force)*force(1)
      by_velocity = row(:, column_force + 1)*force(2)
      by_anchor = 0.0_wp
      do j = 1, n
         !$omp simd
         do k = 2, series_order
            series(k) = series(k) + row(k, j)*from(j, 1)
            by_velocity(k) = by_velocity(k) + row(k, width + j)*from(j, 2)
            by_anchor(k) = by_anchor(k) + row(k, column_anchor + j - 1)*regime(j, anchor)
         end do
      end do
      series = series + by_velocity + by_anchor
   end function series_of

   !> Finds the first zero of every lane's guard by steps that cannot pass one (as first_crossing does),
   !> turns the series to start there, and integrates the force that sets in.
   pure subroutine locate(batch)
      type(single_batch), intent(inout) :: batch
      integer, parameter :: iterations = 6   ! each doubles the digits
      real(wp), parameter :: rounding = 1.0e-14_wp
      real(wp), dimension(lanes) :: bend, value, slope, step
      integer :: iteration, k, l

      bend = 0.0_wp
      do k = series_order, 2, -1
         bend = bend + k*(k - 1)*abs(batch%guard(:, k))
      end do
      batch%tau = 0.0_wp
      do iteration = 1, iterations
         value = batch%guard(:, series_order)
         slope = 0.0_wp
         do k = series_order - 1, 0, -1
            !$omp simd
            do l = 1, lanes
               slope(l) = slope(l)*batch%tau(l) + value(l)
               value(l) = value(l)*batch%tau(l) + batch%guard(l, k)
            end do
         end do
         !$omp simd
         do l = 1, lanes
            block
               real(wp) :: above, below, root
               root = sqrt(max(slope(l)**2 + 2.0_wp*bend(l)*value(l), 0.0_wp))
               above = merge(slope(l) + root, 2.0_wp*value(l), slope(l) > 0.0_wp)
               below = merge(bend(l), root - slope(l), slope(l) > 0.0_wp)
               step(l) = above/max(below, tiny(1.0_wp))
               batch%tau(l) = min(batch%tau(l) + step(l), 1.0_wp)
            end block
         end do
      end do
      do l = 1, lanes
         batch%is_located(l) = merge(1.0_wp, 0.0_wp, bend(l)*step(l)**2 <= -rounding*slope(l) .and. &
                                     batch%tau(l) < 1.0_wp)
      end do
      call shift_series(batch%tau, batch%series)
      where (batch%is_stick) batch%series(:, 1) = 0.0_wp   ! it stops
      call integrate_force(batch)
   end subroutine locate

   !> Coefficients about tau from those about 0 (repeated synthetic division).
   pure subroutine shift_series(tau, series)
      real(wp), intent(in) :: tau(lanes)
      real(wp), intent(inout) :: series(lanes, 0:series_order)
      integer :: j, k, l

      do j = 0, series_order - 1
         do k = series_order - 1, j, -1
            !$omp simd
            do l = 1, lanes
               series(l, k) = series(l, k) + tau(l)*series(l, k + 1)
            end do
         end do
      end do
   end subroutine shift_series

   !> psi_m = gain sum_k x_k k!/(k+m+1)! r^(k+m+1) over the rest r of the step, powers to series_order + 1.
   pure subroutine integrate_force(batch)
      type(single_batch), intent(inout) :: batch
      real(wp) :: power(lanes), term(lanes), rest(lanes)
      integer :: k, l, m

      rest = 1.0_wp - batch%tau
      batch%psi = 0.0_wp
      power = batch%gain
      do k = 1, series_order
         power = power*rest
         term = power*batch%series(:, k)
         do m = 0, min(width - 1, series_order - k)
            !$omp simd
            do l = 1, lanes
               term(l) = term(l)*rest(l)*(1.0_wp/(k + m + 1))
               batch%psi(l, m) = batch%psi(l, m) + term(l)
            end do
         end do
      end do
   end subroutine integrate_force

   !> Takes the step of a lane once more, with the effect of its transition added to what the anchors add; tells
   !> whether nothing else may have happened in the step, before or after it.
   pure subroutine step_across(batch, l, n, table, kick, force, floor, regime, from, to, slack, is_clean)
      type(single_batch), intent(in) :: batch
      integer, intent(in) :: l, n
      real(wp), intent(in) :: table(width, 2, 2*width + 2)           !! of the old pattern
      real(wp), intent(in) :: kick(width, 2, 0:width - 1, width)     !! of the new pattern
      real(wp), intent(in) :: force(2), floor
      real(wp), intent(in) :: regime(width, regime_size), from(width, 2)
      real(wp), intent(inout) :: to(width, 2), slack(width)
      logical, intent(out) :: is_clean
      real(wp) :: shift(width, 2)
      integer :: i, j, m

      i = batch%mass(l)
      shift = regime(:, shift_x:shift_u)
      do m = 0, width - 1
         !$omp simd
         do j = 1, width
            shift(j, 1) = shift(j, 1) + batch%psi(l, m)*kick(j, 1, m, i)
            shift(j, 2) = shift(j, 2) + batch%psi(l, m)*kick(j, 2, m, i)
         end do
      end do
      call add_further_masses(n, table, from, shift)
      call take_step(table, force(1), force(2), floor, shift, regime, from, to, slack)
      slack(i) = 0.0_wp
      is_clean = .not. any(slack < 0.0_wp)
      if (is_clean) is_clean = stays(batch%is_stick(l), batch%series(l, :), 1.0_wp - batch%tau(l), &
                                     batch%sense(l), to(i, 1), to(i, 2), regime(i, reach))
   end subroutine step_across

   !> Whether the mass keeps its new regime to the end of the step: a slip whose velocity stays clear of zero, or a
   !> stick that moves back from its limit all the way, and not as far as the other one.
   pure function stays(is_stick, series, rest, sense, x, u, limit)
      logical, intent(in) :: is_stick
      real(wp), intent(in) :: series(0:), rest, sense, x, u, limit
      logical :: stays
      real(wp) :: higher
      integer :: k

      if (is_stick) then
         higher = 0.0_wp
         do k = series_order, 3, -1
            higher = (higher + k*(k - 1)*abs(series(k)))*rest
         end do
         stays = -2.0_wp*sense*series(2) > 1.5_wp*higher .and. abs(x - series(0)) < limit
      else
         stays = rest*min(sense*series(1), sense*u) > &
                 abs((series(1) + u)*rest - 2.0_wp*(x - series(0)))
      end if
   end function stays

end module dynamics_single
