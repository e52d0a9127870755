!> Scenes as text for the tests of this floor, and their complaints.
module scene_texts
   use config_scene, only: complaint_list, parse_scene, scene_type
   use core_source, only: new_source
   implicit none(type, external)
   private
   public :: complaints_on, read_text, with_chain, with_excitation, with_integration, with_output, &
             with_process

   character(*), parameter :: lf = new_line('a')

contains

   !> Complaints, one per line, without excerpts; empty if the scene is accepted.
   function complaints_on(text, overrides) result(lines)
      character(*), intent(in) :: text
      character(*), intent(in), optional :: overrides   !! one a line
      character(:), allocatable :: lines
      type(scene_type) :: scene
      type(complaint_list) :: complaints
      integer :: first, last

      call read_text(text, scene, complaints, overrides)
      lines = ''
      if (complaints%n == 0) return
      first = 1
      do while (first <= len(complaints%text))
         last = index(complaints%text(first:), lf) + first - 2
         if (last < first) last = len(complaints%text)
         if (index(complaints%text(first:last), '   | ') /= 1) &
            lines = lines//complaints%text(first:last)//lf
         first = last + 2
      end do
      lines = lines(:len(lines) - 1)
   end function complaints_on

   !> Reads a scene from a text.
   subroutine read_text(text, scene, complaints, overrides)
      character(*), intent(in) :: text
      type(scene_type), intent(out) :: scene
      type(complaint_list), intent(out) :: complaints
      character(*), intent(in), optional :: overrides   !! one a line

      if (present(overrides)) then
         call parse_scene(new_source('s', text), overrides, scene, complaints)
      else
         call parse_scene(new_source('s', text), '', scene, complaints)
      end if
   end subroutine read_text

   !> Complete scenes around the entries of one group, which are on line 1.
   pure function with_process(entries) result(text)
      character(*), intent(in) :: entries
      character(:), allocatable :: text

      text = '&process '//entries//' /'
   end function with_process

   pure function with_chain(entries) result(text)
      character(*), intent(in) :: entries
      character(:), allocatable :: text

      text = '&chain '//entries
      if (index(entries, 'friction') == 0) text = text//' friction = 0.2'
      text = text//' /'//lf//'&excitation variance = 1.0 /'
   end function with_chain

   pure function with_excitation(entries) result(text)
      character(*), intent(in) :: entries
      character(:), allocatable :: text

      text = '&excitation '//entries//' /'//lf//'&chain friction = 0.2 /'
   end function with_excitation

   pure function with_integration(entries) result(text)
      character(*), intent(in) :: entries
      character(:), allocatable :: text

      text = '&integration '//entries//' /'//lf//with_chain('')
   end function with_integration

   pure function with_output(entries) result(text)
      character(*), intent(in) :: entries
      character(:), allocatable :: text

      text = '&output '//entries//' /'//lf//with_chain('')
   end function with_output

end module scene_texts
