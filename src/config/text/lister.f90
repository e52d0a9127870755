!> Lists a group's table as text: each entry with its value as a scene would give it.
module config_text_lister
   use config_text_value_table, only: entry_type, visitor_type, word_type
   implicit none(type, external)
   private
   public :: lister_type, row_type

   !> An entry, with its value as a scene would give it.
   type :: row_type
      type(entry_type) :: entry
      character(:), allocatable :: value     !! empty: none
   end type row_type

   !> Collects the rows of the tables that it visits; lists that nobody set get their defaults.
   type, extends(visitor_type) :: lister_type
      type(row_type), allocatable :: rows(:)
   contains
      procedure :: visit_words
   end type lister_type

contains

   !> Lists the values; equal values, where one stands for all dofs, as one.
   subroutine visit_words(self, words, entry)
      class(lister_type), intent(inout) :: self
      type(word_type), allocatable, intent(inout) :: words(:)
      type(entry_type), intent(in) :: entry
      type(row_type) :: row
      integer :: i, n

      n = size(words)
      if (entry%per_dof >= 0) then
         if (all([(words(i)%text == words(1)%text, i=2, n)])) n = min(n, 1)
      end if
      row%entry = entry
      row%value = ''
      do i = 1, n
         if (i > 1) row%value = row%value//', '
         if (entry%kind == 'text') then
            row%value = row%value//quoted(words(i)%text)
         else
            row%value = row%value//words(i)%text
         end if
      end do
      if (.not. allocated(self%rows)) allocate (self%rows(0))
      self%rows = [self%rows, row]
   end subroutine visit_words

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
