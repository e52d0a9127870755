!> The statistics of a case over its samples, in memory that does not grow with their number.
module driver_statistics
   use campaign_bands, only: band_collector, sample_groups, start_bands
   use campaign_joint_statistics, only: joint_collector, start_joints
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result, case_statistics, spectrum_layout
   use campaign_selection, only: selection_type
   use campaign_time_average, only: count_spans, fewest_spans, span_collector
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_blocks, only: put_short
   use io_gathering, only: read_band, read_samples, read_slip_series
   use io_group, only: group_type
   use io_shards, only: shard_type
   use io_store, only: shard_store
   use numerics_correlated, only: n_batches
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: attend_to_others, world_type
   implicit none(type, external)
   private
   public :: find_slip_statistics, spectra_task, open_spectra

   integer, parameter :: most_parts = 32   !! of the frequencies, shared out over the ranks

   !> The statistics of one case's spectra in the making: `open_spectra`, then every rank takes
   !> parts when it has time, then `close`. A part of the work is a range of frequencies of a group
   !> of samples.
   type :: spectra_task
      integer :: number = 0                      !! of the case
      type(shard_type), allocatable :: shards(:)
      logical, private :: has_bands = .false.
      integer, private :: width = 0              !! frequencies of a part
      integer, private :: n_parts = 0            !! of all frequencies
      type(band_collector), private :: bands
      type(work_counter), private :: counter
   contains
      procedure :: take_parts
      procedure :: close => close_spectra
   end type spectra_task

