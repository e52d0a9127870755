!> The --set options: `group%name=value`, one value of the scene each.
module config_text_overrides
   use config_text_document, only: document_type
   use config_text_namelist, only: begins_assignment, parse_assignment, parse_count
   use config_text_tokens, only: token_end_of_line, token_left, token_right, token_type, token_word
   use core_complaints, only: complaint_list
   use core_text, only: lowered
   implicit none(type, external)
   private
   public :: override_text, parse_overrides

contains

   !> The options as a text, one a line.
   pure function override_text(overrides) result(text)
      character(*), intent(in) :: overrides(:)
      character(:), allocatable :: text
      integer :: i, j

      text = ''
      do i = 1, size(overrides)
         do j = 1, len_trim(overrides(i))
            text = text//merge(' ', overrides(i) (j:j), overrides(i) (j:j) == new_line('a'))
         end do
         text = text//new_line('a')
      end do
   end function override_text

   !> Adds the options' assignments behind the file's, where they take their place.
   subroutine parse_overrides(document, first, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: first   !! token of the options; each option ends with its line
      type(complaint_list), intent(inout) :: complaints
      integer :: i, last

      i = first
      do while (i <= size(document%tokens))
         last = i
         do while (document%tokens(last)%kind /= token_end_of_line)
            last = last + 1
         end do
         if (last > i) call parse_override(document, i, last - 1, complaints)
         i = last + 1
      end do
   end subroutine parse_overrides

   !> Parses `group%name = values`, or `group(number)%name = values` where there are several
   !> groups.
   subroutine parse_override(document, first, last, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: first, last   !! tokens
      type(complaint_list), intent(inout) :: complaints
      type(token_type) :: group
      integer :: i, number, percent
      logical :: is_valid

      i = first
      number = 0
      group = document%tokens(i)
      is_valid = group%kind == token_word .and. last > first
      if (is_valid .and. index(document%text_of(group), '%') == 0) then
         is_valid = last >= first + 5 .and. document%tokens(i + 1)%kind == token_left
         if (is_valid) call parse_count(document, document%tokens(i + 2), number, is_valid)
         if (is_valid) is_valid = document%tokens(i + 3)%kind == token_right
         if (is_valid) i = i + 4
      end if
      if (is_valid) then
         percent = index(document%text_of(document%tokens(i)), '%')
         is_valid = percent > 0 .and. (percent > 1 .neqv. i > first)
      end if
      if (is_valid) then
         if (i == first) group%last = group%first + percent - 2
         document%tokens(i)%first = document%tokens(i)%first + percent
         is_valid = begins_assignment(document%tokens(:last), i)
      end if
      if (is_valid) then
         call apply_override(document, group, number, i, last, complaints)
      else
         call document%complain(group, document%source(2)%line(group%line), &
                                'must be group%name=value, such as campaign%n_samples=20', &
                                complaints)
      end if
   end subroutine parse_override

   !> Adds an assignment to every group of that name, or to the one of that number. Opens a group
   !> that is absent.
   subroutine apply_override(document, group, number, i, last, complaints)
      type(document_type), intent(inout) :: document
      type(token_type), intent(in) :: group
      integer, intent(in) :: number     !! 0: all
      integer, intent(in) :: i, last    !! tokens of name = values
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: name
      integer :: block, n_found, next

      name = lowered(document%text_of(group))
      if (.not. any([(document%blocks(block)%name == name, block=1, size(document%blocks))])) &
         call document%open_block(name, group)
      n_found = 0
      next = i
      do block = 1, size(document%blocks)
         if (document%blocks(block)%name /= name) cycle
         n_found = n_found + 1
         if (number /= 0 .and. number /= n_found) cycle
         next = i
         call parse_assignment(document, last, block, next, complaints)
      end do
      if (number > n_found) then
         call document%complain(group, document%source(2)%line(group%line), &
                                'the scene has no group of that number', complaints)
      else if (next <= last) then
         call document%complain(document%tokens(next), document%text_of(document%tokens(next)), &
                                'an option sets one value', complaints)
      end if
   end subroutine apply_override

end module config_text_overrides
