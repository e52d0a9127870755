!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the band ratio, of the last percentile's pseudo-variance to the first one's.
!>
!> Errors of integrals over frequency come from the influences of samples on the logarithms of
!> percentiles, which are summed over frequencies. They give standard errors of the pseudo-variances
!> and the interval of the band ratio, ratio exp(+-1.96 s), where s is the standard error of its
!> logarithm. Biases (percentiles of few samples lie inward) are summed too, and their squares are
!> included in the squared errors.
!>
!> Time-average errors come from consecutive batches of the march. The force record that the samples
!> share changes the response of all of them, and more samples do not average that out. A percentile
!> changes as the samples near its rank do on average; the deviations of single samples from that
!> are in the Monte Carlo errors. So the density of a percentile in a batch is estimated as that of
!> the whole march times the mean, over the samples in the 95 % interval of its rank, of the power
!> of a sample in this batch over its mean power in all batches, within a range of frequencies. Full
!> spectra of every batch would take eight times the memory.
!>
!> Memory does not grow with n_samples: spectra are added by ranges of frequencies and groups of
!> samples, and the influences of neighbouring samples are summed in bins.
!>
!> Ranks may add different ranges and groups: columns%sums, columns%at, influence, bias and
!> in_batches are then summed over the ranks. Groups are joined in their order, so the results have
!> the same bits on any number of ranks; columns%at has them after the selection.
module campaign_bands
   use campaign_columns, only: column_collector, high, low, start_columns
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   use numerics_correlated, only: error_of_batches, n_batches
   use numerics_spectrum, only: last_of_ranges
   use statistics_estimates, only: estimates_type, plain_mean, plain_percentile, stated_error, &
                                   statistic_type, normal_95
   implicit none(type, external)
   private
   public :: band_collector, start_bands, most_bins

   integer, parameter :: most_bins = 512        !! number of bins of samples
   real(wp), parameter :: at_rest = 1.0e-30_wp  !! least density in logarithms, over the largest
   !> Quiet NaN: ratio of two powers that are zero.
   real(wp), parameter :: not_a_number = transfer(int(z'7FF8000000000000', long), 0.0_wp)

   !> Sums over the spectra of one case.
   type :: band_collector
      integer :: n_dof = 0, n_frequencies = 0
      type(column_collector) :: columns            !! densities: column dof + n_dof (frequency - 1)
      !> (bin, statistic, dof, slice, group) influences of the samples of a bin on the integrals of
      !> the mean and the percentiles
      real(wp), allocatable :: influence(:, :, :, :, :)
      real(wp), allocatable :: bias(:, :, :, :)    !! (statistic, dof, slice, group) of integrals
      !> (batch; mean or percentile; dof; slice and group as one index) pseudo-variances [m^2]; not
      !> allocated without power series
      real(wp), allocatable :: in_batches(:, :, :, :)
      integer, private :: bin_width = 1            !! number of samples of a bin
      real(wp), private :: step = 0.0_wp           !! frequency step [Hz]
      integer, allocatable, private :: last_of_range(:)   !! (range) as in last_of_ranges
   contains
      procedure :: add
      procedure :: finish
      procedure :: first_of_power
   end type band_collector

