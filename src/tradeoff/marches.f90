!> Runs a task of a tradeoff: draws its samples, marches them, and reduces them to a few numbers.
module tradeoff_marches
   use campaign_comparison, only: ratio_replicates
   use campaign_plan, only: plan_type
   use campaign_results, only: block_result, case_statistics
   use campaign_sample, only: stop_query
   use core_error, only: error_type
   use core_kinds, only: wp
   use process_model, only: process_model_type
   use tradeoff_estimators, only: find_gains
   use tradeoff_sample, only: draw_level, level_type, march_level
   use tradeoff_settings, only: setting_type
   use tradeoff_task_results, only: find_plain_statistics, find_published_values, &
                                    find_setting_errors, plain_errors
   use tradeoff_tasks, only: batch_task, case_of, choose_march, samples_task, setting_task, &
                             spectrum_task, task_type, tradeoff_type, variant_task
   use tradeoff_variants, only: use_common_memory
   implicit none(type, external)
   private
   public :: run_task

contains

   !> Runs a task and stores its result in the tradeoff.
   subroutine run_task(tradeoff, number, should_stop, error)
      type(tradeoff_type), intent(inout) :: tradeoff
      integer, intent(in) :: number
      procedure(stop_query) :: should_stop
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: plan
      type(level_type) :: level
      type(setting_type) :: setting
      type(block_result) :: result
      type(case_statistics) :: statistics   ! plain sampling's
      integer :: n_samples

      associate (task => tradeoff%tasks(number), found => tradeoff%results(number))
         call choose_march(tradeoff, task, plan, setting, n_samples)
         call draw_samples(tradeoff, task, n_samples, plan%integration%n_steps, level)
         call march_level(plan, level, setting, should_stop, result, found%cost, error)
         if (allocated(error) .or. result%n_samples == 0) return
         found%n_samples = result%n_samples
         select case (task%kind)
         case (setting_task)
            call find_setting_errors(plan, level, result, tradeoff%references(task%level), &
                                     found%errors)
         case (spectrum_task, batch_task)
            call find_published_values(plan, result, found%value)
         case (samples_task)
            call find_plain_statistics(plan, result, statistics)
            found%plain_error = plain_errors(plan, result, statistics)
            allocate (found%gain, mold=found%plain_error)
            found%gain = 1.0_wp   ! gain of plain sampling
            associate (case_number => tradeoff%cases(task%row), scope => tradeoff%scope)
               if (tradeoff%n_cases(case_number) > 0) &
                  call find_gains(plan, scope%models(plan%cases(case_number)%process), &
                                  level%friction, result, statistics, scope%has_settings, &
                                  found%gain, error)
            end associate
         case (variant_task)
            found%slip_fraction = result%slip_fraction
            if (plan%output%spectrum) &
               found%ratio_without = ratio_replicates(result%psd, plan%output%percentiles)
         end select
      end associate
   end subroutine run_task

   !> Draws the friction and force of a task's samples: those of its level, or samples 1 to n of a
   !> case. A variant uses the random numbers of the scene's own process.
   subroutine draw_samples(tradeoff, task, n, n_steps, level)
      type(tradeoff_type), intent(in) :: tradeoff
      type(task_type), intent(in) :: task
      integer, intent(in) :: n, n_steps
      type(level_type), intent(out) :: level
      type(process_model_type), allocatable :: alike(:), models(:)
      integer :: case_number, i

      associate (scope => tradeoff%scope)
         select case (task%kind)
         case (samples_task)
            case_number = tradeoff%cases(task%row)
            models = scope%models
         case (variant_task)
            case_number = case_of(tradeoff, task)
            alike = scope%variant_models
            call use_common_memory(alike)
            models = scope%models
            models(scope%variants(task%row)%process) = alike(task%row)
         case default
            level = tradeoff%levels(task%level)
            return
         end select
      end associate
      level%case_number = spread(case_number, 1, n)
      level%sample = [(i, i=1, n)]
      call draw_level(tradeoff%runner%plan, tradeoff%runner, n_steps, level, models)
   end subroutine draw_samples

end module tradeoff_marches
