!> Data of all shards of one case: small data of all samples, large data a part at a time.
module io_gathering
   use campaign_results, only: block_result
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use io_blocks, only: read_block
   use io_hdf5, only: hdf5_file, move_part, open_hdf5, read_dataset, read_extent
   use io_shards, only: shard_type
   use io_store, only: shard_store
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: count_transitions, finished_samples, read_part, read_samples, shards_of

contains

   !> True if a sample of 1..n_samples of a case has a shard.
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
      integer, allocatable :: order(:)
      integer :: i

      ! by index: gfortran does not free the paths of packed shards
      order = pack([(i, i=1, size(shards))], shards%case_number == case_number .and. &
                   shards%first_sample <= n_samples)
      order = order(sort_order(real(shards(order)%first_sample, wp)))
      chosen = shards(order)
   end function shards_of

   !> Counts the transitions of samples 1..n_samples.
   subroutine count_transitions(shards, n_samples, n_transitions, error)
      type(shard_type), intent(in) :: shards(:)   !! of one case
      integer, intent(in) :: n_samples
      integer, intent(out) :: n_transitions
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer(long), allocatable :: n_rows(:)
      real(wp), allocatable :: sample(:)
      integer :: i

      n_transitions = 0
      do i = 1, size(shards)
         call open_hdf5(shards(i)%path, file, error)
         if (allocated(error)) return
         call read_extent(file, '/transition_sample', 1, n_rows, error)
         if (.not. allocated(error) .and. &
             shards(i)%first_sample + shards(i)%n_samples - 1 > n_samples) then   ! it is cut
            allocate (sample(n_rows(1)))
            call read_dataset(file, '/transition_sample', sample, error)
            n_rows = count(nint(sample) <= n_samples)
            deallocate (sample)
         end if
         call file%abandon()
         if (allocated(error)) return
         n_transitions = n_transitions + int(n_rows(1))
      end do
   end subroutine count_transitions

   !> Reads samples first..last without slip series, spectra, histories and transitions.
   subroutine read_samples(store, shards, case_number, first, last, block, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of one case, as shards_of has them
      integer, intent(in) :: case_number, first, last
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer :: before, i, n

      call require_all(store, shards, case_number, first, last, error)
      if (allocated(error)) return
      block%case_number = case_number
      block%first_sample = first
      block%n_samples = last - first + 1
      do i = 1, size(shards)
         call common_samples(shards(i), first, last, before, n)
         if (n < 1) cycle
         call open_hdf5(shards(i)%path, file, error)   ! whose it is, verify_shard has seen
         if (allocated(error)) return
         call read_block(file, '/', block, before, shards(i)%first_sample + before - first, n, &
                         .true., error)
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_samples

   !> Reads a part of a dataset of the samples: all values behind the first one, as far as there is
   !> room. Ranges of frequencies_together need the fewest reads of spectra.
   subroutine read_part(store, shards, case_number, name, first, values, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of one case, as shards_of has them
      integer, intent(in) :: case_number
      character(*), intent(in) :: name            !! 'psd', 'power_series' or 'slip_series'
      integer, intent(in) :: first(3)             !! place of the first value on each axis
      !> (dof or joint; frequency, batch and range, or span; sample)
      real(wp), intent(out), contiguous :: values(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer :: before, i, last, n, place

      last = first(3) + size(values, 3) - 1
      call require_all(store, shards, case_number, first(3), last, error)
      if (allocated(error)) return
      do i = 1, size(shards)
         call common_samples(shards(i), first(3), last, before, n)
         if (n < 1) cycle
         call open_hdf5(shards(i)%path, file, error)
         if (allocated(error)) return
         place = shards(i)%first_sample + before - first(3)
         call move_part(file, '/'//name, [first(:2), before + 1], &
                        values(:, :, place + 1:place + n), .false., error)
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_part

   !> Finds the samples of a shard that are among first..last: n of them, after the first `before`.
   pure subroutine common_samples(shard, first, last, before, n)
      type(shard_type), intent(in) :: shard
      integer, intent(in) :: first, last
      integer, intent(out) :: before, n

      before = max(first - shard%first_sample, 0)
      n = min(shard%n_samples, last - shard%first_sample + 1) - before
   end subroutine common_samples

   !> Refuses samples first..last of which one has no shard: it was removed during the run.
   subroutine require_all(store, shards, case_number, first, last, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)   !! of one case, as shards_of has them
      integer, intent(in) :: case_number, first, last
      type(error_type), allocatable, intent(out) :: error
      integer :: i, missing

      missing = first
      do i = 1, size(shards)
         if (shards(i)%first_sample > missing) exit
         missing = max(missing, shards(i)%first_sample + shards(i)%n_samples)
      end do
      if (missing > last) return
      call raise(error, exit_file, store%folder//' lacks sample '//to_text(missing)// &
                 ' of case '//to_text(case_number)//': run again to compute it')
   end subroutine require_all

end module io_gathering
