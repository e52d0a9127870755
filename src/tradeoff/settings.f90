!> The settings that trade speed for accuracy in a march, those that are worth comparing, and what
!> each is expected to cost.
module tradeoff_settings
   use campaign_plan, only: integration_settings, plan_type
   use campaign_runner, only: new_marcher
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_newmark_march, only: longest_step
   use dynamics_response, only: march_work, marcher_type
   implicit none(type, external)
   private
   public :: setting_type, all_settings, settings_at_dt, own_setting, same_setting, with_setting
   public :: count_work, expected_cost, reference_setting, setting_dt, use_setting

   !> A method, its step in terms of the scene's, and how closely it follows a transition.
   type :: setting_type
      character(16) :: method = 'event'     !! or 'newmark'
      integer :: parts = 1                  !! equal steps that an interval of the force is cut into
      integer :: stride = 1                 !! intervals of the force that a step takes together
      integer :: max_halvings = 0           !! newmark
      real(wp) :: tolerance = 0.0_wp        !! event
      type(march_work) :: work              !! of a step of its own; see count_work
   end type setting_type

   !> Setting a hundred times tighter than the best that is compared
   type(setting_type), parameter :: reference_setting = setting_type('event', tolerance=1.0e-12_wp)

contains

   !> The scene's own.
   pure function own_setting(plan) result(setting)
      type(plan_type), intent(in) :: plan
      type(setting_type) :: setting

      setting%method = plan%integration%method
      if (setting%method == 'newmark') then
         setting%max_halvings = plan%integration%max_halvings
      else
         setting%tolerance = plan%integration%tolerance
      end if
   end function own_setting

   !> Settings for the scene's own steps, its own setting last if it is not among them.
   pure function settings_at_dt(plan) result(settings)
      type(plan_type), intent(in) :: plan
      type(setting_type), allocatable :: settings(:)
      integer, parameter :: halvings(*) = [0, 1, 2, 3, 4, 6, 8, 10, 12, 15, 20]
      integer :: i

      settings = [(setting_type('event', tolerance=10.0_wp**(-i)), i=3, 10)]
      if (is_stable(plan, 1.0_wp)) &
         settings = [settings, (setting_type('newmark', max_halvings=halvings(i)), &
                                i=1, size(halvings))]
      if (.not. any(same_setting(settings, own_setting(plan)))) &
         settings = [settings, own_setting(plan)]
   end function settings_at_dt

   !> Settings at the scene's dt, and Newmark's scheme with steps of 1/2 to 1/16 of the scene's
   !> under the same force; where `can_skip`, also both methods with every second value of the
   !> force.
   pure function all_settings(plan, can_skip) result(settings)
      type(plan_type), intent(in) :: plan
      logical, intent(in) :: can_skip
      type(setting_type), allocatable :: settings(:)
      integer, parameter :: halvings(*) = [0, 2, 4, 8], parts(*) = [2, 4, 8, 16]
      integer :: i, k

      settings = settings_at_dt(plan)
      if (can_skip) settings = [settings, setting_type('event', stride=2, tolerance=1.0e-3_wp), &
                                setting_type('event', stride=2, tolerance=1.0e-6_wp)]
      do k = 1, size(halvings)
         if (can_skip .and. is_stable(plan, 2.0_wp)) &
            settings = [settings, setting_type('newmark', stride=2, max_halvings=halvings(k))]
         do i = 1, size(parts)
            if (is_stable(plan, 1.0_wp/parts(i))) &
               settings = [settings, setting_type('newmark', parts(i), max_halvings=halvings(k))]
         end do
      end do
   end function all_settings

   !> True if Newmark's scheme can take steps of so many dt (its linear stability bound).
   pure function is_stable(plan, steps) result(is_so)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: steps
      logical :: is_so

      associate (how => plan%integration)
         is_so = steps*how%dt <= longest_step(plan%structure, how%beta, how%gamma)
      end associate
   end function is_stable

   !> True if two settings march alike.
   elemental function same_setting(a, b) result(is_same)
      type(setting_type), intent(in) :: a, b
      logical :: is_same

      is_same = a%method == b%method .and. a%parts == b%parts .and. a%stride == b%stride &
                .and. a%max_halvings == b%max_halvings &
                .and. abs(a%tolerance - b%tolerance) <= 1.0e-6_wp*b%tolerance
   end function same_setting

   !> The step of a setting [s].
   elemental function setting_dt(setting, dt) result(step)
      type(setting_type), intent(in) :: setting
      real(wp), intent(in) :: dt   !! the scene's
      real(wp) :: step

      step = dt*setting%stride/setting%parts
   end function setting_dt

   !> The plan marched with a setting: the same time, the same records in its spectra. n_steps,
   !> n_discard, segment_length and spectrum_every must be multiples of the stride.
   pure function with_setting(plan, setting) result(changed)
      type(plan_type), intent(in) :: plan
      type(setting_type), intent(in) :: setting
      type(plan_type) :: changed

      changed = plan
      associate (how => changed%integration, output => changed%output)
         call use_setting(setting, how)
         how%dt = setting_dt(setting, plan%integration%dt)
         how%n_steps = how%n_steps*setting%parts/setting%stride
         how%n_discard = how%n_discard*setting%parts/setting%stride
         output%segment_length = output%segment_length*setting%parts/setting%stride
         output%spectrum_every = output%spectrum_every*setting%parts/setting%stride
      end associate
   end function with_setting

   !> Sets the method and what it has of its own; not the step.
   pure subroutine use_setting(setting, how)
      type(setting_type), intent(in) :: setting
      type(integration_settings), intent(inout) :: how

      how%method = setting%method
      if (how%method == 'newmark') then
         how%max_halvings = setting%max_halvings
      else
         how%tolerance = setting%tolerance
      end if
   end subroutine use_setting

   !> Counts the work of a setting's march.
   subroutine count_work(plan, setting, error)
      type(plan_type), intent(in) :: plan
      type(setting_type), intent(inout) :: setting
      type(error_type), allocatable, intent(out) :: error
      class(marcher_type), allocatable :: marcher
      type(plan_type) :: changed

      changed = with_setting(plan, setting)
      call new_marcher(changed, changed%integration, marcher, error)
      if (.not. allocated(error)) setting%work = marcher%work
   end subroutine count_work

   !> Expected cost of a sample-step of the scene, from counted work [ns of a processor of 2023]. It
   !> ranks settings, the same on every machine and in every run; it is no forecast.
   elemental real(wp) function expected_cost(setting, n_dof, n_samples, transitions) &
      result(nanoseconds)
      type(setting_type), intent(in) :: setting   !! counted
      integer, intent(in) :: n_dof, n_samples     !! of a block
      real(wp), intent(in) :: transitions         !! of a sample in a step of the scene
      real(wp), parameter :: of_multiplication = 0.05_wp, of_record = 5.0_wp   ! of a dof, spectra
      real(wp) :: steps   ! in one of the scene

      steps = real(setting%parts, wp)/setting%stride
      nanoseconds = of_record*n_dof &
                    + of_multiplication*steps &
                    *setting%work%with_transitions(transitions/steps, n_samples)
   end function expected_cost

end module tradeoff_settings
