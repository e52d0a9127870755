!> From a token of the scene to a checked value of an entry. Nothing is guessed: what is not exactly
!> a value of the wanted type is refused, with the rule that it breaks.
module config_text_conversion
   use config_text_document, only: document_type
   use config_text_tokens, only: token_word
   use config_text_value_table, only: choice_length, entry_type
   use core_kinds, only: long, wp
   use core_text, only: lowered, nearest_name, parse_integer, parse_real
   implicit none(type, external)
   private
   public :: convert_choice, convert_integer, convert_real, convert_text, parse_logical, parse_text

contains

   !> Converts a token to a whole number that its entry admits; else `rule` says why not.
   pure subroutine convert_integer(text, entry, limit, value, rule)
      character(*), intent(in) :: text
      type(entry_type), intent(in) :: entry
      integer(long), intent(in) :: limit
      integer(long), intent(out) :: value
      character(:), allocatable, intent(out) :: rule

      call parse_integer(text, limit, value, rule)
      if (allocated(rule)) return
      if (.not. entry%rule%admits(real(value, wp))) rule = 'must be '//entry%rule%text()
   end subroutine convert_integer

   !> Converts a token to a number that its entry admits; else `rule` says why not.
   pure subroutine convert_real(text, entry, value, rule)
      character(*), intent(in) :: text
      type(entry_type), intent(in) :: entry
      real(wp), intent(out) :: value
      character(:), allocatable, intent(out) :: rule

      call parse_real(text, value, rule)
      if (allocated(rule)) return
      if (.not. entry%rule%admits(value)) rule = 'must be '//entry%rule%text()
   end subroutine convert_real

   !> Converts a token to text. Quotes are needed in a file but not on the command line, where the
   !> shell takes them away.
   pure subroutine convert_text(document, slot, value, rule)
      class(document_type), intent(in) :: document
      integer, intent(in) :: slot   !! into document%tokens
      character(:), allocatable, intent(out) :: value, rule

      associate (token => document%tokens(slot))
         if (token%source == 2 .and. token%kind == token_word) then
            value = document%text_of(token)
         else
            call parse_text(document%text_of(token), value, rule)
         end if
      end associate
   end subroutine convert_text

   !> Converts a token to one of the entry's choices, in any case.
   pure subroutine convert_choice(document, slot, entry, value, rule)
      class(document_type), intent(in) :: document
      integer, intent(in) :: slot   !! into document%tokens
      type(entry_type), intent(in) :: entry
      character(choice_length), intent(inout) :: value
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: text
      character(choice_length) :: nearest
      integer :: i

      call convert_text(document, slot, text, rule)
      if (allocated(rule)) return
      do i = 1, entry%n_choices
         if (lowered(text) /= lowered(trim(entry%choices(i)))) cycle
         value = entry%choices(i)
         return
      end do
      rule = 'must be '//entry%choices_text()
      nearest = nearest_name(lowered(text), entry%choices(:entry%n_choices))
      if (nearest /= '') rule = rule//", did you mean '"//trim(nearest)//"'?"
   end subroutine convert_choice

   !> Parses t, true, .t., .true. and their opposites, in any case.
   pure subroutine parse_logical(text, value, rule)
      character(*), intent(in) :: text
      logical, intent(out) :: value
      character(:), allocatable, intent(out) :: rule

      value = .false.
      select case (lowered(text))
      case ('t', 'true', '.t.', '.true.')
         value = .true.
      case ('f', 'false', '.f.', '.false.')
      case default
         rule = 'must be .true. or .false.'
      end select
   end subroutine parse_logical

   !> Parses text between quotes; a doubled quote stands for one.
   pure subroutine parse_text(text, value, rule)
      character(*), intent(in) :: text                        !! with its quotes
      character(:), allocatable, intent(out) :: value, rule
      integer :: i

      value = ''
      if (len(text) < 2 .or. scan(text, '''"') /= 1) then
         rule = 'must be text in quotes'
         return
      end if
      i = 2
      do while (i < len(text))
         if (iachar(text(i:i)) < iachar(' ')) rule = 'must not hold control characters'
         value = value//text(i:i)
         i = i + merge(2, 1, text(i:i) == text(1:1))
      end do
   end subroutine parse_text

end module config_text_conversion
