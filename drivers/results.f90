!> From shards to the results file: statistics of every case, and everything written as a whole.
module driver_results
   use config_scene, only: scene_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_random, only: new_stream, stream_type
   use driver_command_line, only: command_line
   use driver_deadline, only: seconds_so_far
   use driver_output, only: output_type
   use driver_provenance, only: provenance_of
   use ensemble_audit, only: audit_of
   use ensemble_bands, only: band_collector, start_bands
   use ensemble_comparison, only: compare_slip, compare_spectra, numerical_error
   use ensemble_plan, only: plan_type
   use ensemble_results, only: block_result, case_statistics
   use ensemble_runner, only: runner_type
   use ensemble_study, only: slip_statistics
   use ensemble_time_average, only: count_spans, fewest_spans, span_collector
   use io_audit_results, only: write_audit
   use io_case_results, only: write_case
   use io_gathering, only: read_psd_band, read_samples, read_slip_series, shards_of
   use io_process_results, only: write_process
   use io_results, only: begin_results, results_writer
   use io_shards, only: list_shards, remove_store, shard_type
   use process_model, only: process_model_type, request_label
   use process_positive, only: draw_points
   implicit none(type, external)
   private
   public :: find_slip_statistics, write_results

   real(wp), parameter :: band_memory = 64.0e6_wp   !! [byte] of spectra held at a time
   integer, parameter :: neighbours = 64            !! frequencies that shards keep together

