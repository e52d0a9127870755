!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the band ratio, of the last percentile's pseudo-variance to the first one's.
!>
!> Errors of integrals over frequency come from the influences of samples on the logarithms of
!> percentiles, which are summed over frequencies. They give standard errors of the pseudo-variances
!> and the interval of the band ratio, ratio exp(+-1.96 s), where s is the standard error of its
!> logarithm. Biases (percentiles of few samples lie inward) are summed too, and their squares are
!> included in the squared errors.
!>
!> Memory does not grow with n_samples: spectra are added by ranges of frequencies and groups of
!> samples, and the influences of neighbouring samples are summed in bins.
!>
!> Ranks may add different ranges and groups: columns%sums, columns%at, influence, bias and
!> batches%variance are then summed over the ranks. Groups are joined in their order, so the results
!> have the same bits on any number of ranks; columns%at has them after the selection.
module campaign_bands
   use campaign_band_batches, only: batch_collector, not_a_number, start_batches
   use campaign_columns, only: column_collector, high, low, start_columns
   use campaign_results, only: case_statistics
   use core_kinds, only: wp
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   use statistics_estimates, only: estimates_type, plain_mean, plain_percentile, stated_error, &
                                   statistic_type, normal_95
   implicit none(type, external)
   private
   public :: band_collector, start_bands, most_bins

   integer, parameter :: most_bins = 512        !! number of bins of samples
   real(wp), parameter :: at_rest = 1.0e-30_wp  !! least density in logarithms, over the largest

   !> Sums over the spectra of one case.
   type :: band_collector
      integer :: n_dof = 0, n_frequencies = 0
      type(column_collector) :: columns            !! densities: column dof + n_dof (frequency - 1)
      !> (bin, statistic, dof, slice, group) influences of the samples of a bin on the integrals of
      !> the mean and the percentiles
      real(wp), allocatable :: influence(:, :, :, :, :)
      real(wp), allocatable :: bias(:, :, :, :)    !! (statistic, dof, slice, group) of integrals
      type(batch_collector) :: batches             !! time-average errors
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
      if (follows_power) &
         call start_batches(size(percentiles), n_dof, n_slices*n_groups, collector%batches)
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
            call self%batches%add((group - 1)*size(self%bias, 3) + slice, dof, density(:, f), &
                                  ranking(:, f), power(dof, place + 1:place + n_batches, :), &
                                  weight*curve(f, :), rank(:, low), rank(:, high))
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

   !> Computes the statistics and the errors of pseudo-variances and band ratios after all
   !> frequencies of all ranks are added. A band ratio is NaN if the pseudo-variance of the first
   !> percentile is 0.
   pure subroutine finish(self, statistics)
      class(band_collector), intent(in) :: self
      type(case_statistics), intent(inout) :: statistics
      integer :: dof, f

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
      end associate
      if (allocated(self%batches%variance)) call self%batches%finish(statistics)
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
