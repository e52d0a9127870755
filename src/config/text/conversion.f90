!> From a token of the scene to a checked value of an entry. Nothing is guessed: what is not exactly
!> a value of the wanted type is refused, with the rule that it breaks.
module config_text_conversion
   use config_text_document, only: document_type
   use config_text_tokens, only: token_word
   use config_text_value_table, only: entry_type
   use core_kinds, only: long, wp
   use core_text, only: lowered, nearest_name, parse_integer, parse_real, to_text
   implicit none(type, external)
   private
   public :: convert, parse_logical, parse_text

contains

   !> Converts a token to a word that its entry admits; else `rule` says why not.
   pure subroutine convert(document, slot, entry, word, rule)
      class(document_type), intent(in) :: document
      integer, intent(in) :: slot   !! into document%tokens
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(out) :: word, rule
      integer(long) :: whole
      real(wp) :: number
      logical :: is_true

      number = 0.0_wp
      word = document%text_of(document%tokens(slot))
      select case (entry%kind)
      case ('integer')
         call parse_integer(word, entry%largest, whole, rule)
         number = real(whole, wp)
         word = to_text(whole)
      case ('real')
         call parse_real(word, number, rule)
         word = to_text(number)
      case ('logical')
         call parse_logical(word, is_true, rule)
         word = to_text(is_true)
      case default
         ! the shell takes the quotes of the command line away
         if (document%tokens(slot)%source == 1 .or. document%tokens(slot)%kind /= token_word) &
            call parse_text(document%text_of(document%tokens(slot)), word, rule)
         if (entry%n_choices > 0 .and. .not. allocated(rule)) call choose(entry, word, rule)
      end select
      if (.not. (allocated(rule) .or. entry%rule%admits(number))) &
         rule = 'must be '//entry%rule%text()
   end subroutine convert

   !> Replaces a word by the choice that it is, in any case.
   pure subroutine choose(entry, word, rule)
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(inout) :: word
      character(:), allocatable, intent(out) :: rule
      character(:), allocatable :: nearest
      integer :: i

      do i = 1, entry%n_choices
         if (lowered(word) /= lowered(trim(entry%choices(i)))) cycle
         word = trim(entry%choices(i))
         return
      end do
      rule = 'must be '//entry%choices_text()
      nearest = nearest_name(lowered(word), entry%choices(:entry%n_choices))
      if (nearest /= '') rule = rule//", did you mean '"//trim(nearest)//"'?"
   end subroutine choose

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
