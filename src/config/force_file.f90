!> Reads force histories from text files, and checks force histories from any file.
module config_force_file
   use core_complaints, only: complaint_list
   use core_kinds, only: long, wp
   use core_random, only: label_of
   use core_table, only: read_table, table_type
   use core_text, only: counted, rounded_text, to_text
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   implicit none(type, external)
   private
   public :: check_force, force_label, read_force_text

contains

   !> Reads a text file with one column per force, and optionally the time in front of them.
   subroutine read_force_text(path, n_forces, dt, force, complaints)
      character(*), intent(in) :: path
      integer, intent(in) :: n_forces
      real(wp), intent(in) :: dt   !! step of the time column [s]
      real(wp), allocatable, intent(out) :: force(:, :)   !! (0:n_steps, force) [N]
      type(complaint_list), intent(inout) :: complaints
      type(table_type) :: table
      integer :: n_before, n_columns

      n_before = complaints%n
      call read_table(path, n_forces, n_forces + 1, table, complaints)
      allocate (force(0:table%n_rows - 1, n_forces))
      if (complaints%n > n_before .or. table%n_rows == 0) return
      n_columns = table%n_columns(1)
      call check_rows(table, n_columns, n_forces, dt, complaints)
      force(:, :) = transpose(table%value(n_columns - n_forces + 1:n_columns, :))
   end subroutine read_force_text

   !> Complains of the first row that has not as many columns as the first one, or whose time is not
   !> dt after the one before, to a tenth of dt as times may be rounded.
   subroutine check_rows(table, n_columns, n_forces, dt, complaints)
      type(table_type), intent(in) :: table
      integer, intent(in) :: n_columns, n_forces
      real(wp), intent(in) :: dt   !! [s]
      type(complaint_list), intent(inout) :: complaints
      real(wp), parameter :: tolerance = 0.1_wp   ! largest error of a time, in steps
      real(wp) :: time
      integer :: i

      do i = 1, table%n_rows
         if (table%n_columns(i) /= n_columns) then
            call table%refuse_row(i, 'columns', to_text(table%n_columns(i)), 'must be '// &
                                  to_text(n_columns)//', as on the first line', complaints)
            return
         end if
         if (n_columns == n_forces) cycle
         time = table%value(1, 1) + (i - 1)*dt
         if (abs(table%value(1, i) - time) <= tolerance*dt) cycle
         call table%refuse_row(i, 'time', to_text(table%value(1, i))//', '// &
                               rounded_text(table%value(1, i) - table%value(1, i - 1), 6)// &
                               ' after the one before', &
                               'must be '//rounded_text(time, 12)//', '//to_text(i - 1)// &
                               ' times integration%dt = '//to_text(dt)//' after the first', &
                               complaints)
         return
      end do
   end subroutine check_rows

   !> Checks the force records of a file: number of values and of records, and finite values.
   subroutine check_force(path, force, n_steps, n_forces, n_samples, complaints)
      character(*), intent(in) :: path
      real(wp), intent(in) :: force(0:, :)   !! (step, record) [N]
      integer, intent(in) :: n_steps         !! 0: any number
      integer, intent(in) :: n_forces
      integer, intent(in) :: n_samples       !! samples with their own records; 0: all share one
      type(complaint_list), intent(inout) :: complaints
      integer :: place(2)   ! of the first value that is not finite

      if (size(force, 1) < 2) then
         call complaints%add_general(path//': holds '//counted(size(force, 1), 'value', 'values') &
                                     //': must hold two or more')
      else if (n_steps > 0 .and. size(force, 1, kind=long) /= n_steps + 1_long) then
         call complaints%add_general(path//': holds '//to_text(size(force, 1))// &
                                     ' values: must be integration%n_steps + 1 = '// &
                                     to_text(n_steps + 1_long))
      end if
      associate (held => path//': holds '//counted(size(force, 2), 'record', 'records'))
         if (size(force, 2) < n_forces*n_samples) then
            call complaints%add_general(held//': must be '//to_text(n_forces*n_samples)// &
                                        ', one for each force and sample')
         else if (n_samples == 0 .and. size(force, 2) /= n_forces) then
            call complaints%add_general(held//': must be '//to_text(n_forces)// &
                                        ', one for each force, without excitation%per_sample')
         end if
      end associate
      if (all(ieee_is_finite(force))) return
      place = findloc(ieee_is_finite(force), .false.)
      call complaints%add_general(path//': record '//to_text(place(2))//', step '// &
                                  to_text(place(1) - 1)//': every value must be finite')
   end subroutine check_force

   !> Hash of the values.
   pure function force_label(force) result(label)
      real(wp), intent(in) :: force(:, :)   !! (step, record)
      integer(long) :: label
      integer :: i, j

      label = label_of('force')
      do j = 1, size(force, 2)
         do i = 1, size(force, 1)
            label = label_of(label, force(i, j))
         end do
      end do
   end function force_label

end module config_force_file
