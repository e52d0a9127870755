!> The part of the error that finite samples leave, of the scene's estimator.
module tradeoff_samples_part
   use campaign_samples_needed, only: error_with, law_share
   use core_kinds, only: wp
   use tradeoff_task_results, only: task_result
   use tradeoff_tasks, only: of_samples, tradeoff_type
   implicit none(type, external)
   private
   public :: mean_slip_errors, noise_of_one, part_of_samples, published_error

   !> An error of what is published, the largest over cases and dofs; a standard error where it is
   !> statistical. Those of spectra are integrals over frequency, relative to that of the density.
   type :: published_error
      real(wp) :: slip = 0.0_wp              !! [points] of the mean over samples
      real(wp) :: slip_std = 0.0_wp          !! [points] of the standard deviation over samples
      real(wp) :: psd_mean = 0.0_wp          !! of the mean spectrum
      real(wp) :: psd_percentiles = 0.0_wp   !! of the percentiles of the spectrum
      real(wp) :: ratio = 0.0_wp             !! relative, of band ratios
   end type published_error

contains

   !> The part of finite samples with so many times the scene's.
   pure function part_of_samples(tradeoff, time_slip, n_steps, times) result(part)
      type(tradeoff_type), intent(in) :: tradeoff
      real(wp), intent(in) :: time_slip      !! the part of slip that the length of the march leaves
      integer, intent(in) :: n_steps         !! of the scene, after those discarded
      real(wp), intent(in) :: times
      type(published_error) :: part
      integer :: i

      do i = 1, size(tradeoff%tasks)
         if (tradeoff%tasks(i)%kind == of_samples) &
            call add_samples(tradeoff, tradeoff%cases(tradeoff%tasks(i)%row), tradeoff%found(i), &
                             noise_of_one(tradeoff, time_slip, n_steps), times, part)
      end do
   end function part_of_samples

   !> Time-average error of one sample [points] where each has its own record, as the scatter over
   !> samples of a short march holds it too; else 0.
   pure real(wp) function noise_of_one(tradeoff, time_slip, n_steps)
      type(tradeoff_type), intent(in) :: tradeoff
      real(wp), intent(in) :: time_slip
      integer, intent(in) :: n_steps   !! of the scene

      noise_of_one = 0.0_wp
      if (tradeoff%plan%excitation%per_sample) noise_of_one = time_slip &
         *sqrt(maxval(tradeoff%plan%cases%n_samples)*real(n_steps, wp) &
               /tradeoff%plan%integration%n_steps)
   end function noise_of_one

   !> Finds standard errors of mean slip fractions for as many samples as were marched [points]
   !> without what their own records add, and plain sampling's over them.
   pure subroutine mean_slip_errors(found, noise, now, ratio)
      type(task_result), intent(in) :: found   !! of the samples of a case
      real(wp), intent(in) :: noise            !! of one sample [points]
      real(wp), allocatable, intent(out) :: now(:), ratio(:)   !! (joint)

      associate (w => real(found%n_samples, wp))
         now = (found%plain_error%slip/found%gain%slip)**2 - noise**2/w
         ratio = sqrt(max(0.0_wp, found%plain_error%slip**2 - noise**2/w))
         now = min(ratio, max(law_share*sqrt(w)*ratio, sqrt(max(0.0_wp, now))))
      end associate
      where (now > 0.0_wp)
         ratio = ratio/now
      else where
         ratio = 1.0_wp
      end where
   end subroutine mean_slip_errors

   !> Adds errors from the samples of one case, for so many times as many as the scene has of it.
   pure subroutine add_samples(tradeoff, case_number, found, noise, times, part)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: case_number
      type(task_result), intent(in) :: found
      real(wp), intent(in) :: noise   !! of one sample's slip, due to its own record [points]
      real(wp), intent(in) :: times
      type(published_error), intent(inout) :: part
      real(wp), allocatable :: now(:), ratio(:)

      call mean_slip_errors(found, noise, now, ratio)
      associate (n => times*tradeoff%plan%cases(case_number)%n_samples, &
                 most => tradeoff%most_fitted(case_number), plain => found%plain_error, &
                 gain => found%gain)
         part%slip = max(part%slip, maxval(error_with(n, real(found%n_samples, wp), now, ratio, &
                                                      0.0_wp, most)))
         part%slip_std = max(part%slip_std, maxval(with_gain(plain%slip_std, gain%slip_std)))
         part%ratio = max(part%ratio, maxval(with_gain(plain%band_ratio, gain%band_ratio)))
         part%psd_mean = max(part%psd_mean, with_gain(plain%psd_mean, gain%psd_mean))
         part%psd_percentiles = max(part%psd_percentiles, &
                                    with_gain(plain%psd_percentiles, gain%psd_percentiles))
      end associate

   contains

      !> The error with n samples from plain sampling's with those marched.
      elemental real(wp) function with_gain(plain, gain)
         real(wp), intent(in) :: plain, gain

         with_gain = error_with(times*tradeoff%plan%cases(case_number)%n_samples, &
                                real(found%n_samples, wp), plain/gain, gain, 0.0_wp, &
                                tradeoff%most_fitted(case_number))
      end function with_gain

   end subroutine add_samples

end module tradeoff_samples_part
