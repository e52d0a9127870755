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
   use statistics_order, only: at_rank
   implicit none(type, external)
   private
   public :: numerical_error, spectrum_comparison, compare_slip, compare_spectra
   public :: slip_error, band_ratio_error, band_ratios, ratio_replicates, change_of_ratio

   real(wp), parameter :: points = 100.0_wp   !! of percent in a fraction

   !> Differences of the first march from the second. A difference that was not asked for, or needs
   !> two samples and has one, is not allocated. Each `*_error` is the standard error of what stands
   !> before it.
   type :: numerical_error
      real(wp), allocatable :: slip_mean(:)            !! (dof) of the mean slip fraction [points]
      real(wp), allocatable :: slip_mean_error(:)
      real(wp), allocatable :: slip_rms(:)             !! (dof) over samples, of one sample [points]
      real(wp), allocatable :: slip_rms_error(:)
      real(wp), allocatable :: slip_largest(:)         !! (dof) of one sample [points]
      real(wp), allocatable :: slip_std(:)             !! (dof) of the std over samples [points]
      real(wp), allocatable :: slip_std_error(:)
      !> (dof) integral over frequency of the absolute difference of the mean densities, relative to
      !> that of the density
      real(wp), allocatable :: psd_mean(:)
      real(wp), allocatable :: psd_mean_error(:)
      !> (dof, percentile) the same for each percentile over samples
      real(wp), allocatable :: psd_percentiles(:, :)
      real(wp), allocatable :: psd_percentiles_error(:, :)
      !> (dof) relative, of the ratio of the last to the first percentile's pseudo-variance; 0 for a
      !> dof that does not move in that share of the samples
      real(wp), allocatable :: band_ratio(:)
      real(wp), allocatable :: band_ratio_error(:)
   end type numerical_error

   !> Integrals over frequency of one dof, of all samples (0) and without sample i: replicate 0..n.
   type :: spectrum_integrals
      real(wp), allocatable :: reference(:, :)  !! (curve, replicate) of the second march
      real(wp), allocatable :: tested(:, :)    !! (curve, replicate) of the first
      real(wp), allocatable :: apart(:, :)     !! (curve, replicate) of the absolute difference
   end type spectrum_integrals

   !> Spectra that exist twice, compared range by range of their frequencies, in ascending order.
   type :: spectrum_comparison
      private
      real(wp), allocatable :: percentiles(:)                 !! [%], ascending
      type(spectrum_integrals), allocatable :: integrals(:)   !! (dof)
   contains
      procedure :: add
      procedure :: finish
   end type spectrum_comparison

