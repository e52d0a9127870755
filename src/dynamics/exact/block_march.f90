!> March of a block, 32 samples at a time: part by part, the free motion of all samples first and
!> then the transitions in it.
module dynamics_exact_block_march
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_exact_base_system, only: base_system, raise_too_many, switch_joint
   use dynamics_exact_joint_paths, only: width
   use dynamics_exact_transitions, only: clear, examine, find_next, group_size, plain, &
                                         take_answer, take_suspects, transition_group
   use dynamics_joint, only: dissipate
   use dynamics_response, only: block_state
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: march_block

   integer, parameter :: records_together = 32
   integer, parameter :: most_seen = 8   !! of the joints that switch in one part of one sample

   !> Joints of a sample that switch in one part, and when, see (9).
   type :: switching
      integer :: n = 0
      integer :: joint(most_seen)
      real(wp) :: earliest(most_seen), latest(most_seen)   !! [parts]
   end type switching

   !> Suspects of a part, its groups of transitions, and records that are not yet handed on.
   type :: march_room
      integer, allocatable :: list(:)
      logical :: is_involved(width) = .false.              !! marched again, by `redo`
      type(switching) :: seen(width)       !! (lane) joints that switch in the part
      type(transition_group), allocatable :: groups(:)
      type(transition_group) :: one        !! a joint that is followed
      logical :: is_independent = .true.   !! no sample is ever marched again
      !> Joints without friction: their way counts from part to part
      integer, allocatable :: sliding(:, :)                !! (lane joint, entry)
      integer :: n_kept = 0, n_records = 0                 !! kept here; handed on
      real(wp), allocatable :: displacement(:, :, :), velocity(:, :, :)   !! (lane, dof, record)
   end type march_room

