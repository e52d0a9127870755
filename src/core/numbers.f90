!> Numbers in text. Text that is not exactly a number of the wanted type is refused, with the rule
!> that it breaks.
module core_numbers
   use core_kinds, only: long, wp
   use core_spelling, only: lowered
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: parse_integer, parse_real

   character(*), parameter :: digits = '0123456789'
   integer, parameter :: largest_exponent = 100   !! of ten: products of a few values stay in range

contains

   !> Parses digits with an optional sign; `rule` is allocated when the text is not a whole number
   !> from -limit to limit. The value of one beyond them is limit.
   pure subroutine parse_integer(text, limit, value, rule)
      character(*), intent(in) :: text
      integer(long), intent(in) :: limit
      integer(long), intent(out) :: value
      character(:), allocatable, intent(out) :: rule
      integer :: first, i
      integer(long) :: digit

      value = 0
      first = after_sign(text)
      if (first > len(text) .or. verify(text(first:), digits) /= 0) then
         rule = 'must be a whole number'
         return
      end if
      do i = first, len(text)
         digit = iachar(text(i:i)) - iachar('0')
         if (value > (limit - digit)/10) then
            rule = 'must be from -'//to_text(limit)//' to '//to_text(limit)
            value = limit
            return
         end if
         value = 10*value + digit
      end do
      if (text(1:1) == '-') value = -value
   end subroutine parse_integer

   !> Reads a finite decimal number, with an exponent after e or d.
   pure subroutine parse_real(text, value, rule)
      character(*), intent(in) :: text
      real(wp), intent(out) :: value
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: mantissa, decimal
      integer :: first, letter, point, exponent, leading, status

      value = 0.0_wp
      first = after_sign(text)
      letter = scan(text, 'eEdDqQ')
      if (letter == 0) letter = len(text) + 1
      mantissa = text(min(first, len(text) + 1):letter - 1)
      if (verify(mantissa, digits//'.') /= 0 .or. scan(mantissa, digits) == 0 .or. &
          index(mantissa, '.') /= index(mantissa, '.', back=.true.)) then
         select case (lowered(text(min(first, len(text) + 1):)))
         case ('nan', 'inf', 'infinity')
            rule = 'must be finite'
         case default
            rule = 'must be a number'
         end select
         return
      end if
      call parse_exponent(text(letter:), exponent, rule)
      if (allocated(rule)) return

      leading = scan(mantissa, '123456789')
      if (leading == 0) return
      point = index(mantissa, '.')
      if (point == 0) point = len(mantissa) + 1
      if (abs(exponent + point - leading) > largest_exponent) then
         rule = 'must be zero or of a magnitude from 1e-100 to 1e100'
         return
      end if
      decimal = text(:letter - 1)//'e'//to_text(exponent)
      read (decimal, *, iostat=status) value
      if (status /= 0) rule = 'must be a number'
   end subroutine parse_real

   !> Parses the exponent after the mantissa: nothing, or a letter and a whole number.
   pure subroutine parse_exponent(text, exponent, rule)
      character(*), intent(in) :: text
      integer, intent(out) :: exponent
      character(:), allocatable, intent(out) :: rule
      integer(long), parameter :: limit = 1000000_long
      integer(long) :: value

      exponent = 0
      if (len(text) == 0) return
      call parse_integer(text(2:), limit, value, rule)
      exponent = int(value)
      if (.not. allocated(rule)) return
      if (value == limit) then   ! out of range, whatever the sign
         deallocate (rule)
      else
         rule = 'must be a number'
      end if
   end subroutine parse_exponent

   pure integer function after_sign(text)
      character(*), intent(in) :: text

      after_sign = 1
      if (scan(text, '+-') == 1) after_sign = 2
   end function after_sign

end module core_numbers
