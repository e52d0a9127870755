!> Reads a structure from files: Matrix Market matrices, a table of joints, directions, a load.
module structure_files
   use core_complaints, only: complaint_list
   use core_error, only: error_type
   use core_kinds, only: wp
   use core_table, only: read_table, table_type
   use core_text, only: counted, number_text, to_text
   use structure_matrix_market, only: matrix_file, read_matrix
   use structure_model, only: build_structure, damping_type, part_names, structure_type
   implicit none(type, external)
   private
   public :: read_structure, structure_paths

   integer, parameter :: most_points = 100000   !! points of a friction process
   integer, parameter :: most_forces = 100
   real(wp), parameter :: rounding = 1.0e-12_wp   !! asymmetry over the largest entry, at most

   !> Paths of the files of a structure; '': there is no such file.
   type :: structure_paths
      character(:), allocatable :: mass         !! M
      character(:), allocatable :: stiffness    !! K without the joints
      character(:), allocatable :: damping      !! C
      character(:), allocatable :: joints       !! table, see read_joints
      character(:), allocatable :: directions   !! W (dof, joint)
      character(:), allocatable :: load         !! b (dof, force)
   end type structure_paths

contains

   !> Reads and completes a structure, which is valid if there are no new complaints and
   !> `damping_ratio` has one value, or one for each of its n_dof modes: else the caller complains.
   !> Without a load file one force acts on `forced_dof`.
   subroutine read_structure(paths, rayleigh, damping_ratio, forced_dof, structure, complaints)
      type(structure_paths), intent(in) :: paths
      real(wp), intent(in) :: rayleigh(2)        !! alpha [1/s], beta [s]; zeros: not this damping
      real(wp), intent(in) :: damping_ratio(:)   !! of each mode, if no other damping
      integer, intent(in) :: forced_dof          !! 0: the last dof
      type(structure_type), intent(out) :: structure
      type(complaint_list), intent(inout) :: complaints
      type(damping_type) :: damping
      type(error_type), allocatable :: error
      type(part_names) :: names
      integer :: n_before

      n_before = complaints%n
      damping%rayleigh = rayleigh
      damping%ratio = damping_ratio
      names%mass = paths%mass   ! by component: gfortran 12 misjudges the lengths in a constructor
      names%stiffness = paths%stiffness
      call read_symmetric(paths%mass, .true., structure%n_dof, structure%mass, complaints)
      call read_symmetric(paths%stiffness, .false., structure%n_dof, structure%stiffness, &
                          complaints)
      names%damping = paths%damping
      if (paths%damping /= '') &
         call read_symmetric(paths%damping, .false., structure%n_dof, damping%matrix, complaints)
      if (complaints%n > n_before) return   ! n_dof may be unknown
      call read_joints(paths, structure, complaints)
      call read_load(paths%load, forced_dof, structure, complaints)
      if (complaints%n > n_before .or. all(size(damping_ratio) /= [1, structure%n_dof])) return
      call build_structure(damping, names, structure, error)
      if (allocated(error)) call complaints%add_general(error%message)
   end subroutine read_structure

   !> Reads a symmetric matrix (dof, dof); the first one gives the number of dofs.
   subroutine read_symmetric(path, is_mass, n_dof, matrix, complaints)
      character(*), intent(in) :: path
      logical, intent(in) :: is_mass    !! True: its diagonal must be positive
      integer, intent(inout) :: n_dof   !! 0: not known yet
      real(wp), allocatable, intent(out) :: matrix(:, :)
      type(complaint_list), intent(inout) :: complaints
      type(matrix_file) :: file
      integer :: i, j, n_before, worst(2)

      n_before = complaints%n
      call read_matrix(path, file, complaints)
      if (complaints%n > n_before) return
      if (n_dof == 0) n_dof = size(file%value, 1)
      if (any(shape(file%value) /= n_dof)) then
         call refuse_sizes(file, size_text([n_dof, n_dof])//', as many as there are dofs', &
                           complaints)
         return
      end if
      worst = maxloc(abs(file%value - transpose(file%value)))
      if (file%line(worst(2), worst(1)) > file%line(worst(1), worst(2))) worst = worst([2, 1])
      i = worst(1)
      j = worst(2)   ! (i, j) stands later in the file than (j, i)
      if (abs(file%value(i, j) - file%value(j, i)) > rounding*maxval(abs(file%value))) &
         call file%refuse(file%line(i, j), entry(file, i, j)//' but ('//to_text(j)//', '// &
                          to_text(i)//') = '//to_text(file%value(j, i))//': must be symmetric', &
                          complaints)
      do i = 1, n_dof
         if (file%value(i, i) > 0.0_wp .or. .not. is_mass) cycle
         call file%refuse(file%line(i, i), entry(file, i, i)// &
                          ': a mass matrix must be positive definite', complaints)
         exit
      end do
      call move_alloc(file%value, matrix)
   end subroutine read_symmetric

   !> Complains of the sizes of a matrix.
   subroutine refuse_sizes(file, wanted, complaints)
      type(matrix_file), intent(in) :: file
      character(*), intent(in) :: wanted
      type(complaint_list), intent(inout) :: complaints

      call file%refuse(file%size_line, 'holds '//size_text(shape(file%value))// &
                       ' entries: must be '//wanted, complaints)
   end subroutine refuse_sizes

   pure function size_text(extents) result(text)
      integer, intent(in) :: extents(2)
      character(:), allocatable :: text

      text = to_text(extents(1))//' x '//to_text(extents(2))
   end function size_text

   pure function entry(file, i, j) result(text)
      type(matrix_file), intent(in) :: file
      integer, intent(in) :: i, j
      character(:), allocatable :: text

      text = 'entry ('//to_text(i)//', '//to_text(j)//') = '//to_text(file%value(i, j))
   end function entry

   !> Reads a line for each joint: dof_a dof_b stiffness normal_load friction [friction_point],
   !> without the dofs if there is a file of directions.
   subroutine read_joints(paths, structure, complaints)
      type(structure_paths), intent(in) :: paths
      type(structure_type), intent(inout) :: structure
      type(complaint_list), intent(inout) :: complaints
      character(*), parameter :: columns = 'dof_a dof_b stiffness normal_load friction '// &
                                 '[friction_point]'
      type(table_type) :: table
      integer :: n_before, n_dofs

      n_before = complaints%n
      n_dofs = merge(2, 0, paths%directions == '')
      call read_table(paths%joints, n_dofs + 3, n_dofs + 4, table, complaints)
      if (complaints%n > n_before .or. table%n_rows == 0) &
         call complaints%add_general(paths%joints//': must have a joint on each line, one '// &
                                     'at least: '//columns(merge(1, 13, n_dofs == 2):))
      if (complaints%n > n_before) return
      structure%n_joints = table%n_rows
      call read_properties(table, n_dofs, structure, complaints)
      if (n_dofs == 2) then
         call read_pairs(table, structure, complaints)
      else
         call read_directions(paths%directions, structure, complaints)
      end if
   end subroutine read_joints

   !> Reads W (dof, joint); no column may be zero.
   subroutine read_directions(path, structure, complaints)
      character(*), intent(in) :: path
      type(structure_type), intent(inout) :: structure
      type(complaint_list), intent(inout) :: complaints
      type(matrix_file) :: file
      integer :: j, n_before

      n_before = complaints%n
      call read_matrix(path, file, complaints)
      if (complaints%n > n_before) return
      if (any(shape(file%value) /= [structure%n_dof, structure%n_joints])) then
         call refuse_sizes(file, 'dofs x joints, '// &
                           size_text([structure%n_dof, structure%n_joints]), complaints)
         return
      end if
      call move_alloc(file%value, structure%direction)
      do j = 1, structure%n_joints
         if (any(abs(structure%direction(:, j)) > 0.0_wp)) cycle
         call complaints%add_general(path//': column '//to_text(j)//': must not be zero')
      end do
   end subroutine read_directions

   !> Reads stiffness, normal load, friction and friction point of each joint; without the last, the
   !> point is the joint's number.
   subroutine read_properties(table, n_dofs, structure, complaints)
      type(table_type), intent(in) :: table
      integer, intent(in) :: n_dofs   !! number of columns before
      type(structure_type), intent(inout) :: structure
      type(complaint_list), intent(inout) :: complaints
      character(*), parameter :: names(3) = &
                                 [character(11) :: 'stiffness', 'normal_load', 'friction']
      character(*), parameter :: rules(3) = [character(24) :: &
         'must be positive', 'must be zero or positive', 'must be zero or positive']
      integer :: i, j

      structure%joint_stiffness = table%value(n_dofs + 1, :)
      structure%normal_load = table%value(n_dofs + 2, :)
      structure%joint_friction = table%value(n_dofs + 3, :)
      structure%friction_point = [(j, j=1, table%n_rows)]
      do j = 1, table%n_rows
         do i = 1, 3
            associate (value => table%value(n_dofs + i, j))
               if (value > 0.0_wp .or. (i > 1 .and. .not. value < 0.0_wp)) cycle
               call table%refuse_row(j, trim(names(i)), to_text(value), trim(rules(i)), complaints)
            end associate
         end do
         if (table%n_columns(j) == n_dofs + 4) &
            call read_count(table, j, n_dofs + 4, 'friction_point', 1, most_points, &
                            structure%friction_point(j), complaints)
      end do
   end subroutine read_properties

   !> Reads the dofs of each joint. Its direction is +1 at dof_a and -1 at dof_b; 0 is the ground.
   subroutine read_pairs(table, structure, complaints)
      type(table_type), intent(in) :: table
      type(structure_type), intent(inout) :: structure
      type(complaint_list), intent(inout) :: complaints
      integer :: a, b, j

      allocate (structure%direction(structure%n_dof, table%n_rows), source=0.0_wp)
      do j = 1, table%n_rows
         call read_count(table, j, 1, 'dof_a', 1, structure%n_dof, a, complaints)
         call read_count(table, j, 2, 'dof_b', 0, structure%n_dof, b, complaints)
         if (a == 0) cycle
         structure%direction(a, j) = 1.0_wp
         if (b > 0) structure%direction(b, j) = -1.0_wp
         if (a == b) call table%refuse_row(j, 'dof_b', to_text(b), 'must differ from dof_a', &
                                           complaints)
      end do
   end subroutine read_pairs

   !> Reads a whole number between limits; 0 after a complaint.
   subroutine read_count(table, row, column, name, least, most, count, complaints)
      type(table_type), intent(in) :: table
      integer, intent(in) :: row, column, least, most
      character(*), intent(in) :: name
      integer, intent(out) :: count
      type(complaint_list), intent(inout) :: complaints

      count = 0
      associate (value => table%value(column, row))
         if (value < least .or. value > most .or. abs(value - aint(value)) > 0.0_wp) then
            call table%refuse_row(row, name, number_text(value), 'must be a whole number from '// &
                                  to_text(least)//' to '//to_text(most), complaints)
         else
            count = nint(value)
         end if
      end associate
   end subroutine read_count

   !> Reads b: a line for each dof, a column for each force. Without a file, 1 at the forced dof.
   subroutine read_load(path, forced_dof, structure, complaints)
      character(*), intent(in) :: path
      integer, intent(in) :: forced_dof
      type(structure_type), intent(inout) :: structure
      type(complaint_list), intent(inout) :: complaints
      type(table_type) :: table
      integer :: i, n_before

      if (path == '') then
         allocate (structure%load(structure%n_dof, 1), source=0.0_wp)
         i = merge(forced_dof, structure%n_dof, forced_dof > 0)
         if (i <= structure%n_dof) structure%load(i, 1) = 1.0_wp
         return
      end if
      n_before = complaints%n
      call read_table(path, 1, most_forces, table, complaints)
      if (complaints%n > n_before) return
      if (table%n_rows /= structure%n_dof) then
         call complaints%add_general(path//': holds '//counted(table%n_rows, 'row', 'rows')// &
                                     ': must be one for each of the '// &
                                     to_text(structure%n_dof)//' dofs')
         return
      end if
      structure%n_forces = table%n_columns(1)
      do i = 1, table%n_rows
         if (table%n_columns(i) == structure%n_forces) cycle
         call table%refuse_row(i, 'columns', to_text(table%n_columns(i)), 'must be '// &
                               to_text(structure%n_forces)//', as on the first line', complaints)
         return
      end do
      structure%load = transpose(table%value(:structure%n_forces, :))
      do i = 1, structure%n_forces
         if (any(abs(structure%load(:, i)) > 0.0_wp)) cycle
         call complaints%add_general(path//': column '//to_text(i)//': must not be zero')
      end do
   end subroutine read_load

end module structure_files
