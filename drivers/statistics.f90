!> The statistics of a case over its samples, in memory that does not grow with their number.
module driver_statistics
   use campaign_bands, only: band_collector, start_bands
   use campaign_columns, only: column_collector, start_columns
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result, case_statistics, n_quantities, numbers_of, &
                               spectrum_layout
   use campaign_selection, only: selection_type
   use campaign_time_average, only: count_spans, fewest_spans, span_collector, start_spans
   use core_chunks, only: frequencies_together
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_shards, only: stored_samples
   use numerics_correlated, only: n_batches
   use parallel_work, only: new_counter, work_counter
   use parallel_world, only: attend_to_others, world_type
   implicit none(type, external)
   private
   public :: case_task, open_case

   integer, parameter :: most_slices = 32   !! of the frequencies, shared out over the ranks
   integer, parameter :: samples_together = 64   !! whose slip series are read at once

   !> The statistics of one case in the making: `open_case`, then every rank takes items when it has
   !> time, then `close`. An item is a slice of the frequencies of a group of samples, or the joints
   !> of a group.
   type :: case_task
      integer, private :: number = 0             !! of the case
      logical, private :: has_spans = .false.
      integer, private :: width = 0              !! frequencies of a slice
      integer, private :: n_slices = 0           !! of all frequencies; 0: without spectra
      type(band_collector), private :: bands
      type(column_collector), private :: numbers   !! as numbers_of has them; one sample: no groups
      type(span_collector), private :: spans
      type(work_counter), private :: counter
   contains
      procedure :: take_items
      procedure :: close => close_case
   end type case_task

