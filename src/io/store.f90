!> The folder of one output, `<output>.shards/`: what is finished on the way to its results file, in
!> files that are written once, each whole or not at all.
module io_store
   use core_error, only: error_type
   use io_files, only: exists, list_files, list_unfinished, make_folder, remove_file, rename_file, &
                       sync_file, unfinished_name
   use io_hdf5, only: create_hdf5, hdf5_file, open_hdf5
   use io_identity, only: identity_type, require_same, write_identity
   implicit none(type, external)
   private
   public :: shard_store, new_store
   public :: finish_file, list_finished, name_of, open_own, remove_leftovers, remove_store, &
             start_file

   !> Where the files of one output lie.
   type :: shard_store
      character(:), allocatable :: output   !! path of the results file
      character(:), allocatable :: folder
      type(identity_type) :: identity
   end type shard_store

contains

   !> The store of a results file; nothing is made before the first file is.
   pure function new_store(output, identity) result(store)
      character(*), intent(in) :: output   !! path of the results file
      type(identity_type), intent(in) :: identity
      type(shard_store) :: store

      store%output = output
      store%folder = output//'.shards'
      store%identity = identity
   end function new_store

   !> Creates a file with the store's identity under a temporary name; finish_file gives it its
   !> own.
   subroutine start_file(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! without the folder
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(error_type), allocatable :: ignored
      character(:), allocatable :: temporary

      temporary = unfinished_name(store%folder//'/'//name)
      call make_folder(store%folder, error)
      if (allocated(error)) return
      call create_hdf5(temporary, file, error)
      if (.not. allocated(error)) call write_identity(file, store%identity, error)
      if (.not. allocated(error)) return
      call file%abandon()
      call remove_file(temporary, ignored)
   end subroutine start_file

   !> Opens a finished file that must be of the store's scene and program.
   subroutine open_own(store, path, advice, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: path     !! with the folder
      character(*), intent(in) :: advice   !! behind an error
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error

      call open_hdf5(path, file, error)
      if (allocated(error)) then
         error%message = error%message//advice
         return
      end if
      call require_same(file, store%identity, error, advice)
      if (allocated(error)) call file%abandon()
   end subroutine open_own

   !> Closes the file and gives it its name; it is on the disk when this returns without error.
   !> After an error, met here or while it was filled, removes it.
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
         call sync_file(store%folder, error)   ! the new name
      end if
   end subroutine finish_file

   !> Lists the finished files of a store, sorted; none where it was never made.
   subroutine list_finished(store, paths, error)
      type(shard_store), intent(in) :: store
      character(:), allocatable, intent(out) :: paths(:)   !! padded with blanks
      type(error_type), allocatable, intent(out) :: error

      if (exists(store%folder)) then
         call list_files(store%folder, paths, error)
      else
         allocate (character(0) :: paths(0))
      end if
   end subroutine list_finished

   !> The last part of a path.
   pure function name_of(path) result(name)
      character(*), intent(in) :: path
      character(:), allocatable :: name

      name = trim(path(index(path, '/', back=.true.) + 1:))
   end function name_of

   !> Removes what killed runs left half-written, results files too; only for who holds the lock of
   !> the output.
   subroutine remove_leftovers(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)

      call list_unfinished(store%output, paths, error)
      if (.not. allocated(error)) call remove_all(paths, error)
      if (.not. allocated(error)) call list_unfinished(store%folder, paths, error)
      if (.not. allocated(error)) call remove_all(paths, error)
   end subroutine remove_leftovers

   !> Removes the store and all in it; one that was never made is fine.
   subroutine remove_store(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)

      call remove_leftovers(store, error)
      if (.not. allocated(error)) call list_finished(store, paths, error)
      if (.not. allocated(error)) call remove_all(paths, error)
      if (.not. allocated(error)) call remove_file(store%folder, error)
   end subroutine remove_store

   subroutine remove_all(paths, error)
      character(*), intent(in) :: paths(:)
      type(error_type), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(paths)
         call remove_file(trim(paths(i)), error)
         if (allocated(error)) return
      end do
   end subroutine remove_all

end module io_store
