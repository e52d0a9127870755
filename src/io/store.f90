!> Store of an output: the folder `<output>.shards/` with finished blocks and processes until the
!> results file has them. Each file is written once under a temporary name, then renamed.
module io_store
   use core_error, only: error_type, exit_file, raise
   use io_files, only: list_files, make_folder, remove_file, rename_file, sync_file, unfinished, &
                       unfinished_name
   use io_hdf5, only: create_hdf5, hdf5_file, hdf5_object, open_hdf5
   use io_identity, only: identity_type, require_same, write_identity
   implicit none(type, external)
   private
   public :: shard_store, new_store
   public :: advise, create_unfinished, create_in_store, discard_file, finish_in_store, &
             numbers_in, open_in_store, remove_leftovers, remove_store

   !> End of an error of a damaged file of a store.
   character(*), parameter :: advice = '; remove it to have what it holds computed again'

   !> Paths of an output and of its store, and the identity that its files must have.
   type :: shard_store
      character(:), allocatable :: output   !! path of the results file
      character(:), allocatable :: folder
      type(identity_type) :: identity
   end type shard_store

contains

   !> Store of a results file. Its folder is made with the first file.
   pure function new_store(output, identity) result(store)
      character(*), intent(in) :: output   !! path of the results file
      type(identity_type), intent(in) :: identity
      type(shard_store) :: store

      store%output = output
      store%folder = output//'.shards'
      store%identity = identity
   end function new_store

   !> Creates a file of the store under a temporary name; its attribute `name` has the final one.
   subroutine create_in_store(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! final name, without the folder
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

      call make_folder(store%folder, error)
      if (.not. allocated(error)) &
         call create_unfinished(store%folder//'/'//name, store%identity, file, error)
      if (allocated(error)) return
      root = hdf5_object(file, '/')
      root%has_fixed_texts = .true.
      call root%attribute('name', name)
      call root%take_error(error)
      if (allocated(error)) call discard_file(file)
   end subroutine create_in_store

   !> Creates a file with an identity under a temporary name; removes it after an error.
   subroutine create_unfinished(path, identity, file, error)
      character(*), intent(in) :: path   !! final path
      type(identity_type), intent(in) :: identity
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error

      call create_hdf5(unfinished_name(path), file, error)
      if (.not. allocated(error)) call write_identity(file, identity, error)
      if (allocated(error)) call discard_file(file)
   end subroutine create_unfinished

   !> Closes and removes an unfinished file. A finished file of its final name stays.
   subroutine discard_file(file)
      type(hdf5_file), intent(inout) :: file
      type(error_type), allocatable :: ignored

      call file%abandon()
      call remove_file(file%path, ignored)
   end subroutine discard_file

   !> Adds to the error of a damaged file of a store what to do.
   pure subroutine advise(error)
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) error%message = error%message//advice
   end subroutine advise

   !> Opens a finished file of the store; refuses a damaged or renamed one, and one of another scene
   !> or program.
   subroutine open_in_store(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! name without the folder
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root
      character(:), allocatable :: found

      call open_hdf5(store%folder//'/'//name, file, error)
      call advise(error)
      if (allocated(error)) return
      call require_same(file, store%identity, advice, error)
      if (.not. allocated(error)) then
         root = hdf5_object(file, '/')
         call root%read('name', found)
         call root%take_error(error)
         if (.not. allocated(error) .and. found /= name) &
            call raise(error, exit_file, file%path//' was renamed: its name was '//found)
         call advise(error)
      end if
      if (allocated(error)) call file%abandon()
   end subroutine open_in_store

   !> Closes a file and renames it to its final name; it is on the disk when this returns without
   !> error. Removes it after an error, also after one that is passed in.
   subroutine finish_in_store(store, name, file, error)
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
   end subroutine finish_in_store

   !> First three whole numbers in a name; 0 for missing ones, and for all if one is too large.
   pure function numbers_in(name) result(numbers)
      character(*), intent(in) :: name
      integer :: numbers(3)
      character(len(name) + 1) :: text
      integer :: i, status

      text = name//'/'   ! ends the reading
      do i = 1, len(name)
         if (verify(name(i:i), '0123456789') > 0) text(i:i) = ' '
      end do
      numbers = 0
      read (text, *, iostat=status) numbers
      if (status /= 0) numbers = 0
   end function numbers_in

   !> Removes the unfinished files of killed runs, of the store and of the results file. The caller
   !> must hold the lock on the output.
   subroutine remove_leftovers(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store%output//unfinished, '', error)
      if (.not. allocated(error)) call remove_files(store%folder//'/', unfinished, error)
   end subroutine remove_leftovers

   !> Removes the store with all its files, if there is one, and unfinished results files.
   subroutine remove_store(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store%output//unfinished, '', error)
      if (.not. allocated(error)) call remove_files(store%folder//'/', '', error)
      if (.not. allocated(error)) call remove_file(store%folder, error)
   end subroutine remove_store

   !> Removes the files that `list_files` lists.
   subroutine remove_files(prefix, part, error)
      character(*), intent(in) :: prefix, part
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)
      integer :: i

      call list_files(prefix, part, paths, error)
      do i = 1, size(paths)
         call remove_file(trim(paths(i)), error)
         if (allocated(error)) return
      end do
   end subroutine remove_files

end module io_store
