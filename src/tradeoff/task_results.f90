!> Results of the marches of a tradeoff: each kind of task fills its own components.
module tradeoff_task_results
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
   public :: published_error, published_numbers, setting_errors, task_result
   public :: find_plain_errors, find_published, find_setting_errors, find_variant

   real(wp), parameter :: points = 100.0_wp   !! of percent in a fraction

   !> An error of what is published, the largest over cases and dofs; a standard error where it is
   !> statistical. Those of spectra are integrals over frequency, relative to that of the density.
   type :: published_error
      real(wp) :: slip = 0.0_wp              !! [points] of the mean over samples
      real(wp) :: slip_std = 0.0_wp          !! [points] of the standard deviation over samples
      real(wp) :: psd_mean = 0.0_wp          !! of the mean spectrum
      real(wp) :: psd_percentiles = 0.0_wp   !! of the percentiles of the spectrum
      real(wp) :: band_ratio = 0.0_wp        !! relative, of band ratios
   end type published_error

   !> Errors of a setting against the reference, that of slip the rms over samples. A standard error
   !> is such that twice of it covers the errors of all.
   type, extends(published_error) :: setting_errors
      real(wp) :: slip_error = 0.0_wp         !! standard error of slip
      real(wp) :: slip_mean = 0.0_wp          !! [points] of the mean over samples
      real(wp) :: band_ratio_error = 0.0_wp   !! standard error of band_ratio
   end type setting_errors

   !> Published numbers of a case, of each joint and dof: values, errors or gains.
   type :: published_numbers
      real(wp), allocatable :: slip(:)         !! (joint) mean slip fraction over samples
      real(wp), allocatable :: slip_std(:)     !! (joint) its standard deviation
      real(wp), allocatable :: band_ratio(:)   !! (dof)
      !> the mean spectrum and its percentiles, integrated over frequency
      real(wp) :: psd_mean = 0.0_wp, psd_percentiles = 0.0_wp
   end type published_numbers

   !> Result of a task.
   type :: task_result
      real(wp) :: cost = 0.0_wp           !! of a sample-step [ns of a processor]
      integer :: n_samples = 0            !! that were marched
      type(setting_errors) :: errors      !! of a setting
      !> values in a batch [points, 1]; of a way to form spectra
      type(published_numbers) :: value
      !> plain sampling's standard errors from a case's samples [points, of the logarithm, relative]
      type(published_numbers) :: plain_error
      type(published_numbers) :: gain     !! plain_error over the error of the scene's estimator
      real(wp), allocatable :: slip_fraction(:, :)   !! (joint, sample) of a variant
      !> (0: of all samples, i: without the i-th; dof) band ratios of a variant
      real(wp), allocatable :: ratio_without(:, :)
   end type task_result

