!> Solved processes as files of a store, beside the shards of the samples that are drawn from them:
!> a fit that is done is not done again.
module io_process_shards
   use core_error, only: error_type, exit_file, raise
   use core_kinds, only: long, wp
   use io_checksum, only: checksum_type
   use io_files, only: exists, remove_file
   use io_hdf5, only: hdf5_file, label_type, open_hdf5, read_attribute, read_dataset, read_extent, &
                      write_attribute, write_dataset
   use io_process_results, only: process_name, read_process
   use io_store, only: finish_file, list_finished, name_of, open_own, shard_store, start_file
   use process_model, only: process_model_type
   use process_packing, only: pack_model, unpack_model
   implicit none(type, external)
   private
   public :: extract_processes, is_process_shard, keep_process, read_kept, remove_kept

   character(*), parameter :: advice = '; remove it to have its process solved again'

contains

   !> A process that is solved, or refused with its reason; on the disk when this returns without
   !> error.
   subroutine keep_process(store, number, model, error)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number   !! of the process
      type(process_model_type), intent(in) :: model
      type(error_type), allocatable, intent(out) :: error

      real(wp), allocatable :: row(:)
      type(hdf5_file) :: file

      row = pack_model(model)
      call start_file(store, shard_name(number), file, error)
      if (allocated(error)) return
      call write_attribute(file, '/', 'process', number, error)
      if (.not. allocated(error)) &
         call write_attribute(file, '/', 'checksum', checksum_of(number, row), error)
      if (.not. allocated(error)) &
         call write_dataset(file, '/packed', row, label_type('1', 'all that was found', ''), error)
      call finish_file(store, shard_name(number), file, error)
   end subroutine keep_process

   !> The processes that a store has. One that is another scene's, another program's, or damaged is
   !> refused by name.
   subroutine read_kept(store, models, is_kept, error)
      type(shard_store), intent(in) :: store
      type(process_model_type), intent(inout) :: models(:)   !! (process), their requests known
      logical, intent(out) :: is_kept(:)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: row(:)
      integer :: i

      is_kept = .false.
      do i = 1, size(models)
         if (.not. exists(path_of(store, i))) cycle
         call read_row(store, i, row, error)
         if (allocated(error)) return
         call unpack_model(row, models(i), is_kept(i))
         if (.not. is_kept(i)) call raise(error, exit_file, path_of(store, i)// &
                                          ' does not hold a process'//advice)
         if (allocated(error)) return
      end do
   end subroutine read_kept

   subroutine read_row(store, number, row, error)
      type(shard_store), intent(in) :: store
      integer, intent(in) :: number
      real(wp), allocatable, intent(out) :: row(:)
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_file) :: file
      integer(long), allocatable :: n(:)
      integer(long) :: expected
      integer :: found

      call open_own(store, path_of(store, number), advice, file, error)
      if (allocated(error)) return
      call read_attribute(file, '/', 'process', found, error)
      if (.not. allocated(error)) call read_attribute(file, '/', 'checksum', expected, error)
      if (.not. allocated(error)) call read_extent(file, '/packed', 1, n, error)
      if (.not. allocated(error)) then
         allocate (row(n(1)))
         call read_dataset(file, '/packed', row, error)
      end if
      call file%abandon()
      if (allocated(error)) then
         error%message = error%message//advice
      else if (found /= number) then
         call raise(error, exit_file, file%path// &
                    ' does not hold the process that its name tells'//advice)
      else if (checksum_of(number, row) /= expected) then
         call raise(error, exit_file, file%path// &
                    ' is damaged: its values do not have its checksum'//advice)
      end if
   end subroutine read_row

   !> Keeps the processes of a results file, but for those that the store has already.
   subroutine extract_processes(path, n_processes, store, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_processes
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: model
      type(hdf5_file) :: file
      logical :: is_there
      integer :: i

      call open_hdf5(path, file, error)
      if (allocated(error)) return
      do i = 1, n_processes
         if (exists(path_of(store, i))) cycle
         call read_process(file, i, model, is_there, error)
         if (is_there .and. .not. allocated(error)) call keep_process(store, i, model, error)
         if (allocated(error)) exit
      end do
      call file%abandon()
   end subroutine extract_processes

   !> Removes all processes of a store, and the store if nothing else is in it.
   subroutine remove_kept(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: ignored
      character(:), allocatable :: paths(:)
      integer :: i

      call list_finished(store, paths, error)
      do i = 1, size(paths)
         if (allocated(error)) return
         if (is_process_shard(paths(i))) call remove_file(trim(paths(i)), error)
      end do
      if (.not. allocated(error)) call remove_file(store%folder, ignored)   ! fails, rightly, if not
   end subroutine remove_kept

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

      name = 'process_'//process_name(number)//'.h5'
   end function shard_name

   function checksum_of(number, row) result(value)
      integer, intent(in) :: number
      real(wp), intent(in), contiguous :: row(:)
      integer(long) :: value
      type(checksum_type) :: checksum

      call checksum%add([number, size(row)])
      call checksum%add(row)
      value = checksum%value()
   end function checksum_of

end module io_process_shards
