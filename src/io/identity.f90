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

   !> What must be the same for two files to hold samples of one campaign.
   type :: identity_type
      character(:), allocatable :: fingerprint    !! of all in the scene that changes a sample
      character(:), allocatable :: version        !! of the program
      character(:), allocatable :: architecture   !! what decides the last bits of numbers
      character(:), allocatable :: command        !! that wrote it: run, replay, tradeoff
   end type identity_type

contains

   !> Writes it into the root of a file.
   subroutine write_identity(file, identity, error)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error

      call write_sealed_attribute(file, '/', 'program', 'entroslip', error)
      if (allocated(error)) return
      call write_attribute(file, '/', 'format_version', format_version, error)
      if (allocated(error)) return
      call write_sealed_attribute(file, '/', 'fingerprint', identity%fingerprint, error)
      if (allocated(error)) return
      call write_sealed_attribute(file, '/', 'version', identity%version, error)
      if (allocated(error)) return
      call write_sealed_attribute(file, '/', 'architecture', identity%architecture, error)
      if (allocated(error)) return
      call write_sealed_attribute(file, '/', 'command', identity%command, error)
   end subroutine write_identity

   !> Refuses, by name and with the difference, a file of another campaign or of another program.
   subroutine require_same(file, identity, error)
      type(hdf5_file), intent(in) :: file
      type(identity_type), intent(in) :: identity
      type(error_type), allocatable, intent(out) :: error
      integer :: found

      call require_program(file, error)
      if (allocated(error)) return
      call read_attribute(file, '/', 'format_version', found, error)
      if (allocated(error)) return
      if (found /= format_version) then
         call raise(error, exit_file, file%path//' has format version '//to_text(found)// &
                    ', this program reads '//to_text(format_version))
         return
      end if
      call require_command(file, identity%command, error)
      if (allocated(error)) return
      call require_text('fingerprint', identity%fingerprint, 'belongs to another scene')
      if (allocated(error)) return
      call require_text('version', identity%version, &
                        'was written by another version of the program')
      if (allocated(error)) return
      call require_text('architecture', identity%architecture, &
                        'was computed by another kind of machine')

   contains

      subroutine require_text(name, expected, complaint)
         character(*), intent(in) :: name, expected, complaint
         character(:), allocatable :: text

         call read_attribute(file, '/', name, text, error)
         if (allocated(error)) return
         if (text == expected) return
         call raise(error, exit_file, file%path//' '//complaint//' ('//name//' '//text// &
                    ', here '//expected//'): choose another --output, or discard it with --fresh')
      end subroutine require_text

   end subroutine require_same

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

   !> A file that is not this program's to replace.
   subroutine refuse_foreign(path, error)
      character(*), intent(in) :: path
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_file, path//' was not written by this program: choose another '// &
                 '--output')
   end subroutine refuse_foreign

end module io_identity
