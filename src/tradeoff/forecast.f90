!> Cost of a scene before anything is run: a sample-step's is measured, the regressions' counted.
!>
!> Samples of all cases are marched for a moment under a short record of their force, as the
!> campaign will march them: as many side by side, what is kept kept, spectra of as many steps. The
!> friction is a stand-in of the right mean and scatter, so no process need be fitted.
!>
!> Counts of the regressions are those that grow with the samples, the friction values, the
!> frequencies and the cases; what each costs was measured on the paper's chain (25 to 400 samples a
!> case), 20 and 50 masses and a ring of blades.
module tradeoff_forecast
   use campaign_plan, only: add_audits, case_type, kept_dofs, plan_type
   use campaign_pooling, only: case_pool, find_points, find_pools
   use campaign_results, only: block_result
   use campaign_runner, only: prepare_runner, runner_type
   use campaign_sample, only: never, run_block
   use campaign_size, only: n_frequencies
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_law, only: n_points
   use statistics_spectra, only: last_powerful
   use statistics_surrogate, only: most_landmarks
   use tradeoff_sample, only: choose_levels, draw_level, level_type
   use tradeoff_settings, only: expected_cost, own_setting, setting_type
   implicit none(type, external)
   private
   public :: cost_type, measure_cost, regression_seconds

   real(wp), parameter :: budget = 0.4_wp            !! expected cost of a measurement [s]
   real(wp), parameter :: some_transitions = 0.3_wp  !! in a step
   real(wp), parameter :: history_memory = 32.0e6_wp !! [byte] of a block
   integer, parameter :: fewest_steps = 1200

   real(wp), parameter :: of_fit = 3.0e6_wp       !! [ns] of a kernel's choice
   real(wp), parameter :: of_pair = 100.0_wp      !! [ns] of a sample and a landmark: features
   real(wp), parameter :: of_kernel = 1.15_wp     !! [ns] of a point, a landmark and an input
   real(wp), parameter :: further_inputs = 5.4_wp !! that the rest of a kernel is worth
   real(wp), parameter :: of_polynomials = 2.0_wp !! [ns] of a point and two inputs
   real(wp), parameter :: of_density = 140.0_wp   !! [ns] of a sample and a frequency
   real(wp), parameter :: of_product = 0.056_wp   !! [ns] of a point, a landmark and a frequency
   real(wp), parameter :: of_mean = 9.0_wp        !! [ns] of a point and a frequency
   real(wp), parameter :: of_percentile = 12.0_wp !! [ns] of a point and a frequency

   !> Measured cost, spectra and other kept results included: the mean over all samples.
   type :: cost_type
      real(wp) :: nanoseconds = 0.0_wp         !! of a processor for a sample-step
      real(wp) :: audit_nanoseconds = 0.0_wp   !! the same of an audit; 0: none
      real(wp) :: transitions = 0.0_wp         !! of a sample in a step, all masses
      real(wp) :: share_powerful = 0.0_wp      !! of the frequencies: those that have the power
      integer :: n_steps = 0                   !! that were marched; 0: nothing was measured
      character(:), allocatable :: form        !! of the exact march, in words
   end type cost_type

