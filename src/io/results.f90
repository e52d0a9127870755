!> The results file, whole or not at all: its structure, and its end. Datasets are named as users
!> know them; case data are in io_case_results, process data in io_process_results.
module io_results
   use campaign_plan, only: plan_type
   use core_error, only: error_type
   use core_kinds, only: wp
   use io_contents, only: check_contents, note_contents
   use io_files, only: folder_of, sync_file
   use io_group, only: group_type, new_group
   use io_hdf5, only: hdf5_file, open_hdf5, write_attribute
   use io_lock, only: lock_type
   use io_store, only: discard_file
   use numerics_sparse, only: sparse_matrix, sparse_of
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: finish_results, write_structure

   character(*), parameter, public :: &
      about_dofs = 'degree of freedom; of a chain: mass, from the wall', &
      about_joints = 'joint; of a chain: that of the mass of this number'

contains

   !> Writes the structure, and how it was marched: M, C and K by their entries, the joints, the
   !> load.
   subroutine write_structure(file, plan, error)
      type(hdf5_file), intent(in) :: file
      type(plan_type), intent(in) :: plan
      type(error_type), allocatable, intent(out) :: error
      type(group_type) :: group

      group = new_group(file, '/structure')
      call group%attribute('method', trim(plan%integration%method))
      call group%attribute('n_zero_modes', plan%structure%n_zero_modes)
      call group%put_value('dt', plan%integration%dt, 's', 'time step')
      call write_matrices(group, plan%structure)
      call group%put('load', plan%structure%load, trim(merge('kg', '1 ', plan%excitation%base)), &
                     'factor of the force', 'force dof')
      call group%take_error(error)
   end subroutine write_structure

   !> Writes the axes, the frequencies, M, C, K and the joints.
   subroutine write_matrices(group, structure)
      type(group_type), intent(inout) :: group
      type(structure_type), intent(in) :: structure

      call group%put_axis('mode', structure%n_dof, 'mode, from the lowest')
      call group%put_axis('dof', structure%n_dof, about_dofs)
      call group%put_axis('joint', structure%n_joints, about_joints)
      call group%put_axis('force', structure%n_forces, 'force, a column of the load')
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
   end subroutine write_matrices

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
   !> name, or still the earlier file. None is left after an error.
   subroutine finish_results(file, lock, wall_seconds, error)
      type(hdf5_file), intent(inout) :: file
      type(lock_type), intent(inout) :: lock   !! of the output
      real(wp), intent(in) :: wall_seconds   !! of the run that ends here
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: temporary

      temporary = file%path
      call write_attribute(file, '/', 'wall_seconds', wall_seconds, error)
      if (.not. allocated(error)) call note_contents(file, error)
      if (.not. allocated(error)) call file%close(error)
      if (.not. allocated(error)) call sync_file(temporary, error)
      if (.not. allocated(error)) call open_hdf5(temporary, file, error)
      if (.not. allocated(error)) call check_contents(file, error)
      call file%abandon()
      if (.not. allocated(error)) call lock%publish(temporary, error)
      if (allocated(error)) then
         call discard_file(file)
      else
         call sync_file(folder_of(lock%output), error)   ! the new name
      end if
   end subroutine finish_results

end module io_results
