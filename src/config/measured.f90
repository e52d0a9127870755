!> Reads measured values from a text file: one record per line, or one record with a value per line.
!>
!> Lines are as in core_table; `nan` stands for a missing value.
module config_measured
   use core_complaints, only: complaint_list
   use core_kinds, only: wp
   use core_source, only: read_source, source_type
   use core_table, only: number_marks, parse_line
   use process_estimate, only: measured_record
   implicit none(type, external)
   private
   public :: read_measured

   integer, parameter :: longest_record = 100000   !! largest number of values on a line
   integer, parameter :: most_bytes = 100000000    !! largest size of the file

contains

   !> Reads the records of a file. Complains of a value that is not a number.
   subroutine read_measured(path, records, complaints)
      character(*), intent(in) :: path
      type(measured_record), allocatable, intent(out) :: records(:)
      type(complaint_list), intent(inout) :: complaints
      character(:), allocatable :: refusal
      type(source_type) :: source
      real(wp), allocatable :: values(:)
      integer :: i, n, n_bad, n_records, number

      call read_source(path, source, refusal, most_bytes)
      if (allocated(refusal)) then
         call complaints%add_general(path//': '//refusal)
         return
      end if
      allocate (values(longest_record), records(source%n_lines()))
      n_bad = 0
      n_records = 0
      do number = 1, source%n_lines()
         call parse_line(source, number, number_marks, 1, .true., values, n, n_bad, complaints)
         if (n == 0) cycle
         n_records = n_records + 1
         records(n_records)%value = values(:n)
      end do
      if (n_records == 0 .and. complaints%n == 0) &
         call complaints%add_general(path//': holds no values')
      records = records(:n_records)
      if (n_records > 1 .and. all([(size(records(i)%value) == 1, i=1, n_records)])) &
         records = [measured_record([(records(i)%value(1), i=1, n_records)])]
   end subroutine read_measured

end module config_measured
