!> Exact march of a block, 32 samples at a time. In each part of a step it finds first the free
!> motion of all samples, then the transitions in it (docs/exact_march.md).
module dynamics_exact_block_march
   use, intrinsic :: ieee_arithmetic, only: ieee_set_underflow_mode, ieee_support_underflow_control
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_exact_base_system, only: base_system, raise_too_many
   use dynamics_exact_joint_paths, only: joint_paths, regime_slider, width
   use dynamics_exact_transitions, only: clear, examine, find_next, group_size, plain, &
                                         apply_response, load_candidates, transition_group
   use dynamics_joint, only: add_frictionless_slip, slider_at
   use dynamics_response, only: block_state, marcher_type
   implicit none(type, external)
   private
   public :: exact_march

   integer, parameter :: buffer_size = 32   !! records

   !> Exact march, prepared for one structure and time step.
   type, extends(marcher_type) :: exact_march
      real(wp) :: tolerance = 0.0_wp     !! displacement error relative to its rms
      integer :: parts = 1               !! parts in a step
      character(:), allocatable :: form  !! 'power series' or 'modes'
      !> Multiplications of one sample in a step (11); huge if the form was not tried
      real(wp) :: work_series = huge(1.0_wp), work_modes = huge(1.0_wp)
      class(base_system), allocatable :: base
   contains
      procedure :: advance
   end type exact_march

   !> Candidates of a part, in groups, and records that are not yet written out.
   type :: march_buffers
      type(transition_group), allocatable :: groups(:)
      type(transition_group) :: single     !! one joint, for march_joint
      logical :: is_independent = .true.   !! True if no sample is ever marched again
      logical :: has_frictionless = .false.
      real(wp), allocatable :: speed(:, :)   !! (lane, joint) w.v at the start of the part [m/part]
      integer :: n_buffered = 0, n_written = 0   !! records
      real(wp), allocatable :: displacement(:, :, :), velocity(:, :, :)   !! (lane, dof, record)
   end type march_buffers

