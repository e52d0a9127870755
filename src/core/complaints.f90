!> Complaints about a scene and its files, in the order of their lines, each with its line and a
!> caret below the offending character; the nearest known name of a misspelt one.
module core_complaints
   use core_kinds, only: long
   use core_source, only: source_type
   use core_text, only: joined, line_feed, lowered, to_text
   implicit none(type, external)
   private
   public :: blank_hint, complaint_list, nearest_name, printable, suggestion

   integer, parameter :: max_kept = 200          !! complaints that are shown; others are counted
   integer, parameter :: window = 76             !! bytes of a line that are shown
   integer, parameter :: longest_character = 4   !! bytes of a character in UTF-8
   integer(long), parameter :: line_places = 2_long**25     !! more than a line has columns
   integer(long), parameter :: option_places = 2_long**61   !! more than a file has places
   integer, parameter :: tab = 9, first_printable = 32, delete = 127, first_continuation = 128, &
                         last_continuation = 191

   type :: complaint_type
      integer(long) :: place = huge(1_long)   !! ascends through the file, then the --set options
      character(:), allocatable :: text
   end type complaint_type

   !> Complaints in the order of their places.
   type :: complaint_list
      integer :: n = 0                              !! number of complaints
      character(:), allocatable :: text             !! text of all to be printed; unallocated: none
      type(complaint_type), allocatable, private :: kept(:)
      character(:), allocatable, private :: shown   !! text of `kept`, each with a line feed
   contains
      procedure :: add
      procedure :: add_general
      procedure, private :: keep
   end type complaint_list

contains

   !> Adds a complaint `file:line: message` about the character in a column.
   subroutine add(self, source, line, column, message)
      class(complaint_list), intent(inout) :: self
      type(source_type), intent(in) :: source
      integer, intent(in) :: line, column
      character(*), intent(in) :: message
      type(complaint_type) :: complaint

      complaint%place = merge(option_places, 0_long, source%name == '--set') + line*line_places &
                        + column
      complaint%text = source%name//':'//to_text(line)//': '//message// &
                       excerpt(source%line(line), column)
      call self%keep(complaint)
   end subroutine add

   !> Adds a complaint without a line, for instance about a file that cannot be opened.
   subroutine add_general(self, message)
      class(complaint_list), intent(inout) :: self
      character(*), intent(in) :: message
      type(complaint_type) :: complaint

      complaint%text = message
      call self%keep(complaint)
   end subroutine add_general

   !> Inserts a complaint in the order of lines, after those of its own line, and renews the text.
   subroutine keep(self, complaint)
      class(complaint_list), intent(inout) :: self
      type(complaint_type), intent(in) :: complaint
      integer :: i

      self%n = self%n + 1
      if (.not. allocated(self%kept)) allocate (self%kept(0))
      if (size(self%kept) == max_kept) then
         self%text = self%shown//'... and '//to_text(self%n - max_kept)//' more'
         return
      end if
      i = count(self%kept%place <= complaint%place)
      self%kept = [self%kept(:i), complaint, self%kept(i + 1:)]
      self%shown = ''
      do i = 1, size(self%kept)
         self%shown = self%shown//self%kept(i)%text//line_feed
      end do
      self%text = self%shown(:len(self%shown) - 1)
   end subroutine keep

   !> Line of a source with a caret below the column; a long line is cut around the column.
   pure function excerpt(line, column) result(text)
      character(*), intent(in) :: line
      integer, intent(in) :: column
      character(:), allocatable :: text
      integer :: first, last, i, blanks

      first = max(1, column - window/2)
      if (column <= window) first = 1
      last = min(len(line), first + window - 1)
      do i = 1, longest_character - 1   ! no UTF-8 character is cut in two
         if (is_continuation(line(first:first))) first = min(first + 1, column)
         if (last == len(line)) cycle
         if (is_continuation(line(last + 1:last + 1))) last = last - 1
      end do
      blanks = 0
      do i = first, min(column - 1, last)
         if (.not. is_continuation(line(i:i))) blanks = blanks + 1
      end do
      text = line_feed//'   | '//printable(line(first:last))//line_feed//'   | '// &
             repeat(' ', blanks)//'^'
   end function excerpt

   !> Text with its control characters replaced, so that a hostile line cannot control the terminal.
   pure function printable(text) result(clean)
      character(*), intent(in) :: text
      character(:), allocatable :: clean
      integer :: i, code

      clean = text
      do i = 1, len(text)
         code = iachar(text(i:i))
         if (code == tab) then
            clean(i:i) = ' '
         else if (code < first_printable .or. code == delete) then
            clean(i:i) = '?'
         end if
      end do
      if (len(clean) > 0) then
         if (text(len(text):) == achar(13)) clean = clean(:len(clean) - 1)
      end if
   end function printable

   !> Hint if a word without quotes has a non-breaking space, which looks like a blank; else empty.
   pure function blank_hint(word) result(hint)
      character(*), intent(in) :: word
      character(:), allocatable :: hint
      character(*), parameter :: utf8 = char(194)//char(160), latin1 = char(160)

      hint = ''
      if (scan(word, '''"') == 1) return
      if (index(word, utf8) > 0 .or. index(word, latin1) == 1) &
         hint = ' (it holds a non-breaking space, U+00A0: type a plain blank)'
   end function blank_hint

   !> End of a complaint about an unknown name: the nearest known name, or else all of them.
   pure function suggestion(name, known) result(text)
      character(*), intent(in) :: name, known(:)
      character(:), allocatable :: text

      text = ', did you mean '//trim(nearest_name(name, known))//'?'
      if (nearest_name(name, known) == '') text = '; there are '//joined(known)
   end function suggestion

   !> Known name nearest to a misspelt one, whatever the case; blank if more than a third of the
   !> letters differ.
   pure function nearest_name(name, known) result(nearest)
      character(*), intent(in) :: name
      character(*), intent(in) :: known(:)
      character(len(known)) :: nearest
      integer :: i, distance, least

      nearest = ''
      if (len(name) > len(known)) return
      least = max(1, len(name)/3) + 1
      do i = 1, size(known)
         distance = edit_distance(lowered(name), lowered(trim(known(i))))
         if (distance >= least) cycle
         least = distance
         nearest = known(i)
      end do
   end function nearest_name

   !> Number of letters to insert, delete, replace or swap with a neighbour between two names.
   pure integer function edit_distance(a, b) result(distance)
      character(*), intent(in) :: a, b
      integer :: d(0:len(a), 0:len(b)), i, j

      d(:, 0) = [(i, i=0, len(a))]
      d(0, :) = [(j, j=0, len(b))]
      do j = 1, len(b)
         do i = 1, len(a)
            d(i, j) = min(d(i - 1, j) + 1, d(i, j - 1) + 1, &
                          d(i - 1, j - 1) + merge(0, 1, a(i:i) == b(j:j)))
            if (i > 1 .and. j > 1) then
               if (a(i:i) == b(j - 1:j - 1) .and. a(i - 1:i - 1) == b(j:j)) &
                  d(i, j) = min(d(i, j), d(max(i, 2) - 2, max(j, 2) - 2) + 1)
            end if
         end do
      end do
      distance = d(len(a), len(b))
   end function edit_distance

   !> True if a byte continues a UTF-8 character, and so needs no column on the screen.
   elemental logical function is_continuation(byte)
      character, intent(in) :: byte

      is_continuation = ichar(byte) >= first_continuation .and. ichar(byte) <= last_continuation
   end function is_continuation

end module core_complaints
