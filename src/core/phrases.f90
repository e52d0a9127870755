!> Numbers for people to read: counts, durations, sizes, labelled lines.
module core_phrases
   use core_kinds, only: wp
   use core_text, only: nearest_name, to_text
   implicit none(type, external)
   private
   public :: brief, counted, duration, joined, labelled, numbered, numbers_text, padded, &
             size_text, suggestion

   character(*), parameter :: line_feed = new_line('a')
   integer, parameter :: label_width = 13, line_width = 80

contains

   !> A line of a report: its label in the first column; broken at blanks to a terminal's width.
   pure function labelled(label, text) result(lines)
      character(*), intent(in) :: label, text
      character(:), allocatable :: lines
      integer, parameter :: width = line_width - label_width
      integer :: first, last

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

   !> The label with at least one blank after it.
   pure function padded(text, width)
      character(*), intent(in) :: text
      integer, intent(in) :: width
      character(:), allocatable :: padded

      padded = text//repeat(' ', max(1, width - len(text)))
   end function padded

   !> 'a, b, c'; 'nothing' for an empty list.
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

   !> End of a complaint of a name that is not known: the nearest known one, or else all of them.
   pure function suggestion(name, known) result(text)
      character(*), intent(in) :: name, known(:)
      character(:), allocatable :: text
      character(len(known)) :: nearest

      nearest = nearest_name(name, known)
      text = '; there are '//joined(known)
      if (nearest /= '') text = ', did you mean '//trim(nearest)//'?'
   end function suggestion

   !> A count with its noun: 1 case, 2 cases.
   pure function counted(n, one, many) result(text)
      integer, intent(in) :: n
      character(*), intent(in) :: one, many
      character(:), allocatable :: text

      text = to_text(n)//' '//many
      if (n == 1) text = to_text(n)//' '//one
   end function counted

   !> Name with a number of three digits or more: c007.
   pure function numbered(letter, n) result(text)
      character, intent(in) :: letter
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = to_text(n)
      text = letter//repeat('0', max(0, 3 - len(text)))//text
   end function numbered

   !> The chosen numbers as 'p001 to p003, p005', or '12 processes' if that is long.
   pure function numbers_text(letter, are_meant, many) result(text)
      character, intent(in) :: letter
      logical, intent(in) :: are_meant(:)
      character(*), intent(in) :: many   !! plural of what has the numbers
      character(:), allocatable :: text
      integer, parameter :: longest = 40
      integer :: first, last

      text = ''
      first = 1
      do while (first <= size(are_meant))
         last = first
         if (are_meant(first)) then
            do while (last < size(are_meant))
               if (.not. are_meant(last + 1)) exit
               last = last + 1
            end do
            if (text /= '') text = text//', '
            text = text//numbered(letter, first)
            if (last > first) text = text//' to '//numbered(letter, last)
         end if
         first = last + 1
      end do
      if (len(text) > longest) text = to_text(count(are_meant))//' '//many
   end function numbers_text

   !> A number with three significant digits, without trailing zeros: 2, 0.067, 4.81e8.
   pure function brief(value) result(text)
      real(wp), intent(in) :: value
      character(:), allocatable :: text
      character(16) :: buffer
      real(wp) :: rounded
      integer :: e

      write (buffer, '(es16.2e3)') value
      read (buffer, *) rounded
      text = to_text(rounded)
      e = index(text, 'E')
      if (e == 0) then
         text = without_point(text)
      else if (text(e + 1:e + 1) == '-') then
         text = without_point(text(:e - 1))//'e-'//text(e + 2:)
      else
         text = without_point(text(:e - 1))//'e'//text(e + 2:)
      end if
   end function brief

   pure function without_point(text) result(shorter)
      character(*), intent(in) :: text
      character(:), allocatable :: shorter

      shorter = text
      if (len(text) < 3) return
      if (text(len(text) - 1:) == '.0') shorter = text(:len(text) - 2)
   end function without_point

   !> A duration in seconds, minutes, hours or days.
   pure function duration(seconds) result(text)
      real(wp), intent(in) :: seconds
      character(:), allocatable :: text

      if (seconds < 1.0_wp) then
         text = 'less than 1 s'
      else if (seconds < 120.0_wp) then
         text = brief(seconds)//' s'
      else if (seconds < 7200.0_wp) then
         text = brief(seconds/60.0_wp)//' min'
      else if (seconds < 172800.0_wp) then
         text = brief(seconds/3600.0_wp)//' h'
      else
         text = brief(seconds/86400.0_wp)//' days'
      end if
   end function duration

   !> Bytes in kB, MB or GB.
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

end module core_phrases
