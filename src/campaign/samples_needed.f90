!> The standard error of mean slip fractions as a whole, and what would bring it to a target.
!>
!> With one record of the force for all samples, samples lower the error of the mean that is due to
!> friction, and only a longer march lowers what the record adds. With a record for each sample, the
!> scatter over samples holds both.
module campaign_samples_needed
   use campaign_results, only: case_statistics
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: statistical_error, find_need, needs_more_samples

   real(wp), parameter :: points = 100.0_wp     !! of percent in a fraction
   real(wp), parameter :: largest = 1.0e15_wp   !! number that is told

contains

   !> The largest over the dofs of the standard error of slip_mean [points]; huge when the march is
   !> too short to tell it.
   pure function statistical_error(statistics) result(error)
      type(case_statistics), intent(in) :: statistics   !! of two samples or more
      real(wp) :: error

      error = huge(1.0_wp)
      if (.not. allocated(statistics%slip_mean_time_error)) return
      error = points*maxval(hypot(statistics%slip%mean_error, statistics%slip_mean_time_error))
   end function statistical_error

   !> True if the error is above the target and more samples alone can bring it there.
   pure function needs_more_samples(statistics, target) result(is_so)
      type(case_statistics), intent(in) :: statistics
      real(wp), intent(in) :: target   !! [points]
      logical :: is_so

      is_so = allocated(statistics%slip_mean_time_error)
      if (is_so) is_so = points*maxval(statistics%slip_mean_time_error) < target .and. &
                         statistical_error(statistics) > target
   end function needs_more_samples

   !> Samples and steps that bring the error to the target, as the statistics of some have it. Steps
   !> are added where the record alone takes more than half of the variance allowed, and then so
   !> many that it takes half; errors fall with the root of the number.
   pure subroutine find_need(statistics, target, n_steps, samples_needed, steps_needed)
      type(case_statistics), intent(in) :: statistics   !! that has a statistical error
      real(wp), intent(in) :: target          !! [points]
      integer, intent(in) :: n_steps          !! of the march that the statistics are of
      integer(long), intent(out) :: samples_needed, steps_needed
      real(wp), parameter :: share = 0.5_wp   ! of the variance, that the record may take
      real(wp) :: friction(size(statistics%slip%mean_error)), record(size(friction))

      friction = (points*statistics%slip%mean_error/target)**2
      record = (points*statistics%slip_mean_time_error/target)**2
      steps_needed = n_steps
      if (maxval(record) > share) &
         steps_needed = ceiling(min(largest, n_steps*maxval(record)/share), long)
      samples_needed = ceiling(min(largest, statistics%n_samples &
                                   *maxval(friction/(1.0_wp - min(record, share)))), long)
   end subroutine find_need

end module campaign_samples_needed
