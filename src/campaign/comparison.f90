!> How far two marches of the same samples are apart in what is published of a case: the numerical
!> error of the first, where the second is much better.
!>
!> Both marches met the same friction and the same force, so the differences belong to the method
!> and its settings alone (the response is a contraction: even long histories stay comparable).
!> Where only some of a case's samples were marched twice, the standard errors say how far the
!> differences over all samples may be from those found: jackknife, leaving one sample out, times
!> the root of the share that was not compared; zero when all were. For percentiles the jackknife is
!> rough, as it is not consistent for one quantile; integrals over many frequencies smooth it.
module campaign_comparison
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: mean, standard_deviation
   use statistics_estimates, only: statistic_type
   use statistics_order, only: at_rank
   implicit none(type, external)
   private
   public :: numerical_error, spectrum_comparison, compare_slip, compare_spectra
   public :: slip_error, band_ratio_error, ratio_replicates, change_of_ratios

   real(wp), parameter :: points = 100.0_wp   !! of percent in a fraction

   !> Differences of the first march from the second in what is published, (joint or dof), with
   !> their standard errors, of which one sample tells nothing. Not allocated: not asked for, or it
   !> needs two samples.
   type :: numerical_error
      integer :: n_samples = 0                                !! that were compared
      type(statistic_type), allocatable :: slip_mean(:)       !! of the mean slip fraction [points]
      type(statistic_type), allocatable :: slip_rms(:)        !! over samples, of one [points]
      type(statistic_type), allocatable :: slip_std(:)        !! of the std over samples [points]
      real(wp), allocatable :: slip_largest(:)                !! (joint) of one sample [points]
      !> integral over frequency of the absolute difference of the mean densities, relative to that
      !> of the density
      type(statistic_type), allocatable :: psd_mean(:)
      type(statistic_type), allocatable :: psd_percentiles(:, :)   !! (dof, percentile) alike
      !> relative, of the ratio of the last to the first percentile's pseudo-variance; 0 for a dof
      !> that does not move in that share of the samples
      type(statistic_type), allocatable :: band_ratio(:)
   end type numerical_error

   !> Spectra that exist twice, compared range by range of their frequencies, in ascending order.
   type :: spectrum_comparison
      private
      real(wp), allocatable :: percentiles(:)   !! [%], ascending
      !> (mean (0) or percentile; all samples (0) or all but the i-th; which, dof) over frequency
      real(wp), allocatable :: integral(:, :, :, :)
   contains
      procedure :: add
      procedure :: finish
   end type spectrum_comparison

   !> Integrals of the densities of the first march, of the second, of their absolute difference.
   integer, parameter :: of_tested = 1, of_reference = 2, of_difference = 3

