!> One case of a campaign as a group of the results file: its axes, statistics and attributes. What
!> each sample handed back is io_case_samples'.
module io_case_results
   use core_error, only: error_type
   use core_kinds, only: wp
   use ensemble_plan, only: plan_type
   use ensemble_results, only: case_statistics, spectrum_layout
   use ensemble_time_average, only: count_spans
   use io_case_samples, only: batch_frequencies, kept_axis, make_samples, write_dofs, write_long
   use io_group, only: counted, group_type, new_group
   use io_hdf5, only: label_type
   use io_process_results, only: process_name
   use io_results, only: results_writer
   use io_shards, only: shard_type
   use io_store, only: shard_store
   use numerics_spectrum, only: error_of_density
   implicit none(type, external)
   private
   public :: begin_case, case_group, finish_case, write_frequency

   character(*), parameter :: not_lowered = &
                              ' that more samples do not lower: the march is finite'

contains

   !> c001, c002, ...
   pure function case_name(number) result(name)
      integer, intent(in) :: number
      character(:), allocatable :: name
      character(16) :: buffer

      write (buffer, '(a, i0.3)') 'c', number
      name = trim(buffer)
   end function case_name

   !> Where a case lies, without a last slash. The audits come behind all cases of their own, in the
   !> same order, each in the group of the case that it repeats.
   pure function case_group(number, n_own) result(group)
      integer, intent(in) :: number
      integer, intent(in) :: n_own   !! cases that are no audits
      character(:), allocatable :: group

      if (number <= n_own) then
         group = '/campaign/'//case_name(number)
      else
         group = '/campaign/'//case_name(number - n_own)//'/audit'
      end if
   end function case_group

   !> The group of a case, its axes, and room for its samples. `force` is the record, or one for
   !> each sample, and belongs to histories; errors stay with the group.
   subroutine begin_case(writer, plan, number, layout, folded_share, group, force)
      type(results_writer), intent(in) :: writer
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(spectrum_layout), intent(in) :: layout
      !> (dof) of the pilot march; empty: none was made
      real(wp), intent(in), contiguous :: folded_share(:)
      type(group_type), intent(out) :: group
      real(wp), intent(in), contiguous, optional :: force(:, :)   !! (step, 1 or sample) [N]

      group = new_group(writer%file, case_group(number, size(plan%cases)))
      call write_attributes(group, plan, number)
      associate (case => plan%cases(number))
         call group%put('sample', case%first_sample - 1 + counted(case%n_samples), &
                        label_type('1', 'sample', 'sample'))
      end associate
      call write_dofs(group, plan)
      if (plan%output%slip) then
         call group%put('span', counted(count_spans(plan%integration)), &
                        label_type('1', 'equal span of the time that is measured', 'span'))
      end if
      if (plan%output%spectrum) call write_spectrum_axes(group, plan, layout, folded_share)
      if (plan%output%history) call write_history_axes(group, plan, force)
      call make_samples(group, plan, plan%output, plan%cases(number)%n_samples)
   end subroutine begin_case

   !> Statistics, and what is long taken from the shards; takes the first error of all.
   subroutine finish_case(group, plan, number, layout, statistics, store, shards, error)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(spectrum_layout), intent(in) :: layout
      type(case_statistics), intent(in) :: statistics
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of the case, as shards_of has them
      type(error_type), allocatable, intent(out) :: error

      call write_slip_statistics(group, statistics)
      call write_time_averages(group, statistics)
      call write_bands(group, kept_axis(plan), statistics)
      call write_long(group, plan, plan%output, layout, plan%cases(number)%n_samples, store, shards)
      call group%take_error(error)
   end subroutine finish_case

   subroutine write_attributes(group, plan, number)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      associate (case => plan%cases(number))
         call group%attribute('process', process_name(case%process))
         call group%attribute('variance', case%variance)
         call group%attribute('n_samples', case%n_samples)
         if (case%process == 0) call group%attribute('friction_from', plan%friction_from)
         if (case%process == 0) return
         call group%attribute('std', plan%processes(case%process)%std)
         call group%attribute('correlation_length', plan%processes(case%process)%correlation_length)
      end associate
   end subroutine write_attributes

   subroutine write_slip_statistics(group, statistics)
      type(group_type), intent(inout) :: group
      type(case_statistics), intent(in) :: statistics

      if (.not. allocated(statistics%slip_mean)) return
      call group%attribute('slip_mean_error_method', 'standard deviation over root of n_samples')
      call group%attribute('slip_std_error_method', 'fourth central moment, any law')
      call group%put_allocated('slip_mean', statistics%slip_mean, &
                               label_type('1', 'mean over samples of slip_fraction', 'joint'))
      call group%put_allocated('slip_mean_error', statistics%slip_mean_error, &
                               label_type('1', 'standard error of slip_mean', 'joint'))
      call group%put_allocated('slip_std', statistics%slip_std, &
                               label_type('1', 'standard deviation over samples of slip_fraction', &
                                          'joint'))
      call group%put_allocated('slip_std_error', statistics%slip_std_error, &
                               label_type('1', 'standard error of slip_std', 'joint'))
   end subroutine write_slip_statistics

   !> What the autocovariance of the slip series tells of errors.
   subroutine write_time_averages(group, statistics)
      type(group_type), intent(inout) :: group
      type(case_statistics), intent(in) :: statistics

      if (.not. allocated(statistics%slip_mean_time_error)) return
      call group%put('slip_mean_time_error', statistics%slip_mean_time_error, &
                     label_type('1', 'standard error of slip_mean'//not_lowered, 'joint'))
      call group%put_allocated('slip_std_time_part', statistics%slip_std_time_part, &
                               label_type('1', 'part of slip_std that the finite march adds', &
                                          'joint'))
   end subroutine write_time_averages

   subroutine write_spectrum_axes(group, plan, layout, folded_share)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(spectrum_layout), intent(in) :: layout
      real(wp), intent(in), contiguous :: folded_share(:)   !! (dof)

      call write_frequency(group, layout)
      call group%put('percentile', plan%output%percentiles, &
                     label_type('%', 'percentile over samples', 'percentile'))
      call group%attribute('window', 'periodic Hann')
      call group%attribute('detrending', 'mean of each segment')
      call group%attribute('segment_length', layout%segment_length)
      call group%attribute('overlap', layout%overlap)
      call group%attribute('n_segments', layout%n_segments)
      call group%attribute('psd_time_error', error_of_density(layout%n_segments))
      call group%attribute('every', layout%every)
      call group%attribute('sided', 'one')
      if (layout%follows_power) then
         call group%put('batch', counted(size(batch_frequencies(layout))), &
                        label_type('1', 'batch of segments in a range of frequencies', 'batch'))
         call group%put('batch_frequency', batch_frequencies(layout), &
                        label_type('Hz', 'highest frequency of its range', 'batch'))
      end if
      if (size(folded_share) == 0) return
      call group%attribute('folded_share', maxval(folded_share))
      call group%put('folded_share', folded_share, &
                     label_type('1', 'share of the power that thinning folds below the highest '// &
                                'frequency, in a pilot march', 'dof'))
   end subroutine write_spectrum_axes

   !> The axis of the spectra.
   subroutine write_frequency(group, layout)
      type(group_type), intent(inout) :: group
      type(spectrum_layout), intent(in) :: layout

      call group%put('frequency', layout%frequency, label_type('Hz', 'frequency', 'frequency'))
   end subroutine write_frequency

   subroutine write_bands(group, dof, statistics)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: dof   !! the axis
      type(case_statistics), intent(in) :: statistics
      ! gfortran does not free text that is joined inside of a structure constructor
      character(:), allocatable :: spectrum_axes, percentile_spectrum_axes, percentile_axes

      if (.not. allocated(statistics%psd_mean)) return
      spectrum_axes = 'frequency '//dof
      percentile_spectrum_axes = 'percentile frequency '//dof
      percentile_axes = 'percentile '//dof
      call group%attribute('psd_percentiles_interval_method', 'order statistics, binomial, 95 %')
      call group%attribute('band_ratio_interval_method', &
                           'bootstrap over samples, of the logarithm, 95 %')
      call group%attribute('pseudo_variance_percentiles_error_method', 'bootstrap over samples')
      call group%put_allocated('psd_mean', statistics%psd_mean, &
                               label_type('m^2/Hz', 'mean over samples of psd', spectrum_axes))
      call group%put_allocated('psd_mean_error', statistics%psd_mean_error, &
                               label_type('m^2/Hz', 'standard error of psd_mean', &
                                          spectrum_axes))
      call group%put_allocated('psd_percentiles', statistics%psd_percentiles, &
                               label_type('m^2/Hz', 'percentiles over samples of psd', &
                                          percentile_spectrum_axes))
      call group%put_allocated('psd_percentiles_low', statistics%psd_percentiles_low, &
                               label_type('m^2/Hz', 'lower end of the 95 % interval', &
                                          percentile_spectrum_axes))
      call group%put_allocated('psd_percentiles_high', statistics%psd_percentiles_high, &
                               label_type('m^2/Hz', 'upper end of the 95 % interval', &
                                          percentile_spectrum_axes))
      call group%put_allocated('pseudo_variance_mean', statistics%pseudo_variance_mean, &
                               label_type('m^2', 'integral of psd_mean over frequency, Eq. (46)', &
                                          dof))
      call group%put_allocated('pseudo_variance_mean_error', &
                               statistics%pseudo_variance_mean_error, &
                               label_type('m^2', 'standard error of pseudo_variance_mean', dof))
      call group%put_allocated('pseudo_variance_percentiles', &
                               statistics%pseudo_variance_percentiles, &
                               label_type('m^2', 'integral of each percentile, Eq. (46)', &
                                          percentile_axes))
      call group%put_allocated('pseudo_variance_percentiles_error', &
                               statistics%pseudo_variance_percentiles_error, &
                               label_type('m^2', 'standard error of pseudo_variance_percentiles', &
                                          percentile_axes))
      call group%put_allocated('band_ratio', statistics%band_ratio, &
                               label_type('1', &
                                          'pseudo-variance of the last over the first percentile', &
                                          dof))
      call group%put_allocated('band_ratio_low', statistics%band_ratio_low, &
                               label_type('1', 'lower end of the 95 % interval of band_ratio', &
                                          dof))
      call group%put_allocated('band_ratio_high', statistics%band_ratio_high, &
                               label_type('1', 'upper end of the 95 % interval of band_ratio', &
                                          dof))
      call group%put_allocated('band_ratio_bias', statistics%band_ratio_bias, &
                               label_type('1', 'relative bias of band_ratio, by bootstrap', dof))
      if (.not. allocated(statistics%band_ratio_time_error)) return
      call group%attribute('band_ratio_time_error_method', &
                           'scatter of consecutive batches of the march')
      call group%put_allocated('pseudo_variance_mean_time_error', &
                               statistics%pseudo_variance_mean_time_error, &
                               label_type('m^2', 'standard error of pseudo_variance_mean'// &
                                          not_lowered, dof))
      call group%put_allocated('pseudo_variance_percentiles_time_error', &
                               statistics%pseudo_variance_percentiles_time_error, &
                               label_type('m^2', 'standard error of pseudo_variance_percentiles'// &
                                          not_lowered, percentile_axes))
      call group%put_allocated('band_ratio_time_error', statistics%band_ratio_time_error, &
                               label_type('1', 'standard error of band_ratio'//not_lowered, dof))
   end subroutine write_bands

   subroutine write_history_axes(group, plan, force)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      !> (step, force, or force and sample)
      real(wp), intent(in), contiguous, optional :: force(:, :)
      integer :: i, n_forces

      n_forces = plan%structure%n_forces
      call group%put('time', [(i*plan%integration%dt, i=0, plan%integration%n_steps)], &
                     label_type('s', 'time', 'time'))
      if (.not. present(force)) return
      if (n_forces > 1) call group%put('force_number', counted(n_forces), &
                                       label_type('1', 'force, a column of the load', &
                                                  'force_number'))
      if (size(force, 2) == 1) then
         call group%put('force', force(:, 1), label_type('N', 'force', 'time'))
      else if (n_forces == 1) then
         call group%put('force', force, label_type('N', 'force', 'sample time'))
      else if (size(force, 2) == n_forces) then
         call group%put('force', force, label_type('N', 'force', 'force_number time'))
      else
         call group%put_allocated('force', by_sample(force, n_forces), &
                                  label_type('N', 'force', 'sample force_number time'))
      end if
   end subroutine write_history_axes

   !> (step, force and sample) as (step, force, sample)
   pure function by_sample(force, n_forces) result(parted)
      real(wp), intent(in) :: force(:, :)
      integer, intent(in) :: n_forces
      real(wp), allocatable :: parted(:, :, :)

      parted = reshape(force, [size(force, 1), n_forces, size(force, 2)/n_forces])
   end function by_sample

end module io_case_results