contains

   !> Marches on by as many steps as the force has intervals; see marcher_type.
   subroutine march_block(base, structure, parts, state, force, every, displacement, velocity, &
                          error)
      class(base_system), intent(inout) :: base
      type(structure_type), intent(in) :: structure
      integer, intent(in) :: parts   !! of a step
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(march_room) :: room
      integer :: first, part, step

      base%keeps_ledger = state%keeps_ledger
      call base%begin()
      call find_kept(base, state)
      room%is_independent = all(base%paths%is_local) .and. size(base%paths%moved) == 0
      allocate (room%list(width*max(1, state%n_joints)), room%groups(1))
      allocate (room%displacement(width, state%n_dof, merge(records_together, 0, &
                                                            size(displacement) > 0)))
      allocate (room%velocity(width, merge(state%n_dof, 0, present(velocity)), &
                              size(room%displacement, 3)))
      samples: do first = 1, state%n_samples, width
         base%paths%first_sample = first
         base%paths%n_samples = min(width, state%n_samples - first + 1)
         call base%take(state)
         call base%paths%take_in(structure%joint_stiffness, state)
         call list_sliding(base, state, room)
         room%n_records = 0
         do step = 0, ubound(force, 1) - 1
            do part = 0, parts - 1
               call set_force(base, force, step, real(part, wp)/parts, 1.0_wp/parts)
               call march_part(base, real((state%step + step)*parts + part, wp), state, room, error)
               if (allocated(error)) exit samples
            end do
            if (size(displacement) > 0) then
               if (modulo(state%step + step + 1, int(every, long)) == 0) &
                  call keep_record(base, displacement, velocity, room)
            end if
         end do
         call hand_on(base, displacement, velocity, room)
         call base%give(state)
         call base%paths%hand_back(structure%direction, state)
      end do samples
      state%kept_step = state%step + ubound(force, 1)
      if (state%keeps_ledger) call dissipate(structure, state)
      call base%paths%free()
   end subroutine march_block

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
      integer :: found, s

      call base%run_part(room%list, found)
      if (.not. room%is_independent) room%is_involved = .false.
      if (found > 0) call make_transitions(base, found, begin, state, room, error)
      if (allocated(error)) return
      if (state%keeps_ledger) call keep_ledger(base, state)
      call base%go_on()
      do s = 1, size(room%sliding, 2)
         associate (l => room%sliding(1, s), j => room%sliding(2, s), &
                    w => base%paths%first_sample + room%sliding(1, s) - 1)
            associate (place => base%paths%x(l, base%paths%row(j), base%paths%layer(0)))
               state%slip_distance(j, w) = state%slip_distance(j, w) + &
                                           abs(place - state%slip_from(j, w))
               state%slip_from(j, w) = place
            end associate
         end associate
      end do
   end subroutine march_part

   !> Makes the transitions of the suspects in their order. Where joints may be involved all are
   !> judged first; samples with involved joints that are not local are marched again, of the others
   !> each joint by itself. What is done to a sample depends on that sample alone.
   subroutine make_transitions(base, found, begin, state, room, error)
      class(base_system), intent(inout) :: base
      integer, intent(in) :: found
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state
      type(march_room), intent(inout) :: room
      type(error_type), allocatable, intent(out) :: error
      type(transition_group), allocatable :: more(:)
      integer :: g, n_groups

      n_groups = (found + group_size - 1)/group_size
      if (room%is_independent) then
         do g = 1, n_groups
            call examine_group(g, room%groups(1))
            call enter_group(base, room%groups(1), begin, state, room, error)
            if (allocated(error)) return
         end do
         return
      end if
      if (n_groups > size(room%groups)) then
         allocate (more(2*n_groups))
         call move_alloc(more, room%groups)
      end if
      room%seen%n = 0
      do g = 1, n_groups
         call examine_group(g, room%groups(g))
         call find_involved(base, room%groups(g), room)
      end do
      do g = 1, n_groups
         call enter_group(base, room%groups(g), begin, state, room, error)
         if (allocated(error)) return
      end do
      if (any(room%is_involved)) call base%redo(room%is_involved, begin, state, error)

   contains

      subroutine examine_group(number, group)
         integer, intent(in) :: number
         type(transition_group), intent(inout) :: group

         associate (first => group_size*(number - 1) + 1)
            call examine(base%paths, room%list(first:min(found, first + group_size - 1)), group)
         end associate
      end subroutine examine_group

   end subroutine make_transitions

   !> Notes the samples of a group that must be marched again, and how far clear joints are from a
   !> transition.
   pure subroutine find_involved(base, group, room)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      type(march_room), intent(inout) :: room
      integer :: e, l

      do e = 1, group%n
         l = group%lane(e)
         if (group%verdict(e) == clear) then
            if (base%paths%keeps_slack) base%paths%slack(l, group%joint(e)) = group%is_clear(e)
            cycle
         end if
         if (.not. base%paths%is_local(group%joint(e))) then
            room%is_involved(l) = .true.
         else if (size(base%paths%moved) > 0) then
            call note_joint(base, group, e, room%seen(l), room%is_involved(l))
         end if
      end do
   end subroutine find_involved

   !> Enters the transitions of a group, of samples that are not marched again, in their order.
   subroutine enter_group(base, group, begin, state, room, error)
      class(base_system), intent(inout) :: base
      type(transition_group), intent(in) :: group
      real(wp), intent(in) :: begin   !! [parts]
      type(block_state), intent(inout) :: state
      type(march_room), intent(inout) :: room
      type(error_type), allocatable, intent(out) :: error
      integer :: chosen(group_size), e, i, n

      n = 0
      do e = 1, group%n   ! without branches
         chosen(n + 1) = e
         n = n + merge(0, 1, group%verdict(e) == clear .or. room%is_involved(group%lane(e)))
      end do
      do i = 1, n
         e = chosen(i)
         if (group%verdict(e) == plain) then
            call make_transition(base, group, e, begin, state)
         else
            call follow_joint(base, group%suspect(e), begin, state, room%one, error)
            if (allocated(error)) return
         end if
      end do
   end subroutine enter_group

   !> Notes a joint, and if it moves one that switches later in the part of its sample too much, or
   !> is moved so (9). A joint that is followed may switch at any time.
   pure subroutine note_joint(base, group, entry, seen, is_involved)
      class(base_system), intent(in) :: base
      type(transition_group), intent(in) :: group
      integer, intent(in) :: entry
      type(switching), intent(inout) :: seen
      logical, intent(inout) :: is_involved
      real(wp) :: earliest, latest
      integer :: s

      is_involved = is_involved .or. seen%n == most_seen
      if (is_involved) return
      earliest = merge(group%time(entry), 0.0_wp, group%verdict(entry) == plain)
      latest = merge(group%time(entry), 1.0_wp, group%verdict(entry) == plain)
      associate (joint => group%joint(entry), paths => base%paths)
         do s = 1, seen%n
            is_involved = is_involved .or. &
                          paths%moves(joint, seen%joint(s), seen%latest(s) - earliest) .or. &
                          paths%moves(seen%joint(s), joint, latest - seen%earliest(s))
         end do
         seen%n = seen%n + 1
         seen%joint(seen%n) = joint
      end associate
      seen%earliest(seen%n) = earliest
      seen%latest(seen%n) = latest
   end subroutine note_joint

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

   !> Enters the works of a part into the ledgers.
   subroutine keep_ledger(base, state)
      class(base_system), intent(inout) :: base
      type(block_state), intent(inout) :: state
      real(wp) :: work(width, 2)

      work = 0.0_wp
      call base%add_works(work)
      associate (n => base%paths%n_samples, w => base%paths%first_sample)
         state%work_input(w:w + n - 1) = state%work_input(w:w + n - 1) + work(:n, 1)
         state%work_viscous(w:w + n - 1) = state%work_viscous(w:w + n - 1) + work(:n, 2)
      end associate
   end subroutine keep_ledger

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

   pure subroutine list_sliding(base, state, room)
      class(base_system), intent(in) :: base
      type(block_state), intent(in) :: state
      type(march_room), intent(inout) :: room
      integer :: j, l, many, w

      many = base%paths%n_samples
      w = base%paths%first_sample - 1
      if (allocated(room%sliding)) deallocate (room%sliding)
      allocate (room%sliding(2, count(.not. state%slip_limit(:, w + 1:w + many) > 0.0_wp)))
      many = 0
      do l = 1, base%paths%n_samples
         do j = 1, state%n_joints
            if (state%slip_limit(j, w + l) > 0.0_wp) cycle
            many = many + 1
            room%sliding(:, many) = [l, j]
         end do
      end do
   end subroutine list_sliding

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

      call copy_planes(base, room, room%displacement, displacement)
      if (present(velocity)) call copy_planes(base, room, room%velocity, velocity)
      room%n_records = room%n_records + room%n_kept
      room%n_kept = 0
   end subroutine hand_on

   !> Copies planes (lane, dof) to a history (record, dof, sample).
   pure subroutine copy_planes(base, room, planes, history)
      class(base_system), intent(in) :: base
      type(march_room), intent(in) :: room
      real(wp), intent(in) :: planes(:, :, :)
      real(wp), intent(inout) :: history(:, :, :)
      integer :: i, l, r

      do i = 1, size(planes, 2)
         do l = 1, base%paths%n_samples
            do r = 1, room%n_kept
               history(room%n_records + r, i, base%paths%first_sample + l - 1) = planes(l, i, r)
            end do
         end do
      end do
   end subroutine copy_planes

end module dynamics_exact_block_march
