!> Cost of a campaign's storage and statistics in CPU time, for scheduling.py: shards of one block
!> and of several, and what a group of samples takes in the merge.
program storage
   use campaign_bands, only: band_collector, start_bands
   use campaign_columns, only: column_collector, high, low, middle, selection_type, start_columns
   use campaign_results, only: block_result
   use campaign_time_average, only: span_collector, start_spans
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_shards, only: list_shards, sort_shards, read_shard, shard_type, stored_samples, &
                        write_shard
   use io_store, only: identity_type, new_store, remove_store, shard_store
   implicit none(type, external)
   integer, parameter :: n_samples = 32, n_dof = 5, n_band = 61
   integer, parameter :: n_frequencies = 1025   !! segments of 8192 steps, every 4th step
   integer, parameter :: n_group = 2**14, n_spans = 64
   real(wp), parameter :: percentiles(*) = [5.0_wp, 95.0_wp]
   type(error_type), allocatable :: error

   call measure_shards(40, 1, '')
   call measure_shards(10, 4, '_of_4')
   call measure_spectra()
   call measure_joints()

contains

   !> Times shards of so many blocks: written, verified, and read as the merge reads them.
   subroutine measure_shards(n_shards, n_blocks, ending)
      integer, intent(in) :: n_shards, n_blocks
      character(*), intent(in) :: ending   !! end of the names
      type(shard_store) :: store
      type(shard_type), allocatable :: shards(:)
      type(stored_samples) :: stored
      type(block_result), allocatable :: blocks(:)
      type(block_result) :: samples
      real(wp), allocatable :: psd(:, :, :)
      real(wp) :: began
      integer :: b, i

      store = new_store('bench_storage.h5', identity_type('0', '0', '0', 'run', ''))
      allocate (blocks(n_blocks))
      do b = 1, n_blocks
         call make_block(blocks(b))
      end do
      call cpu_time(began)
      do i = 1, n_shards
         do b = 1, n_blocks
            blocks(b)%first_sample = 1 + ((i - 1)*n_blocks + b - 1)*n_samples
         end do
         call write_shard(store, blocks, error)
         call check()
      end do
      call tell('write_shard'//ending, began, n_shards)

      call list_shards(store, shards, error)
      call check()
      call cpu_time(began)
      do i = 1, n_shards
         call read_shard(store, shards(i), samples, error)
         call check()
      end do
      call tell('read_shard'//ending, began, n_shards)

      call cpu_time(began)
      call sort_shards(store, shards, stored)
      call stored%read(1, 1, n_shards*n_blocks*n_samples, samples, error)
      call check()
      call tell('read_samples'//ending, began, n_shards)

      allocate (psd(n_dof, n_band, n_shards*n_blocks*n_samples))
      call cpu_time(began)
      call stored%read_part(1, 'psd', [1, 1, 1], psd, error)
      call check()
      call tell('read_part'//ending, began, n_shards)
      call remove_store(store, error)
      call check()
   end subroutine measure_shards

   subroutine make_block(block)
      type(block_result), intent(out) :: block

      block%case_number = 1
      block%n_samples = n_samples
      allocate (block%friction(n_dof, n_samples), source=0.1_wp)
      allocate (block%slip_fraction, source=block%friction)
      allocate (block%slip_starts(n_dof, n_samples), block%stick_starts(n_dof, n_samples), &
                source=1.0_wp)
      allocate (block%psd(n_dof, n_frequencies, n_samples))
      call random_number(block%psd)
   end subroutine make_block

   !> Times a range of frequencies of a group among a million samples: its statistics, and the
   !> search for the percentiles of all.
   subroutine measure_spectra()
      type(band_collector) :: bands
      type(selection_type) :: selection
      real(wp), allocatable :: psd(:, :, :)
      real(wp) :: began
      integer :: dof, f, i

      allocate (psd(n_dof, n_band, n_group))
      call random_number(psd)
      call start_bands(1000000, n_dof, [(real(i, wp), i=1, n_band)], percentiles, 1, bands)
      call cpu_time(began)
      call bands%add(1, 1, 1, psd(:, :, :bands%columns%group_first(2) - 1))
      call tell('spectra_part', began, 1)
      call repeat_group(bands%columns)
      call cpu_time(began)
      call bands%columns%open_selection(1, n_dof*n_band, selection)
      do f = 1, n_band
         do dof = 1, n_dof
            call selection%add(dof + n_dof*(f - 1), psd(dof, f, :))
         end do
      end do
      call tell('selection_part', began, 1)
   end subroutine measure_spectra

   !> Times the joints of a group: three quantities, their percentiles of all samples, the slip
   !> series.
   subroutine measure_joints()
      type(column_collector) :: joints
      type(selection_type) :: selection
      type(span_collector) :: spans
      real(wp), allocatable :: values(:, :), series(:, :, :)
      real(wp) :: began
      integer :: i

      allocate (values(3*n_dof, 16000), series(n_dof, n_spans, 16000))
      call random_number(values)
      call random_number(series)
      call start_columns(1000000, 3*n_dof, percentiles, joints)
      call cpu_time(began)
      do i = 1, size(values, 1)
         call joints%add(i, 1, values(i, :))
      end do
      call tell('joints_group', began, 1)
      call repeat_group(joints)
      call cpu_time(began)
      call joints%open_selection(1, size(values, 1), selection)
      do i = 1, size(values, 1)
         call selection%add(i, values(i, :))
      end do
      call tell('joints_selection', began, 1)
      call cpu_time(began)
      call start_spans(n_spans, n_dof, 1, spans)
      call spans%add(1, series)
      call tell('spans_group', began, 1)
   end subroutine measure_joints

   !> Finds the percentiles of uniform numbers, as if all groups were like the first.
   subroutine repeat_group(collector)
      type(column_collector), intent(inout) :: collector
      integer :: p

      do p = 1, size(percentiles)
         collector%at(:, p, middle) = percentiles(p)/100
         collector%at(:, p, low) = percentiles(p)/100 - 4.0e-4_wp
         collector%at(:, p, high) = percentiles(p)/100 + 4.0e-4_wp
      end do
   end subroutine repeat_group

   !> Prints the milliseconds of one of n times of some work.
   subroutine tell(work, began, n)
      character(*), intent(in) :: work
      real(wp), intent(in) :: began
      integer, intent(in) :: n
      real(wp) :: now

      call cpu_time(now)
      print '(a, t20, f9.3, a)', work, 1.0e3_wp*(now - began)/n, ' ms'
   end subroutine tell

   subroutine check()
      if (allocated(error)) error stop error%message
   end subroutine check

end program storage
