!> Solved processes as files of a store, beside the shards of the samples that are drawn from them:
!> a fit that is done is not done again.
module io_process_shards
   use core_error, only: error_type
   use core_text, only: numbered
   use io_files, only: exists
   use io_group, only: group_type, new_group
   use io_hdf5, only: hdf5_file, open_hdf5
   use io_process_results, only: read_solution, write_solution
   use io_store, only: finish_file, name_of, open_own, shard_store, start_file
   use process_model, only: process_model_type
   implicit none(type, external)
   private
   public :: is_process_shard, keep_process, read_kept

   character(*), parameter :: solution = '/solution'   !! group of a shard
   character(*), parameter :: advice = '; remove it to have its process solved again'

contains

   !> Stores a process that is solved, or refused with its reason. It is on the disk when this
   !> returns without error.
   subroutine keep_process(store, number, model, error)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number   !! of the process
      type(process_model_type), intent(in) :: model
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group
      type(hdf5_file) :: file

      call start_file(store, shard_name(number), ['process'], [number], file, error)
      if (allocated(error)) return
      group = new_group(file, solution)
      group%seals_texts = .true.   ! Python has bytes; a results file is for it
      call write_solution(group, model)
      call group%take_error(error)
      call finish_file(store, shard_name(number), file, error)
   end subroutine keep_process

   !> Reads the processes that a store or an earlier results file has. One of another scene or
   !> program, or a damaged one, is refused by name; of a results file inspect_results sees to that.
   subroutine read_kept(store, models, is_kept, error)
      type(shard_store), intent(in) :: store
      type(process_model_type), intent(inout) :: models(:)   !! (process), their requests known
      logical, intent(out) :: is_kept(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: results
      character(:), allocatable :: group
      logical :: has_results
      integer :: i

      is_kept = .false.
      has_results = exists(store%output)
      if (has_results) call open_hdf5(store%output, results, error)
      do i = 1, size(models)
         if (allocated(error)) exit
         group = '/process/'//numbered('p', i)
         is_kept(i) = exists(path_of(store, i))
         if (is_kept(i)) then
            call read_one(store, i, models(i), error)
         else if (has_results) then
            is_kept(i) = results%has(group)
            if (is_kept(i)) call read_solution(results, group, models(i), error)
         end if
      end do
      call results%abandon()
   end subroutine read_kept

   subroutine read_one(store, number, model, error)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file

      call open_own(store, path_of(store, number), ['process'], [number], 'process', advice, file, &
                    error)
      if (allocated(error)) return
      call read_solution(file, solution, model, error)
      call file%abandon()
      if (allocated(error)) error%message = error%message//advice
   end subroutine read_one

   !> True if a path of a store is that of a process, by its name alone.
   pure function is_process_shard(path)
      character(*), intent(in) :: path
      logical :: is_process_shard
      character(*), parameter :: before = 'process_p', after = '.h5'
      character(:), allocatable :: name
      integer :: number, status

      is_process_shard = .false.
      name = name_of(path)
      if (len(name) <= len(before//after) .or. index(name, before) /= 1) return
      read (name(len(before) + 1:len(name) - len(after)), *, iostat=status) number
      if (status == 0) is_process_shard = name == shard_name(number)
   end function is_process_shard

   pure function path_of(store, number) result(path)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number
      character(:), allocatable :: path

      path = store%folder//'/'//shard_name(number)
   end function path_of

   !> process_p003.h5
   pure function shard_name(number) result(name)
      integer, intent(in) :: number
      character(:), allocatable :: name

      name = 'process_'//numbered('p', number)//'.h5'
   end function shard_name

end module io_process_shards
