!> The --set options: `group%name=value`, one value of the scene each.
module config_text_overrides
   use config_text_document, only: document_type
   use config_text_namelist, only: parse_assignment, parse_index
   use config_text_tokens, only: token_index, token_name, token_type, token_word, tokenize
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
   subroutine parse_overrides(document)
      class(document_type), intent(inout) :: document
      integer :: line

      do line = 1, document%source(2)%n_lines()
         if (document%source(2)%line(line) /= '') call parse_override(document, line)
      end do
   end subroutine parse_overrides

   !> Parses `group%name = values`, or `group(number)%name = values` where there are several
   !> groups.
   subroutine parse_override(document, line)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: line
      type(token_type), allocatable :: head(:), tokens(:)   ! before and behind %
      type(token_type) :: place
      character(:), allocatable :: text
      integer :: number, percent, upper
      logical :: is_valid

      text = document%source(2)%line(line)
      percent = index(text, '%')
      associate (source => document%source(2), first => document%source(2)%line_start(line))
         place = token_type(source=2, line=line, first=first, last=first + len(text) - 1)
         call tokenize(source, 2, line, first, first + percent - 2, head)
         call tokenize(source, 2, line, first + percent, place%last, tokens)
      end associate
      number = 0
      is_valid = any(size(head) == [1, 2]) .and. size(tokens) > 0
      if (is_valid) is_valid = head(1)%kind == token_word .and. tokens(1)%kind == token_name
      if (is_valid .and. size(head) == 2) then
         call parse_index(document%text_of(head(2)), number, upper, is_valid)
         is_valid = is_valid .and. upper == number .and. head(2)%kind == token_index
      end if
      if (is_valid) then
         call apply_override(document, head(1), number, tokens)
      else
         call document%complain(place, text, &
                                'must be group%name=value, such as campaign%n_samples=20')
      end if
   end subroutine parse_override

   !> Adds an assignment to every group of that name, or to the one of that number. Opens a group
   !> that is absent.
   subroutine apply_override(document, group, number, tokens)
      class(document_type), intent(inout) :: document
      type(token_type), intent(in) :: group
      integer, intent(in) :: number             !! 0: all
      type(token_type), intent(in) :: tokens(:)   !! of name = values
      character(:), allocatable :: name
      integer :: block, first, last, n_found

      name = lowered(document%text_of(group))
      if (document%find_block(name) == 0) call document%open_block(group)
      first = size(document%tokens) + 1
      document%tokens = [document%tokens, tokens]
      n_found = 0
      last = size(document%tokens)
      do block = 1, size(document%blocks)
         if (document%blocks(block)%name /= name) cycle
         n_found = n_found + 1
         if (all(number /= [0, n_found])) cycle
         last = first
         call parse_assignment(document, block, last)
      end do
      if (number > n_found) then
         call document%complain(group, document%source(2)%line(group%line), &
                                'the scene has no group of that number')
      else if (last < size(document%tokens)) then
         associate (next => document%tokens(last + 1))
            call document%complain(next, document%text_of(next), 'an option sets one value')
         end associate
      end if
   end subroutine apply_override

end module config_text_overrides
