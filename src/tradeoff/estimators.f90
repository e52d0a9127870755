!> Gain of the scene's estimator on a few samples of a case: the standard errors of plain sampling
!> over those of the regression, by which the errors of the campaign are foretold.
!>
!> The case is taken by itself; pooled with others it gains more.
module tradeoff_estimators
   use campaign_plan, only: plan_type
   use campaign_pooling, only: draw_law, fewest_samples, find_points
   use campaign_results, only: block_result, case_statistics
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use process_model, only: process_model_type
   use statistics_estimates, only: statistic_type
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars
   use statistics_spectra, only: estimate_spectrum
   use tradeoff_task_results, only: band_ratio, psd_mean, psd_percentiles, slip, slip_std
   implicit none(type, external)
   private
   public :: find_gains

   integer, parameter :: enough_draws = 2**14   !! of the law
   integer, parameter :: most_looked_at = 8     !! joints or dofs; the others gain as the least

contains

   !> Finds the gain of each published number; those of spectra are the least of all dofs. It stays
   !> 1 where there is none.
   subroutine find_gains(plan, model, friction, result, statistics, has_bands, gain, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: model   !! of the case
      real(wp), intent(in) :: friction(:, :)          !! (joint, sample)
      type(block_result), intent(in) :: result        !! of the same samples
      type(case_statistics), intent(in) :: statistics   !! plain sampling's
      logical, intent(in) :: has_bands                !! wanted
      real(wp), intent(inout) :: gain(:, :)           !! (joint or dof, published number)
      type(error_type), allocatable, intent(out) :: error
      type(pool_type) :: pool
      real(wp), allocatable :: draws(:, :)
      real(wp) :: n_independent
      integer, allocatable :: points(:), joints(:)

      if (result%n_samples < fewest_samples) return
      call find_points(plan%structure, points, joints)
      call new_pool(transpose(friction(joints, :)), [1, result%n_samples + 1], &
                    [result%n_samples], pool)
      call draw_law(plan%seed, model, points, draws, n_independent, enough_draws)
      call pool%add_law(1, draws, n_independent)
      call gains_of_slip(pool, result%slip_fraction, statistics%numbers, gain, error)
      if (allocated(error) .or. .not. (plan%output%spectrum .and. has_bands)) return
      call gains_of_bands(plan, pool, result%psd, statistics%psd, gain, error)
   end subroutine find_gains

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
         if (i <= most_looked_at .and. scatter(joint) > 0.0_wp) then
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

   subroutine gains_of_bands(plan, pool, psd, statistics, gain, error)
      type(plan_type), intent(in) :: plan
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample)
      type(statistic_type), intent(in) :: statistics(:, :, :)   !! (dof, frequency, statistic)
      real(wp), intent(inout) :: gain(:, :)
      type(error_type), allocatable, intent(out) :: error
      type(statistic_type) :: best(size(psd, 2), size(statistics, 3), 1), &
                              integrals(size(statistics, 3) + 1, 1)
      real(wp) :: of_mean, of_percentiles
      logical :: is_looked_at(size(psd, 1))
      integer :: dof, i, n, s

      is_looked_at = .false.
      of_mean = huge(1.0_wp)
      of_percentiles = huge(1.0_wp)
      n = min(most_looked_at, size(psd, 1))
      do i = 1, n
         dof = 1 + ((i - 1)*size(psd, 1))/n
         is_looked_at(dof) = .true.
         if (.not. maxval(psd(dof, :, :)) > 0.0_wp) cycle
         call estimate_spectrum(pool, transpose(psd(dof, :, :)), &
                                1.0_wp/(plan%output%segment_length*plan%integration%dt), &
                                plan%output%percentiles/100.0_wp, &
                                reshape(statistics(dof, :, :), shape(best)), best, integrals, error)
         if (allocated(error)) return
         gain(dof, band_ratio) = max(1.0_wp, integrals(size(integrals, 1), 1)%ratio)
         associate (mean => best(:, 1, 1))
            of_mean = min(of_mean, sum(mean%error*mean%ratio)/sum(mean%error))
         end associate
         do s = 2, size(best, 2)
            associate (percentile => best(:, s, 1))
               of_percentiles = min(of_percentiles, &
                                    sum((percentile%high - percentile%low)*percentile%ratio) &
                                    /sum(percentile%high - percentile%low))
            end associate
         end do
      end do
      if (of_mean < huge(1.0_wp)) then
         gain(:, psd_mean) = max(1.0_wp, of_mean)
         gain(:, psd_percentiles) = max(1.0_wp, of_percentiles)
      end if
      associate (of_dofs => gain(:size(psd, 1), band_ratio))
         where (.not. is_looked_at) of_dofs = minval(of_dofs, mask=is_looked_at)
      end associate
   end subroutine gains_of_bands

end module tradeoff_estimators