contains

   !> Marches a block of every level of force.
   subroutine measure_cost(plan, file_force, every, cost, error)
      type(plan_type), intent(in) :: plan          !! without audits
      real(wp), intent(in) :: file_force(0:, :)    !! (step, 1 or sample) [N]; else of size 0
      integer, intent(in) :: every                 !! every k-th step enters the spectra
      type(cost_type), intent(out) :: cost
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: short
      type(runner_type) :: runner, shortest
      type(level_type), allocatable :: levels(:)
      type(cost_type) :: of_level
      type(setting_type) :: own
      integer :: k

      call choose_levels(plan, levels)
      short = plan
      call add_audits(short)
      short%integration%n_steps = min(plan%integration%n_steps, fewest_steps)
      short%integration%n_discard = 0
      call prepare_runner(short, file_force, shortest, error)
      if (allocated(error)) return
      cost%form = shortest%form_of_march()
      own = own_setting(plan)
      own%work = shortest%marcher%work
      cost%n_steps = steps_for(plan, [(size(levels(k)%sample), k=1, size(levels))], own)
      short%integration%n_steps = cost%n_steps
      call prepare_runner(short, file_force(:min(cost%n_steps, ubound(file_force, 1)), :), runner, &
                          error, like=shortest)
      if (allocated(error)) return
      do k = 1, size(levels)
         call draw_level(short, runner, cost%n_steps, levels(k), error)
         if (allocated(error)) return
         call time_level(runner, levels(k), every, of_level, error)
         if (allocated(error)) return
         associate (share => real(levels(k)%n_all, wp)/sum(levels%n_all))
            cost%nanoseconds = cost%nanoseconds + share*of_level%nanoseconds
            cost%audit_nanoseconds = cost%audit_nanoseconds + share*of_level%audit_nanoseconds
            cost%transitions = cost%transitions + share*of_level%transitions
            cost%share_powerful = max(cost%share_powerful, of_level%share_powerful)
         end associate
      end do
   end subroutine measure_cost

   !> Steps that the budget allows.
   pure integer function steps_for(plan, n_samples, own)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_samples(:)     !! (level)
      type(setting_type), intent(in) :: own   !! the scene's, counted
      real(wp) :: most

      most = 1.0e9_wp*budget/sum(n_samples*expected_cost(own, plan%structure%n_dof, n_samples, &
                                                         some_transitions))
      if (plan%output%history) &
         most = min(most, history_memory/(16.0_wp*size(kept_dofs(plan))*sum(n_samples)))
      steps_for = min(plan%integration%n_steps, max(fewest_steps, int(min(most, 1.0e9_wp))))
   end function steps_for

   !> Times one level of force, by the scene's method and by that of audits, whose blocks are
   !> narrower.
   subroutine time_level(like, level, every, cost, error)
      type(runner_type), intent(in) :: like   !! of all levels
      type(level_type), intent(in) :: level
      integer, intent(in) :: every
      type(cost_type), intent(out) :: cost
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: short
      type(runner_type) :: runner
      type(cost_type) :: of_audit
      integer :: n_audited

      short = like%plan
      n_audited = min(size(level%sample), maxval(short%cases%n_samples, &
                                                 mask=short%cases%audits > 0))
      associate (n_steps => short%integration%n_steps)
         short%output%segment_length = min(short%output%segment_length, every*(n_steps/every))
      end associate
      short%output%spectrum_every = every
      short%excitation%kind = 'file'
      short%excitation%per_sample = size(level%force, 2) > short%structure%n_forces
      associate (n => size(level%sample))
         short%cases = [case_type(0, 0.0_wp, n)]
         if (n_audited > 0) short%cases = [short%cases, case_type(0, 0.0_wp, n_audited, audits=1)]
      end associate
      call prepare_runner(short, level%force, runner, error, like)
      if (.not. allocated(error)) call time_block(runner, 1, level%friction, cost, error)
      if (.not. allocated(error) .and. n_audited > 0) &
         call time_block(runner, 2, level%friction(:, :n_audited), of_audit, error)
      cost%audit_nanoseconds = of_audit%nanoseconds
   end subroutine time_level

   !> Times a block of one case of a short plan: the lesser time of two, as the first prepares
   !> transforms.
   subroutine time_block(runner, case_number, friction, cost, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: case_number
      real(wp), intent(in) :: friction(:, :)   !! (dof, sample)
      type(cost_type), intent(out) :: cost
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: result
      real(wp) :: after, before, sample_steps
      integer :: dof, trial
      logical :: is_abandoned

      cost%nanoseconds = huge(1.0_wp)
      sample_steps = real(runner%plan%integration%n_steps, wp)*size(friction, 2)
      do trial = 1, 2
         call cpu_time(before)
         call run_block(runner, case_number, friction, 1, never, result, is_abandoned, error)
         call cpu_time(after)
         if (allocated(error)) return
         cost%nanoseconds = min(cost%nanoseconds, 1.0e9_wp*(after - before)/sample_steps)
      end do
      cost%transitions = sum(result%slip_starts + result%stick_starts)/sample_steps
      if (.not. allocated(result%psd)) return
      cost%share_powerful = maxval([(last_powerful(sum(result%psd(dof, :, :), 2)), &
                                     dof=1, size(result%psd, 1))])/real(size(result%psd, 2), wp)
   end subroutine time_block

   !> Time [s of a processor] of all pools' regressions.
   pure real(wp) function regression_seconds(plan, every, share_powerful)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: every                !! every k-th step enters the spectra
      real(wp), intent(in) :: share_powerful      !! of the frequencies: those that are fitted
      type(case_pool), allocatable :: pools(:)
      integer, allocatable :: joints(:), points(:)
      real(wp) :: at_points, n, n_dofs, n_f, n_landmarks, nanoseconds
      integer :: p

      pools = find_pools(plan)
      call find_points(plan%structure, points, joints)
      n_dofs = 0.0_wp
      if (plan%output%spectrum) n_dofs = size(kept_dofs(plan))
      n_f = n_frequencies(plan, every)
      nanoseconds = 0.0_wp
      do p = 1, size(pools)
         n = sum(pools(p)%n_fitted)
         n_landmarks = min(n, real(most_landmarks, wp))
         at_points = real(n_points, wp)*size(pools(p)%cases)
         nanoseconds = nanoseconds + (plan%structure%n_joints + n_dofs) &
                       *(of_fit + of_pair*n*n_landmarks &
                         + at_points*(of_kernel*n_landmarks*(size(points) + further_inputs) &
                                      + of_polynomials*size(points)**2)) &
                       + n_dofs*n_f*share_powerful*(of_density*n + at_points &
                                     *(of_mean + of_percentile*size(plan%output%percentiles) &
                                       + of_product*n_landmarks))
      end do
      regression_seconds = 1.0e-9_wp*nanoseconds
   end function regression_seconds

end module tradeoff_forecast
