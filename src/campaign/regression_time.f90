!> Processor time of a plan's regressions, counted before anything is run. The counts are those that
!> grow with the samples, the friction values, the frequencies and the cases; what each costs was
!> measured on the paper's chain (25 to 400 samples a case), 20 and 50 masses and a ring of blades.
module campaign_regression_time
   use campaign_plan, only: kept_dofs, plan_type
   use campaign_pooling, only: case_pool, find_points, find_pools
   use campaign_size, only: n_frequencies
   use core_kinds, only: wp
   use statistics_law, only: n_points
   use statistics_surrogate, only: most_landmarks
   implicit none(type, external)
   private
   public :: regression_seconds

   real(wp), parameter :: of_fit = 3.0e6_wp       !! [ns] of a kernel's choice
   real(wp), parameter :: of_pair = 100.0_wp      !! [ns] of a sample and a landmark: features
   real(wp), parameter :: of_kernel = 1.15_wp     !! [ns] of a point, a landmark and an input
   real(wp), parameter :: further_inputs = 5.4_wp !! that the rest of a kernel is worth
   real(wp), parameter :: of_polynomials = 2.0_wp !! [ns] of a point and two inputs
   real(wp), parameter :: of_density = 140.0_wp   !! [ns] of a sample and a frequency
   real(wp), parameter :: of_product = 0.056_wp   !! [ns] of a point, a landmark and a frequency
   real(wp), parameter :: of_mean = 9.0_wp        !! [ns] of a point and a frequency
   real(wp), parameter :: of_percentile = 12.0_wp !! [ns] of a point and a frequency

contains

   !> Time [s of a processor] of all pools' regressions.
   pure real(wp) function regression_seconds(plan, every, share_powerful)
      type(plan_type), intent(in) :: plan
      integer, intent(in) :: every                !! every k-th step enters the spectra
      real(wp), intent(in) :: share_powerful      !! of the frequencies: those that are fitted
      type(case_pool), allocatable :: pools(:)
      integer, allocatable :: joints(:), points(:)
      real(wp) :: at_points, n, n_dofs, n_f, n_landmarks, nanoseconds
      integer :: p

      pools = find_pools(plan)
      call find_points(plan%structure, points, joints)
      n_dofs = 0.0_wp
      if (plan%output%spectrum) n_dofs = size(kept_dofs(plan))
      n_f = n_frequencies(plan, every)
      nanoseconds = 0.0_wp
      do p = 1, size(pools)
         n = sum(pools(p)%n_fitted)
         n_landmarks = min(n, real(most_landmarks, wp))
         at_points = real(n_points, wp)*size(pools(p)%cases)
         nanoseconds = nanoseconds + (plan%structure%n_joints + n_dofs) &
                       *(of_fit + of_pair*n*n_landmarks &
                         + at_points*(of_kernel*n_landmarks*(size(points) + further_inputs) &
                                      + of_polynomials*size(points)**2)) &
                       + n_dofs*n_f*(of_density*n + share_powerful*at_points &
                                     *(of_mean + of_percentile*size(plan%output%percentiles) &
                                       + of_product*n_landmarks))
      end do
      regression_seconds = 1.0e-9_wp*nanoseconds
   end function regression_seconds

end module campaign_regression_time
