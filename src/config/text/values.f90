!> Logical values and text of a scene. Nothing is guessed: what is not exactly a value of the wanted
!> type is refused, with the rule that it breaks.
module config_text_values
   use core_spelling, only: lowered
   implicit none(type, external)
   private
   public :: parse_logical, parse_text

contains

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

end module config_text_values
