!> The exact march: the force is piecewise linear, the motion between transitions is exact, and
!> every transition is located (docs/exact_march.md). The motion is found by power series in the
!> dofs or by modes, whichever needs less work.
module dynamics_exact_march
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_text, only: brief, rounded_text, to_text
   use dynamics_exact_block_march, only: exact_march
   use dynamics_exact_modal_form, only: modal_form, new_modal_form
   use dynamics_exact_modal_terms, only: lanes, longest_in_parts
   use dynamics_exact_series, only: fastest_rate, longest_part
   use dynamics_exact_series_form, only: new_series_form, series_form
   use dynamics_response, only: march_work
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: check_exact, exact_march, fewest_parts, least_tolerance, new_exact_march

   integer, parameter :: most_parts = 4096   !! parts of a step; more are refused
   real(wp), parameter :: least_tolerance = 1.0e-13_wp
   !> Fastest rate times a part up to which modes keep any tolerance: in 4096 parts (M7) is below
   !> 1e-13 for kappa <= 100 rho^2, and its blocks need not be found
   real(wp), parameter :: certain_part = 1.0e-3_wp
   !> Fastest rate times a step, at most: modes know the phase of a step to 1e-16 of it, and (M7)
   !> does not see errors below 1e-14 of kappa = rho^2, which are those of a part with rho > 1e7
   real(wp), parameter :: most_phase = 1.0e9_wp

contains

   !> Prepares the exact march for one structure. The tolerance is relative to the rms displacement
   !> of each dof; 1e-12 to 1e-3 are tested.
   subroutine new_exact_march(structure, dt, tolerance, marcher, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(in) :: tolerance
      type(exact_march), intent(out) :: marcher
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: transitions

      call check_exact(structure, dt, tolerance, error)
      if (allocated(error)) return
      marcher%structure = structure
      marcher%dt = dt
      marcher%tolerance = tolerance
      transitions = transitions_of_step(structure, dt)
      if (structure%has_lumped_mass()) call use_series(transitions, marcher)
      ! in modes, the path of each joint takes at least two products with all modes
      if (2.0_wp*structure%n_joints*structure%n_dof < marcher%work_series) &
         call try_modes(transitions, marcher, error)
   end subroutine new_exact_march

   !> Refuses a time step or a tolerance that cannot be marched, or only in too many parts.
   subroutine check_exact(structure, dt, tolerance, error)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt, tolerance
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: longest   ! longest step [s]

      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%dt = '//to_text(dt)//': must be positive')
      else if (.not. (tolerance >= least_tolerance .and. tolerance <= 1.0_wp)) then
         call raise(error, exit_bad_input, 'integration%tolerance = '//to_text(tolerance)// &
                    ': must be from '//brief(least_tolerance)//' to 1')
      else
         longest = dt
         if (structure%has_lumped_mass()) then
            longest = most_parts*longest_part/fastest_rate(structure)
         else if (fastest_rate(structure)*dt > most_parts*certain_part) then
            call longest_in_parts(structure, most_parts, &
                                  min(dt, most_phase/fastest_rate(structure)), tolerance, &
                                  longest, error)
            if (allocated(error)) return
         end if
         if (dt > longest) call raise(error, exit_bad_input, &
                                      'integration%dt = '//to_text(dt)//': must be at most '// &
                                      rounded_text(longest, 6, down=.true.)//' for a mode of '// &
                                      brief(maxval(structure%frequencies_stuck))//' Hz: a '// &
                                      'mass may be too light, a joint, spring or damper too stiff')
      end if
   end subroutine check_exact

   !> Chooses power series, in the number of parts that takes the least work: in shorter parts more
   !> joints are local (8).
   subroutine use_series(transitions, marcher)
      real(wp), intent(in) :: transitions   !! expected number for a sample in a step
      type(exact_march), intent(inout) :: marcher
      type(series_form), allocatable :: form
      type(march_work) :: work
      integer :: parts

      parts = fewest_parts(marcher%structure, marcher%dt)
      do while (parts <= most_parts)
         if (.not. allocated(form)) allocate (form)
         call new_series_form(marcher%structure, marcher%dt, parts, marcher%tolerance, form)
         work = form%work(parts)
         if (work%with_transitions(transitions) < marcher%work_series) then
            marcher%work = work
            marcher%work_series = work%with_transitions(transitions)
            marcher%parts = parts
            marcher%form = 'power series'
            if (allocated(marcher%base)) deallocate (marcher%base)
            call move_alloc(form, marcher%base)
         end if
         if (work%step >= marcher%work_series) exit
         parts = 2*parts
      end do
   end subroutine use_series

   !> Chooses modes if they need a fifth less work than power series. Power series are preferred
   !> because their rounding errors are relative to the motion of each dof; those of modes are
   !> relative to the largest motion.
   subroutine try_modes(transitions, marcher, error)
      real(wp), intent(in) :: transitions   !! expected number for a sample in a step
      type(exact_march), intent(inout) :: marcher
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: per_transition = 7000.0_wp, most_share = 0.8_wp   ! see (11)
      type(modal_form), allocatable :: form
      type(march_work) :: work

      allocate (form)
      call new_modal_form(marcher%structure, marcher%dt, marcher%tolerance, form, error)
      if (allocated(error)) return
      if (form%operators%n_parts > most_parts) return
      work%step = form%operators%n_parts*form%operators%work()
      work%lanes = lanes
      work%transition = per_transition
      marcher%work_modes = work%with_transitions(transitions)
      if (marcher%work_modes >= most_share*marcher%work_series) return
      marcher%work = work
      marcher%parts = form%operators%n_parts
      marcher%form = 'modes'
      if (allocated(marcher%base)) deallocate (marcher%base)
      call move_alloc(form, marcher%base)
   end subroutine try_modes

   !> Guessed number of transitions of a sample in a step: one of every joint in a period of the
   !> fastest mode with all joints stuck, but at most one in 20 steps, a period of the fastest
   !> force, or in half a period of the slowest mode, if that is shorter (11).
   pure real(wp) function transitions_of_step(structure, dt) result(transitions)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt   !! [s]

      associate (frequency => structure%frequencies_stuck)
         transitions = structure%n_joints*min(dt*maxval(frequency), &
                                              max(0.05_wp, 2.0_wp*dt*minval(frequency)))
      end associate
   end function transitions_of_step

   !> Smallest number of parts of a step for power series (4).
   pure integer function fewest_parts(structure, dt) result(parts)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: dt   !! [s]

      parts = max(1, ceiling(fastest_rate(structure)*dt/longest_part))
   end function fewest_parts

end module dynamics_exact_march
