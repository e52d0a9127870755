!> Writes the results file: processes, samples from the shards, and statistics of every case.
module driver_results
   use campaign_columns, only: sample_groups
   use campaign_comparison, only: compare_slip, numerical_error, spectrum_comparison
   use campaign_plan, only: audit_of, kept_dofs, plan_type
   use campaign_results, only: block_result, case_estimates, case_statistics, spectrum_layout
   use campaign_runner, only: runner_type
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: new_stream, stream_type
   use driver_deadline, only: seconds_so_far
   use driver_output, only: output_type
   use driver_regression, only: find_estimates
   use driver_statistics, only: case_task, open_case
   use io_blocks, only: write_block
   use io_case_statistics, only: write_audit, write_estimates
   use io_hdf5, only: hdf5_file, hdf5_group
   use io_process_results, only: write_process
   use io_results, only: begin_case, finish_case, finish_results, write_structure
   use io_shards, only: remove_merged_shards, stored_samples
   use io_store, only: discard_file
   use parallel_world, only: attend_to_others
   use process_model, only: process_model_type, request_label
   use process_realization, only: draw_points
   implicit none(type, external)
   private
   public :: write_results

contains

   !> Writes the results file and removes the shards that it contains. The root writes; all ranks
   !> share the statistics. Collective.
   subroutine write_results(plan, models, runner, output, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(in) :: runner
      type(output_type), intent(inout) :: output
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      if (output%world%is_root()) call output%begin_file(plan, file, error)
      if (output%world%any_true(allocated(error))) return
      if (output%world%is_root()) call write_processes(plan, models, file, error)
      if (.not. output%world%any_true(allocated(error)) .and. plan%has_structure) &
         call write_cases(plan, models, runner, output, file, error)
      if (output%world%any_true(allocated(error))) then
         if (output%world%is_root()) call discard_file(file)
      else if (output%world%is_root()) then
         call finish_results(file, output%lock, seconds_so_far(), error)
         if (.not. allocated(error)) &
            call remove_merged_shards(output%store, output%lock, [plan%cases%n_samples], error)
      end if
   end subroutine write_results

   !> Writes the processes and the requested realizations.
   subroutine write_processes(plan, models, file, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(hdf5_file), intent(in) :: file
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:, :)   ! (point, realization)
      type(stream_type) :: stream
      integer :: i, k

      do i = 1, size(models)
         ! a replay leaves processes that it does not need unsolved, without a reason
         if (.not. (models(i)%is_solved .or. allocated(models(i)%reason))) cycle
         if (allocated(values)) deallocate (values)
         if (plan%n_realizations > 0 .and. models(i)%is_solved .and. &
             plan%processes(i)%method /= 'values') then
            allocate (values(plan%n_points, plan%n_realizations))
            do k = 1, plan%n_realizations
               stream = new_stream(plan%seed, request_label(models(i)%request), k)
               call draw_points(models(i), stream, values(:, k))
            end do
         end if
         call write_process(file, i, models(i), error, values)
         if (allocated(error)) return
      end do
   end subroutine write_processes

   !> Writes the structure and the cases, then the best estimates, which use samples of several
   !> cases. While the root writes the long data of a case and the short data of the next one, the
   !> other ranks compute statistics of the next one. Collective.
   subroutine write_cases(plan, models, runner, output, file, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(in) :: runner
      type(output_type), intent(in) :: output
      type(hdf5_file), intent(in) :: file
      type(error_type), allocatable, intent(out) :: error
      type(stored_samples) :: stored
      type(case_task), allocatable :: tasks(:)   ! statistics of a case and of the next one
      type(case_statistics) :: statistics(size(plan%cases))
      type(case_estimates) :: estimates(size(plan%cases))
      type(hdf5_group) :: groups(size(plan%cases))
      integer, allocatable :: numbers(:)
      integer :: i, k

      if (output%world%is_root()) call write_structure(file, plan, error)
      if (output%world%any_true(allocated(error))) return
      call output%list_stored(plan, stored, error)
      if (output%world%any_true(allocated(error))) return
      ! spectra that finish_case does not copy are checked here
      if (plan%output%spectrum .and. .not. plan%output%samples) then
         call output%verify(stored, error)
         if (output%world%any_true(allocated(error))) return
      end if
      numbers = pack([(i, i=1, size(plan%cases))], &
                     plan%cases%n_samples > 0 .and. plan%cases%audits == 0)
      allocate (tasks(0:1))
      if (size(numbers) > 0) call open_task(1)
      do k = 1, size(numbers)
         associate (task => tasks(modulo(k, 2)), number => numbers(k))
            if (output%world%is_root() .and. .not. allocated(error)) &
               call begin_group(plan, number, runner, stored, file, groups(number), error)
            call task%finish(output%world, plan, stored, statistics(number), error)
            if (output%world%any_true(allocated(error))) return
            if (k < size(numbers)) call open_task(k + 1)
            if (.not. output%world%is_root()) cycle
            call finish_case(groups(number), plan, number, stored, error)
            if (audit_of(plan, number) > 0 .and. .not. allocated(error)) &
               call finish_audit(plan, audit_of(plan, number), runner%layout, stored, file, error)
         end associate
      end do
      deallocate (tasks)
      if (output%world%any_true(allocated(error))) return
      call find_estimates(output%world, plan, models, stored, &
                          pack(runner%layout%frequency, plan%output%spectrum), statistics, &
                          estimates, error)
      if (allocated(error) .or. .not. output%world%is_root()) return
      do k = 1, size(numbers)
         call write_estimates(groups(numbers(k)), statistics(numbers(k)), &
                              estimates(numbers(k)), error)
         if (allocated(error)) return
      end do

   contains

      !> Opens the statistics of the k-th case.
      subroutine open_task(k)
         integer, intent(in) :: k

         call open_case(output%world, plan, numbers(k), tasks(modulo(k, 2)), runner%layout)
      end subroutine open_task

   end subroutine write_cases

   !> Creates the group of a case and writes the short data of its samples: all but series, spectra,
   !> histories and transitions.
   subroutine begin_group(plan, number, runner, stored, file, group, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number   !! case number
      type(runner_type), intent(in) :: runner
      type(stored_samples), intent(in) :: stored
      type(hdf5_file), intent(in) :: file
      type(hdf5_group), intent(out) :: group
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: folded_share(:)   ! (dof)
      real(wp), allocatable :: force(:, :)       ! (0:n_steps, record) [N], only with histories
      type(block_result) :: samples
      integer, allocatable :: first(:)
      integer :: g

      associate (case => plan%cases(number))
         if (plan%output%history) then
            allocate (force(0:plan%integration%n_steps, plan%structure%n_forces &
                            *merge(case%n_samples, 1, plan%excitation%per_sample)))
            call runner%force_of(number, case%first_sample, force)
         end if
         folded_share = [real(wp) ::]
         if (plan%output%spectrum) folded_share = runner%folded_share(:, number)
         call begin_case(file, plan, number, runner%layout, folded_share, group, force)
         first = sample_groups(case%n_samples)
      end associate
      do g = 1, size(first) - 1
         call attend_to_others()
         call stored%read(number, first(g), first(g + 1) - 1, samples, error)
         if (allocated(error)) return
         call write_block(group, plan, samples)
      end do
   end subroutine begin_group

   !> Compares an audit with the samples that it repeats, spectra some frequencies at a time, and
   !> writes the errors. Only for the root.
   subroutine finish_audit(plan, audit, layout, stored, file, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: audit   !! its case number
      type(spectrum_layout), intent(in) :: layout
      type(stored_samples), intent(in) :: stored
      type(hdf5_file), intent(in) :: file
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: tested, reference
      type(numerical_error) :: errors
      type(spectrum_comparison) :: comparison
      real(wp), allocatable :: psd(:, :, :), reference_psd(:, :, :)   ! (dof, frequency, sample)
      integer :: f, n_at_once, n_dof, n_frequencies

      associate (audited => plan%cases(audit)%audits, n => plan%cases(audit)%n_samples)
         call stored%read(audited, 1, n, tested, error)
         if (.not. allocated(error)) call stored%read(audit, 1, n, reference, error)
         if (allocated(error)) return
         call compare_slip(tested%slip_fraction, reference%slip_fraction, &
                           plan%cases(audited)%n_samples, errors)
         n_dof = size(kept_dofs(plan))
         n_frequencies = size(layout%frequency)
         n_at_once = frequencies_together(n_dof, n_frequencies)
         do f = 1, merge(n_frequencies, 0, plan%output%spectrum), n_at_once
            allocate (psd(n_dof, min(n_at_once, n_frequencies - f + 1), n))
            allocate (reference_psd, mold=psd)
            call stored%read_part(audited, 'psd', [1, f, 1], psd, error)
            if (.not. allocated(error)) &
               call stored%read_part(audit, 'psd', [1, f, 1], reference_psd, error)
            if (allocated(error)) return
            call comparison%add(psd, reference_psd, plan%output%percentiles)
            deallocate (psd, reference_psd)
         end do
         if (plan%output%spectrum) call comparison%finish(plan%cases(audited)%n_samples, errors)
      end associate
      call write_audit(file, plan, audit, reference, layout, errors, stored, error)
   end subroutine finish_audit

end module driver_results
