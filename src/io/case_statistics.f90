!> Statistics of a case in its group of the results file: the best estimates, plain sampling's in
!> `plain/`, and in `error_ratio/` how much larger the errors of those are.
module io_case_statistics
   use campaign_estimates, only: case_estimates
   use campaign_plan, only: plan_type
   use campaign_results, only: case_statistics, joint_statistics
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: to_text
   use io_blocks, only: kept_axis
   use io_group, only: group_type, new_group
   use io_hdf5, only: label_type
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: write_estimates

   character(*), parameter :: not_lowered = &
                              ' that more samples do not lower: the march is finite'
   character(*), parameter :: by_regression = &
                              'leave-one-out residuals of the regression, Student, 95 %'

   !> Axes of what is told of each dof whose spectra are kept, in Python's order.
   type :: band_axes
      character(64) :: dof, spectrum, percentile, percentile_spectrum
   end type band_axes

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
      if (allocated(plain%slip%mean)) then
         call group%attribute('estimator', trim(estimates%estimator))
         if (len(estimates%reason) > 0) call group%attribute('plain_reason', estimates%reason)
      end if
      if (estimates%estimator /= 'plain') then
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
         call describe_estimators(group, estimates)
      end if
      call group%take_error(error)
   end subroutine write_estimates

   !> Notes with each best estimate how it came about and what that gains.
   subroutine describe_estimators(group, estimates)
      type(group_type), intent(inout) :: group
      type(case_estimates), intent(in) :: estimates

      associate (ratio => estimates%error_ratio)
         call describe_numbers('slip', ratio%slip)
         call describe_numbers('slip_distance', ratio%slip_distance)
         call describe_numbers('dissipation', ratio%dissipation)
         if (allocated(ratio%harmonic_amplitude%mean)) &
            call describe_numbers('harmonic_amplitude', ratio%harmonic_amplitude)
         if (.not. allocated(ratio%psd_mean)) return
         call describe('psd_mean', [ratio%psd_mean])
         call describe('psd_percentiles', [ratio%psd_percentiles])
         call describe('pseudo_variance_mean', ratio%pseudo_variance_mean)
         call describe('pseudo_variance_percentiles', [ratio%pseudo_variance_percentiles])
         call describe('band_ratio', ratio%band_ratio)
      end associate

   contains

      subroutine describe_numbers(name, ratio)
         character(*), intent(in) :: name
         type(joint_statistics), intent(in) :: ratio

         call describe(name//'_mean', ratio%mean)
         call describe(name//'_std', ratio%std)
         call describe(name//'_percentiles', [ratio%percentiles])
      end subroutine describe_numbers

      subroutine describe(name, ratio)
         character(*), intent(in) :: name
         real(wp), intent(in) :: ratio(:)
         type(group_type) :: dataset
         integer :: order(size(ratio))

         if (allocated(group%error)) return
         dataset = group
         dataset%path = group%path//'/'//name
         order = sort_order(ratio)
         call dataset%attribute('error_ratio', ratio(order((size(order) + 1)/2)))
         if (maxval(ratio) > 1.0_wp) then
            call dataset%attribute('estimator', trim(estimates%estimator))
            if (size(estimates%pooled_with) > 0) &
               call dataset%attribute('pooled_with', names_of(estimates%pooled_with))
         else
            call dataset%attribute('estimator', 'plain')
            call dataset%attribute('plain_reason', 'the regression explains too little')
         end if
         call dataset%take_error(group%error)
      end subroutine describe

   end subroutine describe_estimators

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

   !> Quantities of joints, amplitudes under a sine, then bands.
   subroutine write_statistics(group, plan, statistics, is_regression)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      logical, intent(in) :: is_regression

      if (.not. allocated(statistics%slip%mean)) return
      call write_methods(group, is_regression, allocated(statistics%psd_mean))
      call put_numbers(group, 'slip', '1', 'slip_fraction', 'joint', statistics%slip)
      call put_numbers(group, 'slip_distance', 'm', 'slip_distance', 'joint', &
                       statistics%slip_distance)
      call put_numbers(group, 'dissipation', 'J', 'dissipation', 'joint', statistics%dissipation)
      if (allocated(statistics%harmonic_amplitude%mean)) &
         call put_numbers(group, 'harmonic_amplitude', 'm', 'harmonic_amplitude', 'dof', &
                          statistics%harmonic_amplitude)
      if (.not. allocated(statistics%psd_mean)) return
      call put_bands(group, axes_of(plan), statistics)
      call put_band_errors(group, axes_of(plan), statistics)
   end subroutine write_statistics

   pure function axes_of(plan) result(axes)
      type(plan_type), intent(in) :: plan
      type(band_axes) :: axes

      axes%dof = kept_axis(plan)
      axes%spectrum = 'frequency '//trim(axes%dof)
      axes%percentile = 'percentile '//trim(axes%dof)
      axes%percentile_spectrum = 'percentile frequency '//trim(axes%dof)
   end function axes_of

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

   !> A quantity of the joints or dofs with its errors.
   subroutine put_numbers(group, name, units, quantity, axis, statistics)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: name, units
      character(*), intent(in) :: quantity   !! dataset of the samples
      character(*), intent(in) :: axis       !! 'joint' or 'dof'
      type(joint_statistics), intent(in) :: statistics
      ! gfortran does not free text that is joined inside of a structure constructor
      character(:), allocatable :: meaning

      meaning = 'mean of '//quantity
      call group%put_allocated(name//'_mean', statistics%mean, label_type(units, meaning, axis))
      meaning = 'standard error of '//name//'_mean'
      call group%put_allocated(name//'_mean_error', statistics%mean_error, &
                     label_type(units, meaning, axis))
      meaning = 'standard deviation of '//quantity
      call group%put_allocated(name//'_std', statistics%std, label_type(units, meaning, axis))
      meaning = 'standard error of '//name//'_std'
      call group%put_allocated(name//'_std_error', statistics%std_error, &
                     label_type(units, meaning, axis))
      meaning = 'percentiles of '//quantity
      call group%put_allocated(name//'_percentiles', statistics%percentiles, &
                     label_type(units, meaning, 'percentile '//axis))
      call group%put_allocated(name//'_percentiles_low', statistics%low, &
                     label_type(units, 'lower end of the 95 % interval', 'percentile '//axis))
      call group%put_allocated(name//'_percentiles_high', statistics%high, &
                     label_type(units, 'upper end of the 95 % interval', 'percentile '//axis))
   end subroutine put_numbers

   !> Writes the bands without their errors.
   subroutine put_bands(group, axes, statistics)
      type(group_type), intent(inout) :: group
      type(band_axes), intent(in) :: axes
      type(case_statistics), intent(in) :: statistics

      call group%put_allocated('psd_mean', statistics%psd_mean, &
                     label_type('m^2/Hz', 'mean of psd', trim(axes%spectrum)))
      call group%put_allocated('psd_percentiles', statistics%psd_percentiles, &
                     label_type('m^2/Hz', 'percentiles of psd', trim(axes%percentile_spectrum)))
      call group%put_allocated('pseudo_variance_mean', statistics%pseudo_variance_mean, &
                     label_type('m^2', 'integral of psd_mean over frequency, Eq. (46)', &
                                trim(axes%dof)))
      call group%put_allocated('pseudo_variance_percentiles', &
                               statistics%pseudo_variance_percentiles, &
                               label_type('m^2', 'integral of each percentile, Eq. (46)', &
                                          trim(axes%percentile)))
      call group%put_allocated('band_ratio', statistics%band_ratio, &
                     label_type('1', 'pseudo-variance of the last over the first percentile', &
                                trim(axes%dof)))
   end subroutine put_bands

   subroutine put_band_errors(group, axes, statistics)
      type(group_type), intent(inout) :: group
      type(band_axes), intent(in) :: axes
      type(case_statistics), intent(in) :: statistics

      call group%put_allocated('psd_mean_error', statistics%psd_mean_error, &
                     label_type('m^2/Hz', 'standard error of psd_mean', trim(axes%spectrum)))
      call group%put_allocated('psd_percentiles_low', statistics%psd_percentiles_low, &
                     label_type('m^2/Hz', 'lower end of the 95 % interval', &
                                trim(axes%percentile_spectrum)))
      call group%put_allocated('psd_percentiles_high', statistics%psd_percentiles_high, &
                     label_type('m^2/Hz', 'upper end of the 95 % interval', &
                                trim(axes%percentile_spectrum)))
      call group%put_allocated('pseudo_variance_mean_error', &
                               statistics%pseudo_variance_mean_error, &
                               label_type('m^2', 'standard error of pseudo_variance_mean', &
                                          trim(axes%dof)))
      call group%put_allocated('pseudo_variance_percentiles_error', &
                     statistics%pseudo_variance_percentiles_error, &
                     label_type('m^2', 'standard error of pseudo_variance_percentiles', &
                                trim(axes%percentile)))
      call group%put_allocated('band_ratio_low', statistics%band_ratio_low, &
                     label_type('1', 'lower end of the 95 % interval of band_ratio', &
                                trim(axes%dof)))
      call group%put_allocated('band_ratio_high', statistics%band_ratio_high, &
                     label_type('1', 'upper end of the 95 % interval of band_ratio', &
                                trim(axes%dof)))
      call group%put_allocated('band_ratio_bias', statistics%band_ratio_bias, &
                               label_type('1', 'relative bias of band_ratio, by bootstrap', &
                                          trim(axes%dof)))
   end subroutine put_band_errors

   !> Writes the errors that the finite length of the march adds, whatever the estimator.
   subroutine write_time_errors(group, plan, statistics)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics
      type(band_axes) :: axes

      if (allocated(statistics%slip_mean_time_error)) then
         call group%put_allocated('slip_mean_time_error', statistics%slip_mean_time_error, &
                        label_type('1', 'standard error of slip_mean'//not_lowered, 'joint'))
         call group%put_allocated('slip_std_time_part', statistics%slip_std_time_part, &
                        label_type('1', 'part of slip_std that the finite march adds', 'joint'))
      end if
      if (.not. allocated(statistics%band_ratio_time_error)) return
      axes = axes_of(plan)
      call group%attribute('band_ratio_time_error_method', &
                           'scatter of consecutive batches of the march')
      call group%put_allocated('pseudo_variance_mean_time_error', &
                     statistics%pseudo_variance_mean_time_error, &
                     label_type('m^2', 'standard error of pseudo_variance_mean'//not_lowered, &
                                trim(axes%dof)))
      call group%put_allocated('pseudo_variance_percentiles_time_error', &
                     statistics%pseudo_variance_percentiles_time_error, &
                     label_type('m^2', 'standard error of pseudo_variance_percentiles'// &
                                not_lowered, trim(axes%percentile)))
      call group%put_allocated('band_ratio_time_error', statistics%band_ratio_time_error, &
                     label_type('1', 'standard error of band_ratio'//not_lowered, trim(axes%dof)))
   end subroutine write_time_errors

   !> How much larger the standard errors of plain sampling are, by the names of the estimates.
   subroutine write_ratios(group, plan, ratio)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: ratio
      character(*), parameter :: meaning = &
                                 'standard error of plain sampling over that of the estimate'
      type(band_axes) :: axes

      axes = axes_of(plan)
      call put_numbers_of('slip', 'joint', ratio%slip)
      call put_numbers_of('slip_distance', 'joint', ratio%slip_distance)
      call put_numbers_of('dissipation', 'joint', ratio%dissipation)
      if (allocated(ratio%harmonic_amplitude%mean)) &
         call put_numbers_of('harmonic_amplitude', 'dof', ratio%harmonic_amplitude)
      if (.not. allocated(ratio%psd_mean)) return
      call group%put('psd_mean', ratio%psd_mean, label_type('1', meaning, trim(axes%spectrum)))
      call group%put('psd_percentiles', ratio%psd_percentiles, &
                     label_type('1', meaning, trim(axes%percentile_spectrum)))
      call group%put('pseudo_variance_mean', ratio%pseudo_variance_mean, &
                     label_type('1', meaning, trim(axes%dof)))
      call group%put('pseudo_variance_percentiles', ratio%pseudo_variance_percentiles, &
                     label_type('1', meaning, trim(axes%percentile)))
      call group%put('band_ratio', ratio%band_ratio, label_type('1', meaning, trim(axes%dof)))

   contains

      subroutine put_numbers_of(name, axis, of)
         character(*), intent(in) :: name, axis
         type(joint_statistics), intent(in) :: of

         call group%put(name//'_mean', of%mean, label_type('1', meaning, axis))
         call group%put(name//'_std', of%std, label_type('1', meaning, axis))
         call group%put(name//'_percentiles', of%percentiles, &
                        label_type('1', meaning, 'percentile '//axis))
      end subroutine put_numbers_of

   end subroutine write_ratios

end module io_case_statistics
