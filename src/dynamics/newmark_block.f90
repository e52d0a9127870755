!> A block of samples while Newmark's scheme marches it: every sample at its own time and step size.
!>
!> Time is counted in ticks of the smallest step, dt/2^max_halvings, from the beginning of the piece
!> that is marched: where a step begins and how long it may be are then whole numbers. A sample has
!> two slots for its motion: one holds the present, the other takes the step that is being tried.
module dynamics_newmark_block
   use core_kinds, only: long, wp
   use structure_model, only: structure_type
   use dynamics_newmark_ledger, only: add_works
   use dynamics_alignment, only: first_aligned, register_width, whole_registers
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: newmark_block, load_block, store_block

   !> Columns over the dofs are padded to whole registers.
   type :: newmark_block
      integer :: n_dof = 0, n_samples = 0
      integer :: forced_dof = 0
      integer :: max_halvings = 0
      real(wp) :: dt = 0.0_wp
      real(wp), allocatable :: force(:, :)        !! (0:step, 1 or sample) [N]
      integer, allocatable :: column(:)           !! (sample) of the force
      integer(long), allocatable :: tick(:)       !! (sample) now
      integer(long), allocatable :: ticks(:)      !! (sample) of the next step
      integer, allocatable :: level(:)            !! (sample) the step tried is dt/2^level
      integer(long), allocatable :: until(:)      !! (sample) a transition is known to come by then
      integer(long), allocatable :: slot(:)       !! (sample) 0 or 1: that of the present motion
      integer, allocatable :: pattern(:)          !! (sample) bit i-1: dof i is stuck; short chains
      !> (dof; a, v, x; slot; sample)
      real(wp), pointer, contiguous :: motion(:, :, :, :) => null()
      !> (dof; slider, reach, way, stiffness; sample). Reach is huge for one that slips, way 0 for
      !> one that is stuck (or slips for ever), stiffness 0 for one that slips.
      real(wp), pointer, contiguous :: bounds(:, :, :) => null()
      real(wp), allocatable :: stiffness(:)       !! (dof) of the contact springs [N/m]
      real(wp), allocatable :: reach(:, :)        !! (dof, sample) mu N/k [m]
      integer(long), allocatable :: slip_begin(:, :)   !! (dof, sample) counted up to here
      real(wp), allocatable :: pull(:, :)         !! (dof, sample) what a slipping one carries [N]
      real(wp), allocatable :: damping(:, :)      !! (dof, dof) C, where a ledger is kept
      real(wp), allocatable :: work(:, :, :)      !! (dof; input, viscous, friction; sample) [J]
      real(wp), allocatable :: room(:, :)         !! for the steps to work in
      integer, allocatable :: list(:)             !! (dof) room for a list
      real(wp), private :: tick_size = 0.0_wp     !! [s]
      real(wp), pointer, contiguous, private :: memory(:) => null()
   contains
      procedure :: switch_at_nearer_end
      procedure :: add_work
      procedure :: change_of_force
      procedure, private :: slip
      procedure, private :: stick
      procedure, private :: set_regime
      procedure, private :: balance
      procedure, private :: force_now
      procedure, private :: seconds
      final :: free_block
   end type newmark_block

