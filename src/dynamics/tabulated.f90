!> The march by tabulated propagators: most steps are quiet, some have one transition, few have more.
!>
!> Each sample walks at its own pace. A pass takes one step of every sample that is free to; those whose
!> step was not quiet wait until eight can be treated side by side, first as steps with a single
!> transition, then, where that is not all, by Taylor series with every transition in turn.
module dynamics_tabulated
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_lanes, only: lane_group
   use dynamics_propagator, only: alignment_gap, propagator_type, width
   use dynamics_quiet, only: add_further_masses, anchor, direction, reach, regime_size, shift_u, shift_x, &
                             slider, take_step, written_out
   use dynamics_response, only: block_state
   use dynamics_single, only: clear_lane, lanes, locate, read_series, single_batch, step_across
   implicit none(type, external)
   private
   public :: tabulated_march

   !> What all samples share.
   type :: tabulated_march
      type(chain_type) :: chain
      real(wp) :: h = 0.0_wp            !! [s]
      real(wp) :: floor = 0.0_wp        !! share of its reach that a mass keeps clear of the limit in a quiet step
      logical :: has_series = .false.   !! the tabulated series keep the tolerance
      type(propagator_type) :: propagator
      type(lane_group) :: group
   contains
      procedure :: march
   end type tabulated_march

   !> What each sample is doing; arrays (sample).
   type :: schedule_type
      integer, allocatable :: pattern(:)   !! of stuck masses
      integer, allocatable :: column(:)    !! of the force
      integer, allocatable :: step(:)      !! steps done
      integer, allocatable :: place(:)     !! 0 or 1: where its state is
      integer, allocatable :: due(:), record(:)   !! step and number of the next record
      integer, allocatable :: free(:), waiting(:), crowded(:)   !! lists of samples
      integer :: n_free = 0, n_waiting = 0, n_crowded = 0
   end type schedule_type

