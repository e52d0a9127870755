!> Numbers in their shortest form, for messages.
module core_text
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: rounded_text, to_text

   !> Shortest usual form of a value, without blanks: 7, -2.0, 1.5E-9, T.
   interface to_text
      module procedure text_of_integer, text_of_long, text_of_real, text_of_logical
   end interface to_text

contains

   pure function text_of_integer(value) result(text)
      integer, intent(in) :: value
      character(:), allocatable :: text

      text = text_of_long(int(value, long))
   end function text_of_integer

   pure function text_of_long(value) result(text)
      integer(long), intent(in) :: value
      character(:), allocatable :: text
      character(24) :: buffer

      write (buffer, '(i0)') value
      text = trim(buffer)
   end function text_of_long

   !> A number in the fewest digits that read back as the same number; nan and inf as words.
   pure function text_of_real(value) result(text)
      real(wp), intent(in) :: value
      character(:), allocatable :: text
      character(32) :: buffer
      character(12) :: format
      real(wp) :: back
      integer :: digits, status
      logical :: is_plain

      is_plain = abs(value) >= 1.0e-3_wp .and. abs(value) < 1.0e6_wp .or. .not. abs(value) > 0.0_wp
      do digits = 1, 17
         write (format, '(a, i0, a)') trim(merge('(f0. ', '(es0.', is_plain)), &
            max(digits - 1, 1), ')'
         write (buffer, format) value
         read (buffer, *, iostat=status) back
         if (status /= 0 .or. .not. abs(back - value) > 0.0_wp) exit
      end do
      text = trim(adjustl(buffer))
      if (text(1:1) == '.') text = '0'//text
      if (len(text) > 1) then
         if (text(1:2) == '-.') text = '-0'//text(2:)
      end if
   end function text_of_real

   !> A number in `digits` digits. With `down` it is rounded down, so that a limit can be used as
   !> printed.
   pure function rounded_text(value, digits, down) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      logical, intent(in), optional :: down
      character(:), allocatable :: text
      real(wp) :: whole
      integer :: decimals
      logical :: cuts_off

      text = to_text(value)
      if (.not. (abs(value) > 0.0_wp .and. abs(value) <= huge(value))) return
      cuts_off = .false.
      if (present(down)) cuts_off = down
      decimals = digits - 1 - floor(log10(abs(value)))
      whole = scaled(value, decimals)
      whole = merge(real(floor(whole, long), wp), anint(whole), cuts_off)
      text = to_text(scaled(whole, -decimals))
   end function rounded_text

   !> value times 10^power; 10^|power| is exact to |power| = 22.
   elemental real(wp) function scaled(value, power)
      real(wp), intent(in) :: value
      integer, intent(in) :: power

      if (power < 0) then
         scaled = value/10.0_wp**(-power)
      else
         scaled = value*10.0_wp**power
      end if
   end function scaled

   pure function text_of_logical(value) result(text)
      logical, intent(in) :: value
      character(:), allocatable :: text

      text = trim(merge('.true. ', '.false.', value))
   end function text_of_logical

end module core_text
