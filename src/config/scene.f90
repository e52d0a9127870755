!> Reads a scene: the scene file and the --set options become checked groups, or complaints.
module config_scene
   use config_complaints, only: complaint_list, nearest_name
   use config_entries, only: visitor_type
   use config_groups, only: scene_type
   use config_namelist, only: document_type, parse_namelist
   use config_process, only: process_group
   use config_reader, only: reader_type
   use config_rules, only: block_numbers, check_rules
   use config_source, only: new_source, read_source, source_type
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: complaint_list, parse_scene, read_scene, scene_type

   character(*), parameter :: group_names(*) = [character(12) :: 'scene', 'process', 'chain', &
                              'excitation', 'integration', 'campaign', 'accuracy', 'output']

contains

   !> Reads and checks a scene file. The scene is of use when nothing is complained of (complaints%n = 0).
   subroutine read_scene(path, overrides, scene, complaints)
      character(*), intent(in) :: path
      character(*), intent(in) :: overrides(:)   !! `group%name=value`, as --set has them
      type(scene_type), intent(out) :: scene
      type(complaint_list), intent(out) :: complaints
      type(source_type) :: source
      character(:), allocatable :: refusal

      call read_source(path, source, refusal)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
      else
         call parse_scene(source, overrides, scene, complaints)
      end if
   end subroutine read_scene

   !> The same for a text that is already there; source%name is the path in complaints.
   subroutine parse_scene(source, overrides, scene, complaints)
      type(source_type), intent(in) :: source
      character(*), intent(in) :: overrides(:)
      type(scene_type), intent(out) :: scene
      type(complaint_list), intent(out) :: complaints
      type(reader_type) :: reader
      type(block_numbers) :: blocks
      integer :: i

      scene%path = source%name
      scene%text = source%text
      do i = 1, size(overrides)
         scene%text = scene%text//'! --set '//trim(overrides(i))//new_line('a')
      end do
      call parse_namelist(source, overrides, reader%document, reader%complaints)
      call find_groups(reader%document, blocks, reader%complaints)
      call read_groups(reader, blocks, scene)
      call check_rules(scene, blocks, reader)
      complaints = reader%complaints
   end subroutine parse_scene

   !> The number of each group; complains of unknown ones, and of those that are there twice.
   subroutine find_groups(document, blocks, complaints)
      type(document_type), intent(in) :: document
      type(block_numbers), intent(out) :: blocks
      type(complaint_list), intent(inout) :: complaints
      character(12) :: nearest
      integer :: i

      allocate (blocks%processes(0))
      do i = 1, size(document%blocks)
         associate (name => document%blocks(i)%name)
            select case (name)
            case ('scene')
               call take(blocks%heading)
            case ('process')
               blocks%processes = [blocks%processes, i]
            case ('chain')
               call take(blocks%chain)
            case ('excitation')
               call take(blocks%excitation)
            case ('integration')
               call take(blocks%integration)
            case ('campaign')
               call take(blocks%campaign)
            case ('accuracy')
               call take(blocks%accuracy)
            case ('output')
               call take(blocks%output)
            case default
               nearest = nearest_name(name, group_names)
               if (nearest == '') then
                  call complain('unknown group')
               else
                  call complain('unknown group, did you mean &'//trim(nearest)//'?')
               end if
            end select
         end associate
      end do

   contains

      subroutine take(number)
         integer, intent(inout) :: number

         if (number > 0) then
            call complain('the group is there twice, first on line '// &
                          to_text(document%blocks(number)%place%line))
         else
            number = i
         end if
      end subroutine take

      subroutine complain(rule)
         character(*), intent(in) :: rule

         call document%complain(document%blocks(i)%place, '&'//document%blocks(i)%name, rule, complaints)
      end subroutine complain

   end subroutine find_groups

   !> Visits every group's table; an absent group has its defaults then.
   subroutine read_groups(reader, blocks, scene)
      type(reader_type), intent(inout) :: reader
      type(block_numbers), intent(in) :: blocks
      type(scene_type), intent(inout) :: scene
      integer :: i

      call reader%begin_group(blocks%heading)
      call scene%heading%visit(reader)
      call reader%end_group()

      allocate (scene%processes(size(blocks%processes)))
      do i = 1, size(blocks%processes)
         call reader%begin_group(blocks%processes(i))
         call scene%processes(i)%visit(reader)
         call reader%end_group()
      end do

      call reader%begin_group(blocks%chain)
      call scene%chain%visit(reader)
      call reader%end_group()

      call reader%begin_group(blocks%excitation)
      call scene%excitation%visit(reader)
      call reader%end_group()

      call reader%begin_group(blocks%integration)
      call scene%integration%visit(reader)
      call reader%end_group()

      call reader%begin_group(blocks%campaign)
      call scene%campaign%visit(reader)
      call reader%end_group()

      call reader%begin_group(blocks%accuracy)
      call scene%accuracy%visit(reader)
      call reader%end_group()

      call reader%begin_group(blocks%output)
      call scene%output%visit(reader)
      call reader%end_group()

      scene%has_heading = blocks%heading > 0
      scene%has_chain = blocks%chain > 0
      scene%has_excitation = blocks%excitation > 0
      scene%has_integration = blocks%integration > 0
      scene%has_campaign = blocks%campaign > 0
      scene%has_accuracy = blocks%accuracy > 0
      scene%has_output = blocks%output > 0
      scene%unused = reader%unused
   end subroutine read_groups

end module config_scene
