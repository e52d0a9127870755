!> Force histories of the user's own: text files, and the rules that any history must keep.
module config_force_file
   use core_complaints, only: complaint_list, printable
   use core_kinds, only: long, wp
   use core_numbers, only: parse_real
   use core_random, only: label_of
   use core_source, only: try_file
   use core_text, only: to_text
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   implicit none(type, external)
   private
   public :: check_force, force_label, is_hdf5_file, read_force_text

   integer, parameter :: max_shown = 10   !! bad lines that are named one by one
   character(*), parameter :: blanks = ' '//achar(9)//achar(13)

contains

   !> Does the file begin as HDF5 does? Any other is taken for text.
   logical function is_hdf5_file(path)
      character(*), intent(in) :: path
      character(8) :: signature
      integer :: unit, status

      is_hdf5_file = .false.
      open (newunit=unit, file=path, access='stream', form='unformatted', action='read', &
            status='old', iostat=status)
      if (status /= 0) return
      read (unit, iostat=status) signature
      if (status == 0) is_hdf5_file = &
         signature == char(137)//'HDF'//achar(13)//achar(10)//achar(26)//achar(10)
      close (unit, iostat=status)
   end function is_hdf5_file

   !> One value a line; what follows a # is a comment. Every bad line is a complaint.
   subroutine read_force_text(path, force, complaints)
      character(*), intent(in) :: path
      real(wp), allocatable, intent(out) :: force(:)   !! (step), from 0 [N]
      type(complaint_list), intent(inout) :: complaints
      character(256) :: line, reason
      character(:), allocatable :: rule
      integer(long) :: size_in_bytes
      real(wp) :: value
      integer :: unit, status, number, n, n_bad
      logical :: has_value

      allocate (force(1024))
      n = 0
      n_bad = 0
      number = 0
      call try_file(path, size_in_bytes, rule)
      if (allocated(rule)) then
         call complaints%add_general(path//': '//rule)
         return
      end if
      open (newunit=unit, file=path, action='read', status='old', iostat=status, iomsg=reason)
      do while (status == 0)
         read (unit, '(a)', iostat=status, iomsg=reason) line
         if (status /= 0) exit
         number = number + 1
         call parse_line(line, has_value, value, rule)
         if (allocated(rule)) then
            n_bad = n_bad + 1
            if (n_bad <= max_shown) call complaints%add_general( &
               path//':'//to_text(number)//': '//printable(trim(line(:40)))//': '//rule)
         else if (has_value) then
            if (n == size(force)) force = [force, spread(0.0_wp, 1, n)]
            n = n + 1
            force(n) = value
         end if
      end do
      if (.not. is_iostat_end(status)) &
         call complaints%add_general(path//': cannot be read: '//trim(reason))
      close (unit, iostat=status)
      if (n_bad > max_shown) &
         call complaints%add_general(path//': '//to_text(n_bad - max_shown)//' more bad lines')
      force = force(:n)
   end subroutine read_force_text

   !> The value of a line, where it has one; `rule` is allocated when the line is bad.
   pure subroutine parse_line(line, has_value, value, rule)
      character(*), intent(in) :: line
      logical, intent(out) :: has_value
      real(wp), intent(out) :: value
      character(:), allocatable, intent(out) :: rule
      integer :: first, last

      value = 0.0_wp
      last = index(line, '#') - 1
      if (last < 0) last = len(line)
      first = verify(line(:last), blanks)
      has_value = first > 0
      if (.not. has_value) return
      last = verify(line(:last), blanks, back=.true.)
      if (scan(line(first:last), blanks//',;') > 0) then
         rule = 'must be one value'
      else if (last == len(line)) then
         rule = 'the line is too long'
      else
         call parse_real(line(first:last), value, rule)
      end if
   end subroutine parse_line

   !> The rules of a history, whatever file it comes from: enough finite values, enough records.
   subroutine check_force(path, force, n_steps, n_records, complaints)
      character(*), intent(in) :: path
      real(wp), intent(in) :: force(0:, :)   !! (step, record) [N]
      integer, intent(in) :: n_steps         !! 0: as many as there are
      integer, intent(in) :: n_records       !! that are needed
      type(complaint_list), intent(inout) :: complaints

      if (size(force, 1) < 2) then
         call complaints%add_general(path//': must hold at least two values')
      else if (n_steps > 0 .and. size(force, 1, kind=long) /= n_steps + 1_long) then
         call complaints%add_general(path//': holds '//to_text(size(force, 1))// &
                                     ' values: must be integration%n_steps + 1 = '// &
                                     to_text(n_steps + 1_long))
      end if
      if (size(force, 2) < n_records) &
         call complaints%add_general(path//': holds '//to_text(size(force, 2))// &
                                     ' records: must be one per sample, '//to_text(n_records))
      if (.not. all(ieee_is_finite(force))) &
         call complaints%add_general(path//': every value must be finite')
   end subroutine check_force

   !> Fingerprint of the values.
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
