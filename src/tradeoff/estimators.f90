!> Gain of the scene's estimator on a few samples of a case: the standard errors of plain sampling
!> over those of the regression, by which the errors of the campaign are foretold.
!>
!> The case is taken by itself; pooled with others it gains more.
module tradeoff_estimators
   use campaign_plan, only: plan_type
   use campaign_pooling, only: draw_law, fewest_samples, find_points
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: standard_deviation
   use process_model, only: process_model_type
   use statistics_estimates, only: estimates_type, plain_mean, plain_percentile
   use statistics_pool, only: new_pool, pool_type
   use statistics_scalars, only: estimate_scalars, scalar_type
   use statistics_spectra, only: estimate_spectrum, spectrum_type
   use tradeoff_task_results, only: band_ratio, psd_mean, psd_percentiles, slip, slip_std
   implicit none(type, external)
   private
   public :: find_gains

   integer, parameter :: enough_draws = 2**14   !! of the law
   integer, parameter :: most_looked_at = 8     !! joints or dofs; the others gain as the least

contains

   !> Finds the gain of each published number; those of spectra are the least of all dofs. It stays
   !> 1 where there is none.
   subroutine find_gains(plan, model, friction, result, has_bands, gain, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: model   !! of the case
      real(wp), intent(in) :: friction(:, :)          !! (joint, sample)
      type(block_result), intent(in) :: result        !! of the same samples
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
      call gains_of_slip(pool, result%slip_fraction, gain, error)
      if (allocated(error) .or. .not. (plan%output%spectrum .and. has_bands)) return
      call gains_of_bands(plan, pool, result%psd, gain, error)
   end subroutine find_gains

   subroutine gains_of_slip(pool, slip_fraction, gain, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: slip_fraction(:, :)   !! (joint, sample)
      real(wp), intent(inout) :: gain(:, :)
      type(error_type), allocatable, intent(out) :: error
      type(scalar_type) :: plain(1, 1), estimate(1, 1)
      real(wp) :: scatter(size(slip_fraction, 1)), least(2)
      integer, allocatable :: ranking(:)
      integer :: i, joint

      scatter = [(standard_deviation(slip_fraction(i, :)), i=1, size(scatter))]
      ranking = sort_order(-scatter)
      least = huge(1.0_wp)
      do i = 1, size(ranking)
         joint = ranking(i)
         if (i <= most_looked_at .and. scatter(joint) > 0.0_wp) then
            plain(1, 1)%mean = sum(slip_fraction(joint, :))/size(slip_fraction, 2)
            plain(1, 1)%deviation = scatter(joint)
            call estimate_scalars(pool, reshape(slip_fraction(joint, :), &
                                                [size(slip_fraction, 2), 1]), &
                                  [.true.], [real(wp) ::], plain, estimate, error)
            if (allocated(error)) return
            gain(joint, slip) = max(1.0_wp, estimate(1, 1)%mean_ratio)
            gain(joint, slip_std) = max(1.0_wp, estimate(1, 1)%deviation_ratio)
            least = min(least, [gain(joint, slip), gain(joint, slip_std)])
         else if (scatter(joint) > 0.0_wp) then
            gain(joint, slip) = least(1)
            gain(joint, slip_std) = least(2)
         end if
      end do
   end subroutine gains_of_slip

   subroutine gains_of_bands(plan, pool, psd, gain, error)
      type(plan_type), intent(in) :: plan
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample)
      real(wp), intent(inout) :: gain(:, :)
      type(error_type), allocatable, intent(out) :: error
      type(spectrum_type) :: plain(1), estimate(1)
      type(estimates_type) :: some
      real(wp), allocatable :: density(:, :)   ! (sample, frequency)
      real(wp) :: of_mean, of_percentiles
      logical :: is_looked_at(size(psd, 1))
      integer :: dof, i, n, p

      is_looked_at = .false.
      of_mean = huge(1.0_wp)
      of_percentiles = huge(1.0_wp)
      n = min(most_looked_at, size(psd, 1))
      do i = 1, n
         dof = 1 + ((i - 1)*size(psd, 1))/n
         is_looked_at(dof) = .true.
         density = transpose(psd(dof, :, :))
         if (.not. maxval(density) > 0.0_wp) cycle
         some = plain_mean(density)
         plain(1)%mean = some%value
         if (allocated(plain(1)%percentile)) deallocate (plain(1)%percentile)
         allocate (plain(1)%percentile(size(psd, 2), size(plan%output%percentiles)))
         do p = 1, size(plan%output%percentiles)
            some = plain_percentile(density, plan%output%percentiles(p)/100.0_wp)
            plain(1)%percentile(:, p) = some%value
         end do
         call estimate_spectrum(pool, density, &
                                1.0_wp/(plan%output%segment_length*plan%integration%dt), &
                                plan%output%percentiles/100.0_wp, plain, estimate, error)
         if (allocated(error)) return
         associate (best => estimate(1))
            gain(dof, band_ratio) = max(1.0_wp, best%ratio_ratio)
            of_mean = min(of_mean, sum(best%mean_error*best%mean_ratio)/sum(best%mean_error))
            do p = 1, size(plan%output%percentiles)
               associate (width => best%high(:, p) - best%low(:, p))
                  of_percentiles = min(of_percentiles, sum(width*best%percentile_ratio(:, p)) &
                                       /sum(width))
               end associate
            end do
         end associate
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