contains

   !> See marcher_type. Numbers below 2e-308 are set to zero until the return: there are many ahead
   !> of a wave in a long chain, and Intel processors multiply them 50 times slower.
   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(exact_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)
      real(wp), intent(out), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(march_buffers) :: buffers
      integer :: first, last, part, step

      if (ieee_support_underflow_control(1.0_wp)) call ieee_set_underflow_mode(gradual=.false.)
      associate (base => self%base, structure => self%structure)
         base%keeps_ledger = state%keeps_ledger
         base%has_internal = allocated(state%internal)
         if (.not. base%has_internal) &
            allocate (state%internal(base%n_internal, state%n_samples), source=0.0_wp)
         buffers%has_frictionless = any(.not. state%slip_limit > 0.0_wp)
         allocate (buffers%groups(1))
         allocate (buffers%displacement(width, state%n_dof, merge(buffer_size, 0, &
                                                                  size(displacement) > 0)))
         allocate (buffers%velocity(width, merge(state%n_dof, 0, present(velocity)), &
                                    size(buffers%displacement, 3)))
         do first = 1, state%n_samples, width
            base%paths%first_sample = first
            last = min(first + width - 1, state%n_samples)
            base%paths%n_samples = last - first + 1
            call base%load_state(state)
            buffers%is_independent = all(base%paths%responses%is_local) .and. &
                                     all(base%paths%responses%undisturbed_span >= 1.0_wp)
            call base%paths%load_regimes(structure%joint_stiffness, state)
            if (buffers%has_frictionless) &
               buffers%speed = base%paths%x(:, base%paths%row, base%paths%layer(1))
            base%work_done(:last - first + 1, 1) = state%work_input(first:last)
            base%work_done(:last - first + 1, 2) = state%work_viscous(first:last)
            buffers%n_written = 0
            do step = 0, ubound(force, 1) - 1
               do part = 0, self%parts - 1
                  call set_force(base, force, step, real(part, wp)/self%parts, 1.0_wp/self%parts)
                  call march_part(base, real((state%step + step)*self%parts + part, wp), state, &
                                  buffers, error)
                  if (allocated(error)) return
               end do
               if (size(displacement) == 0) cycle
               if (modulo(state%step + step + 1, int(every, long)) == 0) &
                  call buffer_record(base, displacement, velocity, buffers)
            end do
            call flush_records(base, displacement, velocity, buffers)
            state%work_input(first:last) = base%work_done(:last - first + 1, 1)
            state%work_viscous(first:last) = base%work_done(:last - first + 1, 2)
            call base%store_state(state)
            call store_sliders(base%paths, structure%joint_stiffness, state)
         end do
         state%step = state%step + ubound(force, 1)
      end associate
   end subroutine advance

   !> Copies the sliders of all samples to the block. Those of slipping joints move with the paths.
   pure subroutine store_sliders(paths, joint_stiffness, state)
      type(joint_paths), intent(in) :: paths
      real(wp), intent(in) :: joint_stiffness(:)   !! (joint) k [N/m]
      type(block_state), intent(inout) :: state
      integer :: l, w

      do l = 1, paths%n_samples
         w = paths%first_sample + l - 1
         associate (direction => state%account(:, w)%direction)
            state%slider(:, w) = merge(paths%regime(l, :paths%n_joints, regime_slider), &
                                       slider_at(paths%x(l, paths%row, paths%layer(0)), direction, &
                                                 state%slip_limit(:, w)/joint_stiffness), &
                                       direction == 0)
         end associate
      end do
   end subroutine store_sliders

   !> Marches all lanes through one part of a step, with its transitions.
   subroutine march_part(base, begin, state, buffers, error)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: begin   !! time at which the part begins [parts]
      type(block_state), intent(inout) :: state
      type(march_buffers), intent(inout) :: buffers
      type(error_type), allocatable, intent(out) :: error

      call base%march_freely()
      if (.not. buffers%is_independent) base%paths%is_remarched = .false.
      if (base%paths%n_candidates > 0) call make_transitions(base, begin, state, buffers, error)
      if (allocated(error)) return
      call base%end_part()
      if (buffers%has_frictionless) call count_frictionless(base%paths, buffers%speed, state)
   end subroutine march_part

   !> Makes the transitions of all candidates. Judges all of them first: samples whose joints may
   !> disturb each other are marched through the part again (8), (9). What is done to a sample
   !> depends on that sample alone.
   subroutine make_transitions(base, begin, state, buffers, error)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: begin   !! time at which the part begins [parts]
      type(block_state), intent(inout) :: state
      type(march_buffers), intent(inout) :: buffers
      type(error_type), allocatable, intent(out) :: error
      integer :: first, g, n_groups

      n_groups = (base%paths%n_candidates + group_size - 1)/group_size
      if (n_groups > size(buffers%groups)) then
         deallocate (buffers%groups)
         allocate (buffers%groups(2*n_groups))
      end if
      do g = 1, n_groups
         first = group_size*(g - 1) + 1
         call examine(base%paths, first, min(base%paths%n_candidates, first + group_size - 1), &
                      buffers%groups(g))
      end do
      if (.not. buffers%is_independent) call mark_remarched(base%paths, buffers%groups(:n_groups))
      do g = 1, n_groups
         call make_group(base, buffers%groups(g), begin, state, buffers%single, error)
         if (allocated(error)) return
      end do
      if (buffers%is_independent) return
      if (any(base%paths%is_remarched)) call base%march_again(begin, state, error)
   end subroutine make_transitions

   !> Marks the samples that must be marched through the part again. Power series: those with a
   !> transition that is not local, or that moves another joint too much before its transition (9).
   !> Modes: those with a transition that is not plain, with two, or with one whose response might
   !> take the guard of another joint through zero (M10).
   pure subroutine mark_remarched(paths, groups)
      type(joint_paths), intent(inout) :: paths
      type(transition_group), intent(in) :: groups(:)
      logical :: is_seen(width)    ! modes: lanes with a candidate that is not clear
      real(wp) :: response(width)  ! modes: bound of the response of any guard to its transition [m]
      integer :: e, g, i, k

      is_seen = .false.
      response = 0.0_wp
      do g = 1, size(groups)
         associate (group => groups(g))
            do e = 1, group%n
               associate (l => group%lane(e), j => group%joint(e))
                  if (group%outcome(e) == clear) then
                     paths%least_guard(l) = min(paths%least_guard(l), group%clear_margin(e))
                     cycle
                  else if (allocated(paths%coupling)) then
                     paths%is_remarched(l) = paths%is_remarched(l) .or. is_seen(l) .or. &
                                             group%outcome(e) /= plain
                     is_seen(l) = .true.
                     do k = 1, paths%degree
                        response(l) = response(l) + paths%coupling(j)*(k*abs(group%path(e, k)))
                     end do
                     cycle
                  end if
                  if (.not. paths%responses%is_local(j)) paths%is_remarched(l) = .true.
                  do k = 1, g
                     if (paths%is_remarched(l)) exit
                     do i = 1, merge(groups(k)%n, e - 1, k < g)
                        if (groups(k)%lane(i) /= l .or. groups(k)%outcome(i) == clear) cycle
                        paths%is_remarched(l) = paths%is_remarched(l) .or. &
                                                disturbs(paths, groups(k), i, group, e) .or. &
                                                disturbs(paths, group, e, groups(k), i)
                     end do
                  end do
               end associate
            end do
         end associate
      end do
      paths%is_remarched = paths%is_remarched .or. is_seen .and. paths%least_guard <= response
   end subroutine mark_remarched

   !> True if entry e of a group may disturb entry i of another group that switches later (9). A
   !> joint whose transition is not plain may switch at any time of the part.
   pure logical function disturbs(paths, group, e, others, i)
      type(joint_paths), intent(in) :: paths
      type(transition_group), intent(in) :: group, others
      integer, intent(in) :: e, i
      real(wp) :: earliest, latest

      earliest = merge(group%time(e), 0.0_wp, group%outcome(e) == plain)
      latest = merge(others%time(i), 1.0_wp, others%outcome(i) == plain)
      disturbs = latest - earliest > &
                 paths%responses%undisturbed_span(others%joint(i), group%joint(e))
   end function disturbs

   !> Makes the transitions of a group in the samples that are not marched again.
   subroutine make_group(base, group, begin, state, single, error)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      real(wp), intent(in) :: begin   !! time at which the part begins [parts]
      type(block_state), intent(inout) :: state
      type(transition_group), intent(inout) :: single   !! buffer
      type(error_type), allocatable, intent(out) :: error
      integer :: e

      do e = 1, group%n
         if (group%outcome(e) == clear .or. base%paths%is_remarched(group%lane(e))) cycle
         if (group%outcome(e) == plain) then
            call make_transition(base, group, e, begin, state)
         else
            call march_joint(base, group%candidate(e), begin, state, single, error)
            if (allocated(error)) return
         end if
      end do
   end subroutine make_group

   !> Makes one transition: corrects the values at the end of the part, and switches the joint.
   subroutine make_transition(base, group, entry, begin, state)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      real(wp), intent(in) :: begin   !! time at which the part begins [parts]
      type(block_state), intent(inout) :: state

      call base%add_transition(group, entry)
      call base%paths%switch(group%lane(entry), group%joint(entry), &
                             (begin + group%time(entry))*base%h, group%place(entry), &
                             group%direction(entry), state)
   end subroutine make_transition

   !> Makes all transitions of a local joint in the part, one after another.
   subroutine march_joint(base, candidate, begin, state, single, error)
      class(base_system), intent(inout) :: base
      integer, intent(in) :: candidate   !! see joint_paths
      real(wp), intent(in) :: begin    !! time at which the part begins [parts]
      type(block_state), intent(inout) :: state
      type(transition_group), intent(inout) :: single
      type(error_type), allocatable, intent(out) :: error
      logical :: is_found
      integer :: round

      call load_candidates(base%paths%degree, base%paths, [candidate], single)
      do round = 0, base%max_transitions
         call find_next(base%paths%degree, single, is_found)
         if (.not. is_found) return
         call make_transition(base, single, 1, begin, state)
         call apply_response(base%paths, single)
      end do
      call raise_too_many(base, single%joint(1), single%lane(1), begin, error)
   end subroutine march_joint

   !> Sets the forces of all lanes: their values after a share of a step, and their rises over the
   !> part that follows. Lanes without a sample have none and stay at rest.
   pure subroutine set_force(base, force, step, share, part)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: force(0:, :), share, part
      integer, intent(in) :: step
      logical :: is_shared   ! one record for all samples
      real(wp) :: rise
      integer :: column, f, l, n_forces

      associate (n => base%paths%n_samples, push => base%paths%force)
         n_forces = size(push, 2)
         is_shared = size(force, 2) == n_forces
         do f = 1, n_forces
            column = f
            do l = 1, merge(1, n, is_shared)
               if (.not. is_shared) column = f + n_forces*(base%paths%first_sample + l - 2)
               rise = force(step + 1, column) - force(step, column)
               push(l, f, 0) = force(step, column) + share*rise
               push(l, f, 1) = part*rise
            end do
            if (.not. is_shared) cycle
            push(:, f, 0) = push(1, f, 0)
            push(:, f, 1) = push(1, f, 1)
         end do
         push(n + 1:, :, :) = 0.0_wp
      end associate
   end subroutine set_force

   !> Counts the slip of joints without friction, which slip all the time, over a part.
   pure subroutine count_frictionless(paths, speed, state)
      type(joint_paths), intent(in) :: paths
      real(wp), intent(inout) :: speed(:, :)   !! (lane, joint) w.v at the start; then at the end
      type(block_state), intent(inout) :: state
      integer :: j, l, w

      do l = 1, paths%n_samples
         w = paths%first_sample + l - 1
         do j = 1, paths%n_joints
            if (state%slip_limit(j, w) > 0.0_wp) cycle
            associate (place => paths%x(l, paths%row(j), paths%layer(0)), &
                       after => paths%x(l, paths%row(j), paths%layer(1)))
               call add_frictionless_slip(place, [speed(l, j), after], state%account(j, w))
               speed(l, j) = after
            end associate
         end do
      end do
   end subroutine count_frictionless

   !> Keeps a record of all lanes, and writes out all records first if the buffers are full.
   subroutine buffer_record(base, displacement, velocity, buffers)
      class(base_system), intent(in) :: base
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(march_buffers), intent(inout) :: buffers

      if (buffers%n_buffered == buffer_size) &
         call flush_records(base, displacement, velocity, buffers)
      buffers%n_buffered = buffers%n_buffered + 1
      call base%copy_state(buffers%displacement(:, :, buffers%n_buffered), &
                           buffers%velocity(:, :, buffers%n_buffered))
   end subroutine buffer_record

   !> Writes out the records of the buffers.
   subroutine flush_records(base, displacement, velocity, buffers)
      class(base_system), intent(in) :: base
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(march_buffers), intent(inout) :: buffers
      integer :: i, l, w

      associate (done => buffers%n_written, kept => buffers%n_buffered)
         do i = 1, size(displacement, 2)
            do l = 1, base%paths%n_samples
               w = base%paths%first_sample + l - 1
               displacement(done + 1:done + kept, i, w) = buffers%displacement(l, i, :kept)
               if (present(velocity)) &
                  velocity(done + 1:done + kept, i, w) = buffers%velocity(l, i, :kept)
            end do
         end do
         done = done + kept
         kept = 0
      end associate
   end subroutine flush_records

end module dynamics_exact_block_march
