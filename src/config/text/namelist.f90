!> Parses a scene in namelist form, groups of `name = values`, and the --set options,
!> `group%name=value`. Keeps the place of each name and value for complaints.
!>
!> Fortran's own namelist read stops at the first mistake and does not say where it is; this parser
!> continues and reports all mistakes. config_text_reader converts the values.
module config_text_namelist
   use config_text_tokens, only: token_end, token_group, token_index, token_name, &
                                 token_open_quote, token_type, token_word, tokenize
   use config_text_value_table, only: visitor_type
   use core_complaints, only: blank_hint, complaint_list, printable
   use core_kinds, only: long
   use core_source, only: new_source, source_type
   use core_text, only: lowered, parse_integer
   implicit none(type, external)
   private
   public :: assignment_type, document_type

   integer, parameter :: max_groups = 100   !! largest number of groups in a scene
   integer, parameter :: shown = 40   !! characters shown of either end of a long value

   !> One `&group ... /`.
   type :: group_type
      character(32) :: name = ''          !! name in lower case, cut at 32 characters
      type(token_type) :: place           !! &name
      logical :: is_misread = .false.    !! true if a name, an index or an '=' in it is wrong
   end type group_type

   !> One `name = values` or `name(lower:upper) = values`.
   type :: assignment_type
      integer :: group = 0                !! index into document%groups
      character(32) :: name = ''          !! name in lower case, cut at 32 characters
      type(token_type) :: place           !! the name with its index
      integer :: lower = 0, upper = 0     !! the index; 0: the whole list
      integer :: first_value = 1, last_value = 0   !! range of its values in document%tokens
      logical :: is_known = .false.       !! true if its group has an entry of this name
      logical :: is_refused = .false.     !! true if it was complained of
   end type assignment_type

   !> The scene file and the options as tokens, groups and assignments.
   type, abstract, extends(visitor_type) :: document_type
      type(source_type) :: source(2)      !! the scene file; the --set options, one per line
      type(token_type), allocatable :: tokens(:)
      type(group_type), allocatable :: groups(:)             !! groups in the order of the file
      type(assignment_type), allocatable :: assignments(:)   !! the first n_assignments are used
      integer :: n_assignments = 0
      type(complaint_list) :: complaints
   contains
      procedure :: parse
      procedure :: find_group
      procedure :: text_of
      procedure :: rule_on
      procedure :: complain
      procedure :: refuse
      procedure :: refuse_assignment
      procedure, private :: add_group, values_text
   end type document_type

