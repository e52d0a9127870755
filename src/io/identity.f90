!> By what a file of results is known to belong to a campaign.
module io_identity
   use core_error, only: error_type, exit_file, raise
   use core_text, only: to_text
   use io_hdf5, only: hdf5_file, hdf5_object
   implicit none(type, external)
   private
   public :: identity_type, refuse_foreign, require_command, require_same, write_identity

   integer, parameter :: format_version = 3   !! of shards and of results files
   character(*), parameter :: unused = 'unused'   !! for a value that has no line in the settings

   !> Identity of a campaign: equal in two files that hold samples of one.
   type :: identity_type
      character(:), allocatable :: fingerprint    !! of the settings
      character(:), allocatable :: version        !! of the program
      character(:), allocatable :: architecture   !! what decides the last bits of numbers
      character(:), allocatable :: command        !! that wrote it: run, replay, tradeoff
      character(:), allocatable :: settings       !! what changes a sample: `name = value` a line
   end type identity_type

contains

   !> Writes it into the root of a file.
   subroutine write_identity(file, identity, error)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error
      type(hdf5_object) :: root

      root = hdf5_object(file, '/')
      root%seals_texts = .true.
      call root%attribute('format_version', format_version)
      call root%attribute('program', 'entroslip')
      call root%attribute('settings', identity%settings)
      call root%attribute('fingerprint', identity%fingerprint)
      call root%attribute('version', identity%version)
      call root%attribute('architecture', identity%architecture)
      call root%attribute('command', identity%command)
      call root%take_error(error)
   end subroutine write_identity

   !> Refuses, by name and with the difference, a file of another campaign or of another program.
   !> `advice` is for a file that is damaged.
   subroutine require_same(file, identity, error, advice)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error
      character(*), intent(in), optional :: advice
      character(:), allocatable :: architecture, fingerprint, settings, version
      type(hdf5_object) :: root
      integer :: found

      call require_command(file, identity%command, error)
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
         if (present(advice)) error%message = error%message//advice
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

   !> The values that differ between the settings of a file and those of the scene; the first few,
   !> and how many more. Those that the file does not use come last.
   function difference(theirs, ours) result(text)
      character(*), intent(in) :: theirs, ours   !! as in identity_type
      character(:), allocatable :: text
      character, parameter :: line_feed = new_line('a')
      integer, parameter :: most_named = 3
      character(:), allocatable :: our_value, rest, their_value
      integer :: n

      rest = theirs//line_feed//ours//line_feed
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
               if (n <= most_named) text = text//name//' = '//brief(their_value)//', here '// &
                                           brief(our_value)
            end if
         end associate
         rest = rest(index(rest, line_feed) + 1:)
      end do
      if (n > most_named) text = text//' and '//to_text(n - most_named)//' more'
   end function difference

   !> The value of a name in settings.
   pure function value_of(name, settings) result(value)
      character(*), intent(in) :: name, settings
      character(:), allocatable :: value
      integer :: first

      value = unused
      first = index(new_line('a')//settings, new_line('a')//name//' = ')
      if (first == 0) return
      value = settings(first + len(name) + 3:)
      value = value(:index(value//new_line('a'), new_line('a')) - 1)
   end function value_of

   !> The beginning of a long value.
   pure function brief(value)
      character(*), intent(in) :: value
      character(:), allocatable :: brief
      integer, parameter :: longest = 40

      brief = value
      if (len(value) > longest) brief = value(:longest)//'...'
   end function brief

   !> Refuses a file that this command of this program did not write: it is not its to replace.
   subroutine require_command(file, command, error)
      type(hdf5_file), intent(in) :: file
      character(*), intent(in) :: command
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: found, program
      type(hdf5_object) :: root

      root = hdf5_object(file, '/')
      program = ''
      if (root%has_attribute('program')) call root%read('program', program)
      if (program == 'entroslip') call root%read('command', found)
      call root%take_error(error)
      if (allocated(error)) return
      if (program /= 'entroslip') then
         call refuse_foreign(file%path, error)
      else if (found /= command) then
         call raise(error, exit_file, file%path//' holds what entroslip '//found// &
                    ' has written: choose another --output')
      end if
   end subroutine require_command

   !> Refuses to replace a file that this program did not write.
   subroutine refuse_foreign(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, path//' was not written by this program: choose another '// &
                 '--output')
   end subroutine refuse_foreign

end module io_identity
