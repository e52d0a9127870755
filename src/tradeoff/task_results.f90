!> Results of the tasks of a tradeoff: published numbers of a march, and their errors.
module tradeoff_task_results
   use campaign_bands, only: band_collector, start_bands
   use campaign_columns, only: column_collector, start_columns
   use campaign_comparison, only: band_ratio_error, compare_slip, compare_spectra, &
                                  numerical_error, ratio_replicates, slip_error
   use campaign_plan, only: plan_type
   use campaign_results, only: block_result, case_statistics
   use core_kinds, only: wp
   use numerics_statistics, only: standard_deviation
   use statistics_estimates, only: estimates_type, plain_percentile
   use tradeoff_sample, only: level_type
   implicit none(type, external)
   private
   public :: task_result
   public :: find_plain_statistics, plain_errors, find_published_values, find_setting_errors

   real(wp), parameter :: points = 100.0_wp   !! percentage points of a fraction of 1

   !> Places of the published numbers in a list: mean over samples of slip fractions [points], their
   !> standard deviation [points], mean and percentiles of spectra (relative, integrated over
   !> frequency), band ratio. In lists of errors, `slip` is the rms over samples of the error of a
   !> slip fraction, and slip_mean the error of the mean.
   integer, parameter, public :: slip = 1, slip_std = 2, psd_mean = 3, psd_percentiles = 4, &
                                 band_ratio = 5, slip_mean = 6, n_published = 6

   !> Result of a task; each kind of task fills its own components. Tables are (joint or dof,
   !> published number), zero for numbers that are not computed.
   type :: task_result
      real(wp) :: cost = 0.0_wp           !! processor time of a sample-step [ns]
      integer :: n_samples = 0            !! number of samples that were marched
      !> setting task: (published number; 1: error, 2: error plus twice its standard error), the
      !> largest over cases and dofs
      real(wp), allocatable :: errors(:, :)
      real(wp), allocatable :: value(:, :)   !! batch and spectrum tasks: published numbers
      !> samples task: standard errors of plain sampling; for band ratios of the logarithm
      real(wp), allocatable :: plain_error(:, :)
      !> samples task: plain_error over the standard error of the scene's estimator
      real(wp), allocatable :: gain(:, :)
      real(wp), allocatable :: slip_fraction(:, :)   !! variant task: (joint, sample)
      !> variant task: band ratios (0: of all samples, i: of all but the i-th; dof)
      real(wp), allocatable :: ratio_without(:, :)
   end type task_result