contains

   !> The numerical error of the slip fractions that counts against a target [points]: the largest
   !> over the dofs of the rms over samples. It bounds the error of the mean, and nearly (by the
   !> root of n/(n - 1)) that of the standard deviation, and no errors cancel in it.
   pure function slip_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors
      real(wp) :: largest

      largest = maxval(errors%slip_rms)
   end function slip_error

   !> The numerical error of the band ratios that counts against a target: the largest over the
   !> dofs, relative; 0 where there are no bands.
   pure function band_ratio_error(errors) result(largest)
      type(numerical_error), intent(in) :: errors
      real(wp) :: largest

      largest = 0.0_wp
      if (allocated(errors%band_ratio)) largest = maxval(abs(errors%band_ratio))
   end function band_ratio_error

   !> Ratio of the last to the first percentile's pseudo-variance, Eq. (46); 0 for a dof that does
   !> not move in that share of the samples.
   pure function band_ratios(psd, percentiles) result(ratio)
      real(wp), intent(in) :: psd(:, :, :)     !! (dof, frequency, sample); two samples or more
      real(wp), intent(in) :: percentiles(:)   !! [%], ascending
      real(wp) :: ratio(size(psd, 1))
      real(wp) :: ratios(0:size(psd, 3), size(psd, 1))

      ratios = ratio_replicates(psd, percentiles)
      ratio = ratios(0, :)
   end function band_ratios

   !> Band ratios of all samples (replicate 0) and of all but the i-th (1..n).
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

   !> Computes the relative change of a band ratio and its standard error for a case of n_all
   !> samples.
   pure subroutine change_of_ratio(tested, reference, n_all, value, standard_error)
      real(wp), intent(in) :: tested(0:), reference(0:)   !! (replicate) of ratio_replicates
      integer, intent(in) :: n_all
      real(wp), intent(out) :: value, standard_error

      value = change(tested(0), reference(0))
      standard_error = jackknife_error(change(tested(1:), reference(1:)), n_all)
   end subroutine change_of_ratio

   !> Compares the slip fractions of samples that were marched twice, of n_all samples of the case.
   pure subroutine compare_slip(tested, reference, n_all, errors)
      real(wp), intent(in) :: tested(:, :)      !! (dof, sample) slip fractions, first march
      real(wp), intent(in) :: reference(:, :)   !! (dof, sample) second march
      integer, intent(in) :: n_all
      type(numerical_error), intent(inout) :: errors
      real(wp) :: difference(size(tested, 2))
      real(wp) :: of_mean(0:size(tested, 2)), of_rms(0:size(tested, 2)), of_std(0:size(tested, 2))
      integer :: dof, i, n, n_dof

      n_dof = size(tested, 1)
      n = size(tested, 2)
      allocate (errors%slip_mean(n_dof), errors%slip_rms(n_dof), errors%slip_largest(n_dof))
      if (n > 1) allocate (errors%slip_mean_error(n_dof), errors%slip_rms_error(n_dof), &
                           errors%slip_std(n_dof), errors%slip_std_error(n_dof))
      do dof = 1, n_dof
         difference = points*(tested(dof, :) - reference(dof, :))
         errors%slip_mean(dof) = mean(difference)
         errors%slip_rms(dof) = sqrt(mean(difference**2))
         errors%slip_largest(dof) = maxval(abs(difference))
         if (n == 1) cycle
         do i = 0, n
            associate (kept => without(i, n))
               of_mean(i) = mean(difference(kept))
               of_rms(i) = sqrt(mean(difference(kept)**2))
               of_std(i) = deviation(points*tested(dof, kept)) &
                           - deviation(points*reference(dof, kept))
            end associate
         end do
         errors%slip_std(dof) = of_std(0)
         errors%slip_mean_error(dof) = jackknife_error(of_mean(1:), n_all)
         errors%slip_rms_error(dof) = jackknife_error(of_rms(1:), n_all)
         errors%slip_std_error(dof) = jackknife_error(of_std(1:), n_all)
      end do
      if (n > 1) errors%slip_rms_error(:) = not_alone(errors%slip_rms, errors%slip_rms_error, n, &
                                                      n_all)
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
      integer :: dof

      if (.not. allocated(self%integrals)) then
         self%percentiles = percentiles
         allocate (self%integrals(size(tested, 1)))
      end if
      do dof = 1, size(tested, 1)
         call integrate(tested(dof, :, :), reference(dof, :, :), percentiles, self%integrals(dof))
      end do
   end subroutine add

   !> Computes the errors of a case of n_all samples once all ranges are added.
   pure subroutine finish(self, n_all, errors)
      class(spectrum_comparison), intent(in) :: self
      integer, intent(in) :: n_all
      type(numerical_error), intent(inout) :: errors
      real(wp), allocatable :: relative(:)   ! (replicate)
      integer :: dof, last, n, n_dof, p

      n_dof = size(self%integrals)
      last = size(self%percentiles)
      n = ubound(self%integrals(1)%reference, 2)
      allocate (errors%psd_mean(n_dof), relative(0:n))
      if (n > 1) allocate (errors%psd_mean_error(n_dof), errors%psd_percentiles(n_dof, last), &
                           errors%psd_percentiles_error(n_dof, last), &
                           errors%band_ratio(n_dof), errors%band_ratio_error(n_dof))
      do dof = 1, n_dof
         associate (integrals => self%integrals(dof))
            relative(:) = share(integrals%apart(0, :), integrals%reference(0, :))
            errors%psd_mean(dof) = relative(0)
            if (n == 1) cycle
            errors%psd_mean_error(dof) = jackknife_error(relative(1:), n_all)
            do p = 1, last
               relative(:) = share(integrals%apart(p, :), integrals%reference(p, :))
               errors%psd_percentiles(dof, p) = relative(0)
               errors%psd_percentiles_error(dof, p) = jackknife_error(relative(1:), n_all)
            end do
            call change_of_ratio(share(integrals%tested(last, :), integrals%tested(1, :)), &
                                 share(integrals%reference(last, :), integrals%reference(1, :)), &
                                 n_all, errors%band_ratio(dof), errors%band_ratio_error(dof))
         end associate
      end do
   end subroutine finish

   !> Adds the frequencies of one dof's curves, the mean (0) and the percentiles (1..), for all
   !> samples and without each of them.
   pure subroutine integrate(tested, reference, percentiles, integrals)
      real(wp), intent(in) :: tested(:, :), reference(:, :)   !! (frequency, sample)
      real(wp), intent(in) :: percentiles(:)
      type(spectrum_integrals), intent(inout) :: integrals
      real(wp), dimension(0:size(percentiles), 0:size(tested, 2)) :: ours, theirs
      integer :: f

      if (.not. allocated(integrals%reference)) then
         associate (last => size(percentiles), n => size(tested, 2))
            allocate (integrals%reference(0:last, 0:n), integrals%tested(0:last, 0:n), &
                      integrals%apart(0:last, 0:n), source=0.0_wp)
         end associate
      end if
      do f = 1, size(tested, 1)
         ours = curves(tested(f, :), percentiles)
         theirs = curves(reference(f, :), percentiles)
         integrals%reference = integrals%reference + theirs
         integrals%tested = integrals%tested + ours
         integrals%apart = integrals%apart + abs(ours - theirs)
      end do
   end subroutine integrate

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
   elemental function change(tested, reference) result(value)
      real(wp), intent(in) :: tested, reference
      real(wp) :: value

      value = 0.0_wp
      if (reference > 0.0_wp) value = tested/reference - 1.0_wp
   end function change

end module campaign_comparison