contains

   !> Compares a march with the reference of the same samples.
   pure subroutine find_setting_errors(plan, level, tested, reference, found)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      type(block_result), intent(in) :: tested, reference
      type(setting_errors), intent(out) :: found
      type(numerical_error) :: errors
      integer :: p

      call compare_cases(level, plan%cases%n_samples, tested%slip_fraction, &
                         reference%slip_fraction, found)
      if (.not. plan%output%spectrum) return
      call compare_spectra(tested%psd, reference%psd, plan%output%percentiles, level%n_all, errors)
      found%psd_mean = maxval(errors%psd_mean%value)
      if (size(level%sample) == 1) return
      found%psd_percentiles = maxval([(errors%psd_percentiles(p)%value, &
                                       p=1, size(errors%psd_percentiles))])
      found%band_ratio = band_ratio_error(errors)
      found%band_ratio_error = maxval(errors%band_ratio%error)
   end subroutine find_setting_errors

   !> Finds the largest errors of slip fractions over the cases of a level. One sample of many says
   !> as much as its error is large.
   pure subroutine compare_cases(level, n_samples, tested, reference, found)
      type(level_type), intent(in) :: level
      integer, intent(in) :: n_samples(:)       !! (case)
      real(wp), intent(in) :: tested(:, :)      !! (dof, sample)
      real(wp), intent(in) :: reference(:, :)   !! (dof, sample)
      type(setting_errors), intent(inout) :: found
      type(numerical_error) :: errors
      real(wp) :: scatter, surely
      integer, allocatable :: samples(:)
      integer :: c, i

      surely = 0.0_wp
      do c = 1, size(n_samples)
         samples = pack([(i, i=1, size(level%sample))], level%case_number == c)
         if (size(samples) == 0) cycle
         errors = numerical_error()
         call compare_slip(tested(:, samples), reference(:, samples), n_samples(c), errors)
         scatter = 0.0_wp
         if (size(samples) > 1) then
            scatter = maxval(errors%slip_rms%error)
            found%slip_std = max(found%slip_std, maxval(abs(errors%slip_std%value)))
         else if (n_samples(c) > 1) then
            scatter = slip_error(errors)
         end if
         surely = max(surely, slip_error(errors) + 2*scatter)
         found%slip = max(found%slip, slip_error(errors))
         found%slip_mean = max(found%slip_mean, maxval(abs(errors%slip_mean%value)))
      end do
      found%slip_error = 0.5_wp*(surely - found%slip)
   end subroutine compare_cases

   !> Finds mean slip fractions, their standard deviations over samples [points], and band ratios;
   !> 0 where there are none.
   pure subroutine find_published(plan, result, found)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      type(published_numbers), intent(out) :: found
      integer :: joint

      allocate (found%slip_std(plan%structure%n_joints), found%band_ratio(plan%structure%n_dof), &
                source=0.0_wp)
      found%slip = points*sum(result%slip_fraction, 2)/result%n_samples
      if (result%n_samples == 1) return
      do joint = 1, size(found%slip_std)
         found%slip_std(joint) = points*standard_deviation(result%slip_fraction(joint, :))
      end do
      if (plan%output%spectrum) &
         found%band_ratio = band_ratios(result%psd, plan%output%percentiles)
   end subroutine find_published

   !> Finds plain sampling's standard errors for as many samples as were marched, two or more.
   subroutine find_plain_errors(plan, result, found)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      type(published_numbers), intent(out) :: found
      type(case_statistics) :: statistics
      type(band_collector) :: bands
      integer :: dof, i, joint, p

      associate (m => plan%structure%n_joints, n => plan%structure%n_dof)
         allocate (found%slip(m), found%slip_std(m), found%band_ratio(n), source=0.0_wp)
         do joint = 1, m
            associate (slip => points*result%slip_fraction(joint, :))
               found%slip(joint) = standard_deviation(slip)/sqrt(real(result%n_samples, wp))
               found%slip_std(joint) = error_of_deviation(slip)
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
               found%band_ratio(dof) = log(statistics%band_ratio_high(dof) &
                                           /statistics%band_ratio(dof))/1.96_wp
            if (.not. statistics%pseudo_variance_mean(dof) > 0.0_wp) cycle
            found%psd_mean = max(found%psd_mean, sum(statistics%psd_mean_error(dof, :)) &
                                 /sum(statistics%psd_mean(dof, :)))
            do p = 1, size(plan%output%percentiles)
               found%psd_percentiles = max(found%psd_percentiles, &
                                        relative_error(statistics%psd_percentiles(dof, :, p), &
                                                       statistics%psd_percentiles_low(dof, :, p), &
                                                       statistics%psd_percentiles_high(dof, :, p)))
            end do
         end do
      end associate
   end subroutine find_plain_errors

   !> Relative error of an integral, from 95 % intervals of its integrand; 0 of nothing.
   pure real(wp) function relative_error(values, low, high)
      real(wp), intent(in) :: values(:), low(:), high(:)

      relative_error = 0.0_wp
      if (sum(values) > 0.0_wp) relative_error = sum(high - low)/(2*1.96_wp*sum(values))
   end function relative_error

   !> Finds slip fractions of all samples, and, where there are spectra, band ratios of all samples
   !> and without each.
   pure subroutine find_variant(plan, result, found)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      type(task_result), intent(inout) :: found

      found%slip_fraction = result%slip_fraction
      if (plan%output%spectrum) &
         found%ratio_without = ratio_replicates(result%psd, plan%output%percentiles)
   end subroutine find_variant

end module tradeoff_task_results
