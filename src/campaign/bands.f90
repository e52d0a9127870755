!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the ratio of the outer ones.
!>
!> Integrals over all frequencies have their errors from the bootstrap over samples: standard errors
!> of the pseudo-variances of percentiles, and for the ratio the interval ratio exp(+-1.96 s), s the
!> standard error of its logarithm. The bootstrap also tells the ratio's bias: percentiles of few
!> samples are drawn inward.
!>
!> Memory does not grow with n_samples: spectra come a range of frequencies and a group of samples
!> at a time. The bootstrap draws within groups, fewer times in each.
!>
!> Ranges of frequencies and groups may be taken by different ranks: sums over the ranks of
!> columns%sums, columns%at, replicate, integral and batches%variance, zero where nothing was added,
!> make a collector that has all. Groups are joined in their order, so the sums have the same bits
!> on any number of ranks; columns%at alone has not, before the selection.
module campaign_bands
   use campaign_band_batches, only: batch_collector, not_a_number, start_batches
   use campaign_columns, only: column_collector, high, low, middle, start_columns
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   use numerics_statistics, only: error_of_mean
   use statistics_estimates, only: statistic_type
   implicit none(type, external)
   private
   public :: band_collector, start_bands, n_replicates

   integer, parameter :: n_replicates = 400       !! of the bootstrap: intervals scatter by 5 %
   integer, parameter :: most_bins = 512       !! of samples, whose integrals are kept

   !> Collects the spectra of one case, by ranges of frequencies and groups of samples.
   type :: band_collector
      integer :: n_dof = 0, n_frequencies = 0
      type(column_collector) :: columns            !! densities: dof + n_dof (frequency - 1)
      !> (dof, percentile, replicate, slice) pseudo-variances; the replicates of a group together
      real(wp), allocatable :: replicate(:, :, :, :)
      !> (dof, bin, slice, group) mean integral of densities; bins from the group's first on
      real(wp), allocatable :: integral(:, :, :, :)
      type(batch_collector) :: batches             !! of the march
      integer, private :: n_drawn = 0              !! replicates of each group
      integer, private :: bin_width = 1            !! samples whose integrals are kept as one
      integer(long), private :: seed = 0
      real(wp), private :: step = 0.0_wp           !! between frequencies [Hz]
      integer, allocatable, private :: last_of_range(:)   !! (range) as last_of_ranges has them
   contains
      procedure :: add
      procedure :: finish
      procedure :: first_of_power
   end type band_collector

