!> Numbers to which each march of a tradeoff is reduced.
module tradeoff_numbers
   use campaign_bands, only: band_collector, start_bands
   use campaign_comparison, only: band_ratio_error, band_ratios, compare_slip, compare_spectra, &
      numerical_error, ratio_replicates, slip_error
   use campaign_plan, only: plan_type
   use campaign_results, only: block_result, case_statistics
   use core_kinds, only: wp
   use numerics_statistics, only: error_of_deviation, standard_deviation
   use tradeoff_sample, only: level_type
   implicit none(type, external)
   private
   public :: batch_numbers, ratio_numbers, sample_numbers, setting_numbers, variant_numbers

   real(wp), parameter :: points = 100.0_wp   !! of percent in a fraction

contains

   !> Against the reference: slip fractions [points] rms over samples and its standard error, their
   !> mean, their standard deviation; mean spectrum, percentiles, band ratio and its standard error
   !> [relative].
   pure function setting_numbers(plan, level, tested, reference) result(numbers)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      type(block_result), intent(in) :: tested, reference
      real(wp) :: numbers(8)
      type(numerical_error) :: errors

      numbers = 0.0_wp
      numbers(:4) = compare_cases(level, plan%cases%n_samples, tested%slip_fraction, &
                                  reference%slip_fraction)
      if (.not. plan%output%spectrum) return
      call compare_spectra(tested%psd, reference%psd, plan%output%percentiles, level%n_all, errors)
      numbers(5) = maxval(errors%psd_mean)
      if (size(level%sample) == 1) return
      numbers(6) = maxval(errors%psd_percentiles)
      numbers(7) = band_ratio_error(errors)
      numbers(8) = maxval(errors%band_ratio_error)
   end function setting_numbers

   !> The largest errors of slip fractions over the cases of a level: rms, its standard error, mean,
   !> standard deviation. The standard error is such that twice of it covers that of every case. One
   !> sample of many says as much as its error is large.
   pure function compare_cases(level, n_samples, tested, reference) result(numbers)
      type(level_type), intent(in) :: level
      integer, intent(in) :: n_samples(:)       !! (case)
      real(wp), intent(in) :: tested(:, :)      !! (dof, sample)
      real(wp), intent(in) :: reference(:, :)   !! (dof, sample)
      real(wp) :: numbers(4)
      type(numerical_error) :: errors
      real(wp) :: scatter, surely
      integer, allocatable :: samples(:)
      integer :: c, i

      numbers = 0.0_wp
      surely = 0.0_wp
      do c = 1, size(n_samples)
         samples = pack([(i, i=1, size(level%sample))], level%case_number == c)
         if (size(samples) == 0) cycle
         errors = numerical_error()
         call compare_slip(tested(:, samples), reference(:, samples), n_samples(c), errors)
         scatter = 0.0_wp
         if (size(samples) > 1) then
            scatter = maxval(errors%slip_rms_error)
            numbers(4) = max(numbers(4), maxval(abs(errors%slip_std)))
         else if (n_samples(c) > 1) then
            scatter = slip_error(errors)
         end if
         surely = max(surely, slip_error(errors) + 2*scatter)
         numbers(1) = max(numbers(1), slip_error(errors))
         numbers(3) = max(numbers(3), maxval(abs(errors%slip_mean)))
      end do
      numbers(2) = 0.5_wp*(surely - numbers(1))
   end function compare_cases

   !> Band ratios (dof); 0 where there are none.
   pure function ratio_numbers(plan, result) result(numbers)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      real(wp) :: numbers(plan%structure%n_dof)

      numbers = 0.0_wp
      if (plan%output%spectrum .and. result%n_samples > 1) &
         numbers = band_ratios(result%psd, plan%output%percentiles)
   end function ratio_numbers

   !> Mean slip fractions [points] (joint), their standard deviations over samples [points] (joint),
   !> band ratios (dof).
   pure function batch_numbers(plan, result) result(numbers)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      real(wp) :: numbers(2*plan%structure%n_joints + plan%structure%n_dof)
      integer :: joint

      associate (m => plan%structure%n_joints)
         numbers(:m) = points*sum(result%slip_fraction, 2)/result%n_samples
         numbers(m + 1:2*m) = 0.0_wp
         numbers(2*m + 1:) = ratio_numbers(plan, result)
         if (result%n_samples == 1) return
         do joint = 1, m
            numbers(m + joint) = points*standard_deviation(result%slip_fraction(joint, :))
         end do
      end associate
   end function batch_numbers

   !> Standard deviation over samples of slip fractions, its standard error [points] (joint each),
   !> standard error of the logarithm of the band ratio (dof), for as many samples as were marched;
   !> their number; standard errors of mean spectrum and percentiles, integrals over frequency,
   !> relative, the largest.
   function sample_numbers(plan, result) result(numbers)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result   !! two samples or more
      real(wp) :: numbers(2*plan%structure%n_joints + plan%structure%n_dof + 3)
      type(case_statistics) :: statistics
      type(band_collector) :: bands
      integer :: dof, i, joint, p

      numbers = 0.0_wp
      associate (m => plan%structure%n_joints, n => plan%structure%n_dof, &
                 last => 2*plan%structure%n_joints + plan%structure%n_dof)
         numbers(last + 1) = result%n_samples
         do joint = 1, m
            associate (slip => points*result%slip_fraction(joint, :))
               numbers(joint) = standard_deviation(slip)
               numbers(m + joint) = error_of_deviation(slip)
            end associate
         end do
         if (.not. plan%output%spectrum) return
         associate (step => 1.0_wp/(plan%output%segment_length*plan%integration%dt))
            call start_bands(result%n_samples, n, [(i*step, i=0, size(result%psd, 2) - 1)], &
                             plan%output%percentiles, plan%seed, 1, bands)
         end associate
         call bands%add(1, 1, 1, result%psd)
         call bands%finish(statistics)
         do dof = 1, n
            if (minval(statistics%pseudo_variance_percentiles(dof, :)) > 0.0_wp) &
               numbers(2*m + dof) = log(statistics%band_ratio_high(dof) &
                                        /statistics%band_ratio(dof))/1.96_wp
            if (.not. statistics%pseudo_variance_mean(dof) > 0.0_wp) cycle
            numbers(last + 2) = max(numbers(last + 2), sum(statistics%psd_mean_error(dof, :)) &
                                    /sum(statistics%psd_mean(dof, :)))
            do p = 1, size(plan%output%percentiles)
               numbers(last + 3) = max(numbers(last + 3), &
                                       relative_error(statistics%psd_percentiles(dof, :, p), &
                                                      statistics%psd_percentiles_low(dof, :, p), &
                                                      statistics%psd_percentiles_high(dof, :, p)))
            end do
         end do
      end associate
   end function sample_numbers

   !> Relative error of an integral, from 95 % intervals of its integrand; 0 of nothing.
   pure real(wp) function relative_error(values, low, high)
      real(wp), intent(in) :: values(:), low(:), high(:)

      relative_error = 0.0_wp
      if (sum(values) > 0.0_wp) relative_error = sum(high - low)/(2*1.96_wp*sum(values))
   end function relative_error

   !> Slip fractions (joint, sample), then, where there are spectra, band ratios (replicate 0..n,
   !> dof): of all samples, and without each.
   pure function variant_numbers(plan, result) result(numbers)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      real(wp), allocatable :: numbers(:)

      numbers = [result%slip_fraction]
      if (plan%output%spectrum) &
         numbers = [numbers, ratio_replicates(result%psd, plan%output%percentiles)]
   end function variant_numbers

end module tradeoff_numbers
