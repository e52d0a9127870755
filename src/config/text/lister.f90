!> Lists a group's table as text: each entry with its value as a scene would give it.
module config_text_lister
   use config_text_value_table, only: choice_length, entry_type, visitor_type
   use core_kinds, only: long, wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: lister_type, row_type

   !> An entry, with its value as a scene would give it.
   type :: row_type
      type(entry_type) :: entry
      character(:), allocatable :: value     !! empty: none
      logical :: is_list = .false.
      character(7) :: kind = ''              !! integer, real, logical, text
   end type row_type

   !> Collects the rows of the tables that it visits; lists that nobody set get their defaults.
   type, extends(visitor_type) :: lister_type
      type(row_type), allocatable :: rows(:)
   contains
      procedure :: visit_value
      procedure :: visit_text
      procedure :: visit_reals
      procedure :: visit_choices
      procedure, private :: add
   end type lister_type

contains

   subroutine visit_value(self, value, entry)
      class(lister_type), intent(inout) :: self
      class(*), intent(inout) :: value
      type(entry_type), intent(in) :: entry

      select type (value)
      type is (integer)
         call self%add(entry, to_text(value), 'integer', is_list=.false.)
      type is (integer(long))
         call self%add(entry, to_text(value), 'integer', is_list=.false.)
      type is (real(wp))
         call self%add(entry, to_text(value), 'real', is_list=.false.)
      type is (logical)
         call self%add(entry, to_text(value), 'logical', is_list=.false.)
      type is (character(*))
         call self%add(entry, quoted(trim(value)), 'text', is_list=.false.)
      end select
   end subroutine visit_value

   subroutine visit_text(self, value, entry)
      class(lister_type), intent(inout) :: self
      character(:), allocatable, intent(inout) :: value
      type(entry_type), intent(in) :: entry

      if (.not. allocated(value)) value = ''
      call self%add(entry, quoted(value), 'text', is_list=.false.)
   end subroutine visit_text

   !> Lists the values; equal values, where one stands for all dofs, as one.
   subroutine visit_reals(self, values, entry, default)
      class(lister_type), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      real(wp), intent(in), optional :: default(:)
      character(:), allocatable :: text
      integer :: i

      if (.not. allocated(values)) then
         allocate (values(0))
         if (present(default)) values = default
      end if
      text = ''
      do i = 1, size(values)
         text = text//separator(i)
         if (entry%is_whole) then
            text = text//to_text(nint(values(i)))
         else
            text = text//to_text(values(i))
         end if
         if (entry%per_dof < 0) cycle
         if (.not. any(abs(values - values(1)) > 0.0_wp)) exit
      end do
      call self%add(entry, text, trim(merge('integer', 'real   ', entry%is_whole)), is_list=.true.)
   end subroutine visit_reals

   subroutine visit_choices(self, values, entry, default)
      class(lister_type), intent(inout) :: self
      character(choice_length), allocatable, intent(inout) :: values(:)
      type(entry_type), intent(in) :: entry
      character(*), intent(in) :: default(:)
      character(:), allocatable :: text
      integer :: i

      if (.not. allocated(values)) values = default
      text = ''
      do i = 1, size(values)
         text = text//separator(i)//quoted(trim(values(i)))
      end do
      call self%add(entry, text, 'text', is_list=.true.)
   end subroutine visit_choices

   subroutine add(self, entry, value, kind, is_list)
      class(lister_type), intent(inout) :: self
      type(entry_type), intent(in) :: entry
      character(*), intent(in) :: value, kind
      logical, intent(in) :: is_list
      type(row_type) :: row

      row%entry = entry
      row%value = value
      row%kind = kind
      row%is_list = is_list
      if (.not. allocated(self%rows)) allocate (self%rows(0))
      self%rows = [self%rows, row]
   end subroutine add

   pure function separator(i) result(text)
      integer, intent(in) :: i
      character(:), allocatable :: text

      text = ', '
      if (i == 1) text = ''
   end function separator

   !> Text in quotes, those within doubled.
   pure function quoted(text)
      character(*), intent(in) :: text
      character(:), allocatable :: quoted
      integer :: i

      quoted = "'"
      do i = 1, len(text)
         quoted = quoted//text(i:i)
         if (text(i:i) == "'") quoted = quoted//"'"
      end do
      quoted = quoted//"'"
   end function quoted

end module config_text_lister
