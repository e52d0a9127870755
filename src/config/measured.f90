!> Reads measured values from a text file: one record per line, or one record with a value per line.
!>
!> Lines are as in core_table; `nan` stands for a missing value.
module config_measured
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use core_complaints, only: blank_hint, complaint_list, printable
   use core_kinds, only: wp
   use core_source, only: read_source, source_type
   use core_table, only: data_line, heading_hint, next_word, no_value, number_marks, separate_commas
   use core_text, only: lowered, parse_real, to_text
   use process_estimate, only: measured_record
   implicit none(type, external)
   private
   public :: read_measured

   integer, parameter :: longest_record = 100000   !! largest number of values of a record
   integer, parameter :: most_bytes = 100000000    !! largest size of the file

contains

   !> Reads the records of a file. Complains of a value that is not a number.
   subroutine read_measured(path, records, complaints)
      character(*), intent(in) :: path
      type(measured_record), allocatable, intent(out) :: records(:)
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      real(wp), allocatable :: values(:)   ! all records in sequence
      integer, allocatable :: last(:)      ! (0:record) position of its last value in `values`
      type(source_type) :: source
      integer :: i, n, n_records, number

      call read_source(path, source, refusal, most_bytes)
      if (allocated(refusal)) then
         allocate (records(0))
         call complaints%add_general(path//': '//refusal)
         return
      end if
      allocate (values(64), last(0:source%n_lines()))
      last(0) = 0
      n_records = 0
      do number = 1, source%n_lines()
         n = last(n_records)
         call read_record(path//':'//to_text(number), data_line(source, number, number_marks), &
                          values, n, complaints)
         if (n == last(n_records)) cycle
         n_records = n_records + 1
         last(n_records) = n
      end do
      if (n_records == 0 .and. complaints%n == 0) &
         call complaints%add_general(path//': holds no values')
      if (n_records > 1 .and. last(n_records) == n_records) then
         last(1) = n_records   ! one value per line: a single record
         n_records = 1
      end if
      allocate (records(n_records))
      do i = 1, n_records
         records(i)%value = values(last(i - 1) + 1:last(i))
      end do
   end subroutine read_measured

   !> Appends the values of one line.
   subroutine read_record(place, line, values, n, complaints)
      character(*), intent(in) :: place, line
      real(wp), allocatable, intent(inout) :: values(:)
      integer, intent(inout) :: n   !! number of values in `values`
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: rule, text
      real(wp) :: value
      integer :: first, last, n_before

      text = line
      call separate_commas(text, first, last, rule)
      if (allocated(rule)) then
         if (rule == no_value) rule = rule//'; nan says that none was measured'
         call complaints%add_general(place//': '//printable(line(first:min(last, first + 39)))// &
                                     ': '//rule)
         return
      end if
      n_before = n
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
               rule = rule//', or nan where none was measured'//blank_hint(text(first:last))// &
                      heading_hint(line, rule, number_marks)
               call complaints%add_general(place//': '//printable(text(first:last))//': '//rule)
               exit
            end if
         end if
         if (n - n_before == longest_record) then
            call complaints%add_general(place//': a record has at most '// &
                                        to_text(longest_record)//' values')
            exit
         end if
         if (n == size(values)) values = [values, values]
         n = n + 1
         values(n) = value
      end do
   end subroutine read_record

end module config_measured
