!> The march by tabulated propagators: most steps are quiet, some have one transition, few have
!> more.
!>
!> Each sample walks at its own pace, two steps at once where it may. A pass takes a stretch of one
!> or two steps of every sample that is free to; those whose stretch was not quiet wait until eight
!> can be treated side by side, first as stretches with a single transition, then, where that is not
!> all, step by step, and at last by Taylor series with every transition in turn.
module dynamics_tabulated
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_crossing, only: capacity, crossing_batch, locate, read_mass, step_across
   use dynamics_lanes, only: lane_group
   use dynamics_propagator, only: alignment_gap, columns, longest_stride, propagator_type, width
   use dynamics_quiet, only: at_direction, at_reach, at_slider, at_state, find_slacks, kink_of, &
                             sample_size, set_anchors, set_shift, take_steps
   use dynamics_response, only: block_state
   use dynamics_schedule, only: book_size, crowded, far, near, of_due, of_last, of_pattern, &
                                of_phase, of_place, of_position, of_taken, schedule_type, &
                                sort_out, waiting
   use dynamics_taylor, only: lanes
   use dynamics_transitions, only: first_suspect, keep_transition, keeps_regimes, &
                                   most_transitions, transition_log
   implicit none(type, external)
   private
   public :: tabulated_march

   !> What all samples share.
   type :: tabulated_march
      type(chain_type) :: chain
      integer :: forced_dof = 0
      real(wp) :: h = 0.0_wp              !! [s]
      integer :: stride = 1               !! most steps taken at once
      real(wp) :: floor(longest_stride) = 0.0_wp   !! share of the reach kept clear in quiet strides
      logical :: has_crossings(longest_stride) = .false.   !! dynamics_crossing keeps the tolerance
      type(propagator_type) :: propagator
      type(crossing_batch) :: batch
      type(lane_group) :: group
   contains
      procedure :: march
   end type tabulated_march

