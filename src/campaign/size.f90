!> Estimates the size of a results file and the memory of a rank from the plan alone: array shapes
!> times bytes, and measured overheads.
module campaign_size
   use campaign_bands, only: most_bins
   use campaign_columns, only: largest_group
   use campaign_plan, only: add_audits, have_same_force, kept_dofs, kept_of, output_settings, &
                            plan_type
   use campaign_pooling, only: case_pool, find_pools, plan_draws, reason_for_plain
   use campaign_results, only: n_quantities, spectrum_layout
   use campaign_runner, only: block_width, layout_of
   use campaign_time_average, only: count_spans
   use core_chunks, only: frequencies_together, stored_bytes
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_memory, only: can_allocate
   use core_text, only: to_text
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   use numerics_statistics, only: n_sums
   use process_direct_sign_search, only: max_listed
   use process_model, only: is_fitted_by_simulation, process_model_type, process_request
   use statistics_estimates, only: numbers_of_statistic
   use statistics_fit, only: most_pair_outputs, most_pair_samples
   use statistics_law, only: most_kept_draws, n_points
   use statistics_spectra, only: fitted_together => together
   use statistics_surrogate, only: most_landmarks
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: memory_of_pilot, memory_of_rank, n_frequencies, refuse_long_lists, refuse_oversize, &
             results_size

   real(wp), parameter :: real_bytes = 8.0_wp
   real(wp), parameter :: transition_bytes = 20.0_wp     !! time, sample, joint and kind
   real(wp), parameter :: entry_bytes = 20.0_wp          !! row, column, value, number of an entry
   real(wp), parameter :: dataset_bytes = 775.0_wp       !! headers of a dataset (measured)
   real(wp), parameter :: process_bytes = 20.5e3_wp      !! headers of a solved process (measured)
   real(wp), parameter :: unsolved_bytes = 2.6e3_wp      !! process without a solution
   real(wp), parameter :: empty_file_bytes = 6.0e3_wp    !! results file without results (measured)
   real(wp), parameter :: base_memory = 30.0e6_wp        !! [byte] libraries of a rank (measured)
   real(wp), parameter :: fit_memory = 15.0e6_wp         !! [byte] fit by simulation (measured)
   real(wp), parameter :: march_memory = 38.0e6_wp       !! [byte] the same in a march (measured)
   real(wp), parameter :: listed_shard_bytes = 400.0_wp  !! shard in the lists of a rank
   real(wp), parameter, public :: most_pilot_memory = 20.0e6_wp   !! cases marched at once [byte]
   integer, parameter, public :: pilot_segments = 8   !! Welch segments of the pilot march
   !> Estimates are shown with three digits; with this factor they are never too small.
   real(wp), parameter :: margin = 1.01_wp
   !> Transitions in a step of a whole march over those in a step of its start from rest.
   real(wp), parameter :: growth_after_start = 1.3_wp

