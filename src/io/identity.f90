!> Identity of a campaign: attributes of a file's root that say which scene, program and machine its
!> samples come from.
module io_identity
   use core_error, only: error_type, exit_file, raise
   use core_text, only: line_feed, to_text
   use io_hdf5, only: hdf5_file, hdf5_object
   implicit none(type, external)
   private
   public :: identity_type, refuse_foreign, require_command, require_same, write_identity

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

contains

   !> Writes an identity as attributes of the root of a file.
   subroutine write_identity(file, identity, error)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

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
   end subroutine write_identity

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

end module io_identity
