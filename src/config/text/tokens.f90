!> Cuts namelist text into tokens that know where they stand.
module config_text_tokens
   use core_source, only: byte_order_mark, source_type
   use core_text, only: lowered
   implicit none(type, external)
   private
   public :: token_type, tokenize, comment_rule
   public :: token_word, token_quoted, token_open_quote, token_equals, token_comma, token_left, &
             token_right, token_colon, token_group, token_end, token_end_of_line

   integer, parameter :: token_word = 1         !! a name, a number, .true.
   integer, parameter :: token_quoted = 2       !! 'text', with its quotes
   integer, parameter :: token_open_quote = 3   !! a quote that is not closed on its line
   integer, parameter :: token_equals = 4, token_comma = 5, token_left = 6, token_right = 7, &
                         token_colon = 8
   integer, parameter :: token_group = 9        !! &name
   integer, parameter :: token_end = 10         !! '/' or &end
   integer, parameter :: token_end_of_line = 11 !! only between the --set options, one a line

   !> Said of a word that begins with #, where a person used to other languages expects a comment.
   character(*), parameter :: comment_rule = 'a comment begins with !'

   character(*), parameter :: blanks = ' '//achar(9)//achar(11)//achar(12)//achar(13)
   character(*), parameter :: punctuation = '=,():'
   integer, parameter :: punctuation_kind(*) = &
                         [token_equals, token_comma, token_left, token_right, token_colon]

   !> Text is source%text(first:last).
   type :: token_type
      integer :: kind = token_word
      integer :: source = 1     !! 1: the scene file, 2: the --set options
      integer :: line = 1
      integer :: first = 1, last = 0
      integer :: start = 1      !! start of r*value where that stands before it, else first
      integer :: repeat = 1     !! r of r*value
   end type token_type

contains

   !> Splits a source into its tokens. On the command line `/`, `!` and `&` are ordinary
   !> characters.
   subroutine tokenize(source, number, tokens)
      type(source_type), intent(in) :: source
      integer, intent(in) :: number                    !! 1: the scene file, 2: the --set options
      type(token_type), allocatable, intent(out) :: tokens(:)
      type(token_type) :: token
      integer :: position, line, n
      logical :: is_file

      is_file = number == 1
      n = 0
      allocate (tokens(256))
      line = 1
      position = 1
      if (index(source%text, byte_order_mark) == 1) position = 4
      associate (text => source%text)
         do while (position <= len(text))
            token = token_type(source=number, line=line, first=position, last=position, &
                               start=position)
            if (text(position:position) == new_line('a')) then
               line = line + 1
               token%kind = token_end_of_line
               if (.not. is_file) call append(token)
            else if (text(position:position) == '!' .and. is_file) then
               token%last = end_of_line(text, position)
            else if (index(blanks, text(position:position)) == 0) then
               call classify(text, is_file, token)
               call append(token)
            end if
            position = token%last + 1
         end do
      end associate
      tokens = tokens(:n)

   contains

      subroutine append(token)
         type(token_type), intent(in) :: token
         type(token_type), allocatable :: longer(:)

         if (n == size(tokens)) then
            allocate (longer(2*n))
            longer(:n) = tokens
            call move_alloc(longer, tokens)
         end if
         n = n + 1
         tokens(n) = token
      end subroutine append

   end subroutine tokenize

   !> Finds the kind and the end of the token that begins at token%first.
   pure subroutine classify(text, is_file, token)
      character(*), intent(in) :: text
      logical, intent(in) :: is_file
      type(token_type), intent(inout) :: token
      integer :: kind, star

      kind = index(punctuation, text(token%first:token%first))
      if (kind > 0) then
         token%kind = punctuation_kind(kind)
         return
      end if
      select case (text(token%first:token%first))
      case ("'", '"')
         call close_quote(text, token)
         return
      case ('/')
         if (is_file) then
            token%kind = token_end
            return
         end if
      case ('&', '$')
         if (is_file) then
            token%last = end_of_word(text, token%first + 1, is_file)
            token%kind = token_group
            if (lowered(text(token%first + 1:token%last)) == 'end') token%kind = token_end
            return
         end if
      end select

      token%last = end_of_word(text, token%first, is_file)
      star = index(text(token%first:token%last), '*')
      if (star > 1) then
         if (verify(text(token%first:token%first + star - 2), '0123456789') == 0) then
            token%repeat = bounded_count(text(token%first:token%first + star - 2))
            token%first = token%first + star
            if (token%first > len(text) .or. token%first <= token%last) return
            if (scan(text(token%first:token%first), '''"') == 1) call close_quote(text, token)
         end if
      end if
   end subroutine classify

   !> Finds the end of the text whose opening quote is at token%first; a doubled quote stands for
   !> one.
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

   !> Last position before the line feed.
   pure integer function end_of_line(text, position)
      character(*), intent(in) :: text
      integer, intent(in) :: position

      end_of_line = index(text(position:), new_line('a')) + position - 2
      if (end_of_line < position - 1) end_of_line = len(text)
   end function end_of_line

   pure integer function end_of_word(text, position, is_file)
      character(*), intent(in) :: text
      integer, intent(in) :: position
      logical, intent(in) :: is_file
      character(*), parameter :: ends = blanks//punctuation//new_line('a')//'''"'

      if (is_file) then
         end_of_word = scan(text(position:), ends//'/!&$') + position - 2
      else
         end_of_word = scan(text(position:), ends) + position - 2
      end if
      if (end_of_word < position - 1) end_of_word = len(text)
   end function end_of_word

   !> r of r*value, cut at a million: no list is that long.
   pure integer function bounded_count(digits) result(count)
      character(*), intent(in) :: digits
      integer :: i

      count = 0
      do i = 1, len(digits)
         count = min(10*count + iachar(digits(i:i)) - iachar('0'), 1000000)
      end do
   end function bounded_count

end module config_text_tokens
