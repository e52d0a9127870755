!> Plain statistics of many columns of numbers: moments, and percentiles with their 95 % intervals.
!> A column holds one number of every sample. Samples are added in groups.
!>
!> Percentiles interpolate linearly between order statistics (Hyndman and Fan, type 7). The ends of
!> their intervals are order statistics (binomial, 95 %), or lie beyond all samples if these are too
!> few. With more than one group, the percentiles averaged over the groups show where to select the
!> order statistics of all samples: `open_selection`, to which all values are added again, and
!> `store_selected`.
!>
!> A selection has for each percentile a bracket in which its order statistics are expected. Values
!> below the bracket are counted, values inside it are kept. They are few: joined from all ranks and
!> sorted, they contain the order statistics, the same on any number of ranks. `add` all values;
!> `check` with the sums of `counts` over the ranks. If a bracket misses its order statistics, add
!> all values and check again. Then `order_statistics` finds those of a bracket in the values that
!> all ranks have `kept`.
!>
!> Ranks may add different groups: `sums` and `at` are then summed over the ranks. `at` has the same
!> bits on any number of ranks only after the selection.
module campaign_columns
   use core_kinds, only: long, wp
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: deviation_error_of_sums, deviation_of_sums, freedoms_of_sums, &
                                  joined_sums, mean_error_of_sums, n_sums, sums_of
   use statistics_estimates, only: limit_beyond_samples, statistic_type, sort_percentiles
   use statistics_percentiles, only: at_rank, interval_rank
   implicit none(type, external)
   private
   public :: column_collector, selection_type, start_columns, start_selection, largest_group, &
             sample_groups

   integer, parameter :: largest_group = 2**14    !! number of samples sorted at once
   integer, parameter, public :: middle = 1, low = 2, high = 3   !! percentile, ends of its interval

   !> Sums and percentiles of the columns.
   type :: column_collector
      integer :: n_samples = 0, n_percentiles = 0
      integer :: n_groups = 0   !! if more than 1, the percentiles of all samples must be selected
      integer, allocatable :: group_first(:)   !! (group) first sample; last, n_samples + 1
      real(wp), allocatable :: sums(:, :, :)   !! (sum as in sums_of, column, group)
      real(wp), allocatable :: at(:, :, :)     !! (column, percentile; middle, low or high)
      real(wp), allocatable :: share_below(:)  !! (percentile) percentile/100
      !> (percentile; middle, low or high) rank among all samples; 0 or n_samples + 1: beyond them
      real(wp), allocatable, private :: rank(:, :)
   contains
      procedure :: group_size
      procedure :: ranks_in_group
      procedure :: add
      procedure :: open_selection
      procedure :: store_selected
      procedure :: finish
      procedure, private :: below
   end type column_collector

   !> Values in a bracket.
   type :: kept_values
      real(wp), allocatable :: value(:)
   end type kept_values

   !> Places in `counts` of the values below a bracket and inside it.
   integer, parameter :: below_bracket = 1, in_bracket = 2

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
      procedure :: add => add_to_selection
      procedure :: check
      procedure :: order_statistics
   end type selection_type

