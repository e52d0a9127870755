!> A scene as it is written: groups, names and values, each with its place, and the complaints about
!> them. Who fills the tables of groups from it extends it: config_text_reader.
module config_text_document
   use config_text_tokens, only: token_comma, token_group, token_open_quote, token_type
   use config_text_value_table, only: visitor_type
   use core_complaints, only: complaint_list, printable
   use core_source, only: source_type
   use core_text, only: lowered
   implicit none(type, external)
   private
   public :: assignment_type, document_type

   integer, parameter :: shown = 40   !! characters of a long value that a complaint repeats, twice
   character(*), parameter :: digits = '0123456789'

   !> One `&group ... /`.
   type :: block_type
      character(32) :: name = ''          !! lower case; a longer one is cut, and no group of ours
      type(token_type) :: place           !! place of its &name
      logical :: has_unknown = .false.    !! complained of a name in it
   end type block_type

   !> `name = values`, `name(lower:upper) = values`.
   type :: assignment_type
      integer :: block = 0
      character(32) :: name = ''          !! lower case; a longer one is cut, and no name of ours
      type(token_type) :: place           !! of the name, with its index
      integer :: lower = 0, upper = 0     !! 0: the whole list
      integer :: first_value = 1, last_value = 0   !! into document%tokens
      logical :: is_known = .false.       !! an entry of its group has its name
      logical :: is_refused = .false.     !! complained of
   end type assignment_type

   !> The file and the options, cut into tokens, groups and assignments.
   type, abstract, extends(visitor_type) :: document_type
      type(source_type) :: source(2)      !! the scene file; the --set options, one a line
      type(token_type), allocatable :: tokens(:)
      type(block_type), allocatable :: blocks(:)             !! in the order of the file
      type(assignment_type), allocatable :: assignments(:)   !! valid to n_assignments
      integer :: n_assignments = 0
      type(complaint_list) :: complaints
   contains
      procedure :: open_block
      procedure :: find_block
      procedure :: append
      procedure :: is_for
      procedure :: text_of
      procedure :: values_text
      procedure :: rule_on
      procedure :: comma_hint
      procedure, private :: has_comma_inside
      procedure :: complain
      procedure :: refuse
      procedure :: refuse_assignment
   end type document_type