contains

   !> Shares out the statistics of a case among the ranks. Collective.
   subroutine open_case(world, plan, number, task, layout)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(case_task), intent(out) :: task
      type(spectrum_layout), intent(in), optional :: layout   !! absent: without spectra
      integer :: n_dof, n_numbers, n_samples

      task%number = number
      n_samples = plan%cases(number)%n_samples
      if (n_samples > 1) then
         associate (structure => plan%structure, n_spans => count_spans(plan%integration))
            task%has_spans = plan%output%slip .and. n_spans >= fewest_spans
            n_numbers = n_quantities*structure%n_joints
            if (plan%excitation%kind == 'sine') n_numbers = n_numbers + structure%n_dof
            call start_columns(n_samples, n_numbers, plan%output%percentiles, task%numbers)
            call start_spans(n_spans, structure%n_joints, task%numbers%n_groups, task%spans)
         end associate
      end if
      if (present(layout) .and. plan%output%spectrum .and. n_samples > 1) then
         n_dof = size(kept_dofs(plan))
         associate (n => size(layout%frequency))
            task%width = frequencies_together(n_dof, n)
            task%width = task%width*((n - 1)/(task%width*most_slices) + 1)
            task%n_slices = (n - 1)/task%width + 1
         end associate
         call start_bands(n_samples, n_dof, layout%frequency, plan%output%percentiles, &
                          task%n_slices, task%bands, layout%follows_power)
      end if
      call new_counter(world, (task%n_slices + 1)*task%numbers%n_groups, task%counter)
   end subroutine open_case

   !> Takes items until none is left; an error keeps all ranks from going on.
   subroutine take_items(self, stored, error)
      class(case_task), intent(inout) :: self
      type(stored_samples), intent(in) :: stored
      type(error_type), allocatable, intent(inout) :: error
      integer :: group, item, slice

      do
         item = self%counter%next(stops=allocated(error))
         if (item == 0) exit
         slice = modulo(item - 1, self%n_slices + 1) + 1
         group = (item - 1)/(self%n_slices + 1) + 1
         if (slice > self%n_slices) then
            call add_joints(self, stored, group, error)
         else
            call add_slice(self, stored, group, slice, error)
         end if
      end do
   end subroutine take_items

   !> Joins what all ranks have found, for every rank. Collective.
   subroutine close_case(self, world, plan, stored, statistics, error)
      class(case_task), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(stored_samples), intent(in) :: stored
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(inout) :: error

      call self%counter%close()
      if (world%any_true(allocated(error)) .or. self%numbers%n_groups == 0) return
      call join_columns(world, stored, self, .false., self%numbers, error)
      if (world%any_true(allocated(error))) return
      call world%add_up(size(self%spans%common), self%spans%common)
      call world%add_up(size(self%spans%autocovariance), self%spans%autocovariance)
      call finish_joints(self, plan, statistics)
      if (self%n_slices == 0) return
      associate (bands => self%bands)
         call world%add_up(size(bands%influence), bands%influence)
         call world%add_up(size(bands%bias), bands%bias)
         if (allocated(bands%batches%variance)) &
            call world%add_up(size(bands%batches%variance), bands%batches%variance)
      end associate
      call join_columns(world, stored, self, .true., self%bands%columns, error)
      if (.not. allocated(error)) call self%bands%finish(statistics)
   end subroutine close_case

   !> Joins what all ranks have of some columns, numbers of the joints or densities; where they come
   !> in groups, selects the percentiles of all samples, of as many ranges of frequencies at once as
   !> keep all ranks busy. Collective.
   subroutine join_columns(world, stored, task, are_densities, columns, error)
      type(world_type), intent(in) :: world
      type(stored_samples), intent(in) :: stored
      class(case_task), intent(in) :: task
      logical, intent(in) :: are_densities
      type(column_collector), intent(inout) :: columns
      type(error_type), allocatable, intent(out) :: error
      type(selection_type) :: selection
      real(wp), allocatable :: counts(:, :, :), kept(:)
      integer :: c, first, last, n_columns, n_frequencies, p, range, together
      logical :: is_done

      call world%add_up(size(columns%sums), columns%sums)
      call world%add_up(size(columns%at), columns%at)
      if (columns%n_groups == 1) return
      n_columns = size(columns%at, 1)
      if (are_densities) n_columns = task%bands%n_dof
      n_frequencies = size(columns%at, 1)/n_columns
      range = frequencies_together(n_columns, n_frequencies)
      together = range*(1 + world%n_ranks/columns%n_groups)
      do first = 1, n_frequencies, together
         last = min(first + together - 1, n_frequencies)
         call columns%open_selection(n_columns*(first - 1) + 1, n_columns*last, selection)
         is_done = .false.
         do while (.not. is_done)
            call add_all()
            if (world%any_true(allocated(error))) return
            counts = selection%counts
            call world%add_up(size(counts), counts)
            call selection%check(counts, is_done)
         end do
         do c = 1, size(selection%kept, 2)
            do p = 1, size(selection%kept, 1)
               kept = selection%kept(p, c)%value
               call world%join(kept)
               call columns%take_selected(n_columns*(first - 1) + c, p, &
                                          selection%order_statistics(p, c, kept))
            end do
         end do
      end do

   contains

      !> Adds the columns of all samples at frequencies first..last. Collective.
      subroutine add_all()
         type(work_counter) :: counter
         real(wp), allocatable :: values(:, :, :)   ! (column, frequency, sample)
         integer :: column, f, from, group, item, n_ranges

         n_ranges = (last - first)/range + 1
         call new_counter(world, n_ranges*columns%n_groups, counter)
         do
            item = counter%next(stops=allocated(error))
            if (item == 0) exit
            call attend_to_others()
            group = (item - 1)/n_ranges + 1
            from = first + range*modulo(item - 1, n_ranges)
            allocate (values(n_columns, min(range, last - from + 1), columns%group_size(group)))
            associate (first_sample => columns%group_first(group))
               if (are_densities) then
                  call stored%read_part(task%number, 'psd', [1, from, first_sample], values, error)
               else
                  call read_numbers(stored, task%number, first_sample, values(:, 1, :), error)
               end if
            end associate
            if (.not. allocated(error)) then
               do f = 1, size(values, 2)
                  do column = 1, n_columns
                     call selection%add(column + n_columns*(from + f - 1 - first), &
                                        values(column, f, :))
                  end do
               end do
            end if
            deallocate (values)
         end do
         call counter%close()
      end subroutine add_all

   end subroutine join_columns

   !> Adds the joints of a group of samples, and their slip series.
   subroutine add_joints(self, stored, group, error)
      class(case_task), intent(inout) :: self
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: group
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:, :)      ! (number, sample)
      real(wp), allocatable :: series(:, :, :)   ! (joint, span, sample)
      integer :: i, last

      call attend_to_others()
      associate (numbers => self%numbers)
         allocate (values(size(numbers%at, 1), numbers%group_size(group)))
         call read_numbers(stored, self%number, numbers%group_first(group), values, error)
         if (allocated(error)) return
         do i = 1, size(values, 1)
            call numbers%add(i, group, values(i, :))
         end do
         if (.not. self%has_spans) return
         last = numbers%group_first(group + 1) - 1
         do i = numbers%group_first(group), last, samples_together
            allocate (series(size(self%spans%common, 2), size(self%spans%common, 1), &
                             min(samples_together, last - i + 1)))
            call stored%read_part(self%number, 'slip_series', [1, 1, i], series, error)
            if (allocated(error)) return
            call self%spans%add(group, series)
            deallocate (series)
         end do
      end associate
   end subroutine add_joints

   !> Reads the numbers of some samples that have statistics.
   subroutine read_numbers(stored, number, first, values, error)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number          !! of the case
      integer, intent(in) :: first           !! sample
      real(wp), intent(out) :: values(:, :)  !! (number, sample) as numbers_of has them
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: samples

      call stored%read(number, first, first + size(values, 2) - 1, samples, error)
      if (.not. allocated(error)) values = numbers_of(samples)
   end subroutine read_numbers

   subroutine finish_joints(self, plan, statistics)
      class(case_task), intent(in) :: self
      type(plan_type), intent(in) :: plan
      type(case_statistics), intent(inout) :: statistics

      statistics%n_samples = plan%cases(self%number)%n_samples
      statistics%n_joints = plan%structure%n_joints
      associate (n => size(self%numbers%at, 1), last => self%numbers%n_percentiles + 2)
         allocate (statistics%numbers(n, last))
         call self%numbers%finish(statistics%numbers(:, :last - 1), statistics%numbers(:, last))
      end associate
      associate (slip => statistics%numbers(:statistics%n_joints, :))
         slip%high = min(slip%high, 1.0_wp)   ! an end beyond the samples knows no fraction
      end associate
      if (.not. self%has_spans) return
      call self%spans%finish(statistics%n_samples, statistics)
      if (plan%excitation%per_sample) statistics%slip_mean_time_error = 0.0_wp   ! samples lower it
   end subroutine finish_joints

   !> Adds the spectra of a group of samples at a slice of the frequencies.
   subroutine add_slice(self, stored, group, slice, error)
      class(case_task), intent(inout) :: self
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: group, slice
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: psd(:, :, :)     ! (dof, frequency, sample)
      real(wp), allocatable :: power(:, :, :)   ! (dof, batch and range, sample)
      integer :: f, last, n_dof, n_samples, place, together

      n_dof = self%bands%n_dof
      n_samples = self%bands%columns%group_size(group)
      together = frequencies_together(n_dof, self%bands%n_frequencies)
      last = min(slice*self%width, self%bands%n_frequencies)
      associate (bands => self%bands, first => self%bands%columns%group_first(group))
         do f = (slice - 1)*self%width + 1, last, together
            call attend_to_others()
            allocate (psd(n_dof, min(together, last - f + 1), n_samples))
            call stored%read_part(self%number, 'psd', [1, f, first], psd, error)
            if (.not. allocated(error) .and. allocated(bands%batches%variance)) then
               place = bands%first_of_power(f)
               allocate (power(n_dof, bands%first_of_power(f + size(psd, 2) - 1) + n_batches &
                               - place, n_samples))
               call stored%read_part(self%number, 'power_series', [1, place, first], power, error)
            end if
            if (allocated(error)) return
            call bands%add(slice, f, group, psd, power)
            deallocate (psd)
            if (allocated(power)) deallocate (power)
         end do
      end associate
   end subroutine add_slice

end module driver_statistics
