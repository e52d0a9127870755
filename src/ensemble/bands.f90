!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the ratio of the outer ones.
!>
!> Spectra come a range of frequencies at a time, so that memory does not grow with n_samples times
!> n_frequencies. Percentiles interpolate linearly between order statistics (Hyndman and Fan,
!> type 7). Their pointwise intervals are order statistics (binomial, 95 %). What integrals over all
!> frequencies enter has its errors from the bootstrap over samples: standard errors of the
!> pseudo-variances of percentiles, and for the ratio the interval ratio exp(+-1.96 s), s the
!> standard error of its logarithm. The bootstrap also tells the ratio's bias: percentiles of few
!> samples are drawn inward.
module ensemble_bands
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use ensemble_results, only: case_statistics
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: error_of_mean, standard_deviation
   implicit none(type, external)
   private
   public :: band_collector, start_bands, n_replicates, at_rank

   integer, parameter :: n_replicates = 400   !! of the bootstrap: it scatters the interval by 5 %

   !> Collects the spectra of one case, frequency range by frequency range.
   type :: band_collector
      private
      integer :: n_samples = 0
      real(wp) :: step = 0.0_wp                     !! between frequencies [Hz]
      real(wp), allocatable :: rank(:)              !! (percentile) place among 1..n_samples
      integer, allocatable :: rank_low(:)           !! (percentile) of the pointwise intervals
      integer, allocatable :: rank_high(:)
      integer, allocatable :: times(:, :)           !! (sample, replicate) how often drawn again
      real(wp), allocatable :: replicate(:, :, :)   !! (dof, percentile, replicate) pseudo-variances
      real(wp), allocatable :: variance(:, :)       !! (dof, sample) integral of each density
   contains
      procedure :: add
      procedure :: finish
   end type band_collector

