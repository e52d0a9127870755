!> Order statistics of many columns of numbers, exact, while no rank holds a column whole.
!>
!> A column is all samples' values of one quantity. Each wanted percentile has a bracket that its
!> order statistics are expected in. First every value is counted that lies below the bracket, and
!> kept where it lies inside. Then the order statistics are bisected: of a real number's bits, read
!> as an integer, half of the interval is left each time, by the number of values up to its middle.
!> Counts are sums over the ranks, so the result is the same on any number of them.
!>
!> `start_selection`; `add` all values; `check` the sums of `counts`, and add all again while
!> brackets missed; `halve` by the sums of `count_to_middle` until `is_done`; then `value`.
module campaign_selection
   use core_kinds, only: long, wp
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
      type(kept_values), allocatable :: kept(:, :)       !! (percentile, column) of this rank
      !> (below or inside, percentile, column) this rank's values
      real(wp), allocatable, public :: counts(:, :, :)
      integer(long), allocatable :: low(:, :, :), high(:, :, :)   !! (target, percentile, column)
   contains
      procedure :: add
      procedure :: check
      procedure :: count_to_middle
      procedure :: halve
      procedure :: is_done
      procedure :: value
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
         allocate (selection%kept(np, n_columns))
         allocate (selection%is_met(np, n_columns), source=.false.)
         allocate (selection%counts(2, np, n_columns), source=0.0_wp)
         allocate (selection%low(size(place, 1), np, n_columns))
         allocate (selection%high, mold=selection%low)
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

   !> Checks the counts added over the ranks: starts to bisect once every bracket holds its order
   !> statistics. Else widens the others fully, and all values must be added again.
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
                  kept%value = kept%value(sort_order(kept%value))
                  self%low(:, p, c) = key_of(bracket(1))
                  self%high(:, p, c) = key_of(bracket(2))
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

   !> This rank's values up to the middle of each interval.
   pure function count_to_middle(self) result(counts)
      class(selection_type), intent(in) :: self
      real(wp), allocatable :: counts(:, :, :)   !! (target, percentile, column)
      integer :: c, p, t

      allocate (counts(size(self%low, 1), size(self%low, 2), size(self%low, 3)))
      do c = 1, size(counts, 3)
         do p = 1, size(counts, 2)
            do t = 1, size(counts, 1)
               counts(t, p, c) = self%counts(below, p, c) &
                                 + count_to(self%kept(p, c)%value, &
                                            middle_of(self%low(t, p, c), self%high(t, p, c)))
            end do
         end do
      end do
   end function count_to_middle

   !> Leaves the half with the wanted order statistic, from the sums over the ranks.
   pure subroutine halve(self, counts)
      class(selection_type), intent(inout) :: self
      real(wp), intent(in) :: counts(:, :, :)   !! (target, percentile, column)
      integer :: c, p, t

      do c = 1, size(counts, 3)
         do p = 1, size(counts, 2)
            do t = 1, size(counts, 1)
               associate (low => self%low(t, p, c), high => self%high(t, p, c))
                  if (low == high) cycle
                  if (counts(t, p, c) >= self%place(t, p)) then
                     high = middle_of(low, high)
                  else
                     low = middle_of(low, high) + 1
                  end if
               end associate
            end do
         end do
      end do
   end subroutine halve

   pure logical function is_done(self)
      class(selection_type), intent(in) :: self

      is_done = all(self%low == self%high)
   end function is_done

   !> The order statistic of a column.
   pure real(wp) function value(self, target, percentile, column)
      class(selection_type), intent(in) :: self
      integer, intent(in) :: target, percentile, column

      value = real_of(self%low(target, percentile, column))
   end function value

   !> Number of ascending values that are not above a limit.
   pure integer function count_to(values, limit)
      real(wp), intent(in) :: values(:)
      integer(long), intent(in) :: limit   !! as key_of has it
      integer :: first, last, middle

      first = 0
      last = size(values)
      do while (first < last)
         middle = last - (last - first)/2
         if (key_of(values(middle)) <= limit) then
            first = middle
         else
            last = middle - 1
         end if
      end do
      count_to = first
   end function count_to

   !> An integer that ascends with the real number: its bits, for a negative one turned around.
   elemental integer(long) function key_of(number)
      real(wp), intent(in) :: number

      key_of = transfer(number, key_of)
      if (key_of < 0) key_of = ieor(key_of, huge(key_of))
   end function key_of

   elemental real(wp) function real_of(key)
      integer(long), intent(in) :: key

      real_of = transfer(merge(ieor(key, huge(key)), key, key < 0), real_of)
   end function real_of

   !> Their mean, rounded down; their sum may be too large for an integer.
   elemental integer(long) function middle_of(low, high)
      integer(long), intent(in) :: low, high

      middle_of = iand(low, high) + shifta(ieor(low, high), 1)
   end function middle_of

end module campaign_selection