contains

   !> Parses the text of a scene, then the options, whose assignments override those of the file.
   !> Complains of text that it cannot parse and leaves it out.
   subroutine parse(self, source, overrides)
      class(document_type), intent(inout) :: self
      type(source_type), intent(in) :: source
      character(*), intent(in) :: overrides   !! --set options, `group%name=value`, one a line
      integer :: line

      self%source(1) = source
      self%source(2) = new_source('--set', overrides)
      allocate (self%groups(0), self%assignments(0))
      call tokenize(source, 1, 1, 1, len(source%text), self%tokens)
      call parse_groups(self)
      do line = 1, self%source(2)%n_lines()
         if (self%source(2)%line(line) /= '') call parse_override(self, line)
      end do
   end subroutine parse

   !> Parses the tokens of the scene file.
   subroutine parse_groups(document)
      class(document_type), intent(inout) :: document
      type(token_type) :: group, token
      character(:), allocatable :: rule
      integer :: i
      logical :: is_open, is_reported   ! is_reported: words outside of groups

      is_open = .false.
      is_reported = .false.
      i = 1
      do while (i <= size(document%tokens))
         token = document%tokens(i)
         if (token%kind == token_group) then
            call complain_if_open()
            if (size(document%groups) == max_groups) then
               call document%complain(token, 'more groups than a scene can have')
               return
            end if
            call document%add_group(token)
            group = token
            is_open = .true.
            is_reported = .false.
         else if (.not. is_open) then
            rule = document%rule_on(token, 'stands outside of every group')
            associate (before => document%tokens(max(i - 1, 1)))
               if (before%kind == token_end .and. before%last == token%first - 1) &
                  rule = rule//' (the / before it ends one; text with a / needs quotes)'
            end associate
            if (.not. is_reported) call document%complain(token, rule)
            is_reported = .true.
         else if (token%kind == token_end) then
            is_open = .false.
         else if (token%kind == token_name) then
            call parse_assignment(document, size(document%groups), i)
         else
            call document%complain(token, document%rule_on(token, 'expected name = value'))
            document%groups(size(document%groups))%is_misread = .true.
            i = end_of_values(document%tokens, i)
         end if
         i = i + 1
      end do
      call complain_if_open()

   contains

      !> Complains of a group that token i does not close; not if an open quote took its end along.
      subroutine complain_if_open()
         if (.not. is_open) return
         if (document%tokens(i - 1)%kind /= token_open_quote) &
            call document%complain(group, 'the group is not closed by /')
      end subroutine complain_if_open

   end subroutine parse_groups

   !> Parses `name [(lower[:upper])] = values` of a group; sets `i` to the last token of the values.
   subroutine parse_assignment(document, group, i)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: group    !! index into document%groups
      integer, intent(inout) :: i     !! token of the name
      type(assignment_type) :: given
      logical :: is_valid

      given%group = group
      given%place = document%tokens(i)
      given%name = lowered(document%text_of(given%place))
      i = i + 1
      is_valid = .true.
      associate (token => document%tokens(i))
         if (token%kind == token_index) then
            i = i + 1
            call parse_index(document%text_of(token), given%lower, given%upper, is_valid)
            if (.not. is_valid) then
               call document%refuse(group, token, document%text_of(given%place), '', &
                                    'an index is (i) or (i:j), counted from 1')
               document%groups(group)%is_misread = .true.
            end if
            given%place%last = token%last
         end if
      end associate
      given%first_value = i + 1
      i = end_of_values(document%tokens, i)
      given%last_value = i
      if (.not. is_valid) return
      associate (n => document%n_assignments)
         if (n == size(document%assignments)) &
            document%assignments = [document%assignments, document%assignments, given]
         n = n + 1
         document%assignments(n) = given
      end associate
   end subroutine parse_assignment

   !> Parses (i) or (i:j), integers from 1 to 9999.
   pure subroutine parse_index(text, lower, upper, is_valid)
      character(*), intent(in) :: text   !! text with its parentheses
      integer, intent(out) :: lower, upper
      logical, intent(out) :: is_valid
      integer(long), parameter :: largest = 9999
      character(:), allocatable :: rule
      integer(long) :: bounds(2)
      integer :: colon

      colon = index(text, ':')
      if (colon == 0) colon = len(text)
      call parse_integer(trim(adjustl(text(2:colon - 1))), largest, bounds(1), rule)
      bounds(2) = bounds(1)
      if (colon < len(text) .and. .not. allocated(rule)) &
         call parse_integer(trim(adjustl(text(colon + 1:len(text) - 1))), largest, bounds(2), rule)
      lower = int(bounds(1))
      upper = int(bounds(2))
      is_valid = lower > 0 .and. upper >= lower .and. .not. allocated(rule)
   end subroutine parse_index

   !> Last token of the values that begin after token `i`: the one before the next name, group or
   !> end.
   pure integer function end_of_values(tokens, i)
      type(token_type), intent(in) :: tokens(:)
      integer, intent(in) :: i

      do end_of_values = i, size(tokens) - 1
         if (any(tokens(end_of_values + 1)%kind == [token_name, token_group, token_end])) return
      end do
   end function end_of_values

   !> Parses the option `group%name = values` into an assignment to every group of that name, or
   !> `group(number)%name = values` to the one with that number. Adds the group if there is none.
   subroutine parse_override(document, line)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: line
      type(token_type), allocatable :: head(:), tokens(:)   ! before and after %
      type(token_type) :: place
      character(:), allocatable :: name, text
      integer :: first, group, last, n_found, number, percent, upper
      logical :: is_valid

      text = document%source(2)%line(line)
      percent = index(text, '%')
      associate (source => document%source(2), start => document%source(2)%line_start(line))
         place = token_type(source=2, line=line, first=start, last=start + len(text) - 1)
         call tokenize(source, 2, line, start, start + percent - 2, head)
         call tokenize(source, 2, line, start + percent, place%last, tokens)
      end associate
      number = 0   ! every group of that name
      is_valid = any(size(head) == [1, 2]) .and. size(tokens) > 0
      if (is_valid) is_valid = head(1)%kind == token_word .and. tokens(1)%kind == token_name
      if (is_valid .and. size(head) == 2) then
         call parse_index(document%text_of(head(2)), number, upper, is_valid)
         is_valid = is_valid .and. upper == number .and. head(2)%kind == token_index
      end if
      if (.not. is_valid) then
         call document%complain(place, 'must be group%name=value, such as campaign%n_samples=20')
         return
      end if
      name = lowered(document%text_of(head(1)))
      if (document%find_group(name) == 0) call document%add_group(head(1))
      first = size(document%tokens) + 1
      document%tokens = [document%tokens, tokens]
      n_found = 0
      last = size(document%tokens)
      do group = 1, size(document%groups)
         if (document%groups(group)%name /= name) cycle
         n_found = n_found + 1
         if (all(number /= [0, n_found])) cycle
         last = first
         call parse_assignment(document, group, last)
      end do
      if (number > n_found) then
         call document%complain(head(1), 'the scene has no group of that number', text)
      else if (last < size(document%tokens)) then
         call document%complain(document%tokens(last + 1), 'an option sets one value')
      end if
   end subroutine parse_override

   !> Adds a group whose name is at a token.
   subroutine add_group(self, place)
      class(document_type), intent(inout) :: self
      type(token_type), intent(in) :: place
      character(:), allocatable :: name

      name = lowered(self%text_of(place))
      if (place%kind == token_group) name = name(2:)
      self%groups = [self%groups, group_type(name, place)]
   end subroutine add_group

   !> Index of the first group of a name, or of the number-th one; 0 if there is none.
   pure integer function find_group(self, name, number) result(group)
      class(document_type), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), optional :: number
      integer :: i

      group = 0
      associate (places => pack([(i, i=1, size(self%groups))], self%groups%name == name))
         i = 1
         if (present(number)) i = number
         if (i <= size(places)) group = places(i)
      end associate
   end function find_group

   !> Text of a token.
   pure function text_of(self, token) result(text)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(:), allocatable :: text

      text = self%source(token%source)%text(token%first:token%last)
   end function text_of

   !> Text of an assignment's values, of the first line only.
   pure function values_text(self, given) result(text)
      class(document_type), intent(in) :: self
      type(assignment_type), intent(in) :: given
      character(:), allocatable :: text
      integer :: last

      text = ''
      if (given%last_value < given%first_value) return
      associate (tokens => self%tokens(given%first_value:given%last_value))
         last = count(tokens%line == tokens(1)%line)
         text = self%source(tokens(1)%source)%text(tokens(1)%start:tokens(last)%last)
      end associate
   end function values_text

   !> Rule that an unexpected token breaks: an open quote, a comment after # as in other languages,
   !> else `otherwise`.
   pure function rule_on(self, token, otherwise) result(rule)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: otherwise
      character(:), allocatable :: rule

      rule = otherwise
      if (token%kind == token_open_quote) rule = 'the quote is not closed on its line'
      if (index(self%text_of(token), '#') == 1) rule = 'a comment begins with !'
   end function rule_on

   !> Adds a complaint at a token, `file:line: subject: rule`.
   subroutine complain(self, token, rule, subject)
      class(document_type), intent(inout) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: rule
      character(*), intent(in), optional :: subject   !! default: text of the token
      character(:), allocatable :: text

      text = self%text_of(token)
      if (present(subject)) text = subject
      if (len(text) > 2*shown) text = text(:shown)//'...'//text(len(text) - shown + 4:)
      associate (source => self%source(token%source))
         call self%complaints%add(source, token%line, &
                                  token%first - source%line_start(token%line) + 1, &
                                  printable(text)//': '//rule//blank_hint(self%text_of(token)))
      end associate
   end subroutine complain

   !> Adds a complaint at a value, `file:line: group%name = value: rule`.
   subroutine refuse(self, group, token, name, value, rule)
      class(document_type), intent(inout) :: self
      integer, intent(in) :: group
      type(token_type), intent(in) :: token
      character(*), intent(in) :: name, value, rule
      character(:), allocatable :: subject

      subject = trim(self%groups(group)%name)//'%'//name
      if (len_trim(value) > 0) subject = subject//' = '//value
      call self%complain(token, rule, subject)
   end subroutine refuse

   !> Complains of the i-th assignment, with all its values, if it breaks a rule.
   subroutine refuse_assignment(self, i, rule)
      class(document_type), intent(inout) :: self
      integer, intent(in) :: i
      character(*), intent(in), optional :: rule   !! absent: none is broken

      if (.not. present(rule)) return
      associate (given => self%assignments(i))
         given%is_refused = .true.
         call self%refuse(given%group, given%place, self%text_of(given%place), &
                          self%values_text(given), rule)
      end associate
   end subroutine refuse_assignment

end module config_text_namelist