contains

   !> The numerical error of the slip fractions that counts against a target [points]: the largest
   !> over the dofs of the rms over samples. It bounds the error of the mean, and nearly (by the
   !> root of n/(n - 1)) that of the standard deviation, and no errors cancel in it.
   pure function slip_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors
      real(wp) :: largest

      largest = maxval(errors%slip_rms%value)
   end function slip_error

   !> The numerical error of the band ratios that counts against a target: the largest over the
   !> dofs, relative; 0 where there are no bands.
   pure function band_ratio_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors
      real(wp) :: largest

      largest = 0.0_wp
      if (allocated(errors%band_ratio)) largest = maxval(abs(errors%band_ratio%value))
   end function band_ratio_error

   !> Ratio of the last to the first percentile's pseudo-variance, Eq. (46), of all samples
   !> (replicate 0) and of all but the i-th (1..n); 0 for a dof that does not move in that share of
   !> the samples.
   pure function ratio_replicates(psd, percentiles) result(ratios)
      real(wp), intent(in) :: psd(:, :, :)     !! (dof, frequency, sample); two samples or more
      real(wp), intent(in) :: percentiles(:)   !! [%], ascending
      real(wp) :: ratios(0:size(psd, 3), size(psd, 1))
      real(wp), dimension(0:size(percentiles), 0:size(psd, 3)) :: integral
      integer :: dof, f

      do dof = 1, size(psd, 1)
         integral = 0.0_wp
         do f = 1, size(psd, 2)
            integral = integral + curves(psd(dof, f, :), percentiles)
         end do
         ratios(:, dof) = share(integral(size(percentiles), :), integral(1, :))
      end do
   end function ratio_replicates

   !> Relative changes of band ratios, for a case of n_all samples.
   pure function change_of_ratios(tested, reference, n_all) result(change)
      real(wp), intent(in) :: tested(:, :), reference(:, :)   !! (replicate, dof)
      integer, intent(in) :: n_all
      type(statistic_type) :: change(size(tested, 2))

      change = difference_of(relative_change(tested, reference), n_all)
   end function change_of_ratios

   !> A difference by its values of all samples (replicate 0) and of all but the i-th.
   pure function difference_of(replicates, n_all) result(difference)
      real(wp), intent(in) :: replicates(0:, :)   !! (replicate, joint or dof)
      integer, intent(in) :: n_all                !! samples of the case
      type(statistic_type) :: difference(size(replicates, 2))
      integer :: i

      difference%value = replicates(0, :)
      if (size(replicates, 1) > 1) &
         difference%error = [(jackknife_error(replicates(1:, i), n_all), i=1, size(replicates, 2))]
   end function difference_of

   !> Compares the slip fractions of samples that were marched twice, of n_all samples of the case.
   pure subroutine compare_slip(tested, reference, n_all, errors)
      real(wp), intent(in) :: tested(:, :)      !! (joint, sample) slip fractions, first march
      real(wp), intent(in) :: reference(:, :)   !! (joint, sample) second march
      integer, intent(in) :: n_all
      type(numerical_error), intent(inout) :: errors
      real(wp) :: difference(size(tested, 1), size(tested, 2))
      real(wp), allocatable, dimension(:, :) :: of_mean, of_rms, of_std   ! (replicate, joint)
      integer :: i, joint, last, n

      n = size(tested, 2)
      errors%n_samples = n
      last = merge(n, 0, n > 1)
      allocate (of_mean(0:last, size(tested, 1)))
      allocate (of_rms, of_std, mold=of_mean)
      difference = points*(tested - reference)
      do joint = 1, size(tested, 1)
         do i = 0, last
            associate (kept => without(i, n))
               of_mean(i, joint) = mean(difference(joint, kept))
               of_rms(i, joint) = sqrt(mean(difference(joint, kept)**2))
               of_std(i, joint) = deviation(points*tested(joint, kept)) &
                                  - deviation(points*reference(joint, kept))
            end associate
         end do
      end do
      errors%slip_largest = maxval(abs(difference), 2)
      errors%slip_mean = difference_of(of_mean, n_all)
      errors%slip_rms = difference_of(of_rms, n_all)
      if (n == 1) return
      errors%slip_std = difference_of(of_std, n_all)
      errors%slip_rms%error = not_alone(errors%slip_rms%value, errors%slip_rms%error, n, n_all)
   end subroutine compare_slip

   !> Standard errors of the rms of several dofs. A few samples seldom hold the largest errors, and
   !> where they do not, neither the rms nor its jackknife knows of them. So each is at least the
   !> root mean square of all dofs', whose errors are of one kind, and what enters there at least
   !> that of normal errors.
   pure function not_alone(rms, alone, n, n_all) result(error)
      real(wp), intent(in) :: rms(:)      !! (dof)
      real(wp), intent(in) :: alone(:)    !! (dof) by jackknife
      integer, intent(in) :: n, n_all     !! samples compared, and meant
      real(wp) :: error(size(rms))
      real(wp) :: of_normal(size(rms))

      of_normal = rms*sqrt(max(0.0_wp, 1.0_wp - real(n, wp)/n_all)/(2*n))
      error = max(alone, sqrt(mean(max(alone, of_normal)**2)))
   end function not_alone

   !> Compares the spectra of samples that were marched twice, of n_all samples of the case.
   pure subroutine compare_spectra(tested, reference, percentiles, n_all, errors)
      real(wp), intent(in) :: tested(:, :, :)      !! (dof, frequency, sample) densities
      real(wp), intent(in) :: reference(:, :, :)   !! (dof, frequency, sample)
      real(wp), intent(in) :: percentiles(:)       !! [%], ascending
      integer, intent(in) :: n_all
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
         allocate (self%integral(0:size(percentiles), 0:size(tested, 3), of_tested:of_difference, &
                                 size(tested, 1)), source=0.0_wp)
      end if
      do dof = 1, size(tested, 1)
         associate (sums => self%integral(:, :, :, dof))
            do f = 1, size(tested, 2)
               ours = curves(tested(dof, f, :), percentiles)
               theirs = curves(reference(dof, f, :), percentiles)
               sums(:, :, of_tested) = sums(:, :, of_tested) + ours
               sums(:, :, of_reference) = sums(:, :, of_reference) + theirs
               sums(:, :, of_difference) = sums(:, :, of_difference) + abs(ours - theirs)
            end do
         end associate
      end do
   end subroutine add

   !> Computes the errors of a case of n_all samples once all ranges are added.
   pure subroutine finish(self, n_all, errors)
      class(spectrum_comparison), intent(in) :: self
      integer, intent(in) :: n_all
      type(numerical_error), intent(inout) :: errors
      integer :: last, n, p

      last = size(self%percentiles)
      n = ubound(self%integral, 2)
      associate (tested => self%integral(:, :, of_tested, :), &
                 reference => self%integral(:, :, of_reference, :), &
                 apart => self%integral(:, :, of_difference, :))   ! all from 1 on
         errors%psd_mean = difference_of(share(apart(1, :, :), reference(1, :, :)), n_all)
         if (n == 1) return
         allocate (errors%psd_percentiles(size(self%integral, 4), last))
         do p = 1, last
            errors%psd_percentiles(:, p) = &
               difference_of(share(apart(1 + p, :, :), reference(1 + p, :, :)), n_all)
         end do
         errors%band_ratio = &
            change_of_ratios(share(tested(1 + last, :, :), tested(2, :, :)), &
                             share(reference(1 + last, :, :), reference(2, :, :)), n_all)
      end associate
   end subroutine finish

   !> Mean (0) and percentiles (1..) of all values (0) and of all but the i-th (1..n); one value has
   !> its mean alone.
   pure function curves(values, percentiles) result(statistics)
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
   end function curves

   !> A percentile of all values but the i-th: order statistics from i on are the next one's.
   pure function at_rank_without(i, sorted, percentile) result(value)
      integer, intent(in) :: i
      real(wp), intent(in) :: sorted(:)   !! two or more
      real(wp), intent(in) :: percentile
      real(wp) :: value
      real(wp) :: low, high, rank
      integer :: below, n

      n = size(sorted)
      rank = 1.0_wp + (n - 2)*percentile/100.0_wp
      below = max(1, min(int(rank), n - 2))
      low = sorted(merge(below, below + 1, below < i))
      high = sorted(min(n, merge(below + 1, below + 2, below + 1 < i)))
      value = low + (rank - below)*(high - low)
   end function at_rank_without

   !> 1..n without i; all of them for i = 0.
   pure function without(i, n) result(kept)
      integer, intent(in) :: i, n
      integer, allocatable :: kept(:)
      integer :: k

      kept = pack([(k, k=1, n)], [(k /= i, k=1, n)])
   end function without

   !> Zero for one value.
   pure function deviation(values) result(scatter)
      real(wp), intent(in) :: values(:)
      real(wp) :: scatter

      scatter = 0.0_wp
      if (size(values) > 1) scatter = standard_deviation(values)
   end function deviation

   !> Standard error from the values without one sample each, when n_all samples are meant.
   pure function jackknife_error(replicates, n_all) result(error)
      real(wp), intent(in) :: replicates(:)
      integer, intent(in) :: n_all
      real(wp) :: error
      integer :: n

      n = size(replicates)
      error = sqrt((n - 1.0_wp)/n*sum((replicates - mean(replicates))**2) &
                   *max(0.0_wp, 1.0_wp - real(n, wp)/n_all))
   end function jackknife_error

   !> A part of a whole; of nothing: zero.
   elemental function share(part, whole) result(value)
      real(wp), intent(in) :: part, whole
      real(wp) :: value

      value = 0.0_wp
      if (whole > 0.0_wp) value = part/whole
   end function share

   !> Relative change of a positive value; zero where there is none.
   elemental function relative_change(tested, reference) result(value)
      real(wp), intent(in) :: tested, reference
      real(wp) :: value

      value = 0.0_wp
      if (reference > 0.0_wp) value = tested/reference - 1.0_wp
   end function relative_change

end module campaign_comparison