contains

   !> Prepares the collector and the statistics it fills; needs two samples or more.
   subroutine start_bands(n_samples, n_dof, frequency, percentiles, seed, collector, statistics)
      integer, intent(in) :: n_samples, n_dof
      real(wp), intent(in) :: frequency(:)      !! (frequency) [Hz], equally spaced from 0
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer(long), intent(in) :: seed
      type(band_collector), intent(out) :: collector
      type(case_statistics), intent(inout) :: statistics
      integer :: p, np, nf

      np = size(percentiles)
      nf = size(frequency)
      collector%n_samples = n_samples
      collector%step = frequency(2) - frequency(1)
      collector%rank = 1.0_wp + (n_samples - 1)*percentiles/100.0_wp
      collector%rank_low = [(interval_rank(n_samples, percentiles(p)/100.0_wp, .false.), p=1, np)]
      collector%rank_high = [(interval_rank(n_samples, percentiles(p)/100.0_wp, .true.), p=1, np)]
      call draw_again(n_samples, seed, collector%times)
      allocate (collector%replicate(n_dof, np, n_replicates), source=0.0_wp)
      allocate (collector%variance(n_dof, n_samples), source=0.0_wp)

      allocate (statistics%psd_mean(n_dof, nf), statistics%psd_mean_error(n_dof, nf))
      allocate (statistics%psd_percentiles(n_dof, nf, np))
      allocate (statistics%psd_percentiles_low, statistics%psd_percentiles_high, &
                mold=statistics%psd_percentiles)
      allocate (statistics%pseudo_variance_mean(n_dof), source=0.0_wp)
      allocate (statistics%pseudo_variance_percentiles(n_dof, np), source=0.0_wp)
   end subroutine start_bands

   !> Takes the spectra of all samples at frequencies first, first + 1, ...
   pure subroutine add(self, first, psd, statistics)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: first
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: sorted(self%n_samples), mean, again
      integer :: order(self%n_samples)
      integer :: b, dof, f, i, p

      do f = 1, size(psd, 2)
         i = first + f - 1
         do dof = 1, size(psd, 1)
            self%variance(dof, :) = self%variance(dof, :) + psd(dof, f, :)*self%step
            order = sort_order(psd(dof, f, :))
            sorted = psd(dof, f, order)
            mean = sum(sorted)/self%n_samples
            statistics%psd_mean(dof, i) = mean
            statistics%psd_mean_error(dof, i) = sqrt(sum((sorted - mean)**2)/(self%n_samples - 1) &
                                                     /self%n_samples)
            statistics%pseudo_variance_mean(dof) = statistics%pseudo_variance_mean(dof) &
                                                   + mean*self%step
            do p = 1, size(self%rank)
               statistics%psd_percentiles(dof, i, p) = at_rank(sorted, self%rank(p))
               statistics%psd_percentiles_low(dof, i, p) = sorted(self%rank_low(p))
               statistics%psd_percentiles_high(dof, i, p) = sorted(self%rank_high(p))
               statistics%pseudo_variance_percentiles(dof, p) = &
                  statistics%pseudo_variance_percentiles(dof, p) &
                  + statistics%psd_percentiles(dof, i, p)*self%step
               do b = 1, n_replicates
                  again = at_rank_again(sorted, order, self%times(:, b), self%rank(p))
                  self%replicate(dof, p, b) = self%replicate(dof, p, b) + self%step*again
               end do
            end do
         end do
      end do
   end subroutine add

   !> After the last frequency: errors of the pseudo-variances, and the ratio of the last to the
   !> first percentile's; not a number for a dof that does not move in that share of the samples.
   pure subroutine finish(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp), parameter :: not_a_number = transfer(int(z'7FF8000000000000', long), 0.0_wp)
      real(wp) :: logarithm(n_replicates), mean, ratio, spread
      integer :: dof, last, p

      last = size(self%rank)
      statistics%pseudo_variance_mean_error = &
         [(error_of_mean(self%variance(dof, :)), dof=1, size(self%variance, 1))]
      allocate (statistics%pseudo_variance_percentiles_error, &
                mold=statistics%pseudo_variance_percentiles)
      do p = 1, last
         statistics%pseudo_variance_percentiles_error(:, p) = &
            [(standard_deviation(self%replicate(dof, p, :)), dof=1, size(self%replicate, 1))]
      end do
      allocate (statistics%band_ratio(size(self%replicate, 1)), source=not_a_number)
      statistics%band_ratio_low = statistics%band_ratio
      statistics%band_ratio_high = statistics%band_ratio
      statistics%band_ratio_bias = statistics%band_ratio
      do dof = 1, size(statistics%band_ratio)
         if (any(.not. self%replicate(dof, 1, :) > 0.0_wp)) cycle
         logarithm = log(self%replicate(dof, last, :)/self%replicate(dof, 1, :))
         mean = sum(logarithm)/n_replicates
         spread = 1.96_wp*sqrt(sum((logarithm - mean)**2)/(n_replicates - 1))
         ratio = statistics%pseudo_variance_percentiles(dof, last) &
                 /statistics%pseudo_variance_percentiles(dof, 1)
         statistics%band_ratio(dof) = ratio
         statistics%band_ratio_low(dof) = ratio*exp(-spread)
         statistics%band_ratio_high(dof) = ratio*exp(spread)
         statistics%band_ratio_bias(dof) = exp(mean)/ratio - 1.0_wp
      end do
   end subroutine finish

   !> Value at a rank that may lie between two order statistics.
   pure function at_rank(sorted, rank) result(value)
      real(wp), intent(in) :: sorted(:), rank
      real(wp) :: value
      integer :: below

      below = min(int(rank), size(sorted) - 1)
      value = sorted(below) + (rank - below)*(sorted(below + 1) - sorted(below))
   end function at_rank

   !> The same of a sample drawn again: sample order(i) stands `times(order(i))` times in it.
   !> Counts from the nearer end, a few steps for an outer percentile.
   pure function at_rank_again(sorted, order, times, rank) result(value)
      real(wp), intent(in) :: sorted(:), rank
      integer, intent(in) :: order(:), times(:)
      real(wp) :: value
      integer :: below, count, i, n

      n = size(sorted)
      below = min(int(rank), n - 1)
      if (2*below <= n) then
         count = 0
         i = 0
         do while (count < below)
            i = i + 1
            count = count + times(order(i))
         end do
         value = sorted(i)
         do while (count < below + 1)
            i = i + 1
            count = count + times(order(i))
         end do
         value = value + (rank - below)*(sorted(i) - value)
      else
         count = n + 1
         i = n + 1
         do while (count > below + 1)
            i = i - 1
            count = count - times(order(i))
         end do
         value = sorted(i)
         do while (count > below)
            i = i - 1
            count = count - times(order(i))
         end do
         value = sorted(i) + (rank - below)*(value - sorted(i))
      end if
   end function at_rank_again

   !> Bootstrap: n_replicates times n_samples draws with replacement, as counts.
   pure subroutine draw_again(n_samples, seed, times)
      integer, intent(in) :: n_samples
      integer(long), intent(in) :: seed
      integer, allocatable, intent(out) :: times(:, :)   !! (sample, replicate)
      type(stream_type) :: stream
      real(wp) :: u(n_samples)
      integer :: b, i, drawn

      allocate (times(n_samples, n_replicates), source=0)
      do b = 1, n_replicates
         stream = new_stream(seed, label_of('bootstrap'), b)
         call stream%uniforms(u)
         do i = 1, n_samples
            drawn = min(1 + int(u(i)*n_samples), n_samples)
            times(drawn, b) = times(drawn, b) + 1
         end do
      end do
   end subroutine draw_again

   !> Rank of the order statistic that ends the 95 % interval of the quantile at probability p: the
   !> number of samples below it is binomial. Too few samples for a bound: the extreme sample.
   pure function interval_rank(n, p, is_upper) result(rank)
      integer, intent(in) :: n
      real(wp), intent(in) :: p
      logical, intent(in) :: is_upper
      integer :: rank
      real(wp) :: cumulated, level, logarithm
      integer :: k

      level = merge(0.975_wp, 0.025_wp, is_upper)
      cumulated = 0.0_wp
      do k = 0, n
         logarithm = log_gamma(n + 1.0_wp) - log_gamma(k + 1.0_wp) - log_gamma(n - k + 1.0_wp) &
                     + k*log(p) + (n - k)*log(1.0_wp - p)
         cumulated = cumulated + exp(logarithm)
         if (cumulated > level) exit
      end do
      rank = merge(k + 1, k, is_upper)
      rank = max(1, min(rank, n))
   end function interval_rank

end module ensemble_bands
