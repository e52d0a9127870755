!> Stretches with few transitions, each of another mass and one after the other, many stretches side
!> by side; those that have more to them are left for a closer look.
module dynamics_stretches
   use core_kinds, only: wp
   use dynamics_crossing, only: capacity, is_smooth, read_masses, step_across
   use dynamics_location, only: locate
   use dynamics_propagator, only: stride_of
   use dynamics_quiet, only: find_suspects
   use dynamics_response, only: block_state
   use dynamics_tables, only: tables_type
   use dynamics_transitions, only: check_regimes, first_suspect, keep_transition, most_transitions
   use dynamics_walk, only: append, crowded, finish_stretch, pop, waiting, walk_type
   use dynamics_walker, only: set_anchors, walker_type
   implicit none(type, external)
   private
   public :: treat_stretches

   !> Those that are treated now; arrays (stretch).
   type :: stretch_list
      integer :: n = 0
      integer :: sample(capacity)             !! whose
      logical :: is_open(capacity)            !! the way of dynamics_crossing may still do
      integer :: n_transitions(capacity)      !! found so far
      real(wp) :: latest(capacity)            !! time of the last one of them [stretches]
   end type stretch_list

contains

   !> Takes a batch of the waiting stretches: reads of each the mass that may have its transition
   !> first, locates those transitions, adds what they change to the states at the end, and again,
   !> until no mass is left that may have one.
   subroutine treat_stretches(tables, walk, state)
      type(tables_type), intent(inout) :: tables
      type(walk_type), intent(inout) :: walk
      type(block_state), intent(inout) :: state
      type(stretch_list) :: list
      integer, dimension(capacity) :: mass, reading, sample   ! (lane)
      integer :: k, l, n_reading

      call pop(walk, waiting, capacity, list%sample, list%n)
      call open_stretches(tables, walk, list, n_reading, reading)
      tables%found%n = 0
      do while (n_reading > 0)
         do k = 1, n_reading
            sample(k) = list%sample(reading(k))
            mass(k) = first_suspect(walk%walker(sample(k)))
         end do
         associate (propagator => tables%propagator)
            call read_masses(n_reading, sample, mass, propagator, &
                             propagator%pool(propagator%pull), walk%course, walk%n_samples, &
                             walk%walker, tables%batch)
         end associate
         call locate(tables%batch)
         n_reading = 0
         do k = 1, tables%batch%n
            l = reading(k)
            call take_transition(tables, walk, list, l, k, mass(k))
            reading(n_reading + 1) = l
            if (list%is_open(l) .and. walk%walker(list%sample(l))%suspects /= 0) &
               n_reading = n_reading + 1
         end do
      end do
      call check_regimes(walk%course, list%sample, walk%walker, tables%found, list%is_open)
      call change_regimes(tables, walk, list, state)
      do l = 1, list%n
         call close_stretch(walk, list%sample(l), list%is_open(l))
      end do
   end subroutine treat_stretches

   !> Finds out which stretches can be treated side by side.
   pure subroutine open_stretches(tables, walk, list, n_reading, reading)
      type(tables_type), intent(in) :: tables
      type(walk_type), intent(inout) :: walk
      type(stretch_list), intent(inout) :: list
      integer, intent(out) :: n_reading, reading(capacity)
      integer :: l

      n_reading = 0
      do l = 1, list%n
         list%n_transitions(l) = 0
         list%latest(l) = -huge(1.0_wp)
         associate (walker => walk%walker(list%sample(l)))
            walker%switched = 0
            list%is_open(l) = tables%has_crossings(walker%level) .and. &
                              is_smooth(tables%batch, walk%course%bend(walker%position, &
                                                                       walker%level), walker)
         end associate
         reading(n_reading + 1) = l
         if (list%is_open(l)) n_reading = n_reading + 1
      end do
   end subroutine open_stretches

   !> Takes the transition of mass i that a lane has located into the state of stretch l, unless it
   !> would come before the last one; or notes that there is none.
   subroutine take_transition(tables, walk, list, l, lane, i)
      type(tables_type), intent(inout) :: tables
      type(walk_type), intent(inout) :: walk
      type(stretch_list), intent(inout) :: list
      integer, intent(in) :: l, lane, i
      integer :: pattern

      associate (walker => walk%walker(list%sample(l)), batch => tables%batch, &
                 propagator => tables%propagator)
         if (batch%is_clear(lane) > 0.5_wp) then
            walker%suspects = ibclr(walker%suspects, i - 1)
            return
         end if
         list%is_open(l) = batch%is_located(lane) > 0.5_wp .and. &
                           list%n_transitions(l) < most_transitions .and. &
                           batch%tau(lane) > list%latest(l)
         if (.not. list%is_open(l)) return
         list%n_transitions(l) = list%n_transitions(l) + 1
         list%latest(l) = batch%tau(lane)
         call keep_transition(batch, lane, l, i, tables%found)
         walker%switched = ibset(walker%switched, i - 1)
         pattern = ieor(walker%pattern, walker%switched)
         if (.not. propagator%is_built(pattern)) call propagator%build(pattern)
         call step_across(batch, lane, i, propagator%pool(propagator%at_kick(pattern)), walker)
         walker%suspects = iand(find_suspects(stride_of(walker%level), &
                                              walk%course%bend(walker%position, walker%level), &
                                              tables%floor(walker%level), walker), &
                                not(walker%switched))
      end associate
   end subroutine take_transition

   !> Enters the transitions of the stretches that are done.
   subroutine change_regimes(tables, walk, list, state)
      type(tables_type), intent(in) :: tables
      type(walk_type), intent(inout) :: walk
      type(stretch_list), intent(in) :: list
      type(block_state), intent(inout) :: state
      real(wp) :: now
      integer :: i, kind, stick, t, w

      do t = 1, tables%found%n
         if (.not. list%is_open(tables%found%stretch(t))) cycle
         w = list%sample(tables%found%stretch(t))
         associate (found => tables%found, walker => walk%walker(w))
            i = found%mass(t)
            now = walk%begin + (walker%position - walker%first) + &
                  stride_of(walker%level)*found%time(t)
            stick = int(found%is_stick(t))
            kind = (1 - stick)*int(found%sense(t))
            walker%slider(i) = found%x(t) - found%sense(t)*walker%reach(i)
            walker%direction(i) = kind
         end associate
         state%stick_starts(i, w) = state%stick_starts(i, w) + stick
         state%slip_starts(i, w) = state%slip_starts(i, w) + (1 - stick)
         state%slip_time(i, w) = state%slip_time(i, w) + &
                                 stick*(now - state%slip_begin(i, w))*tables%h
         state%slip_begin(i, w) = merge(state%slip_begin(i, w), now, stick == 1)
         if (state%keeps_transitions) call state%transitions(w)%append(now*tables%h, i, kind)
      end do
   end subroutine change_regimes

   !> A stretch that is done counts; one that is not is taken again by shorter strides.
   pure subroutine close_stretch(walk, w, is_done)
      type(walk_type), intent(inout) :: walk
      integer, intent(in) :: w
      logical, intent(in) :: is_done

      associate (walker => walk%walker(w))
         if (is_done) then
            walker%pattern = ieor(walker%pattern, walker%switched)
            walker%place = 1 - walker%place
            call set_anchors(walker)
            call finish_stretch(walk, w)
         else
            call append(walk, w, merge(walker%level - 1, crowded, walker%level > 1))
         end if
      end associate
   end subroutine close_stretch

end module dynamics_stretches
