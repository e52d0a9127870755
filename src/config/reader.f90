!> Fills a group from what the scene file and the --set options give, and complains of what they should not.
module config_reader
   use config_complaints, only: complaint_list, nearest_name
   use config_entries, only: choice_length, entry_type, name_length, visitor_type
   use config_namelist, only: document_type
   use config_slots, only: find_slots
   use config_tokens, only: lowered, token_type, token_word
   use config_values, only: parse_integer, parse_logical, parse_real, parse_text
   use core_kinds, only: long, wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: reader_type

   type, extends(visitor_type) :: reader_type
      type(document_type) :: document
      type(complaint_list) :: complaints
      integer :: block = 0                                  !! being read; 0: absent, all is default
      character(name_length), allocatable :: known(:)       !! names of the group visited so far
      logical, allocatable :: is_known(:)                   !! (assignment)
      logical, allocatable :: is_refused(:)                 !! (assignment) complained of
      integer, private :: current = 0                       !! assignment being read, the last of its name
      character(80), allocatable :: unused(:)               !! given, but of no effect: group%name
   contains
      procedure :: begin_group
      procedure :: end_group
      procedure :: require
      procedure :: was_given
      procedure :: visit_integer
      procedure :: visit_long
      procedure :: visit_real
      procedure :: visit_logical
      procedure :: visit_choice
      procedure :: visit_text
      procedure :: visit_integers
      procedure :: visit_reals
      procedure :: visit_choices
      procedure, private :: gather
      procedure, private :: gather_one
      procedure, private :: refuse
   end type reader_type

