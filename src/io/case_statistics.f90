!> Statistics of a case in its group of the results file: the best estimates, the plain estimates in
!> `plain/`, and the ratios of their errors in `error_ratio/`; in `audit/` the samples that the
!> reference method repeated, and the numerical error that their differences show.
module io_case_statistics
   use campaign_comparison, only: band_ratio_error, numerical_error, slip_error
   use campaign_plan, only: integration_settings, plan_type, reference_for
   use campaign_results, only: block_result, case_estimates, case_statistics, n_quantities, &
                               spectrum_layout
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: numbered
   use io_blocks, only: write_block
   use io_files, only: folder_of
   use io_hdf5, only: hdf5_file, hdf5_group, new_group
   use io_results, only: case_group, finish_case, write_dofs
   use io_shards, only: stored_samples
   use numerics_sorting, only: sort_order
   use statistics_estimates, only: statistic_type
   implicit none(type, external)
   private
   public :: write_audit, write_estimates

contains

   !> Writes the best estimates of a case and the errors of the finite march; also the plain
   !> estimates, if the best ones come from a regression. `error` is the first of all in the group.
   subroutine write_estimates(group, plain, found, error)
      type(hdf5_group), intent(inout) :: group
      type(case_statistics), intent(in) :: plain
      type(case_estimates), intent(in) :: found
      type(error_type), allocatable, intent(out) :: error
      character(*), parameter :: time_error = 'time-average error, the same for any number of '// &
                                 'samples, of '
      type(hdf5_group) :: member
      integer :: last

      if (allocated(plain%numbers)) then
         call write_methods(group, found%estimator /= 'plain', allocated(plain%psd))
         call write_statistics(group, found%best)
         call group%attribute('estimator', trim(found%estimator))
         if (len(found%reason) > 0) call group%attribute('plain_reason', found%reason)
      end if
      call group%put('slip_mean_time_error', plain%slip_mean_time_error, '1', &
                     time_error//'slip_mean', 'joint')
      call group%put('slip_std_time_part', plain%slip_std_time_part, '1', &
                     'part of slip_std that the time average adds', 'joint')
      if (allocated(plain%pseudo_variance_time_error)) then
         call group%attribute('band_ratio_time_error_method', &
                              'scatter of consecutive batches of the march')
         associate (errors => plain%pseudo_variance_time_error)
            last = size(errors, 2)
            call group%put('pseudo_variance_mean_time_error', errors(:, 1), 'm^2', &
                           time_error//'pseudo_variance_mean', 'kept')
            call group%put('pseudo_variance_percentiles_time_error', errors(:, 2:last - 1), 'm^2', &
                           time_error//'pseudo_variance_percentiles', 'percentile kept')
            call group%put('band_ratio_time_error', errors(:, last), '1', &
                           time_error//'band_ratio', 'kept')
         end associate
      end if
      if (found%estimator /= 'plain') then
         call group%put('friction_point', found%friction_points, '1', &
                        'point of the process, of the friction of one joint or more', &
                        'friction_point')
         call group%put('sensitivity', found%sensitivity%value, '1', &
                        'share of the variance of slip_fraction due to one friction value', &
                        'joint friction_point')
         call group%put('sensitivity_error', found%sensitivity%error, '1', &
                        'standard error of sensitivity', 'joint friction_point')
         member = group
         call member%change_to(group%path//'/plain')
         call write_methods(member, .false., allocated(plain%psd))
         call write_statistics(member, plain)
         call member%change_to(group%path//'/error_ratio')
         call write_statistics(member, found%best, found)
         if (allocated(member%error)) group%error = member%error
      end if
      call group%take_error(error)
   end subroutine write_estimates

   !> Writes each statistic of a case with its error or interval. If `estimates` is present, writes
   !> instead the ratios of plain sampling's errors to theirs, and attributes of each estimate in
   !> the group above.
   subroutine write_statistics(group, statistics, estimates)
      type(hdf5_group), intent(inout) :: group
      type(case_statistics), intent(in) :: statistics
      type(case_estimates), intent(in), optional :: estimates
      integer :: last, n, n_f, np

      last = size(statistics%numbers, 2)
      np = last - 2
      n = statistics%n_joints
      associate (numbers => statistics%numbers)
         call put_numbers('slip', '1', 'joint', 'slip_fraction', numbers(:n, :))
         call put_numbers('slip_distance', 'm', 'joint', 'slip_distance', numbers(n + 1:2*n, :))
         call put_numbers('dissipation', 'J', 'joint', 'dissipation', &
                          numbers(2*n + 1:n_quantities*n, :))
         if (size(numbers, 1) > n_quantities*n) &
            call put_numbers('harmonic_amplitude', 'm', 'dof', 'harmonic_amplitude', &
                             numbers(n_quantities*n + 1:, :))
      end associate
      if (.not. allocated(statistics%psd)) return
      associate (psd => statistics%psd, integrals => statistics%pseudo_variances)
         n = size(psd, 1)
         n_f = size(psd, 2)
         call put('psd_mean', 'm^2/Hz', 'frequency kept', 'mean of psd', .false., [n, n_f], &
                  psd(:, :, 1))
         call put('psd_percentiles', 'm^2/Hz', 'percentile frequency kept', 'percentiles of psd', &
                  .true., [n, n_f, np], psd(:, :, 2:))
         call put('pseudo_variance_mean', 'm^2', 'kept', &
                  'integral of psd_mean over frequency, Eq. (46)', .false., [n], integrals(:, 1))
         call put('pseudo_variance_percentiles', 'm^2', 'percentile kept', &
                  'integral of each percentile, Eq. (46)', .false., [n, np], &
                  integrals(:, 2:last - 1))
         call put('band_ratio', '1', 'kept', &
                  'pseudo-variance of the last over the first percentile', .true., [n], &
                  integrals(:, last))
      end associate
      call group%put('band_ratio_bias', statistics%band_ratio_bias, '1', &
                     'relative bias of band_ratio, of percentiles of few samples', 'kept')

   contains

      !> Writes the statistics of a quantity of the joints or dofs.
      subroutine put_numbers(name, units, axis, quantity, numbers)
         character(*), intent(in) :: name, units
         character(*), intent(in) :: axis       !! 'joint' or 'dof'
         character(*), intent(in) :: quantity   !! dataset of the samples
         type(statistic_type), intent(in) :: numbers(:, :)

         associate (n => size(numbers, 1))
            call put(name//'_mean', units, axis, 'mean of '//quantity, .false., [n], numbers(:, 1))
            call put(name//'_std', units, axis, 'standard deviation of '//quantity, .false., [n], &
                     numbers(:, last))
            call put(name//'_percentiles', units, 'percentile '//axis, &
                     'percentiles of '//quantity, .true., [n, np], numbers(:, 2:last - 1))
         end associate
      end subroutine put_numbers

      !> Writes one statistic.
      subroutine put(name, units, axes, long_name, has_interval, extents, values)
         character(*), intent(in) :: name, units, axes, long_name
         logical, intent(in) :: has_interval    !! else a standard error
         integer, intent(in) :: extents(:)      !! Fortran's order
         type(statistic_type), intent(in) :: values(product(extents))

         if (present(estimates)) then
            call group%put(name, values%ratio, '1', &
                           'standard error of plain sampling, with the tail that the samples '// &
                           'lack, over that of the estimate', axes, &
                           extents=extents)
            call write_gain(group, estimates, name, values%ratio)
            return
         end if
         call group%put(name, values%value, units, long_name, axes, extents=extents)
         if (has_interval) then
            call group%put(name//'_low', values%low, units, 'lower end of the 95 % interval of '// &
                           name, axes, extents=extents)
            call group%put(name//'_high', values%high, units, 'upper end of the 95 % interval '// &
                           'of '//name, axes, extents=extents)
         else
            call group%put(name//'_error', values%error, units, 'standard error of '//name, axes, &
                           extents=extents)
         end if
      end subroutine put

   end subroutine write_statistics

   !> Writes the method of each error and interval as an attribute.
   subroutine write_methods(group, is_regression, has_bands)
      type(hdf5_group), intent(inout) :: group
      logical, intent(in) :: is_regression, has_bands

      call put('slip_mean_error_method', 'standard deviation over root of n_samples')
      call put('slip_std_error_method', 'fourth central moment, any law')
      call put('slip_percentiles_interval_method', 'order statistics, binomial, 95 %')
      if (.not. has_bands) return
      call put('psd_percentiles_interval_method', 'order statistics, binomial, 95 %')
      call put('band_ratio_interval_method', &
               'influences of samples on its logarithm, Student, 95 %')
      call put('pseudo_variance_percentiles_error_method', 'influences of samples, Student')

   contains

      subroutine put(name, plain_method)
         character(*), intent(in) :: name, plain_method

         if (is_regression) then
            call group%attribute(name, &
                                 'leave-one-out residuals of the regression, Student, 95 %')
         else
            call group%attribute(name, plain_method)
         end if
      end subroutine put

   end subroutine write_methods

   !> Writes attributes of a best estimate: its estimator, the cases pooled, its median error ratio.
   subroutine write_gain(group, found, name, ratio)
      type(hdf5_group), intent(inout) :: group   !! `error_ratio`, a member of the estimate's group
      type(case_estimates), intent(in) :: found
      character(*), intent(in) :: name           !! name of the estimate
      real(wp), intent(in) :: ratio(:)           !! plain sampling's errors over the estimate's
      type(hdf5_group) :: dataset
      character(:), allocatable :: pooled_with
      integer :: i, order(size(ratio))

      if (allocated(group%error)) return
      dataset = group
      dataset%path = folder_of(group%path)//'/'//name
      order = sort_order(ratio)
      call dataset%attribute('error_ratio', ratio(order((size(order) + 1)/2)))
      if (maxval(ratio) > 1.0_wp) then
         call dataset%attribute('estimator', trim(found%estimator))
         pooled_with = ''
         do i = 1, size(found%pooled_with)
            pooled_with = pooled_with//' '//numbered('c', found%pooled_with(i))
         end do
         if (pooled_with /= '') call dataset%attribute('pooled_with', trim(adjustl(pooled_with)))
      else
         call dataset%attribute('estimator', 'plain')
         call dataset%attribute('plain_reason', 'the regression explains too little')
      end if
      call dataset%take_error(group%error)
   end subroutine write_gain

   !> Writes the group of an audit: its short datasets from `samples`, the others from the shards.
   subroutine write_audit(file, plan, number, samples, layout, errors, stored, error)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number                  !! number of the audit among the plan's cases
      type(block_result), intent(inout) :: samples   !! left as it was
      type(spectrum_layout), intent(in) :: layout
      type(numerical_error), intent(in) :: errors
      type(stored_samples), intent(in) :: stored
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_group) :: group
      type(integration_settings) :: reference

      group = new_group(file, case_group(number, count(plan%cases%audits == 0)))
      call group%attribute('n_samples', samples%n_samples)
      reference = reference_for(plan%integration)
      call group%attribute('method', trim(reference%method))
      call group%attribute('tolerance', reference%tolerance)
      call group%attribute('standard_error_method', &
                           'jackknife over the samples repeated; zero where all are; of rms '// &
                           'values at least the root mean square over joints or dofs')
      call group%put_axis('sample', samples%n_samples, 'sample')
      call write_dofs(group, plan)
      call write_block(group, plan, samples)
      if (plan%output%spectrum) then
         call group%put('frequency', layout%frequency, 'Hz', 'frequency', 'frequency')
         call group%put('percentile', plan%output%percentiles, '%', 'percentile over samples', &
                        'percentile')
         call group%attribute('band_ratio', band_ratio_error(errors))
      end if
      call group%attribute('slip_points', slip_error(errors))
      call write_errors(group, errors)
      call finish_case(group, plan, number, stored, error)
   end subroutine write_audit

   !> Writes the differences, case minus reference, that are known: those of slip fractions in
   !> percentage points, those of spectra relative and integrated over frequency.
   subroutine write_errors(group, errors)
      type(hdf5_group), intent(inout) :: group
      type(numerical_error), intent(in) :: errors

      call put('slip_mean_difference', errors%slip_mean, '%', 'numerical error of slip_mean', &
               'joint')
      call put('slip_rms_difference', errors%slip_rms, '%', &
               'numerical error of slip_fraction, root mean square over samples', 'joint')
      call group%put('slip_largest_difference', errors%slip_largest, '%', &
                     'numerical error of slip_fraction, largest of a sample', 'joint')
      call put('slip_std_difference', errors%slip_std, '%', 'numerical error of slip_std', 'joint')
      call put('psd_mean_difference', errors%psd_mean, '1', &
               'numerical error of psd_mean, relative: integral of its absolute value', 'kept')
      call put('band_ratio_difference', errors%band_ratio, '1', &
               'numerical error of band_ratio, relative', 'kept')
      if (.not. allocated(errors%psd_percentiles)) return
      associate (values => errors%psd_percentiles)
         call put('psd_percentiles_difference', reshape(values, [size(values)]), '1', &
                  'numerical error of psd_percentiles, relative: integral of its absolute value', &
                  'percentile kept', shape(values))
      end associate

   contains

      !> Writes a difference, and its standard error if there are two samples or more.
      subroutine put(name, difference, units, long_name, axes, extents)
         character(*), intent(in) :: name, units, long_name, axes
         type(statistic_type), intent(in), optional :: difference(:)
         integer, intent(in), optional :: extents(:)

         if (.not. present(difference)) return
         call group%put(name, difference%value, units, long_name, axes, extents=extents)
         if (errors%n_samples > 1) &
            call group%put(name//'_error', difference%error, units, 'standard error of '//name, &
                           axes, extents=extents)
      end subroutine put

   end subroutine write_errors

end module io_case_statistics
