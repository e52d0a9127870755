!> The statistics of a case over its samples, in memory that does not grow with their number.
module driver_statistics
   use campaign_bands, only: band_collector, sample_groups, start_bands
   use campaign_joint_statistics, only: joint_collector, start_joints
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_results, only: block_result, case_statistics, spectrum_layout
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
   !> parts when it has time, then `close`.
   type :: spectra_task
      integer :: number = 0                      !! of the case
      type(shard_type), allocatable :: shards(:)
      logical, private :: has_bands = .false.
      integer, private :: width = 0              !! frequencies of a part
      type(band_collector), private :: bands
      type(work_counter), private :: counter
   contains
      procedure :: take_parts
      procedure :: close => close_spectra
   end type spectra_task

contains

   !> Shares out the frequencies of a case in parts; collective.
   subroutine open_spectra(world, plan, number, layout, shards, task)
      type(world_type), intent(in) :: world
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: number
      type(spectrum_layout), intent(in) :: layout
      type(shard_type), intent(in) :: shards(:)   !! of the case, as shards_of has them
      type(spectra_task), intent(out) :: task
      integer :: n_dof, n_parts, n_samples

      task%number = number
      task%shards = shards
      n_samples = plan%cases(number)%n_samples
      task%has_bands = plan%output%spectrum .and. n_samples > 1
      n_parts = 0
      if (task%has_bands) then
         n_dof = size(kept_dofs(plan))
         associate (n => size(layout%frequency))
            task%width = frequencies_together(n_dof, n)
            task%width = task%width*((n - 1)/(task%width*most_parts) + 1)
            n_parts = (n - 1)/task%width + 1
         end associate
         call start_bands(n_samples, n_dof, layout%frequency, plan%output%percentiles, plan%seed, &
                          n_parts, task%bands, layout%follows_power)
      end if
      call new_counter(world, int(n_parts, long), task%counter)
   end subroutine open_spectra

   !> Parts of the frequencies until none is left; an error keeps all ranks from going on.
   subroutine take_parts(self, store, error)
      class(spectra_task), intent(inout) :: self
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(inout) :: error
      integer :: part

      do
         if (allocated(error)) call self%counter%request_stop()
         part = int(self%counter%next())
         if (part == 0) exit
         call add_part(self%number, store, self%shards, part, (part - 1)*self%width + 1, &
                       min(part*self%width, size(self%bands%at_frequency, 2)), self%bands, error)
      end do
   end subroutine take_parts

   !> Hands the root what all ranks have found. Collective.
   subroutine close_spectra(self, world, statistics)
      class(spectra_task), intent(inout) :: self
      type(world_type), intent(in) :: world
      type(case_statistics), intent(inout) :: statistics

      call self%counter%close()
      if (.not. self%has_bands) return
      associate (bands => self%bands)
         call world%add_up(size(bands%at_frequency), bands%at_frequency)
         call world%add_up(size(bands%replicate), bands%replicate)
         call world%add_up(size(bands%integral), bands%integral)
         if (allocated(bands%batches%level)) &
            call world%add_up(size(bands%batches%level), bands%batches%level)
         if (world%is_root()) call bands%finish(statistics)
      end associate
   end subroutine close_spectra

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
      type(joint_collector) :: slip, slip_distance, dissipation, harmonic_amplitude
      type(span_collector) :: spans
      integer, allocatable :: first(:)
      integer :: g
      logical :: has_series, is_sine

      has_series = plan%output%slip .and. count_spans(plan%integration) >= fewest_spans
      is_sine = plan%excitation%kind == 'sine'
      first = sample_groups(plan%cases(number)%n_samples)
      if (plan%cases(number)%n_samples > 1) then
         call start(plan%structure%n_joints, slip)
         call start(plan%structure%n_joints, slip_distance)
         call start(plan%structure%n_joints, dissipation)
         if (is_sine) call start(plan%structure%n_dof, harmonic_amplitude)
      end if
      do g = 1, size(first) - 1
         call attend_to_others()
         call read_samples(store, shards, number, first(g), first(g + 1) - 1, samples, error)
         if (allocated(error)) return
         if (plan%cases(number)%n_samples > 1) then
            call slip%add(g, samples%slip_fraction)
            call slip_distance%add(g, samples%slip_distance)
            call dissipation%add(g, samples%dissipation)
            if (is_sine) call harmonic_amplitude%add(g, samples%harmonic_amplitude)
         end if
         if (has_series) call take_series(shards, samples, spans, error)
         if (allocated(error)) return
         if (present(group)) call put_short(group, plan, samples)
      end do
      if (plan%cases(number)%n_samples < 2) return
      statistics%n_samples = plan%cases(number)%n_samples
      call slip%finish(statistics%slip)
      call slip_distance%finish(statistics%slip_distance)
      call dissipation%finish(statistics%dissipation)
      if (is_sine) call harmonic_amplitude%finish(statistics%harmonic_amplitude)
      if (.not. has_series) return
      call spans%finish(statistics)
      if (plan%excitation%per_sample) statistics%slip_mean_time_error = 0.0_wp   ! samples lower it

   contains

      subroutine start(n_numbers, collector)
         integer, intent(in) :: n_numbers   !! of a sample
         type(joint_collector), intent(out) :: collector

         call start_joints(plan%cases(number)%n_samples, n_numbers, plan%output%percentiles, &
                           plan%seed, collector)
      end subroutine start

   end subroutine find_slip_statistics

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

   !> The spectra of all samples at frequencies first..last, group by group of the samples.
   subroutine add_part(number, store, shards, part, first, last, bands, error)
      integer, intent(in) :: number
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: part, first, last
      type(band_collector), intent(inout) :: bands
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: psd(:, :, :)     ! (dof, frequency, sample)
      real(wp), allocatable :: power(:, :, :)   ! (dof, batch and range, sample)
      integer :: f, g, n_dof, n_samples, place, together

      n_dof = size(bands%at_frequency, 1)
      together = frequencies_together(n_dof, size(bands%at_frequency, 2))
      do g = 1, size(bands%group_first) - 1
         n_samples = bands%group_first(g + 1) - bands%group_first(g)
         do f = first, last, together
            call attend_to_others()
            allocate (psd(n_dof, min(together, last - f + 1), n_samples))
            call read_band(store, shards, number, 'psd', bands%group_first(g), f, psd, error)
            if (.not. allocated(error) .and. allocated(bands%batches%level)) then
               place = bands%first_of_power(f)
               allocate (power(n_dof, bands%first_of_power(f + size(psd, 2) - 1) + n_batches &
                               - place, n_samples))
               call read_band(store, shards, number, 'power_series', bands%group_first(g), &
                              place, power, error)
            end if
            if (allocated(error)) return
            call bands%add(part, f, g, psd, power)
            deallocate (psd)
            if (allocated(power)) deallocate (power)
         end do
      end do
   end subroutine add_part

end module driver_statistics