contains

   !> Before a group's table is visited.
   subroutine begin_group(self, block)
      class(reader_type), intent(inout) :: self
      integer, intent(in) :: block   !! into document%blocks; 0: absent

      self%block = block
      self%known = [character(name_length) ::]
      if (.not. allocated(self%is_known)) &
         allocate (self%is_known(self%document%n_assignments), &
                   self%is_refused(self%document%n_assignments), source=.false.)
      if (.not. allocated(self%unused)) allocate (self%unused(0))
   end subroutine begin_group

   !> After it: whatever was given and not visited has a name that the group does not know.
   subroutine end_group(self)
      class(reader_type), intent(inout) :: self
      character(name_length) :: nearest
      character(:), allocatable :: rule
      integer :: i

      do i = 1, self%document%n_assignments
         associate (given => self%document%assignments(i))
            if (given%block /= self%block .or. self%is_known(i)) cycle
            self%current = i
            nearest = nearest_name(trim(given%name), self%known)
            rule = 'unknown name'
            if (nearest /= '') rule = rule//', did you mean '//trim(nearest)//'?'
            call self%refuse(given%place, self%document%text_of(given%place), &
                             self%document%values_text(given), rule)
         end associate
      end do
   end subroutine end_group

   !> A rule between values: complains of `name` where it was given, else at its group.
   !> A value that was refused already is not judged again.
   subroutine require(self, condition, block, name, value, rule)
      class(reader_type), intent(inout) :: self
      logical, intent(in) :: condition
      integer, intent(in) :: block              !! 0: the group is absent
      character(*), intent(in) :: name, value   !! `value` is shown where the scene does not give it
      character(*), intent(in) :: rule
      integer :: i, last

      if (condition) return
      self%block = block
      last = 0
      do i = 1, self%document%n_assignments
         associate (given => self%document%assignments(i))
            if (given%block == block .and. given%name == name) last = i
         end associate
      end do
      self%current = last
      if (last > 0) then
         if (self%is_refused(last)) return
         associate (given => self%document%assignments(last))
            call self%refuse(given%place, name, self%document%values_text(given), rule)
         end associate
      else if (block > 0) then
         call self%refuse(self%document%blocks(block)%place, name, value, rule)
      else
         call self%complaints%add_general(self%document%source(1)%name//': '//name//': '//rule)
      end if
   end subroutine require

   pure logical function was_given(self, block, name)
      class(reader_type), intent(in) :: self
      integer, intent(in) :: block
      character(*), intent(in) :: name
      integer :: i

      was_given = .false.
      do i = 1, self%document%n_assignments
         associate (given => self%document%assignments(i))
            was_given = was_given .or. given%block == block .and. given%name == name
         end associate
      end do
   end function was_given

   subroutine visit_integer(self, value, entry)
      class(reader_type), intent(inout) :: self
      integer, intent(inout) :: value
      type(entry_type), intent(in) :: entry
      integer(long) :: wide

      wide = value
      call read_integer(self, wide, entry, int(huge(1), long))
      value = int(wide)
   end subroutine visit_integer

   subroutine visit_long(self, value, entry)
      class(reader_type), intent(inout) :: self
      integer(long), intent(inout) :: value
      type(entry_type), intent(in) :: entry

      call read_integer(self, value, entry, huge(1_long))
   end subroutine visit_long

   subroutine read_integer(self, value, entry, limit)
      class(reader_type), intent(inout) :: self
      integer(long), intent(inout) :: value
      type(entry_type), intent(in) :: entry
      integer(long), intent(in) :: limit
      integer :: slot

      call self%gather_one(entry, slot)
      if (slot > 0) call convert_integer(self, slot, 1, entry, limit, value)
      if (self%current > 0) then
         if (self%is_refused(self%current)) value = 0   ! so that no other value is judged by it
      end if
   end subroutine read_integer

   subroutine visit_real(self, value, entry)
      class(reader_type), intent(inout) :: self
      real(wp), intent(inout) :: value
      type(entry_type), intent(in) :: entry
      integer :: slot

      call self%gather_one(entry, slot)
      if (slot > 0) call convert_real(self, slot, 1, entry, value)
   end subroutine visit_real

   subroutine visit_logical(self, value, entry)
      class(reader_type), intent(inout) :: self
      logical, intent(inout) :: value
      type(entry_type), intent(in) :: entry
      character(:), allocatable :: rule
      integer :: slot

      call self%gather_one(entry, slot)
      if (slot == 0) return
      associate (token => self%document%tokens(slot))
         call parse_logical(self%document%text_of(token), value, rule)
         if (allocated(rule)) call self%refuse(token, trim(entry%name), self%document%text_of(token), rule)
      end associate
   end subroutine visit_logical

   subroutine visit_choice(self, value, entry)
      class(reader_type), intent(inout) :: self
      character(choice_length), intent(inout) :: value
      type(entry_type), intent(in) :: entry
      integer :: slot

      call self%gather_one(entry, slot)
      if (slot > 0) call convert_choice(self, slot, entry, value)
   end subroutine visit_choice

   subroutine visit_text(self, value, entry)
      class(reader_type), intent(inout) :: self
      character(:), allocatable, intent(inout) :: value
      type(entry_type), intent(in) :: entry
      integer :: slot

      if (.not. allocated(value)) value = ''
      call self%gather_one(entry, slot)
      if (slot > 0) call convert_text(self, slot, entry, value)
   end subroutine visit_text

   subroutine visit_integers(self, values, entry, default)
      class(reader_type), intent(inout) :: self
      integer, allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default(:)
      integer, allocatable :: slots(:)
      integer(long) :: wide
      integer :: i

      call self%gather(entry, size(default), slots)
      values = default(min([(i, i=1, size(slots))], size(default)))
      do i = 1, size(slots)
         if (slots(i) == 0) cycle
         wide = values(i)
         call convert_integer(self, slots(i), i, entry, int(huge(1), long), wide)
         values(i) = int(wide)
      end do
   end subroutine visit_integers

   subroutine visit_reals(self, values, entry, default)
      class(reader_type), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      real(wp), intent(in), optional :: default(:)
      integer, allocatable :: slots(:)
      integer :: i

      if (present(default)) then
         call self%gather(entry, size(default), slots)
         values = default(min([(i, i=1, size(slots))], size(default)))
      else
         call self%gather(entry, 0, slots)
         values = spread(0.0_wp, 1, size(slots))
      end if
      do i = 1, size(slots)
         if (slots(i) > 0) call convert_real(self, slots(i), i, entry, values(i))
      end do
   end subroutine visit_reals

   subroutine visit_choices(self, values, entry, default)
      class(reader_type), intent(inout) :: self
      character(choice_length), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      character(*), intent(in) :: default(:)
      integer, allocatable :: slots(:)
      integer :: i

      call self%gather(entry, size(default), slots)
      values = default(min([(i, i=1, size(slots))], size(default)))
      do i = 1, size(slots)
         if (slots(i) == 0) cycle
         call convert_choice(self, slots(i), entry, values(i))
         if (any(values(:i - 1) == values(i))) &
            call self%refuse(self%document%tokens(slots(i)), trim(entry%name), &
                             self%document%text_of(self%document%tokens(slots(i))), 'is named twice')
      end do
   end subroutine visit_choices

   !> The token of a single value; 0: its default.
   subroutine gather_one(self, entry, slot)
      class(reader_type), intent(inout) :: self
      type(entry_type), intent(in) :: entry
      integer, intent(out) :: slot
      type(entry_type) :: single
      integer, allocatable :: slots(:)

      single = entry
      single%length = 1
      call self%gather(single, 1, slots)
      slot = 0
      if (size(slots) == 1) slot = slots(1)
   end subroutine gather_one

   !> The token of each value of a list; 0: its default. Empty: refused, missing, or so by default.
   subroutine gather(self, entry, default_size, slots)
      class(reader_type), intent(inout) :: self
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: default_size
      integer, allocatable, intent(out) :: slots(:)
      integer :: i, last_given, n_before

      last_given = 0
      do i = 1, self%document%n_assignments
         associate (given => self%document%assignments(i))
            if (given%block /= self%block .or. given%name /= entry%name) cycle
            self%is_known(i) = .true.
            last_given = i
         end associate
      end do
      self%current = last_given
      self%known = [self%known, entry%name]
      if (last_given > 0) then
         n_before = self%complaints%n
         call find_slots(self%document, self%block, entry, default_size, slots, self%complaints)
         self%is_refused(last_given) = self%complaints%n > n_before
         if (.not. entry%is_used) call note_unused()
      else
         slots = spread(0, 1, default_size)
         if (entry%is_required) &
            call self%require(.false., self%block, trim(entry%name), '', 'must be given')
      end if

   contains

      subroutine note_unused()
         character(len(self%unused)) :: name

         name = self%document%blocks(self%block)%name//'%'//entry%name
         self%unused = [self%unused, name]
      end subroutine note_unused

   end subroutine gather

   subroutine convert_integer(self, slot, i, entry, limit, value)
      class(reader_type), intent(inout) :: self
      integer, intent(in) :: slot, i
      type(entry_type), intent(in) :: entry
      integer(long), intent(in) :: limit
      integer(long), intent(inout) :: value
      character(:), allocatable :: rule

      associate (token => self%document%tokens(slot))
         call parse_integer(self%document%text_of(token), limit, value, rule)
         if (.not. allocated(rule) .and. .not. entry%rule%admits(real(value, wp))) rule = entry%rule%text()
         if (allocated(rule)) &
            call self%refuse(token, element_name(entry, i), self%document%text_of(token), rule)
      end associate
   end subroutine convert_integer

   subroutine convert_real(self, slot, i, entry, value)
      class(reader_type), intent(inout) :: self
      integer, intent(in) :: slot, i
      type(entry_type), intent(in) :: entry
      real(wp), intent(inout) :: value
      character(:), allocatable :: rule

      associate (token => self%document%tokens(slot))
         call parse_real(self%document%text_of(token), value, rule)
         if (.not. allocated(rule) .and. .not. entry%rule%admits(value)) rule = entry%rule%text()
         if (allocated(rule)) &
            call self%refuse(token, element_name(entry, i), self%document%text_of(token), rule)
      end associate
   end subroutine convert_real

   !> Text in quotes; on the command line, where the shell takes them away, also without.
   subroutine convert_text(self, slot, entry, value)
      class(reader_type), intent(inout) :: self
      integer, intent(in) :: slot
      type(entry_type), intent(in) :: entry
      character(:), allocatable, intent(inout) :: value
      character(:), allocatable :: rule

      associate (token => self%document%tokens(slot))
         if (token%source == 2 .and. token%kind == token_word) then
            value = self%document%text_of(token)
         else
            call parse_text(self%document%text_of(token), value, rule)
         end if
         if (allocated(rule)) call self%refuse(token, trim(entry%name), self%document%text_of(token), rule)
      end associate
   end subroutine convert_text

   subroutine convert_choice(self, slot, entry, value)
      class(reader_type), intent(inout) :: self
      integer, intent(in) :: slot
      type(entry_type), intent(in) :: entry
      character(choice_length), intent(inout) :: value
      character(:), allocatable :: text, rule
      character(choice_length) :: nearest
      integer :: i, n

      n = self%complaints%n
      call convert_text(self, slot, entry, text)
      if (self%complaints%n > n) return
      do i = 1, entry%n_choices
         if (lowered(text) /= lowered(trim(entry%choices(i)))) cycle
         value = entry%choices(i)
         return
      end do
      rule = 'must be '
      do i = 1, entry%n_choices
         if (i > 1 .and. i < entry%n_choices) rule = rule//', '
         if (i > 1 .and. i == entry%n_choices) rule = rule//' or '
         rule = rule//"'"//trim(entry%choices(i))//"'"
      end do
      nearest = nearest_name(lowered(text), entry%choices(:entry%n_choices))
      if (nearest /= '') rule = rule//", did you mean '"//trim(nearest)//"'?"
      associate (token => self%document%tokens(slot))
         call self%refuse(token, trim(entry%name), self%document%text_of(token), rule)
      end associate
   end subroutine convert_choice

   !> A complaint at a token of the group being read.
   subroutine refuse(self, token, name, value, rule)
      class(reader_type), intent(inout) :: self
      type(token_type), intent(in) :: token
      character(*), intent(in) :: name, value, rule

      if (self%current > 0) self%is_refused(self%current) = .true.
      call self%document%refuse(self%block, token, name, value, rule, self%complaints)
   end subroutine refuse

   pure function element_name(entry, i) result(text)
      type(entry_type), intent(in) :: entry
      integer, intent(in) :: i
      character(:), allocatable :: text

      text = trim(entry%name)
      if (i > 1) text = text//'('//to_text(i)//')'
   end function element_name

end module config_reader