contains

   !> Size of the results file [byte]: values, chunks that are not full, and headers.
   pure real(wp) function results_size(plan, transitions, models) result(bytes)
      type(plan_type), intent(in) :: plan           !! plan without audits
      real(wp), intent(in) :: transitions           !! transitions of a sample in a step
      type(process_model_type), intent(in) :: models(:)   !! (process) as far as they are known
      type(plan_type) :: all_cases
      integer :: c

      bytes = empty_file_bytes
      if (plan%n_realizations > 0) bytes = bytes + margin*size(plan%processes)* &
                                           (real_bytes*(plan%n_realizations + plan%n_points) &
                                            + stored_bytes([plan%n_points, plan%n_realizations]))
      bytes = bytes + sum(size_of_process(plan%processes, models))
      if (.not. plan%has_structure) return
      all_cases = plan
      call add_audits(all_cases)
      do c = 1, size(all_cases%cases)
         bytes = bytes + size_of_case(all_cases, c, transitions)
      end do
      associate (structure => plan%structure)
         bytes = bytes + real_bytes*12*(structure%n_dof + structure%n_joints) + 20*dataset_bytes &
                 + real_bytes*structure%n_dof*(structure%n_joints + structure%n_forces) &
                 + entry_bytes*(count(abs(structure%mass) > 0.0_wp) &
                                + count(abs(structure%damping) > 0.0_wp) &
                                + count(abs(structure%stiffness) > 0.0_wp))
      end associate
   end function results_size

   !> Size of a process in the file [byte], with its autocovariance and all kept solutions of a
   !> search over all signs. Lags that are not known yet are bounded.
   elemental real(wp) function size_of_process(request, model) result(bytes)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(in) :: model
      real(wp), parameter :: reals_per_lag = 2.5_wp, reals_per_order = 3.5_wp, &
                             reals_per_node = 2.5_wp, most_lags = 4097.0_wp, &
                             most_lags_if_positive = 601.0_wp
      real(wp) :: n_lags, n_solutions, order

      bytes = unsolved_bytes
      if (.not. model%is_solved) return
      order = request%order
      if (request%order == 0) order = request%max_order
      n_lags = min(10.0_wp + 12*request%correlation_length &
                   + order*(5.0_wp + 4.5_wp*request%correlation_length), &
                   merge(most_lags_if_positive, most_lags, request%positive))
      if (allocated(model%a)) order = size(model%a)
      if (allocated(model%autocovariance)) n_lags = size(model%autocovariance)
      n_solutions = 1.0_wp
      if (request%all_signs) n_solutions = min(2.0_wp**min(order, 30.0_wp), 1.0_wp*max_listed)
      bytes = process_bytes + real_bytes*(reals_per_lag*n_lags + reals_per_order*order &
                                          + n_solutions*(0.5_wp*order + 4))
      if (allocated(model%nodes)) bytes = bytes + real_bytes*reals_per_node*size(model%nodes)
   end function size_of_process

   !> Size of a case in the file [byte].
   pure real(wp) function size_of_case(plan, number, transitions) result(bytes)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      real(wp), intent(in) :: transitions   !! transitions of a sample in a step
      type(output_settings) :: kept
      real(wp) :: case_bytes, n_steps, sample_bytes   ! common data, data of each sample
      integer :: n_datasets, n_kept, n_samples

      kept = kept_of(plan, number)
      n_kept = size(kept_dofs(plan))
      n_samples = plan%cases(number)%n_samples
      n_steps = plan%integration%n_steps + 1.0_wp
      associate (n_dof => plan%structure%n_dof, n_joints => plan%structure%n_joints)
         sample_bytes = real_bytes*(1 + 7*n_joints)
         if (kept%energy) sample_bytes = sample_bytes + real_bytes*5
         if (kept%spectrum) sample_bytes = sample_bytes + real_bytes*n_joints
         if (kept%harmonic) sample_bytes = sample_bytes + real_bytes*2*(n_dof + 1)
         case_bytes = real_bytes*(n_dof + n_joints)
         n_datasets = 27
         if (n_samples > 1 .and. plan%cases(number)%audits == 0) &
            call add_statistics(plan, number, case_bytes, n_datasets)
         if (kept%slip .and. (kept%keeps_spectra(n_samples) .or. .not. kept%spectrum)) &
            case_bytes = case_bytes &
                         + stored_bytes([n_joints, count_spans(plan%integration), n_samples])
      end associate
      if (kept%spectrum) then
         n_datasets = n_datasets + 9
         case_bytes = case_bytes + real_bytes*n_frequencies(plan)
         if (kept%keeps_spectra(n_samples)) &
            case_bytes = case_bytes + stored_bytes([n_kept, n_frequencies(plan), n_samples]) &
                         + stored_bytes([n_kept, n_powers(plan), n_samples])
      end if
      if (kept%history) then
         if (plan%excitation%per_sample) &
            sample_bytes = sample_bytes + real_bytes*n_steps*plan%structure%n_forces
         case_bytes = case_bytes + (1.5_wp + plan%structure%n_forces)*real_bytes*n_steps &
                      + 2*stored_bytes([n_kept, plan%integration%n_steps + 1, n_samples])
         n_datasets = n_datasets + 5
      end if
      if (kept%transitions) then
         sample_bytes = sample_bytes + growth_after_start*transition_bytes*transitions*n_steps
         n_datasets = n_datasets + 5
      end if
      bytes = margin*(n_samples*sample_bytes + case_bytes + n_datasets*dataset_bytes)
   end function size_of_case

   !> Adds the statistics over the samples of a case: those of plain sampling and, where the case
   !> has a regression, its estimates, sensitivities and ratios of errors.
   pure subroutine add_statistics(plan, number, bytes, n_datasets)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      real(wp), intent(inout) :: bytes
      integer, intent(inout) :: n_datasets
      real(wp), parameter :: with_regression = 2.5_wp   ! all values over those of plain sampling
      real(wp) :: factor, n_values
      logical :: is_plain

      is_plain = len(reason_for_plain(plan, number)) > 0
      factor = merge(1.0_wp, with_regression, is_plain)
      associate (structure => plan%structure, np => size(plan%output%percentiles))
         n_values = n_quantities*structure%n_joints*(4 + 3*np)
         n_datasets = n_datasets + nint(factor*7*n_quantities)
         if (plan%output%spectrum) then
            n_values = n_values + size(kept_dofs(plan)) &
                       *(n_frequencies(plan)*(2.0_wp + 3*np) + 8 + 3*np)
            n_datasets = n_datasets + nint(factor*17)
         end if
         bytes = bytes + real_bytes*factor*n_values
         if (.not. is_plain) bytes = bytes + real_bytes*2*structure%n_joints*structure%n_points
      end associate
   end subroutine add_statistics

   !> Number of frequencies of a spectrum.
   pure integer function n_frequencies(plan)
      type(plan_type), intent(in) :: plan

      n_frequencies = plan%output%segment_length/max(1, plan%output%spectrum_every)/2 + 1
   end function n_frequencies

   !> Number of values of power_series for one sample and dof.
   pure integer function n_powers(plan)
      type(plan_type), intent(in) :: plan
      type(spectrum_layout) :: layout

      layout = layout_of(plan)
      n_powers = 0
      if (layout%follows_power) n_powers = n_batches*size(last_of_ranges(size(layout%frequency)))
   end function n_powers

   !> Largest resident memory of a rank [byte] over the steps of a run: fits, realizations, march,
   !> statistics, regression, and of the pilot march before them. The matrices stay to the end.
   pure real(wp) function memory_of_rank(plan, transitions, share_powerful) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: transitions      !! transitions of a sample in a step
      real(wp), intent(in) :: share_powerful   !! share of the frequencies that are fitted
      real(wp) :: n_samples, pilot

      bytes = base_memory + max(merge(fit_memory, 0.0_wp, &
                                      any(is_fitted_by_simulation(plan%processes))), &
                                real_bytes*plan%n_realizations*plan%n_points)
      if (.not. plan%has_structure) return
      n_samples = maxval(plan%cases%n_samples)
      pilot = 0.0_wp
      if (plan%output%spectrum) &
         pilot = 3*memory_of_structure(plan%structure) &   ! of its plans
                 + min(size(plan%cases)*memory_of_pilot(plan), &
                       max(memory_of_pilot(plan), most_pilot_memory))
      bytes = max(bytes, march_memory + 4*n_samples*size(plan%cases) &
                  + listed_shard_bytes*size(plan%cases)*(1 + n_samples/block_width(plan)) &
                  + memory_of_matrices(plan) &
                  + max(memory_of_march(plan, transitions), pilot, &
                        memory_of_tables(plan) + memory_of_statistics(plan), &
                        2*memory_of_tables(plan) + memory_of_regression(plan, share_powerful)))
   end function memory_of_rank

   !> Memory [byte] of the force record and of a block of samples, of one case or of cases with the
   !> same force.
   pure function memory_of_march(plan, transitions) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: transitions   !! transitions of a sample in a step
      real(wp) :: bytes        ! first of a sample
      real(wp) :: drawn, n_steps, record   ! drawn: records' worth of memory
      integer :: c, n, width   ! n: samples of the largest block

      n_steps = plan%integration%n_steps + 1.0_wp
      n = maxval(plan%cases%n_samples)
      width = block_width(plan)
      do c = 1, merge(0, size(plan%cases), plan%excitation%per_sample)
         if (n >= width) exit
         n = max(n, sum(plan%cases%n_samples, have_same_force(plan%cases, plan%cases(c))))
      end do
      associate (n_kept => size(kept_dofs(plan)), n_forces => plan%structure%n_forces, &
                 output => plan%output, excitation => plan%excitation)
         ! the record prepared, in the march, and while it is drawn; the transforms of the drawing
         ! need less for a band with a lower upper end (numerics_synthesis)
         drawn = 2.0_wp
         if (excitation%kind == 'band_limited') &
            drawn = min(2.0_wp, 6*excitation%band(2)*plan%integration%dt)
         record = (drawn + 2*n_forces)*real_bytes*n_steps
         if (excitation%kind == 'file' .and. excitation%per_sample) &   ! records are there twice
            record = 2*real_bytes*n_steps*n_forces*maxval(plan%cases%n_samples)
         bytes = 0.0_wp
         if (output%spectrum) bytes = real_bytes*n_kept*(5*n_frequencies(plan) + 2*n_powers(plan))
         if (output%history) bytes = bytes + 2*real_bytes*n_kept*n_steps
         if (output%transitions) bytes = bytes + 3*transition_bytes*transitions*n_steps
         if (excitation%per_sample) bytes = bytes + real_bytes*n_steps*n_forces
      end associate
      bytes = record + min(width, n)*bytes
   end function memory_of_march

   !> Memory [byte] of a case in the pilot march (tradeoff_pilot): Welch segments, spectra of every
   !> step at all dofs, and four copies of the force.
   pure real(wp) function memory_of_pilot(plan) result(bytes)
      type(plan_type), intent(in) :: plan

      associate (length => plan%output%segment_length)
         bytes = real_bytes*(3.0_wp*length*plan%structure%n_dof + 4.0_wp*plan%structure%n_forces &
                             *min(plan%integration%n_steps, (pilot_segments + 1)*length/2))
      end associate
   end function memory_of_pilot

   !> Memory [byte] of the matrices of a march: four copies of the structure, in the scene, the
   !> plan, the runner and the marcher, and those of the method. Newmark's scheme has two copies of
   !> its frame, K and M, and a matrix of its rows for each halving of the step. Modes have V and
   !> V^-1 of (M3), twice while they are found. Five more matrices are buffers (measured).
   pure real(wp) function memory_of_matrices(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp) :: cross, square   ! bytes of a (dof, joint) and of a (dof, dof) matrix
      integer :: n_between        ! number of joints between dofs

      associate (structure => plan%structure)
         cross = real_bytes*structure%n_dof*structure%n_joints
         square = real_bytes*structure%n_dof*real(structure%n_dof, wp)
         bytes = 4*memory_of_structure(structure) + 5*square
         if (plan%integration%method == 'newmark') then
            n_between = count(count(abs(structure%direction) > 0.0_wp, 1) > 1)
            bytes = bytes + 12*square + 8*cross + (plan%integration%max_halvings + 1) &
                    *real_bytes*real(structure%n_dof + n_between, wp)**2
         else if (.not. structure%has_lumped_mass()) then
            bytes = bytes + 16*square
         end if
      end associate
   end function memory_of_matrices

   !> Memory [byte] of the matrices of a structure: M, K, C, modes, and directions of joints.
   pure real(wp) function memory_of_structure(structure) result(bytes)
      type(structure_type), intent(in) :: structure

      bytes = real_bytes*structure%n_dof*(4.0_wp*structure%n_dof + structure%n_joints)
   end function memory_of_structure

   !> Memory [byte] of the statistics of the spectra of all cases by one estimator.
   pure real(wp) function memory_of_tables(plan) result(bytes)
      type(plan_type), intent(in) :: plan

      bytes = 0.0_wp   ! below, + 1: degrees of freedom of the mean
      if (plan%output%spectrum) &
         bytes = real_bytes*size(kept_dofs(plan))*n_frequencies(plan) &
                 *count(plan%cases%n_samples > 1) &
                 *(numbers_of_statistic*(1 + size(plan%output%percentiles)) + 1)
   end function memory_of_tables

   !> Memory [byte] of the collectors of up to two cases at once, and of the spectra of a group of
   !> samples at some frequencies.
   pure real(wp) function memory_of_statistics(plan) result(bytes)
      type(plan_type), intent(in) :: plan
      integer, parameter :: most_slices = 32   ! as in driver_statistics
      !> sqrt(n) times this many values are in a bracket: 3 times 2*1.96 sqrt(p (1 - p)), p = 1/2
      real(wp), parameter :: bracket_width = 6.0_wp
      !> of one dof: the density, its logarithm, its rank (half a real), influences twice
      real(wp), parameter :: values_of_density = 4.5_wp
      integer :: at_once, n_group, n_groups, n_samples, together

      at_once = min(2, count(plan%cases%n_samples > 1))
      n_samples = maxval(plan%cases%n_samples)
      n_group = min(n_samples, largest_group)
      n_groups = (n_samples - 1)/largest_group + 1
      bytes = real_bytes*n_group*plan%structure%n_joints &
              *(10 + count_spans(plan%integration)/max(1, n_group/block_width(plan)))
      if (.not. plan%output%spectrum .or. n_group < 2) return
      associate (n_kept => size(kept_dofs(plan)), n_percentiles => size(plan%output%percentiles))
         together = frequencies_together(n_kept, n_frequencies(plan))
         bytes = bytes + at_once*real_bytes*n_kept &
                 *(n_frequencies(plan)*real(3*n_percentiles + n_sums*n_groups, wp) &
                   + most_slices*(n_percentiles + 1)*min(n_group, most_bins)) &
                 + real_bytes*n_group*(n_kept*(together + min(n_powers(plan), 2*n_batches)) &
                                       + together*values_of_density)
         if (n_groups > 1) bytes = bytes + real_bytes*n_kept*together*n_percentiles &
                                   *bracket_width*sqrt(real(n_samples, wp))
      end associate
   end function memory_of_statistics

   !> Memory [byte] of the largest regression: draws of the laws of the pool; outputs, fits and
   !> predictions of one dof.
   pure real(wp) function memory_of_regression(plan, share_powerful) result(bytes)
      type(plan_type), intent(in) :: plan
      real(wp), intent(in) :: share_powerful   !! as in memory_of_rank
      type(case_pool), allocatable :: pools(:)
      real(wp) :: draws, law, outputs   ! numbers of reals
      integer :: d, n, n_draws, nf, p, stride

      bytes = 0.0_wp
      pools = find_pools(plan)
      d = plan%structure%n_points
      nf = 0
      if (plan%output%spectrum) nf = ceiling(share_powerful*n_frequencies(plan))
      do p = 1, size(pools)
         n = sum(pools(p)%n_fitted)
         associate (request => plan%processes(plan%cases(pools(p)%cases(1))%process))
            call plan_draws(d, request%sampler == 'exact', request%correlation_length, n_draws, &
                            stride)
         end associate
         draws = real(n_draws, wp)*(stride + 3*d)
         law = real(min(n_draws, most_kept_draws), wp)*d*size(pools(p)%cases)
         outputs = 0.0_wp
         if (nf > 0) outputs = real(nf, wp)*(4*n + 2*min(most_landmarks, n)) &
                               + real(n_points, wp)*(min(most_landmarks, n) + 5*fitted_together) &
                               + real(size(plan%output%percentiles), wp)*fitted_together &
                               *(min(most_landmarks, n) + n) &
                               + real((nf - 1)/fitted_together + 1, wp)*most_pair_outputs*n &
                               *2*min(most_pair_samples, n)
         bytes = max(bytes, real_bytes*(law + max(draws, outputs)))
      end do
   end function memory_of_regression

   !> Refuses a plan whose realizations or whose march need more memory than the system gives. It
   !> asks for the memory and does not use it.
   subroutine refuse_oversize(plan, error)
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(plan_type) :: sparse   ! spectra of one frequency: their thinning is not known yet

      call require(real_bytes*plan%n_points*real(plan%n_realizations, wp), &
                   'process%n_realizations', plan%n_realizations, &
                   'the realizations of a process take ', &
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
      real(wp), parameter :: sample_bytes = 12.0_wp   ! two logicals and an integer
      integer :: most

      most = maxval([plan%cases%n_samples, 0])
      call require(sample_bytes*most*size(plan%cases), 'campaign%n_samples', most, &
                   'the lists of samples take ', &
                   ' MB on each rank, which the system does not give', error)
   end subroutine refuse_long_lists

   !> Refuses the value of a setting if the system does not give the memory that it needs.
   subroutine require(bytes, name, value, subject, rule, error)
      real(wp), intent(in) :: bytes
      character(*), intent(in) :: name   !! setting that decides
      integer, intent(in) :: value
      character(*), intent(in) :: subject, rule   !! text before and after the number of MB
      type(error_type), allocatable, intent(out) :: error

      if (.not. can_allocate(bytes)) &
         call raise(error, exit_bad_input, name//' = '//to_text(value)//': '//subject// &
                    to_text(nint(bytes/1.0e6_wp, long))//rule)
   end subroutine require

end module campaign_size
