!> Fills a group from what the scene file and the --set options give, and complains of what they
!> should not. Nothing is guessed: what is not exactly a value of the wanted type is refused, with
!> the rule that it breaks.
module config_text_reader
   use config_text_namelist, only: assignment_type, document_type
   use config_text_tokens, only: token_comma, token_quoted, token_type, token_word
   use config_text_value_table, only: choice_length, entry_type, name_length, word_type
   use core_kinds, only: long, wp
   use core_table, only: words_of
   use core_text, only: lowered, nearest_name, parse_integer, parse_real, suggestion, to_text
   implicit none(type, external)
   private
   public :: reader_type

   integer, parameter :: max_length = 1000   !! values of a list

   !> Visits the groups of a scene and fills them from its document.
   type, extends(document_type) :: reader_type
      character(2*name_length), allocatable :: unused(:)   !! group%name: given, of no effect
      integer, private :: block = 0      !! the group being read; 0: absent, all is default
      integer, private :: last_slot = 0  !! the token that was refused last
      character(name_length), allocatable, private :: known(:)   !! the group's names so far
      character(name_length), allocatable, private :: missing(:) !! of them, must be and are not
   contains
      procedure :: begin_group
      procedure :: end_group
      procedure :: was_given
      procedure :: longest_list
      procedure :: require
      procedure :: visit_words
   end type reader_type

