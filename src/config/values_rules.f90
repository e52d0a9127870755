!> Rules of process%values: samples of the friction that a scene takes as they are.
module config_values_rules
   use config_force_file, only: force_label
   use config_groups, only: scene_type
   use config_text_reader, only: reader_type
   use core_kinds, only: wp
   use core_source, only: find_beside
   use core_table, only: read_table, table_type
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: check_values

   character(*), parameter :: group = 'process'
   !> Values of the group that describe a law, which given values have not.
   character(*), parameter :: of_law(*) = [character(18) :: 'method', 'correlation', &
                                           'correlation_length', 'order', 'mean', 'std', &
                                           'n_realizations']

contains

   !> Reads the samples of the one &process that has them; their number is that of the campaign.
   subroutine check_values(scene, reader)
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      integer :: i, j

      do i = 1, size(scene%processes)
         if (scene%processes(i)%values == '') cycle
         call reader%require(scene%moves(), group, 'values', 'needs &chain or &structure', number=i)
         call reader%require(.not. allocated(scene%values), group, 'values', &
                             'must stand in one &process alone', number=i)
         do j = 1, size(of_law)
            call reader%require(.not. reader%was_given(group, trim(of_law(j)), i), group, &
                                trim(of_law(j)), 'must be absent with values', number=i)
         end do
         if (scene%moves() .and. .not. allocated(scene%values)) call read_values(i, scene, reader)
      end do

   end subroutine check_values

   !> Reads the friction samples of process%values, one line a sample and one value a point. Sets
   !> the process's mean and std to those of all values.
   subroutine read_values(number, scene, reader)
      integer, intent(in) :: number   !! of the &process
      type(scene_type), intent(inout) :: scene
      type(reader_type), intent(inout) :: reader
      type(table_type) :: table
      character(:), allocatable :: path
      integer :: i, n_before, n_points

      path = find_beside(scene%path, scene%processes(number)%values)
      call reader%require(path /= '', group, 'values', 'no such file', number=number)
      n_points = merge(scene%structure%n_points, scene%chain%n_dof, scene%has_structure)
      if (path == '' .or. n_points == 0) return
      n_before = reader%complaints%n
      call read_table(path, '#', n_points, n_points, table, reader%complaints)
      do i = 1, table%n_rows
         if (minval(table%value(:, i)) < 0.0_wp) &
            call table%refuse_row(i, 'friction', to_text(minval(table%value(:, i))), &
                                  'must be zero or positive', reader%complaints)
      end do
      if (reader%complaints%n > n_before) return
      if (table%n_rows < 2) then
         call reader%complaints%add_general(path//': must hold two samples or more')
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
                          'needs samples without end: process%values has so many')
   end subroutine read_values

end module config_values_rules
