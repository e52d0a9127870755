!> The results file: one writer that makes it whole or not at all. Datasets are named as users know
!> them; case data are in io_case_results, process data in io_process_results.
module io_results
   use campaign_plan, only: integration_settings
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use io_contents, only: check_contents, note_contents
   use io_files, only: folder_of, remove_file, sync_file, unfinished_name
   use io_group, only: group_type, new_group
   use io_hdf5, only: create_hdf5, hdf5_file, open_hdf5, write_attribute
   use io_identity, only: identity_type, write_identity
   use io_lock, only: lock_type
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: provenance_type, results_writer, begin_results

   character(*), parameter, public :: &
      about_dofs = 'degree of freedom; of a chain: mass, from the wall', &
      about_joints = 'joint; of a chain: that of the mass of this number'

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
      procedure :: write_structure
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
      if (.not. allocated(error)) &
         call write_attribute(file, '/', 'n_ranks', provenance%n_ranks, error)
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

   !> Writes the structure, and how it was marched: M, C and K by their entries, the joints, the
   !> load.
   subroutine write_structure(self, structure, how, error)
      class(results_writer), intent(in) :: self
      type(structure_type), intent(in) :: structure
      type(integration_settings), intent(in) :: how
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(self%file, '/structure')
      call group%attribute('method', trim(how%method))
      call group%attribute('n_zero_modes', structure%n_zero_modes)
      call group%put_value('dt', how%dt, 's', 'time step')
      associate (n => structure%n_dof)
         call group%put_axis('mode', n, 'mode, from the lowest')
         call group%put_axis('dof', n, about_dofs)
         call group%put_axis('joint', structure%n_joints, about_joints)
         call group%put_axis('force', structure%n_forces, 'force, a column of the load')
      end associate
      call group%put('frequencies_stuck', structure%frequencies_stuck, 'Hz', &
                     'natural frequency with all joints stuck', 'mode')
      call group%put('frequencies_slip', structure%frequencies_slip, 'Hz', &
                     'natural frequency with all joints slipping', 'mode')
      if (size(structure%damping_ratio) > 0) &
         call group%put('damping_ratio', structure%damping_ratio, '1', &
                        'damping ratio with all joints stuck', 'mode')
      call write_entries(group, 'mass', 'kg', structure%mass)
      call write_entries(group, 'stiffness', 'N/m', structure%stiffness)
      call write_entries(group, 'damping', 'N s/m', structure%damping)
      call group%put('joint_stiffness', structure%joint_stiffness, 'N/m', &
                     'stiffness of the joint while it sticks', 'joint')
      call group%put('normal_load', structure%normal_load, 'N', 'normal load of the joint', 'joint')
      call group%put('joint_friction', structure%joint_friction, '1', &
                     'friction coefficient as given', 'joint')
      call group%put('friction_point', structure%friction_point, '1', &
                     'point of the process that gives the friction', 'joint')
      call group%put('directions', structure%direction, '1', 'direction of the joint', 'joint dof')
      call group%put('load', structure%load, '1', 'factor of the force', 'force dof')
      call group%take_error(error)
   end subroutine write_structure

   !> Writes the nonzero entries of a matrix, row by row.
   subroutine write_entries(group, name, unit, matrix)
      type(group_type), intent(inout) :: group
      character(*), intent(in) :: name, unit
      real(wp), intent(in) :: matrix(:, :)
      type(sparse_matrix) :: entries
      character(:), allocatable :: axis

      entries = sparse_of(matrix)
      axis = name//'_entry'
      call group%put_axis(axis, size(entries%value), 'entry')
      call group%put(name//'_row', entries%row_of_entries(), '1', 'row', axis)
      call group%put(name//'_column', entries%column, '1', 'column', axis)
      call group%put(name//'_value', entries%value, unit, 'value', axis)
   end subroutine write_entries

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
         call sync_file(folder_of(self%path), error)   ! the new name
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
