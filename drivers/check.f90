!> `entroslip check`: checks a scene and prints what a run would compute and cost. Writes no file.
module driver_check
   use campaign_plan, only: plan_type
   use campaign_pooling, only: fewest_samples
   use campaign_samples_needed, only: find_need, slip_error, statistical_error
   use campaign_size, only: refuse_oversize, results_size
   use config_scene, only: scene_type
   use config_summary, only: summary_text
   use core_error, only: error_type, exit_done
   use core_kinds, only: long, wp
   use core_text, only: brief, duration, labelled, line_feed, size_text, to_text
   use driver_campaign, only: load_plan, refuse_unsolved
   use driver_command_line, only: command_line
   use driver_judge_results, only: need_words
   use driver_processes, only: solve_processes
   use driver_trial_runs, only: choose_setting, measure_settings, choose_spectrum_step
   use io_progress, only: inform, set_quiet
   use parallel_world, only: start_world, stop_world, world_type
   use process_fit, only: predict_process
   use process_model, only: process_model_type
   use process_scaling, only: first_of_fit
   use tradeoff_forecast, only: cost_type, end_seconds, measure_cost
   use tradeoff_front, only: predicted_slip_error
   use tradeoff_tasks, only: trial_scope, tradeoff_type
   implicit none(type, external)
   private
   public :: check

   !> Longest expected processor time of each measurement [s]: settings, folded spectra, time of a
   !> step, statistical error.
   real(wp), parameter :: most_seconds = 3.0_wp

contains

   !> Runs the command `check`. Collective.
   subroutine check(line)
      type(command_line), intent(in) :: line
      type(world_type) :: world
      type(scene_type) :: scene
      type(plan_type) :: plan
      type(process_model_type), allocatable :: models(:)
      type(cost_type) :: cost
      character(:), allocatable :: choice, march, need, text
      type(error_type), allocatable :: error, oversize

      call start_world(world)
      call set_quiet(line%has('--quiet') .or. .not. world%is_root())
      call load_plan(line, scene, plan, error)
      call world%stop_on(error)
      call choose_setting(world, scene, plan, choice, most_seconds)
      call choose_spectrum_step(world, plan, scene%force, most_seconds, error)
      if (plan%has_structure .and. world%is_root() .and. .not. allocated(error)) &
         call measure_cost(plan, scene%force, most_seconds, cost, error)
      call world%stop_on(error)
      call predict_samples_needed(world, plan, scene%force, cost, need)
      if (world%is_root()) then
         call predict_processes(plan, models)
         text = summary_text(scene, plan, cost%nanoseconds, world%n_ranks, cost%transitions, &
                             models, cost%audit_nanoseconds, &
                             end_seconds(plan, models, cost, world%n_ranks), &
                             cost%share_powerful)
         call refuse_oversize(plan, oversize)
         if (allocated(oversize)) text = text//'note: '//oversize%message//line_feed
         if (cost%n_steps > 0) then
            if (cost%form /= '') text = text//labelled('exact march', cost%form)
            march = ' in a step of a sample, in the first '//to_text(cost%n_steps)//' steps'
            if (cost%transitions > 0.0_wp) then
               march = brief(cost%transitions)//march
            else
               march = 'none'//march//': the march is linear'
            end if
            text = text//labelled('transitions', march)
         end if
         if (plan%has_structure .and. plan%output%spectrum .and. &
             plan%output%spectrum_every == 0) &
            text = text//labelled('not tried', 'output%spectrum_every is left to run, as '// &
                                  'its march takes long: here spectra are of every step')
         text = text//choice//need
         call inform(text(:len(text) - 1))
         call refuse_unsolved(plan, models, error)
      end if
      call world%stop_on(error)
      call stop_world(exit_done)
   end subroutine check

   !> Predicts which processes have a solution, and how realizations of the exact law are drawn, as
   !> far as that is known before the fits.
   subroutine predict_processes(plan, models)
      type(plan_type), intent(in) :: plan
      type(process_model_type), allocatable, intent(out) :: models(:)
      integer :: first(size(plan%processes)), i

      allocate (models(size(plan%processes)))
      first = first_of_fit(plan%processes)
      do i = 1, size(models)
         if (first(i) < i) then
            models(i) = models(first(i))
            models(i)%request = plan%processes(i)
         else
            call predict_process(plan%processes(i), plan%seed, models(i))
         end if
      end do
   end subroutine predict_processes

   !> Predicts the standard error and, if it exceeds accuracy%target_statistical, the samples and
   !> steps that meet the target, with enough samples for a regression. Fits the processes for it.
   !> Collective.
   subroutine predict_samples_needed(world, plan, force, cost, text)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: force(0:, :)   !! (0:n_steps, record) force file [N]; else size 0
      type(cost_type), intent(in) :: cost    !! known on the root
      !> Lines; '' without a target, or if a process has no solution
      character(:), allocatable, intent(out) :: text
      type(process_model_type), allocatable :: models(:)
      type(tradeoff_type) :: measured
      type(plan_type) :: larger
      type(slip_error) :: predicted
      type(error_type), allocatable :: error
      character(:), allocatable :: costs
      integer(long) :: n_samples, n_steps
      real(wp) :: seconds

      text = ''
      if (.not. (plan%has_structure .and. plan%accuracy%target_statistical > 0.0_wp)) return
      if (all(plan%cases%process == 0)) return
      call solve_processes(world, plan, models)
      if (.not. all(models%is_solved)) return
      call measure_settings(world, plan, force, trial_scope(most_seconds, most_seconds, &
                                                            has_settings=.false., &
                                                            is_statistical=.true., models=models), &
                            measured, error)
      call world%stop_on(error)
      if (.not. allocated(measured%tasks)) then
         text = labelled('statistics', 'target_statistical is left to run: trial marches take long')
         return
      end if
      associate (s => plan%integration, wanted => plan%accuracy%target_statistical, &
                 n_now => plan%cases%n_samples)
         predicted = predicted_slip_error(plan, measured)
         text = 'target_statistical = '//brief(wanted)//': a standard error of about '// &
                brief(statistical_error(predicted))//' points is expected'
         if (statistical_error(predicted) > wanted) then
            larger = plan
            larger%cases%n_samples = max(fewest_samples, n_now)
            predicted = predicted_slip_error(larger, measured)
            call find_need(predicted, wanted, s%n_steps - s%n_discard, n_samples, n_steps)
            seconds = 1.0e-9_wp*cost%nanoseconds*n_samples/maxval(n_now)*(n_steps + s%n_discard) &
                      *sum(real(n_now, wp))/world%n_ranks
            larger%cases%n_samples = int(min(n_samples, 2_long**30))
            costs = ', '//duration(seconds)
            if (plan%accuracy%sample_until_met) &
               costs = costs//', '//size_text(results_size(larger, cost%transitions, models))
            text = text//'; '//need_words(plan, predicted, costs)
         end if
      end associate
      text = labelled('statistics', text)
   end subroutine predict_samples_needed

end module driver_check
