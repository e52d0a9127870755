!> Store of an output: the folder `<output>.shards/` with finished blocks and processes until the
!> results file has them. Each file is written once under a temporary name, then renamed.
!>
!> Attributes of a file's root, its identity, say which scene, program and machine its samples come
!> from.
module io_store
   use core_error, only: error_type, exit_file, raise
   use core_text, only: line_feed, to_text
   use io_files, only: list_files, make_folder, remove_file, rename_file, sync_file, unfinished, &
                       unfinished_name
   use io_hdf5, only: create_hdf5, hdf5_file, hdf5_object, open_hdf5
   implicit none(type, external)
   private
   public :: identity_type, shard_store, new_store
   public :: refuse_foreign, require_command, require_same
   public :: advise, create_unfinished, create_in_store, discard_file, finish_in_store, &
             open_in_store, remove_leftovers, remove_store

   integer, parameter :: format_version = 3       !! format of shards and results files
   character(*), parameter :: unused = 'unused'   !! value of a name that settings do not have

   !> Identity of a campaign: two files with the same one hold samples of the same campaign.
   type :: identity_type
      character(:), allocatable :: fingerprint    !! fingerprint of the settings
      character(:), allocatable :: version        !! version of the program
      character(:), allocatable :: architecture   !! processor and compiler: they decide last bits
      character(:), allocatable :: command        !! command that wrote it: run, replay or tradeoff
      character(:), allocatable :: settings       !! lines `name = value` that fix the samples
   end type identity_type

   !> End of an error of a damaged file of a store.
   character(*), parameter :: remedy = '; remove it to have what it holds computed again'

   !> Paths of an output and of its store, and the identity that its files must have.
   type :: shard_store
      character(:), allocatable :: output   !! path of the results file
      character(:), allocatable :: folder
      type(identity_type) :: identity
   end type shard_store

contains

   !> Store of a results file. Its folder is made with the first file.
   pure type(shard_store) function new_store(output, identity) result(store)
      character(*), intent(in) :: output   !! path of the results file
      type(identity_type), intent(in) :: identity

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
      type(hdf5_object) :: root

      call create_hdf5(unfinished_name(path), file, error)
      if (.not. allocated(error)) then
         root = hdf5_object(file, '/')
         root%has_fixed_texts = .true.
         call root%attribute('format_version', format_version)
         call root%attribute('program', 'entroslip')
         call root%attribute('settings', identity%settings)
         call root%attribute('fingerprint', identity%fingerprint)
         call root%attribute('version', identity%version)
         call root%attribute('architecture', identity%architecture)
         call root%attribute('command', identity%command)
         call root%take_error(error)
      end if
      if (allocated(error)) call discard_file(file)   ! also of a full disk's first bytes
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

      if (allocated(error)) error%message = error%message//remedy
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
      call require_same(file, store%identity, remedy, error)
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

   !> Refuses a file of another scene, program version or machine, with the difference.
   subroutine require_same(file, identity, advice, error)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      character(*), intent(in) :: advice   !! end of the error of a damaged file
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: architecture, fingerprint, settings, version
      type(hdf5_object) :: root
      integer :: found

      call require_command(file, identity%command, advice, error)
      if (allocated(error)) return
      root = hdf5_object(file, '/')
      call root%read('format_version', found)
      if (.not. allocated(root%error) .and. found /= format_version) then
         call raise(error, exit_file, file%path//' has format version '//to_text(found)// &
                    ', this program reads '//to_text(format_version))
         return
      end if
      call root%read('fingerprint', fingerprint)
      call root%read('settings', settings)
      call root%read('version', version)
      call root%read('architecture', architecture)
      call root%take_error(error)
      if (allocated(error)) then
         error%message = error%message//advice
      else if (fingerprint /= identity%fingerprint) then
         call refuse('belongs to another scene', difference(settings, identity%settings))
      else if (version /= identity%version) then
         call refuse('was written by another version of the program', &
                     'version '//version//', here '//identity%version)
      else if (architecture /= identity%architecture) then
         call refuse('was computed by another kind of machine', &
                     'architecture '//architecture//', here '//identity%architecture)
      end if

   contains

      subroutine refuse(complaint, reason)
         character(*), intent(in) :: complaint, reason

         call raise(error, exit_file, file%path//' '//complaint//' ('//reason// &
                    '): choose another --output, or discard it with --fresh')
      end subroutine refuse

   end subroutine require_same

   !> First differences between the settings of a file and those of the scene, and the number of the
   !> others. Names that only the scene has come last.
   function difference(theirs, ours) result(text)
      character(*), intent(in) :: theirs, ours   !! settings of the file and of the scene
      character(:), allocatable :: text
      integer, parameter :: most_named = 3
      character(:), allocatable :: our_value, rest, their_value
      integer :: n

      rest = theirs//line_feed//ours//line_feed   ! lines that are not compared yet
      text = ''
      n = 0
      do while (len(rest) > 0)
         associate (name => rest(:index(rest, ' = ') - 1))
            their_value = value_of(name, theirs)
            our_value = value_of(name, ours)
            if (their_value /= our_value .and. &
                (len(rest) > len(ours) + 1 .or. their_value == unused)) then
               n = n + 1
               if (n > 1 .and. n <= most_named) text = text//'; '
               if (n <= most_named) text = text//name//' = '//shortened(their_value)//', here '// &
                                           shortened(our_value)
            end if
         end associate
         rest = rest(index(rest, line_feed) + 1:)
      end do
      if (n > most_named) text = text//' and '//to_text(n - most_named)//' more'
   end function difference

   !> Value of a name in settings; 'unused' if they do not have it.
   pure function value_of(name, settings) result(value)
      character(*), intent(in) :: name, settings
      character(:), allocatable :: value
      integer :: first

      value = unused
      first = index(line_feed//settings, line_feed//name//' = ')
      if (first == 0) return
      value = settings(first + len(name) + 3:)
      value = value(:index(value//line_feed, line_feed) - 1)
   end function value_of

   !> A value, cut after 40 characters.
   pure function shortened(value)
      character(*), intent(in) :: value
      character(:), allocatable :: shortened
      integer, parameter :: longest = 40

      shortened = value
      if (len(value) > longest) shortened = value(:longest)//'...'
   end function shortened

   !> Refuses a file that another command or another program wrote.
   subroutine require_command(file, command, advice, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: command
      character(*), intent(in) :: advice   !! as in require_same
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: found, program
      type(hdf5_object) :: root

      root = hdf5_object(file, '/')
      program = ''
      if (root%has_attribute('program')) call root%read('program', program)
      if (program == 'entroslip') call root%read('command', found)
      call root%take_error(error)
      if (allocated(error)) then
         error%message = error%message//advice
      else if (program /= 'entroslip') then
         call refuse_foreign(file%path, error)
      else if (found /= command) then
         call raise(error, exit_file, file%path//' was written by entroslip '//found// &
                    ': choose another --output')
      end if
   end subroutine require_command

   !> Raises the error of a file that this program did not write.
   subroutine refuse_foreign(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, path//' was not written by this program: choose another '// &
                 '--output')
   end subroutine refuse_foreign

end module io_store
