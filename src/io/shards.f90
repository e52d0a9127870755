!> Shards: files of a store with finished blocks of samples. They are written once, listed, and read
!> whole, or their short datasets alone, or a part of one dataset.
module io_shards
   use campaign_results, only: block_result
   use campaign_study, only: block_range
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use io_blocks, only: read_block, transitions_before, write_blocks
   use io_files, only: list_files, remove_file, unfinished
   use io_hdf5, only: hdf5_file, hdf5_group, open_hdf5
   use io_lock, only: lock_type
   use io_process_results, only: process_file_name
   use io_store, only: advise, create_in_store, finish_in_store, open_in_store, &
                       remove_store, shard_store
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: shard_type
   public :: list_shards, shard_path, read_shard, remove_merged_shards, write_shard
   public :: finished_samples, sort_shards, stored_samples

   !> Case and samples of a shard, or of a range of samples in an earlier results file.
   type, extends(block_range) :: shard_type
      character(32) :: group = ''   !! path of the case in a results file; '' for a shard
      integer :: file_offset = 0    !! samples in the file before the first one
   end type shard_type

   !> Shards from which samples are read. `read_shard` has checked their identity and checksums.
   type :: stored_samples
      type(shard_store) :: store
      type(shard_type), allocatable :: shards(:)   !! shards by case, then by sample
   contains
      procedure :: shards_of
      procedure :: read => read_samples
      procedure :: read_part
      procedure :: count_transitions
      procedure, private :: require_all
   end type stored_samples

   !> An empty block. It lies in static memory, which is zero: the bounds that gfortran 11 reads in
   !> allocate_for.
   type(block_result) :: empty_block

