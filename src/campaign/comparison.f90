!> Differences of two marches of the same samples in the published numbers of a case: the numerical
!> error of the tested march, if the reference is much more accurate.
!>
!> Both marches have the same friction and force, so the differences are due to the method and its
!> settings alone (the response is a contraction: even long histories stay comparable). If n of N
!> samples were compared, a difference over all N has the standard error of a jackknife over the n,
!> times sqrt(1 - n/N). For percentiles the jackknife is rough, as it is not consistent for one
!> quantile; integrals over many frequencies smooth it.
module campaign_comparison
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: mean, standard_deviation
   use statistics_estimates, only: statistic_type
   use statistics_percentiles, only: at_rank
   implicit none(type, external)
   private
   public :: numerical_error, spectrum_comparison, compare_slip, compare_spectra
   public :: slip_error, band_ratio_error, ratio_replicates, change_of_ratios

   real(wp), parameter :: points = 100.0_wp   !! percentage points of a fraction of 1

   !> Differences of the tested march from the reference, with their standard errors (zero for one
   !> sample). A difference is not allocated if its result is not kept, or needs two samples.
   type :: numerical_error
      integer :: n_samples = 0   !! number of samples compared
      !> (joint) differences of slip fractions [points]: of the mean, rms over samples, of the
      !> standard deviation, largest of a sample
      type(statistic_type), allocatable :: slip_mean(:)
      type(statistic_type), allocatable :: slip_rms(:)
      type(statistic_type), allocatable :: slip_std(:)
      real(wp), allocatable :: slip_largest(:)
      !> (dof) integral over frequency of the absolute difference of the mean densities, relative to
      !> the integral of the reference
      type(statistic_type), allocatable :: psd_mean(:)
      type(statistic_type), allocatable :: psd_percentiles(:, :)   !! (dof, percentile) the same
      !> (dof) relative difference of the band ratio; 0 for a dof that does not move in so many
      !> samples that the first percentile is 0
      type(statistic_type), allocatable :: band_ratio(:)
   end type numerical_error

   !> Comparison of spectra, to which ranges of frequencies are added.
   type :: spectrum_comparison
      private
      real(wp), allocatable :: percentiles(:)   !! [%], ascending
      !> (0: mean, or percentile; 0: all samples, or all but the i-th; integrand, dof)
      real(wp), allocatable :: integral(:, :, :, :)
   contains
      procedure :: add
      procedure :: finish
   end type spectrum_comparison

   !> Integrands: density of the tested march, of the reference, absolute difference of both.
   integer, parameter :: tested_psd = 1, reference_psd = 2, psd_difference = 3

