!> Reads and checks the files of &structure, and the file of friction values of a &process.
module config_structure_rules
   use config_force_file, only: force_label
   use config_groups, only: scene_type
   use config_text_reader, only: reader_type
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use core_table, only: read_table, table_type
   use core_text, only: counted, to_text
   use structure_files, only: read_structure, structure_paths
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: check_structure, check_values

   character(*), parameter :: group = 'structure'
   !> Names of &process that describe a law, which a process of given values does not have.
   character(*), parameter :: law_names(*) = [character(18) :: 'method', 'correlation', &
                                              'correlation_length', 'order', 'mean', 'std', &
                                              'n_realizations']

contains

   !> Checks the rules of &structure and reads its files into scene%structure, which is valid only
   !> without complaints.
   subroutine check_structure(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      type(structure_paths) :: paths
      integer :: n_before

      n_before = reader%complaints%n
      call reader%require(scene%has_excitation .or. scene%has_unknown_group, group, 'mass_matrix', &
                          '&structure needs &excitation')
      call reader%require(.not. scene%has_chain, 'chain', 'n_dof', &
                          'must be absent with &structure: a scene has one structure')
      call check_damping(scene, reader)
      if (scene%structure_files%load /= '') &
         call reader%require(.not. reader%was_given('excitation', 'dof'), 'excitation', 'dof', &
                             'must be absent with structure%load, which says where forces act')
      associate (this => scene%structure_files)
         call find('mass_matrix', this%mass_matrix, .true., paths%mass)
         call find('stiffness_matrix', this%stiffness_matrix, .true., paths%stiffness)
         call find('damping_matrix', this%damping_matrix, .false., paths%damping)
         call find('joints', this%joints, .true., paths%joints)
         call find('directions', this%directions, .false., paths%directions)
         call find('load', this%load, .false., paths%load)
         if (reader%complaints%n > n_before) return
         if (paths%mass == '' .or. paths%stiffness == '' .or. paths%joints == '' .or. &
             size(this%damping_ratio) == 0) return   ! refused
         call read_structure(paths, this%rayleigh, this%damping_ratio, scene%excitation%dof, &
                             scene%structure, reader%complaints)
         call reader%require(any(size(this%damping_ratio) == [1, scene%structure%n_dof]) .or. &
                             scene%structure%n_dof == 0, group, 'damping_ratio', &
                             'must be one value, or one for each of the '// &
                             to_text(scene%structure%n_dof)//' modes')
         if (reader%complaints%n > n_before) return
         scene%structure_label = label_of_structure(scene%structure, paths%damping /= '')
      end associate

   contains

      !> Finds the path of a file of the structure, '' if it is not given. Complains of a file that
      !> is required and not given.
      subroutine find(name, file, is_required, path)
         character(*), intent(in) :: name, file
         logical, intent(in) :: is_required
         character(:), allocatable, intent(out) :: path

         path = ''
         if (file == '') then
            call reader%require(.not. is_required, group, name, 'must be given')
         else
            call reader%find_file(group, name, file, path)
         end if
      end subroutine find

   end subroutine check_structure

   !> Checks that at most one kind of damping is given. An empty file name and zeros, which the
   !> template has, count as not given.
   subroutine check_damping(scene, reader)
      type(scene_type), intent(in) :: scene
      type(reader_type), intent(inout) :: reader
      character(*), parameter :: rule = 'must be absent with structure%'
      logical :: has_ratio, is_rayleigh

      has_ratio = reader%was_given(group, 'damping_ratio')
      is_rayleigh = any(scene%structure_files%rayleigh > 0.0_wp)
      if (scene%structure_files%damping_matrix /= '') then
         call reader%require(.not. is_rayleigh, group, 'rayleigh', rule//'damping_matrix')
         call reader%require(.not. has_ratio, group, 'damping_ratio', rule//'damping_matrix')
      else if (is_rayleigh) then
         call reader%require(.not. has_ratio, group, 'damping_ratio', rule//'rayleigh')
      end if
   end subroutine check_damping

   !> Hash of all data of the files that can change a sample with random friction.
   pure function label_of_structure(structure, has_damping) result(label)
      type(structure_type), intent(in) :: structure
      logical, intent(in) :: has_damping   !! true if C is from a file
      integer(long) :: label

      label = label_of('structure')
      call add(structure%mass)
      call add(structure%stiffness)
      if (has_damping) call add(structure%damping)
      call add(structure%direction)
      call add(structure%load)
      call add(reshape([structure%joint_stiffness, structure%normal_load, &
                        real(structure%friction_point, wp)], [structure%n_joints, 3]))

   contains

      !> Adds rows, columns and values of the nonzero entries of a matrix.
      pure subroutine add(matrix)
         real(wp), intent(in) :: matrix(:, :)
         integer :: i, j

         label = label_of(label_of(label, size(matrix, 1)), size(matrix, 2))
         do j = 1, size(matrix, 2)
            do i = 1, size(matrix, 1)
               if (.not. abs(matrix(i, j)) > 0.0_wp) cycle
               label = label_of(label_of(label_of(label, i), j), matrix(i, j))
            end do
         end do
      end subroutine add

   end function label_of_structure

   !> Reads process%values, which one &process may have.
   subroutine check_values(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: i, j

      do i = 1, size(scene%processes)
         if (scene%processes(i)%values == '') cycle
         call reader%require(scene%has_motion(), 'process', 'values', &
                             'needs &chain or &structure', number=i)
         call reader%require(.not. allocated(scene%values), 'process', 'values', &
                             'must be given in one &process only', number=i)
         do j = 1, size(law_names)
            call reader%require(.not. reader%was_given('process', trim(law_names(j)), i), &
                                'process', trim(law_names(j)), 'must be absent with values', &
                                number=i)
         end do
         if (scene%has_motion() .and. .not. allocated(scene%values)) &
            call read_values(i, scene, reader)
      end do
   end subroutine check_values

   !> Reads the friction values of a file, one line per sample and one value per point. Sets mean
   !> and std of the process to those of all values, and the default of campaign%n_samples.
   subroutine read_values(number, scene, reader)
      integer, intent(in) :: number   !! number of the &process
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      type(table_type) :: table
      character(:), allocatable :: path
      integer :: i, n_before, n_points

      call reader%find_file('process', 'values', scene%processes(number)%values, path, number)
      n_points = merge(scene%structure%n_points, scene%chain%n_dof, scene%has_structure)
      if (path == '' .or. n_points == 0) return
      n_before = reader%complaints%n
      call read_table(path, n_points, n_points, table, reader%complaints)
      do i = 1, table%n_rows
         if (minval(table%value(:, i)) < 0.0_wp) &
            call table%refuse_row(i, 'friction', to_text(minval(table%value(:, i))), &
                                  'must be zero or positive', reader%complaints)
      end do
      if (reader%complaints%n > n_before) return
      if (table%n_rows < 2) then
         call reader%complaints%add_general( &
            path//': holds '//counted(table%n_rows, 'sample', 'samples')//': must hold two or more')
         return
      end if
      if (maxval(table%value) <= minval(table%value)) then
         call reader%complaints%add_general(path//': all values are '// &
                                            to_text(maxval(table%value))//': they must scatter')
         return
      end if
      scene%values = table%value
      scene%values_label = force_label(scene%values)
      associate (this => scene%processes(number), n => real(size(table%value), wp))
         this%shared%mean = sum(table%value)/n
         this%stds = [sqrt(sum((table%value - this%shared%mean)**2)/n)]
         this%lengths = [0.0_wp]
         this%orders = [1]
      end associate
      if (.not. reader%was_given('campaign', 'n_samples')) scene%campaign%n_samples = table%n_rows
      call reader%require(scene%campaign%n_samples <= table%n_rows, 'campaign', 'n_samples', &
                          'must be at most '//to_text(table%n_rows)// &
                          ', the samples of process%values')
      call reader%require(.not. scene%accuracy%sample_until_met, 'accuracy', 'sample_until_met', &
                          'needs an unlimited number of samples: process%values has a fixed number')
   end subroutine read_values

end module config_structure_rules