contains

   !> Takes the samples over from the state, for a march under this piece of force.
   subroutine load_block(chain, dt, forced_dof, max_halvings, force, state, block)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: dt
      integer, intent(in) :: forced_dof, max_halvings
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N]
      type(block_state), intent(in) :: state
      type(newmark_block), intent(inout) :: block
      integer :: first, i, rows, w, samples

      samples = state%n_samples
      rows = whole_registers(state%n_dof)
      block%n_dof = state%n_dof
      block%n_samples = samples
      block%forced_dof = forced_dof
      block%max_halvings = max_halvings
      block%dt = dt
      block%tick_size = 0.5_wp**max_halvings*dt
      allocate (block%force(0:ubound(force, 1), size(force, 2)))
      block%force(:, :) = force
      block%column = [(min(w, size(force, 2)), w=1, samples)]
      block%stiffness = chain%joint_stiffness
      block%reach = state%slip_limit/spread(chain%joint_stiffness, 2, samples)
      allocate (block%tick(samples), block%until(samples), block%slot(samples), source=0_long)
      allocate (block%ticks(samples), source=shiftl(1_long, max_halvings))
      allocate (block%slip_begin(state%n_dof, samples), source=0_long)
      allocate (block%level(samples), block%pattern(samples), source=0)
      allocate (block%pull(rows, samples), source=0.0_wp)
      if (state%keeps_ledger) then
         allocate (block%damping(rows, state%n_dof), block%work(rows, 3, samples), source=0.0_wp)
         block%damping(:state%n_dof, :) = chain%damping
      end if
      allocate (block%room(rows, max(samples, state%n_dof + 2)), block%list(state%n_dof))
      allocate (block%memory(10*rows*samples + register_width), source=0.0_wp)
      first = first_aligned(block%memory)
      block%motion(1:rows, 1:3, 0:1, 1:samples) => block%memory(first:)
      block%bounds(1:rows, 1:4, 1:samples) => block%memory(first + 6*rows*samples:)
      block%bounds(:, 2, :) = huge(1.0_wp)
      do w = 1, samples
         block%motion(:state%n_dof, 2, 0, w) = state%velocity(:, w)
         block%motion(:state%n_dof, 3, 0, w) = state%displacement(:, w)
         do i = 1, state%n_dof
            call block%set_regime(i, w, state%direction(i, w), state%slider(i, w))
         end do
         call block%balance(chain, state, w)
      end do
   end subroutine load_block

   !> Gives the samples back, all at the end of the piece.
   subroutine store_block(block, state)
      type(newmark_block), intent(in) :: block
      type(block_state), intent(inout) :: state
      integer :: i, w

      if (state%keeps_ledger) then
         state%work_input = state%work_input + sum(block%work(:, 1, :), 1)
         state%work_viscous = state%work_viscous + sum(block%work(:, 2, :), 1)
         state%work_friction = state%work_friction + sum(block%work(:, 3, :), 1)
      end if
      do w = 1, block%n_samples
         associate (motion => block%motion(:, :, block%slot(w), w))
            state%velocity(:, w) = motion(:block%n_dof, 2)
            state%displacement(:, w) = motion(:block%n_dof, 3)
         end associate
         do i = 1, block%n_dof
            state%slider(i, w) = block%bounds(i, 1, w)
            if (state%direction(i, w) == 0) cycle
            state%slider(i, w) = state%displacement(i, w) - state%direction(i, w)*block%reach(i, w)
            state%slip_time(i, w) = state%slip_time(i, w) &
                                    + block%seconds(block%tick(w) - block%slip_begin(i, w))
         end do
      end do
      state%step = state%step + ubound(block%force, 1)
      state%slip_since = state%step*block%dt   ! slips under way are counted up to here
      state%slip_from = state%displacement
   end subroutine store_block

   !> A smallest step of sample w has passed a slider's limit: the transition is put at its nearer
   !> end, the earliest deciding. The begin is nearer if less was missing there than is too much at
   !> the end (linear interpolation).
   subroutine switch_at_nearer_end(self, chain, state, w)
      class(newmark_block), intent(inout) :: self
      type(structure_type), intent(in) :: chain
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      integer :: i, k, n_passed
      integer(long) :: new, nearer, old

      old = self%slot(w)
      new = 1 - old
      n_passed = 0
      nearer = new
      associate (rows => size(self%room, 1), before => self%room(:, 1), after => self%room(:, 2))
         call find_margins(rows, self%bounds(:, :, w), self%motion(:, :, old, w), before)
         call find_margins(rows, self%bounds(:, :, w), self%motion(:, :, new, w), after)
         do i = 1, self%n_dof
            if (.not. after(i) < 0.0_wp) cycle
            n_passed = n_passed + 1
            self%list(n_passed) = i
            if (before(i) < -after(i) .and. moves_on(i, old)) nearer = old
         end do
      end associate
      if (nearer == new) then
         if (state%keeps_ledger) call self%add_work([w], spread(0_long, 1, self%n_samples))
         self%tick(w) = self%tick(w) + 1
         self%slot(w) = new
      end if
      do k = 1, n_passed
         i = self%list(k)
         if (nearer == old .and. .not. self%room(i, 1) < -self%room(i, 2)) cycle
         if (.not. moves_on(i, nearer)) cycle
         if (state%direction(i, w) /= 0) then
            call self%stick(chain, state, i, w)
         else
            call self%slip(chain, state, i, w, self%motion(i, 3, new, w) > self%bounds(i, 1, w))
         end if
      end do
      self%until(w) = 0
      self%ticks(w) = shiftl(1_long, min(trailz(self%tick(w)), self%max_halvings))

   contains

      !> Whether dof i, beyond its limit at the end, may change its regime at this end of the step:
      !> a slipping one always, a stuck one if it moves outward there.
      pure logical function moves_on(i, slot)
         integer, intent(in) :: i
         integer(long), intent(in) :: slot

         associate (extension => self%motion(i, 3, new, w) - self%bounds(i, 1, w))
            moves_on = self%motion(i, 2, slot, w)*extension > 0.0_wp
         end associate
         moves_on = moves_on .or. .not. self%bounds(i, 4, w) > 0.0_wp
      end function moves_on

   end subroutine switch_at_nearer_end

   !> How far the dofs are from their limits: a stuck one by the extension its spring may still gain
   !> [m], a slipping one by its velocity [m/s].
   pure subroutine find_margins(rows, bounds, motion, margin)
      integer, intent(in) :: rows
      real(wp), intent(in) :: bounds(rows, 4), motion(rows, 3)
      real(wp), intent(out) :: margin(rows)
      integer :: i

      !$omp simd
      do i = 1, rows
         margin(i) = merge(bounds(i, 2) - abs(motion(i, 3) - bounds(i, 1)), &
                           bounds(i, 3)*motion(i, 2), bounds(i, 4) > 0.0_wp)
      end do
   end subroutine find_margins

   !> Dof i slips from now on, outward. Its spring carries mu N instead of what it had come to.
   subroutine slip(self, chain, state, i, w, is_forward)
      class(newmark_block), intent(inout) :: self
      type(structure_type), intent(in) :: chain
      type(block_state), intent(inout) :: state
      integer, intent(in) :: i, w
      logical, intent(in) :: is_forward
      integer :: direction

      direction = merge(1, -1, is_forward)
      associate (motion => self%motion(:, :, self%slot(w), w))
         motion(i, 1) = motion(i, 1) - self%stiffness(i)/chain%mass(i, i)* &
                        (direction*self%reach(i, w) - (motion(i, 3) - self%bounds(i, 1, w)))
      end associate
      state%slip_starts(i, w) = state%slip_starts(i, w) + 1
      self%slip_begin(i, w) = self%tick(w)
      call self%set_regime(i, w, direction, 0.0_wp)
      call note_transition(self, state, i, w, direction)
   end subroutine slip

   !> Dof i sticks from now on: it stands still, which relieves the dampers, and its spring carries
   !> no more than mu N.
   subroutine stick(self, chain, state, i, w)
      class(newmark_block), intent(inout) :: self
      type(structure_type), intent(in) :: chain
      type(block_state), intent(inout) :: state
      integer, intent(in) :: i, w
      real(wp) :: slider
      integer :: j

      associate (motion => self%motion(:, :, self%slot(w), w), reach => self%reach(i, w))
         do j = 1, self%n_dof
            motion(j, 1) = motion(j, 1) + chain%damping(j, i)*motion(i, 2)/chain%mass(j, j)
         end do
         motion(i, 2) = 0.0_wp
         slider = motion(i, 3) - state%direction(i, w)*reach
         do while (abs(motion(i, 3) - slider) > reach)   ! by rounding
            slider = nearest(slider, motion(i, 3) - slider)
         end do
      end associate
      state%stick_starts(i, w) = state%stick_starts(i, w) + 1
      state%slip_time(i, w) = state%slip_time(i, w) &
                              + self%seconds(self%tick(w) - self%slip_begin(i, w))
      call self%set_regime(i, w, 0, slider)
      call note_transition(self, state, i, w, 0)
   end subroutine stick

   subroutine note_transition(self, state, i, w, direction)
      type(newmark_block), intent(in) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: i, w, direction

      state%direction(i, w) = direction
      if (state%keeps_transitions) call state%transitions(w)%append( &
         state%step*self%dt + self%seconds(self%tick(w)), i, direction)
   end subroutine note_transition

   !> Bounds and pattern of a slider that slips in a direction, or is stuck (0).
   !> One that carries nothing (mu N = 0) slips for ever.
   pure subroutine set_regime(self, i, w, direction, slider)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: i, w, direction
      real(wp), intent(in) :: slider

      if (direction == 0) then
         self%bounds(i, :, w) = [slider, self%reach(i, w), 0.0_wp, self%stiffness(i)]
      else
         self%bounds(i, :, w) = [0.0_wp, huge(1.0_wp), &
                                 merge(direction, 0, self%reach(i, w) > 0.0_wp)*1.0_wp, 0.0_wp]
      end if
      self%pull(i, w) = direction*self%stiffness(i)*self%reach(i, w)
      if (self%n_dof > register_width) return
      self%pattern(w) = merge(ibset(self%pattern(w), i - 1), ibclr(self%pattern(w), i - 1), &
                              direction == 0)
   end subroutine set_regime

   !> Accelerations from the equation of motion.
   pure subroutine balance(self, chain, state, w)
      class(newmark_block), intent(inout) :: self
      type(structure_type), intent(in) :: chain
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      real(wp) :: spring
      integer :: i, j

      associate (motion => self%motion(:, :, self%slot(w), w))
         do i = 1, self%n_dof
            spring = motion(i, 3) - self%bounds(i, 1, w)
            if (state%direction(i, w) /= 0) spring = state%direction(i, w)*self%reach(i, w)
            motion(i, 1) = -self%stiffness(i)*spring
         end do
         motion(self%forced_dof, 1) = motion(self%forced_dof, 1) + self%force_now(w)
         do j = 1, self%n_dof
            do i = 1, self%n_dof
               motion(i, 1) = motion(i, 1) &
                             - chain%damping(i, j)*motion(j, 2) - chain%stiffness(i, j)*motion(j, 3)
            end do
         end do
         do i = 1, self%n_dof
            motion(i, 1) = motion(i, 1)/chain%mass(i, i)
         end do
      end associate
   end subroutine balance

   !> Adds the work of the steps that the listed samples have tried, where they stand: of the force,
   !> the dampers and the sliders. With average acceleration it is the change of the stored energy,
   !> to rounding.
   pure subroutine add_work(self, sample, has_passed)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: sample(:)                !! their numbers
      integer(long), intent(in) :: has_passed(:)      !! (all samples) 1: the step does not stand

      call add_works(self%n_dof, size(self%motion, 1), self%forced_dof, self%max_halvings, &
                     self%dt, size(sample), sample, self%n_samples, has_passed, self%tick, &
                     self%ticks, self%slot, self%column, ubound(self%force, 1), &
                     size(self%force, 2), self%force, self%damping, self%pull, self%motion, &
                     self%work)
   end subroutine add_work

   !> The force on sample w now, linear within a step.
   pure function force_now(self, w) result(force)
      class(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      real(wp) :: force
      integer :: step
      real(wp) :: share

      step = min(int(shiftr(self%tick(w), self%max_halvings)), ubound(self%force, 1) - 1)
      share = (self%tick(w) - shiftl(int(step, long), self%max_halvings))*self%tick_size/self%dt
      associate (f => self%force, column => self%column(w))
         force = f(step, column) + share*(f(step + 1, column) - f(step, column))
      end associate
   end function force_now

   !> By how much it changes in the present step of dt.
   pure function change_of_force(self, w) result(change)
      class(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      real(wp) :: change
      integer :: step

      step = int(shiftr(self%tick(w), self%max_halvings))
      change = self%force(step + 1, self%column(w)) - self%force(step, self%column(w))
   end function change_of_force

   pure function seconds(self, ticks) result(time)
      class(newmark_block), intent(in) :: self
      integer(long), intent(in) :: ticks
      real(wp) :: time

      time = ticks*self%tick_size
   end function seconds

   subroutine free_block(self)
      type(newmark_block), intent(inout) :: self

      if (associated(self%memory)) deallocate (self%memory)
   end subroutine free_block

end module dynamics_newmark_block
