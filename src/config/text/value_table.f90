!> Table of the values of a group: an entry with name, unit, rule and meaning for each value.
!>
!> Each group lists its entries once, in its procedure `visit_*`. A visitor of that table reads the
!> values, or lists them for the template, the scene reference and the fingerprint.
module config_text_value_table
   use core_kinds, only: long, wp
   use core_table, only: words_of
   use core_text, only: number_text, to_text
   implicit none(type, external)
   private
   public :: entry_type, interval, lister_type, row_type, visitor_type, word_type
   public :: choice_length, name_length, not_negative, positive

   integer, parameter :: name_length = 24, choice_length = 16, doc_length = 132

   !> Interval that a number must lie in.
   type :: interval
      real(wp) :: lower = -huge(1.0_wp), upper = huge(1.0_wp)
      logical :: is_open = .false.   !! True: without its ends
   contains
      procedure :: admits
      procedure :: text => rule_text
   end type interval

   type(interval), parameter :: positive = interval(lower=0.0_wp, is_open=.true.), &
                                not_negative = interval(lower=0.0_wp)

   !> Description of one value or list of a group.
   type :: entry_type
      character(name_length) :: name
      character(doc_length) :: doc = ''        !! meaning
      character(8) :: unit = ''
      type(interval) :: rule
      character(64) :: choices = ''            !! permitted texts, blanks between; '': any text
      integer :: length = 0                    !! number of values of a list; 0: any
      integer :: per_dof = -1                  !! dofs, for a list of one value or one per dof
      logical :: is_list = .false.
      character(7) :: kind = 'real'            !! or 'integer', 'logical', 'text'
      integer(long) :: largest = huge(1)       !! largest magnitude of an integer
      character(doc_length) :: default = ''    !! the default in words, if it is no fixed value
      logical :: is_required = .false.
      logical :: in_fingerprint = .true.       !! true if the value can change a sample
      logical :: is_used = .true.              !! false if other values leave it without effect
   contains
      procedure :: choices_text
   end type entry_type

   !> A value as written in a scene; text without its quotes.
   type :: word_type
      character(:), allocatable :: text
   end type word_type

   !> Visitor of the table of a group. It gets values as words; a list without default is empty.
   type, abstract :: visitor_type
   contains
      generic :: visit => visit_value, visit_integers, visit_reals
      procedure :: visit_value
      procedure :: visit_text
      procedure :: visit_integers
      procedure :: visit_reals
      procedure :: visit_choices
      procedure(visit_words), deferred :: visit_words
   end type visitor_type

   abstract interface
      !> Reads or replaces the values of an entry.
      subroutine visit_words(self, words, entry)
         import :: entry_type, visitor_type, word_type
         class(visitor_type), intent(inout) :: self
         type(word_type), allocatable, intent(inout) :: words(:)   !! defaults on entry
         type(entry_type), intent(in) :: entry
      end subroutine visit_words
   end interface

   !> An entry and its value.
   type :: row_type
      type(entry_type) :: entry
      character(:), allocatable :: value     !! as written in a scene; '' if there is none
   end type row_type

   !> Visitor that lists the rows of the tables that it visits.
   type, extends(visitor_type) :: lister_type
      type(row_type), allocatable :: rows(:)
   contains
      procedure :: visit_words => list_words
   end type lister_type

