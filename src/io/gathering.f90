!> What the shards of one case hold together: small data of all samples, spectra a range of
!> frequencies at a time.
module io_gathering
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use ensemble_results, only: block_result
   use io_blocks, only: read_block
   use io_hdf5, only: hdf5_file, open_hdf5, read_dataset, read_extent, read_part
   use io_shards, only: open_shard, shard_store, shard_type
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: count_transitions, finished_samples, read_psd_band, read_samples, read_slip_series, &
             shards_of

contains

   !> Which of samples 1..n_samples of a case have a shard.
   pure function finished_samples(shards, case_number, n_samples) result(is_finished)
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: case_number, n_samples
      logical :: is_finished(n_samples)
      integer :: first, i, last

      is_finished = .false.
      do i = 1, size(shards)
         if (shards(i)%case_number /= case_number) cycle
         first = shards(i)%first_sample
         last = min(first + shards(i)%n_samples - 1, n_samples)
         is_finished(first:last) = .true.
      end do
   end function finished_samples

   !> The shards of a case with any of samples 1..n_samples, in sample order.
   pure function shards_of(shards, case_number, n_samples) result(chosen)
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: case_number, n_samples
      type(shard_type), allocatable :: chosen(:)

      chosen = pack(shards, shards%case_number == case_number .and. &
                    shards%first_sample <= n_samples)
      chosen = chosen(sort_order(real(chosen%first_sample, wp)))
   end function shards_of

   !> Transitions of samples 1..n_samples.
   subroutine count_transitions(shards, n_samples, n_transitions, error)
      type(shard_type), intent(in) :: shards(:)   !! of one case
      integer, intent(in) :: n_samples
      integer, intent(out) :: n_transitions
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer(long), allocatable :: counts(:, :)
      integer :: i, n

      n_transitions = 0
      do i = 1, size(shards)
         call open_hdf5(shards(i)%path, file, error)
         if (allocated(error)) return
         allocate (counts(1, shards(i)%n_samples))
         call read_dataset(file, '/transition_count', counts, error)
         call file%abandon()
         if (allocated(error)) return
         n = min(shards(i)%n_samples, n_samples - shards(i)%first_sample + 1)
         n_transitions = n_transitions + int(sum(counts(1, :n)))
         deallocate (counts)
      end do
   end subroutine count_transitions

   !> The slip series of those samples of a shard that are among samples 1..n_samples.
   subroutine read_slip_series(shard, n_samples, series, error)
      type(shard_type), intent(in) :: shard
      integer, intent(in) :: n_samples
      real(wp), allocatable, intent(out) :: series(:, :, :)   !! (dof, span, sample)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer(long), allocatable :: n(:)

      call open_hdf5(shard%path, file, error)
      if (allocated(error)) return
      call read_extent(file, '/slip_series', 3, n, error)
      if (.not. allocated(error)) then
         n(3) = min(n(3), n_samples - shard%first_sample + 1_long)
         allocate (series(n(1), n(2), n(3)))
         call read_part(file, '/slip_series', [1, 1, 1], series, error)
      end if
      call file%abandon()
   end subroutine read_slip_series

   !> Everything of samples 1..n_samples but series, spectra, histories and transitions.
   subroutine read_samples(store, shards, case_number, n_samples, block, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: case_number, n_samples
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: part
      type(hdf5_file) :: file
      integer :: i, last

      call require_all(store, shards, case_number, n_samples, error)
      if (allocated(error)) return
      do i = 1, size(shards)
         if (shards(i)%case_number /= case_number .or. shards(i)%first_sample > n_samples) cycle
         call open_shard(store, shards(i), file, part, error)
         if (allocated(error)) return
         call read_block(file, '/', part, error, skips_long=.true.)
         call file%abandon()
         if (allocated(error)) return
         last = min(part%first_sample + part%n_samples - 1, n_samples)
         call place(part%friction, block%friction)
         call place(part%slip_fraction, block%slip_fraction)
         call place(part%folded_share, block%folded_share)
         call place(part%energy, block%energy)
         call place_counts(part%slip_starts, block%slip_starts)
         call place_counts(part%stick_starts, block%stick_starts)
      end do
      block%case_number = case_number
      block%first_sample = 1
      block%n_samples = n_samples

   contains

      subroutine place(values, all_values)
         real(wp), allocatable, intent(in) :: values(:, :)
         real(wp), allocatable, intent(inout) :: all_values(:, :)

         if (.not. allocated(values)) return
         if (.not. allocated(all_values)) allocate (all_values(size(values, 1), n_samples))
         all_values(:, part%first_sample:last) = values(:, :last - part%first_sample + 1)
      end subroutine place

      subroutine place_counts(values, all_values)
         integer(long), allocatable, intent(in) :: values(:, :)
         integer(long), allocatable, intent(inout) :: all_values(:, :)

         if (.not. allocated(values)) return
         if (.not. allocated(all_values)) allocate (all_values(size(values, 1), n_samples))
         all_values(:, part%first_sample:last) = values(:, :last - part%first_sample + 1)
      end subroutine place_counts

   end subroutine read_samples

   !> Spectra of samples 1..n at frequencies first_frequency, first_frequency + 1, ... (counted from
   !> 1). Shards keep 64 neighbouring frequencies together: ranges of a multiple of 64 read least.
   subroutine read_psd_band(store, shards, case_number, first_frequency, psd, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: case_number, first_frequency
      real(wp), intent(out) :: psd(:, :, :)   !! (dof, frequency, sample)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      real(wp), allocatable :: part(:, :, :)
      integer :: first, i, last

      call require_all(store, shards, case_number, size(psd, 3), error)
      if (allocated(error)) return
      do i = 1, size(shards)
         first = shards(i)%first_sample
         last = min(first + shards(i)%n_samples - 1, size(psd, 3))
         if (shards(i)%case_number /= case_number .or. last < first) cycle
         call open_hdf5(shards(i)%path, file, error)
         if (allocated(error)) return
         allocate (part(size(psd, 1), size(psd, 2), last - first + 1))
         call read_part(file, '/psd', [1, first_frequency, 1], part, error)
         call file%abandon()
         if (allocated(error)) return
         psd(:, :, first:last) = part
         deallocate (part)
      end do
   end subroutine read_psd_band

   !> A sample without a shard is an error: its shard was removed while the run went on.
   subroutine require_all(store, shards, case_number, n_samples, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: case_number, n_samples
      type(error_type), allocatable, intent(out) :: error
      integer :: missing

      missing = findloc(finished_samples(shards, case_number, n_samples), .false., dim=1)
      if (missing > 0) then
         call raise(error, exit_file, store%folder//' lacks sample '//to_text(missing)// &
                    ' of case '//to_text(case_number)//': run again to compute it')
      end if
   end subroutine require_all

end module io_gathering