contains

   !> Marches a block through the whole force record.
   subroutine march(self, state, force, begin, spacing, n_recorded, slip_begin, displacement, velocity, &
                    error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in), contiguous :: force(0:, :)   !! (step, 1 or sample) [N]
      real(wp), intent(in) :: begin                      !! steps done before [steps]
      integer, intent(in) :: spacing                     !! steps from record to record
      integer, intent(in) :: n_recorded                  !! records already made
      real(wp), intent(inout) :: slip_begin(:, :)        !! (dof, sample) [steps]
      real(wp), intent(inout) :: displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(schedule_type) :: schedule
      real(wp), allocatable :: pool(:)
      integer :: first, n, w

      n = state%n_samples
      allocate (schedule%pattern(n), schedule%free(n), schedule%waiting(n), &
                schedule%crowded(n))
      allocate (schedule%step(n), schedule%place(n), source=0)
      allocate (schedule%record(n), source=n_recorded + 1)
      allocate (schedule%due(n), source=spacing - int(modulo(nint(begin, long), int(spacing, long))))
      if (size(displacement) == 0) schedule%due = -1
      schedule%column = [(merge(1, w, size(force, 2) == 1), w=1, n)]
      allocate (pool((4 + regime_size + 1)*width*n + width), source=0.0_wp)
      first = 1 + alignment_gap(pool)
      call walk(self, state, size(force, 2), ubound(force, 1), force, begin, spacing, slip_begin, &
                displacement, velocity, schedule, pool(first), pool(first + 4*width*n), &
                pool(first + (4 + regime_size)*width*n), error)
   end subroutine march

   !> Passes over the block until every sample has done its steps.
   subroutine walk(self, state, n_columns, n_steps, force, begin, spacing, slip_begin, displacement, &
                   velocity, todo, y, regime, slack, error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: n_columns, n_steps, spacing
      real(wp), intent(in) :: force(0:n_steps, n_columns), begin
      real(wp), intent(inout) :: slip_begin(:, :), displacement(:, :, :)
      real(wp), intent(inout), optional :: velocity(:, :, :)
      type(schedule_type), intent(inout) :: todo
      real(wp), intent(inout) :: y(width, 2, 0:1, state%n_samples)   !! x and u = h v, in two places
      real(wp), intent(inout) :: regime(width, regime_size, state%n_samples)
      real(wp), intent(inout) :: slack(width, state%n_samples)
      type(error_type), allocatable, intent(out) :: error
      type(single_batch) :: batch
      real(wp) :: contact(width)   !! h^2 k/m
      integer :: due(state%n_samples), n, n_due, w

      n = state%n_dof
      contact = 0.0_wp
      contact(:n) = self%h**2*self%chain%contact_stiffness/self%chain%mass
      do w = 1, state%n_samples
         call take_in(w)
      end do
      todo%n_free = state%n_samples
      todo%free = [(w, w=1, state%n_samples)]
      do while (todo%n_free + todo%n_waiting + todo%n_crowded > 0)
         call take_steps(n, state%n_samples, n_steps, n_columns, force, &
                         self%propagator%pool(self%propagator%step), self%floor, todo%n_free, todo%free, &
                         todo%pattern, todo%column, todo%step, regime, todo%place, y, slack)
         call sort_steps(state%n_samples, n_steps, slack, todo%due, todo%step, todo%place, todo%n_free, &
                         todo%free, todo%n_waiting, todo%waiting, n_due, due)
         do w = 1, n_due
            call record(due(w))
         end do
         do while (todo%n_waiting >= lanes .or. (todo%n_free == 0 .and. todo%n_waiting > 0))
            call treat_waiting()
         end do
         do while (todo%n_crowded >= lanes .or. (todo%n_free == 0 .and. todo%n_crowded > 0))
            call treat_crowded(error)
            if (allocated(error)) return
         end do
      end do
      do w = 1, state%n_samples
         call hand_back(w)
      end do

   contains

      !> Counts an eventful step that is done, and frees the sample for the next one.
      subroutine finish_step(w)
         integer, intent(in) :: w

         todo%step(w) = todo%step(w) + 1
         if (todo%step(w) == todo%due(w)) call record(w)
         if (todo%step(w) == n_steps) return
         todo%n_free = todo%n_free + 1
         todo%free(todo%n_free) = w
      end subroutine finish_step

      subroutine record(w)
         integer, intent(in) :: w

         displacement(todo%record(w), :, w) = y(:n, 1, todo%place(w), w)
         if (present(velocity)) velocity(todo%record(w), :, w) = y(:n, 2, todo%place(w), w)/self%h
         todo%record(w) = todo%record(w) + 1
         todo%due(w) = todo%due(w) + spacing
      end subroutine record

      !> Treats up to eight steps as steps with a single transition; the others have more to them.
      subroutine treat_waiting()
         integer :: entry(lanes), l, m, now, pattern, w
         logical :: is_clean

         associate (tables => self%propagator)
         call pop(todo%waiting, todo%n_waiting, entry, m)
         do l = 1, lanes
            w = entry(l)
            now = todo%place(w)
            if (l > m) then
               call clear_lane(batch, l)
            else
               call read_series(batch, l, n, tables%pool(tables%at_row(todo%pattern(w))), &
                                contact, force(todo%step(w):todo%step(w) + 1, todo%column(w)), &
                                regime(:, :, w), y(:, :, now, w), y(:, :, 1 - now, w), slack(:, w))
            end if
         end do
         call locate(batch)
         do l = 1, m
            w = entry(l)
            is_clean = batch%mass(l) > 0 .and. batch%is_located(l) > 0.0_wp .and. self%has_series
            if (is_clean) then
               pattern = ieor(todo%pattern(w), ishft(1, batch%mass(l) - 1))
               if (.not. tables%is_built(pattern)) call tables%build(pattern)
               now = todo%place(w)
               call step_across(batch, l, n, tables%pool(tables%at_step(todo%pattern(w))), &
                                tables%pool(tables%at_kick(pattern)), &
                                force(todo%step(w):todo%step(w) + 1, todo%column(w)), self%floor, &
                                regime(:, :, w), y(:, :, now, w), y(:, :, 1 - now, w), slack(:, w), is_clean)
            end if
            if (is_clean) then
               todo%place(w) = 1 - now
               call change_regime(l, w)
               call finish_step(w)
            else
               todo%n_crowded = todo%n_crowded + 1
               todo%crowded(todo%n_crowded) = w
            end if
         end do
         end associate
      end subroutine treat_waiting

      !> Enters the transition of lane l into the books of its sample.
      subroutine change_regime(l, w)
         integer, intent(in) :: l, w
         real(wp) :: now
         integer :: i, kind

         i = batch%mass(l)
         now = begin + todo%step(w) + batch%tau(l)
         if (batch%is_stick(l)) then
            kind = 0
            regime(i, slider, w) = batch%series(l, 0) - batch%sense(l)*regime(i, reach, w)
            state%stick_starts(i, w) = state%stick_starts(i, w) + 1
            state%slip_time(i, w) = state%slip_time(i, w) + (now - slip_begin(i, w))*self%h
         else
            kind = nint(batch%sense(l))
            state%slip_starts(i, w) = state%slip_starts(i, w) + 1
            slip_begin(i, w) = now
         end if
         regime(i, direction, w) = kind
         if (state%keeps_transitions) call state%transitions(w)%append(now*self%h, i, kind)
         todo%pattern(w) = ieor(todo%pattern(w), ishft(1, i - 1))
         call enter_pattern(w)
      end subroutine change_regime

      !> What its anchors add to every step of a sample while the pattern lasts.
      subroutine enter_pattern(w)
         integer, intent(in) :: w

         if (.not. self%propagator%is_built(todo%pattern(w))) call self%propagator%build(todo%pattern(w))
         call set_shift(n, self%propagator%pool(self%propagator%at_load(todo%pattern(w))), regime(:, :, w))
      end subroutine enter_pattern

      !> Treats up to eight steps with whatever is in them.
      subroutine treat_crowded(error)
         type(error_type), allocatable, intent(out) :: error
         integer :: entry(lanes), l, m, w

         call pop(todo%crowded, todo%n_crowded, entry, m)
         do l = 1, lanes
            call self%group%clear(l)
            if (l > m) cycle
            w = entry(l)
            call hand_back(w)
            call self%group%load(self%chain, l, w, state)
            self%group%begin(l) = begin + todo%step(w)
            associate (f => force(todo%step(w):todo%step(w) + 1, todo%column(w)))
               self%group%force(l, :) = [f(1), f(2) - f(1)]
            end associate
         end do
         call self%group%march_step(state, slip_begin, error)
         if (allocated(error)) return
         do l = 1, m
            call self%group%store(self%chain, l, state)
            call take_in(entry(l))
            call finish_step(entry(l))
         end do
      end subroutine treat_crowded

      !> From the block to the work space. A mass without friction slips for ever: it watches nothing, as a stuck one
      !> with boundless reach, but its contact is not in the pattern.
      subroutine take_in(w)
         integer, intent(in) :: w
         logical :: has_friction(n)
         integer :: i

         y(:n, 1, todo%place(w), w) = state%displacement(:, w)
         y(:n, 2, todo%place(w), w) = self%h*state%velocity(:, w)
         has_friction = state%slip_limit(:, w) > 0.0_wp
         regime(:n, slider, w) = merge(state%slider(:, w), 0.0_wp, has_friction)
         regime(:n, direction, w) = merge(state%direction(:, w), 0, has_friction)
         regime(:n, reach, w) = merge(state%slip_limit(:, w)/self%chain%contact_stiffness, huge(1.0_wp), &
                                      has_friction)
         todo%pattern(w) = 0
         do i = 1, n
            if (state%direction(i, w) == 0) todo%pattern(w) = ibset(todo%pattern(w), i - 1)
         end do
         call enter_pattern(w)
      end subroutine take_in

      !> And back; the slider of a slipping mass has followed it.
      subroutine hand_back(w)
         integer, intent(in) :: w

         state%displacement(:, w) = y(:n, 1, todo%place(w), w)
         state%velocity(:, w) = y(:n, 2, todo%place(w), w)/self%h
         where (state%slip_limit(:, w) > 0.0_wp) state%direction(:, w) = nint(regime(:n, direction, w))
         state%slider(:, w) = merge(regime(:n, slider, w), state%displacement(:, w) - state%direction(:, w)* &
                                    state%slip_limit(:, w)/self%chain%contact_stiffness, state%direction(:, w) == 0)
      end subroutine hand_back

   end subroutine walk

   !> Takes up to eight entries from the front of a list; the rest of `entry` repeats the first.
   pure subroutine pop(list, n_listed, entry, m)
      integer, intent(inout) :: list(:), n_listed
      integer, intent(out) :: entry(lanes), m

      m = min(lanes, n_listed)
      entry = list(1)
      entry(:m) = list(:m)
      list(:n_listed - m) = list(m + 1:n_listed)
      n_listed = n_listed - m
   end subroutine pop

   !> The anchors of a sample, and what they add to every step while the pattern lasts.
   pure subroutine set_shift(n, load, regime)
      integer, intent(in) :: n
      real(wp), intent(in) :: load(width, 2, width)
      real(wp), intent(inout) :: regime(width, regime_size)
      real(wp) :: shift(width, 2)
      integer :: i, j

      regime(:, anchor) = merge(-regime(:, direction)*regime(:, reach), regime(:, slider), &
                                abs(regime(:, direction)) > 0.5_wp)
      shift = 0.0_wp
      do j = 1, n
         !$omp simd
         do i = 1, width
            shift(i, 1) = shift(i, 1) + load(i, 1, j)*regime(j, anchor)
            shift(i, 2) = shift(i, 2) + load(i, 2, j)*regime(j, anchor)
         end do
      end do
      regime(:, shift_x:shift_u) = shift
   end subroutine set_shift

   !> Takes the next step of every listed sample. A sample has two places for its state; the new one goes to
   !> the place that is not in use.
   pure subroutine take_steps(n, n_samples, n_steps, n_columns, force, table, floor, n_listed, list, &
                              pattern, column, step, regime, place, y, slack)
      integer, intent(in) :: n, n_samples, n_steps, n_columns, n_listed
      real(wp), intent(in) :: force(0:n_steps, n_columns)
      real(wp), intent(in) :: table(width, 2, 2*width + 2, 0:2**n - 1)
      real(wp), intent(in) :: floor
      integer, intent(in), dimension(n_samples) :: list, pattern, column, step, place
      real(wp), intent(in) :: regime(width, regime_size, n_samples)
      real(wp), intent(inout) :: y(width, 2, 0:1, n_samples), slack(width, n_samples)
      real(wp) :: shift(width, 2)
      integer :: a, w

      if (n <= written_out) then
         do a = 1, n_listed
            w = list(a)
            call take_step(table(1, 1, 1, pattern(w)), force(step(w), column(w)), &
                           force(step(w) + 1, column(w)), floor, regime(1, shift_x, w), regime(1, 1, w), &
                           y(1, 1, place(w), w), y(1, 1, 1 - place(w), w), slack(1, w))
         end do
      else
         do a = 1, n_listed
            w = list(a)
            shift = regime(:, shift_x:shift_u, w)
            call add_further_masses(n, table(1, 1, 1, pattern(w)), y(1, 1, place(w), w), shift)
            call take_step(table(1, 1, 1, pattern(w)), force(step(w), column(w)), &
                           force(step(w) + 1, column(w)), floor, shift, regime(1, 1, w), &
                           y(1, 1, place(w), w), y(1, 1, 1 - place(w), w), slack(1, w))
         end do
      end if
   end subroutine take_steps

   !> Sorts the samples that have taken a step, without a branch: a quiet step counts, its sample stays free until
   !> the last one, and may be due for a record; an eventful one waits, its state as it was.
   pure subroutine sort_steps(n_samples, n_steps, slack, due_step, step, place, n_free, free, n_waiting, &
                              waiting, n_due, due)
      integer, intent(in) :: n_samples, n_steps
      real(wp), intent(in) :: slack(width, n_samples)
      integer, intent(in) :: due_step(n_samples)
      integer, intent(inout) :: step(n_samples), place(n_samples)
      integer, intent(inout) :: n_free, free(n_samples), n_waiting, waiting(n_samples)
      integer, intent(out) :: n_due
      integer, intent(inout) :: due(n_samples)
      integer(long) :: signs
      integer :: a, i, is_quiet, n_listed, w

      n_listed = n_free
      n_free = 0
      n_due = 0
      do a = 1, n_listed
         w = free(a)
         signs = 0
         !$omp simd reduction(ior: signs)
         do i = 1, width
            signs = ior(signs, transfer(slack(i, w), 0_long))
         end do
         is_quiet = merge(0, 1, signs < 0)
         step(w) = step(w) + is_quiet
         place(w) = ieor(place(w), is_quiet)
         waiting(n_waiting + 1) = w
         n_waiting = n_waiting + 1 - is_quiet
         due(n_due + 1) = w
         n_due = n_due + merge(is_quiet, 0, step(w) == due_step(w))
         free(n_free + 1) = w
         n_free = n_free + merge(is_quiet, 0, step(w) < n_steps)
      end do
   end subroutine sort_steps

end module dynamics_tabulated
