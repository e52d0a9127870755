!> The transitions of one stretch of a sample: which mass may be next, what has been found, and
!> whether it can be all.
module dynamics_transitions
   use core_kinds, only: wp
   use dynamics_crossing, only: crossing_batch
   use dynamics_propagator, only: width
   use dynamics_workspace, only: at_direction, at_reach, at_slider, at_state, sample_size
   implicit none(type, external)
   private
   public :: most_transitions, transition_log, first_suspect, keep_transition, keeps_regimes

   integer, parameter :: most_transitions = 3   !! in a stretch

   !> The transitions found in one stretch, in time order.
   type :: transition_log
      integer :: n = 0
      integer :: mass(most_transitions) = 0
      integer :: switched = 0   !! bit i-1: mass i is among them
      integer :: suspects = 0   !! bit i-1: mass i may have one
      real(wp), dimension(most_transitions) :: time = 0.0_wp, x = 0.0_wp, u = 0.0_wp, sense = 1.0_wp
      real(wp), dimension(most_transitions) :: is_stick = 0.0_wp
   end type transition_log

contains

   !> Of the masses that may have a transition that which would be the first by a straight line
   !> from end to end.
   pure function first_suspect(suspects, place, sample) result(first)
      integer, intent(in) :: suspects   !! bit i-1: mass i; at least one
      integer, intent(in) :: place
      real(wp), intent(in) :: sample(width, sample_size)
      integer :: first
      real(wp) :: share(width)   ! of half the change, left at the end: it grows with the time
      integer :: i, x0, x1

      first = 1 + trailz(suspects)
      if (iand(suspects, suspects - 1) == 0) return
      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      !$omp simd
      do i = 1, width
         block
            real(wp) :: after, before, way
            way = sample(i, at_direction)
            before = merge(way*sample(i, x0 + 1), sample(i, at_reach) - &
                           abs(sample(i, x0) - sample(i, at_slider)), abs(way) > 0.5_wp)
            after = merge(way*sample(i, x1 + 1), sample(i, at_reach) - &
                          abs(sample(i, x1) - sample(i, at_slider)), abs(way) > 0.5_wp)
            share(i) = after/max(0.5_wp*abs(before) + 0.5_wp*abs(after), tiny(1.0_wp))
         end block
      end do
      do i = first + 1, width
         if (btest(suspects, i - 1) .and. share(i) < share(first)) first = i
      end do
   end function first_suspect

   !> Notes the transition of mass i that a lane has found.
   pure subroutine keep_transition(batch, l, i, log)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: l, i
      type(transition_log), intent(inout) :: log

      log%n = log%n + 1
      log%mass(log%n) = i
      log%switched = ibset(log%switched, i - 1)
      log%time(log%n) = batch%tau(l)
      log%x(log%n) = batch%x(l)
      log%u(log%n) = batch%u(l)
      log%sense(log%n) = batch%sense(l)
      log%is_stick(log%n) = batch%is_stick(l)
   end subroutine keep_transition

   !> Whether all masses with a transition keep their new regimes to the end of the stretch: a slip
   !> whose velocity stays clear of zero, a stick that does not come as far as its other limit (it
   !> moves back all the way, as the velocity that fell through zero falls all the way).
   pure function keeps_regimes(log, stride, bend, place, sample)
      type(transition_log), intent(in) :: log
      integer, intent(in) :: stride, place
      real(wp), intent(in) :: bend   !! all kinks of the force, as sum_kinks has them
      real(wp), intent(in) :: sample(width, sample_size)
      logical :: keeps_regimes
      real(wp) :: clear, clear_of_limit, clear_of_zero, rest, run, u
      integer :: i, k, x1

      x1 = at_state + 2 - 2*place
      clear = huge(1.0_wp)
      do k = 1, log%n
         i = log%mass(k)
         rest = 1.0_wp - log%time(k)
         run = sample(i, x1) - log%x(k)
         u = stride*sample(i, x1 + 1)
         clear_of_zero = rest*min(log%sense(k)*log%u(k), log%sense(k)*u) - 0.125_wp*bend - &
                         abs((log%u(k) + u)*rest - 2.0_wp*run)
         clear_of_limit = sample(i, at_reach) - abs(run)
         clear = min(clear, log%is_stick(k)*clear_of_limit + &
                            (1.0_wp - log%is_stick(k))*clear_of_zero)
      end do
      keeps_regimes = clear > 0.0_wp
   end function keeps_regimes

end module dynamics_transitions