contains

   !> Shares out the spectra of a case in parts; collective.
   subroutine open_spectra(world, plan, number, layout, shards, task)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(spectrum_layout), intent(in) :: layout
      type(shard_type), intent(in) :: shards(:)   !! of the case, as shards_of has them
      type(spectra_task), intent(out) :: task
      integer :: n_dof, n_samples

      task%number = number
      task%shards = shards
      n_samples = plan%cases(number)%n_samples
      task%has_bands = plan%output%spectrum .and. n_samples > 1
      if (task%has_bands) then
         n_dof = size(kept_dofs(plan))
         associate (n => size(layout%frequency))
            task%width = frequencies_together(n_dof, n)
            task%width = task%width*((n - 1)/(task%width*most_parts) + 1)
            task%n_parts = (n - 1)/task%width + 1
         end associate
         call start_bands(n_samples, n_dof, layout%frequency, plan%output%percentiles, plan%seed, &
                          task%n_parts, task%bands, layout%follows_power)
         call new_counter(world, int(task%n_parts, long)*task%bands%n_groups(), task%counter)
      else
         call new_counter(world, 0_long, task%counter)
      end if
   end subroutine open_spectra

   !> Parts until none is left; an error keeps all ranks from going on.
   subroutine take_parts(self, store, error)
      class(spectra_task), intent(inout) :: self
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(inout) :: error
      integer :: group, item, part

      do
         if (allocated(error)) call self%counter%request_stop()
         item = int(self%counter%next())
         if (item == 0) exit
         part = modulo(item - 1, self%n_parts) + 1
         group = (item - 1)/self%n_parts + 1
         call add_part(self%number, store, self%shards, part, (part - 1)*self%width + 1, &
                       min(part*self%width, size(self%bands%at_frequency, 2)), group, self%bands, &
                       error)
      end do
   end subroutine take_parts

   !> Hands the root what all ranks have found. Collective.
   subroutine close_spectra(self, world, store, statistics, error)
      class(spectra_task), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(inout) :: error

      call self%counter%close()
      if (world%any_true(allocated(error)) .or. .not. self%has_bands) return
      associate (bands => self%bands)
         call world%add_up(size(bands%at_frequency), bands%at_frequency)
         call world%add_up(size(bands%moments), bands%moments)
         call world%add_up(size(bands%replicate), bands%replicate)
         call world%add_up(size(bands%integral), bands%integral)
         if (allocated(bands%batches%level)) &
            call world%add_up(size(bands%batches%level), bands%batches%level)
         if (bands%has_selection()) call select_percentiles(self, world, store, error)
         if (world%is_root() .and. .not. allocated(error)) call bands%finish(statistics)
      end associate
   end subroutine close_spectra

   !> The percentiles of all samples, as many ranges of frequencies at once as keep all ranks busy.
   !> Collective.
   subroutine select_percentiles(self, world, store, error)
      class(spectra_task), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(selection_type) :: selection
      real(wp), allocatable :: counts(:, :, :)
      integer :: first, last, n_dof, n_frequencies, together
      logical :: all_met

      n_dof = size(self%bands%at_frequency, 1)
      n_frequencies = size(self%bands%at_frequency, 2)
      together = frequencies_together(n_dof, n_frequencies)
      do first = 1, n_frequencies, together*(1 + world%n_ranks/self%bands%n_groups())
         last = min(first + together*(1 + world%n_ranks/self%bands%n_groups()) - 1, n_frequencies)
         call self%bands%open_selection(first, last, selection)
         all_met = .false.
         do while (.not. all_met)
            call select_from(self, world, store, first, last, selection, error)
            if (world%any_true(allocated(error))) return
            counts = selection%count_values()
            call world%add_up(size(counts), counts)
            call selection%check(counts, all_met)
         end do
         do while (.not. selection%is_done())
            counts = selection%count_to_middle()
            call world%add_up(size(counts), counts)
            call selection%halve(counts)
         end do
         call self%bands%take_selection(first, last, selection)
      end do
   end subroutine select_percentiles

   !> Adds the spectra of all samples at frequencies first..last to a selection. Collective.
   subroutine select_from(self, world, store, first, last, selection, error)
      class(spectra_task), intent(in) :: self
      type(world_type), intent(in) :: world
      type(shard_store), intent(in) :: store
      integer, intent(in) :: first, last
      type(selection_type), intent(inout) :: selection
      type(error_type), allocatable, intent(out) :: error
      type(work_counter) :: counter
      real(wp), allocatable :: psd(:, :, :)   ! (dof, frequency, sample)
      integer :: dof, f, from, group, item, n_dof, n_ranges, together

      n_dof = size(self%bands%at_frequency, 1)
      together = frequencies_together(n_dof, size(self%bands%at_frequency, 2))
      n_ranges = (last - first)/together + 1
      call new_counter(world, int(n_ranges, long)*self%bands%n_groups(), counter)
      do
         if (allocated(error)) call counter%request_stop()
         item = int(counter%next())
         if (item == 0) exit
         call attend_to_others()
         group = (item - 1)/n_ranges + 1
         from = first + together*modulo(item - 1, n_ranges)
         associate (samples => self%bands%group_first(group:group + 1))
            allocate (psd(n_dof, min(together, last - from + 1), samples(2) - samples(1)))
            call read_band(store, self%shards, self%number, 'psd', samples(1), from, psd, error)
         end associate
         if (.not. allocated(error)) then
            do f = 1, size(psd, 2)
               do dof = 1, n_dof
                  call selection%add(dof + n_dof*(from + f - 1 - first), psd(dof, f, :))
               end do
            end do
         end if
         deallocate (psd)
      end do
      call counter%close()
   end subroutine select_from

   !> Statistics of the joints of one case, from its samples group by group. Writes the samples'
   !> small data on the way, where there is a group of a results file.
   subroutine find_slip_statistics(plan, number, store, shards, statistics, error, group)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of the case, as shards_of has them
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(out) :: error
      type(group_type), intent(inout), optional :: group
      type(block_result) :: samples
      type(joint_collector), allocatable :: numbers(:)   ! as numbers_of has them
      type(span_collector) :: spans
      integer, allocatable :: first(:)
      integer :: g, i
      logical :: has_series, is_done

      has_series = plan%output%slip .and. count_spans(plan%integration) >= fewest_spans
      first = sample_groups(plan%cases(number)%n_samples)
      call start_numbers(plan, number, numbers)
      do g = 1, size(first) - 1
         call attend_to_others()
         call read_samples(store, shards, number, first(g), first(g + 1) - 1, samples, error)
         if (allocated(error)) return
         do i = 1, size(numbers)
            call numbers(i)%add(g, numbers_of(samples, i))
         end do
         if (has_series) call take_series(shards, samples, spans, error)
         if (allocated(error)) return
         if (present(group)) call put_short(group, plan, samples)
      end do
      if (size(numbers) == 0) return
      is_done = size(first) == 2
      if (.not. is_done) then
         do i = 1, size(numbers)
            call numbers(i)%start_selection()
         end do
      end if
      do while (.not. is_done)
         call select_numbers(number, store, shards, first, numbers, is_done, error)
         if (allocated(error)) return
      end do
      statistics%n_samples = plan%cases(number)%n_samples
      call numbers(1)%finish(statistics%slip)
      call numbers(2)%finish(statistics%slip_distance)
      call numbers(3)%finish(statistics%dissipation)
      if (size(numbers) > 3) call numbers(4)%finish(statistics%harmonic_amplitude)
      if (.not. has_series) return
      call spans%finish(statistics)
      if (plan%excitation%per_sample) statistics%slip_mean_time_error = 0.0_wp   ! samples lower it
   end subroutine find_slip_statistics

   !> Collectors of a case; none of a single sample.
   subroutine start_numbers(plan, number, numbers)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(joint_collector), allocatable, intent(out) :: numbers(:)
      integer :: i, n

      n = 0
      if (plan%cases(number)%n_samples > 1) n = merge(4, 3, plan%excitation%kind == 'sine')
      allocate (numbers(n))
      do i = 1, n
         call start_joints(plan%cases(number)%n_samples, &
                           merge(plan%structure%n_dof, plan%structure%n_joints, i == 4), &
                           plan%output%percentiles, plan%seed, numbers(i))
      end do
   end subroutine start_numbers

   !> Slip fractions, slip distances and dissipations of the joints, or amplitudes of the dofs.
   pure function numbers_of(samples, quantity) result(values)
      type(block_result), intent(in) :: samples
      integer, intent(in) :: quantity
      real(wp), allocatable :: values(:, :)   !! (joint or dof, sample)

      select case (quantity)
      case (1)
         values = samples%slip_fraction
      case (2)
         values = samples%slip_distance
      case (3)
         values = samples%dissipation
      case (4)
         values = samples%harmonic_amplitude
      end select
   end function numbers_of

   !> Shows all samples to the collectors once more, which select their percentiles.
   subroutine select_numbers(number, store, shards, first, numbers, is_done, error)
      integer, intent(in) :: number
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: first(:)   !! samples of the groups
      type(joint_collector), intent(inout) :: numbers(:)
      logical, intent(out) :: is_done   !! else they want to see them again
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: samples
      integer :: g, i
      logical :: has_all

      is_done = .true.
      do g = 1, size(first) - 1
         call attend_to_others()
         call read_samples(store, shards, number, first(g), first(g + 1) - 1, samples, error)
         if (allocated(error)) return
         do i = 1, size(numbers)
            call numbers(i)%select_again(numbers_of(samples, i))
         end do
      end do
      do i = 1, size(numbers)
         call numbers(i)%take_selected(has_all)
         is_done = is_done .and. has_all
      end do
   end subroutine select_numbers

   !> The slip series of some samples, shard by shard, and the errors they tell.
   subroutine take_series(shards, samples, spans, error)
      type(shard_type), intent(in) :: shards(:)
      type(block_result), intent(inout) :: samples   !! slip_fraction_error is found
      type(span_collector), intent(inout) :: spans
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: series(:, :, :)   ! (dof, span, sample)
      integer :: i, last, n

      n = 0
      last = samples%first_sample + samples%n_samples - 1
      samples%slip_fraction_error = 0.0_wp*samples%slip_fraction
      do i = 1, size(shards)
         if (shards(i)%first_sample > last) exit
         if (shards(i)%first_sample + shards(i)%n_samples <= samples%first_sample) cycle
         call read_slip_series(shards(i), samples%first_sample + n, last, series, error)
         if (allocated(error)) return
         call spans%add(series, samples%slip_fraction_error(:, n + 1:n + size(series, 3)))
         n = n + size(series, 3)
      end do
   end subroutine take_series

   !> The spectra of a group of samples at frequencies first..last.
   subroutine add_part(number, store, shards, part, first, last, group, bands, error)
      integer, intent(in) :: number
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: part, first, last, group
      type(band_collector), intent(inout) :: bands
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: psd(:, :, :)     ! (dof, frequency, sample)
      real(wp), allocatable :: power(:, :, :)   ! (dof, batch and range, sample)
      integer :: f, n_dof, n_samples, place, together

      n_dof = size(bands%at_frequency, 1)
      together = frequencies_together(n_dof, size(bands%at_frequency, 2))
      n_samples = bands%group_first(group + 1) - bands%group_first(group)
      do f = first, last, together
         call attend_to_others()
         allocate (psd(n_dof, min(together, last - f + 1), n_samples))
         call read_band(store, shards, number, 'psd', bands%group_first(group), f, psd, error)
         if (.not. allocated(error) .and. allocated(bands%batches%level)) then
            place = bands%first_of_power(f)
            allocate (power(n_dof, bands%first_of_power(f + size(psd, 2) - 1) + n_batches &
                            - place, n_samples))
            call read_band(store, shards, number, 'power_series', bands%group_first(group), &
                           place, power, error)
         end if
         if (allocated(error)) return
         call bands%add(part, f, group, psd, power)
         deallocate (psd)
         if (allocated(power)) deallocate (power)
      end do
   end subroutine add_part

end module driver_statistics
