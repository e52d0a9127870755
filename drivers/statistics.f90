!> Plain statistics of a case over its samples. The ranks share the work; the memory does not grow
!> with the number of samples.
module driver_statistics
   use campaign_bands, only: band_collector, start_bands
   use campaign_columns, only: column_collector, selection_type, start_columns
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result, case_statistics, n_quantities, numbers_of, &
                               spectrum_layout
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
   public :: case_task, find_statistics, open_case

   integer, parameter :: most_slices = 32       !! largest number of slices of the frequencies
   integer, parameter :: samples_at_once = 64   !! samples whose slip series are read at once

   !> Statistics of one case: `open_case`, then `finish`, which every rank calls when it has time.
   !> An item is a slice of the frequencies of a group of samples, or all numbers of a group.
   type :: case_task
      integer, private :: number = 0               !! case number
      logical, private :: has_spans = .false.      !! true with slip series
      integer, private :: width = 0                !! frequencies of a slice
      integer, private :: n_slices = 0             !! slices of all frequencies; 0: no spectra
      type(band_collector), private :: bands
      type(column_collector), private :: numbers   !! numbers in the order of numbers_of
      type(span_collector), private :: spans
      type(work_counter), private :: counter
   contains
      procedure :: finish
   end type case_task

contains

   !> Computes the statistics of all cases with a process, but of no audits. Collective.
   subroutine find_statistics(world, plan, stored, statistics, error, layout)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(stored_samples), intent(in) :: stored
      type(case_statistics), intent(out) :: statistics(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      type(spectrum_layout), intent(in), optional :: layout   !! as in open_case
      type(case_task) :: task
      integer :: i

      do i = 1, size(statistics)
         if (plan%cases(i)%audits > 0 .or. plan%cases(i)%process == 0) cycle
         call open_case(world, plan, i, task, layout)
         call task%finish(world, plan, stored, statistics(i), error)
         if (world%any_true(allocated(error))) return
      end do
   end subroutine find_statistics

   !> Prepares the statistics of a case and divides them into items. Collective.
   subroutine open_case(world, plan, number, task, layout)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number   !! case number
      type(case_task), intent(out) :: task
      type(spectrum_layout), intent(in), optional :: layout   !! absent: no statistics of spectra
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

   !> Computes items until none is left; an error of any rank ends this on all ranks. Then adds up
   !> those of all ranks and finishes the statistics, equal on every rank. Collective.
   subroutine finish(self, world, plan, stored, statistics, error)
      class(case_task), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      type(stored_samples), intent(in) :: stored
      type(case_statistics), intent(inout) :: statistics
      type(error_type), allocatable, intent(inout) :: error
      integer :: group, item, slice

      do
         item = self%counter%next(stops=allocated(error))
         if (item == 0) exit
         slice = modulo(item - 1, self%n_slices + 1) + 1
         group = (item - 1)/(self%n_slices + 1) + 1
         if (slice > self%n_slices) then
            call add_numbers(self, stored, group, error)
         else
            call add_slice(self, stored, group, slice, error)
         end if
      end do
      call self%counter%close()
      if (world%any_true(allocated(error)) .or. self%numbers%n_groups == 0) return   ! one sample
      call join_columns(world, stored, self, .false., self%numbers, error)
      if (world%any_true(allocated(error))) return
      call world%add_up(size(self%spans%common), self%spans%common)
      call world%add_up(size(self%spans%autocovariance), self%spans%autocovariance)
      statistics%n_samples = plan%cases(self%number)%n_samples
      statistics%n_joints = plan%structure%n_joints
      associate (n => size(self%numbers%at, 1), last => self%numbers%n_percentiles + 2)
         allocate (statistics%numbers(n, last))
         call self%numbers%finish(statistics%numbers(:, :last - 1), statistics%numbers(:, last))
      end associate
      associate (slip => statistics%numbers(:statistics%n_joints, :))
         slip%high = min(slip%high, 1.0_wp)   ! an interval may end above the largest fraction
      end associate
      if (self%has_spans) then
         call self%spans%finish(statistics%n_samples, statistics)
         ! with a record per sample it is part of the Monte Carlo error
         if (plan%excitation%per_sample) statistics%slip_mean_time_error = 0.0_wp
      end if
      if (self%n_slices == 0) return
      associate (bands => self%bands)
         call world%add_up(size(bands%influence), bands%influence)
         call world%add_up(size(bands%bias), bands%bias)
         if (allocated(bands%in_batches)) &
            call world%add_up(size(bands%in_batches), bands%in_batches)
      end associate
      call join_columns(world, stored, self, .true., self%bands%columns, error)
      if (.not. allocated(error)) call self%bands%finish(statistics)
   end subroutine finish

   !> Adds up columns, numbers or densities, over the ranks. With several groups of samples selects
   !> the percentiles of all samples, of enough frequencies at once to keep all ranks busy.
   !> Collective.
   subroutine join_columns(world, stored, task, are_densities, columns, error)
      type(world_type), intent(in) :: world
      type(stored_samples), intent(in) :: stored
      class(case_task), intent(in) :: task
      logical, intent(in) :: are_densities
      type(column_collector), intent(inout) :: columns
      type(error_type), allocatable, intent(out) :: error
      type(selection_type) :: selection
      real(wp), allocatable :: counts(:, :, :), kept(:)
      integer :: c, first, last, n_at_once, n_columns, n_frequencies, p, range
      logical :: is_done

      call world%add_up(size(columns%sums), columns%sums)
      call world%add_up(size(columns%at), columns%at)
      if (columns%n_groups == 1) return
      n_columns = size(columns%at, 1)
      if (are_densities) n_columns = task%bands%n_dof
      n_frequencies = size(columns%at, 1)/n_columns
      range = frequencies_together(n_columns, n_frequencies)
      n_at_once = range*(1 + world%n_ranks/columns%n_groups)
      do first = 1, n_frequencies, n_at_once
         last = min(first + n_at_once - 1, n_frequencies)
         call columns%open_selection(n_columns*(first - 1) + 1, n_columns*last, selection)
         is_done = .false.
         do while (.not. is_done)
            call count_all()
            if (world%any_true(allocated(error))) return
            counts = selection%counts
            call world%add_up(size(counts), counts)
            call selection%check(counts, is_done)
         end do
         do c = 1, size(selection%kept, 2)
            do p = 1, size(selection%kept, 1)
               kept = selection%kept(p, c)%value
               call world%join(kept)
               call columns%store_selected(n_columns*(first - 1) + c, p, &
                                           selection%order_statistics(p, c, kept))
            end do
         end do
      end do

   contains

      !> Adds the values of all samples at frequencies first..last to the selection. Collective.
      subroutine count_all()
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
      end subroutine count_all

   end subroutine join_columns

   !> Adds the numbers and the slip series of a group of samples.
   subroutine add_numbers(self, stored, group, error)
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
         do i = numbers%group_first(group), last, samples_at_once
            allocate (series(size(self%spans%common, 2), size(self%spans%common, 1), &
                             min(samples_at_once, last - i + 1)))
            call stored%read_part(self%number, 'slip_series', [1, 1, i], series, error)
            if (allocated(error)) return
            call self%spans%add(group, series)
            deallocate (series)
         end do
      end associate
   end subroutine add_numbers

   !> Reads the numbers of consecutive samples.
   subroutine read_numbers(stored, number, first, values, error)
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: number          !! case number
      integer, intent(in) :: first           !! number of the first sample
      real(wp), intent(out) :: values(:, :)  !! (number, sample) in the order of numbers_of
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: samples

      call stored%read(number, first, first + size(values, 2) - 1, samples, error)
      if (.not. allocated(error)) values = numbers_of(samples)
   end subroutine read_numbers

   !> Adds the spectra of a group of samples at a slice of the frequencies.
   subroutine add_slice(self, stored, group, slice, error)
      class(case_task), intent(inout) :: self
      type(stored_samples), intent(in) :: stored
      integer, intent(in) :: group, slice
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: psd(:, :, :)     ! (dof, frequency, sample)
      real(wp), allocatable :: power(:, :, :)   ! (dof, batch and range, sample)
      integer :: f, last, n_at_once, n_dof, n_samples, place

      n_dof = self%bands%n_dof
      n_samples = self%bands%columns%group_size(group)
      n_at_once = frequencies_together(n_dof, self%bands%n_frequencies)
      last = min(slice*self%width, self%bands%n_frequencies)
      associate (bands => self%bands, first => self%bands%columns%group_first(group))
         do f = (slice - 1)*self%width + 1, last, n_at_once
            call attend_to_others()
            allocate (psd(n_dof, min(n_at_once, last - f + 1), n_samples))
            call stored%read_part(self%number, 'psd', [1, f, first], psd, error)
            if (.not. allocated(error) .and. allocated(bands%in_batches)) then
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
