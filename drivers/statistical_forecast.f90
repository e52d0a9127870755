!> Forecasts what a statistical target will take, from a short march of the scene's own samples.
module driver_statistical_forecast
   use campaign_plan, only: plan_type
   use campaign_samples_needed, only: find_need, slip_error, statistical_error
   use core_error, only: error_type, exit_stopped
   use core_kinds, only: long, wp
   use core_phrases, only: brief, duration, labelled
   use driver_judge_results, only: need_words
   use driver_processes, only: solve_processes
   use driver_trial_runs, only: measure_settings
   use parallel_world, only: stop_world, world_type
   use process_model, only: process_model_type
   use tradeoff_front, only: slip_error_to_come
   use tradeoff_tasks, only: scope_type, tradeoff_type
   implicit none(type, external)
   private
   public :: foresee_need

   real(wp), parameter :: budget = 4.0_wp   !! expected processor time of the march [s]

contains

   !> Says how many samples and steps accuracy%target_statistical needs, without a final line feed;
   !> '' without a target, or where a process has no solution. Fits the processes for it.
   !> Collective.
   subroutine foresee_need(world, plan, force, nanoseconds, text)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (step, 1 or sample) [N] of a file; else of size 0
      real(wp), intent(in) :: nanoseconds    !! cost of a sample-step; on the root
      character(:), allocatable, intent(out) :: text
      type(process_model_type), allocatable :: models(:)
      type(tradeoff_type) :: measured
      type(error_type), allocatable :: error
      logical :: is_stopped

      text = ''
      if (.not. (plan%has_structure .and. plan%accuracy%target_statistical > 0.0_wp)) return
      if (all(plan%cases%process == 0)) return
      call solve_processes(world, plan, .true., models)
      if (.not. all(models%is_solved)) return
      call measure_settings(world, plan, force, scope_type(budget=budget, has_settings=.false., &
                                                           is_statistical=.true., models=models), &
                            .true., measured, is_stopped, error)
      call world%stop_on(error)
      if (is_stopped) call stop_world(exit_stopped)
      text = need_text(plan, slip_error_to_come(plan, measured), nanoseconds, world%n_ranks)
   end subroutine foresee_need

   !> The standard error to come, and what the target takes where that is more than the scene has.
   pure function need_text(plan, error, nanoseconds, n_ranks) result(text)
      type(plan_type), intent(in) :: plan
      type(slip_error), intent(in) :: error
      real(wp), intent(in) :: nanoseconds
      integer, intent(in) :: n_ranks
      character(:), allocatable :: text
      integer(long) :: n_samples, n_steps
      real(wp) :: more, seconds

      associate (how => plan%integration, wanted => plan%accuracy%target_statistical)
         text = 'target_statistical = '//brief(wanted)//': a standard error of about '// &
                brief(statistical_error(error))//' points is foreseen'
         if (statistical_error(error) > wanted) then
            call find_need(error, wanted, how%n_steps - how%n_discard, n_samples, n_steps)
            more = real(n_samples, wp)/error%n_samples*(n_steps + how%n_discard)/how%n_steps
            seconds = 1.0e-9_wp*nanoseconds*more*how%n_steps &
                      *sum(real(plan%cases%n_samples, wp))/n_ranks
            text = text//'; '//need_words(plan, error, ', '//duration(seconds))
         end if
      end associate
      text = labelled('statistics', text)
      text = text(:len(text) - 1)
   end function need_text

end module driver_statistical_forecast
