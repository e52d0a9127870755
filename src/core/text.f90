!> Text of numbers and numbers from text, and text of reports: counts, durations, sizes, lists,
!> labelled lines, rows of tables.
module core_text
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: lowered, number_text, parse_integer, parse_real, rounded_text, to_text
   public :: brief, counted, duration, joined, labelled, numbered, numbers_text, padded, &
             rounded_by_error, row_text, set_line_width, shell_word, size_text, with_error

   !> Text of a value in the fewest digits, without blanks: 7, -2.0, 1.5E-9, .true.
   interface to_text
      module procedure text_of_integer, text_of_long, text_of_real, text_of_logical
   end interface to_text

   character(*), parameter, public :: no_number = 'must be a number'   !! rule of parse_real
   character(*), parameter :: digits = '0123456789'
   integer, parameter :: largest_exponent = 100   !! so that products of three values are finite
   character, parameter, public :: line_feed = new_line('a')
   integer, parameter :: label_width = 13, full_width = 80   !! characters, in reports
   integer :: line_width = full_width                        !! less on a narrow terminal

contains

   !> Digits of a whole number.
   pure function text_of_integer(value) result(text)
      integer, intent(in) :: value
      character(:), allocatable :: text

      text = text_of_long(int(value, long))
   end function text_of_integer

   !> Digits of a whole number of 64 bits.
   pure function text_of_long(value) result(text)
      integer(long), intent(in) :: value
      character(:), allocatable :: text
      character(24) :: buffer

      write (buffer, '(i0)') value
      text = trim(buffer)
   end function text_of_long

   !> Fewest digits that read back as the same number; words for infinities and NaNs.
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
      if (index(text, '.') == 1) text = '0'//text
      if (index(text, '-.') == 1) text = '-0'//text(2:)
   end function text_of_real

   !> Text of a number, an integer without a decimal point.
   pure function number_text(value) result(text)
      real(wp), intent(in) :: value
      character(:), allocatable :: text

      if (abs(value) < 1.0e15_wp .and. .not. abs(value - anint(value)) > 0.0_wp) then
         text = to_text(nint(value, long))
      else
         text = to_text(value)
      end if
   end function number_text

   !> Text of a number in so many significant digits.
   pure function rounded_text(value, digits, down) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      logical, intent(in), optional :: down   !! round down, for a limit that can be used as printed
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

   !> Product of a value and 10^power; 10^|power| is exact up to |power| = 22.
   elemental real(wp) function scaled(value, power)
      real(wp), intent(in) :: value
      integer, intent(in) :: power

      if (power < 0) then
         scaled = value/10.0_wp**(-power)
      else
         scaled = value*10.0_wp**power
      end if
   end function scaled

   !> Fortran's constant of a logical.
   pure function text_of_logical(value) result(text)
      logical, intent(in) :: value
      character(:), allocatable :: text

      text = trim(merge('.true. ', '.false.', value))
   end function text_of_logical

   !> Parses digits with an optional sign. `rule` is allocated if the text is not a whole number
   !> from -limit to limit; `value` is then limit if it is a larger one.
   pure subroutine parse_integer(text, limit, value, rule)
      character(*), intent(in) :: text
      integer(long), intent(in) :: limit
      integer(long), intent(out) :: value
      character(:), allocatable, intent(out) :: rule
      integer :: first, status

      value = 0
      first = merge(2, 1, scan(text, '+-') == 1)   ! after an optional sign
      if (first > len(text) .or. verify(text(first:), digits) /= 0) then
         rule = 'must be a whole number'
         return
      end if
      read (text, *, iostat=status) value
      if (status == 0 .and. value >= -limit .and. value <= limit) return
      rule = 'must be from -'//to_text(limit)//' to '//to_text(limit)
      value = limit
   end subroutine parse_integer

   !> Parses a decimal number, with an optional exponent after e, d or q; `rule` is allocated if the
   !> text is no such number or is out of range.
   pure subroutine parse_real(text, value, rule)
      character(*), intent(in) :: text
      real(wp), intent(out) :: value
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: mantissa, decimal
      integer :: first, letter, point, exponent, leading, status

      value = 0.0_wp
      first = merge(2, 1, scan(text, '+-') == 1)   ! after an optional sign
      letter = scan(text, 'eEdDqQ')
      if (letter == 0) letter = len(text) + 1
      mantissa = text(min(first, len(text) + 1):letter - 1)
      if (verify(mantissa, digits//'.') /= 0 .or. scan(mantissa, digits) == 0 .or. &
          index(mantissa, '.') /= index(mantissa, '.', back=.true.)) then
         select case (lowered(text(min(first, len(text) + 1):)))
         case ('nan', 'inf', 'infinity')
            rule = 'must be finite'
         case default
            rule = no_number
         end select
         return
      end if
      call parse_exponent(text(letter:), exponent, rule)
      if (allocated(rule)) return

      leading = scan(mantissa, '123456789')
      if (leading == 0) return
      point = index(mantissa, '.')
      if (point == 0) point = len(mantissa) + 1
      if (abs(exponent + point - leading - merge(1, 0, point > leading)) <= largest_exponent) then
         decimal = text(:letter - 1)//'e'//to_text(exponent)
         read (decimal, *, iostat=status) value
         if (status /= 0) rule = no_number
         if (status /= 0 .or. abs(value) <= 1.0e100_wp) return
      end if
      rule = 'must be zero or of a magnitude from 1e-100 to 1e100'
   end subroutine parse_real

   !> Parses the exponent of a number: a letter and a whole number, or nothing.
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
      rule = no_number
      if (value == limit) deallocate (rule)   ! out of range, whatever the sign
   end subroutine parse_exponent

   !> Text in lower case.
   pure function lowered(text)
      character(*), intent(in) :: text
      character(len(text)) :: lowered
      integer :: i

      lowered = text
      do i = 1, len(text)
         if (text(i:i) >= 'A' .and. text(i:i) <= 'Z') lowered(i:i) = achar(iachar(text(i:i)) + 32)
      end do
   end function lowered

   !> Line of a report: a label, then a text, broken at blanks to a terminal's width.
   pure function labelled(label, text) result(lines)
      character(*), intent(in) :: label, text
      character(:), allocatable :: lines
      integer :: first, last, width

      width = line_width - label_width
      lines = padded(label, label_width)
      first = 1
      do while (len(text) - first >= width)
         last = first - 1 + index(text(first:first + width), ' ', back=.true.)
         if (last < first) exit
         lines = lines//text(first:last - 1)//line_feed//repeat(' ', label_width)
         first = last + 1
      end do
      lines = lines//text(first:)//line_feed
   end function labelled

   !> Sets the width of labelled lines for a terminal: 80 columns at most, 40 at least.
   subroutine set_line_width(columns)
      integer, intent(in) :: columns

      line_width = min(max(columns, full_width/2), full_width)
   end subroutine set_line_width

   !> Row of a table, with a line feed: each cell fills the width of its column.
   pure function row_text(columns, cells) result(text)
      character(*), intent(in) :: columns   !! names, filled to the widths of the columns, between |
      character(*), intent(in) :: cells     !! texts between |
      character(:), allocatable :: names, rest, text
      integer :: width   ! of the columns so far

      text = ''
      width = 0
      names = columns//'|'
      rest = cells//'|'
      do while (len(names) > 0)
         width = width + index(names, '|') - 1
         text = padded(text//trim(rest(:index(rest, '|') - 1)), width)
         names = names(index(names, '|') + 1:)
         rest = rest(index(rest, '|') + 1:)
      end do
      text = trim(text)//line_feed
   end function row_text

   !> Text filled with blanks to a width, at least one.
   pure function padded(text, width)
      character(*), intent(in) :: text
      integer, intent(in) :: width
      character(:), allocatable :: padded

      padded = text//repeat(' ', max(1, width - len(text)))
   end function padded

   !> List of names such as 'a, b, c'; 'nothing' for an empty one.
   pure function joined(names) result(text)
      character(*), intent(in) :: names(:)
      character(:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(names)
         if (i > 1) text = text//', '
         text = text//trim(names(i))
      end do
      if (text == '') text = 'nothing'
   end function joined

   !> Path as a word of a shell command, quoted if it has blanks or other special characters.
   pure function shell_word(path) result(word)
      character(*), intent(in) :: path
      character(:), allocatable :: word
      character(*), parameter :: quote = "'", signs = ' !"#$&()*;<>?[]^`{|}~'//quote//'\'
      integer :: i

      word = path
      if (scan(path, signs) == 0) return
      word = quote
      do i = 1, len(path)
         if (path(i:i) == quote) word = word//quote//'\'//quote   ! ends the quotes for one sign
         word = word//path(i:i)
      end do
      word = word//quote
   end function shell_word

   !> Count with its noun: '1 case', '2 cases'.
   pure function counted(n, one, many) result(text)
      integer, intent(in) :: n
      character(*), intent(in) :: one, many
      character(:), allocatable :: text

      text = to_text(n)//' '//many
      if (n == 1) text = to_text(n)//' '//one
   end function counted

   !> Letter with a number of at least three digits, such as 'c007'.
   pure function numbered(letter, n) result(text)
      character, intent(in) :: letter
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = to_text(n)
      text = letter//repeat('0', max(0, 3 - len(text)))//text
   end function numbered

   !> List of the chosen numbers such as 'p001 to p003, p005', or '12 processes' if that is long.
   pure function numbers_text(letter, is_chosen, many) result(text)
      character, intent(in) :: letter
      logical, intent(in) :: is_chosen(:)
      character(*), intent(in) :: many   !! plural of the numbered things
      character(:), allocatable :: text
      integer, parameter :: longest = 40
      integer :: first, last

      text = ''
      first = 1
      do while (first <= size(is_chosen))
         last = first
         if (is_chosen(first)) then
            do while (last < size(is_chosen))
               if (.not. is_chosen(last + 1)) exit
               last = last + 1
            end do
            if (text /= '') text = text//', '
            text = text//numbered(letter, first)
            if (last > first) text = text//' to '//numbered(letter, last)
         end if
         first = last + 1
      end do
      if (len(text) > longest) text = to_text(count(is_chosen))//' '//many
   end function numbers_text

   !> Text of a number in three significant digits, without trailing zeros: 2, 0.067, 4.81e8.
   pure function brief(value) result(text)
      real(wp), intent(in) :: value
      character(:), allocatable :: text
      character(:), allocatable :: exponent
      character(16) :: buffer
      real(wp) :: rounded
      integer :: e

      write (buffer, '(es16.2e3)') value
      read (buffer, *) rounded
      text = to_text(rounded)
      e = index(text//'E', 'E')
      exponent = lowered(text(e:))
      if (index(exponent, '+') == 2) exponent = 'e'//exponent(3:)
      text = text(:e - 1)
      if (index(text//' ', '.0 ') > 0) text = text(:e - 3)
      text = text//exponent
   end function brief

   !> Text of a value in as many digits as its standard error leaves: two of the error, three of the
   !> value at least, nine at most.
   pure function rounded_by_error(value, error) result(text)
      real(wp), intent(in) :: value, error
      character(:), allocatable :: text
      integer :: digits

      digits = 3
      if (error > 0.0_wp) &
         digits = 2 + floor(log10(max(abs(value), error))) - floor(log10(error))
      text = lowered(rounded_text(value, max(3, min(digits, 9))))
   end function rounded_by_error

   !> Text 'value+-standard error', the error in two digits.
   pure function with_error(value, error) result(text)
      real(wp), intent(in) :: value, error
      character(:), allocatable :: text

      text = rounded_by_error(value, error)//'+-'//lowered(rounded_text(error, 2))
   end function with_error

   !> Text of a duration in seconds, minutes, hours or days.
   pure function duration(seconds) result(text)
      real(wp), intent(in) :: seconds
      character(:), allocatable :: text

      if (seconds < 120.0_wp) then
         text = brief(seconds)//' s'
      else if (seconds < 7200.0_wp) then
         text = brief(seconds/60.0_wp)//' min'
      else if (seconds < 172800.0_wp) then
         text = brief(seconds/3600.0_wp)//' h'
      else
         text = brief(seconds/86400.0_wp)//' days'
      end if
   end function duration

   !> Text of a size in kB, MB or GB.
   pure function size_text(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(:), allocatable :: text

      if (bytes < 1.0e6_wp) then
         text = brief(bytes/1.0e3_wp)//' kB'
      else if (bytes < 1.0e9_wp) then
         text = brief(bytes/1.0e6_wp)//' MB'
      else
         text = brief(bytes/1.0e9_wp)//' GB'
      end if
   end function size_text

end module core_text
