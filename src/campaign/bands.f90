!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the ratio of the outer ones.
!>
!> Percentiles interpolate linearly between order statistics (Hyndman and Fan, type 7). Their
!> pointwise intervals are order statistics (binomial, 95 %). What integrals over all frequencies
!> enter has its errors from the bootstrap over samples: standard errors of the pseudo-variances of
!> percentiles, and for the ratio the interval ratio exp(+-1.96 s), s the standard error of its
!> logarithm. The bootstrap also tells the ratio's bias: percentiles of few samples are drawn
!> inward.
!>
!> Memory does not grow with n_samples: spectra come a range of frequencies and a group of at most
!> 2**14 samples at a time. Where there is more than one group, its percentiles, averaged over the
!> groups, are where those of all samples are looked for: `open_selection`, to which all spectra are
!> added again, and `take_selection`. The bootstrap draws within groups, fewer times in each.
!>
!> Ranges of frequencies and groups may be taken by different ranks: sums over the ranks of
!> at_frequency, moments, replicate, integral and batches%variance, which are zero where nothing was
!> added, make a collector that has all. Groups are joined in their order, so the sums have the same
!> bits on any number of ranks; at_frequency alone has not, before the selection.
module campaign_bands
   use campaign_band_batches, only: batch_collector, not_a_number, start_batches
   use campaign_bootstrap, only: draw_again, find_again
   use campaign_results, only: case_statistics
   use campaign_selection, only: selection_type, start_selection
   use core_kinds, only: long, wp
   use numerics_correlated, only: n_batches
   use numerics_sorting, only: sort_order
   use numerics_spectrum, only: last_of_ranges
   use numerics_statistics, only: error_of_mean
   use statistics_order, only: at_rank, interval_rank
   implicit none(type, external)
   private
   public :: band_collector, start_bands, largest_group, n_replicates, sample_groups

   integer, parameter :: largest_group = 2**14    !! samples sorted together
   integer, parameter :: n_replicates = 400       !! of the bootstrap: intervals scatter by 5 %
   integer, parameter :: most_bins = 512       !! of samples, whose integrals are kept

   !> Collects the spectra of one case, by ranges of frequencies and groups of samples.
   type :: band_collector
      integer, allocatable :: group_first(:)   !! (group + 1) first sample; behind the last: n + 1
      !> (dof, frequency, percentiles, lower ends of their intervals, upper ends)
      real(wp), allocatable :: at_frequency(:, :, :)
      !> (dof, frequency, group, mean or sum of squared deviations)
      real(wp), allocatable :: moments(:, :, :, :)
      !> (dof, percentile, replicate, slice) pseudo-variances; the replicates of a group together
      real(wp), allocatable :: replicate(:, :, :, :)
      !> (dof, bin, slice, group) mean integral of densities; bins from the group's first on
      real(wp), allocatable :: integral(:, :, :, :)
      type(batch_collector) :: batches             !! of the march
      integer, private :: n_samples = 0
      integer, private :: n_drawn = 0              !! replicates of each group
      integer, private :: bin_width = 1            !! samples whose integrals are kept as one
      integer(long), private :: seed = 0
      real(wp), private :: step = 0.0_wp           !! between frequencies [Hz]
      !> (percentiles, their lower ends, their upper ends) places among 1..n_samples
      real(wp), allocatable, private :: rank(:)
      integer, private :: n_percentiles = 0
      integer, allocatable, private :: last_of_range(:)   !! (range) as last_of_ranges has them
   contains
      procedure :: add
      procedure :: finish
      procedure :: first_of_power
      procedure :: has_selection
      procedure :: n_groups
      procedure :: open_selection
      procedure :: percentiles_at
      procedure :: take_selection
   end type band_collector

