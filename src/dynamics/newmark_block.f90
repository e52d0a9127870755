!> A block of samples while Newmark's scheme marches it: every sample at its own time and step size.
!>
!> Time is counted in ticks of the smallest step, dt/2^max_halvings, from the beginning of the piece that
!> is marched: where a step begins and how long it may be are then whole numbers. A sample has two slots
!> for its motion: one holds the present, the other takes the step that is being tried.
module dynamics_newmark_block
   use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: newmark_block, load_block, store_block, first_aligned, register_width

   integer, parameter :: register_width = 8   !! reals; a sample's columns are padded to whole registers

   type :: newmark_block
      integer :: n_dof = 0, n_samples = 0
      integer :: forced_dof = 0
      integer :: max_halvings = 0
      real(wp) :: dt = 0.0_wp
      real(wp), allocatable :: force(:, :)            !! (0:step, 1 or sample) [N]
      integer, allocatable :: column(:)               !! (sample) of the force
      integer(long), allocatable :: tick(:)           !! (sample) now
      integer, allocatable :: level(:)                !! (sample) the next step is dt/2^level
      integer, allocatable :: slot(:)                 !! (sample) 0 or 1: where the present motion is
      integer, allocatable :: pattern(:)              !! (sample) bit i-1: dof i is stuck; of short chains
      real(wp), pointer, contiguous :: motion(:, :, :, :) => null()  !! (dof; a, v, x; slot; sample)
      real(wp), pointer, contiguous :: bounds(:, :, :) => null()     !! (dof; slider, reach, way; sample)
      real(wp), allocatable :: reach(:, :)            !! (dof, sample) mu N/k: a contact spring's most [m]
      integer(long), allocatable :: slip_begin(:, :)  !! (dof, sample) slip time is accounted for until here
      real(wp), pointer, contiguous, private :: memory(:) => null()
   contains
      procedure :: switch_at_nearer_end
      procedure :: add_work
      procedure, private :: change_regime
      procedure, private :: set_regime
      procedure, private :: balance
      procedure, private :: force_at
      procedure, private :: seconds
      final :: free_block
   end type newmark_block

