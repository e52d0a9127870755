!> Splits namelist text into tokens with their places.
module config_text_tokens
   use core_kinds, only: long
   use core_source, only: source_type
   use core_text, only: line_feed, lowered, parse_integer
   implicit none(type, external)
   private
   public :: token_type, tokenize
   public :: token_word, token_name, token_quoted, token_open_quote, token_comma, token_index, &
             token_group, token_end

   integer, parameter :: token_none = 0         !! blank or comment
   integer, parameter :: token_word = 1         !! value without quotes: a number, .true.
   integer, parameter :: token_name = 2         !! word before '=', or before an index and '='
   integer, parameter :: token_quoted = 3       !! 'text' with its quotes
   integer, parameter :: token_open_quote = 4   !! quote that is not closed on its line
   integer, parameter :: token_equals = 5, token_comma = 6
   integer, parameter :: token_index = 7        !! (i) or (i:j), with any text in the parentheses
   integer, parameter :: token_group = 8        !! &name
   integer, parameter :: token_end = 9          !! '/' or &end
   integer, parameter :: token_stray = 10       !! unpaired parenthesis

   integer, parameter :: most_repeats = 1000000   !! limit of r in r*value; no list is that long
   character(*), parameter :: quotes = '''"', &
                        blanks = ' '//achar(9)//achar(11)//achar(12)//achar(13)//line_feed

   !> A token; its text is source%text(first:last).
   type :: token_type
      integer :: kind = token_word
      integer :: source = 1     !! 1: the scene file, 2: the --set options
      integer :: line = 1
      integer :: first = 1, last = 0
      integer :: start = 1      !! first character with a preceding r*; without one equal to first
      integer :: repeat = 1     !! r in r*value
   end type token_type

contains

   !> Splits a part of a source into tokens. In --set options `/`, `!` and `&` are ordinary
   !> characters.
   pure subroutine tokenize(source, number, line, first, last, tokens)
      type(source_type), intent(in) :: source
      integer, intent(in) :: number        !! 1: the scene file, 2: the --set options
      integer, intent(in) :: line          !! line of the first character
      integer, intent(in) :: first, last   !! range of characters in source%text
      type(token_type), allocatable, intent(out) :: tokens(:)
      type(token_type) :: token
      integer :: line_here, n, position

      n = 0
      allocate (tokens(64))
      line_here = line
      position = first
      do while (position <= last)
         token = token_type(source=number, line=line_here, first=position, last=position, &
                            start=position)
         if (source%text(position:position) == line_feed) line_here = line_here + 1
         call classify(source%text(:last), number == 1, token)
         position = token%last + 1
         if (token%kind == token_none) cycle
         if (token%kind == token_equals) call mark_name(tokens(:n))
         if (n == size(tokens)) tokens = [tokens, tokens]
         n = n + 1
         tokens(n) = token
      end do
      tokens = tokens(:n)
   end subroutine tokenize

   !> Marks the word before '=', or before an index and '=', as a name.
   pure subroutine mark_name(before)
      type(token_type), intent(inout) :: before(:)   !! all tokens before '='
      integer :: i

      i = size(before)
      if (i > 1) i = i - merge(1, 0, before(i)%kind == token_index)
      if (i < 1) return
      if (before(i)%kind == token_word) before(i)%kind = token_name
   end subroutine mark_name

   !> Finds the kind and the end of the token that begins at token%first.
   pure subroutine classify(text, is_file, token)
      character(*), intent(in) :: text
      logical, intent(in) :: is_file
      type(token_type), intent(inout) :: token
      character :: begin
      integer :: length

      begin = text(token%first:token%first)
      if (index(blanks, begin) > 0) then
         token%kind = token_none
      else if (begin == '=') then
         token%kind = token_equals
      else if (begin == ',') then
         token%kind = token_comma
      else if (index('()', begin) > 0) then
         token%kind = token_stray
         length = scan(text(token%first + 1:), '()=&$/!'//quotes//line_feed)
         if (begin == ')' .or. length == 0) return
         if (text(token%first + length:token%first + length) /= ')') return
         token%kind = token_index
         token%last = token%first + length
      else if (index(quotes, begin) > 0) then
         call close_quote(text, token)
      else if (begin == '!' .and. is_file) then
         token%kind = token_none
         token%last = end_of_line(text, token%first)
      else if (begin == '/' .and. is_file) then
         token%kind = token_end
      else if (index('&$', begin) > 0 .and. is_file) then
         token%last = end_of_word(text, token%first + 1, is_file)
         token%kind = merge(token_end, token_group, &
                            lowered(text(token%first + 1:token%last)) == 'end')
      else
         token%last = end_of_word(text, token%first, is_file)
         call split_repeat(text, token)
      end if
   end subroutine classify

   !> Splits r*value into the number of repeats and the value, which may be quoted.
   pure subroutine split_repeat(text, token)
      character(*), intent(in) :: text
      type(token_type), intent(inout) :: token
      character(:), allocatable :: rule
      integer(long) :: repeat
      integer :: star

      star = index(text(token%first:token%last), '*')
      if (star < 2 .or. verify(text(token%first:token%last), '0123456789') /= star) return
      call parse_integer(text(token%first:token%first + star - 2), int(most_repeats, long), &
                         repeat, rule)
      token%repeat = int(repeat)
      token%first = token%first + star
      if (token%first > len(text) .or. token%first <= token%last) return
      if (scan(text(token%first:token%first), quotes) == 1) call close_quote(text, token)
   end subroutine split_repeat

   !> Finds the end of the quoted text that begins at token%first; a doubled quote stands for one.
   pure subroutine close_quote(text, token)
      character(*), intent(in) :: text
      type(token_type), intent(inout) :: token
      character :: quote
      integer :: i, limit

      quote = text(token%first:token%first)
      limit = end_of_line(text, token%first)
      i = token%first + 1
      do while (i <= limit)
         if (text(i:i) == quote) then
            if (i == limit) exit
            if (text(i + 1:i + 1) /= quote) exit
            i = i + 1
         end if
         i = i + 1
      end do
      token%kind = merge(token_quoted, token_open_quote, i <= limit)
      token%last = min(i, limit)
   end subroutine close_quote

   !> Position of the last character before the next line feed.
   pure integer function end_of_line(text, position)
      character(*), intent(in) :: text
      integer, intent(in) :: position

      end_of_line = index(text(position:), line_feed) + position - 2
      if (end_of_line < position - 1) end_of_line = len(text)
   end function end_of_line

   !> Position of the last character of the word that begins at `position`.
   pure integer function end_of_word(text, position, is_file)
      character(*), intent(in) :: text
      integer, intent(in) :: position
      logical, intent(in) :: is_file

      end_of_word = scan(text(position:), blanks//'=,()'//quotes// &
                         merge('/!&$', '    ', is_file)) + position - 2
      if (end_of_word < position - 1) end_of_word = len(text)
   end function end_of_word

end module config_text_tokens