contains

   !> Prepares a collector; needs two samples or more.
   subroutine start_bands(n_samples, n_dof, frequency, percentiles, seed, n_slices, collector, &
                          follows_power)
      integer, intent(in) :: n_samples, n_dof
      real(wp), intent(in) :: frequency(:)      !! (frequency) [Hz], equally spaced from 0
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      integer, intent(in) :: n_slices            !! in which the frequencies come
      type(band_collector), intent(out) :: collector
      logical, intent(in), optional :: follows_power   !! `add` gets it
      integer :: g, n_groups, np, widest

      np = size(percentiles)
      collector%n_dof = n_dof
      collector%n_frequencies = size(frequency)
      call start_columns(n_samples, n_dof*size(frequency), percentiles, collector%columns)
      n_groups = collector%columns%n_groups
      collector%seed = seed
      collector%step = frequency(2) - frequency(1)
      collector%last_of_range = last_of_ranges(size(frequency))
      collector%n_drawn = max(2, (n_replicates - 1)/n_groups + 1)
      collector%bin_width = (n_samples - 1)/most_bins + 1
      widest = maxval([(collector%columns%group_size(g), g=1, n_groups)])
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
      real(wp) :: rank(self%columns%n_percentiles, 3)
      real(wp) :: in_group(self%columns%n_percentiles)
      integer :: dof, f, p, before, place

      weight = self%step*(real(size(psd, 3), wp)/self%columns%n_samples)
      rank = self%columns%ranks_in_group(size(psd, 3))
      before = (group - 1)*self%n_drawn
      call draw_again(self%seed, before, times)
      do f = 1, size(psd, 2)
         place = self%first_of_power(first + f - 1) - self%first_of_power(first)
         do dof = 1, size(psd, 1)
            call add_to_bins(self, self%columns%group_first(group), psd(dof, f, :), &
                             self%integral(dof, :, slice, group))
            call self%columns%add(dof + self%n_dof*(first + f - 2), group, psd(dof, f, :), &
                                  in_group, ranking)
            sorted = psd(dof, f, ranking)
            if (present(power)) &
               call self%batches%add((group - 1)*size(self%integral, 3) + slice, dof, &
                                     psd(dof, f, :), ranking, &
                                     power(dof, place + 1:place + n_batches, :), &
                                     weight*[sum(psd(dof, f, :))/size(psd, 3), in_group], &
                                     rank(:, low), rank(:, high))
            do p = 1, size(in_group)
               call find_again(sorted, ranking, times, rank(p, middle), again)
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

   !> Integrals of the bins of all samples; the last samples are left out where they do not fill
   !> one.
   pure function join_integrals(self, dof) result(integral)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: dof
      real(wp) :: integral(self%columns%n_samples/self%bin_width)
      integer :: b, before, g

      integral = 0.0_wp
      do g = 1, self%columns%n_groups
         before = (self%columns%group_first(g) - 1)/self%bin_width
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
      integer :: dof, f

      associate (n_dof => self%n_dof, nf => self%n_frequencies, &
                 np => self%columns%n_percentiles)
         allocate (statistics%psd(n_dof, nf, np + 1), statistics%psd_mean_freedoms(n_dof, nf), &
                   statistics%pseudo_variances(n_dof, np + 2))
         call self%columns%finish(statistics%psd, freedoms=statistics%psd_mean_freedoms)
         associate (integrals => statistics%pseudo_variances(:, :np + 1))
            do f = 1, nf
               integrals%value = integrals%value + self%step*statistics%psd(:, f, :)%value
            end do
            integrals(:, 1)%error = [(error_of_mean(join_integrals(self, dof)), dof=1, n_dof)]
         end associate
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
      real(wp) :: variance(size(self%replicate, 2), size(self%replicate, 3)), spread
      integer :: dof, last, p

      last = size(self%replicate, 2)
      allocate (statistics%band_ratio_bias(self%n_dof), source=not_a_number)
      do dof = 1, self%n_dof
         variance = sum(self%replicate(dof, :, :, :), 3)
         associate (integrals => statistics%pseudo_variances(dof, 2:last + 1), &
                    ratio => statistics%pseudo_variances(dof, last + 2))
            integrals%error = [(error_over_groups(self, variance(p, :)), p=1, last)]
            ratio = statistic_type(not_a_number, low=not_a_number, high=not_a_number)
            if (any(.not. variance(1, :) > 0.0_wp)) cycle
            associate (logarithm => log(variance(last, :)/variance(1, :)))
               spread = 1.96_wp*error_over_groups(self, logarithm)
               ratio%value = integrals(last)%value/integrals(1)%value
               ratio%low = ratio%value*exp(-spread)
               ratio%high = ratio%value*exp(spread)
               statistics%band_ratio_bias(dof) = exp(sum(logarithm)/size(logarithm))/ratio%value &
                                                 - 1.0_wp
            end associate
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

   !> Finds the values at a rank among samples drawn again, all replicates side by side: sample
   !> ranking(i) is drawn times(b, ranking(i)) times in replicate b. Counts from the nearer end: few
   !> steps for an outer percentile.
   pure subroutine find_again(sorted, ranking, times, rank, values)
      real(wp), intent(in) :: sorted(:), rank
      integer, intent(in) :: ranking(:), times(:, :)
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
         associate (here => times(:, ranking(i)))
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

   !> Draws bootstrap replicates: as many samples, with replacement, as there are, given as counts.
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