contains

   !> Writes the results file and removes the shards it was made of; for the root alone.
   subroutine write_results(line, scene, plan, models, runner, output, n_ranks, error)
      type(command_line), intent(in) :: line
      type(scene_type), intent(in) :: scene
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(in) :: runner
      type(output_type), intent(in) :: output
      integer, intent(in) :: n_ranks
      type(error_type), allocatable, intent(out) :: error
      type(results_writer) :: writer

      call begin_results(output%path, &
                         provenance_of(scene, line%overrides, plan%title, n_ranks), writer, error)
      if (allocated(error)) return
      call write_contents(plan, models, runner, output, writer, error)
      if (allocated(error)) then
         call writer%abandon()
         return
      end if
      call writer%finish(seconds_so_far(), error)
      if (.not. allocated(error)) call remove_store(output%store, error)
   end subroutine write_results

   !> Processes, then the chain, then case by case.
   subroutine write_contents(plan, models, runner, output, writer, error)
      type(plan_type), intent(in) :: plan
      type(process_model_type), intent(in) :: models(:)
      type(runner_type), intent(in) :: runner
      type(output_type), intent(in) :: output
      type(results_writer), intent(in) :: writer
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      integer :: i

      do i = 1, size(models)
         ! neither solved nor refused: a replay did not need it
         if (.not. (models(i)%is_solved .or. allocated(models(i)%reason))) cycle
         call write_process_of(plan, i, models(i), writer, error)
         if (allocated(error)) return
      end do
      if (.not. plan%has_chain) return
      call writer%write_chain(plan%chain, error)
      if (.not. allocated(error)) call list_shards(output%store, shards, error)
      do i = 1, size(plan%cases)
         if (allocated(error)) return
         if (plan%cases(i)%n_samples > 0 .and. plan%cases(i)%audits == 0) call finish_case(i)
      end do

   contains

      !> The statistics of a case over its samples, and its group of the file.
      subroutine finish_case(number)
         integer, intent(in) :: number
         type(block_result) :: samples
         type(case_statistics) :: statistics
         real(wp), allocatable :: force(:, :)   ! (0:n_steps, 1 or sample) [N]

         call read_samples(output%store, shards, number, plan%cases(number)%n_samples, samples, &
                           error)
         if (allocated(error)) return
         call find_slip_statistics(plan, number, samples, shards, statistics, error)
         if (allocated(error)) return
         if (samples%n_samples > 1 .and. plan%output%spectrum) &
            call find_bands(plan, number, runner, output, shards, statistics, error)
         if (allocated(error)) return
         if (.not. plan%output%history) then
            call write_case(writer, plan, number, samples, runner%layout, statistics, &
                            output%store, shards, error)
            if (.not. allocated(error)) call finish_audit(number, samples)
            return
         end if
         allocate (force(0:plan%integration%n_steps, &
                         merge(samples%n_samples, 1, plan%excitation%per_sample)))
         call runner%force_of(number, plan%cases(number)%first_sample, force, error)
         if (allocated(error)) return
         call write_case(writer, plan, number, samples, runner%layout, statistics, &
                         output%store, shards, error, force)
         if (.not. allocated(error)) call finish_audit(number, samples)
      end subroutine finish_case

      !> What the audit of a case tells of its numerical error, where it has one.
      subroutine finish_audit(number, samples)
         integer, intent(in) :: number
         type(block_result), intent(in) :: samples   !! of the case
         type(block_result) :: repeated
         type(numerical_error) :: errors
         integer :: audit

         audit = audit_of(plan, number)
         if (audit == 0) return
         call read_samples(output%store, shards, audit, plan%cases(audit)%n_samples, repeated, &
                           error)
         if (allocated(error)) return
         call compare_slip(samples%slip_fraction(:, :repeated%n_samples), &
                           repeated%slip_fraction, samples%n_samples, errors)
         if (plan%output%spectrum) &
            call compare_psd(plan, audit, size(runner%layout%frequency), output, shards, errors, &
                             error)
         if (allocated(error)) return
         call write_audit(writer, plan, audit, repeated, runner%layout, errors, output%store, &
                          shards, error)
      end subroutine finish_audit

   end subroutine write_contents

   !> A process, with the realizations that were asked for.
   subroutine write_process_of(plan, number, model, writer, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(process_model_type), intent(in) :: model
      type(results_writer), intent(in) :: writer
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: values(plan%n_points, plan%n_realizations)
      type(stream_type) :: stream
      integer :: i

      if (plan%n_realizations == 0 .or. .not. model%is_solved) then
         call write_process(writer, number, model, error)
         return
      end if
      do i = 1, plan%n_realizations
         stream = new_stream(plan%seed, request_label(model%request), i)
         call draw_points(model, stream, values(:, i))
      end do
      call write_process(writer, number, model, error, values)
   end subroutine write_process_of

   !> Spectra of a case beside those of its audit.
   subroutine compare_psd(plan, audit, n_frequencies, output, shards, errors, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: audit   !! case number
      integer, intent(in) :: n_frequencies
      type(output_type), intent(in) :: output
      type(shard_type), intent(in) :: shards(:)
      type(numerical_error), intent(inout) :: errors
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: tested(:, :, :), reference(:, :, :)   ! (dof, frequency, sample)

      associate (audited => plan%cases(audit)%audits)
         allocate (tested(plan%chain%n_dof, n_frequencies, plan%cases(audit)%n_samples))
         allocate (reference, mold=tested)
         call read_psd_band(output%store, shards, audited, 1, tested, error)
         if (.not. allocated(error)) &
            call read_psd_band(output%store, shards, audit, 1, reference, error)
         if (allocated(error)) return
         call compare_spectra(tested, reference, plan%output%percentiles, &
                              plan%cases(audited)%n_samples, errors)
      end associate
   end subroutine compare_psd

   !> Statistics of the slip fractions of one case, and their errors.
   subroutine find_slip_statistics(plan, number, samples, shards, statistics, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(block_result), intent(in) :: samples   !! of the case
      type(shard_type), intent(in) :: shards(:)
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(out) :: error

      if (plan%output%slip) call find_time_averages(plan, number, shards, statistics, error)
      if (allocated(error)) return
      if (samples%n_samples > 1) call slip_statistics(samples%slip_fraction, statistics)
   end subroutine find_slip_statistics

   !> What the finite march does to the slip fractions of one case.
   subroutine find_time_averages(plan, number, shards, statistics, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(shard_type), intent(in) :: shards(:)
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(out) :: error
      type(span_collector) :: spans
      type(shard_type), allocatable :: ours(:)
      real(wp), allocatable :: series(:, :, :)   ! (dof, span, sample)
      integer :: i

      if (count_spans(plan%integration) < fewest_spans) return
      ours = shards_of(shards, number, plan%cases(number)%n_samples)
      do i = 1, size(ours)
         call read_slip_series(ours(i), plan%cases(number)%n_samples, series, error)
         if (allocated(error)) return
         call spans%add(series, statistics)
      end do
      if (plan%cases(number)%n_samples > 1) call spans%finish(statistics)
   end subroutine find_time_averages

   !> Bands of uncertainty of one case, a range of frequencies at a time.
   subroutine find_bands(plan, number, runner, output, shards, statistics, error)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(runner_type), intent(in) :: runner
      type(output_type), intent(in) :: output
      type(shard_type), intent(in) :: shards(:)
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(out) :: error
      type(band_collector) :: bands
      real(wp), allocatable :: psd(:, :, :)   ! (dof, frequency, sample)
      integer :: first, n, n_dof, n_frequencies, n_samples

      n_dof = plan%chain%n_dof
      n_samples = plan%cases(number)%n_samples
      n_frequencies = size(runner%layout%frequency)
      call start_bands(n_samples, n_dof, runner%layout%frequency, plan%output%percentiles, &
                       plan%seed, bands, statistics)
      n = neighbours*max(1, int(band_memory/(8.0_wp*n_dof*n_samples*neighbours)))
      do first = 1, n_frequencies, n
         allocate (psd(n_dof, min(n, n_frequencies - first + 1), n_samples))
         call read_psd_band(output%store, shards, number, first, psd, error)
         if (allocated(error)) return
         call bands%add(first, psd, statistics)
         deallocate (psd)
      end do
      call bands%finish(statistics)
   end subroutine find_bands

end module driver_results
