!> State of a block during Newmark's march, in which every sample has its own time and step size.
!>
!> Time is counted in ticks of the smallest step, dt/2^max_halvings, from the start of the present
!> piece of force, so that times and step sizes are whole numbers. A sample has two slots for its
!> motion: one holds its present motion, the other that at the end of a trial step.
module dynamics_newmark_block
   use core_alignment, only: aligned_memory
   use core_kinds, only: long, wp
   use dynamics_joint, only: add_frictionless_slip, count_open_slips, enter_transition, slider_at
   use dynamics_newmark_frame, only: newmark_frame
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: newmark_block, newmark_trial, load_block, store_block

   !> Trial step of a sample.
   type :: newmark_trial
      integer :: sample = 0, slot = 0           !! slot of the present motion
      integer :: level = 0, pattern = 0         !! h = dt/2^level; see newmark_block
      integer :: entry = 0                      !! see newmark_matrices
      integer :: step = 0, column = 0           !! step of the force; column before its first force
   end type newmark_trial

   !> State of all samples. Rows are those of the frame, padded to whole registers.
   type :: newmark_block
      type(newmark_frame) :: frame
      integer :: n_joints = 0, n_forces = 0, n_samples = 0
      integer :: max_halvings = 0
      real(wp) :: dt = 0.0_wp                     !! [s]
      real(wp), allocatable :: force(:, :)        !! (0:step, force, or force and sample) [N]
      integer, allocatable :: column(:)           !! (sample) column before its first force
      integer(long), allocatable :: tick(:)       !! (sample) present time
      integer(long), allocatable :: step_ticks(:)      !! (sample) length of the next step
      integer(long), allocatable :: failed_tick(:)     !! (sample) end of the last failed trial
      integer(long), allocatable :: slot(:)       !! (sample) 0 or 1: slot of the present motion
      integer, allocatable :: pattern(:)          !! (sample) short frames: bit j-1 is 1: j is stuck
      !> (row; a, v, x; slot; sample)
      real(wp), pointer, contiguous :: motion(:, :, :, :) => null()
      !> (row; slider, reach, direction, stiffness; sample). For a slipping joint reach is huge and
      !> stiffness 0; direction is 0 for a stuck joint and for one without friction
      real(wp), pointer, contiguous :: bounds(:, :, :) => null()
      logical :: has_frictionless = .false.
      real(wp), allocatable :: reach(:, :)        !! mu N/k (joint, sample) [m]
      ! buffers
      type(newmark_trial), allocatable :: trials(:)
      real(wp), pointer, contiguous :: push(:, :) => null()   !! p (row, trial)
      integer, allocatable :: list(:)               !! joints
      real(wp), allocatable :: factor(:, :)         !! (joint + 1, joint)
      real(wp), allocatable :: margin(:, :)         !! guards at both ends of a step (row, 0:1)
      real(wp), private :: tick_size = 0.0_wp     !! length of a tick [s]
      type(aligned_memory), private :: memory
   contains
      procedure :: list_trials
      procedure :: switch_at_nearer_end
      procedure :: count_step
   end type newmark_block

