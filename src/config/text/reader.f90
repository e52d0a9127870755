!> Reads the values of the groups from a parsed scene and its --set options. Refuses every value
!> that is not of the type, range or choices of its entry, with the rule that it breaks.
module config_text_reader
   use config_text_namelist, only: assignment_type, document_type
   use config_text_tokens, only: token_comma, token_quoted, token_type, token_word
   use config_text_value_table, only: choice_length, entry_type, name_length, word_type
   use core_complaints, only: nearest_name, suggestion
   use core_kinds, only: long, wp
   use core_source, only: find_beside, is_folder
   use core_table, only: words_of
   use core_text, only: lowered, parse_integer, parse_real, to_text
   implicit none(type, external)
   private
   public :: reader_type

   integer, parameter :: max_length = 1000   !! largest number of values in a list

   !> Visitor that sets the values of a group from the document.
   type, extends(document_type) :: reader_type
      character(2*name_length), allocatable :: unused(:)   !! group%name of values without effect
      integer, private :: group = 0         !! index of the group being read; 0: it is absent
      integer, private :: last_refused = 0  !! index of the token that was refused last
      character(name_length), allocatable, private :: known(:)    !! names visited in the group
      character(name_length), allocatable, private :: missing(:)  !! required names without a value
   contains
      procedure :: begin_group
      procedure :: end_group
      procedure :: was_given
      procedure :: longest_list
      procedure :: require
      procedure :: find_file
      procedure :: visit_words
   end type reader_type

