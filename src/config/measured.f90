!> Measured values in a text file: one record a line, or one value a line and then one record.
!>
!> Values stand between blanks or commas, but 0,3 is refused; `nan` is a gap. The rest of a
!> line behind # is a comment.
module config_measured
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use core_complaints, only: complaint_list, printable
   use core_kinds, only: wp
   use core_numbers, only: parse_real
   use core_source, only: read_source, source_type
   use core_spelling, only: lowered
   use core_table, only: next_word
   use core_text, only: to_text
   use process_estimate, only: measured_record
   implicit none(type, external)
   private
   public :: read_measured

   integer, parameter :: longest_record = 100000   !! values on one line
   integer, parameter :: most_bytes = 100000000    !! size of the file

contains

   !> Reads the records of a file; a value that is no number is a complaint.
   subroutine read_measured(path, records, complaints)
      character(*), intent(in) :: path
      type(measured_record), allocatable, intent(out) :: records(:)
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: line, refusal
      real(wp), allocatable :: value(:)
      type(measured_record) :: record
      type(source_type) :: source
      integer :: i, number

      allocate (records(0))
      call read_source(path, source, refusal, most_bytes)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
         return
      end if
      do number = 1, source%n_lines()
         line = source%line(number)
         i = index(line, '#')
         if (i > 0) line = line(:i - 1)
         call read_record(path//':'//to_text(number), line, record%value, complaints)
         if (size(record%value) > 0) records = [records, record]
      end do
      if (size(records) == 0 .and. complaints%n == 0) &
         call complaints%add_general(path//': holds no values')
      if (size(records) < 2) return
      if (any([(size(records(i)%value) > 1, i=1, size(records))])) return
      value = [(records(i)%value(1), i=1, size(records))]   ! a column is one line of joints
      deallocate (records)
      allocate (records(1))
      records(1)%value = value
   end subroutine read_measured

   !> Reads the values of one line.
   subroutine read_record(place, line, values, complaints)
      character(*), intent(in) :: place, line
      real(wp), allocatable, intent(out) :: values(:)
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: rule, text
      real(wp) :: value
      integer :: first, i, last, n

      allocate (values(64))
      call find_decimal_comma(line, first, last)
      if (first <= last) then
         values = values(:0)
         call complaints%add_general(place//': '//printable(line(first:min(last, first + 39)))// &
                                     ': decimals follow a point; a comma between values has a '// &
                                     'blank behind it')
         return
      end if
      text = line
      do i = 1, len(text)
         if (text(i:i) == ',') text(i:i) = ' '
      end do
      n = 0
      last = 0
      do
         call next_word(text, first, last)
         if (first > last) exit
         if (lowered(text(first:last)) == 'nan') then
            value = ieee_value(value, ieee_quiet_nan)
         else
            call parse_real(text(first:last), value, rule)
            if (allocated(rule)) then
               last = min(last, first + 39)
               call complaints%add_general(place//': '//printable(text(first:last))//': '//rule &
                                           //', or nan where none was measured')
               exit
            end if
         end if
         if (n == longest_record) then
            call complaints%add_general(place//': a record has at most '// &
                                        to_text(longest_record)//' values')
            exit
         end if
         if (n == size(values)) values = [values, values]
         n = n + 1
         values(n) = value
      end do
      values = values(:n)
   end subroutine read_record

   !> Finds a word such as 0,3: digits with one comma among them; first > last: there is none.
   pure subroutine find_decimal_comma(line, first, last)
      character(*), intent(in) :: line
      integer, intent(out) :: first, last
      integer :: comma

      last = 0
      do
         call next_word(line, first, last)
         if (first > last) return
         associate (word => line(first:last))
            comma = index(word, ',')
            if (comma > 1 .and. comma < len(word) .and. comma == index(word, ',', back=.true.) &
                .and. verify(word, '+-0123456789,') == 0) return
         end associate
      end do
   end subroutine find_decimal_comma

end module config_measured