contains

   !> Copies all samples from a state, for a march under a piece of force.
   subroutine load_block(frame, dt, max_halvings, force, state, block)
      type(newmark_frame), intent(in) :: frame
      real(wp), intent(in) :: dt
      integer, intent(in) :: max_halvings
      real(wp), intent(in) :: force(0:, :)   !! (step, force, or force and sample) [N]
      type(block_state), intent(in) :: state
      type(newmark_block), intent(inout) :: block
      real(wp), pointer, contiguous :: planes(:, :, :)
      integer :: j, m, rows, samples, w

      samples = state%n_samples
      m = state%n_joints
      rows = frame%n_padded
      block%frame = frame
      block%n_joints = m
      block%n_forces = frame%structure%n_forces
      block%n_samples = samples
      block%max_halvings = max_halvings
      block%dt = dt
      block%tick_size = 0.5_wp**max_halvings*dt
      allocate (block%force(0:ubound(force, 1), size(force, 2)))
      block%force(:, :) = force
      block%column = [(min(block%n_forces*(w - 1), size(force, 2) - block%n_forces), &
                       w=1, samples)]
      block%reach = state%slip_limit/spread(frame%structure%joint_stiffness, 2, samples)
      block%has_frictionless = any(.not. block%reach > 0.0_wp)
      allocate (block%tick(samples), block%failed_tick(samples), block%slot(samples), &
                source=0_long)
      allocate (block%step_ticks(samples), source=shiftl(1_long, max_halvings))
      allocate (block%pattern(samples), block%list(m + 1), source=0)
      allocate (block%trials(samples))
      allocate (block%factor(m + 1, m), block%margin(rows, 0:1), source=0.0_wp)
      call block%memory%reserve(11_long*rows*samples)
      call block%memory%assign_planes([rows, 3, 2*samples], planes)
      block%motion(1:rows, 1:3, 0:1, 1:samples) => planes
      call block%memory%assign_planes([rows, 4, samples], block%bounds)
      call block%memory%assign_planes([rows, samples, 1], planes)
      block%push(1:rows, 1:samples) => planes
      block%bounds(:, 2, :) = huge(1.0_wp)
      do w = 1, samples
         call frame%rows%multiply(state%velocity(:, w), block%motion(:frame%n_rows, 2, 0, w))
         call frame%rows%multiply(state%displacement(:, w), block%motion(:frame%n_rows, 3, 0, w))
         do j = 1, m
            call set_regime(block, j, w, state%account(j, w)%direction, state%slider(j, w))
         end do
         call find_accelerations(block, state, w)
      end do
   end subroutine load_block

   !> Copies all samples to the state at the end of the piece, and counts their present slips.
   subroutine store_block(block, state)
      type(newmark_block), intent(in) :: block
      type(block_state), intent(inout) :: state
      integer :: w

      do w = 1, block%n_samples
         associate (motion => block%motion(:, :, block%slot(w), w), row => block%frame%row, &
                    direction => state%account(:, w)%direction)
            state%velocity(:, w) = motion(:block%frame%n_dof, 2)
            state%displacement(:, w) = motion(:block%frame%n_dof, 3)
            state%slider(:, w) = merge(block%bounds(row, 1, w), &
                                       slider_at(motion(row, 3), direction, block%reach(:, w)), &
                                       direction == 0)
         end associate
      end do
      state%step = state%step + ubound(block%force, 1)
      call count_open_slips(block%frame%structure, state%step*block%dt, state)
   end subroutine store_block

   !> Lists the next trial steps of some samples.
   pure subroutine list_trials(self, sample)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: sample(:)
      integer :: k, level, w

      do k = 1, size(sample)
         w = sample(k)
         level = self%max_halvings - trailz(self%step_ticks(w))
         associate (trial => self%trials(k))
            trial%sample = w
            trial%slot = int(self%slot(w))
            trial%level = level
            trial%pattern = self%pattern(w)
            trial%entry = (self%max_halvings + 1)*trial%pattern + level
            trial%step = int(shiftr(self%tick(w), self%max_halvings))
            trial%column = self%column(w)
         end associate
      end do
   end subroutine list_trials

   !> Makes the transitions of a smallest step of sample w in which joints cross their limits, at
   !> the end of the step that is nearer to the first crossing. The start is nearer if the margin
   !> there is smaller than the excess at the end (linear interpolation).
   subroutine switch_at_nearer_end(self, state, w)
      class(newmark_block), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      integer :: i, j
      integer(long) :: new, nearer, old

      old = self%slot(w)
      new = 1 - old
      call find_margins(size(self%bounds, 1), self%bounds(:, :, w), self%motion(:, :, :, w), &
                        self%margin)
      nearer = new
      do j = 1, self%n_joints
         i = self%frame%row(j)
         if (self%margin(i, new) < 0.0_wp .and. is_nearer(i) .and. may_switch(i, old)) nearer = old
      end do
      if (nearer == new) then
         call self%count_step(state, w)
         self%tick(w) = self%tick(w) + 1
         self%slot(w) = new
      end if
      do j = 1, self%n_joints
         i = self%frame%row(j)
         if (.not. self%margin(i, new) < 0.0_wp) cycle
         if (nearer == old .and. .not. is_nearer(i)) cycle
         if (.not. may_switch(i, nearer)) cycle
         call switch(self, state, j, w, &
                     merge(1, -1, self%motion(i, 3, new, w) > self%bounds(i, 1, w)))
      end do
      self%failed_tick(w) = 0
      self%step_ticks(w) = shiftl(1_long, min(trailz(self%tick(w)), self%max_halvings))

   contains

      !> True if the joint of row i is nearer to its limit at the start than at the end.
      pure logical function is_nearer(i)
         integer, intent(in) :: i

         is_nearer = self%margin(i, old) < -self%margin(i, new)
      end function is_nearer

      !> True if the joint of row i, beyond its limit at the end, may switch at an end of the step:
      !> a slipping one always, a stuck one if it moves outwards there.
      pure logical function may_switch(i, slot)
         integer, intent(in) :: i
         integer(long), intent(in) :: slot

         may_switch = .not. self%bounds(i, 4, w) > 0.0_wp
         if (.not. may_switch) may_switch = &
            self%motion(i, 2, slot, w)*(self%motion(i, 3, new, w) - self%bounds(i, 1, w)) > 0.0_wp
      end function may_switch

   end subroutine switch_at_nearer_end

   !> Finds the guards of all joints at both ends of a step: the extension left to a stuck joint
   !> [m], the velocity of a slipping one [m/s] (dynamics_joint).
   pure subroutine find_margins(rows, bounds, motion, margin)
      integer, intent(in) :: rows
      real(wp), intent(in) :: bounds(rows, 4), motion(rows, 3, 0:1)
      real(wp), intent(out) :: margin(rows, 0:1)
      integer :: end, j

      do end = 0, 1
         !$omp simd
         do j = 1, rows
            margin(j, end) = merge(bounds(j, 2) - abs(motion(j, 3, end) - bounds(j, 1)), &
                                   bounds(j, 3)*motion(j, 2, end), bounds(j, 4) > 0.0_wp)
         end do
      end do
   end subroutine find_margins

   !> Switches joint j. One that starts to slip carries mu N instead of its spring's force. One that
   !> sticks loses its velocity, which reduces the dampers' forces, and its spring carries at most
   !> mu N.
   subroutine switch(self, state, j, w, outwards)
      type(newmark_block), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: j, w
      integer, intent(in) :: outwards   !! direction of a slip that starts, +1 or -1
      real(wp) :: place, slider, speed
      integer :: direction

      slider = 0.0_wp
      direction = merge(outwards, 0, state%account(j, w)%direction == 0)
      associate (motion => self%motion(:self%frame%n_rows, :, self%slot(w), w), &
                 bounds => self%bounds(self%frame%row(j), :, w), reach => self%reach(j, w))
         place = motion(self%frame%row(j), 3)
         if (direction /= 0) then
            motion(:, 1) = motion(:, 1) - self%frame%slip_gain(:, j) &
                           *(bounds(4)*(direction*reach - (place - bounds(1))))
         else
            speed = motion(self%frame%row(j), 2)
            motion(:, 1) = motion(:, 1) + self%frame%damping_gain(:, j)*speed
            motion(:, 2) = motion(:, 2) - self%frame%velocity_loss(:, j)*speed
            slider = slider_at(place, state%account(j, w)%direction, reach)
            do while (abs(place - slider) > reach)   ! by rounding
               slider = nearest(slider, place - slider)
            end do
         end if
      end associate
      call set_regime(self, j, w, direction, slider)
      call enter_transition(state, j, w, state%step*self%dt + self%tick(w)*self%tick_size, place, &
                            direction)
   end subroutine switch

   !> Sets bounds and pattern of a joint that slips in a direction, or is stuck (0). One without
   !> friction always slips.
   pure subroutine set_regime(self, j, w, direction, slider)
      type(newmark_block), intent(inout) :: self
      integer, intent(in) :: j, w, direction
      real(wp), intent(in) :: slider

      associate (bounds => self%bounds(self%frame%row(j), :, w))
         if (direction == 0) then
            bounds = [slider, self%reach(j, w), 0.0_wp, self%frame%structure%joint_stiffness(j)]
         else
            bounds = [0.0_wp, huge(1.0_wp), 0.0_wp, 0.0_wp]
            if (self%reach(j, w) > 0.0_wp) bounds(3) = direction
         end if
      end associate
      if (self%frame%is_short) self%pattern(w) = &
         merge(ibset(self%pattern(w), j - 1), ibclr(self%pattern(w), j - 1), direction == 0)
   end subroutine set_regime

   !> Finds the accelerations of sample w from the equation of motion.
   pure subroutine find_accelerations(self, state, w)
      type(newmark_block), intent(inout) :: self
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      real(wp) :: pull
      real(wp), allocatable :: force(:)   ! (dof) [N]
      integer :: j

      associate (frame => self%frame, structure => self%frame%structure, &
                 motion => self%motion(:, :, self%slot(w), w))
         force = matmul(structure%load, force_at(self, w, 0.0_wp)) &
                 - matmul(structure%damping, motion(:frame%n_dof, 2)) &
                 - matmul(structure%stiffness, motion(:frame%n_dof, 3))
         do j = 1, self%n_joints
            pull = state%account(j, w)%direction*state%slip_limit(j, w)
            if (state%account(j, w)%direction == 0) &
               pull = structure%joint_stiffness(j) &
                      *(motion(frame%row(j), 3) - self%bounds(frame%row(j), 1, w))
            force = force - pull*structure%direction(:, j)
         end do
         call frame%rows%multiply(matmul(frame%inverse_mass, force), motion(:frame%n_rows, 1))
      end associate
   end subroutine find_accelerations

   !> Counts the work, if wanted, and the slip of joints without friction over the trial step of
   !> sample w.
   pure subroutine count_step(self, state, w)
      class(newmark_block), intent(in) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      integer :: j

      if (state%keeps_ledger) call add_work(self, state, w)
      if (.not. self%has_frictionless) return
      associate (old => self%slot(w), row => self%frame%row, h => self%step_ticks(w)*self%tick_size)
         do j = 1, self%n_joints
            if (self%reach(j, w) > 0.0_wp) cycle
            call add_frictionless_slip(self%motion(row(j), 3, 1 - old, w), &
                                       h*self%motion(row(j), 2, [old, 1 - old], w), &
                                       state%account(j, w))
         end do
      end associate
   end subroutine count_step

   !> Adds the work of the forces and the dampers over the trial step of sample w. With average
   !> acceleration, mean force times displacement, less the dampers' work at the mean velocity and
   !> that of the joints, is the change of the stored energy to rounding.
   pure subroutine add_work(self, state, w)
      class(newmark_block), intent(in) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      real(wp) :: dx(self%frame%n_dof)

      associate (structure => self%frame%structure, n => self%frame%n_dof)
         dx = self%motion(:n, 3, 1 - self%slot(w), w) - self%motion(:n, 3, self%slot(w), w)
         state%work_input(w) = state%work_input(w) &
                               + dot_product(matmul(structure%load, force_at( &
                                                    self, w, 0.5_wp*self%step_ticks(w))), dx)
         state%work_viscous(w) = state%work_viscous(w) &
                                 + dot_product(dx, matmul(structure%damping, dx)) &
                                 /(self%step_ticks(w)*self%tick_size)
      end associate
   end subroutine add_work

   !> Forces on sample w (force) some ticks from now [N], linear within a step.
   pure function force_at(self, w, ahead) result(force)
      type(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      real(wp), intent(in) :: ahead   !! ticks from now
      real(wp) :: force(self%frame%structure%n_forces)
      integer :: step
      real(wp) :: share

      step = min(int(shiftr(self%tick(w), self%max_halvings)), ubound(self%force, 1) - 1)
      share = ((self%tick(w) - shiftl(int(step, long), self%max_halvings)) + ahead) &
              *self%tick_size/self%dt
      associate (f => self%force(step:step + 1, self%column(w) + 1:self%column(w) + size(force)))
         force = f(1, :) + share*(f(2, :) - f(1, :))
      end associate
   end function force_at

end module dynamics_newmark_block