contains

   !> Opens a group at its name.
   subroutine open_block(self, place)
      class(document_type), intent(inout) :: self
      type(token_type), intent(in) :: place
      type(block_type) :: block
      character(:), allocatable :: name

      name = self%text_of(place)
      if (place%kind == token_group) name = name(2:)
      block%name = lowered(name)
      block%place = place
      self%blocks = [self%blocks, block]
   end subroutine open_block

   !> The first block of a name, or the number-th; 0: there is none.
   pure integer function find_block(self, name, number) result(block)
      class(document_type), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), optional :: number
      integer :: n_missing

      n_missing = 1
      if (present(number)) n_missing = number
      do block = 1, size(self%blocks)
         if (self%blocks(block)%name == name) n_missing = n_missing - 1
         if (n_missing == 0) return
      end do
      block = 0
   end function find_block

   pure subroutine append(self, assignment)
      class(document_type), intent(inout) :: self
      type(assignment_type), intent(in) :: assignment

      if (self%n_assignments == size(self%assignments)) &
         self%assignments = [self%assignments, self%assignments, assignment]
      self%n_assignments = self%n_assignments + 1
      self%assignments(self%n_assignments) = assignment
   end subroutine append

   !> True if the i-th assignment is one to this name of this group.
   pure logical function is_for(self, i, block, name)
      class(document_type), intent(in) :: self
      integer, intent(in) :: i, block
      character(*), intent(in) :: name

      is_for = self%assignments(i)%block == block
      if (is_for) is_for = self%assignments(i)%name == name
   end function is_for

   !> The token as written.
   pure function text_of(self, token) result(text)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(:), allocatable :: text

      text = self%source(token%source)%text(token%first:token%last)
   end function text_of

   !> The values as written; of several lines only the first.
   pure function values_text(self, given) result(text)
      class(document_type), intent(in) :: self
      type(assignment_type), intent(in) :: given
      character(:), allocatable :: text
      integer :: last

      text = ''
      if (given%last_value < given%first_value) return
      associate (first => self%tokens(given%first_value))
         last = given%last_value
         do while (self%tokens(last)%line > first%line)
            last = last - 1
         end do
         text = self%source(first%source)%text(first%start:self%tokens(last)%last)
      end associate
   end function values_text

   !> Rule that a token breaks where it is not expected: where a # stands, a person used to other
   !> languages meant a comment.
   pure function rule_on(self, token, otherwise) result(rule)
      class(document_type), intent(in) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: otherwise
      character(:), allocatable :: rule

      rule = otherwise
      if (token%kind == token_open_quote) rule = 'the quote is not closed on its line'
      if (index(self%text_of(token), '#') == 1) rule = 'a comment begins with !'
   end function rule_on

   !> Hint where a value may be half of 0,2; else empty.
   pure function comma_hint(self, slot) result(hint)
      class(document_type), intent(in) :: self
      integer, intent(in) :: slot   !! into self%tokens
      character(:), allocatable :: hint

      hint = ''
      if (self%has_comma_inside(slot) .or. self%has_comma_inside(slot - 2)) &
         hint = ' (commas separate values: decimals follow a point)'
   end function comma_hint

   !> True if token i and those behind it read digits, comma, digit, without a blank.
   pure logical function has_comma_inside(self, i)
      class(document_type), intent(in) :: self
      integer, intent(in) :: i   !! into self%tokens, or beyond

      has_comma_inside = .false.
      if (i < 1 .or. i + 2 > size(self%tokens)) return
      associate (left => self%tokens(i), comma => self%tokens(i + 1), right => self%tokens(i + 2))
         if (comma%kind /= token_comma .or. left%last + 1 /= comma%first .or. &
             comma%last + 1 /= right%first) return
         has_comma_inside = verify(self%text_of(left), digits) == 0 .and. &
                            scan(self%text_of(right), digits) == 1
      end associate
   end function has_comma_inside

   !> Adds a complaint at a token, `file:line: what: rule`.
   subroutine complain(self, token, what, rule)
      class(document_type), intent(inout) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: what, rule
      character(:), allocatable :: text

      text = what
      if (len(text) > 2*shown) text = what(:shown)//'...'//what(len(what) - shown + 4:)
      associate (source => self%source(token%source))
         call self%complaints%add(source, token%line, &
                                  token%first - source%line_start(token%line) + 1, &
                                  printable(text)//': '//rule//blank_hint(self%text_of(token)))
      end associate
   end subroutine complain

   !> Hint for a word with a blank of another kind, which looks like the plain one; empty for a
   !> text in quotes.
   pure function blank_hint(word) result(hint)
      character(*), intent(in) :: word
      character(:), allocatable :: hint
      character(*), parameter :: utf8 = char(194)//char(160), latin1 = char(160)

      hint = ''
      if (scan(word, '''"') == 1) return
      if (index(word, utf8) > 0 .or. index(word, latin1) == 1) &
         hint = ' (it holds a non-breaking space, U+00A0: type a plain blank)'
   end function blank_hint

   !> Adds a complaint at a value, `file:line: group%name = value: rule`.
   subroutine refuse(self, block, token, name, value, rule)
      class(document_type), intent(inout) :: self
      integer, intent(in) :: block
      type(token_type), intent(in) :: token
      character(*), intent(in) :: name, value, rule
      character(:), allocatable :: what

      what = trim(self%blocks(block)%name)//'%'//name
      if (len_trim(value) > 0) what = what//' = '//value
      call self%complain(token, what, rule)
   end subroutine refuse

   !> Adds a complaint at the name of the i-th assignment with all its values, if a rule is broken.
   subroutine refuse_assignment(self, i, rule)
      class(document_type), intent(inout) :: self
      integer, intent(in) :: i
      character(*), intent(in), optional :: rule

      if (.not. present(rule)) return
      associate (given => self%assignments(i))
         given%is_refused = .true.
         call self%refuse(given%block, given%place, self%text_of(given%place), &
                          self%values_text(given), rule)
      end associate
   end subroutine refuse_assignment

end module config_text_document
