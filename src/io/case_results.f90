!> One case of a campaign as a group of the results file: samples, statistics, and what is long
!> taken from the shards one at a time.
module io_case_results
   use core_error, only: error_type
   use core_kinds, only: wp
   use dynamics_response, only: transition_list
   use ensemble_plan, only: output_settings, plan_type
   use ensemble_results, only: block_result, case_statistics, spectrum_layout
   use ensemble_time_average, only: count_spans, time_average_method
   use io_blocks, only: sample_label
   use io_gathering, only: count_transitions, shards_of
   use io_group, only: counted, group_type, new_group
   use io_hdf5, only: label_type
   use io_process_results, only: process_name
   use io_results, only: results_writer
   use io_shards, only: read_shard, shard_store, shard_type
   implicit none(type, external)
   private
   public :: case_group, case_name, energy_terms, write_case, write_frequency, write_long, &
             write_samples

   !> Datasets of the energy ledger, in the order of its terms.
   character(*), parameter :: energy_terms(*) = [character(15) :: 'energy_input', &
                                                 'energy_viscous', 'energy_friction', &
                                                 'energy_stored', 'energy_defect']

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

   !> All of a case. `samples` is what read_samples gave; spectra, histories and transitions come
   !> from the shards; `force` is the record, or one for each sample, and belongs to histories.
   subroutine write_case(writer, plan, number, samples, layout, statistics, store, shards, error, &
                         force)
      type(results_writer), intent(in) :: writer
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(block_result), intent(in) :: samples
      type(spectrum_layout), intent(in) :: layout
      type(case_statistics), intent(in) :: statistics
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), contiguous, optional :: force(:, :)   !! (step, 1 or sample) [N]
      type(group_type) :: group

      group = new_group(writer%file, case_group(number, size(plan%cases)))
      call write_attributes(group, plan, number)
      call group%put('sample', counted(samples%n_samples), label_type('1', 'sample', 'sample'))
      call group%put('dof', counted(plan%chain%n_dof), &
                     label_type('1', 'mass, from the wall', 'dof'))
      call write_samples(group, samples)
      call write_slip_statistics(group, statistics)
      call write_time_averages(group, plan, statistics)
      if (plan%output%spectrum) then
         call write_spectrum_axes(group, plan, layout, samples)
         call write_bands(group, statistics)
      end if
      if (plan%output%history) call write_history_axes(group, plan, force)
      call write_long(group, plan, plan%output, layout, samples%n_samples, store, &
                      shards_of(shards, number, samples%n_samples))
      call group%take_error(error)
   end subroutine write_case

   subroutine write_attributes(group, plan, number)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      associate (case => plan%cases(number))
         call group%attribute('process', process_name(case%process))
         call group%attribute('variance', case%variance)
         call group%attribute('n_samples', case%n_samples)
         if (case%process == 0) return
         call group%attribute('std', plan%processes(case%process)%std)
         call group%attribute('correlation_length', plan%processes(case%process)%correlation_length)
      end associate
   end subroutine write_attributes

   !> What there is one value of per sample, or per sample and dof.
   subroutine write_samples(group, samples)
      type(group_type), intent(inout) :: group
      type(block_result), intent(in) :: samples
      character(*), parameter :: meaning(*) = [character(40) :: 'work of the force', &
                                               'work of the viscous damping', &
                                               'work of the friction', &
                                               'kinetic and strain energy at the end', &
                                               'what the balance of energies lacks']
      type(label_type) :: label
      real(wp), allocatable :: term(:)
      integer :: i

      call group%put_allocated('friction', samples%friction, sample_label('friction'))
      call group%put_allocated('slip_fraction', samples%slip_fraction, &
                               sample_label('slip_fraction'))
      call group%put('slip_starts', samples%slip_starts, sample_label('slip_starts'))
      call group%put('stick_starts', samples%stick_starts, sample_label('stick_starts'))
      call group%put_allocated('folded_share', samples%folded_share, sample_label('folded_share'))
      if (.not. allocated(samples%energy)) return
      label = label_type('J', '', 'sample')
      do i = 1, size(energy_terms)
         term = samples%energy(i, :)
         label%long_name = trim(meaning(i))
         call group%put(trim(energy_terms(i)), term, label)
      end do
   end subroutine write_samples

   subroutine write_slip_statistics(group, statistics)
      type(group_type), intent(inout) :: group
      type(case_statistics), intent(in) :: statistics

      if (.not. allocated(statistics%slip_mean)) return
      call group%attribute('slip_mean_error_method', 'standard deviation over root of n_samples')
      call group%attribute('slip_std_error_method', 'fourth central moment, any law')
      call group%put_allocated('slip_mean', statistics%slip_mean, &
                               label_type('1', 'mean over samples of slip_fraction', 'dof'))
      call group%put_allocated('slip_mean_error', statistics%slip_mean_error, &
                               label_type('1', 'standard error of slip_mean', 'dof'))
      call group%put_allocated('slip_std', statistics%slip_std, &
                               label_type('1', 'standard deviation over samples of slip_fraction', &
                                          'dof'))
      call group%put_allocated('slip_std_error', statistics%slip_std_error, &
                               label_type('1', 'standard error of slip_std', 'dof'))
   end subroutine write_slip_statistics

   !> The slip series' axis, and what its autocovariance tells of errors.
   subroutine write_time_averages(group, plan, statistics)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(in) :: statistics

      if (.not. plan%output%slip) return
      call group%put('span', counted(count_spans(plan%integration)), &
                     label_type('1', 'equal span of the time that is measured', 'span'))
      if (.not. allocated(statistics%slip_fraction_error)) return
      call group%attribute('time_average_method', time_average_method)
      call group%put('slip_fraction_error', statistics%slip_fraction_error, &
                     label_type('1', 'standard error of slip_fraction: the march is finite', &
                                'sample dof'))
      call group%put_allocated('slip_mean_time_error', statistics%slip_mean_time_error, &
                               label_type('1', 'standard error of slip_mean that more samples '// &
                                          'do not lower: the march is finite', 'dof'))
      call group%put_allocated('slip_std_time_part', statistics%slip_std_time_part, &
                               label_type('1', 'part of slip_std that the finite march adds', &
                                          'dof'))
   end subroutine write_time_averages

   subroutine write_spectrum_axes(group, plan, layout, samples)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(spectrum_layout), intent(in) :: layout
      type(block_result), intent(in) :: samples

      call write_frequency(group, layout)
      call group%put('percentile', plan%output%percentiles, &
                     label_type('%', 'percentile over samples', 'percentile'))
      call group%attribute('window', 'periodic Hann')
      call group%attribute('detrending', 'mean of each segment')
      call group%attribute('segment_length', layout%segment_length)
      call group%attribute('overlap', layout%overlap)
      call group%attribute('n_segments', layout%n_segments)
      call group%attribute('every', layout%every)
      call group%attribute('sided', 'one')
      if (allocated(samples%folded_share)) then
         call group%attribute('folded_share', maxval(samples%folded_share))
      end if
   end subroutine write_spectrum_axes

   !> The axis of the spectra, and how they are formed.
   subroutine write_frequency(group, layout)
      type(group_type), intent(inout) :: group
      type(spectrum_layout), intent(in) :: layout

      call group%put('frequency', layout%frequency, label_type('Hz', 'frequency', 'frequency'))
   end subroutine write_frequency

   subroutine write_bands(group, statistics)
      type(group_type), intent(inout) :: group
      type(case_statistics), intent(in) :: statistics

      if (.not. allocated(statistics%psd_mean)) return
      call group%attribute('psd_percentiles_interval_method', 'order statistics, binomial, 95 %')
      call group%attribute('band_ratio_interval_method', &
                           'bootstrap over samples, of the logarithm, 95 %')
      call group%attribute('pseudo_variance_percentiles_error_method', 'bootstrap over samples')
      call group%put_allocated('psd_mean', statistics%psd_mean, &
                               label_type('m^2/Hz', 'mean over samples of psd', 'frequency dof'))
      call group%put_allocated('psd_mean_error', statistics%psd_mean_error, &
                               label_type('m^2/Hz', 'standard error of psd_mean', 'frequency dof'))
      call group%put_allocated('psd_percentiles', statistics%psd_percentiles, &
                               label_type('m^2/Hz', 'percentiles over samples of psd', &
                                          'percentile frequency dof'))
      call group%put_allocated('psd_percentiles_low', statistics%psd_percentiles_low, &
                               label_type('m^2/Hz', 'lower end of the 95 % interval', &
                                          'percentile frequency dof'))
      call group%put_allocated('psd_percentiles_high', statistics%psd_percentiles_high, &
                               label_type('m^2/Hz', 'upper end of the 95 % interval', &
                                          'percentile frequency dof'))
      call group%put_allocated('pseudo_variance_mean', statistics%pseudo_variance_mean, &
                               label_type('m^2', 'integral of psd_mean over frequency, Eq. (46)', &
                                          'dof'))
      call group%put_allocated('pseudo_variance_mean_error', &
                               statistics%pseudo_variance_mean_error, &
                               label_type('m^2', 'standard error of pseudo_variance_mean', 'dof'))
      call group%put_allocated('pseudo_variance_percentiles', &
                               statistics%pseudo_variance_percentiles, &
                               label_type('m^2', 'integral of each percentile, Eq. (46)', &
                                          'percentile dof'))
      call group%put_allocated('pseudo_variance_percentiles_error', &
                               statistics%pseudo_variance_percentiles_error, &
                               label_type('m^2', 'standard error of pseudo_variance_percentiles', &
                                          'percentile dof'))
      call group%put_allocated('band_ratio', statistics%band_ratio, &
                               label_type('1', &
                                          'pseudo-variance of the last over the first percentile', &
                                          'dof'))
      call group%put_allocated('band_ratio_low', statistics%band_ratio_low, &
                               label_type('1', 'lower end of the 95 % interval of band_ratio', &
                                          'dof'))
      call group%put_allocated('band_ratio_high', statistics%band_ratio_high, &
                               label_type('1', 'upper end of the 95 % interval of band_ratio', &
                                          'dof'))
      call group%put_allocated('band_ratio_bias', statistics%band_ratio_bias, &
                               label_type('1', 'relative bias of band_ratio, by bootstrap', 'dof'))
   end subroutine write_bands

   subroutine write_history_axes(group, plan, force)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      real(wp), intent(in), contiguous, optional :: force(:, :)   !! (step, 1 or sample)
      integer :: i, n

      n = plan%integration%n_steps + 1
      call group%put('step', counted(n) - 1, label_type('1', 'step', 'step'))
      call group%put('time', [(i*plan%integration%dt, i=0, n - 1)], label_type('s', 'time', 'step'))
      if (.not. present(force)) return
      if (size(force, 2) == 1) then
         call group%put('force', force(:, 1), label_type('N', 'force on the forced mass', 'step'))
      else
         call group%put('force', force, label_type('N', 'force on the forced mass', 'sample step'))
      end if
   end subroutine write_history_axes

   !> Series, spectra, histories and transitions, one shard after the other.
   subroutine write_long(group, plan, kept, layout, n_samples, store, shards)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(output_settings), intent(in) :: kept   !! of the case
      type(spectrum_layout), intent(in) :: layout
      integer, intent(in) :: n_samples
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of this case
      type(block_result) :: block
      integer :: first, i, n, n_rows

      n_rows = 0
      call make_long(group, plan, kept, layout, n_samples, shards)
      do i = 1, size(shards)
         if (allocated(group%error)) return
         call read_shard(store, shards(i), block, group%error)
         if (allocated(group%error)) return
         first = block%first_sample
         n = min(block%n_samples, n_samples - first + 1)
         if (kept%slip) &
            call group%put_part('slip_series', [1, 1, first], block%slip_series(:, :, :n))
         if (kept%spectrum) call group%put_part('psd', [1, 1, first], block%psd(:, :, :n))
         if (kept%history) then
            call group%put_part('displacement', [1, 1, first], block%displacement(:, :, :n))
            call group%put_part('velocity', [1, 1, first], block%velocity(:, :, :n))
         end if
         if (kept%transitions) then
            call put_transitions(group, first, block%transitions(:n), n_rows)
         end if
      end do
   end subroutine write_long

   subroutine make_long(group, plan, kept, layout, n_samples, shards)
      type(group_type), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      type(output_settings), intent(in) :: kept
      type(spectrum_layout), intent(in) :: layout
      integer, intent(in) :: n_samples
      type(shard_type), intent(in) :: shards(:)
      integer :: n_dof, n_rows, n_steps

      n_dof = plan%chain%n_dof
      n_steps = plan%integration%n_steps + 1
      if (kept%slip) then
         call group%make('slip_series', 0.0_wp, &
                         [n_dof, count_spans(plan%integration), n_samples], &
                         sample_label('slip_series'))
      end if
      if (kept%spectrum) then
         call group%make('psd', 0.0_wp, [n_dof, size(layout%frequency), n_samples], &
                         sample_label('psd'))
      end if
      if (kept%history) then
         call group%make('displacement', 0.0_wp, [n_dof, n_steps, n_samples], &
                         sample_label('displacement'))
         call group%make('velocity', 0.0_wp, [n_dof, n_steps, n_samples], sample_label('velocity'))
      end if
      if (kept%transitions .and. .not. allocated(group%error)) then
         call count_transitions(shards, n_samples, n_rows, group%error)
         call group%put('transition', counted(n_rows), label_type('1', 'transition', 'transition'))
         call group%make('transition_sample', 0, [n_rows], &
                         label_type('1', 'sample of the transition', 'transition'))
         call group%make('transition_time', 0.0_wp, [n_rows], &
                         label_type('s', 'time of the transition', 'transition'))
         call group%make('transition_dof', 0, [n_rows], &
                         label_type('1', 'mass of the transition', 'transition'))
         call group%make('transition_kind', 0, [n_rows], &
                         label_type('1', '+1, -1: slip starts in that direction; 0: sticks', &
                                    'transition'))
      end if
   end subroutine make_long

   !> The transitions of some samples, below the rows that are filled already.
   subroutine put_transitions(group, first_sample, transitions, n_rows)
      type(group_type), intent(inout) :: group
      integer, intent(in) :: first_sample
      type(transition_list), intent(in) :: transitions(:)
      integer, intent(inout) :: n_rows
      integer :: i

      do i = 1, size(transitions)
         associate (list => transitions(i), row => [n_rows + 1])
            if (list%n == 0) cycle
            call group%put_part('transition_sample', row, spread(first_sample + i - 1, 1, list%n))
            call group%put_part('transition_time', row, list%time(:list%n))
            call group%put_part('transition_dof', row, list%dof(:list%n))
            call group%put_part('transition_kind', row, list%kind(:list%n))
         end associate
         n_rows = n_rows + transitions(i)%n
      end do
   end subroutine put_transitions

end module io_case_results
