!> Tables of numbers in text files: one row a line, its values between blanks or semicolons.
module core_table
   use core_complaints, only: complaint_list, printable
   use core_kinds, only: wp
   use core_source, only: byte_order_mark, read_source, source_type
   use core_text, only: parse_real, to_text
   implicit none(type, external)
   private
   public :: next_word, parse_row, parse_rows, read_table, table_type

   character(*), parameter :: blanks = ' ;'//achar(9)//achar(13)
   integer, parameter :: max_shown = 10        !! bad lines that are named one by one
   integer, parameter :: longest_line = 4096   !! [characters]

   !> Rows in file order. A row that has fewer values than the longest ends in zeros.
   type :: table_type
      character(:), allocatable :: path
      integer :: n_rows = 0
      real(wp), allocatable :: value(:, :)       !! (column, row)
      integer, allocatable :: n_columns(:)       !! (row)
      integer, allocatable :: line(:)            !! (row) of the file
   contains
      procedure :: refuse_row
   end type table_type

contains

   !> Reads the rows of a file; the rest of a line behind one of the marks is a comment. Every row
   !> has fewest to most values. Every bad line is a complaint.
   subroutine read_table(path, marks, fewest, most, table, complaints)
      character(*), intent(in) :: path
      character(*), intent(in) :: marks      !! '#', or '#!'
      integer, intent(in) :: fewest, most    !! values on a line
      type(table_type), intent(out) :: table
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      type(source_type) :: source

      call read_source(path, source, refusal, huge(1) - 1)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
      else
         call parse_rows(source, marks, fewest, most, table, complaints)
      end if
   end subroutine read_table

   !> Takes the rows of a text, see read_table.
   subroutine parse_rows(source, marks, fewest, most, table, complaints)
      type(source_type), intent(in) :: source
      character(*), intent(in) :: marks
      integer, intent(in) :: fewest, most
      type(table_type), intent(out) :: table
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: line, rule
      real(wp) :: values(most)
      integer :: n, n_bad, number

      table%path = source%name
      allocate (table%value(most, 1024), table%n_columns(1024), table%line(1024))
      n_bad = 0
      do number = 1, source%n_lines()
         line = source%line(number)
         if (number == 1 .and. index(line, byte_order_mark) == 1) line = line(4:)
         call parse_row(line(:scan(line//marks, marks) - 1), fewest, values, n, rule)
         if (allocated(rule)) then
            n_bad = n_bad + 1
            if (n_bad <= max_shown) &
               call complaints%add_general(table%path//':'//to_text(number)//': '// &
                                           printable(line(:min(len_trim(line), 40)))//': '//rule)
         else if (n > 0) then
            call append_row(table, values, n, number)
         end if
      end do
      if (n_bad > max_shown) &
         call complaints%add_general(table%path//': '//to_text(n_bad - max_shown)// &
                                     ' more bad lines')
      table%value = table%value(:, :table%n_rows)
      table%n_columns = table%n_columns(:table%n_rows)
      table%line = table%line(:table%n_rows)
   end subroutine parse_rows

   !> Reads the values of a line, n of them; `rule` is allocated when the line is bad.
   pure subroutine parse_row(line, fewest, values, n, rule)
      character(*), intent(in) :: line
      integer, intent(in) :: fewest
      real(wp), intent(out) :: values(:)
      integer, intent(out) :: n
      character(:), allocatable, intent(out) :: rule
      integer :: first, last

      values = 0.0_wp
      n = 0
      last = 0
      if (len(line) > longest_line) rule = 'the line is too long'
      do while (.not. allocated(rule))
         call next_word(line, first, last)
         if (first > last) exit
         n = n + 1
         if (index(line(first:last), ',') > 0) then
            rule = 'a comma separates nothing here: values have blanks or ; between, decimals '// &
                   'follow a point'
         else if (n > size(values)) then
            rule = 'must be '//number_of_values(fewest, size(values))
         else
            call parse_real(line(first:last), values(n), rule)
         end if
      end do
      if (n > 0 .and. n < fewest .and. .not. allocated(rule)) &
         rule = 'must be '//number_of_values(fewest, size(values))
   end subroutine parse_row

   !> Finds the next word of a line after position `last`; first > last if there is none.
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

   !> The allowed number of values: 'one value', '5 or 6 values', '2 to 4 values'.
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
      if (most > 1) text = text//' with blanks or ; between'
   end function number_of_values

   pure subroutine append_row(table, values, n, line)
      type(table_type), intent(inout) :: table
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n, line
      real(wp), allocatable :: more_values(:, :)

      if (table%n_rows == size(table%line)) then
         allocate (more_values(size(values), 2*table%n_rows))
         more_values(:, :table%n_rows) = table%value
         call move_alloc(more_values, table%value)
         table%n_columns = [table%n_columns, table%n_columns]
         table%line = [table%line, table%line]
      end if
      table%n_rows = table%n_rows + 1
      table%value(:, table%n_rows) = values
      table%n_columns(table%n_rows) = n
      table%line(table%n_rows) = line
   end subroutine append_row

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