contains

   !> Numerical error of slip fractions that is judged by a target [points]: largest over the joints
   !> of the rms over samples. It bounds the error of the mean and, but for a factor
   !> sqrt(n/(n - 1)), that of the standard deviation; errors of samples do not cancel in it.
   pure real(wp) function slip_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors

      largest = maxval(errors%slip_rms%value)
   end function slip_error

   !> Numerical error of band ratios that is judged by a target: relative, largest over the dofs; 0
   !> without bands.
   pure real(wp) function band_ratio_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors

      largest = 0.0_wp
      if (allocated(errors%band_ratio)) largest = maxval(abs(errors%band_ratio%value))
   end function band_ratio_error

   !> Band ratios of all samples (replicate 0) and of all but the i-th (1..n): pseudo-variance,
   !> Eq. (46), of the last percentile over that of the first; 0 if that of the first is 0.
   pure function ratio_replicates(psd, percentiles) result(ratios)
      real(wp), intent(in) :: psd(:, :, :)     !! (dof, frequency, sample); two samples or more
      real(wp), intent(in) :: percentiles(:)   !! [%], ascending
      real(wp) :: ratios(0:size(psd, 3), size(psd, 1))
      real(wp), dimension(0:size(percentiles), 0:size(psd, 3)) :: integral
      integer :: dof, f

      do dof = 1, size(psd, 1)
         integral = 0.0_wp
         do f = 1, size(psd, 2)
            integral = integral + replicates_of(psd(dof, f, :), percentiles)
         end do
         ratios(:, dof) = ratio_of(integral(size(percentiles), :), integral(1, :))
      end do
   end function ratio_replicates

   !> Relative changes of band ratios, as statistics of a case of n_all samples; 0 for a dof whose
   !> reference is 0.
   pure function change_of_ratios(tested, reference, n_all) result(change)
      real(wp), intent(in) :: tested(:, :), reference(:, :)   !! (replicate, dof)
      integer, intent(in) :: n_all
      type(statistic_type) :: change(size(tested, 2))

      change = difference_of(merge(ratio_of(tested, reference) - 1.0_wp, 0.0_wp, &
                                   reference > 0.0_wp), n_all)
   end function change_of_ratios

   !> Differences with their standard errors, from replicates: of all samples (0) and of all but the
   !> i-th.
   pure function difference_of(replicates, n_all) result(difference)
      real(wp), intent(in) :: replicates(0:, :)   !! (replicate, joint or dof)
      integer, intent(in) :: n_all                !! samples of the case
      type(statistic_type) :: difference(size(replicates, 2))
      integer :: i, n

      difference%value = replicates(0, :)
      n = size(replicates, 1) - 1
      do i = 1, merge(size(difference), 0, n > 0)
         associate (values => replicates(1:, i))   ! jackknife
            difference(i)%error = sqrt((n - 1.0_wp)/n*sum((values - mean(values))**2) &
                                       *max(0.0_wp, 1.0_wp - real(n, wp)/n_all))
         end associate
      end do
   end function difference_of

   !> Compares slip fractions.
   pure subroutine compare_slip(tested, reference, n_all, errors)
      real(wp), intent(in) :: tested(:, :)      !! (joint, sample) slip fractions
      real(wp), intent(in) :: reference(:, :)   !! (joint, sample)
      integer, intent(in) :: n_all              !! samples of the case
      type(numerical_error), intent(inout) :: errors
      real(wp) :: difference(size(tested, 1), size(tested, 2))
      ! (replicate, joint)
      real(wp), allocatable, dimension(:, :) :: mean_values, rms_values, std_values
      integer :: i, joint, last, n

      n = size(tested, 2)
      errors%n_samples = n
      last = merge(n, 0, n > 1)
      allocate (mean_values(0:last, size(tested, 1)))
      allocate (rms_values, std_values, mold=mean_values)
      difference = points*(tested - reference)
      do joint = 1, size(tested, 1)
         do i = 0, last
            associate (kept => without(i, n))
               mean_values(i, joint) = mean(difference(joint, kept))
               rms_values(i, joint) = sqrt(mean(difference(joint, kept)**2))
               std_values(i, joint) = deviation(points*tested(joint, kept)) &
                                      - deviation(points*reference(joint, kept))
            end associate
         end do
      end do
      errors%slip_largest = maxval(abs(difference), 2)
      errors%slip_mean = difference_of(mean_values, n_all)
      errors%slip_rms = difference_of(rms_values, n_all)
      if (n == 1) return
      errors%slip_std = difference_of(std_values, n_all)
      ! a few samples seldom contain the largest errors, and then the jackknife is too small: each
      ! standard error is at least the rms over the joints of max(jackknife, that of normal errors)
      associate (jackknife => errors%slip_rms%error, &
                 if_normal => errors%slip_rms%value &
                 *sqrt(max(0.0_wp, 1.0_wp - real(n, wp)/n_all)/(2*n)))
         jackknife = max(jackknife, sqrt(mean(max(jackknife, if_normal)**2)))
      end associate
   end subroutine compare_slip

   !> Compares spectra.
   pure subroutine compare_spectra(tested, reference, percentiles, n_all, errors)
      real(wp), intent(in) :: tested(:, :, :)      !! (dof, frequency, sample) densities
      real(wp), intent(in) :: reference(:, :, :)   !! (dof, frequency, sample)
      real(wp), intent(in) :: percentiles(:)       !! [%], ascending
      integer, intent(in) :: n_all                 !! samples of the case
      type(numerical_error), intent(inout) :: errors
      type(spectrum_comparison) :: comparison

      call comparison%add(tested, reference, percentiles)
      call comparison%finish(n_all, errors)
   end subroutine compare_spectra

   !> Adds the next range of frequencies of all samples.
   pure subroutine add(self, tested, reference, percentiles)
      class(spectrum_comparison), intent(inout) :: self
      real(wp), intent(in) :: tested(:, :, :)      !! (dof, frequency, sample) densities
      real(wp), intent(in) :: reference(:, :, :)   !! (dof, frequency, sample)
      real(wp), intent(in) :: percentiles(:)       !! [%], ascending, the same for every range
      real(wp), dimension(0:size(percentiles), 0:size(tested, 3)) :: ours, theirs
      integer :: dof, f

      if (.not. allocated(self%integral)) then
         self%percentiles = percentiles
         allocate (self%integral(0:size(percentiles), 0:size(tested, 3), &
                                 tested_psd:psd_difference, size(tested, 1)), source=0.0_wp)
      end if
      do dof = 1, size(tested, 1)
         associate (sums => self%integral(:, :, :, dof))
            do f = 1, size(tested, 2)
               ours = replicates_of(tested(dof, f, :), percentiles)
               theirs = replicates_of(reference(dof, f, :), percentiles)
               sums(:, :, tested_psd) = sums(:, :, tested_psd) + ours
               sums(:, :, reference_psd) = sums(:, :, reference_psd) + theirs
               sums(:, :, psd_difference) = sums(:, :, psd_difference) + abs(ours - theirs)
            end do
         end associate
      end do
   end subroutine add

   !> Computes the errors of a case of n_all samples after all ranges are added.
   pure subroutine finish(self, n_all, errors)
      class(spectrum_comparison), intent(in) :: self
      integer, intent(in) :: n_all
      type(numerical_error), intent(inout) :: errors
      integer :: last, n, p

      last = size(self%percentiles)
      n = ubound(self%integral, 2)
      associate (tested => self%integral(:, :, tested_psd, :), &
                 reference => self%integral(:, :, reference_psd, :), &
                 apart => self%integral(:, :, psd_difference, :))   ! indices of sections start at 1
         errors%psd_mean = difference_of(ratio_of(apart(1, :, :), reference(1, :, :)), n_all)
         if (n == 1) return
         allocate (errors%psd_percentiles(size(self%integral, 4), last))
         do p = 1, last
            errors%psd_percentiles(:, p) = &
               difference_of(ratio_of(apart(1 + p, :, :), reference(1 + p, :, :)), n_all)
         end do
         errors%band_ratio = &
            change_of_ratios(ratio_of(tested(1 + last, :, :), tested(2, :, :)), &
                             ratio_of(reference(1 + last, :, :), reference(2, :, :)), n_all)
      end associate
   end subroutine finish

   !> Mean (0) and percentiles (1..) of all values (replicate 0) and of all but the i-th (1..n). For
   !> one value only the mean.
   pure function replicates_of(values, percentiles) result(statistics)
      real(wp), intent(in) :: values(:), percentiles(:)
      real(wp) :: statistics(0:size(percentiles), 0:size(values))
      real(wp) :: sorted(size(values))
      integer :: ranking(size(values))
      integer :: i, n, p

      n = size(values)
      statistics = 0.0_wp
      statistics(0, 0) = mean(values)
      if (n == 1) return
      statistics(0, 1:) = (sum(values) - values)/(n - 1)
      ranking = sort_order(values)
      sorted = values(ranking)
      do p = 1, size(percentiles)
         statistics(p, 0) = at_rank(sorted, 1.0_wp + (n - 1)*percentiles(p)/100.0_wp)
         do i = 1, n
            statistics(p, ranking(i)) = at_rank_without(i, sorted, percentiles(p))
         end do
      end do
   end function replicates_of

   !> Percentile of all values but the i-th smallest: order statistics from i on are the next ones.
   pure real(wp) function at_rank_without(i, sorted, percentile) result(value)
      integer, intent(in) :: i
      real(wp), intent(in) :: sorted(:)   !! two or more
      real(wp), intent(in) :: percentile
      real(wp) :: low, high, rank
      integer :: below, n

      n = size(sorted)
      rank = 1.0_wp + (n - 2)*percentile/100.0_wp
      below = max(1, min(int(rank), n - 2))
      low = sorted(merge(below, below + 1, below < i))
      high = sorted(min(n, merge(below + 1, below + 2, below + 1 < i)))
      value = low + (rank - below)*(high - low)
   end function at_rank_without

   !> Numbers 1..n without i; all of them for i = 0.
   pure function without(i, n) result(kept)
      integer, intent(in) :: i, n
      integer, allocatable :: kept(:)
      integer :: k

      kept = pack([(k, k=1, n)], [(k /= i, k=1, n)])
   end function without

   !> Standard deviation; zero for one value.
   pure real(wp) function deviation(values) result(scatter)
      real(wp), intent(in) :: values(:)

      scatter = 0.0_wp
      if (size(values) > 1) scatter = standard_deviation(values)
   end function deviation

   !> Ratio of two values; zero if the denominator is not positive.
   elemental real(wp) function ratio_of(numerator, denominator) result(value)
      real(wp), intent(in) :: numerator, denominator

      value = 0.0_wp
      if (denominator > 0.0_wp) value = numerator/denominator
   end function ratio_of

end module campaign_comparison
