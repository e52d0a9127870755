!> The namelist form: groups of `name = values`, and the --set options, `group%name=value`.
!>
!> The language's own namelist read stops at the first mistake and cannot say where it is; this one
!> keeps the place of every name and value, and goes on behind a mistake.
module config_text_namelist
   use config_text_document, only: assignment_type, document_type
   use config_text_tokens, only: token_end, token_group, token_index, token_name, token_type, &
                                 token_word, tokenize
   use core_kinds, only: long
   use core_text, only: lowered, parse_integer
   implicit none(type, external)
   private
   public :: override_text, parse_groups, parse_overrides

   integer, parameter :: max_blocks = 100   !! groups in one scene

contains

   !> Parses the tokens of the scene file; what is not understood is complained of and left out.
   subroutine parse_groups(document)
      class(document_type), intent(inout) :: document
      type(token_type) :: token
      integer :: i, last_outside
      logical :: is_open

      is_open = .false.
      last_outside = 0
      i = 1
      do while (i <= size(document%tokens))
         token = document%tokens(i)
         if (token%kind == token_group) then
            if (is_open) call complain_unclosed(document)
            if (size(document%blocks) == max_blocks) then
               call document%complain(token, document%text_of(token), &
                                      'more groups than a scene can have')
               return
            end if
            call document%open_block(token)
            is_open = .true.
         else if (.not. is_open) then
            if (token%line /= last_outside) call complain_outside(document, i)
            last_outside = token%line
         else if (token%kind == token_end) then
            is_open = .false.
         else if (token%kind == token_name) then
            call parse_assignment(document, size(document%blocks), i)
         else
            call document%complain(token, document%text_of(token), &
                                   document%rule_on(token, 'expected name = value'))
            i = end_of_values(document%tokens, i)
         end if
         i = i + 1
      end do
      if (is_open) call complain_unclosed(document)
   end subroutine parse_groups

   subroutine complain_unclosed(document)
      class(document_type), intent(inout) :: document

      associate (block => document%blocks(size(document%blocks)))
         call document%complain(block%place, '&'//trim(block%name), &
                                'the group is not closed by /')
      end associate
   end subroutine complain_unclosed

   !> Complains of token i, which belongs to no group. Often a path or a quotient without quotes
   !> stands before it.
   subroutine complain_outside(document, i)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: i
      character(:), allocatable :: rule

      associate (token => document%tokens(i), before => document%tokens(max(i - 1, 1)))
         rule = document%rule_on(token, 'stands outside of every group')
         if (before%kind == token_end .and. before%last == token%first - 1) &
            rule = rule//' (the / before it ends one; text with a / needs quotes)'
         call document%complain(token, document%text_of(token), rule)
      end associate
   end subroutine complain_outside

   !> Parses `name [(lower[:upper])] = values` of a group; leaves `i` on the last of the values.
   subroutine parse_assignment(document, block, i)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: block
      integer, intent(inout) :: i     !! on the name
      type(assignment_type) :: given
      logical :: is_valid

      given%block = block
      given%place = document%tokens(i)
      given%name = lowered(document%text_of(given%place))
      i = i + 1
      is_valid = .true.
      associate (token => document%tokens(i))
         if (token%kind == token_index) then
            i = i + 1
            call parse_index(document%text_of(token), given%lower, given%upper, is_valid)
            if (.not. is_valid) call document%complain(token, document%text_of(given%place), &
                                                'an index is (i) or (i:j), counted from 1')
            given%place%last = token%last
         end if
      end associate
      given%first_value = i + 1
      i = end_of_values(document%tokens, i)
      given%last_value = i
      if (is_valid) call document%append(given)
   end subroutine parse_assignment

   !> Parses (i) or (i:j), whole numbers from 1 to 9999.
   pure subroutine parse_index(text, lower, upper, is_valid)
      character(*), intent(in) :: text   !! with its parentheses
      integer, intent(out) :: lower, upper
      logical, intent(out) :: is_valid
      integer :: colon

      colon = index(text, ':')
      if (colon == 0) colon = len(text)
      lower = count_in(text(2:colon - 1))
      upper = lower
      if (colon < len(text)) upper = count_in(text(colon + 1:len(text) - 1))
      is_valid = lower > 0 .and. upper >= lower

   contains

      !> The number; 0 where there is none.
      pure integer function count_in(word)
         character(*), intent(in) :: word
         integer(long), parameter :: largest = 9999
         integer(long) :: value
         character(:), allocatable :: rule

         call parse_integer(trim(adjustl(word)), largest, value, rule)
         count_in = merge(0, int(value), allocated(rule))
      end function count_in

   end subroutine parse_index

   !> The last token of the values that begin behind token `i`: up to the next name, group or end.
   pure integer function end_of_values(tokens, i)
      type(token_type), intent(in) :: tokens(:)
      integer, intent(in) :: i

      do end_of_values = i, size(tokens) - 1
         if (any(tokens(end_of_values + 1)%kind == [token_name, token_group, token_end])) return
      end do
   end function end_of_values

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

end module config_text_namelist
