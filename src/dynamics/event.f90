!> The exact march: piecewise-linear force, closed form between transitions, each of them located.
!>
!> Chains of up to 8 masses go by tables of exact steps (dynamics_tabulated), in which a step
!> without a transition costs one matrix product and its check. Longer ones, and any chain whose
!> ledger is kept, go by Taylor series (dynamics_lanes), which also give the integrals of powers.
module dynamics_event
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use structure_model, only: structure_type
   use dynamics_newmark_frame, only: new_newmark_frame, newmark_frame
   use dynamics_lanes, only: lane_group, new_lane_group
   use dynamics_propagator, only: width
   use dynamics_response, only: block_state, marcher_type
   use dynamics_tables, only: new_tables, table_rate_step, tables_type
   use dynamics_tabulated, only: march_by_tables
   use dynamics_taylor, only: fastest_rate, lanes, new_taylor, order_for
   implicit none(type, external)
   private
   public :: event_marcher, new_event_marcher, parts_of_step, most_parts

   integer, parameter :: most_parts = 4096   !! of a step; more are refused

   real(wp), parameter :: series_rate_step = 1.0_wp   !! longest part of a step, by series

   !> Marches by tables of exact steps, and by Taylor series where the chain is too long for tables.
   type, extends(marcher_type) :: event_marcher
      real(wp) :: tolerance = 0.0_wp     !! displacement error relative to its rms
      integer :: substeps = 1            !! equal parts of a step
      logical :: has_tables = .false.
      type(lane_group) :: group
      type(tables_type) :: tables
   contains
      procedure :: advance
      procedure :: advance_by_tables
      procedure :: advance_by_series
   end type event_marcher