contains

   !> Visits a number, a logical, or a text that is one of the entry's choices.
   subroutine visit_value(self, value, entry)
      class(visitor_type), intent(inout) :: self
      class(*), intent(inout) :: value
      type(entry_type), intent(in) :: entry
      type(entry_type) :: single
      type(word_type), allocatable :: words(:)

      single = entry
      single%length = 1
      allocate (words(1))
      select type (value)
      type is (integer)
         single%kind = 'integer'
         words(1)%text = to_text(value)
         call self%visit_words(words, single)
         value = nint(number_in(words(1)))
      type is (integer(long))
         single%kind = 'integer'
         single%largest = huge(value)
         words(1)%text = to_text(value)
         call self%visit_words(words, single)
         read (words(1)%text, *) value
      type is (real(wp))
         words(1)%text = to_text(value)
         call self%visit_words(words, single)
         value = number_in(words(1))
      type is (logical)
         single%kind = 'logical'
         words(1)%text = to_text(value)
         call self%visit_words(words, single)
         value = words(1)%text == to_text(.true.)
      type is (character(*))
         single%kind = 'text'
         words(1)%text = trim(value)
         call self%visit_words(words, single)
         value = words(1)%text
      end select
   end subroutine visit_value

   !> Visits any text; its default is ''.
   subroutine visit_text(self, value, entry)
      class(visitor_type), intent(inout) :: self
      character(:), allocatable, intent(inout) :: value
      type(entry_type), intent(in) :: entry
      type(entry_type) :: single
      type(word_type), allocatable :: words(:)

      single = entry
      single%kind = 'text'
      single%length = 1
      allocate (words(1))
      words(1)%text = ''
      if (allocated(value)) words(1)%text = value
      call self%visit_words(words, single)
      value = words(1)%text
   end subroutine visit_text

   !> Visits a list of integers as one of reals, which represent them exactly.
   subroutine visit_integers(self, values, entry, default)
      class(visitor_type), intent(inout) :: self
      integer, allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default(:)
      type(entry_type) :: integers
      real(wp), allocatable :: numbers(:)

      integers = entry
      integers%kind = 'integer'
      if (allocated(values)) numbers = real(values, wp)
      call self%visit_reals(numbers, integers, real(default, wp))
      values = nint(numbers)
   end subroutine visit_integers

   !> Visits a list of real numbers.
   subroutine visit_reals(self, values, entry, default)
      class(visitor_type), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      real(wp), intent(in), optional :: default(:)
      type(entry_type) :: list
      type(word_type), allocatable :: words(:)
      integer :: i

      list = entry
      list%is_list = .true.
      if (.not. allocated(values)) then
         allocate (values(0))
         if (present(default)) values = default
      end if
      allocate (words(size(values)))
      do i = 1, size(words)
         words(i)%text = to_text(values(i))
         if (list%kind == 'integer') words(i)%text = to_text(nint(values(i)))
      end do
      call self%visit_words(words, list)
      values = [(number_in(words(i)), i=1, size(words))]
   end subroutine visit_reals

   !> Visits a list of some of the entry's choices, each at most once.
   subroutine visit_choices(self, values, entry, default)
      class(visitor_type), intent(inout) :: self
      character(choice_length), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      character(*), intent(in) :: default(:)
      type(entry_type) :: list
      type(word_type), allocatable :: words(:)
      integer :: i

      list = entry
      list%kind = 'text'
      list%is_list = .true.
      if (.not. allocated(values)) values = default
      allocate (words(size(values)))
      do i = 1, size(words)
         words(i)%text = trim(values(i))
      end do
      call self%visit_words(words, list)
      deallocate (values)
      allocate (values(size(words)))
      do i = 1, size(words)
         values(i) = words(i)%text
      end do
   end subroutine visit_choices

   !> Number that a word holds.
   pure real(wp) function number_in(word) result(number)
      type(word_type), intent(in) :: word

      read (word%text, *) number
   end function number_in

   !> Appends a row with the values of an entry. Equal values of all dofs become one value.
   subroutine list_words(self, words, entry)
      class(lister_type), intent(inout) :: self
      type(word_type), allocatable, intent(inout) :: words(:)
      type(entry_type), intent(in) :: entry
      type(row_type) :: row
      integer :: i, n

      n = size(words)
      if (entry%per_dof >= 0) then
         if (all([(words(i)%text == words(1)%text, i=2, n)])) n = min(n, 1)
      end if
      row%entry = entry
      row%value = ''
      do i = 1, n
         if (i > 1) row%value = row%value//', '
         if (entry%kind == 'text') then
            row%value = row%value//quoted(words(i)%text)
         else
            row%value = row%value//words(i)%text
         end if
      end do
      if (.not. allocated(self%rows)) allocate (self%rows(0))
      self%rows = [self%rows, row]
   end subroutine list_words

   !> Text in quotes; quotes in it are doubled.
   pure function quoted(text)
      character(*), intent(in) :: text
      character(:), allocatable :: quoted
      integer :: i

      quoted = "'"
      do i = 1, len(text)
         quoted = quoted//text(i:i)
         if (text(i:i) == "'") quoted = quoted//"'"
      end do
      quoted = quoted//"'"
   end function quoted

   !> List of the choices: 'one', 'another' or 'a third'.
   pure function choices_text(self) result(text)
      class(entry_type), intent(in) :: self
      character(:), allocatable :: text
      character(:), allocatable :: choices(:)
      integer :: i

      choices = words_of(self%choices)
      text = ''
      do i = 1, size(choices)
         if (i > 1 .and. i < size(choices)) text = text//', '
         if (i > 1 .and. i == size(choices)) text = text//' or '
         text = text//"'"//trim(choices(i))//"'"
      end do
   end function choices_text

   !> True if a value lies in the interval.
   elemental logical function admits(self, value)
      class(interval), intent(in) :: self
      real(wp), intent(in) :: value

      admits = value >= self%lower .and. value <= self%upper
      if (self%is_open) admits = value > self%lower .and. value < self%upper
   end function admits

   !> Text of the rule after `must be`: `positive`, `from 1 to 200`; '' if every number is admitted.
   pure function rule_text(self) result(text)
      class(interval), intent(in) :: self
      character(:), allocatable :: text
      logical :: is_bounded

      is_bounded = self%upper < huge(1.0_wp)
      if (self%lower <= -huge(1.0_wp)) then
         text = ''
      else if (is_bounded .and. self%is_open) then
         text = 'above '//number_text(self%lower)//' and below '//number_text(self%upper)
      else if (is_bounded) then
         text = 'from '//number_text(self%lower)//' to '//number_text(self%upper)
      else if (abs(self%lower) > 0.0_wp) then
         text = 'at least '//number_text(self%lower)
      else
         text = trim(merge('positive        ', 'zero or positive', self%is_open))
      end if
   end function rule_text

end module config_text_value_table
