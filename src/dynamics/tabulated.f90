!> The march by tabulated propagators: most steps are quiet, some have one transition, few have
!> more.
!>
!> Each sample walks at its own pace, up to four steps at once. A pass takes a stretch of every
!> sample that is free to; those whose stretch was not quiet wait until many can be treated side by
!> side, first as stretches with few transitions, then, where that is not all, by shorter stretches,
!> and at last step by step by Taylor series with every transition in turn.
module dynamics_tabulated
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_course, only: new_course
   use dynamics_lanes, only: lane_group
   use dynamics_propagator, only: levels, stride_of
   use dynamics_quiet, only: take_steps
   use dynamics_response, only: block_state
   use dynamics_stretches, only: treat_stretches
   use dynamics_tables, only: tables_type
   use dynamics_taylor, only: lanes
   use dynamics_walk, only: append, crowded, end_walk, finish_stretch, pop, record, set_free, &
                            sort_out, start_walk, waiting, walk_type
   use dynamics_walker, only: hand_back, take_in
   implicit none(type, external)
   private
   public :: march_by_tables

   integer, parameter :: enough_waiting = 28   ! stretches, most of a block: whole vectors of them

contains

   !> Marches a block through the whole force record.
   subroutine march_by_tables(tables, group, state, force, begin, spacing, n_recorded, &
                              displacement, velocity, error)
      type(tables_type), intent(inout) :: tables
      type(lane_group), intent(inout) :: group
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)         !! (step, 1 or sample) [N]
      real(wp), intent(in) :: begin                !! steps done before [steps]
      integer, intent(in) :: spacing               !! steps from record to record
      integer, intent(in) :: n_recorded            !! records already made
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0
      type(error_type), allocatable, intent(out) :: error
      type(walk_type) :: walk
      integer :: level, w

      call start_walk(new_course(force, tables%propagator%force_scale), ubound(force, 1), begin, &
                      tables%level, spacing, size(displacement) > 0, size(velocity) > 0, state, &
                      walk)
      do w = 1, state%n_samples
         call load(tables, state, w, walk)
         call set_free(walk, w)
      end do
      do while (sum(walk%n_listed) > 0 .and. .not. allocated(error))
         do level = walk%level, 1, -1
            call take_strides(tables, level, walk)
         end do
         do while (is_ready(walk, waiting, enough_waiting))
            call treat_stretches(tables, walk, state)
         end do
         do while (is_ready(walk, crowded, lanes) .and. .not. allocated(error))
            call treat_crowded(tables, group, walk, state, error)
         end do
      end do
      do w = 1, state%n_samples
         call hand_back(tables%chain, tables%h, walk%walker(w), w, state)
      end do
      call end_walk(walk, state%n_dof, n_recorded + 1, tables%h, displacement, velocity)
   end subroutine march_by_tables

   !> Whether a list is to be treated now: enough are in it, or nobody is free to go on.
   pure logical function is_ready(walk, list, enough)
      type(walk_type), intent(in) :: walk
      integer, intent(in) :: list, enough

      is_ready = walk%n_listed(list) >= enough .or. &
                 (sum(walk%n_listed(:levels)) == 0 .and. walk%n_listed(list) > 0)
   end function is_ready

   !> Takes a stride of all samples that are free to, of one level, and sorts them.
   subroutine take_strides(tables, level, walk)
      type(tables_type), intent(in) :: tables
      integer, intent(in) :: level
      type(walk_type), intent(inout) :: walk
      integer :: k, n_due, n_stopping, n_taken, w

      n_taken = walk%n_listed(level)
      if (n_taken == 0) return
      walk%taken(:n_taken) = walk%list(:n_taken, level)
      associate (propagator => tables%propagator)
         call take_steps(propagator%n, stride_of(level), walk%course%force, &
                         walk%course%bend(0, level), &
                         propagator%pool(propagator%at_step(0, level)), tables%floor(level), &
                         n_taken, walk%taken, walk%n_samples, walk%walker, walk%suspects)
      end associate
      call sort_out(n_taken, walk%taken, walk%suspects, stride_of(level), level == walk%level, &
                    walk%n_samples, walk%walker, walk%n_listed(level), walk%list(:, level), &
                    n_stopping, walk%stopping, n_due, walk%due)
      do k = 1, n_due
         call record(walk, walk%due(k))
      end do
      do k = 1, n_stopping
         w = abs(walk%stopping(k))
         if (walk%stopping(k) > 0) then
            call set_free(walk, w)
         else
            walk%walker(w)%level = level
            call append(walk, w, merge(waiting, level - 1, &
                                       level == 1 .or. tables%has_crossings(level)))
         end if
      end do
   end subroutine take_strides

   !> Treats up to eight steps with whatever is in them.
   subroutine treat_crowded(tables, group, walk, state, error)
      type(tables_type), intent(inout) :: tables
      type(lane_group), intent(inout) :: group
      type(walk_type), intent(inout) :: walk
      type(block_state), intent(inout) :: state
      type(error_type), allocatable, intent(out) :: error
      integer :: entry(lanes), l, m, w

      call pop(walk, crowded, lanes, entry, m)
      do l = 1, lanes
         call group%clear(l)
         if (l > m) cycle
         w = entry(l)
         associate (walker => walk%walker(w), f => walk%course%force)
            call hand_back(tables%chain, tables%h, walker, w, state)
            call group%load(tables%chain, l, w, state)
            call group%set_step(l, walk%begin + (walker%position - walker%first), &
                                f(walker%position), f(walker%position + 1) - f(walker%position))
         end associate
      end do
      call group%march_step(state, error)
      if (allocated(error)) return
      do l = 1, m
         call group%store(tables%chain, l, state)
         call load(tables, state, entry(l), walk)
         call finish_stretch(walk, entry(l))
      end do
   end subroutine treat_crowded

   !> From the block to the walk.
   subroutine load(tables, state, w, walk)
      type(tables_type), intent(inout) :: tables
      type(block_state), intent(in) :: state
      integer, intent(in) :: w
      type(walk_type), intent(inout) :: walk

      associate (walker => walk%walker(w), propagator => tables%propagator)
         call take_in(tables%chain, tables%h, state, w, walker)
         if (.not. propagator%is_built(walker%pattern)) call propagator%build(walker%pattern)
      end associate
   end subroutine load

end module dynamics_tabulated
