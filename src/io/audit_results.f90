!> The audit of a case as a group of the results file, `audit` in that of the case: its samples as
!> the reference marched them, and what the differences tell of the case's numerical error.
module io_audit_results
   use campaign_comparison, only: band_ratio_error, difference_type, numerical_error, slip_error
   use campaign_plan, only: integration_settings, kept_of, plan_type, reference_for
   use campaign_results, only: block_result, spectrum_layout
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_blocks, only: kept_axis, put_short
   use io_shards, only: stored_samples
   use io_group, only: group_type, new_group
   use io_hdf5, only: hdf5_file
   use io_results, only: case_group, finish_case, write_dofs
   implicit none(type, external)
   private
   public :: write_audit

contains

   !> Writes the group of an audit: `samples` as they are read, spectra from the
   !> shards.
   subroutine write_audit(file, plan, number, samples, layout, errors, stored, error)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number   !! of the audit among the plan's cases
      type(block_result), intent(inout) :: samples   !! left as it was
      type(spectrum_layout), intent(in) :: layout
      type(numerical_error), intent(in) :: errors
      type(stored_samples), intent(in) :: stored
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group
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
      call put_short(group, plan, samples)
      call write_slip_errors(group, errors)
      if (plan%output%spectrum) then
         call group%put('frequency', layout%frequency, 'Hz', 'frequency', 'frequency')
         call group%put('percentile', plan%output%percentiles, '%', 'percentile over samples', &
                        'percentile')
         call write_spectrum_errors(group, kept_axis(plan), errors)
      end if
      call finish_case(group, plan, number, stored, error)
   end subroutine write_audit

   !> Writes the differences of slip fractions, case less reference [percentage points].
   subroutine write_slip_errors(group, errors)
      type(group_type), intent(inout) :: group
      type(numerical_error), intent(in) :: errors

      call group%attribute('slip_points', slip_error(errors))
      call put_difference(group, 'slip_mean_difference', errors%slip_mean, '%', &
                          'numerical error of slip_mean', 'joint')
      call put_difference(group, 'slip_rms_difference', errors%slip_rms, '%', &
                          'numerical error of slip_fraction, root mean square over samples', &
                          'joint')
      call group%put('slip_largest_difference', errors%slip_largest, '%', &
                     'numerical error of slip_fraction, largest of a sample', 'joint')
      call put_difference(group, 'slip_std_difference', errors%slip_std, '%', &
                          'numerical error of slip_std', 'joint')
   end subroutine write_slip_errors

   !> Writes the relative differences of spectra, integrated over frequency.
   subroutine write_spectrum_errors(group, dof, errors)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: dof   !! the axis
      type(numerical_error), intent(in) :: errors
      integer :: p

      call group%attribute('band_ratio', band_ratio_error(errors))
      call put_difference(group, 'psd_mean_difference', errors%psd_mean, '1', 'numerical error '// &
                          'of psd_mean, relative: integral of its absolute value', dof)
      call put_difference(group, 'band_ratio_difference', errors%band_ratio, '1', &
                          'numerical error of band_ratio, relative', dof)
      if (.not. allocated(errors%psd_percentiles)) return
      associate (of => errors%psd_percentiles, n_dof => size(errors%psd_mean%value))
         call group%put('psd_percentiles_difference', &
                        reshape([(of(p)%value, p=1, size(of))], [n_dof, size(of)]), '1', &
                        'numerical error of psd_percentiles, relative: integral of its '// &
                        'absolute value', 'percentile '//dof)
         call group%put('psd_percentiles_difference_error', &
                        reshape([(of(p)%error, p=1, size(of))], [n_dof, size(of)]), '1', &
                        'standard error of psd_percentiles_difference', 'percentile '//dof)
      end associate
   end subroutine write_spectrum_errors

   !> Writes a difference, and its standard error beside it, as far as they are known.
   subroutine put_difference(group, name, difference, units, about, axis)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: name, units, about, axis
      type(difference_type), intent(in) :: difference

      call group%put(name, difference%value, units, about, axis)
      call group%put(name//'_error', difference%error, units, 'standard error of '//name, axis)
   end subroutine put_difference

end module io_audit_results
