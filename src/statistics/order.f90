!> Order statistics: values at ranks between them, and those at which the interval of a percentile
!> ends.
module statistics_order
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: at_rank, interval_rank

contains

   !> Value at a rank, linear between order statistics.
   pure function at_rank(sorted, rank) result(value)
      real(wp), intent(in) :: sorted(:)   !! ascending, two values or more
      real(wp), intent(in) :: rank        !! 1..size(sorted)
      real(wp) :: value
      integer :: below

      below = min(int(rank), size(sorted) - 1)
      value = sorted(below) + (rank - below)*(sorted(below + 1) - sorted(below))
   end function at_rank

   !> Rank of the order statistic at which the 95 % interval of the quantile at probability p ends:
   !> the number of samples below the quantile is binomial. 0 or n + 1 if there are too few samples.
   pure function interval_rank(n, p, is_upper) result(rank)
      integer, intent(in) :: n
      real(wp), intent(in) :: p
      logical, intent(in) :: is_upper
      integer :: rank
      real(wp) :: cumulated, probability, logarithm
      integer :: k

      probability = merge(0.975_wp, 0.025_wp, is_upper)
      cumulated = 0.0_wp
      do k = 0, n
         logarithm = log_gamma(n + 1.0_wp) - log_gamma(k + 1.0_wp) - log_gamma(n - k + 1.0_wp) &
                     + k*log(p) + (n - k)*log(1.0_wp - p)
         cumulated = cumulated + exp(logarithm)
         if (cumulated > probability) exit
      end do
      rank = merge(k + 1, k, is_upper)
   end function interval_rank

end module statistics_order
