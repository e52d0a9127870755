!> Tables of numbers in text files. A line is a row; blanks, commas or semicolons separate its
!> values. A comment begins with # or !.
module core_table
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use core_complaints, only: blank_hint, complaint_list, printable
   use core_kinds, only: wp
   use core_source, only: read_source, source_type
   use core_text, only: lowered, no_number, parse_real, to_text
   implicit none(type, external)
   private
   public :: next_word, parse_line, parse_rows, read_table, table_type, words_of

   character, parameter :: tab = achar(9)
   character(*), parameter :: white = ' '//tab//achar(13)
   character(*), parameter :: blanks = white//';'
   character(*), parameter, public :: number_marks = '#!'   !! characters that begin a comment
   !> Rule that a line with a missing value breaks.
   character(*), parameter, public :: no_value = 'a value is missing beside the separator'
   integer, parameter :: max_shown = 10        !! bad lines with a complaint each
   integer, parameter :: longest_row = 4096    !! characters of the longest line of a table

   !> Rows of a file in their order. Zeros follow the values of a short row.
   type :: table_type
      character(:), allocatable :: path
      integer :: n_rows = 0
      real(wp), allocatable :: value(:, :)       !! (column, row)
      integer, allocatable :: n_columns(:)       !! (row)
      integer, allocatable :: line(:)            !! (row) number of its line in the file
   contains
      procedure :: refuse_row
   end type table_type

