!> A block of samples while Newmark's scheme marches it: every sample at its own time and step size.
!>
!> Time is counted in ticks of the smallest step, dt/2^max_halvings, from the beginning of the piece
!> that is marched: where a step begins and how long it may be are then whole numbers. A sample has
!> two slots for its motion: one holds the present, the other takes the step that is being tried.
module dynamics_newmark_block
   use core_kinds, only: long, wp
   use dynamics_joint, only: slider_at, stuck_guard
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_alignment, only: first_aligned, register_width, whole_registers
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: newmark_block, load_block, store_block

   !> Columns over the dofs are padded to whole registers.
   type :: newmark_block
      type(newmark_frame) :: frame
      integer :: n_dof = 0, n_joints = 0, n_samples = 0
      integer :: max_halvings = 0
      real(wp) :: dt = 0.0_wp
      real(wp), allocatable :: force(:, :)        !! (0:step, force, or force and sample) [N]
      integer, allocatable :: column(:)           !! (sample) of its first force
      integer(long), allocatable :: tick(:)       !! (sample) now
      integer(long), allocatable :: ticks(:)      !! (sample) of the next step
      integer(long), allocatable :: until(:)      !! (sample) a transition is known to come by then
      integer(long), allocatable :: slot(:)       !! (sample) 0 or 1: that of the present motion
      integer, allocatable :: pattern(:)          !! (sample) bit j-1: joint j is stuck; short rows
      !> (dof; a, v, x; slot; sample)
      real(wp), pointer, contiguous :: motion(:, :, :, :) => null()
      !> (joint; slider, reach, way, stiffness; sample). Reach is huge for one that slips, way 0 for
      !> one that is stuck (or slips for ever), stiffness 0 for one that slips.
      real(wp), pointer, contiguous :: bounds(:, :, :) => null()
      real(wp), allocatable :: stiffness(:)       !! (joint) k [N/m]
      real(wp), allocatable :: reach(:, :)        !! (joint, sample) mu N/k [m]
      integer(long), allocatable :: slip_begin(:, :)   !! (joint, sample) counted up to here
      real(wp), allocatable :: pull(:, :)         !! (joint, sample) force while it slips [N]
      real(wp), allocatable :: work(:, :)         !! (input viscous friction, sample) [J]
      !> (joint) room for a list, its places and speeds at both ends of a step, and a low-rank
      !> system
      integer, allocatable :: list(:)
      real(wp), allocatable :: place(:, :), speed(:, :), factor(:, :), release(:)
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
   subroutine load_block(frame, dt, max_halvings, force, state, block)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: force(0:, :)   !! (step, force, or force and sample) [N]
      type(block_state), intent(in) :: state
      type(newmark_block), intent(inout) :: block
      integer :: first, j, joint_rows, m, n_forces, rows, w, samples

      samples = state%n_samples
      m = state%n_joints
      n_forces = frame%structure%n_forces
      rows = whole_registers(state%n_dof)
      joint_rows = whole_registers(m)
      block%frame = frame
      block%n_dof = state%n_dof
      block%n_joints = m
      block%n_samples = samples
      block%max_halvings = max_halvings
      block%dt = dt
      block%tick_size = 0.5_wp**max_halvings*dt
      allocate (block%force(0:ubound(force, 1), size(force, 2)))
      block%force(:, :) = force
      block%column = [(min(n_forces*(w - 1), size(force, 2) - n_forces) + 1, w=1, samples)]
      block%stiffness = frame%structure%joint_stiffness
      block%reach = state%slip_limit/spread(block%stiffness, 2, samples)
      allocate (block%tick(samples), block%until(samples), block%slot(samples), source=0_long)
      allocate (block%ticks(samples), source=shiftl(1_long, max_halvings))
      allocate (block%slip_begin(m, samples), source=0_long)
      allocate (block%pattern(samples), source=0)
      allocate (block%pull(m, samples), block%work(3, samples), source=0.0_wp)
      allocate (block%list(m + 1), block%factor(m, m), block%release(m), block%place(m, 0:1), &
                block%speed(m, 0:1))
      allocate (block%memory((6*rows + 4*joint_rows)*samples + register_width), source=0.0_wp)
      first = first_aligned(block%memory)
      block%motion(1:rows, 1:3, 0:1, 1:samples) => block%memory(first:)
      block%bounds(1:joint_rows, 1:4, 1:samples) => block%memory(first + 6*rows*samples:)
      block%bounds(:, 2, :) = huge(1.0_wp)
      do w = 1, samples
         block%motion(:state%n_dof, 2, 0, w) = state%velocity(:, w)
         block%motion(:state%n_dof, 3, 0, w) = state%displacement(:, w)
         do j = 1, m
            call block%set_regime(j, w, state%direction(j, w), state%slider(j, w))
         end do
         call block%balance(state, w)
      end do
   end subroutine load_block

   !> Gives the samples back, all at the end of the piece.
   subroutine store_block(block, state)
      type(newmark_block), intent(in) :: block
      type(block_state), intent(inout) :: state
      real(wp) :: place
      integer :: j, w

      if (state%keeps_ledger) then
         state%work_input = state%work_input + block%work(1, :)
         state%work_viscous = state%work_viscous + block%work(2, :)
         state%work_friction = state%work_friction + block%work(3, :)
      end if
      do w = 1, block%n_samples
         associate (motion => block%motion(:, :, block%slot(w), w))
            state%velocity(:, w) = motion(:block%n_dof, 2)
            state%displacement(:, w) = motion(:block%n_dof, 3)
         end associate
         do j = 1, block%n_joints
            state%slider(j, w) = block%bounds(j, 1, w)
            if (state%direction(j, w) == 0) cycle
            place = block%frame%directions%row_times(j, state%displacement(:, w))
            state%slider(j, w) = place - state%direction(j, w)*block%reach(j, w)
            state%slip_time(j, w) = state%slip_time(j, w) &
                                    + block%seconds(block%tick(w) - block%slip_begin(j, w))
            state%slip_distance(j, w) = state%slip_distance(j, w) &
                                        + abs(place - state%slip_from(j, w))
            state%slip_from(j, w) = place
         end do
      end do
      state%step = state%step + ubound(block%force, 1)
      state%slip_since = state%step*block%dt   ! slips under way are counted up to here
   end subroutine store_block

   !> A smallest step of sample w has passed a joint's limit: the transition is put at its nearer
   !> end, the earliest deciding. The begin is nearer if less was missing there than is too much at
   !> the end (linear interpolation).
   subroutine switch_at_nearer_end(self, state, w)
      class(newmark_block), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      integer :: end, j, k, n_passed
      integer(long) :: new, nearer, old
      real(wp) :: before, after

      old = self%slot(w)
      new = 1 - old
      n_passed = 0
      nearer = new
      do j = 1, self%n_joints
         do end = 0, 1
            self%place(j, end) = self%frame%directions%row_times(j, self%motion(:, 3, end, w))
            self%speed(j, end) = self%frame%directions%row_times(j, self%motion(:, 2, end, w))
         end do
         if (.not. margin(j, new) < 0.0_wp) cycle
         n_passed = n_passed + 1
         self%list(n_passed) = j
         if (margin(j, old) < -margin(j, new) .and. moves_on(j, old)) nearer = old
      end do
      if (nearer == new) then
         if (state%keeps_ledger) call self%add_work([w], spread(0_long, 1, self%n_samples))
         self%tick(w) = self%tick(w) + 1
         self%slot(w) = new
      end if
      do k = 1, n_passed
         j = self%list(k)
         before = margin(j, old)
         after = margin(j, new)
         if (nearer == old .and. .not. before < -after) cycle
         if (.not. moves_on(j, nearer)) cycle
         if (state%direction(j, w) /= 0) then
            call self%stick(state, j, w)
         else
            call self%slip(state, j, w, self%place(j, new) > self%bounds(j, 1, w))
         end if
      end do
      self%until(w) = 0
      self%ticks(w) = shiftl(1_long, min(trailz(self%tick(w)), self%max_halvings))

   contains

      !> How far joint j is from its limit: a stuck one by the extension its spring may still gain
      !> [m], a slipping one by its velocity [m/s].
      pure real(wp) function margin(j, slot)
         integer, intent(in) :: j
         integer(long), intent(in) :: slot

         associate (bounds => self%bounds(j, :, w))
            if (bounds(4) > 0.0_wp) then
               margin = stuck_guard(self%place(j, slot), bounds(1), bounds(2))
            else
               margin = bounds(3)*self%speed(j, slot)
            end if
         end associate
      end function margin

      !> True if joint j, beyond its limit at the end, may change its regime at this end of the
      !> step: a slipping one always, a stuck one if it moves outward there.
      pure logical function moves_on(j, slot)
         integer, intent(in) :: j
         integer(long), intent(in) :: slot

         moves_on = self%speed(j, slot)*(self%place(j, new) - self%bounds(j, 1, w)) > 0.0_wp .or. &
                    .not. self%bounds(j, 4, w) > 0.0_wp
      end function moves_on

   end subroutine switch_at_nearer_end

   !> Joint j slips from now on, outward. Its spring carries mu N instead of what it had come to.
   subroutine slip(self, state, j, w, is_forward)
      class(newmark_block), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: j, w
      logical, intent(in) :: is_forward
      integer :: direction
      real(wp) :: place

      direction = merge(1, -1, is_forward)
      associate (motion => self%motion(:self%n_dof, :, self%slot(w), w))
         place = self%frame%directions%row_times(j, motion(:, 3))
         motion(:, 1) = motion(:, 1) - self%frame%kick(:, j)*self%stiffness(j)* &
                        (direction*self%reach(j, w) - (place - self%bounds(j, 1, w)))
      end associate
      state%slip_starts(j, w) = state%slip_starts(j, w) + 1
      state%slip_from(j, w) = place
      self%slip_begin(j, w) = self%tick(w)
      call self%set_regime(j, w, direction, 0.0_wp)
      call note_transition(self, state, j, w, direction)
   end subroutine slip

   !> Joint j sticks from now on: it stands still, which relieves the dampers, and its spring
   !> carries no more than mu N.
   subroutine stick(self, state, j, w)
      class(newmark_block), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: j, w
      real(wp) :: place, slider, speed

      associate (motion => self%motion(:self%n_dof, :, self%slot(w), w), reach => self%reach(j, w))
         speed = self%frame%directions%row_times(j, motion(:, 2))
         motion(:, 1) = motion(:, 1) + self%frame%relief(:, j)*speed
         motion(:, 2) = motion(:, 2) - self%frame%lost(:, j)*speed
         place = self%frame%directions%row_times(j, motion(:, 3))
         slider = slider_at(place, state%direction(j, w), reach)
         do while (abs(place - slider) > reach)   ! by rounding
            slider = nearest(slider, place - slider)
         end do
      end associate
      state%stick_starts(j, w) = state%stick_starts(j, w) + 1
      state%slip_time(j, w) = state%slip_time(j, w) &
                              + self%seconds(self%tick(w) - self%slip_begin(j, w))
      state%slip_distance(j, w) = state%slip_distance(j, w) + abs(place - state%slip_from(j, w))
      call self%set_regime(j, w, 0, slider)
      call note_transition(self, state, j, w, 0)
   end subroutine stick

   subroutine note_transition(self, state, i, w, direction)
      type(newmark_block), intent(in) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: i, w, direction

      state%direction(i, w) = direction
      if (state%keeps_transitions) call state%transitions(w)%append( &
         state%step*self%dt + self%seconds(self%tick(w)), i, direction)
   end subroutine note_transition

   !> Bounds and pattern of a joint that slips in a direction, or is stuck (0).
   !> One that carries nothing (mu N = 0) slips for ever.
   pure subroutine set_regime(self, j, w, direction, slider)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: j, w, direction
      real(wp), intent(in) :: slider

      if (direction == 0) then
         self%bounds(j, :, w) = [slider, self%reach(j, w), 0.0_wp, self%stiffness(j)]
      else
         self%bounds(j, :, w) = [0.0_wp, huge(1.0_wp), &
                                 merge(direction, 0, self%reach(j, w) > 0.0_wp)*1.0_wp, 0.0_wp]
      end if
      self%pull(j, w) = direction*self%stiffness(j)*self%reach(j, w)
      if (self%n_joints > register_width) return
      self%pattern(w) = merge(ibset(self%pattern(w), j - 1), ibclr(self%pattern(w), j - 1), &
                              direction == 0)
   end subroutine set_regime

   !> Accelerations from the equation of motion.
   pure subroutine balance(self, state, w)
      class(newmark_block), intent(inout) :: self
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      real(wp) :: pull, force(self%n_dof)
      integer :: j

      associate (structure => self%frame%structure, directions => self%frame%directions, &
                 motion => self%motion(:self%n_dof, :, self%slot(w), w))
         force = matmul(structure%load, self%force_now(w)) &
                 - matmul(structure%damping, motion(:, 2)) &
                 - matmul(structure%stiffness, motion(:, 3))
         do j = 1, self%n_joints
            if (state%direction(j, w) == 0) then
               pull = directions%row_times(j, motion(:, 3)) - self%bounds(j, 1, w)
               pull = self%stiffness(j)*pull
            else
               pull = self%pull(j, w)
            end if
            call directions%add_row(j, -pull, force)
         end do
         motion(:, 1) = matmul(self%frame%inverse_mass, force)
      end associate
   end subroutine balance

   !> Adds the work of the steps that the listed samples have tried, where they stand: of the
   !> forces, the dampers and the joints. With average acceleration the mean force over the way, the
   !> dampers at the mean velocity and the joints make the change of the stored energy, to rounding.
   pure subroutine add_work(self, sample, has_passed)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: sample(:)                !! their numbers
      integer(long), intent(in) :: has_passed(:)      !! (all samples) 1: the step does not stand
      real(wp) :: middle, way(self%n_dof)
      integer :: j, k, step, w

      associate (structure => self%frame%structure, n_forces => self%frame%structure%n_forces)
         do k = 1, size(sample)
            w = sample(k)
            if (has_passed(w) == 1) cycle
            way = self%motion(:self%n_dof, 3, 1 - self%slot(w), w) &
                  - self%motion(:self%n_dof, 3, self%slot(w), w)
            step = int(shiftr(self%tick(w), self%max_halvings))
            middle = ((self%tick(w) - shiftl(int(step, long), self%max_halvings)) &
                      + 0.5_wp*self%ticks(w))*self%tick_size/self%dt
            do j = 1, n_forces
               associate (f => self%force(step:step + 1, self%column(w) + j - 1))
                  self%work(1, w) = self%work(1, w) + (f(1) + middle*(f(2) - f(1))) &
                                    *dot_product(structure%load(:, j), way)
               end associate
            end do
            self%work(2, w) = self%work(2, w) + dot_product(way, matmul(structure%damping, way)) &
                              /self%seconds(self%ticks(w))
            do j = 1, self%n_joints
               if (self%bounds(j, 4, w) > 0.0_wp) cycle
               self%work(3, w) = self%work(3, w) &
                                 + self%pull(j, w)*self%frame%directions%row_times(j, way)
            end do
         end do
      end associate
   end subroutine add_work

   !> The forces on sample w now (force), linear within a step.
   pure function force_now(self, w) result(force)
      class(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      real(wp) :: force(self%frame%structure%n_forces)
      integer :: step
      real(wp) :: share

      step = min(int(shiftr(self%tick(w), self%max_halvings)), ubound(self%force, 1) - 1)
      share = (self%tick(w) - shiftl(int(step, long), self%max_halvings))*self%tick_size/self%dt
      associate (f => self%force(step:step + 1, self%column(w):self%column(w) + size(force) - 1))
         force = f(1, :) + share*(f(2, :) - f(1, :))
      end associate
   end function force_now

   !> By how much they change in the present step of dt (force).
   pure function change_of_force(self, w) result(change)
      class(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      real(wp) :: change(self%frame%structure%n_forces)
      integer :: step

      step = int(shiftr(self%tick(w), self%max_halvings))
      associate (f => self%force(step:step + 1, self%column(w):self%column(w) + size(change) - 1))
         change = f(2, :) - f(1, :)
      end associate
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