contains

   !> Computes the errors of a march against the reference of the same samples: of slip fractions
   !> the largest over the cases of a level. The standard error of an error from one sample of
   !> several is taken as large as the error.
   pure subroutine find_setting_errors(plan, level, tested, reference, found)
      type(plan_type), intent(in) :: plan
      type(level_type), intent(in) :: level
      type(block_result), intent(in) :: tested, reference
      real(wp), allocatable, intent(out) :: found(:, :)   !! as task_result%errors
      type(numerical_error) :: errors
      real(wp) :: scatter
      integer, allocatable :: samples(:)
      integer :: c, i

      allocate (found(n_published, 2), source=0.0_wp)
      do c = 1, size(plan%cases)
         samples = pack([(i, i=1, size(level%samples))], level%samples%case_number == c)
         if (size(samples) == 0) cycle
         errors = numerical_error()
         call compare_slip(tested%slip_fraction(:, samples), reference%slip_fraction(:, samples), &
                           plan%cases(c)%n_samples, errors)
         scatter = 0.0_wp
         if (size(samples) > 1) then
            scatter = maxval(errors%slip_rms%error)
            found(slip_std, 1) = max(found(slip_std, 1), maxval(abs(errors%slip_std%value)))
         else if (plan%cases(c)%n_samples > 1) then
            scatter = slip_error(errors)
         end if
         found(slip, :) = max(found(slip, :), slip_error(errors) + [0.0_wp, 2*scatter])
         found(slip_mean, 1) = max(found(slip_mean, 1), maxval(abs(errors%slip_mean%value)))
      end do
      if (.not. plan%output%spectrum) return
      call compare_spectra(tested%psd, reference%psd, plan%output%percentiles, level%n_all, errors)
      found(psd_mean, 1) = maxval(errors%psd_mean%value)
      if (size(level%samples) == 1) return
      found(psd_percentiles, 1) = maxval(errors%psd_percentiles%value)
      found(band_ratio, 1) = band_ratio_error(errors)
      found(band_ratio, 2) = found(band_ratio, 1) + 2*maxval(errors%band_ratio%error)
   end subroutine find_setting_errors

   !> Computes mean slip fractions, their standard deviations over samples, and band ratios.
   pure subroutine find_published_values(plan, result, found)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      real(wp), allocatable, intent(out) :: found(:, :)   !! (joint or dof, published number)
      integer :: joint

      associate (m => plan%structure%n_joints, n => plan%structure%n_dof)
         allocate (found(max(m, n), n_published), source=0.0_wp)
         found(:m, slip) = points*sum(result%slip_fraction, 2)/result%n_samples
         if (result%n_samples == 1) return
         do joint = 1, m
            found(joint, slip_std) = points*standard_deviation(result%slip_fraction(joint, :))
         end do
         if (.not. plan%output%spectrum) return
         associate (ratios => ratio_replicates(result%psd, plan%output%percentiles))
            found(:n, band_ratio) = ratios(1, :)   ! ratios of all samples
         end associate
      end associate
   end subroutine find_published_values

   !> Computes the statistics of plain sampling from two or more samples. statistics%numbers are
   !> those of the slip fractions alone.
   subroutine find_plain_statistics(plan, result, statistics)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result
      type(case_statistics), intent(out) :: statistics
      type(band_collector) :: bands
      type(column_collector) :: fractions
      integer :: i, joint, last

      associate (percentiles => plan%output%percentiles, n => plan%structure%n_joints)
         call start_columns(result%n_samples, n, percentiles, fractions)
         do joint = 1, n
            call fractions%add(joint, 1, result%slip_fraction(joint, :))
         end do
         last = size(percentiles) + 2
         allocate (statistics%numbers(n, last))
         call fractions%finish(statistics%numbers(:, :last - 1), statistics%numbers(:, last))
         if (.not. plan%output%spectrum) return
         associate (step => 1.0_wp/(plan%output%segment_length*plan%integration%dt))
            call start_bands(result%n_samples, plan%structure%n_dof, &
                             [(i*step, i=0, size(result%psd, 2) - 1)], percentiles, 1, bands)
         end associate
         call bands%add(1, 1, 1, result%psd)
         call bands%finish(statistics)
      end associate
   end subroutine find_plain_statistics

   !> Standard errors of plain sampling. Those of percentiles and band ratios are of influences
   !> alone: intervals of few samples reach much farther, and do not fall as n^(-1/2).
   pure function plain_errors(plan, result, statistics) result(found)
      type(plan_type), intent(in) :: plan
      type(block_result), intent(in) :: result   !! results of the samples of `statistics`
      type(case_statistics), intent(in) :: statistics
      real(wp), allocatable :: found(:, :)   !! (joint or dof, published number)
      real(wp) :: influence(result%n_samples), own(result%n_samples)   ! on ln of integrals
      real(wp), allocatable :: logarithm(:, :)   ! of the densities (sample, frequency)
      type(estimates_type) :: percentile
      integer :: dof, last, p

      last = size(statistics%numbers, 2)
      associate (m => plan%structure%n_joints, n => plan%structure%n_dof)
         allocate (found(max(m, n), n_published), source=0.0_wp)
         found(:m, slip) = points*statistics%numbers(:, 1)%error
         found(:m, slip_std) = points*statistics%numbers(:, last)%error
         if (.not. allocated(statistics%psd)) return
         do dof = 1, n
            associate (psd => statistics%psd(dof, :, :)%value)
               if (.not. minval(statistics%pseudo_variances(dof, :last - 1)%value) > 0.0_wp) cycle
               found(dof, psd_mean) = sum(statistics%psd(dof, :, 1)%error)/sum(psd(:, 1))
               logarithm = log(max(transpose(result%psd(dof, :, :)), tiny(1.0_wp)))
               do p = 2, last - 1
                  percentile = plain_percentile(logarithm, plan%output%percentiles(p - 1)/100.0_wp)
                  own = matmul(percentile%influence, psd(:, p))/sum(psd(:, p))
                  if (p == 2) influence = own
                  found(dof, psd_percentiles) = max(found(dof, psd_percentiles), &
                                                    dot_product(norm2(percentile%influence, 1), &
                                                                psd(:, p))/sum(psd(:, p)))
               end do
               found(dof, band_ratio) = norm2(own - influence)
            end associate
         end do
      end associate
   end function plain_errors

end module tradeoff_task_results
