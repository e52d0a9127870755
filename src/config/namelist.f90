!> The namelist form: groups of `name = values`, from a scene file and the --set options.
!>
!> The language's own namelist read stops at the first mistake and cannot say where it is; this one
!> keeps the place of every name and value and goes on.
module config_namelist
   use config_complaints, only: complaint_list, printable
   use config_source, only: new_source, source_type
   use config_tokens, only: lowered, token_colon, token_end, token_end_of_line, token_equals, &
                            token_group, token_left, token_comma, token_open_quote, token_right, &
                            token_type, token_word, tokenize
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: assignment_type, block_type, document_type, parse_namelist

   integer, parameter, public :: max_blocks = 100   !! groups in one scene
   integer, parameter :: shown = 40                 !! characters of a token that a complaint repeats

   !> One `&group ... /`.
   type :: block_type
      character(:), allocatable :: name   !! lower case
      type(token_type) :: place           !! of its &name
   end type block_type

   !> `name = values`, `name(lower:upper) = values`.
   type :: assignment_type
      integer :: block = 0
      character(32) :: name = ''          !! lower case; longer names are cut, and unknown
      type(token_type) :: place           !! of the name
      integer :: lower = 0, upper = 0     !! 0: the whole list
      integer :: first_value = 1, last_value = 0   !! into document%tokens
   end type assignment_type

   type :: document_type
      type(source_type) :: source(2)      !! the scene file; the --set options, one a line
      type(token_type), allocatable :: tokens(:)
      type(block_type), allocatable :: blocks(:)
      type(assignment_type), allocatable :: assignments(:)
      integer :: n_assignments = 0
   contains
      procedure :: text_of
      procedure :: name_text
      procedure :: values_text
      procedure :: complain
      procedure :: refuse
   end type document_type

