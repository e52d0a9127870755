!> How large the results of a plan and the memory of a rank become, from the shapes of what is kept.
module campaign_size
   use campaign_bands, only: most_bins
   use campaign_columns, only: largest_group
   use campaign_plan, only: add_audits, kept_dofs, kept_of, output_settings, plan_type
   use campaign_pooling, only: case_pool, find_pools, plan_draws, reason_for_plain
   use campaign_results, only: n_quantities, spectrum_layout
   use campaign_runner, only: block_width, layout_of
   use campaign_time_average, only: count_spans
   use core_chunks, only: frequencies_together, stored_bytes
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_memory, only: gives_memory
   use core_text, only: to_text
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   use numerics_statistics, only: n_sums
   use process_direct_sign_search, only: max_listed
   use process_model, only: process_model_type, process_request
   use statistics_estimates, only: numbers_of_statistic
   use statistics_law, only: most_kept, n_points
   use statistics_spectra, only: fitted_together => together
   use statistics_surrogate, only: most_landmarks, outputs_judged, samples_paired
   use structure_model, only: matrices_alone => memory_of_matrices
   implicit none(type, external)
   private
   public :: memory_of_rank, n_frequencies, refuse_long_lists, refuse_oversize, results_size

   real(wp), parameter :: word = 8.0_wp            !! bytes of a number
   real(wp), parameter :: of_dataset = 775.0_wp    !! bytes beside its values (measured, HDF5 1.10)
   real(wp), parameter :: margin = 1.01_wp         !! three digits are told, never too few bytes
   real(wp), parameter :: of_entry = 20.0_wp       !! bytes: a matrix's row, column, value, number
   real(wp), parameter :: of_process = 20.5e3_wp   !! bytes of one beside its values (measured)
   real(wp), parameter :: of_refused = 2.6e3_wp    !! bytes of a process without a solution
   real(wp), parameter :: of_file = 6.0e3_wp       !! bytes of an empty results file (measured)
   real(wp), parameter :: with_march = 38.0e6_wp      !! resident bytes of libraries (measured)
   real(wp), parameter :: without_march = 30.0e6_wp   !! the same where nothing is marched
   real(wp), parameter :: of_transition = 20.0_wp  !! bytes of its time, sample, dof and kind
   real(wp), parameter :: growth = 1.3_wp          !! of transitions behind the start from rest
   real(wp), parameter :: of_shard = 400.0_wp      !! bytes of one in the lists of a rank