contains

   !> Writes finished blocks, consecutive samples of a case, as one shard. It is on the disk when
   !> this returns without error.
   subroutine write_shard(store, blocks, error)
      type(shard_store), intent(in) :: store
      type(block_result), intent(inout) :: blocks(:)   !! left as they were
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      character(:), allocatable :: name

      associate (first => blocks(1)%first_sample)
         name = shard_name(shard_type(blocks(1)%case_number, first, &
                                      first + sum(blocks%n_samples) - 1))
      end associate
      call create_in_store(store, name, file, error)
      if (allocated(error)) return
      call write_blocks(file, blocks, error)
      call finish_in_store(store, name, file, error)
   end subroutine write_shard

   !> Path of a shard, which need not exist, or of the results file that has the samples.
   pure function shard_path(store, shard) result(path)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shard
      character(:), allocatable :: path

      path = store%folder//'/'//shard_name(shard)
      if (shard%group /= '') path = store%output
   end function shard_path

   !> Lists the shards of a store by their names; none, with an error, if a file has another name.
   subroutine list_shards(store, shards, error)
      type(shard_store), intent(in) :: store
      type(shard_type), allocatable, intent(out) :: shards(:)
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: digits, name, paths(:)
      integer :: i, k, n, numbers(3), status

      call list_files(store%folder//'/', '', paths, error)
      allocate (shards(size(paths)))
      n = 0
      do i = 1, size(paths)
         name = trim(paths(i) (len(store%folder) + 2:))
         digits = name//'/'   ! ends the reading
         do k = 1, len(name)
            if (verify(name(k:k), '0123456789') > 0) digits(k:k) = ' '
         end do
         numbers = 0
         read (digits, *, iostat=status) numbers
         if (status /= 0) numbers = 0   ! one is too large
         if (index(name, unfinished) > 0 .or. name == process_file_name(numbers(1))) cycle
         n = n + 1
         shards(n) = shard_type(numbers(1), numbers(2), numbers(3))
         if (shard_name(shards(n)) == name) cycle
         call raise(error, exit_file, store%folder//'/'//name// &
                    ' is not the name of a shard: only shards may lie in this folder')
         n = 0
         exit
      end do
      shards = shards(:n)
   end subroutine list_shards

   !> Reads a shard whole; refuses a damaged one, and one of another scene or program.
   subroutine read_shard(store, shard, block, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shard
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      block = empty_block
      if (shard%group /= '') then
         call open_hdf5(shard_path(store, shard), file, error)
      else
         call open_in_store(store, shard_name(shard), file, error)
      end if
      if (allocated(error)) return
      block%case_number = shard%case_number
      block%first_sample = shard%first
      block%n_samples = shard%last - shard%first + 1
      call read_block(file, trim(shard%group), block, shard%file_offset, 0, block%n_samples, &
                      .false., error)
      call file%abandon()
      if (shard%group == '') call advise(error)
   end subroutine read_shard

   !> Removes the shards whose samples a results file has, and the store if no other shards are
   !> left. Stops without an error if the run has lost its lock.
   subroutine remove_merged_shards(store, lock, n_samples, error)
      type(shard_store), intent(in) :: store
      type(lock_type), intent(inout) :: lock
      integer, intent(in) :: n_samples(:)   !! (case) in the results file
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: lost
      type(shard_type), allocatable :: shards(:)
      logical :: all_covered
      integer :: i, last

      call list_shards(store, shards, error)
      if (allocated(error)) return
      all_covered = .true.
      do i = 1, size(shards)
         call lock%check_ownership(lost)
         if (allocated(lost)) return
         last = 0
         if (shards(i)%case_number <= size(n_samples)) last = n_samples(shards(i)%case_number)
         if (shards(i)%last > last) then
            all_covered = .false.
         else
            call remove_file(shard_path(store, shards(i)), error)
            if (allocated(error)) return
         end if
      end do
      call lock%check_ownership(lost)
      if (all_covered .and. .not. allocated(lost)) call remove_store(store, error)
   end subroutine remove_merged_shards

   !> Name of a shard, such as c007_s00033-00064.h5 for samples 33 to 64 of case 7.
   pure function shard_name(shard) result(name)
      type(shard_type), intent(in) :: shard
      character(:), allocatable :: name
      character(64) :: buffer

      write (buffer, '(a, i0.3, a, i0.5, a, i0.5, a)') 'c', shard%case_number, '_s', shard%first, &
         '-', shard%last, '.h5'
      name = trim(buffer)
   end function shard_name

   !> True if a shard has the sample.
   pure function finished_samples(shards, n_samples) result(is_finished)
      type(shard_type), intent(in) :: shards(:)
      integer, intent(in) :: n_samples(:)   !! (case)
      logical, allocatable :: is_finished(:, :)   !! (sample, case)
      integer :: i

      allocate (is_finished(maxval([n_samples, 0]), size(n_samples)), source=.false.)
      do i = 1, size(shards)
         associate (shard => shards(i), c => shards(i)%case_number)
            if (c <= size(n_samples)) &
               is_finished(shard%first:min(shard%last, n_samples(c)), c) = .true.
         end associate
      end do
   end function finished_samples

   !> Sorts shards by cases, then by samples, for reading.
   pure subroutine sort_shards(store, shards, stored)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shards(:)
      type(stored_samples), intent(out) :: stored

      stored%store = store
      stored%shards = shards(sort_order(shards%case_number*2.0_wp**31 + shards%first))
   end subroutine sort_shards

   !> Shards with any of samples first..last of a case, in order of samples.
   pure function shards_of(self, case_number, first, last) result(shards)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      type(shard_type), allocatable :: shards(:)
      integer :: from, to

      from = max(findloc(self%shards%case_number, case_number, 1), 1)
      to = findloc(self%shards%case_number, case_number, 1, back=.true.)
      associate (all => self%shards(from:to))
         shards = pack(all, all%first <= last .and. all%last >= first)
      end associate
   end function shards_of

   !> Reads the short datasets of samples first..last of a case.
   subroutine read_samples(self, case_number, first, last, block, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(shard_type), allocatable :: shards(:)
      integer :: i

      call self%require_all(case_number, first, last, shards, error)
      if (allocated(error)) return
      block = empty_block
      block%case_number = case_number
      block%first_sample = first
      block%n_samples = last - first + 1
      do i = 1, size(shards)
         associate (shard => shards(i), from => max(shards(i)%first, first), &
                    to => min(shards(i)%last, last))
            call open_hdf5(shard_path(self%store, shard), file, error)
            if (allocated(error)) return
            call read_block(file, trim(shard%group), block, &
                            shard%file_offset + from - shard%first, from - first, to - from + 1, &
                            .true., error)
         end associate
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_samples

   !> Reads a part of a long dataset of a case, of the shape of `values`. Spectra need the fewest
   !> reads in ranges of `frequencies_together`.
   subroutine read_part(self, case_number, name, first, values, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number
      character(*), intent(in) :: name            !! 'psd', 'power_series' or 'slip_series'
      integer, intent(in) :: first(3)             !! index of the first value on each axis
      !> (dof or joint; frequency, batch and range, or span; sample)
      real(wp), intent(out), contiguous :: values(:, :, :)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      type(hdf5_group) :: group
      type(shard_type), allocatable :: shards(:)
      integer :: i, last

      last = first(3) + size(values, 3) - 1
      call self%require_all(case_number, first(3), last, shards, error)
      if (allocated(error)) return
      do i = 1, size(shards)
         associate (shard => shards(i), from => max(shards(i)%first, first(3)), &
                    to => min(shards(i)%last, last))
            call open_hdf5(shard_path(self%store, shard), file, error)
            if (allocated(error)) return
            group%file = file
            group%path = trim(shard%group)
            call group%read_part(name, [first(:2), shard%file_offset + from - shard%first + 1], &
                                 values(:, :, from - first(3) + 1:to - first(3) + 1))
            call group%take_error(error)
         end associate
         call file%abandon()
         if (allocated(error)) return
      end do
   end subroutine read_part

   !> Counts the transitions of samples 1..last of a case.
   subroutine count_transitions(self, case_number, last, n, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, last
      integer, intent(out) :: n
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_group) :: group
      type(shard_type), allocatable :: shards(:)
      integer :: i

      n = 0
      call self%require_all(case_number, 1, last, shards, error)
      do i = 1, size(shards)
         if (allocated(error)) return
         call open_hdf5(shard_path(self%store, shards(i)), group%file, error)
         if (allocated(error)) return
         group%path = trim(shards(i)%group)
         n = n + transitions_before(group, min(shards(i)%last, last) + 1) &
             - transitions_before(group, shards(i)%first)
         call group%take_error(error)
         call group%file%abandon()
      end do
   end subroutine count_transitions

   !> Finds the shards of samples first..last of a case; raises an error if one was removed during
   !> the run.
   subroutine require_all(self, case_number, first, last, shards, error)
      class(stored_samples), intent(in) :: self
      integer, intent(in) :: case_number, first, last
      type(shard_type), allocatable, intent(out) :: shards(:)
      type(error_type), allocatable, intent(out) :: error
      integer :: i, missing

      shards = self%shards_of(case_number, first, last)
      missing = first
      do i = 1, size(shards)
         if (shards(i)%first > missing) exit
         missing = max(missing, shards(i)%last + 1)
      end do
      if (missing > last) return
      call raise(error, exit_file, self%store%folder//' lacks sample '//to_text(missing)// &
                 ' of case '//to_text(case_number)//': run again to compute it')
   end subroutine require_all

end module io_shards
