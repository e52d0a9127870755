!> The results file: the structure, the axes, attributes and samples of each case, and its end,
!> after which the file is complete or there is none. io_case_statistics writes the statistics of a
!> case, io_process_results the processes.
module io_results
   use campaign_plan, only: kept_dofs, kept_of, output_settings, plan_type
   use campaign_results, only: block_result, spectrum_layout
   use campaign_time_average, only: count_spans, fewest_spans, time_average_method
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_text, only: numbered
   use io_blocks, only: write_block
   use io_contents, only: check_contents, write_contents
   use io_files, only: folder_of, sync_file
   use io_hdf5, only: hdf5_file, hdf5_group, hdf5_object, new_group, open_hdf5
   use io_lock, only: lock_type
   use io_shards, only: read_shard, shard_type, stored_samples
   use io_store, only: discard_file
   use numerics_correlated, only: n_batches
   use numerics_sparse, only: sparse_matrix, sparse_of
   use numerics_spectrum, only: error_of_density, last_of_ranges
   implicit none(type, external)
   private
   public :: begin_case, case_group, finish_case, finish_results, write_dofs, write_structure

   character(*), parameter :: &
      about_dofs = 'degree of freedom; of a chain: mass, from the wall', &
      about_joints = 'joint; of a chain: that of the mass of this number'

