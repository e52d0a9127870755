!> March of a block, 32 samples at a time: part by part, the free motion of all samples first and
!> then the transitions in it.
module dynamics_exact_block_march
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_exact_base_system, only: base_system, raise_too_many, switch_joint
   use dynamics_exact_joint_paths, only: joint_paths, width
   use dynamics_exact_transitions, only: clear, examine, find_next, group_size, plain, &
                                         take_answer, take_suspects, transition_group
   use dynamics_response, only: block_state, marcher_type
   implicit none(type, external)
   private
   public :: exact_march

   integer, parameter :: records_together = 32

   !> Marches a structure by its base system.
   type, extends(marcher_type) :: exact_march
      real(wp) :: tolerance = 0.0_wp     !! displacement error relative to its rms
      integer :: parts = 1               !! of a step
      character(:), allocatable :: form  !! 'power series' or 'modes'
      !> Multiplications of one sample in a step; huge where it cannot be done.
      real(wp) :: work_series = huge(1.0_wp), work_modes = huge(1.0_wp)
      class(base_system), allocatable :: base
   contains
      procedure :: advance
   end type exact_march

   !> Groups of transitions of a part, and records that are not yet handed on.
   type :: march_room
      type(transition_group), allocatable :: groups(:)
      type(transition_group) :: one        !! a joint that is followed
      logical :: is_independent = .true.   !! no sample is ever marched again
      logical :: has_frictionless = .false.
      integer :: n_kept = 0, n_records = 0                 !! kept here; handed on
      real(wp), allocatable :: displacement(:, :, :), velocity(:, :, :)   !! (lane, dof, record)
   end type march_room

