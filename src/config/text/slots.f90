!> Which token of the scene gives each value of an entry.
module config_text_slots
   use config_text_document, only: assignment_type, document_type
   use config_text_tokens, only: token_comma, token_quoted, token_type, token_word
   use config_text_value_table, only: entry_type
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: find_slots

   integer, parameter :: max_length = 1000   !! values of a list

contains

   !> Finds the token of each value of an entry; 0: its default. Empty after a complaint.
   subroutine find_slots(document, block, entry, default_size, slots, last)
      class(document_type), intent(inout) :: document
      integer, intent(in) :: block
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size   !! 0: there is no default
      integer, allocatable, intent(out) :: slots(:)
      integer, intent(out) :: last   !! assignment to it; 0: there is none
      character(:), allocatable :: hint, rule
      integer, allocatable :: values(:)
      type(assignment_type) :: given
      integer :: i, first_line, n_before

      n_before = document%complaints%n
      slots = spread(0, 1, default_size)
      last = 0
      do i = 1, document%n_assignments
         if (.not. document%is_for(i, block, trim(entry%name))) cycle
         document%assignments(i)%is_known = .true.
         given = document%assignments(i)
         call expand_values(document, given, values)
         if (last == 0) first_line = given%place%line
         if (last > 0 .and. given%lower == 0 .and. given%place%source == 1) then
            rule = 'is given twice, first on line '//to_text(first_line)
         else
            call place_values(given, entry, values, slots, rule)
         end if
         call document%refuse_assignment(i, rule)
         last = i
      end do
      if (last == 0) return
      if (document%complaints%n == n_before) then
         call check_length(entry, default_size, slots, rule)
         if (allocated(rule)) then
            hint = ''
            do i = size(slots), 1, -1
               if (slots(i) > 0) hint = document%comma_hint(slots(i))
               if (hint /= '') exit
            end do
            call document%refuse_assignment(last, rule//hint)
         end if
      end if
      document%assignments(last)%is_refused = document%complaints%n > n_before
      if (document%complaints%n > n_before) slots = spread(0, 1, 0)
   end subroutine find_slots

   !> Lists the value tokens of an assignment with repeats written out; empty after a complaint.
   subroutine expand_values(document, given, values)
      class(document_type), intent(inout) :: document
      type(assignment_type), intent(in) :: given
      integer, allocatable, intent(out) :: values(:)
      type(token_type) :: token
      character(:), allocatable :: rule
      integer :: found(max_length), i, n
      logical :: wants_value

      n = 0
      wants_value = .true.
      do i = given%first_value, given%last_value
         token = document%tokens(i)
         if (token%kind == token_comma) then
            if (wants_value) rule = 'a value is missing before the comma'
            wants_value = .true.
         else if (all(token%kind /= [token_word, token_quoted]) .or. &
                  index(document%text_of(token), '#') == 1) then
            rule = document%rule_on(token, 'is not expected among values')
         else if (token%first > token%last) then
            rule = 'a value is missing behind the *'
         else if (token%repeat < 1) then
            rule = 'a value cannot be repeated 0 times'
         else if (n + token%repeat > max_length) then
            rule = 'a list has at most '//to_text(max_length)//' values'
         else
            wants_value = .false.
            found(n + 1:n + token%repeat) = i
            n = n + token%repeat
         end if
         if (allocated(rule)) then
            call document%refuse(given%block, token, document%text_of(given%place), &
                                 document%text_of(token), rule)
            values = found(:0)
            return
         end if
      end do
      if (n == 0) call document%refuse(given%block, given%place, document%text_of(given%place), &
                                       '', 'a value is missing')
      values = found(:n)
   end subroutine expand_values

   !> Puts the values of one assignment where they belong.
   pure subroutine place_values(given, entry, values, slots, rule)
      type(assignment_type), intent(in) :: given
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: values(:)
      integer, allocatable, intent(inout) :: slots(:)
      character(:), allocatable, intent(out) :: rule
      integer :: n, fill

      if (size(values) == 0) return   ! it was refused
      if (given%lower == 0) then
         slots = values
         return
      end if
      n = given%upper - given%lower + 1
      if (given%upper > max_length) then
         rule = 'a list has at most '//to_text(max_length)//' values'
      else if (size(values) /= n) then
         rule = 'the index asks for '//to_text(n)//merge(' value ', ' values', n == 1)
      else
         n = max(size(slots), given%upper, entry%per_dof)
         fill = 0
         if (entry%per_dof > 0 .and. size(slots) == 1) fill = slots(1)
         slots = [slots, spread(fill, 1, n - size(slots))]
         slots(given%lower:given%upper) = values
      end if
   end subroutine place_values

   pure subroutine check_length(entry, default_size, slots, rule)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size
      integer, intent(in) :: slots(:)
      character(:), allocatable, intent(out) :: rule

      if (entry%per_dof > 0 .and. all(size(slots) /= [1, entry%per_dof])) then
         rule = 'must be one value, or one for each of the '//to_text(entry%per_dof)//' dofs'
      else if (entry%length == 1 .and. size(slots) /= 1) then
         rule = 'must be one value'
      else if (entry%length > 0 .and. size(slots) /= entry%length) then
         rule = 'must be '//to_text(entry%length)//' values'
      else if ((entry%per_dof < 0 .or. default_size == 0) .and. &
               any(slots(min(default_size, size(slots)) + 1:) == 0)) then
         rule = 'every value of the list must be given'
      end if
   end subroutine check_length

end module config_text_slots
