!> The namelist form: groups of `name = values`.
!>
!> The language's own namelist read stops at the first mistake and cannot say where it is; this one
!> keeps the place of every name and value, and goes on behind a mistake.
module config_text_namelist
   use config_text_document, only: assignment_type, document_type
   use config_text_tokens, only: comment_rule, token_colon, token_comma, token_end, &
      token_end_of_line, token_equals, token_group, token_left, token_open_quote, token_right, &
      token_type, token_word
   use core_complaints, only: complaint_list
   use core_text, only: lowered
   implicit none(type, external)
   private
   public :: begins_assignment, parse_assignment, parse_count, parse_groups

   integer, parameter :: max_blocks = 100   !! groups in one scene

contains

   !> Parses the tokens of the scene file; what is not understood is complained of and left out.
   subroutine parse_groups(document, n, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: n   !! tokens of the file, the first ones of the document
      type(complaint_list), intent(inout) :: complaints
      integer :: i, last_outside
      logical :: is_open

      is_open = .false.
      last_outside = 0
      i = 1
      do while (i <= n)
         associate (token => document%tokens(i))
            if (token%kind == token_group) then
               if (is_open) call complain_unclosed(document, complaints)
               if (size(document%blocks) == max_blocks) then
                  call document%complain(token, document%text_of(token), &
                                         'more groups than a scene can have', complaints)
                  return
               end if
               call document%open_block(document%source(token%source)%text( &
                                        token%first + 1:token%last), token)
               is_open = .true.
            else if (.not. is_open) then
               if (token%line /= last_outside) call complain_outside(document, i, complaints)
               last_outside = token%line
            else if (token%kind == token_end) then
               is_open = .false.
            else if (begins_assignment(document%tokens(:n), i)) then
               call parse_assignment(document, n, size(document%blocks), i, complaints)
               cycle
            else
               call document%complain(token, document%text_of(token), &
                                      not_an_assignment(document, token), complaints)
               i = end_of_values(document%tokens(:n), i)
            end if
         end associate
         i = i + 1
      end do
      if (is_open) call complain_unclosed(document, complaints)
   end subroutine parse_groups

   pure function not_an_assignment(document, token) result(rule)
      type(document_type), intent(in) :: document
      type(token_type), intent(in) :: token
      character(:), allocatable :: rule

      rule = 'expected name = value'
      if (index(document%text_of(token), '#') == 1) rule = comment_rule
      if (token%kind == token_open_quote) rule = 'the quote is not closed on its line'
   end function not_an_assignment

   subroutine complain_unclosed(document, complaints)
      type(document_type), intent(in) :: document
      type(complaint_list), intent(inout) :: complaints

      associate (block => document%blocks(size(document%blocks)))
         call document%complain(block%place, '&'//block%name, 'the group is not closed by /', &
                                complaints)
      end associate
   end subroutine complain_unclosed

   !> Complains of token i, which belongs to no group. Often a path or a quotient without quotes
   !> stands before it.
   subroutine complain_outside(document, i, complaints)
      type(document_type), intent(in) :: document
      integer, intent(in) :: i
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: rule

      associate (token => document%tokens(i), before => document%tokens(max(i - 1, 1)))
         rule = 'stands outside of every group'
         if (index(document%text_of(token), '#') == 1) rule = comment_rule
         if (before%kind == token_end .and. before%last == token%first - 1) &
            rule = rule//' (the / before it ends one; text with a / needs quotes)'
         call document%complain(token, document%text_of(token), rule, complaints)
      end associate
   end subroutine complain_outside

   !> Parses `name [(lower[:upper])] = values`; leaves `i` on the token after them.
   subroutine parse_assignment(document, n, block, i, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: n        !! the last token that may belong to it
      integer, intent(in) :: block
      integer, intent(inout) :: i     !! on the name
      type(complaint_list), intent(inout) :: complaints
      type(assignment_type) :: assignment
      logical :: is_valid

      assignment%block = block
      assignment%place = document%tokens(i)
      assignment%name = lowered(document%text_of(assignment%place))
      i = i + 1
      is_valid = .true.
      if (document%tokens(i)%kind == token_left) call parse_index(document, i, assignment, is_valid)
      if (.not. is_valid) &
         call document%complain(document%tokens(i), document%text_of(assignment%place), &
                                'an index is (i) or (i:j), counted from 1', complaints)
      do while (document%tokens(i)%kind /= token_equals)
         i = i + 1
      end do
      assignment%first_value = i + 1
      assignment%last_value = end_of_values(document%tokens(:n), i)
      i = assignment%last_value + 1
      if (is_valid) call document%append(assignment)
   end subroutine parse_assignment

   !> Parses (i) or (i:j); leaves `i` on the closing parenthesis, or on what is wrong.
   pure subroutine parse_index(document, i, assignment, is_valid)
      type(document_type), intent(in) :: document
      integer, intent(inout) :: i   !! on the opening parenthesis
      type(assignment_type), intent(inout) :: assignment
      logical, intent(out) :: is_valid

      call parse_count(document, document%tokens(i + 1), assignment%lower, is_valid)
      assignment%upper = assignment%lower
      if (.not. is_valid) return
      i = i + 2
      if (document%tokens(i)%kind == token_colon) then
         call parse_count(document, document%tokens(i + 1), assignment%upper, is_valid)
         if (.not. is_valid) return
         i = i + 2
      end if
      is_valid = document%tokens(i)%kind == token_right .and. assignment%upper >= assignment%lower
   end subroutine parse_index

   !> Parses a whole number from 1 to 9999.
   pure subroutine parse_count(document, token, count, is_valid)
      type(document_type), intent(in) :: document
      type(token_type), intent(in) :: token
      integer, intent(out) :: count
      logical, intent(out) :: is_valid
      character(:), allocatable :: text

      count = 0
      text = document%text_of(token)
      is_valid = token%kind == token_word .and. len(text) >= 1 .and. len(text) <= 4
      if (is_valid) is_valid = verify(text, '0123456789') == 0
      if (.not. is_valid) return
      read (text, '(i4)') count
      is_valid = count > 0
   end subroutine parse_count

   !> True if a name stands here, with '=' behind it or behind its index.
   pure logical function begins_assignment(tokens, i)
      type(token_type), intent(in) :: tokens(:)
      integer, intent(in) :: i
      integer :: j

      begins_assignment = .false.
      if (tokens(i)%kind /= token_word .or. i == size(tokens)) return
      j = i + 1
      if (tokens(j)%kind == token_left) then
         do while (j < size(tokens))
            j = j + 1
            if (tokens(j)%kind == token_right) exit
            if (all(tokens(j)%kind /= [token_word, token_colon, token_comma])) return
         end do
         j = j + 1
         if (j > size(tokens)) return
      end if
      begins_assignment = tokens(j)%kind == token_equals
   end function begins_assignment

   !> The last token of the values that begin after token `i`: up to the next name, group or end.
   pure integer function end_of_values(tokens, i)
      type(token_type), intent(in) :: tokens(:)
      integer, intent(in) :: i

      end_of_values = i
      do while (end_of_values < size(tokens))
         associate (next => tokens(end_of_values + 1))
            if (any(next%kind == [token_group, token_end, token_end_of_line])) exit
         end associate
         if (begins_assignment(tokens, end_of_values + 1)) exit
         end_of_values = end_of_values + 1
      end do
   end function end_of_values

end module config_text_namelist
