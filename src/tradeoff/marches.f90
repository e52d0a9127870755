!> Runs a task of a tradeoff: draws its samples, marches them, and reduces them to a few numbers.
!>
!> Gain of a regression on the samples of a case: standard errors of plain sampling over those of
!> the regression on these samples alone. Forecasts of a pool scale its error by the samples of the
!> pool (error_with of campaign_samples_needed).
module tradeoff_marches
   use campaign_comparison, only: ratio_replicates
   use campaign_plan, only: plan_type
   use campaign_pooling, only: draw_law, fewest_samples, find_input_points
   use campaign_results, only: block_result, case_statistics
   use campaign_sample, only: stop_query
   use campaign_study, only: block_range
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use statistics_estimates, only: statistic_type
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars
   use statistics_spectra, only: estimate_spectrum
   use tradeoff_sample, only: draw_level, level_type, march_level
   use tradeoff_settings, only: setting_type
   use tradeoff_task_results, only: band_ratio, find_plain_statistics, find_published_values, &
                                    find_setting_errors, plain_errors, psd_mean, psd_percentiles, &
                                    slip, slip_std
   use tradeoff_tasks, only: batch_task, case_of, choose_march, samples_task, setting_task, &
                             spectrum_task, task_type, tradeoff_type, variant_task
   implicit none(type, external)
   private
   public :: run_task

   integer, parameter :: most_draws = 2**14    !! draws of the law of the friction
   !> Joints or dofs with a regression; the others are given the smallest gain of these.
   integer, parameter :: most_examined = 8

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
      type(process_model_type), allocatable :: models(:)
      logical, allocatable :: is_sequential(:)   ! (variant)
      integer :: case_number, i

      associate (scope => tradeoff%scope)
         select case (task%kind)
         case (samples_task)
            case_number = tradeoff%cases(task%row)
            models = scope%models
         case (variant_task)
            case_number = case_of(tradeoff, task)
            models = scope%models
            models(scope%variants(task%row)%process) = scope%variant_models(task%row)
            ! all sequential samplers start the same number of values before the first point: the
            ! same random numbers then give the same points
            is_sequential = scope%variant_models%is_solved .and. &
                            scope%variant_models%request%positive .and. &
                            scope%variant_models%request%sampler == 'sequential'
            if (is_sequential(task%row)) models(scope%variants(task%row)%process)%memory = &
               maxval(scope%variant_models%memory, mask=is_sequential)
         case default
            level = tradeoff%levels(task%level)
            return
         end select
      end associate
      level%samples = [(block_range(case_number, i, i), i=1, n)]
      call draw_level(tradeoff%runner%plan, tradeoff%runner, n_steps, level, models)
   end subroutine draw_samples

   !> Computes the gain of each published number; for spectra the smallest over the dofs. A gain
   !> that is not computed keeps its value, 1.
   subroutine find_gains(plan, model, friction, result, statistics, has_bands, gain, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: model   !! process of the case
      real(wp), intent(in) :: friction(:, :)          !! (joint, sample)
      type(block_result), intent(in) :: result        !! results of the same samples
      type(case_statistics), intent(in) :: statistics   !! plain sampling's
      logical, intent(in) :: has_bands                !! computes the gains of spectra too
      real(wp), intent(inout) :: gain(:, :)           !! (joint or dof, published number)
      type(error_type), allocatable, intent(out) :: error
      type(pool_type) :: pool
      real(wp), allocatable :: draws(:, :)
      real(wp) :: n_independent
      integer, allocatable :: points(:), joints(:)

      if (result%n_samples < fewest_samples) return
      call find_input_points(plan%structure, points, joints)
      call new_pool(transpose(friction(joints, :)), [1, result%n_samples + 1], &
                    [result%n_samples], pool)
      call draw_law(plan%seed, model, points, draws, n_independent, most_draws)
      call pool%add_law(1, draws, n_independent)
      call gains_of_slip(pool, result%slip_fraction, statistics%numbers, gain, error)
      if (allocated(error) .or. .not. (plan%output%spectrum .and. has_bands)) return
      call gains_of_bands(plan, pool, result%psd, statistics%psd, gain, error)
   end subroutine find_gains

   !> Computes the gains of the mean and the standard deviation of slip fractions. Examines the
   !> joints with the largest standard deviations.
   subroutine gains_of_slip(pool, slip_fraction, statistics, gain, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: slip_fraction(:, :)   !! (joint, sample)
      type(statistic_type), intent(in) :: statistics(:, :)   !! (joint, statistic)
      real(wp), intent(inout) :: gain(:, :)
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type) :: plain(1, 2, 1), estimate(1, 2, 1)   ! mean, standard deviation
      type(statistic_type) :: sensitivity(size(pool%x, 2), 1)
      real(wp) :: scatter(size(slip_fraction, 1)), least(2)
      integer, allocatable :: ranking(:)
      integer :: i, joint

      scatter = statistics(:, size(statistics, 2))%value
      ranking = sort_order(-scatter)
      least = huge(1.0_wp)
      do i = 1, size(ranking)
         joint = ranking(i)
         if (i <= most_examined .and. scatter(joint) > 0.0_wp) then
            plain(1, :, 1) = statistics(joint, [1, size(statistics, 2)])
            call estimate_scalars(pool, reshape(slip_fraction(joint, :), &
                                                [size(slip_fraction, 2), 1]), &
                                  [.true.], [real(wp) ::], plain, estimate, sensitivity, error)
            if (allocated(error)) return
            gain(joint, [slip, slip_std]) = max(1.0_wp, estimate(1, :, 1)%ratio)
            least = min(least, gain(joint, [slip, slip_std]))
         else if (scatter(joint) > 0.0_wp) then
            gain(joint, [slip, slip_std]) = least
         end if
      end do
   end subroutine gains_of_slip

   !> Computes the gains of spectra and of band ratios. The examined dofs are evenly spaced.
   subroutine gains_of_bands(plan, pool, psd, statistics, gain, error)
      type(plan_type), intent(in) :: plan
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample)
      type(statistic_type), intent(in) :: statistics(:, :, :)   !! (dof, frequency, statistic)
      real(wp), intent(inout) :: gain(:, :)
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type) :: best(size(psd, 2), size(statistics, 3), 1), &
                              integrals(size(statistics, 3) + 1, 1)
      real(wp) :: mean_gain, percentile_gain   ! smallest so far
      logical :: is_examined(size(psd, 1))
      integer :: dof, i, n, s

      is_examined = .false.
      mean_gain = huge(1.0_wp)
      percentile_gain = huge(1.0_wp)
      n = min(most_examined, size(psd, 1))
      do i = 1, n
         dof = 1 + ((i - 1)*size(psd, 1))/n
         is_examined(dof) = .true.
         if (.not. maxval(psd(dof, :, :)) > 0.0_wp) cycle
         call estimate_spectrum(pool, transpose(psd(dof, :, :)), &
                                1.0_wp/(plan%output%segment_length*plan%integration%dt), &
                                plan%output%percentiles/100.0_wp, &
                                reshape(statistics(dof, :, :), shape(best)), best, integrals, error)
         if (allocated(error)) return
         gain(dof, band_ratio) = max(1.0_wp, integrals(size(integrals, 1), 1)%ratio)
         associate (mean => best(:, 1, 1))
            mean_gain = min(mean_gain, sum(mean%error*mean%ratio)/sum(mean%error))
         end associate
         do s = 2, size(best, 2)
            associate (percentile => best(:, s, 1))
               percentile_gain = min(percentile_gain, &
                                     sum((percentile%high - percentile%low)*percentile%ratio) &
                                     /sum(percentile%high - percentile%low))
            end associate
         end do
      end do
      if (mean_gain < huge(1.0_wp)) then
         gain(:, psd_mean) = max(1.0_wp, mean_gain)
         gain(:, psd_percentiles) = max(1.0_wp, percentile_gain)
      end if
      associate (ratio_gain => gain(:size(psd, 1), band_ratio))   ! (dof)
         where (.not. is_examined) ratio_gain = minval(ratio_gain, mask=is_examined)
      end associate
   end subroutine gains_of_bands

end module tradeoff_marches
