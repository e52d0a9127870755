!> By what a file of results is known to belong to a campaign.
module io_identity
   use core_error, only: error_type, exit_file, raise
   use core_text, only: to_text
   use io_hdf5, only: has_attribute, hdf5_file, read_attribute, write_attribute, &
                      write_sealed_attribute
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

      call write_attribute(file, '/', 'format_version', format_version, error)
      call write_text('program', 'entroslip')
      call write_text('settings', identity%settings)
      call write_text('fingerprint', identity%fingerprint)
      call write_text('version', identity%version)
      call write_text('architecture', identity%architecture)
      call write_text('command', identity%command)

   contains

      subroutine write_text(name, text)
         character(*), intent(in) :: name, text

         if (.not. allocated(error)) call write_sealed_attribute(file, '/', name, text, error)
      end subroutine write_text

   end subroutine write_identity

   !> Refuses, by name and with the difference, a file of another campaign or of another program.
   !> `advice` is for a file that is damaged.
   subroutine require_same(file, identity, error, advice)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error
      character(*), intent(in), optional :: advice
      character(:), allocatable :: theirs
      integer :: found

      call require_command(file, identity%command, error)
      if (allocated(error)) return
      call read_attribute(file, '/', 'format_version', found, error)
      if (allocated(error)) then
         call advise()
         return
      else if (found /= format_version) then
         call raise(error, exit_file, file%path//' has format version '//to_text(found)// &
                    ', this program reads '//to_text(format_version))
         return
      end if
      call read_text('fingerprint', theirs)
      if (allocated(error)) return
      if (theirs /= identity%fingerprint) then
         call read_text('settings', theirs)
         if (.not. allocated(error)) &
            call refuse('belongs to another scene', difference(theirs, identity%settings))
         return
      end if
      call require_text('version', identity%version, &
                        'was written by another version of the program')
      if (allocated(error)) return
      call require_text('architecture', identity%architecture, &
                        'was computed by another kind of machine')

   contains

      subroutine require_text(name, expected, complaint)
         character(*), intent(in) :: name, expected, complaint
         character(:), allocatable :: text

         call read_text(name, text)
         if (allocated(error)) return
         if (text /= expected) call refuse(complaint, name//' '//text//', here '//expected)
      end subroutine require_text

      subroutine read_text(name, text)
         character(*), intent(in) :: name
         character(:), allocatable, intent(out) :: text

         call read_attribute(file, '/', name, text, error)
         if (allocated(error)) call advise()
      end subroutine read_text

      subroutine advise()
         if (present(advice)) error%message = error%message//advice
      end subroutine advise

      subroutine refuse(complaint, reason)
         character(*), intent(in) :: complaint, reason

         call raise(error, exit_file, file%path//' '//complaint//' ('//reason// &
                    '): choose another --output, or discard it with --fresh')
      end subroutine refuse

   end subroutine require_same

   !> The values that differ between the settings of a file and those of the scene; the first few,
   !> and how many more.
   function difference(theirs, ours) result(text)
      character(*), intent(in) :: theirs, ours   !! as in identity_type
      character(:), allocatable :: text
      integer, parameter :: most_named = 3
      character(:), allocatable :: value
      integer :: first, last, n, separator

      text = ''
      n = 0
      first = 1
      do while (first <= len(theirs))
         last = first + index(theirs(first:)//new_line('a'), new_line('a')) - 2
         separator = first + index(theirs(first:last)//' = ', ' = ') - 1
         value = value_of(theirs(first:separator - 1), ours)
         if (value /= theirs(separator + 3:last)) &
            call add(theirs(first:separator - 1), theirs(separator + 3:last), value)
         first = last + 2
      end do
      first = 1
      do while (first <= len(ours))
         last = first + index(ours(first:)//new_line('a'), new_line('a')) - 2
         separator = first + index(ours(first:last)//' = ', ' = ') - 1
         if (value_of(ours(first:separator - 1), theirs) == unused) &
            call add(ours(first:separator - 1), unused, ours(separator + 3:last))
         first = last + 2
      end do
      if (n > most_named) text = text//' and '//to_text(n - most_named)//' more'

   contains

      subroutine add(name, value, our_value)
         character(*), intent(in) :: name, value, our_value

         n = n + 1
         if (n > most_named) return
         if (n > 1) text = text//'; '
         text = text//name//' = '//brief(value)//', here '//brief(our_value)
      end subroutine add

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
      character(:), allocatable :: found

      call require_program(file, error)
      if (.not. allocated(error)) call read_attribute(file, '/', 'command', found, error)
      if (allocated(error)) return
      if (found == command) return
      call raise(error, exit_file, file%path//' holds what entroslip '//found//' has written: '// &
                 'choose another --output')
   end subroutine require_command

   subroutine require_program(file, error)
      type(hdf5_file), intent(in) :: file
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: found

      found = ''
      if (has_attribute(file, '/', 'program')) &
         call read_attribute(file, '/', 'program', found, error)
      if (allocated(error) .or. found == 'entroslip') return
      call refuse_foreign(file%path, error)
   end subroutine require_program

   !> Refuses to replace a file that this program did not write.
   subroutine refuse_foreign(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, path//' was not written by this program: choose another '// &
                 '--output')
   end subroutine refuse_foreign

end module io_identity