contains

   !> Prepares the reader to visit a group's values.
   subroutine begin_group(self, group, number)
      class(reader_type), intent(inout) :: self
      character(*), intent(in) :: group
      integer, intent(in) :: number   !! which of several groups of that name

      self%block = self%find_block(group, number)
      self%known = [character(name_length) ::]
      self%missing = self%known
      if (.not. allocated(self%unused)) allocate (self%unused(0))
   end subroutine begin_group

   !> Complains of every name in the group that was given but not visited: the group does not know
   !> it. Else complains of names that must be given and are not: one of them may be misspelt.
   subroutine end_group(self)
      class(reader_type), intent(inout) :: self
      integer :: i

      do i = 1, self%n_assignments
         if (self%assignments(i)%block /= self%block .or. self%assignments(i)%is_known) cycle
         self%blocks(self%block)%has_unknown = .true.
         call self%refuse_assignment(i, 'unknown name'// &
                                     suggestion(trim(self%assignments(i)%name), self%known))
      end do
      do i = 1, size(self%missing)
         associate (block => self%blocks(self%block))
            if (.not. block%has_unknown) call self%refuse(self%block, block%place, &
                                                          trim(self%missing(i)), '', &
                                                          'must be given')
         end associate
      end do
   end subroutine end_group

   !> Number of the last assignment to a name in its group; 0: it is not given.
   pure integer function last_given(self, block, name) result(i)
      class(reader_type), intent(in) :: self
      integer, intent(in) :: block
      character(*), intent(in) :: name

      do i = self%n_assignments, 1, -1
         associate (given => self%assignments(i))
            if (given%block == block .and. given%name == name) return
         end associate
      end do
   end function last_given

   pure logical function was_given(self, group, name, number)
      class(reader_type), intent(in) :: self
      character(*), intent(in) :: group, name
      integer, intent(in), optional :: number   !! which of several groups, default 1

      was_given = last_given(self, self%find_block(group, number), name) > 0
   end function was_given

   !> Number of values of the longest list that a group gives without an index.
   pure integer function longest_list(self, group) result(longest)
      class(reader_type), intent(in) :: self
      character(*), intent(in) :: group
      integer :: block, i

      longest = 0
      block = self%find_block(group)
      do i = 1, self%n_assignments
         associate (given => self%assignments(i))
            if (given%block /= block .or. given%lower > 0) cycle
            associate (tokens => self%tokens(given%first_value:given%last_value))
               longest = max(longest, sum(tokens%repeat, mask=tokens%kind == token_word))
            end associate
         end associate
      end do
   end function longest_list

   !> Complains, unless the condition holds, of `name` where it was given, else of its group. A
   !> value that was refused already is not judged again; nor is a default in a group with unknown
   !> names.
   subroutine require(self, condition, group, name, rule, default, number)
      class(reader_type), intent(inout) :: self
      logical, intent(in) :: condition
      character(*), intent(in) :: group, name, rule
      character(*), intent(in), optional :: default   !! the value, where the scene gives none
      integer, intent(in), optional :: number         !! which of several groups, default 1
      character(:), allocatable :: value
      integer :: block, i

      if (condition) return
      block = self%find_block(group, number)
      i = last_given(self, block, name)
      value = ''
      if (present(default)) value = default
      if (i > 0) then
         if (.not. self%assignments(i)%is_refused) call self%refuse_assignment(i, rule)
      else if (block > 0) then
         if (.not. self%blocks(block)%has_unknown) &
            call self%refuse(block, self%blocks(block)%place, name, value, rule)
      else
         call self%complaints%add_general(self%source(1)%name//': '//group//'%'//name//': '//rule)
      end if
   end subroutine require

   !> Reads the values of an entry. A refused one of a list keeps its default; a refused single
   !> value becomes zero or empty, so that no other is judged by it.
   subroutine visit_words(self, words, entry)
      class(reader_type), intent(inout) :: self
      type(word_type), allocatable, intent(inout) :: words(:)
      type(entry_type), intent(in) :: entry
      character(:), allocatable :: hint, name, rule, word
      character(2*name_length) :: full_name
      type(word_type) :: none
      type(word_type), allocatable :: found(:)
      integer, allocatable :: slots(:)
      integer :: given, i, j   ! assignment, the last of its name

      self%known = [self%known, entry%name]
      call find_slots(self, entry, size(words), slots, given)
      if (self%block > 0) then
         full_name = trim(self%blocks(self%block)%name)//'%'//entry%name
         if (given == 0 .and. entry%is_required) self%missing = [self%missing, entry%name]
         if (given > 0 .and. .not. entry%is_used) self%unused = [self%unused, full_name]
      end if
      none%text = trim(merge(' ', '0', any(entry%kind == [character(7) :: 'logical', 'text'])))
      allocate (found(size(slots)), source=none)
      do i = 1, size(slots)
         if (size(words) > 0) found(i) = words(min(i, size(words)))
         if (slots(i) == 0) cycle
         call convert(self, slots(i), entry, word, rule)
         if (entry%choices /= '' .and. any([(found(j)%text == word, j=1, i - 1)])) &
            rule = 'is named twice'
         if (.not. allocated(rule)) then
            found(i)%text = word
            cycle
         end if
         self%assignments(given)%is_refused = .true.
         if (slots(i) == self%last_slot) cycle   ! r*value, or several groups: once will do
         self%last_slot = slots(i)
         name = trim(entry%name)
         if (size(slots) > 1) name = name//'('//to_text(i)//')'
         hint = ''
         if (entry%length <= 1 .and. (size(words) <= 1 .or. entry%per_dof >= 0)) &
            hint = self%comma_hint(slots(i))   ! several values are not usual
         associate (token => self%tokens(slots(i)))
            call self%refuse(self%block, token, name, self%text_of(token), rule//hint)
         end associate
      end do
      call move_alloc(found, words)
      if (entry%is_list .or. given == 0) return
      if (self%assignments(given)%is_refused) words = [none]
   end subroutine visit_words

   !> Finds the token of each value of an entry; 0: its default. Empty after a complaint.
   subroutine find_slots(self, entry, default_size, slots, last)
      class(reader_type), intent(inout) :: self
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size   !! 0: there is no default
      integer, allocatable, intent(out) :: slots(:)
      integer, intent(out) :: last   !! assignment to it; 0: there is none
      character(:), allocatable :: hint, rule
      integer, allocatable :: values(:)
      type(assignment_type) :: given
      integer :: i, first_line, n_before

      n_before = self%complaints%n
      slots = spread(0, 1, default_size)
      last = 0
      do i = 1, self%n_assignments
         given = self%assignments(i)
         if (given%block /= self%block .or. given%name /= entry%name) cycle
         self%assignments(i)%is_known = .true.
         call expand_values(self, given, values)
         if (last == 0) first_line = given%place%line
         if (last > 0 .and. given%lower == 0 .and. given%place%source == 1) then
            rule = 'is given twice, first on line '//to_text(first_line)
         else
            call place_values(given, entry, values, slots, rule)
         end if
         call self%refuse_assignment(i, rule)
         last = i
      end do
      if (last == 0) return
      if (self%complaints%n == n_before) then
         call check_length(entry, default_size, slots, rule)
         if (allocated(rule)) then
            hint = ''
            do i = size(slots), 1, -1
               if (slots(i) > 0) hint = self%comma_hint(slots(i))
               if (hint /= '') exit
            end do
            call self%refuse_assignment(last, rule//hint)
         end if
      end if
      self%assignments(last)%is_refused = self%complaints%n > n_before
      if (self%complaints%n > n_before) slots = spread(0, 1, 0)
   end subroutine find_slots

   !> Lists the value tokens of an assignment with repeats written out; empty after a complaint.
   subroutine expand_values(self, given, values)
      class(reader_type), intent(inout) :: self
      type(assignment_type), intent(in) :: given
      integer, allocatable, intent(out) :: values(:)
      type(token_type) :: token
      character(:), allocatable :: rule
      integer :: found(max_length), i, n
      logical :: wants_value

      n = 0
      wants_value = .true.
      do i = given%first_value, given%last_value
         token = self%tokens(i)
         if (token%kind == token_comma) then
            if (wants_value) rule = 'a value is missing before the comma'
            wants_value = .true.
         else if (all(token%kind /= [token_word, token_quoted]) .or. &
                  index(self%text_of(token), '#') == 1) then
            rule = self%rule_on(token, 'is not expected among values')
         else if (token%first > token%last) then
            rule = 'a value is missing behind the *'
         else if (token%repeat < 1) then
            rule = 'a value cannot be repeated 0 times'
         else if (n + token%repeat > max_length) then
            rule = 'a list has at most '//to_text(max_length)//' values'
         else
            wants_value = .false.
            found(n + 1:n + token%repeat) = i
            n = n + token%repeat
         end if
         if (allocated(rule)) then
            call self%refuse(given%block, token, self%text_of(given%place), self%text_of(token), &
                             rule)
            values = found(:0)
            return
         end if
      end do
      if (n == 0) call self%refuse(given%block, given%place, self%text_of(given%place), '', &
                                   'a value is missing')
      values = found(:n)
   end subroutine expand_values

   !> Puts the values of one assignment where they belong.
   pure subroutine place_values(given, entry, values, slots, rule)
      type(assignment_type), intent(in) :: given
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: values(:)
      integer, allocatable, intent(inout) :: slots(:)
      character(:), allocatable, intent(out) :: rule
      integer :: n, fill

      if (size(values) == 0) return   ! it was refused
      if (given%lower == 0) then
         slots = values
         return
      end if
      n = given%upper - given%lower + 1
      if (given%upper > max_length) then
         rule = 'a list has at most '//to_text(max_length)//' values'
      else if (size(values) /= n) then
         rule = 'the index asks for '//to_text(n)//merge(' value ', ' values', n == 1)
      else
         n = max(size(slots), given%upper, entry%per_dof)
         fill = 0
         if (entry%per_dof > 0 .and. size(slots) == 1) fill = slots(1)
         slots = [slots, spread(fill, 1, n - size(slots))]
         slots(given%lower:given%upper) = values
      end if
   end subroutine place_values

   pure subroutine check_length(entry, default_size, slots, rule)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size
      integer, intent(in) :: slots(:)
      character(:), allocatable, intent(out) :: rule

      if (entry%per_dof > 0 .and. all(size(slots) /= [1, entry%per_dof])) then
         rule = 'must be one value, or one for each of the '//to_text(entry%per_dof)//' dofs'
      else if (entry%length == 1 .and. size(slots) /= 1) then
         rule = 'must be one value'
      else if (entry%length > 0 .and. size(slots) /= entry%length) then
         rule = 'must be '//to_text(entry%length)//' values'
      else if ((entry%per_dof < 0 .or. default_size == 0) .and. &
               any(slots(min(default_size, size(slots)) + 1:) == 0)) then
         rule = 'every value of the list must be given'
      end if
   end subroutine check_length

   !> Converts a token to a word that its entry admits; else `rule` says why not.
   pure subroutine convert(self, slot, entry, word, rule)
      class(reader_type), intent(in) :: self
      integer, intent(in) :: slot   !! into self%tokens
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(out) :: word, rule
      integer(long) :: whole
      real(wp) :: number

      number = 0.0_wp
      word = self%text_of(self%tokens(slot))
      select case (entry%kind)
      case ('integer')
         call parse_integer(word, entry%largest, whole, rule)
         number = real(whole, wp)
         word = to_text(whole)
      case ('real')
         call parse_real(word, number, rule)
         word = to_text(number)
      case ('logical')
         if (all(lowered(word) /= [character(7) :: 't', 'true', '.t.', '.true.', &
                                   'f', 'false', '.f.', '.false.'])) &
            rule = 'must be .true. or .false.'
         word = to_text(index(lowered(word), 't') > 0)
      case default
         ! the shell takes the quotes of the command line away
         if (self%tokens(slot)%source == 1 .or. self%tokens(slot)%kind /= token_word) &
            call take_quotes(word, rule)
         if (entry%choices /= '' .and. .not. allocated(rule)) call choose(entry, word, rule)
      end select
      if (.not. (allocated(rule) .or. entry%rule%admits(number))) &
         rule = 'must be '//entry%rule%text()
   end subroutine convert

   !> Takes the quotes from a text; a doubled quote stands for one.
   pure subroutine take_quotes(word, rule)
      character(:), allocatable, intent(inout) :: word
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: text
      integer :: i

      call move_alloc(word, text)
      word = ''
      if (len(text) < 2 .or. scan(text, '''"') /= 1) then
         rule = 'must be text in quotes'
         return
      end if
      i = 2
      do while (i < len(text))
         if (iachar(text(i:i)) < iachar(' ')) rule = 'must not hold control characters'
         word = word//text(i:i)
         i = i + merge(2, 1, text(i:i) == text(1:1))
      end do
   end subroutine take_quotes

   !> Replaces a word by the choice that it is, in any case.
   pure subroutine choose(entry, word, rule)
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(inout) :: word
      character(:), allocatable, intent(out) :: rule
      character(choice_length), allocatable :: choices(:)
      character(:), allocatable :: nearest
      integer :: i

      choices = [character(choice_length) :: words_of(entry%choices)]
      do i = 1, size(choices)
         if (lowered(word) /= lowered(trim(choices(i)))) cycle
         word = trim(choices(i))
         return
      end do
      rule = 'must be '//entry%choices_text()
      nearest = nearest_name(lowered(word), choices)
      if (nearest /= '') rule = rule//", did you mean '"//trim(nearest)//"'?"
   end subroutine choose

end module config_text_reader
