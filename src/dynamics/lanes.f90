!> Eight samples side by side through one step, with every stick-slip transition in it.
!>
!> The motion is a Taylor polynomial up to the first transition of each lane, where the regime of
!> that mass is changed and the series begins anew; lanes that are done wait. No lane reads another.
module dynamics_lanes
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use structure_model, only: structure_type
   use dynamics_events, only: first_transition, no_crossing
   use dynamics_ledger, only: ledger_type, new_ledger
   use dynamics_response, only: block_state
   use dynamics_taylor, only: lanes, taylor_type
   implicit none(type, external)
   private
   public :: lane_group, new_lane_group

   !> Samples 1 .. 8 of a group; a lane without a sample (0) carries a chain at rest that cannot
   !> slip. Displacements in m, velocities in m per step; arrays (lane, dof).
   type :: lane_group
      type(taylor_type) :: taylor
      type(ledger_type) :: ledger
      integer :: max_transitions = 1000             !! rounds of them in one step that are no error
      integer :: sample(lanes) = 0
      real(wp) :: begin(lanes) = 0.0_wp             !! steps done when this one begins
      real(wp) :: tau(lanes) = 1.0_wp               !! how far a lane is in its step; 1: done
      integer :: rounds(lanes) = 0                  !! of transitions in it so far
      real(wp) :: force(lanes, 0:1) = 0.0_wp        !! at the beginning, and its rise [N]
      real(wp), allocatable :: x(:, :, :)           !! Taylor coefficients (lane, 0:n+1, power)
      real(wp), allocatable :: direction(:, :)      !! 0: stuck, +1 or -1: slipping that way
      real(wp), allocatable :: slider(:, :)
      real(wp), allocatable :: reach(:, :)          !! mu N/k: extension at which the contact slips
      real(wp), allocatable :: held(:, :)           !! 1: stuck, 0: slipping
      real(wp), allocatable :: anchor(:, :)         !! contact force over stiffness at x = 0 [m]
      real(wp), allocatable :: crossing(:, :)       !! next transition, from now [steps]
   contains
      procedure :: clear
      procedure :: load
      procedure :: store
      procedure :: set_step
      procedure :: march_round
      procedure :: march_step
   end type lane_group

