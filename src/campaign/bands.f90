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
!> 2**14 samples at a time. Up to that many, percentiles are those of all samples; beyond, means
!> over the groups of each group's, which scatter no more. From the percentiles of all they then
!> differ by a fifth of their standard error to 100,000 samples and a third at a million (rms;
!> exponential and lognormal densities). The bootstrap draws within groups, fewer times in each.
!>
!> Ranges of frequencies may be taken by different ranks: sums over the ranks of at_frequency,
!> replicate, integral and batches%level, which are zero where nothing was added, make a collector
!> that has all.
module campaign_bands
   use campaign_band_batches, only: batch_collector, not_a_number, start_batches
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
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
   integer, parameter :: most_batches = 512       !! of samples, whose integrals are kept
   integer, parameter :: mean_of = 1, square_of = 2, n_moments = 2   !! of at_frequency

   !> Collects the spectra of one case, by ranges of frequencies and groups of samples.
   type :: band_collector
      integer, allocatable :: group_first(:)   !! (group + 1) first sample; behind the last: n + 1
      !> (dof, frequency, mean and sum of squared deviations, percentiles, lower, upper ends)
      real(wp), allocatable :: at_frequency(:, :, :)
      !> (dof, percentile, replicate, part) pseudo-variances; the replicates of a group together
      real(wp), allocatable :: replicate(:, :, :, :)
      real(wp), allocatable :: integral(:, :, :)   !! (dof, batch, part) mean integral of densities
      type(batch_collector) :: batches             !! of the march
      integer, private :: n_samples = 0
      integer, private :: n_drawn = 0              !! replicates of each group
      integer, private :: batch = 1                !! samples whose integrals are kept as one
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
      procedure :: percentiles_at
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
   subroutine start_bands(n_samples, n_dof, frequency, percentiles, seed, n_parts, collector, &
                          follows_power)
      integer, intent(in) :: n_samples, n_dof
      real(wp), intent(in) :: frequency(:)      !! (frequency) [Hz], equally spaced from 0
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      integer, intent(in) :: n_parts            !! in which the frequencies come
      type(band_collector), intent(out) :: collector
      logical, intent(in), optional :: follows_power   !! `add` gets it
      integer :: n_groups, np, p

      np = size(percentiles)
      collector%n_samples = n_samples
      collector%n_percentiles = np
      collector%seed = seed
      collector%step = frequency(2) - frequency(1)
      collector%group_first = sample_groups(n_samples)
      collector%last_of_range = last_of_ranges(size(frequency))
      n_groups = size(collector%group_first) - 1
      collector%n_drawn = max(2, (n_replicates - 1)/n_groups + 1)
      collector%batch = (n_samples - 1)/most_batches + 1
      allocate (collector%rank(3*np))
      collector%rank(:np) = 1.0_wp + (n_samples - 1)*percentiles/100.0_wp
      do p = 1, np
         collector%rank(np + p) = interval_rank(n_samples, percentiles(p)/100.0_wp, .false.)
         collector%rank(2*np + p) = interval_rank(n_samples, percentiles(p)/100.0_wp, .true.)
      end do
      allocate (collector%at_frequency(n_dof, size(frequency), n_moments + 3*np), source=0.0_wp)
      allocate (collector%replicate(n_dof, np, n_groups*collector%n_drawn, n_parts), source=0.0_wp)
      allocate (collector%integral(n_dof, n_samples/collector%batch, n_parts), source=0.0_wp)
      if (.not. present(follows_power)) return
      if (follows_power) call start_batches(np, n_dof, n_parts, collector%batches)
   end subroutine start_bands

   !> Takes the spectra of a group's samples at frequencies first, first + 1, ..., which belong to
   !> one part. Groups come in order, frequencies of a part too. `power`: how their power varies
   !> along the march, where it was followed.
   pure subroutine add(self, part, first, group, psd, power)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: part, first, group
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) from the range of the first frequency on
      real(wp), intent(in), optional :: power(:, :, :)
      integer :: times(self%n_drawn, size(psd, 3)), order(size(psd, 3))
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
            call add_to_batches(self, self%group_first(group), psd(dof, f, :), &
                                self%integral(dof, :, part))
            order = sort_order(psd(dof, f, :))
            sorted = psd(dof, f, order)
            at_ranks = [(at_rank(sorted, rank(p)), p=1, size(rank))]
            associate (at => self%at_frequency(dof, first + f - 1, :))
               call add_moments(self%group_first(group) - 1, sorted, at(mean_of), at(square_of))
               at(n_moments + 1:) = at(n_moments + 1:) + weight*at_ranks
            end associate
            if (present(power)) &
               call add_power(self, part, dof, weight, psd(dof, f, :), order, &
                              power(dof, place + 1:place + n_batches, :), rank, &
                              at_ranks(:self%n_percentiles))
            do p = 1, self%n_percentiles
               call find_again(sorted, order, times, rank(p), again)
               associate (variance => self%replicate(dof, p, before + 1:before + size(again), part))
                  variance = variance + self%step*again
               end associate
            end do
         end do
      end do
   end subroutine add

   !> Where the power series of the range of a frequency begins: those of lower ranges lie before.
   pure integer function first_of_power(self, frequency)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency

      first_of_power = 1 + n_batches*count(self%last_of_range < frequency)
   end function first_of_power

   !> Percentiles at one frequency and the ends of their intervals, from what all groups have added.
   pure subroutine percentiles_at(self, frequency, value, low, high)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency
      !> (dof, percentile)
      real(wp), allocatable, intent(out) :: value(:, :), low(:, :), high(:, :)

      associate (at => self%at_frequency(:, frequency, n_moments + 1:), np => self%n_percentiles)
         value = at(:, :np)
         low = at(:, np + 1:2*np)
         high = at(:, 2*np + 1:)
      end associate
   end subroutine percentiles_at

   !> One frequency of one dof in the batches of the march.
   pure subroutine add_power(self, part, dof, weight, density, order, power, rank, percentile)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: part, dof
      real(wp), intent(in) :: weight          !! of the group among all samples
      real(wp), intent(in) :: density(:)      !! (sample)
      integer, intent(in) :: order(:)         !! of the samples, ascending
      real(wp), intent(in) :: power(:, :)     !! (batch, sample)
      real(wp), intent(in) :: rank(:)         !! in the group, as in self
      real(wp), intent(in) :: percentile(:)   !! of the densities
      real(wp) :: at(0:size(percentile))

      at(0) = sum(density)/size(density)
      at(1:) = percentile
      associate (np => size(percentile))
         call self%batches%add(part, dof, density, order, power, self%step*weight*at, &
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

   !> The integrals of the samples grow by one frequency, as means of batches; the last samples are
   !> left out where they do not fill a batch.
   pure subroutine add_to_batches(self, first_sample, density, integral)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: first_sample
      real(wp), intent(in) :: density(:)         !! (sample)
      real(wp), intent(inout) :: integral(:)     !! (batch)
      integer :: b, i

      do i = 1, size(density)
         b = (first_sample + i - 2)/self%batch + 1
         if (b <= size(integral)) integral(b) = integral(b) + self%step*density(i)/self%batch
      end do
   end subroutine add_to_batches

   !> Mean and sum of squared deviations of the values so far, joined by those of more (Chan).
   pure subroutine add_moments(n_before, values, mean, square)
      integer, intent(in) :: n_before
      real(wp), intent(in) :: values(:)
      real(wp), intent(inout) :: mean, square
      real(wp) :: ours, apart
      integer :: n

      n = size(values)
      ours = sum(values)/n
      apart = ours - mean
      square = square + sum((values - ours)**2) + apart**2*(real(n, wp)*n_before/(n + n_before))
      mean = merge(ours, mean + apart*n/(n + n_before), n_before == 0)
   end subroutine add_moments

   !> After the last frequency, from what all ranks have added: the statistics, errors of the
   !> pseudo-variances, and the ratio of the last to the first percentile's; not a number for a dof
   !> that does not move in that share of the samples.
   pure subroutine finish(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      integer :: dof, f, np

      np = self%n_percentiles
      associate (at => self%at_frequency, n => real(self%n_samples, wp))
         statistics%psd_mean = at(:, :, mean_of)
         statistics%psd_mean_error = sqrt(at(:, :, square_of)/(n - 1)/n)
         statistics%psd_percentiles = at(:, :, n_moments + 1:n_moments + np)
         statistics%psd_percentiles_low = at(:, :, n_moments + np + 1:n_moments + 2*np)
         statistics%psd_percentiles_high = at(:, :, n_moments + 2*np + 1:)
         allocate (statistics%pseudo_variance_mean(size(at, 1)), source=0.0_wp)
         allocate (statistics%pseudo_variance_percentiles(size(at, 1), np), source=0.0_wp)
         do f = 1, size(at, 2)
            statistics%pseudo_variance_mean = statistics%pseudo_variance_mean &
                                              + self%step*statistics%psd_mean(:, f)
            statistics%pseudo_variance_percentiles = statistics%pseudo_variance_percentiles &
                                                     + self%step*statistics%psd_percentiles(:, f, :)
         end do
         statistics%pseudo_variance_mean_error = &
            [(error_of_mean(sum(self%integral(dof, :, :), 2)), dof=1, size(at, 1))]
      end associate
      call find_ratios(self, statistics)
      if (allocated(self%batches%level)) call self%batches%finish(statistics)
   end subroutine finish

   !> Errors by the bootstrap. Replicates scatter about the value of their group, and groups are
   !> independent: variances of the mean over groups are the groups' over their number squared.
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

   !> The same of samples drawn again, all replicates side by side: sample order(i) stands
   !> times(b, order(i)) times in replicate b. Counts from the nearer end, a few steps for an outer
   !> percentile.
   pure subroutine find_again(sorted, order, times, rank, values)
      real(wp), intent(in) :: sorted(:), rank
      integer, intent(in) :: order(:), times(:, :)
      real(wp), intent(out) :: values(:)   !! (replicate)
      integer :: count(size(values))       ! samples from the end up to here
      integer :: place(size(values)), next(size(values))   ! from the end, of the order statistics
      integer :: b, below, from_end, i, n, needed
      logical :: is_low

      n = size(sorted)
      below = min(int(rank), n - 1)
      is_low = 2*below <= n
      needed = merge(below, n - below, is_low)
      count = 0
      place = 1
      next = 1
      from_end = 0
      do while (minval(count) <= needed)
         from_end = from_end + 1
         i = merge(from_end, n + 1 - from_end, is_low)
         associate (here => times(:, order(i)))
            do b = 1, size(values)
               count(b) = count(b) + here(b)
               place(b) = place(b) + merge(1, 0, count(b) < needed)
               next(b) = next(b) + merge(1, 0, count(b) <= needed)
            end do
         end associate
      end do
      do b = 1, size(values)
         associate (low => merge(place(b), n + 1 - next(b), is_low), &
                    high => merge(next(b), n + 1 - place(b), is_low))
            values(b) = sorted(low) + (rank - below)*(sorted(high) - sorted(low))
         end associate
      end do
   end subroutine find_again

   !> Bootstrap: as many draws with replacement as there are samples, as counts.
   pure subroutine draw_again(seed, n_before, times)
      integer(long), intent(in) :: seed
      integer, intent(in) :: n_before       !! replicates of the groups before
      integer, intent(out) :: times(:, :)   !! (replicate, sample)
      type(stream_type) :: stream
      real(wp) :: u(size(times, 2))
      integer :: b, i, drawn, n

      n = size(times, 2)
      times = 0
      do b = 1, size(times, 1)
         stream = new_stream(seed, label_of('bootstrap'), n_before + b)
         call stream%uniforms(u)
         do i = 1, n
            drawn = min(1 + int(u(i)*n), n)
            times(b, drawn) = times(b, drawn) + 1
         end do
      end do
   end subroutine draw_again

end module campaign_bands