contains

   !> Size of the results file [byte]: its values, chunks that are not full, and headers.
   pure function results_size(plan, transitions, foreseen) result(bytes)
      type(plan_type), intent(in) :: plan           !! without audits
      real(wp), intent(in) :: transitions           !! of a sample in a step
      type(process_model_type), intent(in) :: foreseen(:)   !! (process)
      real(wp) :: bytes
      type(plan_type) :: all_cases
      integer :: c

      bytes = of_file
      if (plan%n_realizations > 0) bytes = bytes + margin*size(plan%processes)* &
                                           (word*(plan%n_realizations + plan%n_points) &
                                            + stored_bytes([plan%n_points, plan%n_realizations]))
      bytes = bytes + sum(size_of_process(plan%processes, foreseen))
      if (.not. plan%has_structure) return
      all_cases = plan
      call add_audits(all_cases)
      do c = 1, size(all_cases%cases)
         bytes = bytes + size_of_case(all_cases, c, transitions)
      end do
      associate (structure => plan%structure)
         bytes = bytes + word*12*(structure%n_dof + structure%n_joints) + 20*of_dataset &
                 + word*structure%n_dof*(structure%n_joints + structure%n_forces) &
                 + of_entry*(count(abs(structure%mass) > 0.0_wp) &
                             + count(abs(structure%damping) > 0.0_wp) &
                             + count(abs(structure%stiffness) > 0.0_wp))
      end associate
   end function results_size

   !> Size of a process with its autocovariance; of a search over all signs, with as many solutions
   !> as are kept.
   elemental function size_of_process(request, foreseen) result(bytes)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: foreseen
      real(wp) :: bytes
      real(wp), parameter :: of_lag = 2.5_wp, of_order = 3.5_wp, of_node = 2.5_wp, &
                             most_lags = 4097.0_wp, most_of_positive = 601.0_wp
      real(wp) :: n_lags, n_solutions, order

      bytes = of_refused
      if (.not. foreseen%is_solved) return
      order = request%order
      if (request%order == 0) order = request%max_order
      n_lags = min(10.0_wp + 12*request%correlation_length &
                   + order*(5.0_wp + 4.5_wp*request%correlation_length), &
                   merge(most_of_positive, most_lags, request%positive))   ! a bound
      if (allocated(foreseen%a)) order = size(foreseen%a)
      if (allocated(foreseen%autocovariance)) n_lags = size(foreseen%autocovariance)
      n_solutions = 1.0_wp
      if (request%all_signs) n_solutions = min(2.0_wp**min(order, 30.0_wp), 1.0_wp*max_listed)
      bytes = of_process + word*(of_lag*n_lags + of_order*order + n_solutions*(0.5_wp*order + 4))
      if (allocated(foreseen%nodes)) bytes = bytes + word*of_node*size(foreseen%nodes)
   end function size_of_process

   pure function size_of_case(plan, number, transitions) result(bytes)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      real(wp), intent(in) :: transitions
      real(wp) :: bytes
      type(output_settings) :: kept
      real(wp) :: of_sample, once, n_steps
      integer :: n_datasets, n_kept, n_samples

      kept = kept_of(plan, number)
      n_kept = size(kept_dofs(plan))
      n_samples = plan%cases(number)%n_samples
      n_steps = plan%integration%n_steps + 1.0_wp
      associate (n_dof => plan%structure%n_dof, n_joints => plan%structure%n_joints)
         of_sample = word*(6 + 8*n_joints)   ! whatever is kept
         if (kept%harmonic) of_sample = of_sample + word*2*(n_dof + 1)
         once = word*(n_dof + n_joints)
         n_datasets = 27
         if (n_samples > 1 .and. plan%cases(number)%audits == 0) &
            call add_statistics(plan, number, once, n_datasets)
         if (kept%slip .and. (kept%keeps_spectra(n_samples) .or. .not. kept%spectrum)) &
            once = once + stored_bytes([n_joints, count_spans(plan%integration), n_samples])
      end associate
      if (kept%spectrum) then
         n_datasets = n_datasets + 9
         once = once + word*n_frequencies(plan)
         if (kept%keeps_spectra(n_samples)) once = once &
                                   + stored_bytes([n_kept, n_frequencies(plan), n_samples]) &
                                          + stored_bytes([n_kept, n_powers(plan), n_samples])
      end if
      if (kept%history) then
         if (plan%excitation%per_sample) &
            of_sample = of_sample + word*n_steps*plan%structure%n_forces
         once = once + (1.5_wp + plan%structure%n_forces)*word*n_steps &
                + 2*stored_bytes([n_kept, plan%integration%n_steps + 1, n_samples])
         n_datasets = n_datasets + 5
      end if
      if (kept%transitions) then
         of_sample = of_sample + growth*of_transition*transitions*n_steps
         n_datasets = n_datasets + 5
      end if
      bytes = margin*(n_samples*of_sample + once + n_datasets*of_dataset)
   end function size_of_case

   !> Adds the size of the statistics over samples of a case: of plain sampling alone, or with those
   !> of a regression, their sensitivities and ratios of errors.
   pure subroutine add_statistics(plan, number, bytes, n_datasets)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      real(wp), intent(inout) :: bytes
      integer, intent(inout) :: n_datasets
      real(wp), parameter :: with_regression = 2.5_wp   ! times the plain ones
      real(wp) :: n_values, times

      times = merge(1.0_wp, with_regression, len(reason_for_plain(plan, number)) > 0)
      associate (structure => plan%structure, np => size(plan%output%percentiles))
         n_values = n_quantities*structure%n_joints*(4 + 3*np)
         n_datasets = n_datasets + nint(times*7*n_quantities)
         if (plan%output%spectrum) then
            n_values = n_values + size(kept_dofs(plan)) &
                       *(n_frequencies(plan)*(2.0_wp + 3*np) + 8 + 3*np)
            n_datasets = n_datasets + nint(times*17)
         end if
         bytes = bytes + word*(times*n_values + 2*structure%n_joints*structure%n_points)
      end associate
   end subroutine add_statistics

   !> Frequencies of a spectrum.
   pure integer function n_frequencies(plan)
      type(plan_type), intent(in) :: plan

      n_frequencies = plan%output%segment_length/max(1, plan%output%spectrum_every)/2 + 1
   end function n_frequencies

   !> Values of a sample and a dof that tell how its power varies along the march.
   pure integer function n_powers(plan)
      type(plan_type), intent(in) :: plan
      type(spectrum_layout) :: layout

      layout = layout_of(plan)
      n_powers = 0
      if (layout%follows_power) n_powers = n_batches*size(last_of_ranges(size(layout%frequency)))
   end function n_powers

   !> Largest resident memory of a rank [byte]: of realizations, the march, or statistics. The
   !> matrices stay to the end.
   pure function memory_of_rank(plan, transitions) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: transitions   !! of a sample in a step
      real(wp) :: bytes
      real(wp) :: n_samples

      bytes = without_march + word*plan%n_realizations*plan%n_points
      if (.not. plan%has_structure) return
      n_samples = maxval(plan%cases%n_samples)
      bytes = max(bytes, with_march + 4*n_samples*size(plan%cases) &
                  + of_shard*size(plan%cases)*(1 + n_samples/block_width(plan)) &
                  + memory_of_matrices(plan) &
                  + max(memory_of_march(plan, transitions), &
                        memory_of_tables(plan) + memory_of_statistics(plan), &
                        2*memory_of_tables(plan) + memory_of_regression(plan)))
   end function memory_of_rank

   !> Memory of the force as it is drawn (or in a file, prepared, and in the march) and of a block
   !> of samples.
   pure function memory_of_march(plan, transitions) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: transitions
      real(wp) :: bytes
      real(wp) :: n_steps, of_sample

      n_steps = plan%integration%n_steps + 1.0_wp
      associate (n_kept => size(kept_dofs(plan)))
         of_sample = 0.0_wp
         if (plan%output%spectrum) of_sample = word*n_kept*(5*n_frequencies(plan) &
                                                            + 2*n_powers(plan))
         if (plan%output%history) of_sample = of_sample + 2*word*n_kept*n_steps
         if (plan%output%transitions) of_sample = of_sample + 3*of_transition*transitions*n_steps
         if (plan%excitation%per_sample) &
            of_sample = of_sample + word*n_steps*plan%structure%n_forces
      end associate
      bytes = record_memory(plan) &
              + min(block_width(plan), maxval(plan%cases%n_samples))*of_sample
   end function memory_of_march

   !> Matrices of the structure and of the method, and Newmark's of each step.
   pure function memory_of_matrices(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes

      bytes = matrices_alone(plan%structure%n_dof, plan%structure%n_joints)
      if (plan%integration%method == 'newmark') &
         bytes = bytes*(1.0_wp + plan%integration%max_halvings/8.0_wp)
   end function memory_of_matrices

   !> The record while it is drawn: itself, and of the transforms a part that falls with the highest
   !> line (numerics_synthesis); as it is marched. A file's is kept twice more.
   pure function record_memory(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes
      real(wp) :: copies

      associate (how => plan%excitation)
         copies = 2.0_wp
         if (how%kind == 'band_limited') copies = min(2.0_wp, 6*how%band(2)*plan%integration%dt)
         bytes = (copies + 2*plan%structure%n_forces)*word*(plan%integration%n_steps + 1.0_wp)
         if (how%kind == 'file' .and. how%per_sample) &
            bytes = 2*word*(plan%integration%n_steps + 1.0_wp)*plan%structure%n_forces &
                    *maxval(plan%cases%n_samples)
      end associate
   end function record_memory

   !> Statistics of the spectra of all cases: plain sampling's, beside which come the best.
   pure function memory_of_tables(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes
      integer, parameter :: of_freedoms = 1   ! of the mean

      bytes = 0.0_wp
      if (plan%output%spectrum) &
         bytes = word*size(kept_dofs(plan))*n_frequencies(plan) &
                 *count(plan%cases%n_samples > 1) &
                 *(numbers_of_statistic*(1 + size(plan%output%percentiles)) + of_freedoms)
   end function memory_of_tables

   !> Bands of up to two cases at once, and the spectra of a group of samples at some frequencies.
   pure function memory_of_statistics(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes
      integer, parameter :: parts = 32
      real(wp), parameter :: in_bracket = 6.0_wp   ! of sqrt(n) values: 3 times 1.96 sqrt(p (1 - p))
      real(wp) :: n_samples
      integer :: at_once, n_group, n_groups, together

      at_once = min(2, count(plan%cases%n_samples > 1))
      n_samples = maxval(plan%cases%n_samples)
      n_group = min(maxval(plan%cases%n_samples), largest_group)
      n_groups = (maxval(plan%cases%n_samples) - 1)/largest_group + 1
      bytes = word*n_group*plan%structure%n_joints*(10 + count_spans(plan%integration)/ &
                                                    max(1, n_group/block_width(plan)))
      if (.not. plan%output%spectrum .or. n_group < 2) return
      associate (n_kept => size(kept_dofs(plan)), n_percentiles => size(plan%output%percentiles))
         together = frequencies_together(n_kept, n_frequencies(plan))
         bytes = bytes &
                 + at_once*word*n_kept*(n_frequencies(plan) &
                                        *real(3*n_percentiles + n_sums*n_groups, wp) &
                                        + parts*(n_percentiles + 1)*min(n_group, most_bins)) &
                 + word*n_group*n_kept*(together + min(n_powers(plan), 2*n_batches))
         if (n_groups > 1) bytes = bytes + word*n_kept*together*n_percentiles*in_bracket &
                                   *sqrt(n_samples)
      end associate
   end function memory_of_statistics

   !> Draws of the laws of a pool; outputs, fits and predictions of one dof.
   pure function memory_of_regression(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: bytes
      type(case_pool), allocatable :: pools(:)
      real(wp) :: of_dof, of_draws, of_law
      integer :: n, n_draws, nf, p, stride

      bytes = 0.0_wp
      pools = find_pools(plan)
      nf = 0
      if (plan%output%spectrum) nf = n_frequencies(plan)
      do p = 1, size(pools)
         n = sum(pools(p)%n_fitted)
         associate (d => plan%structure%n_points, request => plan%processes(plan%cases(pools(p)% &
                                                                                 cases(1))%process))
            call plan_draws(d, request%sampler == 'exact', request%correlation_length, n_draws, &
                            stride)
            of_draws = real(n_draws, wp)*(stride + 3*d)
            of_law = real(min(n_draws, most_kept), wp)*d*size(pools(p)%cases)
         end associate
         of_dof = 0.0_wp
         if (nf > 0) of_dof = real(nf, wp)*(4*n + 2*min(most_landmarks, n)) &
                              + real(n_points, wp)*(min(most_landmarks, n) + 5*fitted_together) &
                              + real((nf - 1)/fitted_together + 1, wp)*outputs_judged*n &
                              *2*min(samples_paired, n)
         bytes = max(bytes, word*(of_law + max(of_draws, of_dof)))
      end do
   end function memory_of_regression

   !> Refuses a plan whose realizations or whose march need more memory than the system gives; asks
   !> without using it.
   subroutine refuse_oversize(plan, error)
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: sparse   ! whose spectra, not yet known to be thinned, take nothing

      call require(word*plan%n_points*real(plan%n_realizations, wp), 'process%n_realizations', &
                   plan%n_realizations, 'the realizations of a process take ', &
                   ' MB, which the system does not give', error)
      if (allocated(error) .or. .not. plan%has_structure) return
      sparse = plan
      sparse%output%spectrum_every = plan%output%segment_length
      call require(memory_of_matrices(plan) + memory_of_march(sparse, 0.0_wp), &
                   'integration%n_steps', plan%integration%n_steps, &
                   'the force and what is kept of a block take ', &
                   ' MB on each rank, which the system does not give: fewer steps, '// &
                   'histories of fewer output%dofs, or more memory (ulimit -v)', error)
   end subroutine refuse_oversize

   !> Refuses more samples than a rank has memory to list.
   subroutine refuse_long_lists(plan, error)
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: of_sample = 12.0_wp   ! bytes: marks twice, and a number to tell them
      integer :: most

      most = maxval([plan%cases%n_samples, 0])
      call require(of_sample*most*size(plan%cases), 'campaign%n_samples', most, &
                   'the lists of samples take ', &
                   ' MB on each rank, which the system does not give', error)
   end subroutine refuse_long_lists

   subroutine require(bytes, name, value, what, rule, error)
      real(wp), intent(in) :: bytes
      character(*), intent(in) :: name   !! of the setting that decides
      integer, intent(in) :: value
      character(*), intent(in) :: what, rule   !! before and behind the number of MB
      type(error_type), allocatable, intent(out) :: error

      if (.not. gives_memory(bytes)) &
         call raise(error, exit_bad_input, name//' = '//to_text(value)//': '//what// &
                    to_text(nint(bytes/1.0e6_wp, long))//rule)
   end subroutine require

end module campaign_size
