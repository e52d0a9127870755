!> Bands of uncertainty: percentiles over samples at each frequency, their pseudo-variances,
!> Eq. (46), and the ratio of the outer ones.
!>
!> Integrals over all frequencies have their errors from the influences of samples on the logarithms
!> of percentiles, which add up over frequencies: standard errors of the pseudo-variances, and for
!> the ratio the interval ratio exp(+-1.96 s), s the standard error of its logarithm. Biases add up
!> as well, and are in the errors, squared: percentiles of few samples lie inward.
!>
!> Memory does not grow with n_samples: spectra come a range of frequencies and a group of samples
!> at a time, and the influences of neighbouring samples are kept as one.
!>
!> Ranges of frequencies and groups may be taken by different ranks: sums over the ranks of
!> columns%sums, columns%at, influence, bias and batches%variance, zero where nothing was added,
!> make a collector that has all. Groups are joined in their order, so the sums have the same bits
!> on any number of ranks; columns%at alone has not, before the selection.
module campaign_bands
   use campaign_band_batches, only: batch_collector, not_a_number, start_batches
   use campaign_columns, only: column_collector, high, low, start_columns
   use campaign_results, only: case_statistics
   use core_kinds, only: wp
   use numerics_correlated, only: n_batches
   use numerics_spectrum, only: last_of_ranges
   use statistics_estimates, only: estimates_type, plain_mean, plain_percentile, stated_error, &
                                   statistic_type, two_sided
   implicit none(type, external)
   private
   public :: band_collector, start_bands, most_bins

   integer, parameter :: most_bins = 512        !! of samples, whose influences are kept
   real(wp), parameter :: at_rest = 1.0e-30_wp  !! of the largest density: none of a sample is less

   !> Collects the spectra of one case, by ranges of frequencies and groups of samples.
   type :: band_collector
      integer :: n_dof = 0, n_frequencies = 0
      type(column_collector) :: columns            !! densities: dof + n_dof (frequency - 1)
      !> (bin, statistic, dof, slice, group) influences of the samples of a bin on the integrals of
      !> the mean and the percentiles
      real(wp), allocatable :: influence(:, :, :, :, :)
      real(wp), allocatable :: bias(:, :, :, :)    !! (statistic, dof, slice, group) of integrals
      type(batch_collector) :: batches             !! of the march
      integer, private :: bin_width = 1            !! samples whose influences are kept as one
      real(wp), private :: step = 0.0_wp           !! between frequencies [Hz]
      integer, allocatable, private :: last_of_range(:)   !! (range) as last_of_ranges has them
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
      integer, intent(in) :: n_slices            !! in which the frequencies come
      type(band_collector), intent(out) :: collector
      logical, intent(in), optional :: follows_power   !! `add` gets it
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

   !> Takes the spectra of a group's samples at frequencies first, first + 1, ..., which belong to
   !> one slice. Frequencies of a slice come in order. `power`: how their power varies along the
   !> march, where it was followed.
   pure subroutine add(self, slice, first, group, psd, power)
      class(band_collector), intent(inout) :: self
      integer, intent(in) :: slice, first, group
      real(wp), intent(in) :: psd(:, :, :)   !! (dof, frequency, sample), one-sided [m^2/Hz]
      !> (dof, batch and range, sample) from the range of the first frequency on
      real(wp), intent(in), optional :: power(:, :, :)
      type(estimates_type) :: estimates
      integer :: ranking(size(psd, 3), size(psd, 2))
      real(wp) :: at(size(psd, 2), size(self%influence, 2))   ! mean and percentiles
      real(wp), dimension(size(psd, 3), size(psd, 2)) :: density, logarithm
      real(wp) :: rank(self%columns%n_percentiles, 3), share, slope(size(psd, 2)), weight
      integer :: dof, f, place, s

      share = real(size(psd, 3), wp)/self%columns%n_samples
      weight = self%step*share
      do dof = 1, size(psd, 1)
         density = transpose(psd(dof, :, :))
         do f = 1, size(psd, 2)
            call self%columns%add(dof + self%n_dof*(first + f - 2), group, density(:, f), &
                                  at(f, 2:), ranking(:, f))
            logarithm(:, f) = log(max(density(:, f), at_rest*maxval(density(:, f)), tiny(share)))
         end do
         do s = 1, size(at, 2)
            if (s == 1) then
               estimates = plain_mean(density)
               at(:, 1) = estimates%value
               slope = weight
            else
               estimates = plain_percentile(logarithm, self%columns%share_below(s - 1), ranking)
               slope = weight*at(:, s)
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
                                  weight*at(f, :), rank(:, low), rank(:, high))
         end do
      end do
   end subroutine add

   !> First place of the power series of a frequency's range; those of lower ranges lie before.
   pure integer function first_of_power(self, frequency)
      class(band_collector), intent(in) :: self
      integer, intent(in) :: frequency

      first_of_power = 1 + n_batches*count(self%last_of_range < frequency)
   end function first_of_power

   !> Adds the influences of a group's samples to those of their bins.
   pure subroutine add_to_bins(width, influence, bins)
      integer, intent(in) :: width               !! samples of a bin
      real(wp), intent(in) :: influence(:)       !! (sample)
      real(wp), intent(inout) :: bins(:)
      integer :: i

      do i = 1, size(influence)
         associate (bin => bins((i - 1)/width + 1))
            bin = bin + influence(i)
         end associate
      end do
   end subroutine add_to_bins

   !> Computes, once all frequencies of all ranks are added, the statistics, the errors of the
   !> pseudo-variances, and the ratio of the last percentile's to the first one's; NaN for a dof
   !> that does not move in that share of the samples.
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

   !> Computes the errors of the integrals of one dof, and the ratio of the outer ones.
   pure subroutine find_errors(n_samples, influence, bias, integrals, ratio_bias)
      integer, intent(in) :: n_samples
      real(wp), intent(in) :: influence(:, :, :)   !! (bin, statistic, group)
      real(wp), intent(in) :: bias(:)              !! (statistic)
      type(statistic_type), intent(inout) :: integrals(:)   !! (statistic), last the ratio
      real(wp), intent(out) :: ratio_bias          !! relative
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
            ratio_bias = bias(last)/top - bias(2)/bottom   ! of the logarithm
            spread = two_sided*stated_error(by_bin(:, last)/top - by_bin(:, 2)/bottom, &
                                            ratio_bias, n_samples)
            ratio_bias = exp(ratio_bias) - 1.0_wp
            ratio%value = top/bottom
         end associate
         ratio%low = ratio%value*exp(-spread)
         ratio%high = ratio%value*exp(spread)
      end associate
   end subroutine find_errors

end module campaign_bands
