!> The march by tabulated propagators: most steps are quiet, some have one transition, few have
!> more.
!>
!> Each sample walks at its own pace. A pass takes one step of every sample that is free to; those
!> whose step was not quiet wait until eight can be treated side by side, first as steps with a
!> single transition, then, where that is not all, by Taylor series with every transition in turn.
module dynamics_tabulated
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use dynamics_chain, only: chain_type
   use dynamics_lanes, only: lane_group
   use dynamics_propagator, only: alignment_gap, propagator_type, width
   use dynamics_quiet, only: add_further_masses, at_anchor, at_direction, at_reach, at_shift, &
                             at_slack, at_slider, at_state, sample_size, take_step, written_out
   use dynamics_response, only: block_state
   use dynamics_single, only: lanes, locate, read_path, single_batch, step_across
   implicit none(type, external)
   private
   public :: tabulated_march

   !> What all samples share.
   type :: tabulated_march
      type(chain_type) :: chain
      integer :: forced_dof = 0
      real(wp) :: h = 0.0_wp            !! [s]
      real(wp) :: floor = 0.0_wp        !! share of the reach kept clear in a quiet step
      logical :: has_singles = .false.  !! the way of dynamics_single keeps the tolerance
      type(propagator_type) :: propagator
      type(lane_group) :: group
   contains
      procedure :: march
   end type tabulated_march

   !> What each sample is doing; arrays (sample). Positions are those in the force, taken as one
   !> long array.
   type :: schedule_type
      integer, allocatable :: pattern(:)   !! of stuck masses
      integer, allocatable :: place(:)     !! 0 or 1: where its state is
      integer, allocatable :: position(:)  !! of the next step
      integer, allocatable :: origin(:), last(:)   !! of the first step, and after the last one
      integer, allocatable :: due(:), record(:)    !! position and number of the next record
      integer, allocatable :: free(:), waiting(:), crowded(:)   !! lists of samples
      integer :: n_free = 0, n_waiting = 0, n_crowded = 0
   end type schedule_type

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
      type(schedule_type) :: schedule
      real(wp), allocatable :: pool(:)
      integer :: first, n, w

      n = state%n_samples
      allocate (schedule%pattern(n), schedule%free(n), schedule%waiting(n), schedule%crowded(n))
      allocate (schedule%place(n), source=0)
      schedule%origin = [(merge(0, w - 1, size(force, 2) == 1)*size(force, 1), w=1, n)]
      schedule%position = schedule%origin
      schedule%last = schedule%origin + ubound(force, 1)
      schedule%due = schedule%origin + spacing - int(modulo(nint(begin, long), int(spacing, long)))
      if (size(displacement) == 0) schedule%due = -1
      allocate (schedule%record(n), source=n_recorded + 1)
      allocate (pool(sample_size*width*n + width), source=0.0_wp)
      first = 1 + alignment_gap(pool)
      call walk(self, state, size(force), force, begin, spacing, slip_begin, displacement, &
                velocity, schedule, pool(first), error)
   end subroutine march

   !> Passes over the block until every sample has done its steps.
   subroutine walk(self, state, n_forces, force, begin, spacing, slip_begin, displacement, &
                   velocity, todo, sample, error)
      class(tabulated_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      integer, intent(in) :: n_forces, spacing
      real(wp), intent(in) :: force(0:n_forces - 1), begin
      real(wp), intent(inout) :: slip_begin(:, :), displacement(:, :, :), velocity(:, :, :)
      type(schedule_type), intent(inout) :: todo
      real(wp), intent(inout) :: sample(width, sample_size, state%n_samples)
      type(error_type), allocatable, intent(out) :: error
      type(single_batch) :: batch
      real(wp) :: contact(width)     ! h^2 k/m
      real(wp) :: load(width, 0:1)   ! h^2 f/m at both ends of a step
      real(wp) :: force_scale
      integer :: due(state%n_samples), n, n_due, w

      n = state%n_dof
      load = 0.0_wp
      force_scale = self%h**2/self%chain%mass(self%forced_dof)
      contact = 0.0_wp
      contact(:n) = self%h**2*self%chain%contact_stiffness/self%chain%mass
      do w = 1, state%n_samples
         call take_in(w)
      end do
      todo%n_free = state%n_samples
      todo%free = [(w, w=1, state%n_samples)]
      do while (todo%n_free + todo%n_waiting + todo%n_crowded > 0)
         call take_steps(n, state%n_samples, n_forces, force, &
                         self%propagator%pool(self%propagator%step), self%floor, todo%last, &
                         todo%due, todo%pattern, todo%position, todo%place, sample, todo%n_free, &
                            todo%free, &
                         todo%n_waiting, todo%waiting, n_due, due)
         call record(n, due(:n_due), todo%place, sample, self%h, spacing, todo%due, todo%record, &
                     displacement, velocity)
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

         todo%position(w) = todo%position(w) + 1
         if (todo%position(w) == todo%due(w)) then
            call record(n, [w], todo%place, sample, self%h, spacing, todo%due, todo%record, &
                        displacement, velocity)
         end if
         if (todo%position(w) == todo%last(w)) return
         todo%n_free = todo%n_free + 1
         todo%free(todo%n_free) = w
      end subroutine finish_step

      !> Treats up to eight steps as steps with a single transition; the others have more to them.
      subroutine treat_waiting()
         integer :: entry(lanes), l, m, pattern, w
         logical :: is_clean

         call pop(todo%waiting, todo%n_waiting, entry, m)
         batch%mass(m + 1:) = 0
         associate (tables => self%propagator, position => todo%position, place => todo%place)
            do l = 1, m
               w = entry(l)
               load(self%forced_dof, :) = force_scale*force(position(w):position(w) + 1)
               call read_path(batch, l, n, tables%pool(tables%pull), contact, load, place(w), &
                              sample(:, :, w))
            end do
            call locate(batch)
            do l = 1, m
               w = entry(l)
               is_clean = self%has_singles .and. batch%mass(l) > 0 .and. &
                          batch%is_located(l) > 0.5_wp
               if (is_clean) then
                  pattern = ieor(todo%pattern(w), ishft(1, batch%mass(l) - 1))
                  if (.not. tables%is_built(pattern)) call tables%build(pattern)
                  call step_across(batch, l, n, tables%pool(tables%at_step(todo%pattern(w))), &
                                   tables%pool(tables%at_kick(pattern)), force(position(w)), &
                                   self%floor, place(w), sample(:, :, w), is_clean)
               end if
               if (is_clean) then
                  place(w) = 1 - place(w)
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
         integer :: i, kind, stick

         i = batch%mass(l)
         now = begin + (todo%position(w) - todo%origin(w)) + batch%tau(l)
         stick = nint(batch%is_stick(l))
         kind = (1 - stick)*nint(batch%sense(l))
         sample(i, at_slider, w) = batch%x(l) - batch%sense(l)*sample(i, at_reach, w)
         sample(i, at_direction, w) = kind
         state%stick_starts(i, w) = state%stick_starts(i, w) + stick
         state%slip_starts(i, w) = state%slip_starts(i, w) + (1 - stick)
         state%slip_time(i, w) = state%slip_time(i, w) + stick*(now - slip_begin(i, w))*self%h
         slip_begin(i, w) = merge(slip_begin(i, w), now, stick == 1)
         if (state%keeps_transitions) call state%transitions(w)%append(now*self%h, i, kind)
         todo%pattern(w) = ieor(todo%pattern(w), ishft(1, i - 1))
         call enter_pattern(w)
      end subroutine change_regime

      !> What its anchors add to every step of a sample while the pattern lasts.
      subroutine enter_pattern(w)
         integer, intent(in) :: w

         associate (tables => self%propagator, pattern => todo%pattern(w))
            if (.not. tables%is_built(pattern)) call tables%build(pattern)
            call set_shift(n, tables%pool(tables%at_load(pattern)), sample(:, :, w))
         end associate
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
            associate (k => todo%position(w))
               call self%group%set_step(l, begin + (k - todo%origin(w)), force(k), &
                                        force(k + 1) - force(k))
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

      !> From the block to the work space. A mass without friction slips for ever: it watches
      !> nothing, as a stuck one with boundless reach, but its contact is not in the pattern.
      subroutine take_in(w)
         integer, intent(in) :: w
         logical :: has_friction(n)
         integer :: i

         sample(:n, at_state + 2*todo%place(w), w) = state%displacement(:, w)
         sample(:n, at_state + 2*todo%place(w) + 1, w) = self%h*state%velocity(:, w)
         has_friction = state%slip_limit(:, w) > 0.0_wp
         sample(:n, at_slider, w) = merge(state%slider(:, w), 0.0_wp, has_friction)
         sample(:n, at_direction, w) = merge(state%direction(:, w), 0, has_friction)
         sample(:n, at_reach, w) = merge(state%slip_limit(:, w)/self%chain%contact_stiffness, &
                                         huge(1.0_wp), has_friction)
         todo%pattern(w) = 0
         do i = 1, n
            if (state%direction(i, w) == 0) todo%pattern(w) = ibset(todo%pattern(w), i - 1)
         end do
         call enter_pattern(w)
      end subroutine take_in

      !> And back; the slider of a slipping mass has followed it.
      subroutine hand_back(w)
         integer, intent(in) :: w

         state%displacement(:, w) = sample(:n, at_state + 2*todo%place(w), w)
         state%velocity(:, w) = sample(:n, at_state + 2*todo%place(w) + 1, w)/self%h
         where (state%slip_limit(:, w) > 0.0_wp)
            state%direction(:, w) = nint(sample(:n, at_direction, w))
         end where
         state%slider(:, w) = merge(sample(:n, at_slider, w), state%displacement(:, w) - &
                                    state%direction(:, w)*state%slip_limit(:, w)/ &
                                    self%chain%contact_stiffness, state%direction(:, w) == 0)
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
   pure subroutine set_shift(n, load, sample)
      integer, intent(in) :: n
      real(wp), intent(in) :: load(width, 2, width)
      real(wp), intent(inout) :: sample(width, sample_size)
      real(wp) :: shift(width, 2)
      integer :: i, j

      !$omp simd
      do i = 1, width
         sample(i, at_anchor) = merge(-sample(i, at_direction)*sample(i, at_reach), &
                                      sample(i, at_slider), abs(sample(i, at_direction)) > 0.5_wp)
      end do
      shift = 0.0_wp
      do j = 1, n
         !$omp simd
         do i = 1, width
            shift(i, 1) = shift(i, 1) + load(i, 1, j)*sample(j, at_anchor)
            shift(i, 2) = shift(i, 2) + load(i, 2, j)*sample(j, at_anchor)
         end do
      end do
      sample(:, at_shift:at_shift + 1) = shift
   end subroutine set_shift

   !> Takes the next step of every free sample and sorts them, without a branch (hence the
   !> arithmetic: a branch that goes wrong throws away the steps that the processor has already
   !> begun): a quiet step counts, its sample stays free until the last one, and may be due for a
   !> record; an eventful one waits, its state as it was.
   pure subroutine take_steps(n, n_samples, n_forces, force, table, floor, last, due_position, &
                              pattern, position, place, sample, n_free, free, n_waiting, waiting, &
                              n_due, due)
      integer, intent(in) :: n, n_samples, n_forces
      real(wp), intent(in) :: force(0:n_forces - 1)
      real(wp), intent(in) :: table(width, 2, 2*width + 2, 0:2**n - 1)
      real(wp), intent(in) :: floor
      integer, intent(in), dimension(n_samples) :: last, due_position, pattern
      integer, intent(inout) :: position(n_samples), place(n_samples)
      real(wp), intent(inout) :: sample(width, sample_size, n_samples)
      integer, intent(inout) :: n_free, free(n_samples), n_waiting, waiting(n_samples)
      integer, intent(out) :: n_due
      integer, intent(inout) :: due(n_samples)
      real(wp) :: start(width, 2)
      integer(long) :: signs
      integer :: a, i, is_quiet, n_listed, w

      n_listed = n_free
      n_free = 0
      n_due = 0
      do a = 1, n_listed
         w = free(a)
         if (n <= written_out) then
            call take_step(table(1, 1, 1, pattern(w)), force(position(w)), floor, place(w), &
                           sample(1, at_shift, w), sample(1, 1, w))
         else
            start = sample(:, at_shift:at_shift + 1, w)
            call add_further_masses(n, table(1, 1, 1, pattern(w)), &
                                    sample(1, at_state + 2*place(w), w), &
                                    sample(1, at_state + 2*place(w) + 1, w), start)
            call take_step(table(1, 1, 1, pattern(w)), force(position(w)), floor, place(w), start, &
                           sample(1, 1, w))
         end if
         signs = 0
         !$omp simd reduction(ior: signs)
         do i = 1, width
            signs = ior(signs, transfer(sample(i, at_slack, w), 0_long))
         end do
         is_quiet = merge(0, 1, signs < 0)
         position(w) = position(w) + is_quiet
         place(w) = ieor(place(w), is_quiet)
         waiting(n_waiting + 1) = w
         n_waiting = n_waiting + 1 - is_quiet
         due(n_due + 1) = w
         n_due = n_due + iand(is_quiet, 1 - min(1, abs(due_position(w) - position(w))))
         free(n_free + 1) = w
         n_free = n_free + iand(is_quiet, min(1, last(w) - position(w)))
      end do
   end subroutine take_steps

   !> Records the states of the listed samples, and sets the position of their next records.
   pure subroutine record(n, list, place, sample, h, spacing, due, made, displacement, velocity)
      integer, intent(in) :: n, list(:), place(:), spacing
      real(wp), intent(in) :: sample(width, sample_size, *), h
      integer, intent(inout) :: due(:), made(:)
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0
      integer :: a, i, w

      do a = 1, size(list)
         w = list(a)
         do i = 1, n
            displacement(made(w), i, w) = sample(i, at_state + 2*place(w), w)
         end do
         if (size(velocity) > 0) then
            velocity(made(w), :, w) = sample(:n, at_state + 2*place(w) + 1, w)/h
         end if
         made(w) = made(w) + 1
         due(w) = due(w) + spacing
      end do
   end subroutine record

end module dynamics_tabulated
