!> The paper's march (Sec. 3): Newmark's scheme, with the step halved where a transition shows at its end.
!>
!> Halving ends at dt/2^max_halvings, and the transition is put at the nearer end of that smallest step.
!> From there the steps are as long as the halvings of dt allow, to the end of dt. Samples march
!> independently of each other, each at its own time, so that the processor always has several at hand.
module dynamics_newmark
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use dynamics_chain, only: chain_type
   use dynamics_newmark_block, only: load_block, newmark_block, store_block
   use dynamics_newmark_steps, only: new_newmark_steps, newmark_steps
   use dynamics_response, only: block_state, marcher_type
   implicit none(type, external)
   private
   public :: newmark_marcher, new_newmark

   integer, parameter :: most_halvings = 30   !! time is a whole number of smallest steps, of 64 bits

   type, extends(marcher_type) :: newmark_marcher
      type(newmark_steps), private :: steps
   contains
      procedure :: advance
   end type newmark_marcher

   !> Where the displacements (and velocities) after each `every`-th step go.
   type :: recorder_type
      integer :: every = 0                            !! 0: nowhere
      integer(long), allocatable :: next_tick(:)      !! (sample)
      integer, allocatable :: next_record(:)          !! (sample)
   end type recorder_type

contains

   !> Newmark's scheme for one chain, average acceleration with beta = 1/4 and gamma = 1/2.
   subroutine new_newmark(chain, dt, max_halvings, beta, gamma, forced_dof, marcher, error)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings        !! smallest step dt/2^max_halvings
      real(wp), intent(in) :: beta, gamma
      integer, intent(in) :: forced_dof
      type(newmark_marcher), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error

      call check_parameters(chain, dt, max_halvings, beta, gamma, forced_dof, error)
      if (allocated(error)) return
      marcher%chain = chain
      marcher%dt = dt
      marcher%forced_dof = forced_dof
      call new_newmark_steps(chain, dt, max_halvings, beta, gamma, forced_dof, marcher%steps, error)
   end subroutine new_newmark

   !> Refuses what cannot be marched. The scheme is stable for every step if 2 beta >= gamma >= 1/2;
   !> below, if omega dt <= 1/sqrt(gamma/2 - beta) for the fastest mode, that of the stuck chain.
   pure subroutine check_parameters(chain, dt, max_halvings, beta, gamma, forced_dof, error)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: dt, beta, gamma
      integer, intent(in) :: max_halvings, forced_dof
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      real(wp) :: rate

      rate = two_pi*maxval(chain%frequencies_stuck)
      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%dt = '//to_text(dt)//': must be positive')
      else if (max_halvings < 0 .or. max_halvings > most_halvings) then
         call raise(error, exit_bad_input, 'integration%max_halvings = '//to_text(max_halvings)// &
                    ': must be 0 to '//to_text(most_halvings))
      else if (.not. gamma >= 0.5_wp) then
         call raise(error, exit_bad_input, 'integration%gamma = '//to_text(gamma)// &
                    ': must be 0.5 or more, the scheme is unstable below')
      else if (.not. beta >= 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%beta = '//to_text(beta)//': must not be negative')
      else if ((rate*dt)**2*(0.5_wp*gamma - beta) > 1.0_wp) then
         call raise(error, exit_bad_input, 'integration%beta = '//to_text(beta)//': with this gamma and &
                    &dt must be at least '//to_text(0.5_wp*gamma - 1.0_wp/(rate*dt)**2)//' to be stable')
      else if (forced_dof < 1 .or. forced_dof > chain%n_dof) then
         call raise(error, exit_bad_input, 'excitation%dof = '//to_text(forced_dof)//': the chain has '// &
                    to_text(chain%n_dof)//' masses')
      end if
   end subroutine check_parameters

   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(newmark_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)
      real(wp), intent(out), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: steps_in_step = 32   ! samples meet again after so many: their data stay near
      type(newmark_block) :: block
      type(recorder_type) :: recorder
      integer :: step, n_steps

      n_steps = ubound(force, 1)
      if (n_steps == 0) return
      call load_block(self%chain, self%dt, self%forced_dof, self%steps%max_halvings, force, state, block)
      call start_recorder(state, block, merge(every, 0, size(displacement) > 0), recorder)
      do step = 0, n_steps - 1, steps_in_step
         call march_to(self, min(step + steps_in_step, n_steps), state, block, recorder, &
                       displacement, velocity, error)
         if (allocated(error)) return
      end do
      call store_block(block, state)
   end subroutine advance

   !> Marches every sample to the end of a step of the force, by trials: one of each sample in a round.
   subroutine march_to(self, step, state, block, recorder, displacement, velocity, error)
      class(newmark_marcher), intent(in) :: self
      integer, intent(in) :: step
      type(block_state), intent(inout) :: state
      type(newmark_block), intent(inout) :: block
      type(recorder_type), intent(inout) :: recorder
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      integer :: sample(block%n_samples)
      integer(long) :: has_passed(block%n_samples), accepted, last
      integer :: k, most, n_active, n_left, w

      most = block%max_halvings
      last = ishft(int(step, long), most)
      sample = [(w, w=1, block%n_samples)]
      n_active = block%n_samples
      do while (n_active > 0)
         call self%steps%try(sample(:n_active), block, has_passed, error)
         if (allocated(error)) return
         n_left = 0
         do k = 1, n_active
            w = sample(k)
            if (has_passed(k) /= 0 .and. block%level(w) == most) then
               call block%switch_at_nearer_end(self%chain, state, w)
               block%level(w) = most - min(trailz(block%tick(w)), most)
            else   ! a step stands, or is halved: without a branch, for nobody can guess which
               accepted = 1 - has_passed(k)
               if (state%keeps_ledger .and. accepted == 1) call block%add_work(self%chain, state, w)
               block%tick(w) = block%tick(w) + ishft(accepted, most - block%level(w))
               block%slot(w) = ieor(block%slot(w), int(accepted))
               block%level(w) = merge(most - min(trailz(block%tick(w)), most), block%level(w) + 1, accepted == 1)
            end if
            if (block%tick(w) == recorder%next_tick(w)) &
               call record(block, w, recorder, displacement, velocity)
            n_left = n_left + 1
            sample(n_left) = w
            n_left = n_left - merge(1, 0, block%tick(w) == last)
         end do
         n_active = n_left
      end do
   end subroutine march_to

   !> Steps are counted from the start of the march, ticks from the beginning of this piece.
   pure subroutine start_recorder(state, block, every, recorder)
      type(block_state), intent(in) :: state
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: every   !! 0: nothing is recorded
      type(recorder_type), intent(out) :: recorder
      integer(long) :: first
      integer :: w

      recorder%every = every
      first = -1
      if (every > 0) first = ishft(every - modulo(state%step, int(every, long)), block%max_halvings)
      recorder%next_tick = [(first, w=1, block%n_samples)]
      recorder%next_record = [(1, w=1, block%n_samples)]
   end subroutine start_recorder

   pure subroutine record(block, w, recorder, displacement, velocity)
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: w
      type(recorder_type), intent(inout) :: recorder
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)

      associate (motion => block%motion(:block%n_dof, :, block%slot(w), w), r => recorder%next_record(w))
         displacement(r, :, w) = motion(:, 3)
         if (present(velocity)) velocity(r, :, w) = motion(:, 2)
         r = r + 1
      end associate
      recorder%next_tick(w) = recorder%next_tick(w) + ishft(int(recorder%every, long), block%max_halvings)
   end subroutine record

end module dynamics_newmark
