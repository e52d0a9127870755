!> The exact march: piecewise-linear force, closed form between transitions, every transition located.
module dynamics_event
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use dynamics_chain, only: chain_type
   use dynamics_lanes, only: lane_group, new_lane_group
   use dynamics_response, only: block_state, marcher_type
   use dynamics_taylor, only: fastest_rate, lanes, new_taylor, order_for
   implicit none(type, external)
   private
   public :: event_marcher, new_event_marcher

   !> Marches by Taylor series with located transitions.
   type, extends(marcher_type) :: event_marcher
      real(wp) :: tolerance = 0.0_wp     !! displacement error relative to its rms
      integer :: substeps = 1            !! parts of a step, so that rate h <= 1
      type(lane_group) :: group
   contains
      procedure :: advance
   end type event_marcher

contains

   !> The event method for one chain: tolerance 1e-12 .. 1e-3 of the rms displacement.
   subroutine new_event_marcher(chain, dt, tolerance, forced_dof, marcher, error)
      type(chain_type), intent(in) :: chain
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      integer, intent(in) :: forced_dof
      type(event_marcher), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: largest_rate_step = 1.0_wp
      !> a step's error lives on for some 1/zeta periods of many steps each
      real(wp), parameter :: share_of_step = 1.0e-3_wp
      real(wp) :: h

      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'dt = '//to_text(dt)//': must be positive')
      else if (.not. (tolerance > 0.0_wp .and. tolerance < 1.0_wp)) then
         call raise(error, exit_bad_input, 'tolerance = '//to_text(tolerance)// &
                    ': must be between 0 and 1')
      else if (forced_dof < 1 .or. forced_dof > chain%n_dof) then
         call raise(error, exit_bad_input, 'dof = '//to_text(forced_dof)//': the chain has '// &
                    to_text(chain%n_dof)//' masses')
      end if
      if (allocated(error)) return

      marcher%chain = chain
      marcher%dt = dt
      marcher%forced_dof = forced_dof
      marcher%tolerance = tolerance
      marcher%substeps = max(1, ceiling(fastest_rate(chain)*dt/largest_rate_step))
      h = dt/marcher%substeps
      marcher%group = new_lane_group(chain, new_taylor(chain, h, forced_dof, &
                                                       order_for(fastest_rate(chain)*h, share_of_step*tolerance)))
   end subroutine new_event_marcher

   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(event_marcher), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N], linear between its values
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)         !! (record, dof, sample) [m]; may have size 0
      real(wp), intent(out), optional :: velocity(:, :, :)   !! (record, dof, sample) [m/s]
      type(error_type), allocatable, intent(out) :: error
      type(lane_group) :: group
      real(wp), allocatable :: slip_begin(:, :)
      integer(long) :: total
      integer :: column(lanes), first, l, last, n_steps, record, step, sub

      n_steps = ubound(force, 1)
      total = (state%step + n_steps)*self%substeps
      allocate (slip_begin(state%n_dof, state%n_samples), source=real(state%step*self%substeps, wp))
      do first = 1, state%n_samples, lanes
         last = min(first + lanes - 1, state%n_samples)
         group = self%group
         column = 1
         do l = 1, last - first + 1
            call group%load(self%chain, l, first + l - 1, state)
            if (size(force, 2) > 1) column(l) = first + l - 1
         end do
         record = 0
         do step = 0, n_steps - 1
            group%force(:, 1) = (force(step + 1, column) - force(step, column))/self%substeps
            do sub = 0, self%substeps - 1
               group%force(:, 0) = force(step, column) + sub*group%force(:, 1)
               group%begin = real((state%step + step)*self%substeps + sub, wp)
               call group%march_step(state, slip_begin, error)
               if (allocated(error)) return
            end do
            if (mod(state%step + step + 1, int(every, long)) /= 0 .or. size(displacement) == 0) cycle
            record = record + 1
            do l = 1, last - first + 1
               displacement(record, :, first + l - 1) = group%x(l, 1:state%n_dof, 0)
               if (present(velocity)) velocity(record, :, first + l - 1) = &
                  group%x(l, 1:state%n_dof, 1)/group%taylor%h
            end do
         end do
         do l = 1, last - first + 1
            call group%store(self%chain, l, state)
         end do
      end do
      where (state%direction /= 0)
         state%slip_time = state%slip_time + (total - slip_begin)*self%group%taylor%h
      end where
      state%step = state%step + n_steps
   end subroutine advance

end module dynamics_event
