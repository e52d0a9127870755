!> The folder of one output, `<output>.shards/`: what is finished on the way to its results file, in
!> files that are written once, each whole or not at all.
module io_store
   use core_error, only: error_type
   use core_text, only: to_text
   use io_files, only: exists, host_name, list_files, make_folder, process_id, remove_file, &
                       rename_file, sync_file, sync_folder
   use io_hdf5, only: create_hdf5, hdf5_file
   use io_identity, only: identity_type, write_identity
   implicit none(type, external)
   private
   public :: shard_store, new_store
   public :: finish_file, list_finished, name_of, remove_leftovers, remove_store, start_file

   character(*), parameter :: unfinished = '.part'

   !> Where the files of one output lie.
   type :: shard_store
      character(:), allocatable :: folder
      type(identity_type) :: identity
   end type shard_store

contains

   !> The store of a results file; nothing is made before the first file is.
   pure function new_store(output, identity) result(store)
      character(*), intent(in) :: output   !! path of the results file
      type(identity_type), intent(in) :: identity
      type(shard_store) :: store

      store%folder = output//'.shards'
      store%identity = identity
   end function new_store

   !> A file to be filled, which says whose it is, under another name until it is whole.
   subroutine start_file(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! without the folder
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: ignored
      character(:), allocatable :: temporary

      temporary = store%folder//'/'//name//'.'//host_name()//'-'//to_text(process_id())//unfinished
      call make_folder(store%folder, error)
      if (allocated(error)) return
      call create_hdf5(temporary, file, error)
      if (.not. allocated(error)) call write_identity(file, store%identity, error)
      if (.not. allocated(error)) return
      call file%abandon()
      call remove_file(temporary, ignored)
   end subroutine start_file

   !> The file is on the disk under its name when this returns without error; after one, met here or
   !> while it was filled, nothing is left of it.
   subroutine finish_file(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name
      type(hdf5_file), intent(inout) :: file
      type(error_type), allocatable, intent(inout) :: error
      type(error_type), allocatable :: ignored
      character(:), allocatable :: temporary

      temporary = file%path
      if (allocated(error)) then
         call file%abandon()
      else
         call file%close(error)
      end if
      if (.not. allocated(error)) call sync_file(temporary, error)
      if (.not. allocated(error)) call rename_file(temporary, store%folder//'/'//name, error)
      if (allocated(error)) then
         call remove_file(temporary, ignored)
      else
         call sync_folder(store%folder, error)
      end if
   end subroutine finish_file

   !> Paths of what is whole in a store, sorted; none where it was never made.
   subroutine list_finished(store, paths, error)
      type(shard_store), intent(in) :: store
      character(:), allocatable, intent(out) :: paths(:)   !! padded with blanks
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: all_paths(:)
      integer :: i, n

      if (exists(store%folder)) then
         call list_files(store%folder, all_paths, error)
      else
         allocate (character(0) :: all_paths(0))
      end if
      n = count([(.not. is_unfinished(all_paths(i)), i=1, size(all_paths))])
      allocate (character(len(all_paths)) :: paths(n))
      n = 0
      do i = 1, size(all_paths)
         if (is_unfinished(all_paths(i))) cycle
         n = n + 1
         paths(n) = all_paths(i)
      end do
   end subroutine list_finished

   !> The last part of a path.
   pure function name_of(path) result(name)
      character(*), intent(in) :: path
      character(:), allocatable :: name

      name = trim(path(index(path, '/', back=.true.) + 1:))
   end function name_of

   !> Removes what a killed run left half-written; only for who holds the lock of the output.
   subroutine remove_leftovers(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store, only_unfinished=.true., error=error)
   end subroutine remove_leftovers

   !> Removes the store and all in it; one that was never made is fine.
   subroutine remove_store(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store, only_unfinished=.false., error=error)
      if (.not. allocated(error)) call remove_file(store%folder, error)
   end subroutine remove_store

   subroutine remove_files(store, only_unfinished, error)
      type(shard_store), intent(in) :: store
      logical, intent(in) :: only_unfinished
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)
      integer :: i

      if (.not. exists(store%folder)) return
      call list_files(store%folder, paths, error)
      if (allocated(error)) return
      do i = 1, size(paths)
         if (only_unfinished .and. .not. is_unfinished(paths(i))) cycle
         call remove_file(trim(paths(i)), error)
         if (allocated(error)) return
      end do
   end subroutine remove_files

   pure function is_unfinished(path)
      character(*), intent(in) :: path
      logical :: is_unfinished

      is_unfinished = index(path//' ', unfinished//' ') > 0
   end function is_unfinished

end module io_store
