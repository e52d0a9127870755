!> Reads a scene file and the --set options into groups, and checks their values.
module config_scene
   use config_groups, only: group_names, scene_type
   use config_rules, only: check_rules
   use config_text_reader, only: reader_type
   use core_complaints, only: complaint_list, suggestion
   use core_source, only: read_source, source_type
   use core_text, only: to_text
   use structure_model, only: most_dofs
   implicit none(type, external)
   private
   public :: complaint_list, parse_scene, read_scene, scene_type

   integer, parameter :: most_bytes = 16*1024**2   !! largest size of a scene file

contains

   !> Reads and checks a scene file. The scene is valid if complaints%n is 0.
   subroutine read_scene(path, overrides, scene, complaints)
      character(*), intent(in) :: path
      character(*), intent(in) :: overrides   !! --set options, `group%name=value`, one a line
      type(scene_type), intent(out) :: scene
      type(complaint_list), intent(out) :: complaints
      type(source_type) :: source
      character(:), allocatable :: refusal

      call read_source(path, source, refusal, most_bytes)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
      else
         call parse_scene(source, overrides, scene, complaints)
      end if
   end subroutine read_scene

   !> Parses and checks the text of a scene; on request its processes alone, without the files of a
   !> structure or force.
   subroutine parse_scene(source, overrides, scene, complaints, processes_alone)
      type(source_type), intent(in) :: source    !! its name is the path of the scene
      character(*), intent(in) :: overrides
      type(scene_type), intent(out) :: scene
      type(complaint_list), intent(out) :: complaints
      logical, intent(in), optional :: processes_alone
      type(reader_type) :: reader

      scene%path = source%name
      scene%text = source%text
      call reader%parse(source, overrides)
      call check_groups(reader, scene%has_unknown_group)
      call read_groups(reader, scene)
      if (present(processes_alone)) then
         scene%has_structure = scene%has_structure .and. .not. processes_alone
         scene%has_chain = scene%has_chain .and. .not. processes_alone
      end if
      call check_rules(scene, reader)
      complaints = reader%complaints
   end subroutine parse_scene

   !> Complains of unknown groups, and of repeated groups other than &process.
   subroutine check_groups(reader, has_unknown)
      type(reader_type), intent(inout) :: reader
      logical, intent(out) :: has_unknown   !! true if there is an unknown group
      character(:), allocatable :: rule
      integer :: i, first

      has_unknown = .false.
      do i = 1, size(reader%groups)
         associate (group => reader%groups(i))
            first = reader%find_group(group%name)
            if (all(group_names /= group%name)) then
               has_unknown = .true.
               rule = 'unknown group'//suggestion('&'//trim(group%name), '&'//group_names)
            else if (first < i .and. group%name /= 'process') then
               rule = 'the group is there twice, first on line '// &
                      to_text(reader%groups(first)%place%line)
            else
               cycle
            end if
            call reader%complain(group%place, rule, '&'//trim(group%name))
         end associate
      end do
   end subroutine check_groups

   !> Reads all groups; absent ones get their defaults.
   subroutine read_groups(reader, scene)
      type(reader_type), intent(inout) :: reader
      type(scene_type), intent(inout) :: scene
      integer :: i, n_masses, number, n_processes

      n_processes = count(reader%groups%name == 'process')
      allocate (scene%processes(n_processes))
      n_masses = reader%longest_list('chain')   ! unless it is given
      if (n_masses > 1 .and. .not. reader%was_given('chain', 'n_dof')) &
         scene%chain%n_dof = min(n_masses, most_dofs)
      do i = 1, size(group_names)
         do number = 1, merge(n_processes, 1, group_names(i) == 'process')
            call reader%begin_group(trim(group_names(i)), number)
            call scene%visit(trim(group_names(i)), number, reader)
            call reader%end_group()
         end do
      end do
      scene%has_structure = reader%find_group('structure') > 0
      scene%has_chain = reader%find_group('chain') > 0
      scene%has_excitation = reader%find_group('excitation') > 0
      call note_unused(reader, scene)
   end subroutine read_groups

   !> Lists the values that are given and have no effect.
   subroutine note_unused(reader, scene)
      type(reader_type), intent(in) :: reader
      type(scene_type), intent(inout) :: scene
      character(*), parameter :: motion_groups(*) = [character(12) :: &
                                 '&excitation', '&integration', '&campaign', '&accuracy']
      integer :: i

      scene%unused = reader%unused
      if (.not. scene%has_motion()) then
         do i = 1, size(motion_groups)
            if (reader%find_group(trim(motion_groups(i) (2:))) > 0) &
               scene%unused = [character(80) :: scene%unused, motion_groups(i)]
         end do
         return
      end if
      if (reader%was_given('chain', 'friction') .and. .not. scene%runs_deterministic()) &
         scene%unused = [character(80) :: scene%unused, 'chain%friction']
      if (any([(reader%was_given('process', 'n_points', i), i=1, size(scene%processes))])) &
         scene%unused = [character(80) :: scene%unused, 'process%n_points']
   end subroutine note_unused

end module config_scene
