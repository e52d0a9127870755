!> The results file: one writer that makes it whole or not at all. Datasets are named as users know
!> them; case data are in io_case_results, process data in io_process_results.
module io_results
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_contents, only: check_contents, note_contents
   use io_files, only: folder_of, remove_file, sync_file, sync_folder, unfinished_name
   use io_group, only: counted, group_type, new_group
   use io_hdf5, only: create_hdf5, hdf5_file, label_type, open_hdf5, write_attribute
   use io_identity, only: identity_type, write_identity
   use io_lock, only: lock_type
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: provenance_type, results_writer, begin_results

   !> Where results come from; what differs between two equal runs stands in attributes of the file
   !> alone.
   type :: provenance_type
      type(identity_type) :: identity
      character(:), allocatable :: title
      character(:), allocatable :: scene        !! its text
      character(:), allocatable :: overrides    !! of --set, one a line; '' without
      character(:), allocatable :: git_commit
      character(:), allocatable :: compiler
      character(:), allocatable :: flags
      integer(long) :: seed = 0
      integer :: n_ranks = 1
   end type provenance_type

   !> begin_results, any number of the write_* procedures, then `finish`; after an error `abandon`.
   type :: results_writer
      type(hdf5_file) :: file
      character(:), allocatable :: path
      character(:), allocatable :: temporary
   contains
      procedure :: write_chain
      procedure :: finish
      procedure :: abandon
   end type results_writer

contains

   !> Opens a file beside `path`, which takes its name when it is finished.
   subroutine begin_results(path, provenance, writer, error)
      character(*), intent(in) :: path
      type(provenance_type), intent(in) :: provenance
      type(results_writer), intent(out) :: writer
      type(error_type), allocatable, intent(out) :: error

      writer%path = path
      writer%temporary = unfinished_name(path)
      call create_hdf5(writer%temporary, writer%file, error)
      if (.not. allocated(error)) call write_provenance(writer%file, provenance, error)
      if (allocated(error)) call writer%abandon()
   end subroutine begin_results

   subroutine write_provenance(file, provenance, error)
      type(hdf5_file), intent(in) :: file
      type(provenance_type), intent(in) :: provenance
      type(error_type), allocatable, intent(out) :: error

      call write_identity(file, provenance%identity, error)
      if (.not. allocated(error)) call write_attribute(file, '/', 'seed', provenance%seed, error)
      if (.not. allocated(error)) then
         call write_attribute(file, '/', 'n_ranks', provenance%n_ranks, error)
      end if
      call write_text('title', provenance%title)
      call write_text('scene', provenance%scene)
      call write_text('overrides', provenance%overrides)
      call write_text('git_commit', provenance%git_commit)
      call write_text('compiler', provenance%compiler)
      call write_text('flags', provenance%flags)
      call write_text('created', now())

   contains

      subroutine write_text(name, text)
         character(*), intent(in) :: name, text

         if (.not. allocated(error)) call write_attribute(file, '/', name, text, error)
      end subroutine write_text

   end subroutine write_provenance

   !> Date and time with the offset from UTC, as ISO 8601 has them.
   function now() result(text)
      character(:), allocatable :: text
      character(5) :: zone
      character(8) :: date
      character(10) :: time

      call date_and_time(date, time, zone)
      text = date(1:4)//'-'//date(5:6)//'-'//date(7:8)//'T'//time(1:2)//':'//time(3:4)//':'// &
             time(5:6)//zone(1:3)//':'//zone(4:5)
   end function now

   !> Table 1 and the damping.
   subroutine write_chain(self, chain, forced_dof, error)
      class(results_writer), intent(in) :: self
      type(structure_type), intent(in) :: chain
      integer, intent(in) :: forced_dof
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(self%file, '/chain')
      call group%attribute('forced_dof', forced_dof)
      call group%put('mode', counted(chain%n_dof), label_type('1', 'mode, from the lowest', 'mode'))
      call group%put('dof', counted(chain%n_dof), label_type('1', 'mass, from the wall', 'dof'))
      call group%put('frequencies_stuck', chain%frequencies_stuck, &
                     label_type('Hz', 'natural frequency with all sliders stuck', 'mode'))
      call group%put('frequencies_slip', chain%frequencies_slip, &
                     label_type('Hz', 'natural frequency with all sliders slipping', 'mode'))
      call group%put('damping', chain%damping_ratio, &
                     label_type('1', 'damping ratio of the modes of the stuck chain', 'mode'))
      call group%put('mass', chain%lumped_mass(), label_type('kg', 'mass', 'dof'))
      call group%put('contact_stiffness', chain%joint_stiffness, &
                     label_type('N/m', 'stiffness of the Jenkins springs', 'dof'))
      call group%put('normal_load', chain%normal_load, &
                     label_type('N', 'normal load of the sliders', 'dof'))
      call group%take_error(error)
   end subroutine write_chain

   !> Closes the file, reads it back, and gives it its name; before that there is nothing of that
   !> name, or still the earlier file.
   subroutine finish(self, lock, wall_seconds, error)
      class(results_writer), intent(inout) :: self
      type(lock_type), intent(inout) :: lock   !! of the output
      real(wp), intent(in) :: wall_seconds   !! of the run that ends here
      type(error_type), allocatable, intent(out) :: error

      call write_attribute(self%file, '/', 'wall_seconds', wall_seconds, error)
      if (.not. allocated(error)) call note_contents(self%file, error)
      if (.not. allocated(error)) call self%file%close(error)
      if (.not. allocated(error)) call sync_file(self%temporary, error)
      if (.not. allocated(error)) call open_hdf5(self%temporary, self%file, error)
      if (.not. allocated(error)) call check_contents(self%file, error)
      call self%file%abandon()
      if (.not. allocated(error)) call lock%publish(self%temporary, error)
      if (allocated(error)) then
         call self%abandon()
      else
         call sync_folder(folder_of(self%path), error)
      end if
   end subroutine finish

   !> Leaves nothing behind; an earlier results file stays as it is.
   subroutine abandon(self)
      class(results_writer), intent(inout) :: self
      type(error_type), allocatable :: ignored

      call self%file%abandon()
      call remove_file(self%temporary, ignored)
   end subroutine abandon

end module io_results
