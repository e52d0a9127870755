!> Settings of a march that trade speed for accuracy: those that are compared, and the expected cost
!> of each.
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

   !> Method, step and accuracy of a march. Its step is stride/parts times the scene's.
   type :: setting_type
      character(16) :: method = 'event'     !! or 'newmark'
      integer :: parts = 1                  !! steps of the setting in a step of the scene
      integer :: stride = 1                 !! steps of the scene in a step of the setting
      integer :: max_halvings = 0           !! newmark
      real(wp) :: tolerance = 0.0_wp        !! event
      type(march_work) :: work              !! work of a step of the setting, set by count_work
   end type setting_type

   !> Reference: its tolerance is a hundred times smaller than the smallest compared.
   type(setting_type), parameter :: reference_setting = setting_type('event', tolerance=1.0e-12_wp)

contains

   !> Setting of the scene.
   pure type(setting_type) function own_setting(plan) result(setting)
      type(plan_type), intent(in) :: plan

      setting%method = plan%integration%method
      if (setting%method == 'newmark') then
         setting%max_halvings = plan%integration%max_halvings
      else
         setting%tolerance = plan%integration%tolerance
      end if
   end function own_setting

   !> Settings with the scene's step that are compared; the scene's own setting is last if it is not
   !> among them.
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

   !> Settings of settings_at_dt; Newmark's scheme with 1/2 to 1/16 of the scene's step and the same
   !> force; with `can_skip` also both methods with every second value of the force.
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

   !> True if a step of `factor` dt is within the linear stability bound of Newmark's scheme.
   pure logical function is_stable(plan, factor)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: factor

      associate (integration => plan%integration)
         is_stable = factor*integration%dt &
                     <= longest_step(plan%structure, integration%beta, integration%gamma)
      end associate
   end function is_stable

   !> True if two settings give the same march.
   elemental logical function same_setting(a, b)
      type(setting_type), intent(in) :: a, b

      same_setting = a%method == b%method .and. a%parts == b%parts .and. a%stride == b%stride &
                     .and. a%max_halvings == b%max_halvings &
                     .and. abs(a%tolerance - b%tolerance) <= 1.0e-6_wp*b%tolerance
   end function same_setting

   !> Step of a setting [s].
   elemental real(wp) function setting_dt(setting, dt)
      type(setting_type), intent(in) :: setting
      real(wp), intent(in) :: dt   !! step of the scene [s]

      setting_dt = dt*setting%stride/setting%parts
   end function setting_dt

   !> Plan with a setting: the march takes the same time, and the same instants enter its spectra.
   !> n_steps, n_discard, segment_length and spectrum_every must be multiples of the stride.
   pure type(plan_type) function with_setting(plan, setting) result(changed)
      type(plan_type), intent(in) :: plan
      type(setting_type), intent(in) :: setting

      changed = plan
      associate (integration => changed%integration, output => changed%output, &
                 parts => setting%parts, stride => setting%stride)
         call use_setting(setting, integration)
         integration%dt = setting_dt(setting, plan%integration%dt)
         integration%n_steps = integration%n_steps*parts/stride
         integration%n_discard = integration%n_discard*parts/stride
         output%segment_length = output%segment_length*parts/stride
         output%spectrum_every = output%spectrum_every*parts/stride
      end associate
   end function with_setting

   !> Sets the method and its max_halvings or tolerance; leaves the step.
   pure subroutine use_setting(setting, integration)
      type(setting_type), intent(in) :: setting
      type(integration_settings), intent(inout) :: integration

      integration%method = setting%method
      if (setting%method == 'newmark') then
         integration%max_halvings = setting%max_halvings
      else
         integration%tolerance = setting%tolerance
      end if
   end subroutine use_setting

   !> Counts the work of a step of the setting.
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

   !> Expected cost of a sample-step of the scene from counted work [ns of a processor of 2023]. It
   !> ranks settings in the same way on every machine and in every run; it is not a forecast.
   elemental real(wp) function expected_cost(setting, n_dof, n_samples, transitions) &
      result(nanoseconds)
      type(setting_type), intent(in) :: setting   !! setting with counted work
      integer, intent(in) :: n_dof, n_samples     !! dofs, and samples of a block
      real(wp), intent(in) :: transitions         !! transitions of a sample in a step of the scene
      real(wp), parameter :: multiplication_time = 0.05_wp
      real(wp), parameter :: record_time = 5.0_wp   ! time of a displacement in the spectra
      real(wp) :: steps   ! steps of the setting in a step of the scene

      steps = real(setting%parts, wp)/setting%stride
      nanoseconds = record_time*n_dof &
                    + multiplication_time*steps &
                    *setting%work%with_transitions(transitions/steps, n_samples)
   end function expected_cost

end module tradeoff_settings
