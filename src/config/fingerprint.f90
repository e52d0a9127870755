!> Fingerprint of a scene: hash of all values that can change a sample. It identifies shards and
!> results.
module config_fingerprint
   use config_groups, only: group_names, scene_type
   use config_text_value_table, only: lister_type
   use core_random, only: label_of
   use core_text, only: line_feed, to_text
   implicit none(type, external)
   private
   public :: canonical_text, fingerprint

contains

   !> Hash of the canonical text, 16 hexadecimal digits.
   function fingerprint(scene) result(text)
      type(scene_type), intent(in) :: scene
      character(16) :: text

      write (text, '(z16.16)') label_of(canonical_text(scene))
   end function fingerprint

   !> List of the values in use, one line `group%name = value` each, in the order of the tables. It
   !> does not depend on the layout of the scene, and omits values that cannot change a sample, such
   !> as the title, the number of samples and the time limit.
   function canonical_text(scene) result(text)
      type(scene_type), intent(in) :: scene
      character(:), allocatable :: text
      type(lister_type) :: lister
      type(scene_type) :: copy
      integer :: i, j, number

      copy = scene
      text = 'deterministic cases = '//to_text(scene%runs_deterministic())//line_feed// &
             'sampled cases = '//to_text(scene%runs_samples())//line_feed
      do i = 1, size(group_names)
         if (.not. takes_part(group_names(i))) cycle
         do number = 1, merge(size(scene%processes), 1, group_names(i) == 'process')
            lister = lister_type()
            call copy%visit(trim(group_names(i)), number, lister)
            do j = 1, size(lister%rows)
               associate (row => lister%rows(j))
                  if (.not. (row%entry%in_fingerprint .and. row%entry%is_used)) cycle
                  if (row%entry%name == 'friction' .and. .not. scene%runs_deterministic()) cycle
                  text = text//trim(group_names(i))
                  if (number > 1) text = text//'('//to_text(number)//')'
                  text = text//'%'//trim(row%entry%name)//' = '//row%value//line_feed
               end associate
            end do
         end do
      end do
      if (scene%has_structure) &
         text = text//'hash of the structure''s files = '//to_text(scene%structure_label)// &
                line_feed
      if (scene%has_structure .and. scene%runs_deterministic()) then
         do i = 1, scene%structure%n_joints
            text = text//'friction of joint '//to_text(i)//' = '// &
                   to_text(scene%structure%joint_friction(i))//line_feed
         end do
      end if
      if (scene%has_motion() .and. any(scene%excitation%kind == [character(4) :: 'file', 'psd'])) &
         text = text//'hash of the force file = '//to_text(scene%force_label)//line_feed
      if (allocated(scene%values)) &
         text = text//'hash of process%values = '//to_text(scene%values_label)//line_feed

   contains

      !> True if a group can change a sample; without a structure the groups of motion cannot.
      pure logical function takes_part(group)
         character(*), intent(in) :: group

         select case (group)
         case ('scene', 'process')
            takes_part = .true.
         case ('chain')
            takes_part = scene%has_chain
         case ('structure')
            takes_part = scene%has_structure
         case default
            takes_part = scene%has_motion()
         end select
      end function takes_part

   end function canonical_text

end module config_fingerprint