contains

   !> See marcher_type.
   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(exact_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)
      real(wp), intent(out), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(march_room) :: room
      integer :: first, last, part, step

      associate (base => self%base, structure => self%structure)
         base%keeps_ledger = state%keeps_ledger
         call base%begin()
         call find_kept(base, state)
         associate (answers => base%paths%answers)
            room%is_independent = all(answers%is_local) .and. all(answers%free_span >= 1.0_wp)
         end associate
         room%has_frictionless = any(.not. state%slip_limit > 0.0_wp)
         allocate (room%groups(1))
         allocate (room%displacement(width, state%n_dof, merge(records_together, 0, &
                                                               size(displacement) > 0)))
         allocate (room%velocity(width, merge(state%n_dof, 0, present(velocity)), &
                                 size(room%displacement, 3)))
         do first = 1, state%n_samples, width
            base%paths%first_sample = first
            last = min(first + width - 1, state%n_samples)
            base%paths%n_samples = last - first + 1
            call base%take(state)
            call base%paths%take_in(structure%joint_stiffness, state)
            base%works(:last - first + 1, 1) = state%work_input(first:last)
            base%works(:last - first + 1, 2) = state%work_viscous(first:last)
            room%n_records = 0
            do step = 0, ubound(force, 1) - 1
               do part = 0, self%parts - 1
                  call set_force(base, force, step, real(part, wp)/self%parts, 1.0_wp/self%parts)
                  call march_part(base, real((state%step + step)*self%parts + part, wp), state, &
                                  room, error)
                  if (allocated(error)) return
               end do
               if (size(displacement) == 0) cycle
               if (modulo(state%step + step + 1, int(every, long)) == 0) &
                  call keep_record(base, displacement, velocity, room)
            end do
            call hand_on(base, displacement, velocity, room)
            state%work_input(first:last) = base%works(:last - first + 1, 1)
            state%work_viscous(first:last) = base%works(:last - first + 1, 2)
            call base%give(state)
            call base%paths%hand_back(structure%direction, state)
         end do
         state%step = state%step + ubound(force, 1)
         state%kept_step = state%step
      end associate
   end subroutine advance

   !> Finds if the block holds what this march has kept, or makes room for it.
   pure subroutine find_kept(base, state)
      class(base_system), intent(inout) :: base
      type(block_state), intent(inout) :: state

      base%is_kept = state%kept_step == state%step .and. abs(state%kept_h - base%h) <= 0.0_wp
      if (base%is_kept) base%is_kept = size(state%kept, 1) == base%n_kept
      if (base%is_kept) return
      if (allocated(state%kept)) deallocate (state%kept)
      allocate (state%kept(base%n_kept, state%n_samples), source=0.0_wp)
      state%kept_h = base%h
   end subroutine find_kept

   !> Marches one part of a step of all lanes, transitions included.
   subroutine march_part(base, begin, state, room, error)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state
      type(march_room), intent(inout) :: room
      type(error_type), allocatable, intent(out) :: error

      call base%run_part()
      if (.not. room%is_independent) base%paths%is_involved = .false.
      if (base%paths%n_suspects > 0) call make_transitions(base, begin, state, room, error)
      if (allocated(error)) return
      call base%go_on()
      if (room%has_frictionless) call count_frictionless(base%paths, state)
   end subroutine march_part

   !> Makes the transitions of the suspects in their order. Where joints may be involved all are
   !> judged first; samples with involved joints that are not local are marched again, of the others
   !> each joint by itself. What is done to a sample depends on that sample alone.
   subroutine make_transitions(base, begin, state, room, error)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state
      type(march_room), intent(inout) :: room
      type(error_type), allocatable, intent(out) :: error
      integer :: first, g, n_groups

      n_groups = (base%paths%n_suspects + group_size - 1)/group_size
      if (n_groups > size(room%groups)) then
         deallocate (room%groups)
         allocate (room%groups(2*n_groups))
      end if
      do g = 1, n_groups
         first = group_size*(g - 1) + 1
         call examine(base%paths, first, min(base%paths%n_suspects, first + group_size - 1), &
                      room%groups(g))
      end do
      if (.not. room%is_independent) call find_involved(base%paths, room%groups(:n_groups))
      if (allocated(base%paths%coupling)) call find_shaken(base%paths, room%groups(:n_groups))
      do g = 1, n_groups
         call enter_group(base, room%groups(g), begin, state, room%one, error)
         if (allocated(error)) return
      end do
      if (room%is_independent) return
      if (any(base%paths%is_involved)) call base%redo(begin, state, error)
   end subroutine make_transitions

   !> Marks the samples that must be marched again, for a joint that is not local, or that moves
   !> another that switches later in the part too much (9); where joints are coupled, for a second
   !> transition. Notes how far clear joints are from a transition.
   pure subroutine find_involved(paths, groups)
      type(joint_paths), intent(inout) :: paths
      type(transition_group), intent(in) :: groups(:)
      logical :: is_seen(width)   ! that have a suspect which is not clear
      integer :: e, g, i, k

      is_seen = .false.
      do g = 1, size(groups)
         associate (group => groups(g))
            do e = 1, group%n
               associate (l => group%lane(e), j => group%joint(e))
                  if (group%verdict(e) == clear) then
                     paths%least(l) = min(paths%least(l), group%is_clear(e))
                     cycle
                  else if (allocated(paths%coupling)) then
                     paths%is_involved(l) = paths%is_involved(l) .or. is_seen(l) .or. &
                                            group%verdict(e) /= plain
                     is_seen(l) = .true.
                     cycle
                  end if
                  if (.not. paths%answers%is_local(j)) paths%is_involved(l) = .true.
                  do k = 1, g
                     if (paths%is_involved(l)) exit
                     do i = 1, merge(groups(k)%n, e - 1, k < g)
                        if (groups(k)%lane(i) /= l .or. groups(k)%verdict(i) == clear) cycle
                        paths%is_involved(l) = paths%is_involved(l) .or. &
                                               moves(paths, groups(k), i, group, e) .or. &
                                               moves(paths, group, e, groups(k), i)
                     end do
                  end do
               end associate
            end do
         end associate
      end do
   end subroutine find_involved

   !> Marks the samples in which a transition might change the regime of another joint (M10).
   pure subroutine find_shaken(paths, groups)
      type(joint_paths), intent(inout) :: paths
      type(transition_group), intent(in) :: groups(:)
      integer :: e, g, k
      real(wp) :: speed

      do g = 1, size(groups)
         do e = 1, groups(g)%n
            if (groups(g)%verdict(e) == clear) cycle
            speed = 0.0_wp
            do k = 1, paths%degree
               speed = speed + k*abs(groups(g)%path(e, k))
            end do
            associate (l => groups(g)%lane(e))
               paths%is_involved(l) = paths%is_involved(l) .or. paths%least(l) <= &
                                      speed*paths%coupling(groups(g)%joint(e))
            end associate
         end do
      end do
   end subroutine find_shaken

   !> True if entry e of a group may move another, that switches later, too much (9). A joint that
   !> is followed may switch at any time.
   pure logical function moves(paths, group, e, others, i)
      type(joint_paths), intent(in) :: paths
      type(transition_group), intent(in) :: group, others
      integer, intent(in) :: e, i
      real(wp) :: earliest, latest

      earliest = merge(group%time(e), 0.0_wp, group%verdict(e) == plain)
      latest = merge(others%time(i), 1.0_wp, others%verdict(i) == plain)
      moves = latest - earliest > paths%answers%free_span(others%joint(i), group%joint(e))
   end function moves

   !> Enters the transitions of a group, of samples that are not marched again, in their order.
   subroutine enter_group(base, group, begin, state, one, error)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state
      type(transition_group), intent(inout) :: one   !! room
      type(error_type), allocatable, intent(out) :: error
      integer :: e

      do e = 1, group%n
         if (group%verdict(e) == clear .or. base%paths%is_involved(group%lane(e))) cycle
         if (group%verdict(e) == plain) then
            call make_transition(base, group, e, begin, state)
         else
            call follow_joint(base, group%suspect(e), begin, state, one, error)
            if (allocated(error)) return
         end if
      end do
   end subroutine enter_group

   !> Enters one transition into the ends of the part, the regimes and the account.
   subroutine make_transition(base, group, entry, begin, state)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state

      call base%correct(group, entry)
      call switch_joint(base, group%lane(entry), group%joint(entry), begin + group%time(entry), &
                        group%place(entry), group%way(entry), state)
   end subroutine make_transition

   !> Makes all transitions of a local joint in the part, one after another.
   subroutine follow_joint(base, suspect, begin, state, one, error)
      class(base_system), intent(inout) :: base
      integer, intent(in) :: suspect   !! as the list has it
      real(wp), intent(in) :: begin    !! [parts]
      type(block_state), intent(inout) :: state
      type(transition_group), intent(inout) :: one
      type(error_type), allocatable, intent(out) :: error
      logical :: is_found
      integer :: round

      call take_suspects(base%paths%degree, base%paths, [suspect], one)
      do round = 0, base%max_transitions
         call find_next(base%paths%degree, one, is_found)
         if (.not. is_found) return
         call make_transition(base, one, 1, begin, state)
         call take_answer(base%paths, one)
      end do
      call raise_too_many(base, one%joint(1), one%lane(1), begin, error)
   end subroutine follow_joint

   !> Sets the force of every lane at a share of a step, and its rise over the next part of it.
   !> Lanes without a sample have none and stay at rest: their joints are never suspect.
   pure subroutine set_force(base, force, step, share, part)
      class(base_system), intent(inout) :: base
      real(wp), intent(in) :: force(0:, :), share, part
      integer, intent(in) :: step
      real(wp) :: rise
      integer :: column, f, l

      associate (n => base%paths%n_samples, push => base%paths%force)
         push(n + 1:, :, :) = 0.0_wp
         do f = 1, base%n_forces
            do l = 1, n
               column = f
               if (size(force, 2) > base%n_forces) &
                  column = f + base%n_forces*(base%paths%first_sample + l - 2)
               rise = force(step + 1, column) - force(step, column)
               push(l, f, 0) = force(step, column) + share*rise
               push(l, f, 1) = part*rise
               if (l == 1 .and. size(force, 2) == base%n_forces) then
                  push(:n, f, 0) = push(1, f, 0)
                  push(:n, f, 1) = push(1, f, 1)
                  exit
               end if
            end do
         end do
      end associate
   end subroutine set_force

   !> Counts the way of joints without friction from part to part.
   pure subroutine count_frictionless(paths, state)
      type(joint_paths), intent(in) :: paths
      type(block_state), intent(inout) :: state
      integer :: j, l, w

      do l = 1, paths%n_samples
         w = paths%first_sample + l - 1
         do j = 1, paths%n_joints
            if (state%slip_limit(j, w) > 0.0_wp) cycle
            associate (place => paths%x(l, paths%row(j), paths%layer(0)))
               state%slip_distance(j, w) = state%slip_distance(j, w) + &
                                           abs(place - state%slip_from(j, w))
               state%slip_from(j, w) = place
            end associate
         end do
      end do
   end subroutine count_frictionless

   subroutine keep_record(base, displacement, velocity, room)
      class(base_system), intent(in) :: base
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(march_room), intent(inout) :: room

      if (room%n_kept == records_together) call hand_on(base, displacement, velocity, room)
      room%n_kept = room%n_kept + 1
      call base%put_state(room%displacement(:, :, room%n_kept), room%velocity(:, :, room%n_kept))
   end subroutine keep_record

   !> Hands all kept records on.
   subroutine hand_on(base, displacement, velocity, room)
      class(base_system), intent(in) :: base
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(march_room), intent(inout) :: room
      integer :: i, l, w

      associate (done => room%n_records, kept => room%n_kept)
         do i = 1, size(displacement, 2)
            do l = 1, base%paths%n_samples
               w = base%paths%first_sample + l - 1
               displacement(done + 1:done + kept, i, w) = room%displacement(l, i, :kept)
               if (present(velocity)) &
                  velocity(done + 1:done + kept, i, w) = room%velocity(l, i, :kept)
            end do
         end do
         done = done + kept
         kept = 0
      end associate
   end subroutine hand_on

end module dynamics_exact_block_march