contains

   !> First samples of the fewest groups of nearly equal size; last, n_samples + 1.
   pure function sample_groups(n_samples) result(first)
      integer, intent(in) :: n_samples
      integer, allocatable :: first(:)   !! (group + 1)
      integer :: g, n_groups

      n_groups = (n_samples - 1)/largest_group + 1
      first = [(1 + int((g - 1)*int(n_samples, long)/n_groups), g=1, n_groups + 1)]
   end function sample_groups

   !> Prepares a collector; needs two samples or more.
   pure subroutine start_columns(n_samples, n_columns, percentiles, collector)
      integer, intent(in) :: n_samples, n_columns
      real(wp), intent(in) :: percentiles(:)   !! [%]
      type(column_collector), intent(out) :: collector
      integer :: p

      collector%n_samples = n_samples
      collector%n_percentiles = size(percentiles)
      collector%group_first = sample_groups(n_samples)
      collector%n_groups = size(collector%group_first) - 1
      collector%share_below = percentiles/100.0_wp
      allocate (collector%rank(size(percentiles), 3))
      collector%rank(:, middle) = 1.0_wp + (n_samples - 1)*percentiles/100.0_wp
      do p = 1, size(percentiles)
         collector%rank(p, low) = interval_rank(n_samples, collector%share_below(p), .false.)
         collector%rank(p, high) = interval_rank(n_samples, collector%share_below(p), .true.)
      end do
      allocate (collector%sums(n_sums, n_columns, collector%n_groups), &
                collector%at(n_columns, size(percentiles), 3), source=0.0_wp)
   end subroutine start_columns

   !> Number of samples of a group.
   pure integer function group_size(self, group)
      class(column_collector), intent(in) :: self
      integer, intent(in) :: group

      group_size = self%group_first(group + 1) - self%group_first(group)
   end function group_size

   !> Ranks in a group of m samples with the same probability, rank/(m + 1), as the ranks among all
   !> samples.
   pure function ranks_in_group(self, m) result(rank)
      class(column_collector), intent(in) :: self
      integer, intent(in) :: m
      real(wp) :: rank(self%n_percentiles, 3)   !! (percentile; middle, low or high)

      rank = self%rank*((m + 1)/(self%n_samples + 1.0_wp))
      rank = max(1.0_wp, min(rank, real(m, wp)))
   end function ranks_in_group

   !> Adds the values of a group in one column; returns their percentiles and order on demand.
   pure subroutine add(self, column, group, values, in_group, ranking)
      class(column_collector), intent(inout) :: self
      integer, intent(in) :: column, group
      real(wp), intent(in) :: values(:)                !! (sample)
      real(wp), intent(out), optional :: in_group(:)   !! (percentile)
      integer, intent(out), optional :: ranking(:)     !! samples in ascending order
      integer :: ascending(size(values)), p, position
      real(wp), dimension(self%n_percentiles, 3) :: percentile, rank
      real(wp) :: sorted(size(values))

      ascending = sort_order(values)
      sorted = values(ascending)
      rank = self%ranks_in_group(size(values))
      do position = 1, 3
         do p = 1, size(rank, 1)
            percentile(p, position) = at_rank(sorted, rank(p, position))
            if (self%rank(p, position) < 1.0_wp .or. self%rank(p, position) > self%n_samples) &
               percentile(p, position) = limit_beyond_samples(sorted, self%share_below(p), &
                                                              position == high)
         end do
      end do
      self%sums(:, column, group) = sums_of(values)
      self%at(column, :, :) = self%at(column, :, :) &
                              + real(size(values), wp)/self%n_samples*percentile
      if (present(in_group)) in_group = percentile(:, middle)
      if (present(ranking)) ranking = ascending
   end subroutine add

   !> Starts the selection of the order statistics of all samples in columns first..last: those on
   !> both sides of each percentile, and the ends of its interval. The interval averaged over the
   !> groups is accurate to a third of its width; its bracket is three times as wide.
   pure subroutine open_selection(self, first, last, selection)
      class(column_collector), intent(in) :: self
      integer, intent(in) :: first, last
      type(selection_type), intent(out) :: selection
      real(wp), parameter :: rounding = 1.0e-12_wp   ! relative error of means over groups
      real(wp) :: bracket(2, self%n_percentiles, last - first + 1)
      integer :: c, p, place(4, self%n_percentiles)

      do p = 1, self%n_percentiles
         place(:, p) = [self%below(p), self%below(p) + 1, &
                        max(1, min(nint(self%rank(p, [low, high])), self%n_samples))]
         do c = first, last
            associate (ends => self%at(c, p, [low, high]))
               bracket(:, p, c - first + 1) = ends + ((ends(2) - ends(1)) + rounding*abs(ends)) &
                                              *[-1.0_wp, 1.0_wp]
            end associate
         end do
      end do
      call start_selection(place, bracket, selection)
   end subroutine open_selection

   !> Replaces the mean over the groups of a percentile and its interval by the order statistics of
   !> all samples.
   pure subroutine store_selected(self, column, p, found)
      class(column_collector), intent(inout) :: self
      integer, intent(in) :: column, p
      real(wp), intent(in) :: found(:)   !! order statistics, as listed by open_selection

      self%at(column, p, :) = [found(1) + (self%rank(p, middle) - self%below(p)) &
                               *(found(2) - found(1)), found(3), found(4)]
   end subroutine store_selected

   !> Computes the statistics after all groups are added and the percentiles of all samples are
   !> selected.
   pure subroutine finish(self, statistics, deviations, freedoms)
      class(column_collector), intent(in) :: self
      !> (column, statistic) mean and percentiles
      type(statistic_type), intent(out) :: statistics(size(self%at, 1), self%n_percentiles + 1)
      type(statistic_type), intent(out), optional :: deviations(size(self%at, 1))   !! standard
      real(wp), intent(out), optional :: freedoms(size(self%at, 1))   !! Student's, of means
      real(wp) :: sums(n_sums)
      integer :: column, group

      do column = 1, size(statistics, 1)
         sums = self%sums(:, column, 1)
         do group = 2, self%n_groups
            sums = joined_sums(sums, self%sums(:, column, group))
         end do
         statistics(column, 1) = statistic_type(sums(2), mean_error_of_sums(sums))
         if (present(deviations)) deviations(column) = &
            statistic_type(deviation_of_sums(sums), deviation_error_of_sums(sums))
         if (present(freedoms)) freedoms(column) = freedoms_of_sums(sums)
         associate (percentiles => statistics(column, 2:))
            percentiles%value = self%at(column, :, middle)
            percentiles%low = self%at(column, :, low)
            percentiles%high = self%at(column, :, high)
            call sort_percentiles(percentiles)   ! ends beyond the samples may cross
         end associate
      end do
   end subroutine finish

   !> Number of the order statistic below a percentile.
   pure integer function below(self, p)
      class(column_collector), intent(in) :: self
      integer, intent(in) :: p

      below = min(int(self%rank(p, middle)), self%n_samples - 1)
   end function below

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
   pure subroutine add_to_selection(self, column, values)
      class(selection_type), intent(inout) :: self
      integer, intent(in) :: column
      real(wp), intent(in) :: values(:)
      integer :: p

      do p = 1, size(self%bracket, 2)
         if (self%is_complete(p, column)) cycle
         associate (counts => self%counts(:, p, column), low => self%bracket(1, p, column), &
                    high => self%bracket(2, p, column))
            counts(below_bracket) = counts(below_bracket) + count(values < low)
            self%kept(p, column)%value = [self%kept(p, column)%value, &
                                          pack(values, values >= low .and. values <= high)]
            counts(in_bracket) = size(self%kept(p, column)%value)
         end associate
      end do
   end subroutine add_to_selection

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
               self%is_complete(p, c) = minval(rank) > counts(below_bracket, p, c) .and. &
                                        maxval(rank) <= sum(counts(:, p, c))
               if (self%is_complete(p, c)) then
                  self%n_below(p, c) = nint(counts(below_bracket, p, c))
               else
                  if (bracket(2) >= huge(bracket)) error stop 'campaign_columns: not a number'
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

end module campaign_columns
