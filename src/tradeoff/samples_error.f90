!> The component of the error that finite samples leave, of the scene's estimator.
module tradeoff_samples_error
   use campaign_samples_needed, only: error_with, law_share
   use core_kinds, only: wp
   use tradeoff_task_results, only: published_error, task_result
   use tradeoff_tasks, only: of_samples, tradeoff_type
   implicit none(type, external)
   private
   public :: error_of_samples, mean_slip_errors, noise_of_one

contains

   !> The component of finite samples with so many times the scene's.
   pure function error_of_samples(tradeoff, time_slip, n_steps, times) result(error)
      type(tradeoff_type), intent(in) :: tradeoff
      real(wp), intent(in) :: time_slip      !! time-average error of slip
      integer, intent(in) :: n_steps         !! of the scene, after those discarded
      real(wp), intent(in) :: times
      type(published_error) :: error
      integer :: i

      do i = 1, size(tradeoff%tasks)
         if (tradeoff%tasks(i)%kind == of_samples) &
            call add_samples(tradeoff, tradeoff%cases(tradeoff%tasks(i)%row), tradeoff%found(i), &
                             noise_of_one(tradeoff, time_slip, n_steps), times, error)
      end do
   end function error_of_samples

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
   pure subroutine add_samples(tradeoff, case_number, found, noise, times, error)
      type(tradeoff_type), intent(in) :: tradeoff
      integer, intent(in) :: case_number
      type(task_result), intent(in) :: found
      real(wp), intent(in) :: noise   !! of one sample's slip, due to its own record [points]
      real(wp), intent(in) :: times
      type(published_error), intent(inout) :: error
      real(wp), allocatable :: now(:), ratio(:)

      call mean_slip_errors(found, noise, now, ratio)
      associate (n => times*tradeoff%plan%cases(case_number)%n_samples, &
                 n_cases => tradeoff%n_cases(case_number), plain => found%plain_error, &
                 gain => found%gain)
         error%slip = max(error%slip, maxval(error_with(n, real(found%n_samples, wp), now, ratio, &
                                                      0.0_wp, n_cases)))
         error%slip_std = max(error%slip_std, maxval(with_gain(plain%slip_std, gain%slip_std)))
         error%band_ratio = max(error%band_ratio, &
                                maxval(with_gain(plain%band_ratio, gain%band_ratio)))
         error%psd_mean = max(error%psd_mean, with_gain(plain%psd_mean, gain%psd_mean))
         error%psd_percentiles = max(error%psd_percentiles, &
                                    with_gain(plain%psd_percentiles, gain%psd_percentiles))
      end associate

   contains

      !> The error with n samples from plain sampling's with those marched.
      elemental real(wp) function with_gain(plain, gain)
         real(wp), intent(in) :: plain, gain

         with_gain = error_with(times*tradeoff%plan%cases(case_number)%n_samples, &
                                real(found%n_samples, wp), plain/gain, gain, 0.0_wp, &
                                tradeoff%n_cases(case_number))
      end function with_gain

   end subroutine add_samples

end module tradeoff_samples_error