contains

   !> Prepares the reader to visit the table of a group.
   subroutine begin_group(self, group, number)
      class(reader_type), intent(inout) :: self
      character(*), intent(in) :: group
      integer, intent(in) :: number   !! number among the groups of that name

      self%group = self%find_group(group, number)
      self%known = [character(name_length) ::]
      self%missing = self%known
      if (.not. allocated(self%unused)) allocate (self%unused(0))
   end subroutine begin_group

   !> Complains of every name in the group that is unknown: given, but not visited. Complains of
   !> missing names only if there is no unknown one, which may be a misspelt one of them.
   subroutine end_group(self)
      class(reader_type), intent(inout) :: self
      integer :: i

      do i = 1, self%n_assignments
         if (self%assignments(i)%group /= self%group .or. self%assignments(i)%is_known) cycle
         self%groups(self%group)%is_misread = .true.
         call self%refuse_assignment(i, 'unknown name'// &
                                     suggestion(trim(self%assignments(i)%name), self%known))
      end do
      do i = 1, size(self%missing)
         associate (group => self%groups(self%group))
            if (.not. group%is_misread) call self%refuse(self%group, group%place, &
                                                          trim(self%missing(i)), '', &
                                                          'must be given')
         end associate
      end do
   end subroutine end_group

   !> Index of the last assignment to a name of a group; 0 if there is none.
   pure integer function last_given(self, group, name) result(i)
      class(reader_type), intent(in) :: self
      integer, intent(in) :: group
      character(*), intent(in) :: name

      do i = self%n_assignments, 1, -1
         associate (given => self%assignments(i))
            if (given%group == group .and. given%name == name) return
         end associate
      end do
   end function last_given

   !> True if the scene or an option gives a value of a group.
   pure logical function was_given(self, group, name, number)
      class(reader_type), intent(in) :: self
      character(*), intent(in) :: group, name
      integer, intent(in), optional :: number   !! number among the groups of that name, default 1

      was_given = last_given(self, self%find_group(group, number), name) > 0
   end function was_given

   !> Number of values of the longest list that a group gives without an index.
   pure integer function longest_list(self, group) result(longest)
      class(reader_type), intent(in) :: self
      character(*), intent(in) :: group
      integer :: i_group, i

      longest = 0
      i_group = self%find_group(group)
      do i = 1, self%n_assignments
         associate (given => self%assignments(i))
            if (given%group /= i_group .or. given%lower > 0) cycle
            associate (tokens => self%tokens(given%first_value:given%last_value))
               longest = max(longest, sum(tokens%repeat, mask=tokens%kind == token_word))
            end associate
         end associate
      end do
   end function longest_list

   !> Complains if a condition does not hold: of the value, or of its group if the value was not
   !> given. Does not complain twice of a value, nor of a default in a group with unknown names.
   subroutine require(self, condition, group, name, rule, default, number)
      class(reader_type), intent(inout) :: self
      logical, intent(in) :: condition
      character(*), intent(in) :: group, name, rule
      character(*), intent(in), optional :: default   !! value to be shown if none was given
      integer, intent(in), optional :: number         !! number among the groups, default 1
      character(:), allocatable :: value
      integer :: i_group, i

      if (condition) return
      i_group = self%find_group(group, number)
      i = last_given(self, i_group, name)
      value = ''
      if (present(default)) value = default
      if (i > 0) then
         if (.not. self%assignments(i)%is_refused) call self%refuse_assignment(i, rule)
      else if (i_group > 0) then
         if (.not. self%groups(i_group)%is_misread) &
            call self%refuse(i_group, self%groups(i_group)%place, name, value, rule)
      else
         call self%complaints%add_general(self%source(1)%name//': '//group//'%'//name//': '//rule)
      end if
   end subroutine require

   !> Finds the path of the file that a value names, beside the scene or in the current folder.
   !> Complains if there is none or a folder: then the path is ''.
   subroutine find_file(self, group, name, file, path, number)
      class(reader_type), intent(inout) :: self
      character(*), intent(in) :: group, name
      character(*), intent(in) :: file                 !! the value, not empty
      character(:), allocatable, intent(out) :: path
      integer, intent(in), optional :: number          !! number among the groups, default 1

      path = find_beside(self%source(1)%name, file)
      call self%require(path /= '', group, name, 'no such file', number=number)
      if (path == '') return
      call self%require(.not. is_folder(path), group, name, 'is a folder, not a file', &
                        number=number)
      if (is_folder(path)) path = ''
   end subroutine find_file

   !> Reads the values of an entry. A refused value of a list keeps its default; a refused single
   !> value becomes zero or empty, so that it breaks no rule together with other values.
   subroutine visit_words(self, words, entry)
      class(reader_type), intent(inout) :: self
      type(word_type), allocatable, intent(inout) :: words(:)
      type(entry_type), intent(in) :: entry
      character(:), allocatable :: name, rule, word
      character(2*name_length) :: full_name
      type(word_type) :: none
      type(word_type), allocatable :: found(:)
      integer, allocatable :: token_of(:)
      integer :: given, i, j   ! given: the last assignment to the entry

      self%known = [self%known, entry%name]
      call find_tokens(self, entry, size(words), token_of, given)
      if (self%group > 0) then
         full_name = trim(self%groups(self%group)%name)//'%'//entry%name
         if (given == 0 .and. entry%is_required) self%missing = [self%missing, entry%name]
         if (given > 0 .and. .not. entry%is_used) self%unused = [self%unused, full_name]
      end if
      none%text = trim(merge(' ', '0', any(entry%kind == [character(7) :: 'logical', 'text'])))
      allocate (found(size(token_of)), source=none)
      do i = 1, size(token_of)
         if (size(words) > 0) found(i) = words(min(i, size(words)))
         if (token_of(i) == 0) cycle
         call convert(self, token_of(i), entry, word, rule)
         if (entry%choices /= '' .and. any([(found(j)%text == word, j=1, i - 1)])) &
            rule = 'is named twice'
         if (.not. allocated(rule)) then
            found(i)%text = word
            cycle
         end if
         self%assignments(given)%is_refused = .true.
         if (token_of(i) == self%last_refused) cycle   ! r*value, or an option for several groups
         self%last_refused = token_of(i)
         name = trim(entry%name)
         if (size(token_of) > 1) name = name//'('//to_text(i)//')'
         associate (token => self%tokens(token_of(i)))
            call self%refuse(self%group, token, name, self%text_of(token), rule)
         end associate
      end do
      call move_alloc(found, words)
      if (entry%is_list .or. given == 0) return
      if (self%assignments(given)%is_refused) words = [none]
   end subroutine visit_words

   !> Finds the token of each value of an entry, or 0 for its default. Empty after a complaint.
   subroutine find_tokens(self, entry, default_size, token_of, last)
      class(reader_type), intent(inout) :: self
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size          !! number of default values
      integer, allocatable, intent(out) :: token_of(:)   !! (value) index into self%tokens, or 0
      integer, intent(out) :: last   !! index of the last assignment to the entry; 0: none
      character(:), allocatable :: rule
      integer, allocatable :: values(:)
      type(assignment_type) :: given
      integer :: i, first_line, n_before

      n_before = self%complaints%n
      token_of = spread(0, 1, default_size)
      last = 0
      do i = 1, self%n_assignments
         given = self%assignments(i)
         if (given%group /= self%group .or. given%name /= entry%name) cycle
         self%assignments(i)%is_known = .true.
         call expand_values(self, given, values)
         if (last == 0) first_line = given%place%line
         if (last > 0 .and. given%lower == 0 .and. given%place%source == 1) then
            rule = 'is given twice, first on line '//to_text(first_line)
         else
            call place_values(given, entry, values, token_of, rule)
         end if
         call self%refuse_assignment(i, rule)
         last = i
      end do
      if (last == 0) return
      if (self%complaints%n == n_before) then
         call check_length(entry, default_size, token_of, rule)
         call self%refuse_assignment(last, rule)
      end if
      self%assignments(last)%is_refused = self%complaints%n > n_before
      if (self%complaints%n > n_before) token_of = spread(0, 1, 0)
   end subroutine find_tokens

   !> Lists the token of each value of an assignment, repeated for r*value; empty after a complaint.
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
            rule = 'a value is missing after the *'
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
            call self%refuse(given%group, token, self%text_of(given%place), self%text_of(token), &
                             rule)
            values = found(:0)
            return
         end if
      end do
      if (n == 0) call self%refuse(given%group, given%place, self%text_of(given%place), '', &
                                   'a value is missing')
      values = found(:n)
   end subroutine expand_values

   !> Stores the tokens of one assignment: of a whole list, or of the indexed values.
   pure subroutine place_values(given, entry, values, token_of, rule)
      type(assignment_type), intent(in) :: given
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: values(:)
      integer, allocatable, intent(inout) :: token_of(:)
      character(:), allocatable, intent(out) :: rule
      integer :: n, fill

      if (size(values) == 0) return   ! it was refused
      if (given%lower == 0) then
         token_of = values
         return
      end if
      n = given%upper - given%lower + 1
      if (given%upper > max_length) then
         rule = 'a list has at most '//to_text(max_length)//' values'
      else if (size(values) /= n) then
         rule = 'the index asks for '//to_text(n)//merge(' value ', ' values', n == 1)
      else
         n = max(size(token_of), given%upper, entry%per_dof)
         fill = 0
         if (entry%per_dof > 0 .and. size(token_of) == 1) fill = token_of(1)
         token_of = [token_of, spread(fill, 1, n - size(token_of))]
         token_of(given%lower:given%upper) = values
      end if
   end subroutine place_values

   !> Checks the number of values of an entry; `rule` is allocated if it is wrong.
   pure subroutine check_length(entry, default_size, token_of, rule)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size
      integer, intent(in) :: token_of(:)
      character(:), allocatable, intent(out) :: rule

      if (entry%per_dof > 0 .and. all(size(token_of) /= [1, entry%per_dof])) then
         rule = 'must be one value, or one for each of the '//to_text(entry%per_dof)//' dofs'
      else if (entry%length == 1 .and. size(token_of) /= 1) then
         rule = 'must be one value'
         if (entry%kind == 'text') rule = rule//'; a text with blanks stands in quotes'
      else if (entry%length > 0 .and. size(token_of) /= entry%length) then
         rule = 'must be '//to_text(entry%length)//' values'
      else if ((entry%per_dof < 0 .or. default_size == 0) .and. &
               any(token_of(min(default_size, size(token_of)) + 1:) == 0)) then
         rule = 'every value of the list must be given'
      end if
   end subroutine check_length

   !> Converts a token to a value that its entry admits; `rule` is allocated if there is none.
   pure subroutine convert(self, i_token, entry, word, rule)
      class(reader_type), intent(in) :: self
      integer, intent(in) :: i_token   !! index into self%tokens
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(out) :: word, rule
      integer(long) :: whole
      real(wp) :: number

      number = 0.0_wp
      word = self%text_of(self%tokens(i_token))
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
         ! in an option the shell has removed the quotes
         if (self%tokens(i_token)%source == 1 .or. self%tokens(i_token)%kind /= token_word) &
            call remove_quotes(word, rule)
         if (entry%choices /= '' .and. .not. allocated(rule)) call choose(entry, word, rule)
      end select
      if (.not. (allocated(rule) .or. entry%rule%admits(number))) &
         rule = 'must be '//entry%rule%text()
   end subroutine convert

   !> Removes the quotes of a text; a doubled quote stands for one.
   pure subroutine remove_quotes(word, rule)
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
   end subroutine remove_quotes

   !> Replaces a word by the choice that it equals up to upper and lower case.
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
