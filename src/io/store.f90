!> The folder of one output, `<output>.shards/`: what is finished on the way to its results file, in
!> files that are written once, each whole or not at all.
module io_store
   use core_error, only: error_type, exit_file, raise
   use io_files, only: list_files, make_folder, remove_file, rename_file, sync_file, unfinished, &
                       unfinished_name
   use io_hdf5, only: create_hdf5, hdf5_file, hdf5_object, open_hdf5
   use io_identity, only: identity_type, require_same, write_identity
   implicit none(type, external)
   private
   public :: shard_store, new_store
   public :: begin_file, discard_file, finish_file, numbers_in, open_own, remove_leftovers, &
             remove_store, start_file

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

   !> Creates a file of the store; finish_file gives it its name, which it also has in its header.
   subroutine start_file(store, name, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name   !! without the folder
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

      call make_folder(store%folder, error)
      if (.not. allocated(error)) &
         call begin_file(store%folder//'/'//name, store%identity, file, error)
      if (allocated(error)) return
      root = hdf5_object(file, '/')
      root%seals_texts = .true.
      call root%attribute('name', name)
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
   !> tells.
   subroutine open_own(store, name, what, advice, file, error)
      type(shard_store), intent(in) :: store
      character(*), intent(in) :: name       !! without the folder
      character(*), intent(in) :: what       !! the name tells: 'samples'
      character(*), intent(in) :: advice     !! behind an error
      type(hdf5_file), intent(out) :: file
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root
      character(:), allocatable :: found

      call open_hdf5(store%folder//'/'//name, file, error)
      if (allocated(error)) then
         error%message = error%message//advice
         return
      end if
      call require_same(file, store%identity, error, advice)
      if (.not. allocated(error)) then
         root = hdf5_object(file, '/')
         call root%read('name', found)
         call root%take_error(error)
         if (allocated(error)) then
            error%message = error%message//advice
         else if (found /= name) then
            call raise(error, exit_file, file%path//' does not hold the '//what// &
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

   !> The whole numbers in a name, as many as there are of the first three; the others are 0.
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
      if (status /= 0) numbers = 0   ! one is too large
   end function numbers_in

   !> Removes what killed runs left half-written, results files too; only for who holds the lock of
   !> the output.
   subroutine remove_leftovers(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store%output//unfinished, '', error)
      if (.not. allocated(error)) call remove_files(store%folder//'/', unfinished, error)
   end subroutine remove_leftovers

   !> Removes the store and all in it; one that was never made is fine.
   subroutine remove_store(store, error)
      type(shard_store), intent(in) :: store
      type(error_type), allocatable, intent(out) :: error

      call remove_files(store%output//unfinished, '', error)
      if (.not. allocated(error)) call remove_files(store%folder//'/', '', error)
      if (.not. allocated(error)) call remove_file(store%folder, error)
   end subroutine remove_store

   subroutine remove_files(begin, part, error)
      character(*), intent(in) :: begin, part   !! as list_files has them
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: paths(:)
      integer :: i

      call list_files(begin, part, paths, error)
      do i = 1, size(paths)
         call remove_file(trim(paths(i)), error)
         if (allocated(error)) return
      end do
   end subroutine remove_files

end module io_store
