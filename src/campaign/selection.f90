!> Order statistics of many columns of numbers, exact, while no rank holds a column whole.
!>
!> A column is all samples' values of one quantity. Each wanted percentile has a bracket that its
!> order statistics are expected in. Every value is counted that lies below the bracket, and kept
!> where it lies inside. Those inside are few: joined from all ranks, a bracket at a time, and
!> sorted they have the order statistics, the same on any number of ranks.
!>
!> `start_selection`; `add` all values; `check` the sums of `counts` over the ranks, and add all
!> again while brackets missed; then each bracket has its `order_statistics` by what all ranks have
!> `kept`.
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

   !> Values below a bracket and in it.
   integer, parameter :: below = 1, inside = 2

   !> Brackets of order statistics, and the values of one rank that lie in them.
   type :: selection_type
      private
      !> (target, percentile) places among the values of a column, ascending from 1
      integer, allocatable :: place(:, :)
      real(wp), allocatable :: bracket(:, :, :)          !! (lower or upper end, percentile, column)
      logical, allocatable :: is_met(:, :)               !! (percentile, column) by all places
      integer, allocatable :: n_below(:, :)              !! (percentile, column) on all ranks
      type(kept_values), allocatable, public :: kept(:, :)   !! (percentile, column) of this rank
      !> (below or inside, percentile, column) this rank's values
      real(wp), allocatable, public :: counts(:, :, :)
   contains
      procedure :: add
      procedure :: check
      procedure :: order_statistics
   end type selection_type

contains

   !> Prepares a selection: the same on all ranks.
   pure subroutine start_selection(place, bracket, selection)
      integer, intent(in) :: place(:, :)          !! (target, percentile)
      real(wp), intent(in) :: bracket(:, :, :)    !! (lower or upper end, percentile, column)
      type(selection_type), intent(out) :: selection
      integer :: c, p

      selection%place = place
      selection%bracket = bracket
      associate (np => size(bracket, 2), n_columns => size(bracket, 3))
         allocate (selection%kept(np, n_columns), selection%n_below(np, n_columns))
         allocate (selection%is_met(np, n_columns), source=.false.)
         allocate (selection%counts(2, np, n_columns), source=0.0_wp)
         do c = 1, n_columns
            do p = 1, np
               allocate (selection%kept(p, c)%value(0))
            end do
         end do
      end associate
   end subroutine start_selection

   !> Takes values of a column; each value once, on one rank.
   pure subroutine add(self, column, values)
      class(selection_type), intent(inout) :: self
      integer, intent(in) :: column
      real(wp), intent(in) :: values(:)
      integer :: p

      do p = 1, size(self%bracket, 2)
         if (self%is_met(p, column)) cycle
         associate (counts => self%counts(:, p, column), low => self%bracket(1, p, column), &
                    high => self%bracket(2, p, column))
            counts(below) = counts(below) + count(values < low)
            self%kept(p, column)%value = [self%kept(p, column)%value, &
                                          pack(values, values >= low .and. values <= high)]
            counts(inside) = size(self%kept(p, column)%value)
         end associate
      end do
   end subroutine add

   !> Checks, by the counts added over the ranks, that every bracket holds its order statistics.
   !> Else widens the others fully, and all values must be added again.
   pure subroutine check(self, counts, all_met)
      class(selection_type), intent(inout) :: self
      real(wp), intent(in) :: counts(:, :, :)   !! (below or inside, percentile, column)
      logical, intent(out) :: all_met
      integer :: c, p

      do c = 1, size(counts, 3)
         do p = 1, size(counts, 2)
            if (self%is_met(p, c)) cycle
            associate (place => self%place(:, p), bracket => self%bracket(:, p, c), &
                       kept => self%kept(p, c))
               self%is_met(p, c) = minval(place) > counts(below, p, c) .and. &
                                   maxval(place) <= sum(counts(:, p, c))
               if (self%is_met(p, c)) then
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
      all_met = all(self%is_met)
   end subroutine check

   !> The order statistics in a bracket.
   pure function order_statistics(self, percentile, column, values) result(found)
      class(selection_type), intent(in) :: self
      integer, intent(in) :: percentile, column
      real(wp), intent(in) :: values(:)   !! that all ranks have kept
      real(wp) :: found(size(self%place, 1))   !! (target)

      associate (ranking => sort_order(values))
         found = values(ranking(self%place(:, percentile) - self%n_below(percentile, column)))
      end associate
   end function order_statistics

end module campaign_selection