contains

   !> The event method for one chain: tolerance 1e-12 .. 1e-3 of the rms displacement.
   subroutine new_event_marcher(chain, dt, tolerance, forced_dof, marcher, error)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      integer, intent(in) :: forced_dof
      type(event_marcher), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      !> a step's error lives on for some 1/zeta periods of many steps each
      real(wp), parameter :: share_of_step = 1.0e-4_wp, share_of_transition = 2.0e-2_wp
      type(newmark_frame) :: frame
      real(wp) :: h, rate

      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'dt = '//to_text(dt)//': must be positive')
      else if (.not. (tolerance > 0.0_wp .and. tolerance < 1.0_wp)) then
         call raise(error, exit_bad_input, 'tolerance = '//to_text(tolerance)// &
                    ': must be between 0 and 1')
      else if (forced_dof < 1 .or. forced_dof > chain%n_dof) then
         call raise(error, exit_bad_input, 'dof = '//to_text(forced_dof)//': the chain has '// &
                    to_text(chain%n_dof)//' masses')
      else if (parts_of_step(chain, dt) > most_parts) then
         call raise(error, exit_bad_input, 'dt = '//to_text(dt)//': a mass is too light, or '// &
                    'its spring too stiff: dt must be at most '// &
                    to_text(most_parts*dt/parts_of_step(chain, dt)))
      end if
      if (allocated(error)) return
      call new_newmark_frame(chain, frame, error)
      if (allocated(error)) return
      if (.not. frame%is_row) &
         call raise(error, exit_bad_input, "integration%method = 'event': marches a row of "// &
                    "masses, each held to the ground; choose 'newmark'")
      if (allocated(error)) return

      marcher%structure = chain
      marcher%dt = dt
      marcher%forced_dof = forced_dof
      marcher%tolerance = tolerance
      rate = fastest_rate(chain)
      marcher%has_tables = chain%n_dof <= width
      marcher%substeps = max(1, ceiling(parts_of_step(chain, dt)))
      h = dt/marcher%substeps
      associate (order => order_for(rate*h, share_of_step*tolerance))
         marcher%group = new_lane_group(chain, new_taylor(chain, h, forced_dof, order), rate*h, &
                                        tolerance)
      end associate
      if (marcher%has_tables) call new_tables(chain, h, forced_dof, share_of_transition*tolerance, &
                                              marcher%tables)
   end subroutine new_event_marcher

   !> How many parts of a step are needed, at least: the fastest mode bounds their length, for the
   !> tables so that guards are bounded sharply, for the series so that few powers do.
   pure function parts_of_step(chain, dt) result(parts)
      type(structure_type), intent(in) :: chain
      real(wp), intent(in) :: dt   !! [s]
      real(wp) :: parts

      parts = fastest_rate(chain)*dt/merge(table_rate_step, series_rate_step, &
                                           chain%n_dof <= width)
   end function parts_of_step

   !> See marcher_type.
   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(event_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N], linear between its values
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)         !! (record, dof, sample) [m], or size 0
      real(wp), intent(out), optional :: velocity(:, :, :)   !! (record, dof, sample) [m/s]
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: h, no_velocity(0, 0, 0)

      state%slip_begin = spread(spread(real(state%step*self%substeps, wp), 1, state%n_dof), 2, &
                                state%n_samples)
      if (present(velocity)) then
         call go(velocity)
      else
         call go(no_velocity)
      end if
      if (allocated(error)) return
      state%step = state%step + ubound(force, 1)
      h = self%dt/self%substeps
      where (state%direction /= 0) state%slip_time = state%slip_time + &
                                           (real(state%step*self%substeps, wp) - state%slip_begin)*h

   contains

      subroutine go(velocity)
         real(wp), intent(inout) :: velocity(:, :, :)

         if (self%has_tables .and. .not. state%keeps_ledger) then
            call self%advance_by_tables(state, force, every, displacement, velocity, error)
         else
            call self%advance_by_series(state, force, every, displacement, velocity, error)
         end if
      end subroutine go

   end subroutine advance

   !> In pieces whose force, with a value at every part of a step, stays in the cache.
   subroutine advance_by_tables(self, state, force, every, displacement, velocity, error)
      class(event_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: longest_piece = 8192   ! parts of steps
      real(wp), allocatable :: piece(:, :)
      integer :: first, last, n_steps, recorded, step, sub

      n_steps = ubound(force, 1)
      first = 0
      do while (first < n_steps)
         last = min(first + max(1, longest_piece/self%substeps), n_steps)
         allocate (piece(0:(last - first)*self%substeps, size(force, 2)))
         do step = first, last - 1
            do sub = 0, self%substeps - 1
               piece((step - first)*self%substeps + sub, :) = force(step, :) + &
                                 (force(step + 1, :) - force(step, :))*(real(sub, wp)/self%substeps)
            end do
         end do
         piece((last - first)*self%substeps, :) = force(last, :)
         recorded = int((state%step + first)/every - state%step/every)
         call march_by_tables(self%tables, self%group, state, piece, &
                              real((state%step + first)*self%substeps, wp), &
                              every*self%substeps, recorded, displacement, velocity, error)
         if (allocated(error)) return
         deallocate (piece)
         first = last
      end do
   end subroutine advance_by_tables

   !> Eight samples at a time, each at its own pace: a lane that has reached the end of its step
   !> goes on to the next one, and one that has done them all takes another sample.
   subroutine advance_by_series(self, state, force, every, displacement, velocity, error)
      class(event_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(inout) :: displacement(:, :, :), velocity(:, :, :)   !! each may have size 0
      type(error_type), allocatable, intent(out) :: error
      type(lane_group) :: group
      integer :: l, next, part(lanes), record(lanes)   ! parts of steps done, and records made

      group = self%group
      next = 1
      do l = 1, lanes
         call take_sample(l)
      end do
      do while (any(group%sample > 0))
         call group%march_round(state, error)
         if (allocated(error)) return
         do l = 1, lanes
            if (group%sample(l) > 0 .and. group%tau(l) >= 1.0_wp) call finish_part(l)
         end do
      end do

   contains

      !> The next sample that is left, or none.
      subroutine take_sample(l)
         integer, intent(in) :: l

         call group%clear(l)
         if (next > state%n_samples .or. ubound(force, 1) == 0) return
         call group%load(self%structure, l, next, state)
         next = next + 1
         part(l) = 0
         record(l) = 0
         call begin_part(l)
      end subroutine take_sample

      !> Sets out on the next part of a step, with the force on the chord between its values.
      subroutine begin_part(l)
         integer, intent(in) :: l
         integer :: column, step, sub
         real(wp) :: rise

         column = merge(group%sample(l), 1, size(force, 2) > 1)
         step = part(l)/self%substeps
         sub = modulo(part(l), self%substeps)
         rise = (force(step + 1, column) - force(step, column))/self%substeps
         call group%set_step(l, real(state%step*self%substeps + part(l), wp), &
                             force(step, column) + sub*rise, rise)
      end subroutine begin_part

      !> Counts a part of a step that is done, records, and goes on.
      subroutine finish_part(l)
         integer, intent(in) :: l
         integer :: step

         part(l) = part(l) + 1
         step = part(l)/self%substeps
         if (modulo(part(l), self%substeps) == 0 .and. size(displacement) > 0) then
            if (modulo(state%step + step, int(every, long)) == 0) then
               record(l) = record(l) + 1
               associate (w => group%sample(l), n => state%n_dof, h => group%taylor%h)
                  displacement(record(l), :, w) = group%x(l, 1:n, 0)
                  if (size(velocity) > 0) velocity(record(l), :, w) = group%x(l, 1:n, 1)/h
               end associate
            end if
         end if
         if (step < ubound(force, 1)) then
            call begin_part(l)
         else
            call group%store(self%structure, l, state)
            call take_sample(l)
         end if
      end subroutine finish_part

   end subroutine advance_by_series

end module dynamics_event
