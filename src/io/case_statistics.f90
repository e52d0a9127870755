!> Statistics of a case in its group of the results file: the best estimates, plain sampling's in
!> `plain/`, and in `error_ratio/` how much larger the errors of those are.
module io_case_statistics
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: to_text
   use ensemble_estimates, only: case_estimates
   use ensemble_plan, only: plan_type
   use ensemble_results, only: case_statistics
   use io_case_samples, only: kept_axis
   use io_group, only: group_type, new_group
   use io_hdf5, only: label_type
   implicit none(type, external)
   private
   public :: write_estimates

   character(*), parameter :: not_lowered = &
                              ' that more samples do not lower: the march is finite'
   character(*), parameter :: by_regression = &
                              'leave-one-out residuals of the regression, Student, 95 %'

contains

   !> Takes the first error of all.
   subroutine write_estimates(group, plan, plain, estimates, error)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: plain
      type(case_estimates), intent(in) :: estimates
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: beside

      call write_statistics(group, plan, estimates%best, estimates%estimator /= 'plain')
      call write_time_errors(group, plan, plain)
      if (allocated(plain%slip_mean)) then
         call group%attribute('estimator', trim(estimates%estimator))
         if (len(estimates%reason) > 0) call group%attribute('plain_reason', estimates%reason)
      end if
      if (estimates%estimator /= 'plain') then
         if (size(estimates%pooled_with) > 0) &
            call group%attribute('pooled_with', names_of(estimates%pooled_with))
         call group%put('friction_point', estimates%friction_points, &
                        label_type('1', 'point of the process, of the friction of one joint or '// &
                                   'more', 'friction_point'))
         call group%put('sensitivity', estimates%sensitivity, &
                        label_type('1', 'share of the variance of slip_fraction due to one '// &
                                   'friction value', 'joint friction_point'))
         call group%put('sensitivity_error', estimates%sensitivity_error, &
                        label_type('1', 'standard error of sensitivity', 'joint friction_point'))
         if (.not. allocated(group%error)) then
            beside = new_group(group%file, group%path//'/plain')
            call write_statistics(beside, plan, plain, .false.)
            call beside%take_error(group%error)
         end if
         if (.not. allocated(group%error)) then
            beside = new_group(group%file, group%path//'/error_ratio')
            call write_ratios(beside, plan, estimates%error_ratio)
            call beside%take_error(group%error)
         end if
      end if
      call group%take_error(error)
   end subroutine write_estimates

   !> 'c001 c003'
   pure function names_of(cases) result(names)
      integer, intent(in) :: cases(:)
      character(:), allocatable :: names
      character(16) :: buffer
      integer :: i

      names = ''
      do i = 1, size(cases)
         write (buffer, '(a, i0.3)') ' c', cases(i)
         names = names//trim(buffer)
      end do
      names = names(2:)
   end function names_of

   !> Slip fractions, then bands.
   subroutine write_statistics(group, plan, statistics, is_regression)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      logical, intent(in) :: is_regression

      if (.not. allocated(statistics%slip_mean)) return
      call write_methods(group, is_regression, allocated(statistics%psd_mean))
      call put_values(group, plan, statistics)
      call group%put_allocated('slip_mean_error', statistics%slip_mean_error, &
                     label_type('1', 'standard error of slip_mean', 'joint'))
      call group%put_allocated('slip_std_error', statistics%slip_std_error, &
                     label_type('1', 'standard error of slip_std', 'joint'))
      call group%put_allocated('slip_percentiles_low', statistics%slip_percentiles_low, &
                     label_type('1', 'lower end of the 95 % interval', 'percentile joint'))
      call group%put_allocated('slip_percentiles_high', statistics%slip_percentiles_high, &
                     label_type('1', 'upper end of the 95 % interval', 'percentile joint'))
      if (allocated(statistics%psd_mean)) call write_band_errors(group, kept_axis(plan), statistics)
   end subroutine write_statistics

   subroutine write_methods(group, is_regression, has_bands)
      type(group_type), intent(inout) :: group
      logical, intent(in) :: is_regression, has_bands

      call put('slip_mean_error_method', 'standard deviation over root of n_samples')
      call put('slip_std_error_method', 'fourth central moment, any law')
      call put('slip_percentiles_interval_method', 'order statistics, binomial, 95 %')
      if (.not. has_bands) return
      call put('psd_percentiles_interval_method', 'order statistics, binomial, 95 %')
      call put('band_ratio_interval_method', 'bootstrap over samples, of the logarithm, 95 %')
      call put('pseudo_variance_percentiles_error_method', 'bootstrap over samples')

   contains

      subroutine put(name, of_plain)
         character(*), intent(in) :: name, of_plain

         if (is_regression) then
            call group%attribute(name, by_regression)
         else
            call group%attribute(name, of_plain)
         end if
      end subroutine put

   end subroutine write_methods

   !> What the statistics are, without their errors.
   subroutine put_values(group, plan, statistics)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      ! gfortran does not free text that is joined inside of a structure constructor
      character(:), allocatable :: dof, spectrum_axes, percentile_spectrum_axes, percentile_axes

      call group%put_allocated('slip_mean', statistics%slip_mean, &
                     label_type('1', 'mean of slip_fraction', 'joint'))
      call group%put_allocated('slip_std', statistics%slip_std, &
                     label_type('1', 'standard deviation of slip_fraction', 'joint'))
      call group%put_allocated('slip_percentiles', statistics%slip_percentiles, &
                     label_type('1', 'percentiles of slip_fraction', 'percentile joint'))
      if (.not. allocated(statistics%psd_mean)) return
      dof = kept_axis(plan)
      spectrum_axes = 'frequency '//dof
      percentile_spectrum_axes = 'percentile frequency '//dof
      percentile_axes = 'percentile '//dof
      call group%put_allocated('psd_mean', statistics%psd_mean, &
                     label_type('m^2/Hz', 'mean of psd', spectrum_axes))
      call group%put_allocated('psd_percentiles', statistics%psd_percentiles, &
                     label_type('m^2/Hz', 'percentiles of psd', percentile_spectrum_axes))
      call group%put_allocated('pseudo_variance_mean', statistics%pseudo_variance_mean, &
                     label_type('m^2', 'integral of psd_mean over frequency, Eq. (46)', dof))
      call group%put_allocated('pseudo_variance_percentiles', &
                               statistics%pseudo_variance_percentiles, &
                               label_type('m^2', 'integral of each percentile, Eq. (46)', &
                                          percentile_axes))
      call group%put_allocated('band_ratio', statistics%band_ratio, &
                     label_type('1', 'pseudo-variance of the last over the first percentile', dof))
   end subroutine put_values

   subroutine write_band_errors(group, dof, statistics)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: dof   !! the axis
      type(case_statistics), intent(in) :: statistics
      character(:), allocatable :: spectrum_axes, percentile_spectrum_axes, percentile_axes

      spectrum_axes = 'frequency '//dof
      percentile_spectrum_axes = 'percentile frequency '//dof
      percentile_axes = 'percentile '//dof
      call group%put_allocated('psd_mean_error', statistics%psd_mean_error, &
                     label_type('m^2/Hz', 'standard error of psd_mean', spectrum_axes))
      call group%put_allocated('psd_percentiles_low', statistics%psd_percentiles_low, &
                     label_type('m^2/Hz', 'lower end of the 95 % interval', &
                                percentile_spectrum_axes))
      call group%put_allocated('psd_percentiles_high', statistics%psd_percentiles_high, &
                     label_type('m^2/Hz', 'upper end of the 95 % interval', &
                                percentile_spectrum_axes))
      call group%put_allocated('pseudo_variance_mean_error', &
                               statistics%pseudo_variance_mean_error, &
                               label_type('m^2', 'standard error of pseudo_variance_mean', dof))
      call group%put_allocated('pseudo_variance_percentiles_error', &
                     statistics%pseudo_variance_percentiles_error, &
                     label_type('m^2', 'standard error of pseudo_variance_percentiles', &
                                percentile_axes))
      call group%put_allocated('band_ratio_low', statistics%band_ratio_low, &
                     label_type('1', 'lower end of the 95 % interval of band_ratio', dof))
      call group%put_allocated('band_ratio_high', statistics%band_ratio_high, &
                     label_type('1', 'upper end of the 95 % interval of band_ratio', dof))
      call group%put_allocated('band_ratio_bias', statistics%band_ratio_bias, &
                               label_type('1', 'relative bias of band_ratio, by bootstrap', dof))
   end subroutine write_band_errors

   !> What the march adds to errors, whatever the estimator: its length is finite.
   subroutine write_time_errors(group, plan, statistics)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      character(:), allocatable :: dof, percentile_axes

      if (allocated(statistics%slip_mean_time_error)) then
         call group%put_allocated('slip_mean_time_error', statistics%slip_mean_time_error, &
                        label_type('1', 'standard error of slip_mean'//not_lowered, 'joint'))
         call group%put_allocated('slip_std_time_part', statistics%slip_std_time_part, &
                        label_type('1', 'part of slip_std that the finite march adds', 'joint'))
      end if
      if (.not. allocated(statistics%band_ratio_time_error)) return
      dof = kept_axis(plan)
      percentile_axes = 'percentile '//dof
      call group%attribute('band_ratio_time_error_method', &
                           'scatter of consecutive batches of the march')
      call group%put_allocated('pseudo_variance_mean_time_error', &
                     statistics%pseudo_variance_mean_time_error, &
                     label_type('m^2', 'standard error of pseudo_variance_mean'//not_lowered, dof))
      call group%put_allocated('pseudo_variance_percentiles_time_error', &
                     statistics%pseudo_variance_percentiles_time_error, &
                     label_type('m^2', 'standard error of pseudo_variance_percentiles'// &
                                not_lowered, percentile_axes))
      call group%put_allocated('band_ratio_time_error', statistics%band_ratio_time_error, &
                     label_type('1', 'standard error of band_ratio'//not_lowered, dof))
   end subroutine write_time_errors

   !> How much larger the standard errors of plain sampling are, by the names of the estimates.
   subroutine write_ratios(group, plan, ratio)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: ratio
      character(*), parameter :: meaning = &
                                 'standard error of plain sampling over that of the estimate'
      character(:), allocatable :: dof, spectrum_axes, percentile_spectrum_axes, percentile_axes

      dof = kept_axis(plan)
      spectrum_axes = 'frequency '//dof
      percentile_spectrum_axes = 'percentile frequency '//dof
      percentile_axes = 'percentile '//dof
      call group%put('slip_mean', ratio%slip_mean, label_type('1', meaning, 'joint'))
      call group%put('slip_std', ratio%slip_std, label_type('1', meaning, 'joint'))
      call group%put('slip_percentiles', ratio%slip_percentiles, &
                     label_type('1', meaning, 'percentile joint'))
      if (.not. allocated(ratio%psd_mean)) return
      call group%put('psd_mean', ratio%psd_mean, label_type('1', meaning, spectrum_axes))
      call group%put('psd_percentiles', ratio%psd_percentiles, &
                     label_type('1', meaning, percentile_spectrum_axes))
      call group%put('pseudo_variance_mean', ratio%pseudo_variance_mean, &
                     label_type('1', meaning, dof))
      call group%put('pseudo_variance_percentiles', ratio%pseudo_variance_percentiles, &
                     label_type('1', meaning, percentile_axes))
      call group%put('band_ratio', ratio%band_ratio, label_type('1', meaning, dof))
   end subroutine write_ratios

end module io_case_statistics