contains

   !> Marches a block through the whole force record.
   subroutine march(self, state, force, begin, spacing, n_recorded, slip_begin, displacement, &
                    velocity, error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in), contiguous :: force(0:, :)   !! (step, 1 or sample) [N]
      real(wp), intent(in) :: begin                      !! steps done before [steps]
      integer, intent(in) :: spacing                     !! steps from record to record
      integer, intent(in) :: n_recorded                  !! records already made
      real(wp), intent(inout) :: slip_begin(:, :)        !! (dof, sample) [steps]
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0
      type(error_type), allocatable, intent(out) :: error
      type(schedule_type) :: todo
      real(wp), allocatable :: pool(:)
      integer :: first, n, w

      n = state%n_samples
      allocate (todo%list(n + 1, crowded))
      allocate (todo%book(book_size, n), source=0)
      todo%origin = [(merge(0, w - 1, size(force, 2) == 1)*size(force, 1), w=1, n)]
      todo%stride = self%stride
      if (modulo(spacing, self%stride) /= 0 .and. size(displacement) > 0) todo%stride = 1
      todo%book(of_position, :) = todo%origin
      todo%book(of_last, :) = todo%origin + ubound(force, 1)
      todo%book(of_due, :) = todo%origin + spacing - int(modulo(nint(begin, long), &
                                                                int(spacing, long)))
      todo%book(of_phase, :) = todo%book(of_due, :)
      if (size(displacement) == 0) todo%book(of_due, :) = -1
      allocate (todo%n_records(n), source=0)
      allocate (pool(sample_size*width*n + width), source=0.0_wp)
      first = 1 + alignment_gap(pool)
      call walk(self, state, size(force), force, begin, spacing, n_recorded, slip_begin, &
                displacement, velocity, todo, pool(first), error)
   end subroutine march

   !> Passes over the block until every sample has done its steps.
   subroutine walk(self, state, n_forces, force, begin, spacing, n_recorded, slip_begin, &
                   displacement, velocity, todo, sample, error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: n_forces, spacing, n_recorded
      real(wp), intent(in) :: force(0:n_forces - 1), begin
      real(wp), intent(inout) :: slip_begin(:, :), displacement(:, :, :), velocity(:, :, :)
      type(schedule_type), intent(inout) :: todo
      real(wp), intent(inout) :: sample(width, sample_size, state%n_samples)
      type(error_type), allocatable, intent(out) :: error
      type(transition_log) :: log(capacity)
      real(wp), allocatable :: trace(:, :, :), trace_u(:, :, :)   ! (mass, record, sample)
      real(wp) :: contact(width)     ! h^2 k/m
      real(wp) :: is_forced(width)   ! 1 for the forced mass
      real(wp) :: force_scale        ! h^2/m of it
      integer :: due(state%n_samples), listed(state%n_samples), is_quiet(state%n_samples)
      integer :: n, n_due, n_taken, room, w

      n = state%n_dof
      room = n_forces/spacing + 1
      allocate (trace(width, merge(room, 0, size(displacement) > 0), state%n_samples))
      allocate (trace_u(width, merge(room, 0, size(velocity) > 0), state%n_samples))
      is_forced = 0.0_wp
      is_forced(self%forced_dof) = 1.0_wp
      force_scale = self%h**2/self%chain%mass(self%forced_dof)
      contact = 0.0_wp
      contact(:n) = self%h**2*self%chain%contact_stiffness/self%chain%mass
      sample(:, at_reach, :) = huge(1.0_wp)   ! rows beyond n watch nothing
      do w = 1, state%n_samples
         call take_in(w)
         call todo%free(w)
      end do
      do while (sum(todo%n_listed) > 0)
         call pass(far, todo%stride)
         call pass(near, 1)
         do while (is_ready(waiting, 3*lanes))
            call treat_waiting()
         end do
         do while (is_ready(crowded, lanes))
            call treat_crowded(error)
            if (allocated(error)) return
         end do
      end do
      do w = 1, state%n_samples
         call hand_back(w)
      end do
      if (size(displacement) > 0) call unfold(n, todo%n_records(1), trace, 1.0_wp, n_recorded + 1, &
                                              displacement)
      if (size(velocity) > 0) call unfold(n, todo%n_records(1), trace_u, 1.0_wp/self%h, &
                                          n_recorded + 1, velocity)

   contains

      !> Takes a stretch of all samples in a list and sorts them.
      subroutine pass(from, stride)
         integer, intent(in) :: from, stride
         integer :: a, p, to_near

         n_taken = todo%n_listed(from)
         if (n_taken == 0) return
         listed(:n_taken) = todo%list(:n_taken, from)
         todo%n_listed(from) = 0
         if (stride < todo%stride) then
            do a = 1, n_taken
               associate (w => listed(a), tables => self%propagator)
                  p = tables%at_load(todo%book(of_pattern, w), stride)
                  call set_shift(n, stride, tables%pool(p), sample(1, 1, w))
               end associate
            end do
         end if
         to_near = merge(1, 0, stride > 1 .and. .not. self%has_crossings(stride))
         call take_steps(n, stride, n_taken, listed, state%n_samples, n_forces, force, &
                         force_scale, self%propagator%pool(self%propagator%at_step(0, stride)), &
                         self%floor(stride), todo%book, sample, is_quiet)
         call sort_out(n_taken, listed, is_quiet, stride, to_near, todo%stride, state%n_samples, &
                       todo%book, todo%n_listed, todo%list, n_due, due)
         do a = 1, n_due
            call record(due(a))
         end do
      end subroutine pass

      !> Records the state of a sample, and sets the position of its next record.
      subroutine record(w)
         integer, intent(in) :: w
         integer :: k

         k = todo%n_records(w) + 1
         todo%n_records(w) = k
         todo%book(of_due, w) = todo%book(of_due, w) + spacing
         associate (x => at_state + 2*todo%book(of_place, w))
            trace(:, k, w) = sample(:, x, w)
            if (size(velocity) > 0) trace_u(:, k, w) = sample(:, x + 1, w)
         end associate
      end subroutine record

      !> Whether a list is to be treated now: enough are in it, or nobody is free to go on.
      logical function is_ready(list, enough)
         integer, intent(in) :: list, enough

         is_ready = todo%n_listed(list) >= enough .or. &
                    (sum(todo%n_listed(:near)) == 0 .and. todo%n_listed(list) > 0)
      end function is_ready

      !> Counts an eventful stretch that is done, and frees the sample for the next one.
      subroutine finish_stretch(w)
         integer, intent(in) :: w

         todo%book(of_position, w) = todo%book(of_position, w) + todo%book(of_taken, w)
         if (todo%book(of_position, w) == todo%book(of_due, w)) call record(w)
         call todo%free(w)
      end subroutine finish_stretch

      !> Treats stretches as such with few transitions, each of another mass and one after the
      !> other; those that have more to them are left for a closer look.
      subroutine treat_waiting()
         integer, dimension(capacity) :: entry, mass, reading
         real(wp) :: kink(capacity)
         logical :: is_open(capacity)   ! the way of dynamics_crossing may still do
         integer :: k, l, m

         call todo%pop(waiting, capacity, entry, m)
         do l = 1, m
            log(l)%n = 0
            log(l)%switched = 0
            is_open(l) = self%has_crossings(todo%book(of_taken, entry(l)))
            associate (p => todo%book(of_position, entry(l)), &
                       stride => todo%book(of_taken, entry(l)))
               kink(l) = kink_of(stride, force(p), force(p + 1), force(p + stride), force_scale)
            end associate
         end do
         do
            self%batch%n = 0
            do l = 1, m
               if (.not. is_open(l)) cycle
               k = self%batch%n + 1
               reading(k) = l
               call read_suspect(k, l, entry(l), kink(l), mass(k), is_open(l))
            end do
            if (self%batch%n == 0) exit
            call locate(self%batch)
            do k = 1, self%batch%n
               l = reading(k)
               call take_transition(k, l, entry(l), kink(l), mass(k), is_open(l))
            end do
         end do
         do l = 1, m
            if (.not. is_open(l)) cycle
            associate (w => entry(l), book => todo%book(:, entry(l)))
               is_open(l) = keeps_regimes(log(l), book(of_taken), kink(l), book(of_place), &
                                          sample(1, 1, w))
               if (is_open(l)) call change_regimes(log(l), w)
            end associate
         end do
         do l = 1, m
            if (is_open(l)) then
               call enter_pattern(entry(l))
               call finish_stretch(entry(l))
            else
               call todo%append(entry(l), merge(near, crowded, todo%book(of_taken, entry(l)) > 1))
            end if
         end do
      end subroutine treat_waiting

      !> Reads the mass of stretch l that may have its next transition into lane k, if there is one
      !> and it is not one too many.
      subroutine read_suspect(k, l, w, kink, i, is_open)
         integer, intent(in) :: k, l, w
         real(wp), intent(in) :: kink
         integer, intent(out) :: i
         logical, intent(inout) :: is_open
         real(wp) :: load(2)

         associate (tables => self%propagator, place => todo%book(of_place, w), &
                    stride => todo%book(of_taken, w), p => todo%book(of_position, w))
            i = first_suspect(n, log(l)%switched, place, sample(1, 1, w))
            if (i == 0) return
            is_open = log(l)%n < most_transitions
            if (.not. is_open) return
            load = is_forced(i)*force_scale*[force(p), force(p + stride)]
            call read_mass(self%batch, k, i, stride, tables%pool(tables%pull), contact(i), load, &
                           is_forced(i)*kink, place, sample(1, 1, w))
            self%batch%n = k
         end associate
      end subroutine read_suspect

      !> Takes the transition that lane k has located into the state of stretch l, unless it would
      !> come before the last one.
      subroutine take_transition(k, l, w, kink, i, is_open)
         integer, intent(in) :: k, l, w, i
         real(wp), intent(in) :: kink
         logical, intent(inout) :: is_open
         integer :: pattern

         is_open = self%batch%is_located(k) > 0.5_wp
         if (log(l)%n > 0) is_open = is_open .and. self%batch%tau(k) > log(l)%time(max(log(l)%n, 1))
         if (.not. is_open) return
         call keep_transition(self%batch, k, i, log(l))
         pattern = ieor(todo%book(of_pattern, w), log(l)%switched)
         associate (tables => self%propagator, place => todo%book(of_place, w), &
                    stride => todo%book(of_taken, w))
            if (.not. tables%is_built(pattern)) call tables%build(pattern)
            call step_across(self%batch, k, i, tables%pool(tables%at_kick(pattern)), place, &
                             sample(1, 1, w))
            call find_slacks(stride, kink, self%floor(stride), place, sample(1, 1, w))
         end associate
      end subroutine take_transition

      !> Enters the transitions of a stretch into the books of its sample.
      subroutine change_regimes(log, w)
         type(transition_log), intent(in) :: log
         integer, intent(in) :: w
         real(wp) :: now
         integer :: i, k, kind, stick

         do k = 1, log%n
            i = log%mass(k)
            now = begin + (todo%book(of_position, w) - todo%origin(w)) + &
                  todo%book(of_taken, w)*log%time(k)
            stick = int(log%is_stick(k))
            kind = (1 - stick)*int(log%sense(k))
            sample(i, at_slider, w) = log%x(k) - log%sense(k)*sample(i, at_reach, w)
            sample(i, at_direction, w) = kind
            state%stick_starts(i, w) = state%stick_starts(i, w) + stick
            state%slip_starts(i, w) = state%slip_starts(i, w) + (1 - stick)
            state%slip_time(i, w) = state%slip_time(i, w) + stick*(now - slip_begin(i, w))*self%h
            slip_begin(i, w) = merge(slip_begin(i, w), now, stick == 1)
            if (state%keeps_transitions) call state%transitions(w)%append(now*self%h, i, kind)
         end do
         todo%book(of_pattern, w) = ieor(todo%book(of_pattern, w), log%switched)
         todo%book(of_place, w) = 1 - todo%book(of_place, w)
      end subroutine change_regimes

      !> What its anchors add to every step of a sample while the pattern lasts.
      subroutine enter_pattern(w)
         integer, intent(in) :: w

         associate (tables => self%propagator, pattern => todo%book(of_pattern, w))
            if (.not. tables%is_built(pattern)) call tables%build(pattern)
            call set_anchors(sample(1, 1, w))
            call set_shift(n, todo%stride, tables%pool(tables%at_load(pattern, todo%stride)), &
                           sample(1, 1, w))
         end associate
      end subroutine enter_pattern

      !> Treats up to eight steps with whatever is in them.
      subroutine treat_crowded(error)
         type(error_type), allocatable, intent(out) :: error
         integer :: entry(lanes), l, m, w

         call todo%pop(crowded, lanes, entry, m)
         do l = 1, lanes
            call self%group%clear(l)
            if (l > m) cycle
            w = entry(l)
            call hand_back(w)
            call self%group%load(self%chain, l, w, state)
            associate (k => todo%book(of_position, w))
               call self%group%set_step(l, begin + (k - todo%origin(w)), force(k), &
                                        force(k + 1) - force(k))
            end associate
         end do
         call self%group%march_step(state, slip_begin, error)
         if (allocated(error)) return
         do l = 1, m
            call self%group%store(self%chain, l, state)
            call take_in(entry(l))
            call finish_stretch(entry(l))
         end do
      end subroutine treat_crowded

      !> From the block to the work space. A mass without friction slips for ever: it watches
      !> nothing, as a stuck one with boundless reach, but its contact is not in the pattern.
      subroutine take_in(w)
         integer, intent(in) :: w
         logical :: has_friction(n)
         integer :: i

         sample(:n, at_state + 2*todo%book(of_place, w), w) = state%displacement(:, w)
         sample(:n, at_state + 2*todo%book(of_place, w) + 1, w) = self%h*state%velocity(:, w)
         has_friction = state%slip_limit(:, w) > 0.0_wp
         sample(:n, at_slider, w) = merge(state%slider(:, w), 0.0_wp, has_friction)
         sample(:n, at_direction, w) = merge(state%direction(:, w), 0, has_friction)
         sample(:n, at_reach, w) = merge(state%slip_limit(:, w)/self%chain%contact_stiffness, &
                                         huge(1.0_wp), has_friction)
         todo%book(of_pattern, w) = 0
         do i = 1, n
            if (state%direction(i, w) == 0) todo%book(of_pattern, w) = &
               ibset(todo%book(of_pattern, w), i - 1)
         end do
         call enter_pattern(w)
      end subroutine take_in

      !> And back; the slider of a slipping mass has followed it.
      subroutine hand_back(w)
         integer, intent(in) :: w

         state%displacement(:, w) = sample(:n, at_state + 2*todo%book(of_place, w), w)
         state%velocity(:, w) = sample(:n, at_state + 2*todo%book(of_place, w) + 1, w)/self%h
         where (state%slip_limit(:, w) > 0.0_wp)
            state%direction(:, w) = nint(sample(:n, at_direction, w))
         end where
         state%slider(:, w) = merge(sample(:n, at_slider, w), state%displacement(:, w) - &
                                    state%direction(:, w)*state%slip_limit(:, w)/ &
                                    self%chain%contact_stiffness, state%direction(:, w) == 0)
      end subroutine hand_back

   end subroutine walk

   !> From traces (mass, record, sample) to histories, of which the records from `first` on are set.
   pure subroutine unfold(n, n_records, trace, scale, first, history)
      integer, intent(in) :: n, n_records, first
      real(wp), intent(in) :: trace(:, :, :), scale
      real(wp), intent(inout) :: history(:, :, :)   !! (record, dof, sample)
      integer :: i, w

      do w = 1, size(trace, 3)
         do i = 1, n
            history(first:first + n_records - 1, i, w) = scale*trace(i, :n_records, w)
         end do
      end do
   end subroutine unfold

end module dynamics_tabulated
