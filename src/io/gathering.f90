!> The samples that a store has in its shards: small data of many samples, large data a part at a
!> time.
module io_gathering
   use campaign_results, only: block_result
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use io_blocks, only: read_block
   use io_hdf5, only: hdf5_file, move_part, open_hdf5
   use io_shards, only: shard_type
   use io_store, only: shard_store
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: finished_samples, order_shards, stored_samples

   !> The shards of a store. Whose they are and that they are sound, verify_shard has seen.
   type :: stored_samples
      type(shard_store) :: store
      type(shard_type), allocatable :: shards(:)   !! by their cases, then by their samples
   contains
      procedure :: places
      procedure :: read => read_samples
      procedure :: read_part
      procedure, private :: require_all
   end type stored_samples

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

   !> Prepares to read samples.
   pure subroutine order_shards(store, shards, stored)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(stored_samples), intent(out) :: stored

      stored%store = store
      stored%shards = shards(sort_order(shards%case_number*2.0_wp**31 + shards%first_sample))
   end subroutine order_shards

   !> Places among the shards of those with any of samples first..last of a case.
   pure function places(self, case_number, first, last)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      integer, allocatable :: places(:)
      integer :: from, i, to

      from = max(findloc(self%shards%case_number, case_number, 1), 1)
      to = findloc(self%shards%case_number, case_number, 1, back=.true.)
      associate (shards => self%shards(from:to))
         places = pack([(i, i=from, to)], shards%first_sample <= last .and. &
                       shards%first_sample + shards%n_samples > first)
      end associate
   end function places

   !> Reads samples first..last of a case without slip series, spectra, histories and transitions.
   subroutine read_samples(self, case_number, first, last, block, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer, allocatable :: chosen(:)
      integer :: before, i, n

      call self%require_all(case_number, first, last, chosen, error)
      if (allocated(error)) return
      block%case_number = case_number
      block%first_sample = first
      block%n_samples = last - first + 1
      do i = 1, size(chosen)
         associate (shard => self%shards(chosen(i)))
            call find_common(shard, first, last, before, n)
            call open_hdf5(shard%path, file, error)
            if (allocated(error)) return
            call read_block(file, '/', block, before, shard%first_sample + before - first, n, &
                            .true., error)
         end associate
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_samples

   !> Reads a part of a dataset of samples: all values behind the first one, as far as there is
   !> room. Ranges of frequencies_together need the fewest reads of spectra.
   subroutine read_part(self, case_number, name, first, values, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number
      character(*), intent(in) :: name            !! 'psd', 'power_series' or 'slip_series'
      integer, intent(in) :: first(3)             !! place of the first value on each axis
      !> (dof or joint; frequency, batch and range, or span; sample)
      real(wp), intent(out), contiguous :: values(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer, allocatable :: chosen(:)
      integer :: before, i, last, n, place

      last = first(3) + size(values, 3) - 1
      call self%require_all(case_number, first(3), last, chosen, error)
      if (allocated(error)) return
      do i = 1, size(chosen)
         associate (shard => self%shards(chosen(i)))
            call find_common(shard, first(3), last, before, n)
            place = shard%first_sample + before - first(3)
            call open_hdf5(shard%path, file, error)
         end associate
         if (allocated(error)) return
         call move_part(file, '/'//name, [first(:2), before + 1], &
                        values(:, :, place + 1:place + n), .false., error)
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_part

   !> Finds the samples of a shard that are among first..last: n of them, after the first `before`.
   pure subroutine find_common(shard, first, last, before, n)
      type(shard_type), intent(in) :: shard
      integer, intent(in) :: first, last
      integer, intent(out) :: before, n

      before = max(first - shard%first_sample, 0)
      n = min(shard%n_samples, last - shard%first_sample + 1) - before
   end subroutine find_common

   !> Finds the shards of samples first..last of a case; refuses samples of which one has no shard:
   !> it was removed during the run.
   subroutine require_all(self, case_number, first, last, chosen, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      integer, allocatable, intent(out) :: chosen(:)   !! as `places` has them
      type(error_type), allocatable, intent(out) :: error
      integer :: i, missing

      chosen = self%places(case_number, first, last)
      missing = first
      do i = 1, size(chosen)
         associate (shard => self%shards(chosen(i)))
            if (shard%first_sample > missing) exit
            missing = max(missing, shard%first_sample + shard%n_samples)
         end associate
      end do
      if (missing > last) return
      call raise(error, exit_file, self%store%folder//' lacks sample '//to_text(missing)// &
                 ' of case '//to_text(case_number)//': run again to compute it')
   end subroutine require_all

end module io_gathering
