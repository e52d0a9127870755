!> Total standard error of mean slip fractions, and the samples and steps that bring it to a target.
!>
!> If all samples have one force record, more samples lower the Monte Carlo error, and only more
!> steps lower the time-average error. If each sample has its own record, more samples lower both.
!>
!> With n samples the error of plain sampling falls as n^(-1/2). That of a regression falls as 1/n
!> while it can use more samples, and not below the error of the points that represent the law; its
!> part due to records of the samples' own falls as n^(-1/2). On the paper's chain stated errors of
!> 32 samples are 3 to 9 times those of 128 (docs/accuracy.md).
module campaign_samples_needed
   use campaign_pooling, only: fewest_samples, fitted_samples
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: error_with, find_need, is_mostly_time_average, needs_more_samples, slip_error, &
             slip_error_of, statistical_error, with_own_records

   real(wp), parameter :: points = 100.0_wp     !! percentage points of a fraction of 1
   real(wp), parameter :: largest = 1.0e15_wp   !! largest number of samples or steps that is stated
   !> Error of the points that represent the law over the scatter of samples, at most (131,072
   !> windows and 4096 points: statistics_law).
   real(wp), parameter, public :: law_share = 1.0_wp/280.0_wp

   !> Standard errors of the mean slip fractions of a case (joint) [points].
   type :: slip_error
      integer :: n_samples = 0
      integer :: n_cases = 0                 !! cases that may share samples, as in sharing_cases
      real(wp), allocatable :: samples(:)    !! Monte Carlo error, own records of samples included
      real(wp), allocatable :: ratio(:)      !! Monte Carlo error of plain sampling over `samples`
      real(wp), allocatable :: record(:)     !! time-average error under one record of all samples
      real(wp), allocatable :: own(:)        !! time-average error of one sample
      logical :: has_own_records = .false.   !! true: each sample has its own force record
   end type slip_error

contains

   !> Standard errors that statistics state; not allocated if the march is too short for them.
   pure type(slip_error) function slip_error_of(statistics, n_cases, has_own_records) result(error)
      type(case_statistics), intent(in) :: statistics   !! statistics of two or more samples
      integer, intent(in) :: n_cases                    !! as in slip_error
      logical, intent(in) :: has_own_records

      error%n_samples = statistics%n_samples
      error%n_cases = n_cases
      error%has_own_records = has_own_records
      if (.not. allocated(statistics%slip_mean_time_error)) return
      associate (slip_mean => statistics%numbers(:statistics%n_joints, 1))
         error%samples = points*slip_mean%error
         error%ratio = max(1.0_wp, slip_mean%ratio)
      end associate
      error%record = points*statistics%slip_mean_time_error
      error%own = error%record
      if (allocated(statistics%slip_std_time_part)) &
         error%own = hypot(error%record, points*statistics%slip_std_time_part)
   end function slip_error_of

   !> Total standard error of slip_mean, the largest over the joints [points]; huge if it is not
   !> known.
   pure real(wp) function statistical_error(error)
      type(slip_error), intent(in) :: error

      statistical_error = huge(1.0_wp)
      if (allocated(error%record)) statistical_error = maxval(hypot(error%samples, error%record))
   end function statistical_error

   !> True if the time-average error under one record is more than half of the variance.
   pure logical function is_mostly_time_average(error)
      type(slip_error), intent(in) :: error   !! known

      is_mostly_time_average = 2*maxval(error%record)**2 > statistical_error(error)**2
   end function is_mostly_time_average

   !> True if the error is above the target and more samples alone can meet it.
   pure logical function needs_more_samples(error, target)
      type(slip_error), intent(in) :: error
      real(wp), intent(in) :: target   !! [points]

      needs_more_samples = allocated(error%record)
      if (needs_more_samples) needs_more_samples = maxval(error%record) < target .and. &
                                                   statistical_error(error) > target
   end function needs_more_samples

   !> Errors of the same case if each sample has its own force record.
   pure type(slip_error) function with_own_records(shared) result(own)
      type(slip_error), intent(in) :: shared   !! errors under one record

      own = shared
      own%has_own_records = .true.
      own%record = 0.0_wp
      associate (record_part => shared%own/sqrt(real(shared%n_samples, wp)))
         own%samples = hypot(shared%samples, record_part)
         own%ratio = hypot(shared%samples*shared%ratio, record_part)/max(own%samples, tiny(1.0_wp))
      end associate
   end function with_own_records

   !> Standard error with n samples instead of n_now.
   elemental real(wp) function error_with(n, n_now, n_fitted, now, ratio, own, n_cases) &
      result(error)
      real(wp), intent(in) :: n, n_now
      real(wp), intent(in) :: n_fitted !! samples of the regression with the error `now`
      real(wp), intent(in) :: now      !! standard error with n_now samples
      real(wp), intent(in) :: ratio    !! standard error of plain sampling over it
      real(wp), intent(in) :: own      !! as in slip_error; 0 under one record of all samples
      integer, intent(in) :: n_cases   !! as in slip_error
      real(wp) :: law, records, shrink   ! variances of now**2: points of the law, own records

      error = ratio*now*sqrt(n_now/n)
      if (n_cases == 0 .or. n < fewest_samples .or. ratio <= 1.0_wp) return
      shrink = n_fitted/fitted_samples(n, n_cases)
      records = min(own**2/n_now, now**2)
      law = min((law_share*ratio*now)**2*n_now, now**2 - records)
      error = min(error, sqrt(law + records*shrink + (now**2 - records - law)*shrink**2))
   end function error_with

   !> Finds the samples and steps that bring the error to the target. Adds steps if the time-average
   !> error under one record is more than half of the allowed variance, until it is half; it falls
   !> as n_steps^(-1/2).
   pure subroutine find_need(error, target, n_steps, samples_needed, steps_needed)
      type(slip_error), intent(in) :: error   !! known
      real(wp), intent(in) :: target          !! [points]
      integer, intent(in) :: n_steps          !! measured steps of the march with these errors
      integer(long), intent(out) :: samples_needed, steps_needed
      real(wp), parameter :: share = 0.5_wp   ! share of the variance for the time-average error
      real(wp) :: allowed(size(error%record)), record(size(error%record))
      integer(long) :: too_few

      record = (error%record/target)**2
      steps_needed = n_steps
      if (maxval(record) > share) &
         steps_needed = ceiling(min(largest, n_steps*maxval(record)/share), long)
      allowed = target*sqrt(1.0_wp - min(record, share))*(1.0_wp + 1.0e-12_wp)
      too_few = 0
      samples_needed = 1
      do while (.not. suffices(samples_needed) .and. samples_needed < largest)
         too_few = samples_needed
         samples_needed = 2*samples_needed
      end do
      do while (samples_needed - too_few > 1)
         associate (middle => too_few + (samples_needed - too_few)/2)
            if (suffices(middle)) then
               samples_needed = middle
            else
               too_few = middle
            end if
         end associate
      end do

   contains

      !> True if n samples bring the Monte Carlo error to what is allowed.
      pure logical function suffices(n)
         integer(long), intent(in) :: n

         suffices = all(error_with(real(n, wp), real(error%n_samples, wp), &
                                   fitted_samples(real(error%n_samples, wp), error%n_cases), &
                                   error%samples, error%ratio, &
                                   merge(error%own, 0.0_wp, error%has_own_records), &
                                   error%n_cases) <= allowed)
      end function suffices

   end subroutine find_need

end module campaign_samples_needed
