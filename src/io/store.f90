!> The folder of one output, `<output>.shards/`: what is finished on the way to its results file, in
!> files that are written once, each whole or not at all.
module io_store
   use core_error, only: error_type, exit_file, raise
   use io_files, only: exists, list_files, list_unfinished, make_folder, remove_file, rename_file, &
                       sync_file, unfinished_name
   use io_hdf5, only: create_hdf5, hdf5_file, hdf5_object, object_of, open_hdf5
   use io_identity, only: identity_type, require_same, write_identity
   implicit none(type, external)
   private
   public :: shard_store, new_store
   public :: begin_file, discard_file, finish_file, list_finished, name_of, open_own, &
             remove_leftovers, remove_store, start_file

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

   !> Creates a file of the store with whole numbers in its header; finish_file gives it its name.
   subroutine start_file(store, name, names, numbers, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! without the folder
      character(*), intent(in) :: names(:)
      integer, intent(in) :: numbers(:)
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root
      integer :: i

      call make_folder(store%folder, error)
      if (allocated(error)) return
      call begin_file(store%folder//'/'//name, store%identity, file, error)
      if (allocated(error)) return
      root = object_of(file, '/')
      do i = 1, size(names)
         call root%attribute(trim(names(i)), numbers(i))
      end do
      call root%take_error(error)
      if (allocated(error)) call discard_file(file)
   end subroutine start_file

   !> Creates a file with an identity under a temporary name; none is left after an error.
   subroutine begin_file(path, identity, file, error)
      character(*), intent(in) :: path   !! what the file is called when it is whole
      type(identity_type), intent(in) :: identity
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error

      call create_hdf5(unfinished_name(path), file, error)
      if (.not. allocated(error)) call write_identity(file, identity, error)
      if (allocated(error)) call discard_file(file)
   end subroutine begin_file

   !> Removes a file that is not finished; what stood in its place stays as it is.
   subroutine discard_file(file)
      type(hdf5_file), intent(inout) :: file
      type(error_type), allocatable :: ignored

      call file%abandon()
      call remove_file(file%path, ignored)
   end subroutine discard_file

   !> Opens a finished file that must be of the store's scene and program, and hold what its name
   !> tells, by whole numbers in its header.
   subroutine open_own(store, path, names, numbers, what, advice, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: path       !! with the folder
      character(*), intent(in) :: names(:)
      integer, intent(in) :: numbers(:)
      character(*), intent(in) :: what       !! its name tells: 'samples'
      character(*), intent(in) :: advice     !! behind an error
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root
      integer :: found(size(names)), i

      call open_hdf5(path, file, error)
      if (allocated(error)) then
         error%message = error%message//advice
         return
      end if
      call require_same(file, store%identity, error, advice)
      if (.not. allocated(error)) then
         root = object_of(file, '/')
         do i = 1, size(names)
            call root%read(trim(names(i)), found(i))
         end do
         call root%take_error(error)
         if (allocated(error)) then
            error%message = error%message//advice
         else if (any(found /= numbers)) then
            call raise(error, exit_file, path//' does not hold the '//what// &
                       ' that its name tells'//advice)
         end if
      end if
      if (allocated(error)) call file%abandon()
   end subroutine open_own

   !> Closes the file and gives it its name; it is on the disk when this returns without error.
   !> After an error, met here or while it was filled, removes it.
   subroutine finish_file(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name
      type(hdf5_file), intent(inout) :: file
      type(error_type), allocatable, intent(inout) :: error

      if (.not. allocated(error)) call file%close(error)
      if (.not. allocated(error)) call sync_file(file%path, error)
      if (.not. allocated(error)) call rename_file(file%path, store%folder//'/'//name, error)
      if (allocated(error)) then
         call discard_file(file)
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