contains

   !> Lanes for a chain, at rest and empty.
   pure function new_lane_group(chain, taylor, rate_step, tolerance) result(group)
      type(structure_type), intent(in) :: chain
      type(taylor_type), intent(in) :: taylor
      real(wp), intent(in) :: rate_step, tolerance   !! of the ledger: see new_ledger
      type(lane_group) :: group
      integer :: l, n

      n = taylor%n
      group%taylor = taylor
      group%ledger = new_ledger(chain, taylor, rate_step, tolerance)
      allocate (group%x(lanes, 0:n + 1, 0:taylor%order), source=0.0_wp)
      allocate (group%direction(lanes, n), source=0.0_wp)
      allocate (group%slider, group%reach, group%held, group%anchor, group%crossing, &
                source=group%direction)
      do l = 1, lanes
         call group%clear(l)
      end do
   end function new_lane_group

   !> A lane without a sample.
   pure subroutine clear(self, lane)
      class(lane_group), intent(inout) :: self
      integer, intent(in) :: lane

      self%sample(lane) = 0
      self%tau(lane) = 1.0_wp
      self%force(lane, :) = 0.0_wp
      self%x(lane, :, :) = 0.0_wp
      self%slider(lane, :) = 0.0_wp
      self%direction(lane, :) = 0.0_wp
      self%reach(lane, :) = huge(1.0_wp)
      self%held(lane, :) = 1.0_wp
      self%anchor(lane, :) = 0.0_wp
   end subroutine clear

   !> Puts a sample of the block into a lane. A mass without friction slips for ever: it watches
   !> nothing, as a stuck one with boundless reach, but is not held.
   pure subroutine load(self, chain, lane, sample, state)
      class(lane_group), intent(inout) :: self
      type(structure_type), intent(in) :: chain
      integer, intent(in) :: lane, sample
      type(block_state), intent(in) :: state
      logical :: has_friction(chain%n_dof)

      has_friction = state%slip_limit(:, sample) > 0.0_wp
      self%sample(lane) = sample
      self%x(lane, 1:chain%n_dof, 0) = state%displacement(:, sample)
      self%x(lane, 1:chain%n_dof, 1) = self%taylor%h*state%velocity(:, sample)
      self%slider(lane, :) = merge(state%slider(:, sample), 0.0_wp, has_friction)
      self%direction(lane, :) = merge(real(state%direction(:, sample), wp), 0.0_wp, has_friction)
      self%reach(lane, :) = merge(state%slip_limit(:, sample)/chain%joint_stiffness, &
                                  huge(1.0_wp), has_friction)
      self%held(lane, :) = merge(1.0_wp, 0.0_wp, state%direction(:, sample) == 0)
      self%anchor(lane, :) = merge(self%slider(lane, :), &
                                   -self%direction(lane, :)*self%reach(lane, :), &
                                   state%direction(:, sample) == 0)
   end subroutine load

   !> Takes a sample back from its lane; the slider of a slipping mass has followed it.
   pure subroutine store(self, chain, lane, state)
      class(lane_group), intent(in) :: self
      type(structure_type), intent(in) :: chain
      integer, intent(in) :: lane
      type(block_state), intent(inout) :: state

      associate (w => self%sample(lane), n => chain%n_dof)
         state%displacement(:, w) = self%x(lane, 1:n, 0)
         state%velocity(:, w) = self%x(lane, 1:n, 1)/self%taylor%h
         where (state%slip_limit(:, w) > 0.0_wp)
            state%direction(:, w) = nint(self%direction(lane, :))
         end where
         state%slider(:, w) = merge(self%slider(lane, :), state%displacement(:, w) - &
                                    state%direction(:, w)*state%slip_limit(:, w)/ &
                                    chain%joint_stiffness, state%direction(:, w) == 0)
      end associate
   end subroutine store

   !> Marches all lanes to the end of their steps.
   subroutine march_step(self, state, error)
      class(lane_group), intent(inout) :: self
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error

      do while (any(self%tau < 1.0_wp))
         call self%march_round(state, error)
         if (allocated(error)) return
      end do
   end subroutine march_step

   !> Marches each lane to its next transition, or to the end of its step.
   subroutine march_round(self, state, error)
      class(lane_group), intent(inout) :: self
      type(block_state), intent(inout) :: state           !! transitions are counted and logged here
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: span(lanes), force(lanes, 0:1)
      logical :: is_crossing(lanes)
      integer :: l

      force(:, 0) = self%force(:, 0) + self%tau*self%force(:, 1)
      force(:, 1) = self%force(:, 1)
      call self%taylor%expand(self%held, self%anchor, force, self%x)
      call find_transitions(self, 1.0_wp - self%tau, span)
      is_crossing = span < no_crossing
      span = merge(span, 1.0_wp - self%tau, is_crossing)
      if (state%keeps_ledger) call add_work(self, force, span, state)
      call self%taylor%move(span, self%x)
      self%tau = merge(self%tau + span, 1.0_wp, is_crossing)
      self%rounds = merge(self%rounds + 1, 0, is_crossing)
      do l = 1, lanes
         if (.not. is_crossing(l)) cycle
         if (self%rounds(l) > self%max_transitions) then
            call raise(error, exit_no_solution, 'dof '//to_text(minloc(self%crossing(l, :), 1))// &
                       ' of sample '//to_text(self%sample(l))//' of its block: more than '// &
                       to_text(self%max_transitions)//' transitions in the step that ends at '// &
                       't = '//to_text((self%begin(l) + 1.0_wp)*self%taylor%h))
            return
         end if
         call change_regimes(self, l, span(l), self%begin(l) + self%tau(l), state)
      end do
   end subroutine march_round

   !> Gives a lane its next step: when it begins, the force then, and its rise.
   pure subroutine set_step(self, lane, begin, force, rise)
      class(lane_group), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: begin          !! steps done before
      real(wp), intent(in) :: force, rise    !! [N]

      self%tau(lane) = 0.0_wp
      self%rounds(lane) = 0
      self%begin(lane) = begin
      self%force(lane, :) = [force, rise]
   end subroutine set_step

   !> The first transition of every mass from now, and of every lane (no_crossing: none before the
   !> end).
   pure subroutine find_transitions(self, left, first)
      type(lane_group), intent(inout) :: self
      real(wp), intent(in) :: left(lanes)   !! what is left of the step; 0: nothing is looked for
      real(wp), intent(out) :: first(lanes)
      real(wp) :: slack(lanes, self%taylor%n)
      integer :: i, l

      first = no_crossing
      call bound_slack(self, left, slack)
      self%crossing = no_crossing
      if (.not. any(slack < 0.0_wp)) return
      do i = 1, self%taylor%n
         do l = 1, lanes
            if (slack(l, i) >= 0.0_wp .or. left(l) <= 0.0_wp) cycle
            self%crossing(l, i) = first_transition(self%x(l, i, :), self%direction(l, i), &
                                                   self%slider(l, i), self%reach(l, i), left(l))
            first(l) = min(first(l), self%crossing(l, i))
         end do
      end do
   end subroutine find_transitions

   !> A lower bound of every guard over what is left of the step: the terms up to the velocity
   !> (stuck) or the acceleration (slipping) as they are, all higher ones by their absolute values.
   pure subroutine bound_slack(self, left, slack)
      type(lane_group), intent(in) :: self
      real(wp), intent(in) :: left(lanes)
      real(wp), intent(out) :: slack(lanes, self%taylor%n)
      real(wp) :: path(lanes), slope(lanes)
      integer :: i, k, l

      do i = 1, self%taylor%n
         path = 0.0_wp
         slope = 0.0_wp
         do k = self%taylor%order, 3, -1
            !$omp simd
            do l = 1, lanes
               path(l) = (path(l) + abs(self%x(l, i, k)))*left(l)
               slope(l) = (slope(l) + k*abs(self%x(l, i, k)))*left(l)
            end do
         end do
         !$omp simd
         do l = 1, lanes
            block
               real(wp) :: extension, run, stuck, slipping
               path(l) = (path(l) + abs(self%x(l, i, 2)))*left(l)**2
               extension = self%x(l, i, 0) - self%slider(l, i)
               run = self%x(l, i, 1)*left(l)
               stuck = self%reach(l, i) - path(l) - max(extension + max(run, 0.0_wp), &
                                                        -extension - min(run, 0.0_wp))
               slipping = self%direction(l, i)*self%x(l, i, 1) - slope(l)*left(l) + &
                          min(2.0_wp*self%direction(l, i)*self%x(l, i, 2)*left(l), 0.0_wp)
               slack(l, i) = merge(slipping, stuck, abs(self%direction(l, i)) > 0.5_wp)
            end block
         end do
      end do
   end subroutine bound_slack

   !> Changes the regime of every mass that crosses its guard now: one pass for all of an instant.
   !> Sticking stops the mass and puts the slider where the spring carries mu N, so no drift
   !> gathers.
   subroutine change_regimes(self, l, span, now, state)
      type(lane_group), intent(inout) :: self
      integer, intent(in) :: l
      real(wp), intent(in) :: span   !! time of the transition since the last one [steps]
      real(wp), intent(in) :: now    !! [steps]
      type(block_state), intent(inout) :: state
      real(wp), parameter :: same_instant = 4.0_wp*epsilon(1.0_wp)
      integer :: i, w

      w = self%sample(l)
      do i = 1, self%taylor%n
         if (self%crossing(l, i) > span + same_instant) cycle
         if (self%held(l, i) > 0.0_wp) then
            ! along the velocity: outwards, also where the reach is below rounding
            self%direction(l, i) = sign(1.0_wp, self%x(l, i, 1))
            self%held(l, i) = 0.0_wp
            self%anchor(l, i) = -self%direction(l, i)*self%reach(l, i)
            state%slip_starts(i, w) = state%slip_starts(i, w) + 1
            state%slip_begin(i, w) = now
            call note(i, nint(self%direction(l, i)))
         else
            state%stick_starts(i, w) = state%stick_starts(i, w) + 1
            state%slip_time(i, w) = state%slip_time(i, w) + &
                                    (now - state%slip_begin(i, w))*self%taylor%h
            call note(i, 0)
            self%x(l, i, 1) = 0.0_wp
            self%slider(l, i) = self%x(l, i, 0) - self%direction(l, i)*self%reach(l, i)
            self%anchor(l, i) = self%slider(l, i)
            self%direction(l, i) = 0.0_wp
            self%held(l, i) = 1.0_wp
         end if
      end do

   contains

      subroutine note(i, kind)
         integer, intent(in) :: i, kind

         if (state%keeps_transitions) call state%transitions(w)%append(now*self%taylor%h, i, kind)
      end subroutine note

   end subroutine change_regimes

   !> Adds the work of the piece of motion that follows to the ledger of each sample.
   pure subroutine add_work(self, force, span, state)
      type(lane_group), intent(in) :: self
      real(wp), intent(in) :: force(lanes, 0:1), span(lanes)
      type(block_state), intent(inout) :: state
      real(wp) :: work(lanes, 3)
      integer :: l

      work = 0.0_wp
      call self%ledger%add_work(self%taylor, self%x, self%held, self%anchor, force, span, work)
      do l = 1, lanes
         associate (w => self%sample(l))
            if (w == 0) cycle
            state%work_input(w) = state%work_input(w) + work(l, 1)
            state%work_viscous(w) = state%work_viscous(w) + work(l, 2)
            state%work_friction(w) = state%work_friction(w) + work(l, 3)
         end associate
      end do
   end subroutine add_work

end module dynamics_lanes
