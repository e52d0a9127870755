!> What a sample-step of a scene costs, measured before anything is run.
!>
!> Samples of all cases are marched for a moment under the first part of their force, as the
!> campaign will march them: as many side by side, what is kept kept, spectra of as many steps. The
!> friction is a stand-in of the right mean and scatter, so no process need be fitted.
module ensemble_forecast
   use core_error, only: error_type
   use core_kinds, only: wp
   use ensemble_audit, only: add_audits
   use ensemble_plan, only: case_type, kept_dofs, plan_type
   use ensemble_results, only: block_result
   use ensemble_runner, only: prepare_runner, runner_type
   use ensemble_sample, only: run_block
   use ensemble_tradeoff_sample, only: choose_levels, draw_level, level_type
   use ensemble_tradeoff_settings, only: expected_cost, own_setting
   implicit none(type, external)
   private
   public :: measure_cost

   real(wp), parameter :: budget = 0.4_wp            !! expected cost of a measurement [s]
   real(wp), parameter :: some_transitions = 0.3_wp  !! in a step
   real(wp), parameter :: history_memory = 32.0e6_wp !! [byte] of a block
   integer, parameter :: fewest_steps = 1200

contains

   !> Cost of a sample-step on one rank, spectra and what else is kept included, the mean over all
   !> samples: of the campaign and of audits.
   subroutine measure_cost(plan, file_force, every, nanoseconds, audit_nanoseconds, error)
      type(plan_type), intent(in) :: plan          !! without audits
      real(wp), intent(in) :: file_force(0:, :)    !! (step, 1 or sample) [N]; else of size 0
      integer, intent(in) :: every                 !! every k-th step enters the spectra
      real(wp), intent(out) :: nanoseconds, audit_nanoseconds
      type(error_type), allocatable, intent(out) :: error
      type(runner_type) :: runner
      type(level_type), allocatable :: levels(:)
      real(wp) :: cost, audit_cost
      integer :: k, n_steps

      nanoseconds = 0.0_wp
      audit_nanoseconds = 0.0_wp
      call prepare_runner(plan, file_force, runner, error)
      if (allocated(error)) return
      call choose_levels(plan, levels)
      n_steps = steps_for(plan, sum([(size(levels(k)%sample), k=1, size(levels))]))
      do k = 1, size(levels)
         call draw_level(plan, runner, n_steps, levels(k), error)
         if (allocated(error)) return
         call time_level(plan, levels(k), n_steps, every, cost, audit_cost, error)
         if (allocated(error)) return
         associate (share => real(levels(k)%n_all, wp)/sum(levels%n_all))
            nanoseconds = nanoseconds + share*cost
            audit_nanoseconds = audit_nanoseconds + share*audit_cost
         end associate
      end do
   end subroutine measure_cost

   !> Steps that the budget allows.
   pure integer function steps_for(plan, n_samples)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: n_samples
      real(wp) :: most

      most = 1.0e9_wp*budget/(n_samples*expected_cost(own_setting(plan), plan, some_transitions))
      if (plan%output%history) &
         most = min(most, history_memory/(16.0_wp*size(kept_dofs(plan))*n_samples))
      steps_for = min(plan%integration%n_steps, max(fewest_steps, int(min(most, 1.0e9_wp))))
   end function steps_for

   !> One level of force, by the scene's method and by that of its audits, whose blocks are narrower.
   subroutine time_level(plan, level, n_steps, every, cost, audit_cost, error)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      integer, intent(in) :: n_steps, every
      real(wp), intent(out) :: cost, audit_cost   !! [ns]
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: audited, short
      type(runner_type) :: runner
      integer :: n_audited

      audit_cost = 0.0_wp
      audited = plan
      call add_audits(audited)
      n_audited = min(size(level%sample), maxval(audited%cases%n_samples, &
                                                 mask=audited%cases%audits > 0))
      short = plan
      short%integration%n_steps = n_steps
      short%integration%n_discard = 0
      short%output%segment_length = min(short%output%segment_length, every*(n_steps/every))
      short%output%spectrum_every = every
      short%excitation%kind = 'file'
      short%excitation%per_sample = size(level%force, 2) > 1
      associate (n => size(level%sample))
         short%cases = [case_type(0, 0.0_wp, n)]
         if (n_audited > 0) short%cases = [short%cases, case_type(0, 0.0_wp, n_audited, audits=1)]
      end associate
      call prepare_runner(short, level%force, runner, error)
      if (.not. allocated(error)) call time_block(runner, 1, level%friction, cost, error)
      if (.not. allocated(error) .and. n_audited > 0) &
         call time_block(runner, 2, level%friction(:, :n_audited), audit_cost, error)
   end subroutine time_level

   !> A block of one case of a short plan.
   subroutine time_block(runner, case_number, friction, cost, error)
      type(runner_type), intent(inout) :: runner
      integer, intent(in) :: case_number
      real(wp), intent(in) :: friction(:, :)   !! (dof, sample)
      real(wp), intent(out) :: cost            !! [ns of a processor] of a sample-step
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: result
      real(wp) :: after, before
      logical :: is_abandoned

      call cpu_time(before)
      call run_block(runner, case_number, friction, 1, never, result, is_abandoned, error)
      call cpu_time(after)
      cost = 1.0e9_wp*(after - before)/(real(runner%plan%integration%n_steps, wp)*size(friction, 2))
   end subroutine time_block

   !> A measurement is short.
   logical function never()
      never = .false.
   end function never

end module ensemble_forecast