contains

   !> Reads the rows of a file and complains about each bad line.
   subroutine read_table(path, fewest, most, table, complaints)
      character(*), intent(in) :: path
      integer, intent(in) :: fewest, most    !! allowed numbers of values in a row
      type(table_type), intent(out) :: table
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      type(source_type) :: source

      call read_source(path, source, refusal, huge(1) - 1)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
      else
         call parse_rows(source, number_marks, fewest, most, table, complaints)
      end if
   end subroutine read_table

   !> Reads the rows of a text, see read_table.
   subroutine parse_rows(source, marks, fewest, most, table, complaints)
      type(source_type), intent(in) :: source
      character(*), intent(in) :: marks   !! characters that begin a comment
      integer, intent(in) :: fewest, most
      type(table_type), intent(out) :: table
      type(complaint_list), intent(inout) :: complaints
      real(wp) :: values(most)
      integer :: n, n_bad, number

      table%path = source%name
      n = min(source%n_lines(), len(source%text)/(2*fewest) + 1)   ! values have blanks between
      allocate (table%value(most, n), table%n_columns(n), table%line(n))
      n_bad = 0
      do number = 1, source%n_lines()
         call parse_line(source, number, marks, fewest, .false., values, n, n_bad, complaints)
         if (n == 0) cycle
         table%n_rows = table%n_rows + 1
         table%value(:n, table%n_rows) = values(:n)
         table%value(n + 1:, table%n_rows) = 0.0_wp
         table%n_columns(table%n_rows) = n
         table%line(table%n_rows) = number
      end do
      table%value = table%value(:, :table%n_rows)
      table%n_columns = table%n_columns(:table%n_rows)
      table%line = table%line(:table%n_rows)
   end subroutine parse_rows

   !> Reads the n values of a line; n = 0 if there are none, or if the line is bad. Complains about
   !> the first bad lines one by one, and says at the last line how many more there are.
   subroutine parse_line(source, number, marks, fewest, has_gaps, values, n, n_bad, complaints)
      type(source_type), intent(in) :: source
      integer, intent(in) :: number
      character(*), intent(in) :: marks      !! characters that begin a comment
      integer, intent(in) :: fewest
      logical, intent(in) :: has_gaps        !! true: `nan` is a value, and a line has any length
      real(wp), intent(inout) :: values(:)   !! the first n are set
      integer, intent(out) :: n
      integer, intent(inout) :: n_bad        !! bad lines up to this one
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: line, rule

      line = source%line(number)
      line = line(:scan(line//marks, marks) - 1)
      if (has_gaps .or. len(line) <= longest_row) then
         call parse_row(line, fewest, has_gaps, values, n, rule)
      else
         rule = 'the line is too long'
      end if
      if (allocated(rule)) then
         n = 0
         n_bad = n_bad + 1
         rule = complaint_on_line(source, number, rule, marks)
         if (has_gaps) rule = rule//'; nan stands where none was measured'
         if (n_bad <= max_shown) call complaints%add_general(rule)
      end if
      if (number == source%n_lines() .and. n_bad > max_shown) &
         call complaints%add_general(source%name//': '//to_text(n_bad - max_shown)// &
                                     ' more bad lines')
   end subroutine parse_line

   !> Replaces the commas that separate values by blanks. `rule` is allocated if a comma may be a
   !> decimal one, as in 0,3, or if a value is missing.
   pure subroutine separate_commas(line, rule)
      character(:), allocatable, intent(inout) :: line
      character(:), allocatable, intent(out) :: rule
      integer :: comma, first, i, last, n
      logical :: is_empty, is_separator

      last = 0
      do
         call next_word(line, first, last)
         if (first > last) exit
         associate (word => line(first:last))
            comma = index(word, ',')
            if (comma > 1 .and. comma < len(word) .and. comma == index(word, ',', back=.true.) &
                .and. verify(word, '+-0123456789,') == 0) then
               rule = 'may be one value or two: decimals follow a point (tr , . < OLD > NEW); '// &
                      'a comma between values has a blank behind it'
               return
            end if
         end associate
      end do
      n = verify(line, white, back=.true.)
      is_empty = .true.   ! there is no value since the last separator
      do i = 1, n
         if (index(white, line(i:i)) > 0) cycle
         is_separator = index(',;', line(i:i)) > 0
         if (is_separator .and. (is_empty .or. line(i:n) == ',')) then   ! only ; may end a row
            rule = no_value
            return
         end if
         is_empty = is_separator
      end do
      do i = 1, n
         if (line(i:i) == ',') line(i:i) = ' '
      end do
   end subroutine separate_commas

   !> Reads the n values of a line; `rule` is allocated if the line is bad.
   pure subroutine parse_row(line, fewest, has_gaps, values, n, rule)
      character(*), intent(in) :: line
      integer, intent(in) :: fewest
      logical, intent(in) :: has_gaps        !! true: `nan` is a value
      real(wp), intent(inout) :: values(:)   !! the first n are set
      integer, intent(out) :: n
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: text
      integer :: before, first, last

      n = 0
      text = line
      call separate_commas(text, rule)
      last = 0
      do while (.not. allocated(rule))
         before = last
         call next_word(text, first, last)
         if (first > last) exit
         associate (gap => line(before + 1:first - 1))
            if (has_gaps .and. n > 0 .and. scan(gap, ',;') == 0 .and. &
                index(gap, tab) < index(gap, tab, back=.true.)) then
               rule = no_value
               exit
            end if
         end associate
         n = n + 1
         if (n > size(values)) then
            rule = 'must be '//number_of_values(fewest, size(values))
         else
            call parse_real(text(first:last), values(n), rule)
            if (.not. allocated(rule)) cycle
            if (has_gaps .and. lowered(text(first:last)) == 'nan') then
               values(n) = ieee_value(values(n), ieee_quiet_nan)
               deallocate (rule)
            else
               rule = rule//blank_hint(text(first:last))
            end if
         end if
      end do
      if (n > 0 .and. n < fewest .and. .not. allocated(rule)) &
         rule = 'must be '//number_of_values(fewest, size(values))
   end subroutine parse_row

   !> Complaint about a line that breaks a rule: a heading is a comment, if it begins with a word.
   pure function complaint_on_line(source, number, rule, marks) result(text)
      type(source_type), intent(in) :: source
      integer, intent(in) :: number
      character(*), intent(in) :: rule
      character(*), intent(in) :: marks   !! characters that begin a comment
      character(:), allocatable :: line, text

      line = source%line(number)
      text = source%name//':'//to_text(number)//': '//printable(line(:min(len_trim(line), 40)))// &
             ': '//rule
      if (rule == no_number .and. verify(adjustl(line), '+-.0123456789') == 1) &
         text = text//' (a heading begins with '//marks(1:1)//')'
   end function complaint_on_line

   !> Finds the next word, line(first:last), after position `last`; first > last if there is none.
   pure subroutine next_word(line, first, last)
      character(*), intent(in) :: line
      integer, intent(out) :: first
      integer, intent(inout) :: last

      first = last + 1
      do while (first <= len(line))
         if (index(blanks, line(first:first)) == 0) exit
         first = first + 1
      end do
      last = first - 1
      do while (last < len(line))
         if (index(blanks, line(last + 1:last + 1)) > 0) exit
         last = last + 1
      end do
   end subroutine next_word

   !> Words of a text, padded with blanks.
   pure function words_of(text) result(words)
      character(*), intent(in) :: text
      character(:), allocatable :: words(:)
      integer :: first, last

      words = [character(1) ::]
      last = 0
      do
         call next_word(text, first, last)
         if (first > last) return
         words = [character(max(len(words), last - first + 1)) :: words, text(first:last)]
      end do
   end function words_of

   !> Text of the allowed number of values: 'one value', '5 or 6 values', '2 to 4 values'.
   pure function number_of_values(fewest, most) result(text)
      integer, intent(in) :: fewest, most
      character(:), allocatable :: text

      if (most == 1) then
         text = 'one value'
      else if (fewest == most) then
         text = to_text(most)//' values'
      else if (fewest + 1 == most) then
         text = to_text(fewest)//' or '//to_text(most)//' values'
      else
         text = to_text(fewest)//' to '//to_text(most)//' values'
      end if
      if (most > 1) text = text//' with blanks, commas or ; between'
   end function number_of_values

   !> Adds a complaint about one value of a row: `path:line: name = value: rule`.
   subroutine refuse_row(self, row, name, value, rule, complaints)
      class(table_type), intent(in) :: self
      integer, intent(in) :: row
      character(*), intent(in) :: name, value, rule
      type(complaint_list), intent(inout) :: complaints

      call complaints%add_general(self%path//':'//to_text(self%line(row))//': '//name//' = '// &
                                  value//': '//rule)
   end subroutine refuse_row

end module core_table
