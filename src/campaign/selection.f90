!> Exact order statistics of many columns of numbers, of which each rank has a part.
!>
!> A column is the values of one quantity of all samples. For each percentile there is a bracket in
!> which its order statistics are expected. Values below the bracket are counted, values inside it
!> are kept. They are few: joined from all ranks and sorted, they contain the order statistics, the
!> same on any number of ranks.
!>
!> Call `start_selection`; `add` all values; `check` with the sums of `counts` over the ranks. If a
!> bracket misses its order statistics, add all values and check again. Then `order_statistics`
!> finds those of a bracket in the values that all ranks have `kept`.
module campaign_selection
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: selection_type, start_selection

   !> Values in a bracket.
   type :: kept_values
      real(wp), allocatable :: value(:)
   end type kept_values

   !> Places in `counts` of the values below a bracket and inside it.
   integer, parameter :: below = 1, inside = 2

   !> Brackets of order statistics, with the counts and values of one rank.
   type :: selection_type
      private
      integer, allocatable :: rank(:, :)               !! (order statistic, percentile) in a column
      real(wp), allocatable :: bracket(:, :, :)        !! (lower or upper end, percentile, column)
      logical, allocatable :: is_complete(:, :)        !! (percentile, column) has all its ranks
      integer, allocatable :: n_below(:, :)            !! (percentile, column) values on all ranks
      type(kept_values), allocatable, public :: kept(:, :)   !! (percentile, column) of this rank
      !> (below or inside, percentile, column) number of values of this rank
      real(wp), allocatable, public :: counts(:, :, :)
   contains
      procedure :: add
      procedure :: check
      procedure :: order_statistics
   end type selection_type

contains

   !> Prepares a selection, with the same arguments on all ranks.
   pure subroutine start_selection(rank, bracket, selection)
      integer, intent(in) :: rank(:, :)           !! (order statistic, percentile), from 1
      real(wp), intent(in) :: bracket(:, :, :)    !! (lower or upper end, percentile, column)
      type(selection_type), intent(out) :: selection
      integer :: c, p

      selection%rank = rank
      selection%bracket = bracket
      associate (np => size(bracket, 2), n_columns => size(bracket, 3))
         allocate (selection%kept(np, n_columns), selection%n_below(np, n_columns))
         allocate (selection%is_complete(np, n_columns), source=.false.)
         allocate (selection%counts(2, np, n_columns), source=0.0_wp)
         do c = 1, n_columns
            do p = 1, np
               allocate (selection%kept(p, c)%value(0))
            end do
         end do
      end associate
   end subroutine start_selection

   !> Adds values of a column. Each value is added on one rank.
   pure subroutine add(self, column, values)
      class(selection_type), intent(inout) :: self
      integer, intent(in) :: column
      real(wp), intent(in) :: values(:)
      integer :: p

      do p = 1, size(self%bracket, 2)
         if (self%is_complete(p, column)) cycle
         associate (counts => self%counts(:, p, column), low => self%bracket(1, p, column), &
                    high => self%bracket(2, p, column))
            counts(below) = counts(below) + count(values < low)
            self%kept(p, column)%value = [self%kept(p, column)%value, &
                                          pack(values, values >= low .and. values <= high)]
            counts(inside) = size(self%kept(p, column)%value)
         end associate
      end do
   end subroutine add

   !> Checks that every bracket contains its order statistics. Extends those that do not to all
   !> numbers; then all values must be added again.
   pure subroutine check(self, counts, is_complete)
      class(selection_type), intent(inout) :: self
      real(wp), intent(in) :: counts(:, :, :)   !! sums of `counts` over the ranks
      logical, intent(out) :: is_complete       !! all brackets do
      integer :: c, p

      do c = 1, size(counts, 3)
         do p = 1, size(counts, 2)
            if (self%is_complete(p, c)) cycle
            associate (rank => self%rank(:, p), bracket => self%bracket(:, p, c), &
                       kept => self%kept(p, c))
               self%is_complete(p, c) = minval(rank) > counts(below, p, c) .and. &
                                        maxval(rank) <= sum(counts(:, p, c))
               if (self%is_complete(p, c)) then
                  self%n_below(p, c) = nint(counts(below, p, c))
               else
                  if (bracket(2) >= huge(bracket)) error stop 'campaign_selection: not a number'
                  bracket = [-huge(bracket), huge(bracket)]
                  self%counts(:, p, c) = 0.0_wp
                  kept%value = kept%value(:0)
               end if
            end associate
         end do
      end do
      is_complete = all(self%is_complete)
   end subroutine check

   !> Order statistics in a bracket.
   pure function order_statistics(self, percentile, column, values) result(found)
      class(selection_type), intent(in) :: self
      integer, intent(in) :: percentile, column
      real(wp), intent(in) :: values(:)   !! values that all ranks have kept in this bracket
      real(wp) :: found(size(self%rank, 1))   !! (order statistic)

      associate (ranking => sort_order(values))
         found = values(ranking(self%rank(:, percentile) - self%n_below(percentile, column)))
      end associate
   end function order_statistics

end module campaign_selection