contains

   !> First samples of groups of nearly equal size, as few as possible; behind the last, n + 1.
   pure function sample_groups(n_samples) result(first)
      integer, intent(in) :: n_samples
      integer, allocatable :: first(:)   !! (group + 1)
      integer :: g, n_groups

      n_groups = (n_samples - 1)/largest_group + 1
      first = [(1 + int((g - 1)*int(n_samples, long)/n_groups), g=1, n_groups + 1)]
   end function sample_groups

   !> Prepares a collector; needs two samples or more.
   subroutine start_bands(n_samples, n_dof, frequency, percentiles, seed, n_slices, collector, &
                          follows_power, draws_again)
      integer, intent(in) :: n_samples, n_dof
      real(wp), intent(in) :: frequency(:)      !! (frequency) [Hz], equally spaced from 0
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      integer, intent(in) :: n_slices            !! in which the frequencies come
      type(band_collector), intent(out) :: collector
      logical, intent(in), optional :: follows_power   !! `add` gets it
      logical, intent(in), optional :: draws_again     !! .false.: `finish` is not wanted
      integer :: n_groups, np, p, widest

      np = size(percentiles)
      collector%n_samples = n_samples
      collector%n_percentiles = np
      collector%seed = seed
      collector%step = frequency(2) - frequency(1)
      collector%group_first = sample_groups(n_samples)
      collector%last_of_range = last_of_ranges(size(frequency))
      n_groups = size(collector%group_first) - 1
      collector%n_drawn = max(2, (n_replicates - 1)/n_groups + 1)
      if (present(draws_again)) collector%n_drawn = merge(collector%n_drawn, 0, draws_again)
      collector%bin_width = (n_samples - 1)/most_bins + 1
      widest = maxval(collector%group_first(2:) - collector%group_first(:n_groups))
      allocate (collector%rank(3*np))
      collector%rank(:np) = 1.0_wp + (n_samples - 1)*percentiles/100.0_wp
      do p = 1, np
         collector%rank(np + p) = interval_rank(n_samples, percentiles(p)/100.0_wp, .false.)
         collector%rank(2*np + p) = interval_rank(n_samples, percentiles(p)/100.0_wp, .true.)
      end do
      allocate (collector%at_frequency(n_dof, size(frequency), 3*np), source=0.0_wp)
      allocate (collector%moments(n_dof, size(frequency), n_groups, 2), source=0.0_wp)
      allocate (collector%replicate(n_dof, np, n_groups*collector%n_drawn, n_slices), source=0.0_wp)
      allocate (collector%integral(n_dof, (widest - 1)/collector%bin_width + 2, n_slices, &
                                   n_groups), source=0.0_wp)
      if (.not. present(follows_power)) return
      if (follows_power) call start_batches(np, n_dof, n_slices*n_groups, collector%batches)
   end subroutine start_bands

   !> Takes the spectra of a group's samples at frequencies first, first + 1, ..., which belong to
   !> one slice. Frequencies of a slice come in order. `power`: how their power varies along the
   !> march, where it was followed.
   pure subroutine add(self, slice, first, group, psd, power)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: slice, first, group
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) from the range of the first frequency on
      real(wp), intent(in), optional :: power(:, :, :)
      integer :: times(self%n_drawn, size(psd, 3)), ranking(size(psd, 3))
      real(wp) :: sorted(size(psd, 3)), again(self%n_drawn), weight
      real(wp) :: rank(size(self%rank)), at_ranks(size(self%rank))
      integer :: dof, f, p, before, place

      weight = real(size(psd, 3), wp)/self%n_samples
      rank = rank_in_group(self, size(psd, 3))
      before = (group - 1)*self%n_drawn
      call draw_again(self%seed, before, times)
      do f = 1, size(psd, 2)
         place = self%first_of_power(first + f - 1) - self%first_of_power(first)
         do dof = 1, size(psd, 1)
            call add_to_bins(self, self%group_first(group), psd(dof, f, :), &
                             self%integral(dof, :, slice, group))
            ranking = sort_order(psd(dof, f, :))
            sorted = psd(dof, f, ranking)
            at_ranks = [(at_rank(sorted, rank(p)), p=1, size(rank))]
            associate (at => self%at_frequency(dof, first + f - 1, :), &
                       moments => self%moments(dof, first + f - 1, group, :))
               at = at + weight*at_ranks
               moments(1) = sum(sorted)/size(sorted)
               moments(2) = sum((sorted - moments(1))**2)
            end associate
            if (present(power)) &
               call add_power(self, (group - 1)*size(self%integral, 3) + slice, dof, weight, &
                              psd(dof, f, :), ranking, &
                              power(dof, place + 1:place + n_batches, :), rank, &
                              at_ranks(:self%n_percentiles))
            do p = 1, self%n_percentiles
               call find_again(sorted, ranking, times, rank(p), again)
               associate (drawn => self%replicate(dof, p, before + 1:before + size(again), slice))
                  drawn = drawn + self%step*again
               end associate
            end do
         end do
      end do
   end subroutine add

   !> First place of the power series of a frequency's range; those of lower ranges lie before.
   pure integer function first_of_power(self, frequency)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency

      first_of_power = 1 + n_batches*count(self%last_of_range < frequency)
   end function first_of_power

   !> Returns the percentiles at one frequency and the ends of their intervals, of all groups.
   pure subroutine percentiles_at(self, frequency, value, low, high)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency
      !> (dof, percentile)
      real(wp), allocatable, intent(out) :: value(:, :), low(:, :), high(:, :)

      associate (at => self%at_frequency(:, frequency, :), np => self%n_percentiles)
         value = at(:, :np)
         low = at(:, np + 1:2*np)
         high = at(:, 2*np + 1:)
      end associate
   end subroutine percentiles_at

   pure integer function n_groups(self)
      class(band_collector), intent(in) :: self

      n_groups = size(self%group_first) - 1
   end function n_groups

   !> True if the percentiles of all samples have to be selected: those of the groups are not them.
   pure logical function has_selection(self)
      class(band_collector), intent(in) :: self

      has_selection = self%n_groups() > 1
   end function has_selection

   !> Starts the search for the order statistics of all samples at frequencies first..last, a
   !> column for each dof and frequency: those on both sides of each percentile and at the ends of
   !> its interval. The groups know the interval to a third of its width; the bracket is three
   !> times as wide.
   pure subroutine open_selection(self, first, last, selection)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: first, last
      type(selection_type), intent(out) :: selection
      real(wp), parameter :: rounding = 1.0e-12_wp   ! of the mean over groups
      real(wp), allocatable :: bracket(:, :, :)
      real(wp) :: high, low
      integer :: dof, f, n_dof, p, place(4, self%n_percentiles)

      n_dof = size(self%at_frequency, 1)
      allocate (bracket(2, self%n_percentiles, n_dof*(last - first + 1)))
      do p = 1, self%n_percentiles
         associate (np => self%n_percentiles, below => min(int(self%rank(p)), self%n_samples - 1))
            place(:, p) = [below, below + 1, nint(self%rank(np + p)), nint(self%rank(2*np + p))]
            do f = first, last
               do dof = 1, n_dof
                  low = self%at_frequency(dof, f, np + p)
                  high = self%at_frequency(dof, f, 2*np + p)
                  bracket(:, p, dof + n_dof*(f - first)) = &
                     [low - (high - low) - rounding*abs(low), &
                      high + (high - low) + rounding*abs(high)]
               end do
            end do
         end associate
      end do
      call start_selection(place, bracket, selection)
   end subroutine open_selection

   !> Puts what was selected in the place of the groups' percentiles.
   pure subroutine take_selection(self, first, last, selection)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: first, last
      type(selection_type), intent(in) :: selection
      real(wp) :: above, below
      integer :: column, dof, f, p

      do f = first, last
         do dof = 1, size(self%at_frequency, 1)
            column = dof + size(self%at_frequency, 1)*(f - first)
            associate (at => self%at_frequency(dof, f, :), np => self%n_percentiles)
               do p = 1, np
                  below = selection%value(1, p, column)
                  above = selection%value(2, p, column)
                  at(p) = below + (self%rank(p) - min(int(self%rank(p)), self%n_samples - 1)) &
                          *(above - below)
                  at(np + p) = selection%value(3, p, column)
                  at(2*np + p) = selection%value(4, p, column)
               end do
            end associate
         end do
      end do
   end subroutine take_selection

   !> Adds one frequency of one dof to the batches of the march.
   pure subroutine add_power(self, slice, dof, weight, density, ranking, power, rank, percentile)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: slice, dof        !! the slice as one of all groups'
      real(wp), intent(in) :: weight          !! of the group among all samples
      real(wp), intent(in) :: density(:)      !! (sample)
      integer, intent(in) :: ranking(:)         !! of the samples, ascending
      real(wp), intent(in) :: power(:, :)     !! (batch, sample)
      real(wp), intent(in) :: rank(:)         !! in the group, as in self
      real(wp), intent(in) :: percentile(:)   !! of the densities
      real(wp) :: at(0:size(percentile))

      at(0) = sum(density)/size(density)
      at(1:) = percentile
      associate (np => size(percentile))
         call self%batches%add(slice, dof, density, ranking, power, self%step*weight*at, &
                               rank(np + 1:2*np), rank(2*np + 1:))
      end associate
   end subroutine add_power

   !> Ranks in a group of m samples that are expected at the same probability, rank/(m + 1), as the
   !> ranks among all samples.
   pure function rank_in_group(self, m) result(rank)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: m
      real(wp) :: rank(size(self%rank))

      rank = self%rank*((m + 1)/(self%n_samples + 1.0_wp))
      rank = max(1.0_wp, min(rank, real(m, wp)))
   end function rank_in_group

   !> Adds one frequency to the integrals of the samples, as means over bins of samples.
   pure subroutine add_to_bins(self, first_sample, density, integral)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: first_sample
      real(wp), intent(in) :: density(:)         !! (sample)
      real(wp), intent(inout) :: integral(:)     !! (bin) from that of the first sample on
      integer :: b, i

      do i = 1, size(density)
         b = (first_sample + i - 2)/self%bin_width - (first_sample - 1)/self%bin_width + 1
         integral(b) = integral(b) + self%step*density(i)/self%bin_width
      end do
   end subroutine add_to_bins

   !> Joins mean and sum of squared deviations of the groups to those of all samples (Chan).
   pure subroutine join_moments(self, dof, frequency, mean, square)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: dof, frequency
      real(wp), intent(out) :: mean, square
      real(wp) :: apart
      integer :: g, n, n_before

      mean = 0.0_wp
      square = 0.0_wp
      do g = 1, self%n_groups()
         n_before = self%group_first(g) - 1
         n = self%group_first(g + 1) - self%group_first(g)
         associate (ours => self%moments(dof, frequency, g, :))
            apart = ours(1) - mean
            square = square + ours(2) + apart**2*(real(n, wp)*n_before/(n + n_before))
            mean = merge(ours(1), mean + apart*n/(n + n_before), n_before == 0)
         end associate
      end do
   end subroutine join_moments

   !> Integrals of the bins of all samples; the last samples are left out where they do not fill
   !> one.
   pure function join_integrals(self, dof) result(integral)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: dof
      real(wp) :: integral(self%n_samples/self%bin_width)
      integer :: b, before, g

      integral = 0.0_wp
      do g = 1, self%n_groups()
         before = (self%group_first(g) - 1)/self%bin_width
         do b = 1, min(size(self%integral, 2), size(integral) - before)
            integral(before + b) = integral(before + b) + sum(self%integral(dof, b, :, g))
         end do
      end do
   end function join_integrals

   !> Computes, once all frequencies of all ranks are added, the statistics, the errors of the
   !> pseudo-variances, and the ratio of the last percentile's to the first one's; NaN for a dof
   !> that does not move in that share of the samples.
   pure subroutine finish(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: square
      integer :: dof, f, np

      np = self%n_percentiles
      associate (at => self%at_frequency, n => real(self%n_samples, wp))
         allocate (statistics%psd_mean(size(at, 1), size(at, 2)))
         allocate (statistics%psd_mean_error, mold=statistics%psd_mean)
         do f = 1, size(at, 2)
            do dof = 1, size(at, 1)
               call join_moments(self, dof, f, statistics%psd_mean(dof, f), square)
               statistics%psd_mean_error(dof, f) = sqrt(square/(n - 1)/n)
            end do
         end do
         statistics%psd_percentiles = at(:, :, :np)
         statistics%psd_percentiles_low = at(:, :, np + 1:2*np)
         statistics%psd_percentiles_high = at(:, :, 2*np + 1:)
         allocate (statistics%pseudo_variance_mean(size(at, 1)), source=0.0_wp)
         allocate (statistics%pseudo_variance_percentiles(size(at, 1), np), source=0.0_wp)
         do f = 1, size(at, 2)
            statistics%pseudo_variance_mean = statistics%pseudo_variance_mean &
                                              + self%step*statistics%psd_mean(:, f)
            statistics%pseudo_variance_percentiles = statistics%pseudo_variance_percentiles &
                                                     + self%step*statistics%psd_percentiles(:, f, :)
         end do
         statistics%pseudo_variance_mean_error = &
            [(error_of_mean(join_integrals(self, dof)), dof=1, size(at, 1))]
      end associate
      call find_ratios(self, statistics)
      if (allocated(self%batches%variance)) call self%batches%finish(statistics)
   end subroutine finish

   !> Computes the errors of the band ratios by the bootstrap. Replicates scatter about the value
   !> of their group and groups are independent: the variance of the mean over G groups is the sum
   !> of theirs over G^2.
   pure subroutine find_ratios(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: variance(self%n_percentiles, size(self%replicate, 3)), ratio, spread
      integer :: dof, last, p

      last = self%n_percentiles
      allocate (statistics%pseudo_variance_percentiles_error, &
                mold=statistics%pseudo_variance_percentiles)
      allocate (statistics%band_ratio(size(self%replicate, 1)), source=not_a_number)
      statistics%band_ratio_low = statistics%band_ratio
      statistics%band_ratio_high = statistics%band_ratio
      statistics%band_ratio_bias = statistics%band_ratio
      do dof = 1, size(statistics%band_ratio)
         variance = sum(self%replicate(dof, :, :, :), 3)
         statistics%pseudo_variance_percentiles_error(dof, :) = &
            [(error_over_groups(self, variance(p, :)), p=1, last)]
         if (any(.not. variance(1, :) > 0.0_wp)) cycle
         associate (logarithm => log(variance(last, :)/variance(1, :)))
            spread = 1.96_wp*error_over_groups(self, logarithm)
            ratio = statistics%pseudo_variance_percentiles(dof, last) &
                    /statistics%pseudo_variance_percentiles(dof, 1)
            statistics%band_ratio(dof) = ratio
            statistics%band_ratio_low(dof) = ratio*exp(-spread)
            statistics%band_ratio_high(dof) = ratio*exp(spread)
            statistics%band_ratio_bias(dof) = exp(sum(logarithm)/size(logarithm))/ratio - 1.0_wp
         end associate
      end do
   end subroutine find_ratios

   !> Standard error of the mean over groups of what its replicates scatter in.
   pure function error_over_groups(self, replicate) result(error)
      class(band_collector), intent(in) :: self
      real(wp), intent(in) :: replicate(:)   !! those of a group together
      real(wp) :: error, mean, squares
      integer :: b

      squares = 0.0_wp
      do b = 1, size(replicate), self%n_drawn
         associate (group => replicate(b:b + self%n_drawn - 1))
            mean = sum(group)/self%n_drawn
            squares = squares + sum((group - mean)**2)
         end associate
      end do
      error = sqrt(squares/(self%n_drawn - 1))/(size(replicate)/self%n_drawn)
   end function error_over_groups

end module campaign_bands