contains

   !> Takes the samples over from the state, for a march under this piece of force.
   subroutine load_block(chain, dt, forced_dof, max_halvings, force, state, block)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: dt
      integer, intent(in) :: forced_dof, max_halvings
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N]
      type(block_state), intent(in) :: state
      type(newmark_block), intent(inout) :: block
      integer :: first, i, rows, w, samples

      samples = state%n_samples
      rows = register_width*((state%n_dof + register_width - 1)/register_width)
      block%n_dof = state%n_dof
      block%n_samples = samples
      block%forced_dof = forced_dof
      block%max_halvings = max_halvings
      block%dt = dt
      allocate (block%force(0:ubound(force, 1), size(force, 2)))
      block%force(:, :) = force
      block%column = [(min(w, size(force, 2)), w=1, samples)]
      block%reach = state%slip_limit/spread(chain%contact_stiffness, 2, samples)
      allocate (block%tick(samples), block%slip_begin(state%n_dof, samples), source=0_long)
      allocate (block%level(samples), block%slot(samples), block%pattern(samples), source=0)

      allocate (block%memory(9*rows*samples + register_width), source=0.0_wp)
      first = first_aligned(block%memory)
      block%motion(1:rows, 1:3, 0:1, 1:samples) => block%memory(first:)
      block%bounds(1:rows, 1:3, 1:samples) => block%memory(first + 6*rows*samples:)
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
   end subroutine store_block

   !> A smallest step of sample w has passed a slider's limit: the transition is put at its nearer end.
   !>
   !> The end is chosen by linear interpolation, and the earliest transition decides. A slider starts to
   !> slip only if its mass moves outward at that end.
   subroutine switch_at_nearer_end(self, chain, state, w)
      class(newmark_block), intent(inout) :: self
      type(chain_type), intent(in) :: chain
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      real(wp) :: way(self%n_dof), before, after, outward
      logical :: has_passed(self%n_dof), is_at_begin(self%n_dof)
      integer :: i

      associate (begin => self%motion(:, :, self%slot(w), w), end => self%motion(:, :, 1 - self%slot(w), w), &
                 bounds => self%bounds(:, :, w))
         do i = 1, self%n_dof
            if (state%direction(i, w) == 0) then
               way(i) = sign(1.0_wp, end(i, 3) - bounds(i, 1))
               before = bounds(i, 2) - abs(begin(i, 3) - bounds(i, 1))
               after = bounds(i, 2) - abs(end(i, 3) - bounds(i, 1))
               outward = way(i)*begin(i, 2)
               has_passed(i) = after < 0.0_wp
               is_at_begin(i) = has_passed(i) .and. before < -after .and. outward > 0.0_wp
            else
               way(i) = 0.0_wp
               before = bounds(i, 3)*begin(i, 2)
               after = bounds(i, 3)*end(i, 2)
               has_passed(i) = after < 0.0_wp
               is_at_begin(i) = has_passed(i) .and. before < -after
            end if
         end do
         if (any(is_at_begin)) then
            has_passed = is_at_begin
         else
            where (abs(way) > 0.0_wp) has_passed = has_passed .and. way*end(:self%n_dof, 2) > 0.0_wp
         end if
      end associate
      if (.not. any(is_at_begin)) then
         if (state%keeps_ledger) call self%add_work(chain, state, w)
         self%tick(w) = self%tick(w) + 1
         self%slot(w) = 1 - self%slot(w)
      end if
      do i = 1, self%n_dof
         if (has_passed(i)) call self%change_regime(i, w, nint(way(i)), state)
      end do
      if (any(has_passed)) call self%balance(chain, state, w)
   end subroutine switch_at_nearer_end

   !> The slider of dof i slips from now on, in the given direction, or sticks (0).
   !> To stick is to stand still, with a spring that carries no more than mu N.
   subroutine change_regime(self, i, w, direction, state)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: i, w, direction
      type(block_state), intent(inout) :: state
      real(wp) :: slider

      slider = 0.0_wp
      if (direction == 0) then
         associate (motion => self%motion(:, :, self%slot(w), w), reach => self%reach(i, w))
            motion(i, 2) = 0.0_wp
            slider = motion(i, 3) - state%direction(i, w)*reach
            do while (abs(motion(i, 3) - slider) > reach)   ! by rounding
               slider = nearest(slider, motion(i, 3) - slider)
            end do
         end associate
         state%stick_starts(i, w) = state%stick_starts(i, w) + 1
         state%slip_time(i, w) = state%slip_time(i, w) + self%seconds(self%tick(w) - self%slip_begin(i, w))
      else
         state%slip_starts(i, w) = state%slip_starts(i, w) + 1
         self%slip_begin(i, w) = self%tick(w)
      end if
      state%direction(i, w) = direction
      call self%set_regime(i, w, direction, slider)
      if (state%keeps_transitions) call state%transitions(w)%append( &
         state%step*self%dt + self%seconds(self%tick(w)), i, direction)
   end subroutine change_regime

   !> Bounds and pattern of a slider that slips in a direction, or is stuck (0).
   !> One that carries nothing (mu N = 0) slips for ever.
   pure subroutine set_regime(self, i, w, direction, slider)
      class(newmark_block), intent(inout) :: self
      integer, intent(in) :: i, w, direction
      real(wp), intent(in) :: slider

      if (direction == 0) then
         self%bounds(i, :, w) = [slider, self%reach(i, w), 0.0_wp]
      else
         self%bounds(i, :, w) = [0.0_wp, huge(1.0_wp), &
                                 merge(real(direction, wp), 0.0_wp, self%reach(i, w) > 0.0_wp)]
      end if
      if (self%n_dof > register_width) return
      self%pattern(w) = merge(ibset(self%pattern(w), i - 1), ibclr(self%pattern(w), i - 1), direction == 0)
   end subroutine set_regime

   !> Accelerations from the equation of motion, now.
   pure subroutine balance(self, chain, state, w)
      class(newmark_block), intent(inout) :: self
      type(chain_type), intent(in) :: chain
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      real(wp) :: spring(self%n_dof), rest(self%n_dof)
      integer :: n

      n = self%n_dof
      associate (a => self%motion(:n, 1, self%slot(w), w), v => self%motion(:n, 2, self%slot(w), w), &
                 x => self%motion(:n, 3, self%slot(w), w))
         spring = merge(x - self%bounds(:n, 1, w), state%direction(:, w)*self%reach(:, w), &
                        state%direction(:, w) == 0)
         rest = -matmul(chain%damping, v) - matmul(chain%coupling, x) - chain%contact_stiffness*spring
         rest(self%forced_dof) = rest(self%forced_dof) + self%force_at(w, self%tick(w))
         a = rest/chain%mass
      end associate
   end subroutine balance

   !> Adds the work of the step that sample w has tried: of the force, the dampers and the sliders.
   !> With average acceleration it is the change of the stored energy, to rounding.
   pure subroutine add_work(self, chain, state, w)
      class(newmark_block), intent(in) :: self
      type(chain_type), intent(in) :: chain
      type(block_state), intent(inout) :: state
      integer, intent(in) :: w
      real(wp) :: way(self%n_dof), h
      integer(long) :: ticks
      integer :: n

      n = self%n_dof
      ticks = ishft(1_long, self%max_halvings - self%level(w))
      h = self%seconds(ticks)
      way = self%motion(:n, 3, 1 - self%slot(w), w) - self%motion(:n, 3, self%slot(w), w)
      state%work_input(w) = state%work_input(w) + 0.5_wp*way(self%forced_dof)* &
                            (self%force_at(w, self%tick(w)) + self%force_at(w, self%tick(w) + ticks))
      state%work_viscous(w) = state%work_viscous(w) + dot_product(way, matmul(chain%damping, way))/h
      state%work_friction(w) = state%work_friction(w) + &
                               sum(state%direction(:, w)*state%slip_limit(:, w)*way)
   end subroutine add_work

   !> The force on sample w at a tick, linear within a step.
   pure function force_at(self, w, tick) result(force)
      class(newmark_block), intent(in) :: self
      integer, intent(in) :: w
      integer(long), intent(in) :: tick
      real(wp) :: force
      integer :: step
      real(wp) :: share

      step = min(int(ishft(tick, -self%max_halvings)), ubound(self%force, 1) - 1)
      share = real(tick - ishft(int(step, long), self%max_halvings), wp)*0.5_wp**self%max_halvings
      associate (f => self%force, column => self%column(w))
         force = f(step, column) + share*(f(step + 1, column) - f(step, column))
      end associate
   end function force_at

   pure function seconds(self, ticks) result(time)
      class(newmark_block), intent(in) :: self
      integer(long), intent(in) :: ticks
      real(wp) :: time

      time = ticks*0.5_wp**self%max_halvings*self%dt
   end function seconds

   subroutine free_block(self)
      type(newmark_block), intent(inout) :: self

      if (associated(self%memory)) deallocate (self%memory)
   end subroutine free_block

   !> Where in the memory the first whole cache line begins: registers then load from one line only.
   function first_aligned(memory) result(first)
      real(wp), intent(in), target, contiguous :: memory(:)
      integer :: first
      integer(c_intptr_t), parameter :: line = 64

      first = 1 + int(modulo(-transfer(c_loc(memory), 0_c_intptr_t), line))/8
   end function first_aligned

end module dynamics_newmark_block