contains

   !> Parses everything; what is not understood becomes a complaint and is left out.
   subroutine parse_namelist(source, overrides, document, complaints)
      type(source_type), intent(in) :: source
      character(*), intent(in) :: overrides(:)   !! group%name=value, group(number)%name=value
      type(document_type), intent(out) :: document
      type(complaint_list), intent(inout) :: complaints
      type(token_type), allocatable :: tokens(:), set_tokens(:)
      integer :: n

      document%source(1) = source
      document%source(2) = new_source('--set', joined(overrides))
      call tokenize(document%source(1), 1, tokens)
      call tokenize(document%source(2), 2, set_tokens)
      n = size(tokens)
      document%tokens = [tokens, set_tokens]
      allocate (document%blocks(0), document%assignments(64))
      call parse_file(document, n, complaints)
      call parse_overrides(document, n + 1, complaints)
   end subroutine parse_namelist

   !> The token as written.
   pure function text_of(self, token) result(text)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(:), allocatable :: text

      text = self%source(token%source)%text(token%first:token%last)
   end function text_of

   !> The name with its index, as written.
   pure function name_text(self, assignment) result(text)
      class(document_type), intent(in) :: self
      type(assignment_type), intent(in) :: assignment
      character(:), allocatable :: text

      text = self%text_of(assignment%place)
      if (assignment%lower == 0) return
      text = text//'('//to_text(assignment%lower)
      if (assignment%upper > assignment%lower) text = text//':'//to_text(assignment%upper)
      text = text//')'
   end function name_text

   !> The values as written; of several lines only the first.
   pure function values_text(self, assignment) result(text)
      class(document_type), intent(in) :: self
      type(assignment_type), intent(in) :: assignment
      character(:), allocatable :: text
      integer :: last

      text = ''
      if (assignment%last_value < assignment%first_value) return
      associate (first => self%tokens(assignment%first_value))
         last = assignment%last_value
         do while (self%tokens(last)%line > first%line)
            last = last - 1
         end do
         text = self%source(first%source)%text(first%first:self%tokens(last)%last)
      end associate
   end function values_text

   !> A complaint at a token; `what` and `rule` make its text: `what: rule`.
   subroutine complain(self, token, what, rule, complaints)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: what, rule
      type(complaint_list), intent(inout) :: complaints

      associate (source => self%source(token%source))
         call complaints%add(source, token%line, token%first - source%line_start(token%line) + 1, &
                             printable(shortened(what))//': '//rule)
      end associate
   end subroutine complain

   !> A complaint at a value: `group%name = value: rule`.
   subroutine refuse(self, block, token, name, value, rule, complaints)
      class(document_type), intent(in) :: self
      integer, intent(in) :: block
      type(token_type), intent(in) :: token
      character(*), intent(in) :: name, value, rule
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: what

      what = self%blocks(block)%name//'%'//name
      if (len_trim(value) > 0) what = what//' = '//value
      call self%complain(token, what, rule, complaints)
   end subroutine refuse

   subroutine parse_file(document, n, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: n   !! tokens of the file
      type(complaint_list), intent(inout) :: complaints
      integer :: i, last_outside
      logical :: is_open

      is_open = .false.
      last_outside = 0
      i = 1
      do while (i <= n)
         associate (token => document%tokens(i))
            if (token%kind == token_group) then
               if (is_open) call complain_unclosed()
               if (size(document%blocks) == max_blocks) then
                  call document%complain(token, document%text_of(token), &
                                         'more groups than a scene can have', complaints)
                  return
               end if
               call open_block(document, token)
               is_open = .true.
            else if (.not. is_open) then
               if (token%line /= last_outside) call complain_outside(token)
               last_outside = token%line
            else if (token%kind == token_end) then
               is_open = .false.
            else if (begins_assignment(document%tokens(:n), i)) then
               call parse_assignment(document, n, size(document%blocks), i, complaints)
               cycle
            else if (token%kind == token_open_quote) then
               call document%complain(token, document%text_of(token), &
                                      'the quote is not closed on its line', complaints)
            else
               call document%complain(token, document%text_of(token), &
                                      'expected name = value', complaints)
               i = end_of_values(document%tokens(:n), i)
            end if
         end associate
         i = i + 1
      end do
      if (is_open) call complain_unclosed()

   contains

      subroutine complain_unclosed()
         associate (block => document%blocks(size(document%blocks)))
            call document%complain(block%place, '&'//block%name, 'the group is not closed by /', &
                                   complaints)
         end associate
      end subroutine complain_unclosed

      subroutine complain_outside(token)
         type(token_type), intent(in) :: token
         character(:), allocatable :: rule

         rule = 'stands outside of every group'
         if (i > 1) then
            if (document%tokens(i - 1)%kind == token_end .and. document%tokens(i - 1)%line == token%line) &
               rule = rule//' (the / before it ends the group; text with a / needs quotes)'
         end if
         call document%complain(token, document%text_of(token), rule, complaints)
      end subroutine complain_outside

   end subroutine parse_file

   !> name [(lower[:upper])] = values; leaves `i` on the token after them.
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
      if (is_valid) call append_assignment(document, assignment)
   end subroutine parse_assignment

   !> (i) or (i:j); leaves `i` on the closing parenthesis.
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

   !> A number from 1 to 9999.
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

   !> Each option is `group%name=value`; an index on the group picks one of several.
   subroutine parse_overrides(document, first, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: first   !! token of the options
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

   subroutine parse_override(document, first, last, complaints)
      type(document_type), intent(inout) :: document
      integer, intent(in) :: first, last
      type(complaint_list), intent(inout) :: complaints
      type(token_type) :: group
      integer :: i, number, percent
      logical :: is_valid

      i = first
      number = 0
      group = document%tokens(i)
      is_valid = group%kind == token_word .and. last > first
      percent = index(document%text_of(group), '%')
      if (is_valid .and. percent == 0) then
         is_valid = last >= first + 5 .and. document%tokens(i + 1)%kind == token_left
         if (is_valid) call parse_count(document, document%tokens(i + 2), number, is_valid)
         if (is_valid) is_valid = document%tokens(i + 3)%kind == token_right
         i = i + 4
      end if
      if (is_valid) then
         percent = index(document%text_of(document%tokens(i)), '%')
         is_valid = percent > 0 .and. (percent > 1 .neqv. i > first)
         if (i == first) group%last = group%first + percent - 2
         document%tokens(i)%first = document%tokens(i)%first + percent
         if (is_valid) is_valid = begins_assignment(document%tokens(:last), i)
      end if
      if (is_valid) then
         call apply_override(document, group, number, i, last, complaints)
      else
         call document%complain(document%tokens(first), &
                                document%source(2)%line(document%tokens(first)%line), &
                                'must be group%name=value', complaints)
      end if
   end subroutine parse_override

   !> The assignment at token `i` replaces the file's in the group's blocks; a group that is absent is opened.
   subroutine apply_override(document, group, number, i, last, complaints)
      type(document_type), intent(inout) :: document
      type(token_type), intent(in) :: group
      integer, intent(in) :: number     !! which of several groups; 0: all
      integer, intent(in) :: i, last    !! tokens of name = values
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: name
      integer :: block, n_found, position

      name = lowered(document%text_of(group))
      if (.not. any([(document%blocks(block)%name == name, block=1, size(document%blocks))])) &
         call open_block(document, group, name)
      n_found = 0
      do block = 1, size(document%blocks)
         if (document%blocks(block)%name /= name) cycle
         n_found = n_found + 1
         if (number /= 0 .and. number /= n_found) cycle
         position = i
         call parse_assignment(document, last, block, position, complaints)
         call check_rest(position)
      end do
      if (number > n_found) &
         call document%complain(group, document%source(2)%line(group%line), &
                                'the scene has no group of that number', complaints)

   contains

      !> One option sets one value.
      subroutine check_rest(position)
         integer, intent(in) :: position

         if (position <= last) &
            call document%complain(document%tokens(position), &
                                   document%text_of(document%tokens(position)), &
                                   'expected the end of the option', complaints)
      end subroutine check_rest

   end subroutine apply_override

   !> Does a name stand here, with '=' behind it or behind its index?
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
         if (any(tokens(end_of_values + 1)%kind == [token_group, token_end, token_end_of_line])) exit
         if (begins_assignment(tokens, end_of_values + 1)) exit
         end_of_values = end_of_values + 1
      end do
   end function end_of_values

   subroutine open_block(document, place, name)
      type(document_type), intent(inout) :: document
      type(token_type), intent(in) :: place
      character(*), intent(in), optional :: name   !! default: what stands behind the & at the place
      type(block_type) :: block
      character(:), allocatable :: text

      text = document%text_of(place)
      block%place = place
      if (present(name)) then
         block%name = name
      else
         block%name = lowered(text(2:))
      end if
      document%blocks = [document%blocks, block]
   end subroutine open_block

   pure subroutine append_assignment(document, assignment)
      type(document_type), intent(inout) :: document
      type(assignment_type), intent(in) :: assignment
      type(assignment_type), allocatable :: longer(:)

      if (document%n_assignments == size(document%assignments)) then
         allocate (longer(2*size(document%assignments)))
         longer(:document%n_assignments) = document%assignments
         call move_alloc(longer, document%assignments)
      end if
      document%n_assignments = document%n_assignments + 1
      document%assignments(document%n_assignments) = assignment
   end subroutine append_assignment

   pure function shortened(text)
      character(*), intent(in) :: text
      character(:), allocatable :: shortened

      shortened = text
      if (len(text) > 2*shown) shortened = text(:shown)//'...'//text(len(text) - shown + 4:)
   end function shortened

   !> One option a line.
   pure function joined(overrides) result(text)
      character(*), intent(in) :: overrides(:)
      character(:), allocatable :: text
      integer :: i, j

      text = ''
      do i = 1, size(overrides)
         text = text//trim(overrides(i))
         do j = len(text) - len_trim(overrides(i)) + 1, len(text)
            if (text(j:j) == new_line('a')) text(j:j) = ' '
         end do
         text = text//new_line('a')
      end do
   end function joined

end module config_namelist
