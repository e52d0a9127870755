!> The paper's march (Sec. 3): Newmark's scheme, in which a step that ends past a transition is
!> halved.
!>
!> Halving ends at dt/2^max_halvings, and the transition is put at the nearer end of that smallest
!> step. From there steps are as long as the halvings of dt allow. Each sample has its own time, so
!> that every round of trial steps works on many samples.
module dynamics_newmark_march
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, two_pi, wp
   use core_text, only: rounded_text, to_text
   use dynamics_newmark_block, only: load_block, newmark_block, store_block
   use dynamics_newmark_frame, only: new_newmark_frame, newmark_frame
   use dynamics_newmark_matrices, only: new_newmark_matrices, newmark_matrices
   use dynamics_newmark_steps, only: try_steps
   use dynamics_response, only: block_state, marcher_type
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: check_newmark, longest_step, most_halvings, newmark_marcher, new_newmark

   integer, parameter :: most_halvings = 30   !! so that ticks fit into 64 bits

   !> March by Newmark's scheme, prepared for one structure and time step.
   type, extends(marcher_type) :: newmark_marcher
      type(newmark_matrices), private :: matrices
   contains
      procedure :: advance
   end type newmark_marcher

contains

   !> Prepares Newmark's scheme for one structure; average acceleration is beta = 1/4, gamma = 1/2.
   subroutine new_newmark(structure, dt, max_halvings, beta, gamma, marcher, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt                 !! [s]
      integer, intent(in) :: max_halvings        !! smallest step dt/2^max_halvings
      real(wp), intent(in) :: beta, gamma
      type(newmark_marcher), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      type(newmark_frame) :: frame

      call check_newmark(structure, dt, max_halvings, beta, gamma, error)
      if (allocated(error)) return
      marcher%structure = structure
      marcher%dt = dt
      call new_newmark_frame(structure, frame, error)
      if (allocated(error)) return
      call new_newmark_matrices(frame, dt, max_halvings, beta, gamma, marcher%matrices, error)
      if (.not. allocated(error)) marcher%work = marcher%matrices%work()
   end subroutine new_newmark

   !> Longest stable step of the scheme [s]: any step if 2 beta >= gamma >= 1/2, else 1/(omega
   !> sqrt(gamma/2 - beta)) with the fastest omega, all joints stuck (Newmark's bound for linear
   !> structures, at any damping).
   pure real(wp) function longest_step(structure, beta, gamma)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: beta, gamma

      longest_step = huge(1.0_wp)
      if (beta < gamma/2) longest_step = &
         1.0_wp/(sqrt(gamma/2 - beta)*two_pi*maxval(structure%frequencies_stuck))
   end function longest_step

   !> Refuses parameters that the scheme cannot march with.
   pure subroutine check_newmark(structure, dt, max_halvings, beta, gamma, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt, beta, gamma
      integer, intent(in) :: max_halvings
      type(error_type), allocatable, intent(out) :: error

      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%dt = '//to_text(dt)//': must be positive')
      else if (max_halvings < 0 .or. max_halvings > most_halvings) then
         call raise(error, exit_bad_input, 'integration%max_halvings = '//to_text(max_halvings)// &
                    ': must be 0 to '//to_text(most_halvings))
      else if (.not. gamma >= 0.5_wp) then
         call raise(error, exit_bad_input, 'integration%gamma = '//to_text(gamma)// &
                    ': must be 0.5 or more, the scheme is unstable below')
      else if (.not. beta >= 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%beta = '//to_text(beta)// &
                    ': must not be negative')
      else if (dt > longest_step(structure, beta, gamma)) then
         call raise(error, exit_bad_input, 'integration%beta = '//to_text(beta)// &
                    ': must be at least gamma/2, or dt at most '// &
                    rounded_text(longest_step(structure, beta, gamma), 6, down=.true.)// &
                    ' s: the scheme would diverge')
      end if
   end subroutine check_newmark

   !> See marcher_type.
   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(newmark_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)
      real(wp), intent(out), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(newmark_block) :: block
      integer(long) :: next_tick(state%n_samples)   ! time of the next record; -1: none
      integer(long) :: last, record_ticks           ! end; time between records
      integer :: k, n_active, n_due, n_records(state%n_samples), n_switching, w
      integer, dimension(state%n_samples + 1) :: sample, due, switching
      integer(long), dimension(state%n_samples) :: has_crossed, is_active, is_due, is_switching

      if (ubound(force, 1) == 0) return
      call load_block(self%matrices%frame, self%dt, self%matrices%max_halvings, force, state, block)
      n_records = 0
      next_tick = -1
      record_ticks = shiftl(int(every, long), block%max_halvings)
      ! state%step counts from the start of the march, ticks from the start of this piece
      if (size(displacement) > 0) &
         next_tick = record_ticks - shiftl(modulo(state%step, int(every, long)), block%max_halvings)
      last = shiftl(int(ubound(force, 1), long), block%max_halvings)
      sample = [(w, w=1, state%n_samples + 1)]
      n_active = state%n_samples
      do while (n_active > 0)   ! a trial step of each sample that is not at the end
         has_crossed = 0
         call try_steps(self%matrices, sample(:n_active), block, has_crossed)
         if (state%keeps_ledger .or. block%has_frictionless) then
            do k = 1, n_active
               if (has_crossed(sample(k)) == 0) call block%count_step(state, sample(k))
            end do
         end if
         call finish_trials(block, last, has_crossed, next_tick, is_active, is_due, is_switching)
         call list_marked(is_active, sample, n_active)
         call list_marked(is_due, due, n_due)
         call list_marked(is_switching, switching, n_switching)
         do k = 1, n_switching
            w = switching(k)
            call block%switch_at_nearer_end(state, w)
            if (block%tick(w) == next_tick(w)) call append(w, due, n_due)
            if (block%tick(w) < last) call append(w, sample, n_active)
         end do
         do k = 1, n_due
            w = due(k)
            n_records(w) = n_records(w) + 1
            next_tick(w) = next_tick(w) + record_ticks
            associate (motion => block%motion(:block%frame%n_dof, :, block%slot(w), w))
               displacement(n_records(w), :, w) = motion(:, 3)
               if (present(velocity)) velocity(n_records(w), :, w) = motion(:, 2)
            end associate
         end do
      end do
      call store_block(block, state)
   end subroutine advance

   !> Accepts or refuses the trials of all samples before the last tick, and finds their next steps.
   !> A refused step is halved. Later steps take at most half the time to its end, at last one tick.
   !> Marks the samples that switch now (refused at the smallest step), those whose record is due,
   !> and those that march on without a switch. Without branches, which could not be predicted.
   pure subroutine finish_trials(block, last, has_crossed, next_tick, is_active, is_due, &
                                 is_switching)
      type(newmark_block), intent(inout) :: block
      integer(long), intent(in) :: last
      integer(long), dimension(block%n_samples), intent(in) :: has_crossed, next_tick
      integer(long), dimension(block%n_samples), intent(out) :: is_active, is_due, is_switching
      integer(long) :: full_step   ! ticks of a step of dt
      integer :: w

      full_step = shiftl(1_long, block%max_halvings)
      associate (tick => block%tick, ticks => block%step_ticks, slot => block%slot, &
                 failed => block%failed_tick)
         !$omp simd
         do w = 1, block%n_samples
            block
               integer(long) :: stands, fails, now, longest, next

               fails = merge(has_crossed(w), 0_long, tick(w) < last)
               stands = merge(1_long - has_crossed(w), 0_long, tick(w) < last)
               is_switching(w) = merge(fails, 0_long, ticks(w) == 1)
               now = tick(w) + stands*ticks(w)
               longest = iand(ior(now, full_step), -ior(now, full_step))   ! power of 2, divides now
               next = merge(longest, ticks(w), stands == 1)
               failed(w) = merge(now + ticks(w), failed(w), fails == 1)
               next = merge(min(next, shiftr(failed(w) - now, 1)), next, now < failed(w))
               ticks(w) = max(next, 1_long)
               tick(w) = now
               slot(w) = ieor(slot(w), stands)
               is_due(w) = merge(stands, 0_long, now == next_tick(w))
               is_active(w) = merge(1_long - is_switching(w), 0_long, now < last)
            end block
         end do
      end associate
   end subroutine finish_trials

   !> Lists the numbers of the samples marked with 1.
   pure subroutine list_marked(is_marked, list, n)
      integer(long), intent(in) :: is_marked(:)   !! (sample) 1 or 0
      integer, intent(out) :: list(:)             !! longer by one than is_marked
      integer, intent(out) :: n
      integer :: w

      n = 0
      do w = 1, size(is_marked)
         list(n + 1) = w
         n = n + int(is_marked(w))
      end do
   end subroutine list_marked

   !> Appends a number to a list.
   pure subroutine append(number, list, n)
      integer, intent(in) :: number
      integer, intent(inout) :: list(:), n

      n = n + 1
      list(n) = number
   end subroutine append

end module dynamics_newmark_march