contains

   !> Prepares a collector; needs two samples or more.
   subroutine start_bands(n_samples, n_dof, frequency, percentiles, n_slices, collector, &
                          follows_power)
      integer, intent(in) :: n_samples, n_dof
      real(wp), intent(in) :: frequency(:)      !! (frequency) [Hz], equally spaced from 0
      real(wp), intent(in) :: percentiles(:)    !! [%]
      integer, intent(in) :: n_slices            !! number of slices of the frequencies
      type(band_collector), intent(out) :: collector
      logical, intent(in), optional :: follows_power   !! true: `add` is called with power
      integer :: g, n_groups, widest

      collector%n_dof = n_dof
      collector%n_frequencies = size(frequency)
      call start_columns(n_samples, n_dof*size(frequency), percentiles, collector%columns)
      n_groups = collector%columns%n_groups
      collector%step = frequency(2) - frequency(1)
      collector%last_of_range = last_of_ranges(size(frequency))
      collector%bin_width = (n_samples - 1)/most_bins + 1
      widest = maxval([(collector%columns%group_size(g), g=1, n_groups)])
      associate (n => 1 + size(percentiles))
         allocate (collector%influence((widest - 1)/collector%bin_width + 1, n, n_dof, n_slices, &
                                       n_groups), &
                   collector%bias(n, n_dof, n_slices, n_groups), source=0.0_wp)
      end associate
      if (.not. present(follows_power)) return
      if (follows_power) allocate (collector%in_batches(n_batches, 1 + size(percentiles), n_dof, &
                                                        n_slices*n_groups), source=0.0_wp)
   end subroutine start_bands

   !> Adds the spectra of a group of samples at frequencies first, first + 1, ... of one slice.
   !> Frequencies of a slice are added in ascending order.
   pure subroutine add(self, slice, first, group, psd, power)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: slice, first, group
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) power series, from the range of the first frequency on
      real(wp), intent(in), optional :: power(:, :, :)
      type(estimates_type) :: estimates
      integer :: ranking(size(psd, 3), size(psd, 2))
      real(wp) :: curve(size(psd, 2), size(self%influence, 2))   ! mean and percentiles
      real(wp), dimension(size(psd, 3), size(psd, 2)) :: density, logarithm
      real(wp) :: rank(self%columns%n_percentiles, 3), share, slope(size(psd, 2)), weight
      integer :: dof, f, place, s

      share = real(size(psd, 3), wp)/self%columns%n_samples
      weight = self%step*share
      do dof = 1, size(psd, 1)
         density = transpose(psd(dof, :, :))
         do f = 1, size(psd, 2)
            call self%columns%add(dof + self%n_dof*(first + f - 2), group, density(:, f), &
                                  curve(f, 2:), ranking(:, f))
            logarithm(:, f) = log(max(density(:, f), at_rest*maxval(density(:, f)), tiny(share)))
         end do
         do s = 1, size(curve, 2)
            if (s == 1) then
               estimates = plain_mean(density)
               curve(:, 1) = estimates%value
               slope = weight
            else
               estimates = plain_percentile(logarithm, self%columns%share_below(s - 1), ranking)
               slope = weight*curve(:, s)
            end if
            associate (bias => self%bias(s, dof, slice, group))
               do f = 1, size(psd, 2)
                  call add_to_bins(self%bin_width, slope(f)*estimates%influence(:, f), &
                                   self%influence(:, s, dof, slice, group))
                  bias = bias + share*slope(f)*estimates%bias(f)
               end do
            end associate
         end do
         if (.not. present(power)) cycle
         rank = self%columns%ranks_in_group(size(psd, 3))
         do f = 1, size(psd, 2)
            place = self%first_of_power(first + f - 1) - self%first_of_power(first)
            call add_to_batches(density(:, f), ranking(:, f), &
                                power(dof, place + 1:place + n_batches, :), weight*curve(f, :), &
                                rank(:, low:high), &
                                self%in_batches(:, :, dof, (group - 1)*size(self%bias, 3) + slice))
         end do
      end do
   end subroutine add

   !> Place in the power series of the first batch of the range that a frequency belongs to.
   pure integer function first_of_power(self, frequency)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency

      first_of_power = 1 + n_batches*count(self%last_of_range < frequency)
   end function first_of_power

   !> Adds the influences of the samples of a group to their bins.
   pure subroutine add_to_bins(width, influence, bins)
      integer, intent(in) :: width               !! number of samples of a bin
      real(wp), intent(in) :: influence(:)       !! (sample)
      real(wp), intent(inout) :: bins(:)
      integer :: i

      do i = 1, size(influence)
         associate (bin => bins((i - 1)/width + 1))
            bin = bin + influence(i)
         end associate
      end do
   end subroutine add_to_bins

   !> Adds the pseudo-variances of one dof at one frequency in the batches.
   pure subroutine add_to_batches(density, ranking, power, curve, near, variance)
      real(wp), intent(in) :: density(:)   !! (sample) [m^2/Hz]
      integer, intent(in) :: ranking(:)    !! samples in ascending order of density
      real(wp), intent(in) :: power(:, :)  !! (batch, sample) in the range of the frequency
      real(wp), intent(in) :: curve(:)     !! mean and percentiles times frequency step [m^2]
      real(wp), intent(in) :: near(:, :)   !! (percentile; lower or upper end) interval of its rank
      real(wp), intent(inout) :: variance(:, :)   !! (batch; mean or percentile) [m^2]
      ! relative: power of a sample over its mean of all batches
      real(wp) :: relative(n_batches, size(density)), weighted(n_batches)
      integer :: i, p

      relative = 1.0_wp
      weighted = 0.0_wp
      do i = 1, size(density)
         if (sum(power(:, i)) > 0.0_wp) relative(:, i) = power(:, i)*(n_batches/sum(power(:, i)))
         weighted = weighted + density(i)*relative(:, i)
      end do
      if (sum(density) > 0.0_wp) variance(:, 1) = variance(:, 1) + curve(1)*weighted/sum(density)
      do p = 1, size(near, 1)
         associate (samples => ranking(floor(near(p, 1)):ceiling(near(p, 2))))
            variance(:, p + 1) = variance(:, p + 1) &
                                 + curve(p + 1)*sum(relative(:, samples), 2)/size(samples)
         end associate
      end do
   end subroutine add_to_batches

   !> Computes the statistics and the errors of pseudo-variances and band ratios after all
   !> frequencies of all ranks are added. A band ratio is NaN if the pseudo-variance of the first
   !> percentile is 0, and its time-average error if that of any percentile is in a batch.
   pure subroutine finish(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      real(wp) :: variance(n_batches, self%columns%n_percentiles + 1)   ! (batch; mean, percentiles)
      integer :: dof, f, s

      associate (n_dof => self%n_dof, nf => self%n_frequencies, np => self%columns%n_percentiles)
         allocate (statistics%psd(n_dof, nf, np + 1), statistics%psd_mean_freedoms(n_dof, nf), &
                   statistics%pseudo_variances(n_dof, np + 2), statistics%band_ratio_bias(n_dof))
         call self%columns%finish(statistics%psd, freedoms=statistics%psd_mean_freedoms)
         associate (integrals => statistics%pseudo_variances(:, :np + 1))
            do f = 1, nf
               integrals%value = integrals%value + self%step*statistics%psd(:, f, :)%value
            end do
         end associate
         do dof = 1, n_dof
            call find_errors(self%columns%n_samples, sum(self%influence(:, :, dof, :, :), 3), &
                             sum(sum(self%bias(:, dof, :, :), 3), 2), &
                             statistics%pseudo_variances(dof, :), statistics%band_ratio_bias(dof))
         end do
         if (.not. allocated(self%in_batches)) return
         allocate (statistics%pseudo_variance_time_error(n_dof, np + 2))
         do dof = 1, n_dof
            variance = sum(self%in_batches(:, :, dof, :), 3)
            associate (error => statistics%pseudo_variance_time_error(dof, :))
               error(:np + 1) = [(error_of_batches(variance(:, s)), s=1, np + 1)]
               error(np + 2) = not_a_number
               if (minval(variance(:, 2:)) > 0.0_wp) &
                  error(np + 2) = statistics%pseudo_variances(dof, np + 2)%value &
                                  *error_of_batches(log(variance(:, np + 1)/variance(:, 2)))
            end associate
         end do
      end associate
   end subroutine finish

   !> Computes the errors of the pseudo-variances of one dof, and its band ratio.
   pure subroutine find_errors(n_samples, influence, bias, integrals, ratio_bias)
      integer, intent(in) :: n_samples
      real(wp), intent(in) :: influence(:, :, :)   !! (bin, statistic, group)
      real(wp), intent(in) :: bias(:)              !! (statistic)
      type(statistic_type), intent(inout) :: integrals(:)   !! (statistic), the band ratio last
      real(wp), intent(out) :: ratio_bias          !! relative bias of the band ratio
      real(wp) :: by_bin(size(influence, 1)*size(influence, 3), size(bias)), spread
      integer :: s

      do s = 1, size(bias)
         by_bin(:, s) = reshape(influence(:, s, :), [size(by_bin, 1)])
         integrals(s)%error = stated_error(by_bin(:, s), bias(s), n_samples)
      end do
      integrals(1)%error = sqrt(n_samples/(n_samples - 1.0_wp))*norm2(by_bin(:, 1))
      ratio_bias = not_a_number
      associate (bottom => integrals(2)%value, last => size(bias), &
                 ratio => integrals(size(bias) + 1))
         ratio = statistic_type(not_a_number, low=not_a_number, high=not_a_number)
         if (.not. bottom > 0.0_wp) return
         associate (top => integrals(last)%value)
            ratio_bias = bias(last)/top - bias(2)/bottom   ! bias of the logarithm
            spread = normal_95*stated_error(by_bin(:, last)/top - by_bin(:, 2)/bottom, &
                                            ratio_bias, n_samples)
            ratio_bias = exp(ratio_bias) - 1.0_wp
            ratio%value = top/bottom
         end associate
         ratio%low = max(1.0_wp, ratio%value*exp(-spread))
         ratio%high = ratio%value*exp(spread)
      end associate
   end subroutine find_errors

end module campaign_bands