contains

   !> Writes the method and the step of the march, and the structure: axes, natural frequencies, M,
   !> C and K by their entries, joints, load.
   subroutine write_structure(file, plan, error)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_group) :: group

      group = new_group(file, '/structure')
      call group%attribute('method', trim(plan%integration%method))
      call group%attribute('n_zero_modes', plan%structure%n_zero_modes)
      call group%put_value('dt', plan%integration%dt, 's', 'time step')
      associate (structure => plan%structure)
         call group%put_axis('mode', structure%n_dof, 'mode, from the lowest')
         call group%put_axis('dof', structure%n_dof, about_dofs)
         call group%put_axis('joint', structure%n_joints, about_joints)
         call group%put_axis('force', structure%n_forces, 'force, a column of the load')
         call group%put('frequencies_stuck', structure%frequencies_stuck, 'Hz', &
                        'natural frequency with all joints stuck', 'mode')
         call group%put('frequencies_slip', structure%frequencies_slip, 'Hz', &
                        'natural frequency with all joints slipping; negative: unstable', 'mode')
         if (size(structure%damping_ratio) > 0) &
            call group%put('damping_ratio', structure%damping_ratio, '1', &
                           'damping ratio with all joints stuck', 'mode')
         call write_entries(group, 'mass', 'kg', structure%mass)
         call write_entries(group, 'stiffness', 'N/m', structure%stiffness)
         call write_entries(group, 'damping', 'N s/m', structure%damping)
         call group%put('joint_stiffness', structure%joint_stiffness, 'N/m', &
                        'stiffness of the joint while it sticks', 'joint')
         call group%put('normal_load', structure%normal_load, 'N', 'normal load of the joint', &
                        'joint')
         call group%put('joint_friction', structure%joint_friction, '1', &
                        'friction coefficient as given', 'joint')
         call group%put('friction_point', structure%friction_point, '1', &
                        'point of the process that gives the friction', 'joint')
         call group%put('directions', structure%direction, '1', 'direction of the joint', &
                        'joint dof')
         call group%put('load', structure%load, trim(merge('kg', '1 ', plan%excitation%base)), &
                        'factor of the force', 'force dof')
      end associate
      call group%take_error(error)
   end subroutine write_structure

   !> Writes the nonzero entries of a matrix, row by row.
   subroutine write_entries(group, name, unit, matrix)
      type(hdf5_group), intent(inout) :: group
      character(*), intent(in) :: name, unit
      real(wp), intent(in) :: matrix(:, :)
      type(sparse_matrix) :: entries
      character(:), allocatable :: axis

      entries = sparse_of(matrix)
      axis = name//'_entry'
      call group%put_axis(axis, size(entries%value), 'entry')
      call group%put(name//'_row', entries%row_of_entries(), '1', 'row', axis)
      call group%put(name//'_column', entries%column, '1', 'column', axis)
      call group%put(name//'_value', entries%value, unit, 'value', axis)
   end subroutine write_entries

   !> Path of the group of a case or audit. Audits have the numbers after all cases, in the same
   !> order; each lies in the group of the case that it repeats.
   pure function case_group(number, n_cases) result(group)
      integer, intent(in) :: number
      integer, intent(in) :: n_cases   !! number of cases without audits
      character(:), allocatable :: group

      if (number <= n_cases) then
         group = '/campaign/'//numbered('c', number)
      else
         group = '/campaign/'//numbered('c', number - n_cases)//'/audit'
      end if
   end function case_group

   !> Creates the group of a case and writes its attributes and axes, and the force if histories are
   !> kept. The group keeps an error.
   subroutine begin_case(file, plan, number, layout, folded_share, group, force)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(spectrum_layout), intent(in) :: layout
      real(wp), intent(in), contiguous :: folded_share(:)   !! (dof); empty without a pilot march
      type(hdf5_group), intent(out) :: group
      !> (step, force; or step, force and sample) [N], or of a moving base [m/s^2]
      real(wp), intent(in), contiguous, optional :: force(:, :)
      character(:), allocatable :: axes
      integer :: i

      group = new_group(file, case_group(number, size(plan%cases)))
      call write_attributes(group, plan, number)
      associate (case => plan%cases(number))
         call group%put_axis('sample', case%n_samples, 'sample', case%first_sample)
      end associate
      call write_dofs(group, plan)
      if (plan%output%slip) then
         call group%put_axis('span', count_spans(plan%integration), &
                             'equal span of the time that is measured')
         if (count_spans(plan%integration) >= fewest_spans) &
            call group%attribute('time_average_method', time_average_method)
      end if
      if (plan%cases(number)%process > 0 .and. plan%cases(number)%n_samples > 1) &
         call group%put('percentile', plan%output%percentiles, '%', 'percentile over samples', &
                        'percentile')
      if (plan%output%spectrum) call write_spectrum_axes(group, layout, folded_share)
      if (.not. plan%output%history) return
      call group%put('time', [(i*plan%integration%dt, i=0, plan%integration%n_steps)], 's', &
                     'time', 'time')
      axes = 'time'
      associate (n_forces => plan%structure%n_forces, per_sample => plan%excitation%per_sample)
         if (n_forces > 1) then
            call group%put_axis('force_number', n_forces, 'force, a column of the load')
            axes = 'force_number '//axes
         end if
         if (per_sample) axes = 'sample '//axes
         call group%put('force', force, trim(merge('m/s^2', 'N    ', plan%excitation%base)), &
                        'force', axes, &
                        extents=pack([size(force, 1), n_forces, size(force, 2)/n_forces], &
                                     [.true., n_forces > 1, per_sample]))
      end associate
   end subroutine begin_case

   !> Writes the long datasets of a case, shard by shard, so that memory does not grow with the
   !> number of samples; without output%samples no series and spectra. `error` is the first of all
   !> in the group.
   subroutine finish_case(group, plan, number, stored, error)
      type(hdf5_group), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(stored_samples), intent(in) :: stored
      type(error_type), allocatable, intent(out) :: error
      type(output_settings) :: kept
      type(block_result) :: block
      type(shard_type), allocatable :: shards(:)
      integer :: i, n_transitions, n_written
      logical :: is_lean   ! without series and spectra

      kept = kept_of(plan, number)
      is_lean = kept%spectrum .and. .not. kept%keeps_spectra(plan%cases(number)%n_samples)
      shards = stored%shards_of(number, 1, plan%cases(number)%n_samples)
      n_transitions = 0
      n_written = 0
      if (kept%transitions) then
         if (.not. allocated(group%error)) &
            call stored%count_transitions(number, plan%cases(number)%n_samples, n_transitions, &
                                          group%error)
         call group%put_axis('transition', n_transitions, 'transition')
      end if
      do i = 1, size(shards)
         if (is_lean .and. .not. (kept%transitions .or. kept%history)) exit
         if (allocated(group%error)) exit
         call read_shard(stored%store, shards(i), block, group%error)
         if (allocated(group%error)) exit
         if (is_lean) then
            if (allocated(block%slip_series)) deallocate (block%slip_series)
            if (allocated(block%psd)) deallocate (block%psd)
            if (allocated(block%power_series)) deallocate (block%power_series)
         end if
         call write_block(group, plan, block, n_written, n_transitions)
      end do
      call group%take_error(error)
   end subroutine finish_case

   !> Writes the axes of dofs and joints, and that of the dofs with spectra and histories unless all
   !> have them.
   subroutine write_dofs(group, plan)
      type(hdf5_group), intent(inout) :: group
      type(plan_type), intent(in) :: plan

      call group%put_axis('dof', plan%structure%n_dof, about_dofs)
      call group%put_axis('joint', plan%structure%n_joints, about_joints)
      if (size(kept_dofs(plan)) == plan%structure%n_dof) return
      group%kept_axis = 'kept_dof'
      call group%put('kept_dof', kept_dofs(plan), '1', &
                     'dof whose spectra and histories are kept', 'kept_dof')
   end subroutine write_dofs

   !> Writes the excitation, the process, the samples and the duration of a case as attributes.
   subroutine write_attributes(group, plan, number)
      type(hdf5_group), intent(inout) :: group
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number

      associate (case => plan%cases(number))
         call group%attribute('variance', merge(case%strength, 0.0_wp, &
                                                plan%excitation%kind == 'band_limited'))
         if (plan%excitation%kind == 'sine') then
            call group%attribute('frequency', case%frequency)
            call group%attribute('amplitude', case%strength)
         else if (plan%excitation%kind /= 'band_limited') then
            call group%attribute('factor', case%strength)
         end if
         call group%attribute('n_samples', case%n_samples)
         call group%attribute('duration', plan%integration%dt* &
                              (plan%integration%n_steps - plan%integration%n_discard))
         if (case%process == 0) then
            call group%attribute('process', 'none')
            call group%attribute('friction_from', plan%friction_from)
         else
            call group%attribute('process', numbered('p', case%process))
            associate (process => plan%processes(case%process))
               call group%attribute('std', process%std)
               if (process%method /= 'values') &
                  call group%attribute('correlation_length', process%correlation_length)
            end associate
         end if
      end associate
   end subroutine write_attributes

   !> Writes the frequencies, the parameters of Welch's method, and the axes of batches.
   subroutine write_spectrum_axes(group, layout, folded_share)
      type(hdf5_group), intent(inout) :: group
      type(spectrum_layout), intent(in) :: layout
      real(wp), intent(in), contiguous :: folded_share(:)   !! (dof)

      call group%put('frequency', layout%frequency, 'Hz', 'frequency', 'frequency')
      call group%attribute('window', 'periodic Hann')
      call group%attribute('detrending', 'mean of each segment')
      call group%attribute('segment_length', layout%segment_length)
      call group%attribute('overlap', layout%overlap)
      call group%attribute('n_segments', layout%n_segments)
      call group%attribute('psd_time_error', error_of_density(layout%n_segments))
      call group%attribute('every', layout%every)
      call group%attribute('sided', 'one')
      if (layout%follows_power) then
         call group%put_axis('batch', size(batch_frequencies(layout)), &
                             'batch of segments in a range of frequencies')
         call group%put('batch_frequency', batch_frequencies(layout), 'Hz', &
                        'highest frequency of its range', 'batch')
      end if
      if (size(folded_share) == 0) return
      call group%attribute('folded_share', maxval(folded_share))
      call group%put('folded_share', folded_share, '1', &
                     'share of the power that thinning folds below the highest frequency, in a '// &
                     'pilot march', 'dof')
   end subroutine write_spectrum_axes

   !> Highest frequency [Hz] of the range of each value of a power series.
   pure function batch_frequencies(layout) result(highest)
      type(spectrum_layout), intent(in) :: layout
      real(wp), allocatable :: highest(:)
      integer :: i

      associate (last => last_of_ranges(size(layout%frequency)))
         highest = [(spread(layout%frequency(last(i)), 1, n_batches), i=1, size(last))]
      end associate
   end function batch_frequencies

   !> Closes the file, reads it back, and renames it to the output, which until then is missing or
   !> the earlier file. Removes the file after an error, also after one that is passed in.
   subroutine finish_results(file, lock, wall_seconds, error)
      type(hdf5_file), intent(inout) :: file
      type(lock_type), intent(inout) :: lock   !! lock on the output
      real(wp), intent(in) :: wall_seconds     !! duration of the run
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: temporary
      type(hdf5_object) :: root

      temporary = file%path
      root = hdf5_object(file, '/')
      call root%attribute('wall_seconds', wall_seconds)
      if (.not. allocated(error)) call root%take_error(error)
      if (.not. allocated(error)) call write_contents(file, '/', error)
      if (.not. allocated(error)) call file%close(error)
      if (.not. allocated(error)) call sync_file(temporary, error)
      if (.not. allocated(error)) call open_hdf5(temporary, file, error)
      if (.not. allocated(error)) call check_contents(file, error)
      call file%abandon()
      if (.not. allocated(error)) call lock%publish(temporary, error)
      if (allocated(error)) then
         call discard_file(file)
      else
         call sync_file(folder_of(lock%output), error)   ! the new name
      end if
   end subroutine finish_results

end module io_results
