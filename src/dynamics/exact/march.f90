!> The exact march: piecewise-linear force, power series between transitions, each of them located
!> (docs/exact_march.md).
module dynamics_exact_march
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use dynamics_exact_base_system, only: base_system
   use dynamics_exact_block_march, only: march_block
   use dynamics_exact_series, only: fastest_rate, longest_part
   use dynamics_exact_series_form, only: new_series_form, series_form
   use dynamics_response, only: block_state, marcher_type
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: exact_march, new_exact_march, parts_of_step, most_parts

   integer, parameter :: most_parts = 4096   !! of a step; more are refused

   !> Marches a structure by its base system.
   type, extends(marcher_type) :: exact_march
      real(wp) :: tolerance = 0.0_wp     !! displacement error relative to its rms
      integer :: parts = 1               !! of a step
      class(base_system), allocatable :: base
   contains
      procedure :: advance
   end type exact_march

contains

   !> The exact march for one structure: tolerance 1e-12 .. 1e-3 of each dof's rms displacement.
   subroutine new_exact_march(structure, dt, tolerance, marcher, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(exact_march), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      type(series_form), allocatable :: form

      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'dt = '//to_text(dt)//': must be positive')
      else if (.not. (tolerance > 0.0_wp .and. tolerance < 1.0_wp)) then
         call raise(error, exit_bad_input, 'tolerance = '//to_text(tolerance)// &
                    ': must be between 0 and 1')
      else if (parts_of_step(structure, dt) > most_parts) then
         call raise(error, exit_bad_input, 'dt = '//to_text(dt)//': a mass is too light, or '// &
                    'its spring too stiff: dt must be at most '// &
                    to_text(most_parts*dt/parts_of_step(structure, dt)))
      end if
      if (allocated(error)) return

      marcher%structure = structure
      marcher%dt = dt
      marcher%tolerance = tolerance
      marcher%parts = max(1, ceiling(parts_of_step(structure, dt)))
      allocate (form)
      call new_series_form(structure, dt, marcher%parts, tolerance, form)
      call move_alloc(form, marcher%base)
   end subroutine new_exact_march

   !> How many parts of a step the fastest mode needs, at least (4).
   pure function parts_of_step(structure, dt) result(parts)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt   !! [s]
      real(wp) :: parts

      parts = fastest_rate(structure)*dt/longest_part
   end function parts_of_step

   !> See marcher_type.
   subroutine advance(self, state, force, every, displacement, velocity, error)
      class(exact_march), intent(inout) :: self
      type(block_state), intent(inout) :: state
      real(wp), intent(in) :: force(0:, :)
      integer, intent(in) :: every
      real(wp), intent(out) :: displacement(:, :, :)
      real(wp), intent(out), optional :: velocity(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: no_velocity(0, 0, 0)

      if (present(velocity)) then
         call march_block(self%base, self%structure, self%parts, state, force, every, &
                          displacement, velocity, error)
      else
         call march_block(self%base, self%structure, self%parts, state, force, every, &
                          displacement, no_velocity, error)
      end if
      if (allocated(error)) return
      state%step = state%step + ubound(force, 1)
   end subroutine advance

end module dynamics_exact_march
