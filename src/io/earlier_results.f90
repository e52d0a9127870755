!> An earlier results file at the place of the new one: whose it is, and its samples as shards, so
!> that a finished campaign goes on to more of them.
module io_earlier_results
   use campaign_results, only: block_result
   use core_error, only: error_type
   use core_source, only: is_hdf5_file
   use io_blocks, only: read_block
   use io_contents, only: check_contents
   use io_files, only: exists
   use io_gathering, only: finished_samples
   use io_hdf5, only: hdf5_file, hdf5_object, object_of, open_hdf5
   use io_identity, only: identity_type, refuse_foreign, require_command, require_same
   use io_results, only: case_group
   use io_shards, only: list_shards, shard_type, write_shard
   use io_store, only: shard_store
   implicit none(type, external)
   private
   public :: check_replaceable, extract_shards, inspect_results

contains

   !> Fails unless the same command wrote what stands at the place of an output: the results of
   !> another command, a record of the force and the scene itself are not thrown away.
   subroutine check_replaceable(path, command, takes_damaged, error)
      character(*), intent(in) :: path
      character(*), intent(in) :: command        !! run, replay, tradeoff
      logical, intent(in) :: takes_damaged       !! also an HDF5 file that cannot be opened
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      if (.not. exists(path)) return
      if (.not. is_hdf5_file(path)) then
         call refuse_foreign(path, error)
         return
      end if
      call open_hdf5(path, file, error)
      if (.not. allocated(error)) then
         call require_command(file, command, error)
         call file%abandon()
      else if (takes_damaged) then
         deallocate (error)
      end if
   end subroutine check_replaceable

   !> Finds how many samples of each case, then of each audit, a results file holds. Reads the
   !> whole file: one of another scene or program, or a damaged one, is refused by name.
   subroutine inspect_results(path, identity, n_samples, error)
      character(*), intent(in) :: path
      type(identity_type), intent(in) :: identity
      !> (case and audit), twice as many as cases; not allocated: no file
      integer, allocatable, intent(out) :: n_samples(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_object) :: group
      integer, allocatable :: found(:)
      integer :: i, n, n_own

      if (.not. exists(path)) return
      call open_hdf5(path, file, error)
      if (allocated(error)) return
      call require_same(file, identity, error)
      if (.not. allocated(error)) then
         call check_contents(file, error)
         if (allocated(error)) error%message = error%message//': put a sound copy in its '// &
                                'place, or discard it with --fresh and compute its samples again'
      end if
      n_own = 0
      do while (.not. allocated(error))
         if (.not. file%has(case_group(n_own + 1, huge(1)))) exit
         n_own = n_own + 1
      end do
      allocate (found(0))
      do i = 1, 2*n_own
         n = 0
         group = object_of(file, case_group(i, n_own))
         if (file%has(group%path)) call group%read('n_samples', n)
         call group%take_error(error)
         if (allocated(error)) exit
         found = [found, n]
      end do
      call file%abandon()
      if (.not. allocated(error)) call move_alloc(found, n_samples)
   end subroutine inspect_results

   !> Writes the samples of a results file as shards, but for those that the store has already.
   subroutine extract_shards(path, n_samples, samples_per_shard, store, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_samples(:)   !! (case and audit), as inspect_results found them
      integer, intent(in) :: samples_per_shard
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(shard_type), allocatable :: shards(:)
      type(hdf5_file) :: file
      integer :: case_number

      call list_shards(store, shards, error)
      if (allocated(error)) return
      call open_hdf5(path, file, error)
      if (allocated(error)) return
      do case_number = 1, size(n_samples)
         call extract_case(file, case_group(case_number, size(n_samples)/2), case_number, &
                           samples_per_shard, store, &
                           finished_samples(shards, case_number, n_samples(case_number)), error)
         if (allocated(error)) exit
      end do
      call file%abandon()
   end subroutine extract_shards

   subroutine extract_case(file, group, case_number, samples_per_shard, store, is_stored, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: group   !! its path
      integer, intent(in) :: case_number, samples_per_shard
      type(shard_store), intent(in) :: store
      logical, intent(in) :: is_stored(:)   !! (sample)
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: block(1)
      integer :: first, last

      do first = 1, size(is_stored), samples_per_shard
         last = min(first + samples_per_shard - 1, size(is_stored))
         if (all(is_stored(first:last))) cycle
         call hold(block(1))
         call read_block(file, group, block(1), first - 1, 0, last - first + 1, .false., error)
         if (allocated(error)) return
         call write_shard(store, block, error)
         if (allocated(error)) return
      end do

   contains

      !> Starts a block of samples first..last without datasets.
      subroutine hold(blank)
         type(block_result), intent(out) :: blank

         blank%case_number = case_number
         blank%first_sample = first
         blank%n_samples = last - first + 1
      end subroutine hold

   end subroutine extract_case

end module io_earlier_results
