!> Finished blocks of samples as files of a store.
module io_shards
   use campaign_results, only: block_result
   use core_error, only: error_type, exit_file, raise
   use io_blocks, only: read_block, write_blocks
   use io_files, only: remove_file
   use io_hdf5, only: hdf5_file
   use io_lock, only: lock_type
   use io_process_shards, only: is_process_shard
   use io_store, only: finish_file, list_finished, open_own, remove_store, shard_store, start_file
   implicit none(type, external)
   private
   public :: shard_type
   public :: list_shards, named_shard, read_shard, remove_covered, &
             verify_shard, write_shard

   character(*), parameter :: advice = '; remove it to have its samples computed again'
   character(*), parameter :: header(*) = [character(12) :: 'case', 'first_sample', 'n_samples']

   !> One shard, as its name tells it.
   type :: shard_type
      character(:), allocatable :: path
      integer :: case_number = 0
      integer :: first_sample = 0
      integer :: n_samples = 0
   end type shard_type

contains

   !> Writes finished blocks, consecutive samples of a case, as one shard. It is on the disk when
   !> this returns without error.
   subroutine write_shard(store, blocks, error)
      type(shard_store), intent(in) :: store
      type(block_result), intent(inout) :: blocks(:)   !! left as they were
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      character(:), allocatable :: name

      name = shard_name(blocks(1)%case_number, blocks(1)%first_sample, sum(blocks%n_samples))
      call start_file(store, name, header, [blocks(1)%case_number, blocks(1)%first_sample, &
                                            sum(blocks%n_samples)], file, error)
      if (allocated(error)) return
      call write_blocks(file, blocks, error)
      call finish_file(store, name, file, error)
   end subroutine write_shard

   !> The shard of these samples, there or not.
   pure function named_shard(store, case_number, first_sample, n_samples) result(shard)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: case_number, first_sample, n_samples
      type(shard_type) :: shard

      shard = shard_type(store%folder//'/'//shard_name(case_number, first_sample, n_samples), &
                         case_number, first_sample, n_samples)
   end function named_shard

   !> Lists the shards of a store by their names; a file that is none is refused by name.
   subroutine list_shards(store, shards, error)
      type(shard_store), intent(in) :: store
      type(shard_type), allocatable, intent(out) :: shards(:)
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)
      type(shard_type) :: shard
      integer :: i, n

      call list_finished(store, paths, error)
      allocate (shards(size(paths)))
      n = 0
      do i = 1, size(paths)
         if (is_process_shard(paths(i))) cycle
         call parse_name(trim(paths(i)), shard, error)
         if (allocated(error)) return
         n = n + 1
         shards(n) = shard
      end do
      shards = shards(:n)
   end subroutine list_shards

   !> Reads a shard whole: refused by name when it is another scene's, another program's, or
   !> damaged.
   subroutine verify_shard(store, shard, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shard
      type(error_type), allocatable, intent(out) :: error
      type(block_result) :: block

      call read_shard(store, shard, block, error)
   end subroutine verify_shard

   !> Reads a whole shard and verifies it as verify_shard does.
   subroutine read_shard(store, shard, block, error)
      type(shard_store), intent(in) :: store
      type(shard_type), intent(in) :: shard
      type(block_result), intent(out) :: block
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      call open_own(store, shard%path, header, &
                    [shard%case_number, shard%first_sample, shard%n_samples], 'samples', advice, &
                    file, error)
      if (allocated(error)) return
      block%case_number = shard%case_number
      block%first_sample = shard%first_sample
      block%n_samples = shard%n_samples
      call read_block(file, '/', block, 0, 0, block%n_samples, .false., error)
      call file%abandon()
      if (allocated(error)) error%message = error%message//advice
   end subroutine read_shard

   !> Removes the shards whose samples a results file has, as after a run killed at its very end;
   !> shards of further samples stay, and processes with them. Else nothing is left of the store. A
   !> run that has lost its lock leaves the rest to the one that has it.
   subroutine remove_covered(store, lock, n_samples, error)
      type(shard_store), intent(in) :: store
      type(lock_type), intent(inout) :: lock
      integer, intent(in) :: n_samples(:)   !! (case) of the results file
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: lost
      type(shard_type), allocatable :: shards(:)
      logical :: is_bare
      integer :: i, last

      call list_shards(store, shards, error)
      if (allocated(error)) return
      is_bare = .true.
      do i = 1, size(shards)
         call lock%keep(lost)
         if (allocated(lost)) return
         last = 0
         if (shards(i)%case_number <= size(n_samples)) last = n_samples(shards(i)%case_number)
         if (shards(i)%first_sample + shards(i)%n_samples - 1 > last) then
            is_bare = .false.
         else
            call remove_file(shards(i)%path, error)
            if (allocated(error)) return
         end if
      end do
      call lock%keep(lost)
      if (is_bare .and. .not. allocated(lost)) call remove_store(store, error)
   end subroutine remove_covered

   !> c007_s00033-00064.h5: case 7, samples 33 to 64.
   pure function shard_name(case_number, first_sample, n_samples) result(name)
      integer, intent(in) :: case_number, first_sample, n_samples
      character(:), allocatable :: name
      character(64) :: buffer

      write (buffer, '(a, i0.3, a, i0.5, a, i0.5, a)') 'c', case_number, '_s', first_sample, '-', &
         first_sample + n_samples - 1, '.h5'
      name = trim(buffer)
   end function shard_name

   subroutine parse_name(path, shard, error)
      character(*), intent(in) :: path
      type(shard_type), intent(out) :: shard
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: name, numbers
      integer :: case_number, first, i, last, status

      name = path(index(path, '/', back=.true.) + 1:)
      numbers = name
      do i = 1, len(name)
         if (verify(name(i:i), '0123456789') > 0) numbers(i:i) = ' '
      end do
      read (numbers, *, iostat=status) case_number, first, last
      if (status == 0) then
         if (shard_name(case_number, first, last - first + 1) == name) then
            shard = shard_type(path, case_number, first, last - first + 1)
            return
         end if
      end if
      call raise(error, exit_file, path// &
                 ' is not the name of a shard: only shards may lie in this folder')
   end subroutine parse_name

end module io_shards
