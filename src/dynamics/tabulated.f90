!> The march by tabulated propagators: most steps are quiet, some have one transition, few have
!> more.
!>
!> Each sample walks at its own pace, up to four steps at once. A pass takes a stretch of every
!> sample that is free to; those whose stretch was not quiet wait until many can be treated side by
!> side, first as stretches with few transitions, then, where that is not all, by shorter stretches,
!> and at last step by step by Taylor series with every transition in turn.
module dynamics_tabulated
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_crossing, only: capacity, crossing_batch, is_smooth, read_masses, step_across
   use dynamics_lanes, only: lane_group
   use dynamics_location, only: locate
   use dynamics_propagator, only: alignment_gap, levels, propagator_type, stride_of, width
   use dynamics_quiet, only: find_kinks, find_suspects, sum_kinks, take_steps
   use dynamics_response, only: block_state
   use dynamics_schedule, only: book_size, crowded, of_due, of_last, of_level, of_pattern, &
                                of_phase, of_place, of_position, of_suspects, schedule_type, &
                                sort_out, waiting
   use dynamics_taylor, only: lanes
   use dynamics_transitions, only: first_suspect, keep_transition, keeps_regimes, &
                                   most_transitions, transition_log
   use dynamics_workspace, only: at_direction, at_reach, at_shift, at_slider, at_start, at_state, &
                                 hand_back, pattern_of, sample_size, set_anchors, set_shift, &
                                 take_in, unfold
   implicit none(type, external)
   private
   public :: tabulated_march

   !> What all samples share.
   type :: tabulated_march
      type(chain_type) :: chain
      integer :: forced_dof = 0
      real(wp) :: h = 0.0_wp              !! [s]
      integer :: level = 1                !! of the longest stride
      real(wp) :: floor(levels) = 0.0_wp  !! share of the reach kept clear in quiet strides
      logical :: has_crossings(levels) = .false.   !! dynamics_crossing keeps the tolerance
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
      type(schedule_type) :: agenda
      real(wp), allocatable :: pool(:)
      integer :: first, n, w

      n = state%n_samples
      allocate (agenda%book(book_size, n), agenda%list(n + 1, crowded), source=0)
      allocate (agenda%n_records(n), source=0)
      agenda%origin = [(merge(0, w - 1, size(force, 2) == 1)*size(force, 1), w=1, n)]
      agenda%level = self%level
      if (size(displacement) > 0) agenda%level = min(self%level, 1 + trailz(spacing))
      agenda%book(of_position, :) = agenda%origin
      agenda%book(of_last, :) = agenda%origin + ubound(force, 1)
      agenda%book(of_due, :) = agenda%origin + spacing - int(modulo(nint(begin, long), &
                                                                int(spacing, long)))
      agenda%book(of_phase, :) = agenda%book(of_due, :)
      if (size(displacement) == 0) agenda%book(of_due, :) = -1
      allocate (pool(sample_size*width*n + width), source=0.0_wp)
      first = 1 + alignment_gap(pool)
      call walk(self, state, size(force), force, begin, spacing, n_recorded, slip_begin, &
                displacement, velocity, agenda, pool(first), error)
   end subroutine march

   !> Passes over the block until every sample has done its steps.
   subroutine walk(self, state, n_forces, force, begin, spacing, n_recorded, slip_begin, &
                   displacement, velocity, agenda, sample, error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: n_forces, spacing, n_recorded
      real(wp), intent(in) :: force(0:n_forces - 1), begin
      real(wp), intent(inout) :: slip_begin(:, :), displacement(:, :, :), velocity(:, :, :)
      type(schedule_type), intent(inout) :: agenda
      real(wp), intent(inout) :: sample(width, sample_size, state%n_samples)
      type(error_type), allocatable, intent(out) :: error
      type(transition_log) :: log(capacity)
      real(wp), allocatable :: trace(:, :, :), trace_u(:, :, :)   ! (mass, record, sample)
      real(wp) :: kink(0:n_forces - 1)
      real(wp) :: bend(0:n_forces - 1, levels)   ! kinks of a stretch from each position
      real(wp) :: contact(width), force_scale   ! h^2 k/m; h^2/m of the forced mass
      integer, dimension(state%n_samples + 1) :: due, listed, stopping
      integer :: suspects(state%n_samples)
      integer :: level, n, n_due, n_stopping, n_taken, room, w

      n = state%n_dof
      room = n_forces/spacing + 1
      allocate (trace(width, merge(room, 0, size(displacement) > 0), state%n_samples))
      allocate (trace_u(width, merge(room, 0, size(velocity) > 0), state%n_samples))
      force_scale = self%h**2/self%chain%mass(self%forced_dof)
      contact(:n) = self%h**2*self%chain%contact_stiffness/self%chain%mass
      sample(:, at_reach, :) = huge(1.0_wp)   ! rows beyond n watch nothing
      call find_kinks(force, force_scale, kink)
      do level = 1, levels
         call sum_kinks(stride_of(level), kink, bend(:, level))
      end do
      do w = 1, state%n_samples
         call load(w)
         call agenda%free(w)
      end do
      do while (sum(agenda%n_listed) > 0)
         do level = agenda%level, 1, -1
            call pass(level)
         end do
         do while (is_ready(waiting, 3*lanes))
            call treat_waiting()
         end do
         do while (is_ready(crowded, lanes))
            call treat_crowded(error)
            if (allocated(error)) return
         end do
      end do
      do w = 1, state%n_samples
         call store(w)
      end do
      associate (m => agenda%n_records(1), first => n_recorded + 1)
         if (size(displacement) > 0) call unfold(n, m, trace, 1.0_wp, first, displacement)
         if (size(velocity) > 0) call unfold(n, m, trace_u, 1.0_wp/self%h, first, velocity)
      end associate

   contains

      !> Takes a stretch of all samples that are free to, of one level, and sorts them.
      subroutine pass(level)
         integer, intent(in) :: level
         integer :: a, w

         n_taken = agenda%n_listed(level)
         if (n_taken == 0) return
         listed(:n_taken) = agenda%list(:n_taken, level)
         if (level < agenda%level) then
            do a = 1, n_taken
               call shift_for(level, at_start, listed(a))
            end do
         end if
         call take_steps(n, stride_of(level), merge(at_shift, at_start, level == agenda%level), &
                         n_taken, listed, state%n_samples, n_forces, force, bend(:, level), &
                         self%propagator%pool(self%propagator%at_step(0, level)), &
                         self%floor(level), agenda%book, sample, suspects)
         call sort_out(n_taken, listed, suspects, level, agenda%level, state%n_samples, &
                       agenda%book, agenda%n_listed(level), agenda%list(:, level), n_stopping, &
                       stopping, n_due, due)
         do a = 1, n_due
            call record(due(a))
         end do
         do a = 1, n_stopping
            w = abs(stopping(a))
            if (stopping(a) > 0) then
               call agenda%free(w)
            else
               agenda%book(of_level, w) = level
               call agenda%append(w, merge(waiting, level - 1, level == 1 .or. &
                                           self%has_crossings(level)))
            end if
         end do
      end subroutine pass

      !> Records the state of a sample, and sets the position of its next record.
      subroutine record(w)
         integer, intent(in) :: w
         integer :: k

         k = agenda%n_records(w) + 1
         agenda%n_records(w) = k
         agenda%book(of_due, w) = agenda%book(of_due, w) + spacing
         associate (x => at_state + 2*agenda%book(of_place, w))
            trace(:, k, w) = sample(:, x, w)
            if (size(velocity) > 0) trace_u(:, k, w) = sample(:, x + 1, w)
         end associate
      end subroutine record

      !> Whether a list is to be treated now: enough are in it, or nobody is free to go on.
      logical function is_ready(list, enough)
         integer, intent(in) :: list, enough

         is_ready = agenda%n_listed(list) >= enough .or. &
                    (sum(agenda%n_listed(:levels)) == 0 .and. agenda%n_listed(list) > 0)
      end function is_ready

      !> Counts an eventful stretch that is done, and frees the sample for the next one.
      subroutine finish_stretch(w)
         integer, intent(in) :: w

         agenda%book(of_position, w) = agenda%book(of_position, w) + &
                                       stride_of(agenda%book(of_level, w))
         if (agenda%book(of_position, w) == agenda%book(of_due, w)) call record(w)
         call agenda%free(w)
      end subroutine finish_stretch

      !> Treats stretches as such with few transitions, each of another mass and one after the
      !> other; those that have more to them are left for a closer look.
      subroutine treat_waiting()
         integer, dimension(capacity) :: entry, mass, reading, sample_read
         logical :: is_open(capacity)   ! the way of dynamics_crossing may still do
         integer :: k, l, level, m, n_reading

         call agenda%pop(waiting, capacity, entry, m)
         n_reading = 0
         do l = 1, m
            associate (w => entry(l), book => agenda%book(:, entry(l)))
               log(l)%n = 0
               log(l)%switched = 0
               log(l)%suspects = book(of_suspects)
               is_open(l) = self%has_crossings(book(of_level)) .and. &
                            is_smooth(self%batch, stride_of(book(of_level)), &
                                      bend(book(of_position), book(of_level)), book(of_place), &
                                      sample(1, 1, w))
            end associate
            n_reading = n_reading + 1
            reading(n_reading) = l
            if (.not. is_open(l)) n_reading = n_reading - 1
         end do
         do while (n_reading > 0)
            do k = 1, n_reading
               l = reading(k)
               sample_read(k) = entry(l)
               mass(k) = first_suspect(log(l)%suspects, agenda%book(of_place, entry(l)), &
                                       sample(1, 1, entry(l)))
            end do
            call read_masses(self%batch, n_reading, sample_read, mass, n, contact, &
                             self%forced_dof, force_scale, n_forces, force, kink, &
                             self%propagator%pool(self%propagator%pull), state%n_samples, &
                             agenda%book, sample)
            call locate(self%batch)
            n_reading = 0
            do k = 1, self%batch%n
               l = reading(k)
               call take_transition(k, l, entry(l), mass(k), is_open(l))
               if (.not. is_open(l) .or. log(l)%suspects == 0) cycle
               n_reading = n_reading + 1
               reading(n_reading) = l
            end do
         end do
         do l = 1, m
            if (.not. is_open(l)) cycle
            associate (w => entry(l), book => agenda%book(:, entry(l)))
               is_open(l) = keeps_regimes(log(l), stride_of(book(of_level)), &
                                          bend(book(of_position), book(of_level)), &
                                          book(of_place), sample(1, 1, w))
               if (is_open(l)) call change_regimes(log(l), w)
            end associate
         end do
         do l = 1, m
            if (is_open(l)) then
               call enter_pattern(entry(l))
               call finish_stretch(entry(l))
            else
               level = agenda%book(of_level, entry(l)) - 1
               call agenda%append(entry(l), merge(level, crowded, level > 0))
            end if
         end do
      end subroutine treat_waiting

      !> Takes the transition that lane k has located into the state of stretch l, unless it would
      !> come before the last one; or notes that there is none.
      subroutine take_transition(k, l, w, i, is_open)
         integer, intent(in) :: k, l, w, i
         logical, intent(inout) :: is_open
         integer :: pattern

         if (self%batch%is_clear(k) > 0.5_wp) then
            log(l)%suspects = ibclr(log(l)%suspects, i - 1)
            return
         end if
         is_open = self%batch%is_located(k) > 0.5_wp .and. log(l)%n < most_transitions
         if (log(l)%n > 0) is_open = is_open .and. self%batch%tau(k) > log(l)%time(max(log(l)%n, 1))
         if (.not. is_open) return
         call keep_transition(self%batch, k, i, log(l))
         pattern = ieor(agenda%book(of_pattern, w), log(l)%switched)
         associate (tables => self%propagator, place => agenda%book(of_place, w), &
                    level => agenda%book(of_level, w))
            if (.not. tables%is_built(pattern)) call tables%build(pattern)
            call step_across(self%batch, k, i, tables%pool(tables%at_kick(pattern)), place, &
                             sample(1, 1, w))
            log(l)%suspects = iand(find_suspects(stride_of(level), &
                                                 bend(agenda%book(of_position, w), level), &
                                                 self%floor(level), place, sample(1, 1, w)), &
                                   not(log(l)%switched))
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
            now = begin + (agenda%book(of_position, w) - agenda%origin(w)) + &
                  stride_of(agenda%book(of_level, w))*log%time(k)
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
         agenda%book(of_pattern, w) = ieor(agenda%book(of_pattern, w), log%switched)
         agenda%book(of_place, w) = 1 - agenda%book(of_place, w)
      end subroutine change_regimes

      !> What its anchors add to every long stride of a sample while the pattern lasts.
      subroutine enter_pattern(w)
         integer, intent(in) :: w

         associate (tables => self%propagator, pattern => agenda%book(of_pattern, w))
            if (.not. tables%is_built(pattern)) call tables%build(pattern)
         end associate
         call set_anchors(sample(1, 1, w))
         call shift_for(agenda%level, at_shift, w)
      end subroutine enter_pattern

      !> What they add in strides of a level, into two columns from `at`.
      subroutine shift_for(level, at, w)
         integer, intent(in) :: level, at, w

         associate (tables => self%propagator)
            call set_shift(n, tables%pool(tables%at_load(agenda%book(of_pattern, w), level)), at, &
                           sample(1, 1, w))
         end associate
      end subroutine shift_for

      !> Treats up to eight steps with whatever is in them.
      subroutine treat_crowded(error)
         type(error_type), allocatable, intent(out) :: error
         integer :: entry(lanes), l, m, w

         call agenda%pop(crowded, lanes, entry, m)
         do l = 1, lanes
            call self%group%clear(l)
            if (l > m) cycle
            w = entry(l)
            call store(w)
            call self%group%load(self%chain, l, w, state)
            associate (k => agenda%book(of_position, w))
               call self%group%set_step(l, begin + (k - agenda%origin(w)), force(k), &
                                        force(k + 1) - force(k))
            end associate
         end do
         call self%group%march_step(state, slip_begin, error)
         if (allocated(error)) return
         do l = 1, m
            call self%group%store(self%chain, l, state)
            call load(entry(l))
            call finish_stretch(entry(l))
         end do
      end subroutine treat_crowded

      !> From the block to the work space.
      subroutine load(w)
         integer, intent(in) :: w

         call take_in(self%chain, self%h, state, w, agenda%book(of_place, w), sample(1, 1, w))
         agenda%book(of_pattern, w) = pattern_of(state%direction(:, w))
         call enter_pattern(w)
      end subroutine load

      !> And back.
      subroutine store(w)
         integer, intent(in) :: w

         call hand_back(self%chain, self%h, sample(1, 1, w), agenda%book(of_place, w), w, state)
      end subroutine store

   end subroutine walk

end module dynamics_tabulated
