!> Texts made from the tables of the groups: a complete commented scene, and the scene reference.
module config_template
   use config_groups, only: group_docs, group_names, scene_type
   use config_text_value_table, only: entry_type, lister_type, row_type
   use core_kinds, only: wp
   use core_text, only: line_feed
   implicit none(type, external)
   private
   public :: scene_reference, template_text

   integer, parameter :: value_width = 39, line_width = 100   !! [characters]

contains

   !> Complete commented scene: the paper's study for values without default, else the defaults.
   function template_text() result(text)
      character(:), allocatable :: mark, start, text
      type(lister_type) :: lister
      type(scene_type) :: scene
      integer :: i, j

      call set_example_values(scene)
      text = '! A scene of entroslip: groups of name = value.'//line_feed// &
             '! A group that is absent is a part that is not run; a value that is absent has'// &
             line_feed//'! the default shown here, except those marked (required).'//line_feed
      do i = 1, size(group_names)
         lister = lister_type()
         call scene%visit(trim(group_names(i)), 1, lister)
         ! &structure is commented out: a scene has either it or &chain
         mark = trim(merge('! ', '  ', group_names(i) == 'structure'))
         text = text//line_feed//'! '//trim(group_docs(i))//line_feed//mark//'&'// &
                trim(group_names(i))//line_feed
         do j = 1, size(lister%rows)
            associate (row => lister%rows(j))
               start = mark//repeat(' ', 3 - len(mark))
               if (row%entry%is_list .and. row%value == '') start = '   ! '   ! no default
               text = text//with_comment(start//trim(row%entry%name)//' = '//row%value, &
                                         description(row))
            end associate
         end do
         text = text//mark//'/'//line_feed
      end do
   end function template_text

   !> Scene reference in Markdown, one table per group.
   function scene_reference() result(text)
      character(:), allocatable :: text
      type(lister_type) :: lister
      type(scene_type) :: scene
      integer :: i, j

      allocate (scene%processes(1))
      text = ''
      do i = 1, size(group_names)
         lister = lister_type()
         call scene%visit(trim(group_names(i)), 1, lister)
         text = text//'## &'//trim(group_names(i))//line_feed//line_feed// &
                trim(group_docs(i))//'.'//line_feed//line_feed// &
                '| name | type | default | unit | meaning |'//line_feed// &
                '|---|---|---|---|---|'//line_feed
         do j = 1, size(lister%rows)
            text = text//reference_row(lister%rows(j))//line_feed
         end do
         text = text//line_feed
      end do
   end function scene_reference

   !> Sets the values without default to those of the paper.
   subroutine set_example_values(scene)
      type(scene_type), intent(out) :: scene

      scene%heading%title = 'paper'
      allocate (scene%processes(1))
      scene%processes(1)%lengths = [0.3_wp, 1.0_wp, 3.0_wp]
      scene%processes(1)%shared%mean = 0.2_wp
      scene%processes(1)%stds = [0.067_wp, 0.1_wp]
      scene%chain%friction = [0.2_wp]
      scene%excitation%variance = [3.7_wp, 41.1_wp]
   end subroutine set_example_values

   !> Unit, meaning, default and rule of a value, in one line.
   function description(row) result(text)
      type(row_type), intent(in) :: row
      character(:), allocatable :: text

      associate (entry => row%entry)
         text = meaning_of(entry)
         if (entry%unit /= '') text = '['//trim(entry%unit)//'] '//text
         if (entry%default /= '') text = text//'; default '//trim(entry%default)
         if (entry%is_required) text = text//' (required)'
      end associate
   end function description

   !> Meaning, choices and rule of a value.
   pure function meaning_of(entry) result(text)
      type(entry_type), intent(in) :: entry
      character(:), allocatable :: text

      text = trim(entry%doc)
      if (entry%choices /= '') text = text//'; '//entry%choices_text()
      if (len(entry%rule%text()) > 0) text = text//'; '//entry%rule%text()
   end function meaning_of

   !> Line of a value and its comment; a long comment continues on the next lines.
   function with_comment(value, comment) result(text)
      character(*), intent(in) :: value, comment
      character(:), allocatable :: text, rest
      integer :: last

      text = value//repeat(' ', max(1, value_width - len(value)))
      rest = comment
      do
         last = len(rest)
         if (last > line_width - value_width - 2) &
            last = index(rest(:line_width - value_width - 2), ' ', back=.true.)
         text = text//'! '//trim(rest(:last))//line_feed
         if (last == len(rest)) exit
         rest = rest(last + 1:)
         text = text//repeat(' ', value_width)
      end do
   end function with_comment

   !> Row of the scene reference.
   function reference_row(row) result(text)
      type(row_type), intent(in) :: row
      character(:), allocatable :: text, default

      associate (entry => row%entry)
         default = '`'//row%value//'`'
         if (row%value == '') default = 'none'
         if (entry%default /= '') default = trim(entry%default)
         if (entry%is_required) default = '**must be given**'
         text = '| `'//trim(entry%name)//'` | '//trim(entry%kind)// &
                trim(merge(' list', '     ', entry%is_list))//' | '//default//' | '// &
                trim(entry%unit)//' | '//meaning_of(entry)//' |'
      end associate
   end function reference_row

end module config_template
