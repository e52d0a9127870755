!> Forecasts what a statistical target will take, from a short march of the scene's own samples.
module driver_statistical_forecast
   use campaign_plan, only: plan_type
   use campaign_results, only: case_statistics
   use campaign_samples_needed, only: find_need, statistical_error
   use core_error, only: error_type, exit_stopped
   use core_kinds, only: long, wp
   use core_phrases, only: brief, duration, labelled
   use core_text, only: to_text
   use driver_processes, only: solve_processes
   use driver_trial_runs, only: measure_settings
   use parallel_world, only: stop_world, world_type
   use process_model, only: process_model_type
   use tradeoff_front, only: error_parts, parts_of, setting_row
   use tradeoff_tasks, only: scope_type, tradeoff_type
   implicit none(type, external)
   private
   public :: foresee_need

   real(wp), parameter :: budget = 4.0_wp   !! expected processor time of the march [s]

contains

   !> Samples and steps that accuracy%target_statistical needs, in words that end without a line
   !> feed; '' without target, or where a process has no solution. The processes are fitted for it.
   !> Collective.
   subroutine foresee_need(world, plan, force, nanoseconds, text)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      real(wp), intent(in) :: nanoseconds    !! cost of a sample-step; on the root
      character(:), allocatable, intent(out) :: text
      type(process_model_type), allocatable :: models(:)
      type(tradeoff_type) :: measured
      type(error_parts) :: parts
      type(error_type), allocatable :: error
      real(wp), allocatable :: values(:, :)
      logical :: is_stopped

      text = ''
      if (.not. (plan%has_structure .and. plan%accuracy%target_statistical > 0.0_wp)) return
      if (all(plan%cases%process == 0)) return
      call solve_processes(world, plan, .true., models)
      if (.not. all(models%is_solved)) return
      call measure_settings(world, plan, force, scope_type(budget=budget, has_settings=.false., &
                                                           is_statistical=.true., models=models), &
                            .true., measured, values, is_stopped, error)
      call world%stop_on(error)
      if (is_stopped) call stop_world(exit_stopped)
      parts = parts_of(measured, values, setting_row(), &
                       plan%integration%n_steps - plan%integration%n_discard)
      text = need_text(plan, parts, nanoseconds, world%n_ranks)
   end subroutine foresee_need

   !> The standard error to come, and what the target takes where that is more than the scene has.
   pure function need_text(plan, parts, nanoseconds, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(error_parts), intent(in) :: parts
      real(wp), intent(in) :: nanoseconds
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      type(case_statistics) :: statistics
      integer(long) :: n_samples, n_steps
      real(wp) :: error, more, seconds

      statistics%n_samples = maxval(plan%cases%n_samples)
      statistics%slip%mean_error = [0.01_wp*parts%samples%slip]
      statistics%slip_mean_time_error = [0.01_wp*parts%time%slip]
      if (plan%excitation%per_sample) then   ! samples lower both
         statistics%slip%mean_error = 0.01_wp*hypot(parts%samples%slip, parts%time%slip)
         statistics%slip_mean_time_error = 0.0_wp
      end if
      associate (how => plan%integration, wanted => plan%accuracy%target_statistical)
         error = statistical_error(statistics)
         call find_need(statistics, wanted, how%n_steps - how%n_discard, n_samples, n_steps)
         more = real(n_samples, wp)/statistics%n_samples*(n_steps + how%n_discard)/how%n_steps
         text = 'target_statistical = '//brief(wanted)//': a standard error of about '// &
                brief(error)//' points is foreseen'
         seconds = 1.0e-9_wp*nanoseconds*more*how%n_steps &
                   *sum(real(plan%cases%n_samples, wp))/n_ranks
         if (error > wanted) &
            text = text//'; about '//to_text(n_samples)//' samples and '// &
                   to_text(n_steps + how%n_discard)//' steps would do, '//duration(seconds)
      end associate
      text = labelled('statistics', text)
      text = text(:len(text) - 1)
   end function need_text

end module driver_statistical_forecast
