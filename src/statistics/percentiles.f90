!> Order statistics: values at ranks between them, and those at which the interval of a percentile
!> ends. Quantiles of weighted points, without sorting all of them.
module statistics_percentiles
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: at_rank, find_quantile, interval_rank

contains

   !> Value at a rank, linear between order statistics.
   pure real(wp) function at_rank(sorted, rank) result(value)
      real(wp), intent(in) :: sorted(:)   !! ascending, two values or more
      real(wp), intent(in) :: rank        !! 1..size(sorted)
      integer :: below

      below = min(int(rank), size(sorted) - 1)
      value = sorted(below) + (rank - below)*(sorted(below + 1) - sorted(below))
   end function at_rank

   !> Rank of the order statistic at which the 95 % interval of the quantile at probability p ends:
   !> the number of samples below the quantile is binomial. 0 or n + 1 if there are too few samples.
   !> The interval always holds the estimate, at the rank 1 + (n - 1) p.
   pure integer function interval_rank(n, p, is_upper) result(rank)
      integer, intent(in) :: n
      real(wp), intent(in) :: p
      logical, intent(in) :: is_upper
      real(wp) :: cumulated, estimate, probability, logarithm
      integer :: k

      probability = merge(0.975_wp, 0.025_wp, is_upper)
      cumulated = 0.0_wp
      do k = 0, n
         logarithm = log_gamma(n + 1.0_wp) - log_gamma(k + 1.0_wp) - log_gamma(n - k + 1.0_wp) &
                     + k*log(p) + (n - k)*log(1.0_wp - p)
         cumulated = cumulated + exp(logarithm)
         if (cumulated > probability) exit
      end do
      estimate = 1.0_wp + (n - 1)*p
      rank = merge(max(k + 1, ceiling(estimate)), min(k, floor(estimate)), is_upper)
   end function interval_rank

   !> Finds the quantile at probability p: linear between points, each of which stands at the middle
   !> of its weight; and the points whose cumulative weight is within half_width of p.
   pure subroutine find_quantile(values, weight, p, half_width, quantile, near)
      real(wp), intent(in), contiguous :: values(:), weight(:)   !! (point), the weights' sum is 1
      real(wp), intent(in) :: p, half_width
      real(wp), intent(out) :: quantile
      integer, allocatable, intent(out) :: near(:)   !! points, ascending in their values
      real(wp) :: before, below, position, margin, under
      integer, allocatable :: inner(:), places(:)
      real(wp), allocatable :: near_values(:), near_weight(:)
      integer :: first, k, last

      margin = half_width + largest(weight)   ! includes a point on either side of p
      call find_near_values(values, weight, 1.0_wp, p - margin, p + margin, places, under)
      near_values = values(places)
      near_weight = weight(places)
      call find_near_values(near_values, near_weight, sum(near_weight), &
                            p - margin - under, p + margin - under, inner, below)
      below = below + under
      places = places(inner)
      places = places(sort_order(values(places)))
      quantile = values(places(1))
      before = p
      first = 0
      last = 0
      do k = 1, size(places)
         position = below + 0.5_wp*weight(places(k))
         below = below + weight(places(k))
         if (position <= p) quantile = values(places(k))
         if (position > p .and. before <= p .and. k > 1) quantile = values(places(k - 1)) &
               + (values(places(k)) - values(places(k - 1)))*(p - before)/(position - before)
         before = position
         if (position < p - half_width) first = k
         if (position <= p + half_width) last = k
      end do
      first = min(first + 1, size(places))
      near = places(first:max(first, last))
   end subroutine find_quantile

   !> Finds the values at which the cumulative weight lies between `low` and `high`, and some around
   !> them. 64 values, sorted, give thresholds, which are moved apart as far as needed.
   pure subroutine find_near_values(values, weight, total, low, high, places, below)
      real(wp), intent(in), contiguous :: values(:), weight(:)
      real(wp), intent(in) :: total       !! sum of the weights
      real(wp), intent(in) :: low, high
      integer, allocatable, intent(out) :: places(:)   !! places of the values found
      real(wp), intent(out) :: below                   !! weight of all smaller values
      integer, parameter :: n_some = 64, margin = 2     ! values, ranks
      real(wp) :: ends(2), some(n_some), under(2)
      integer :: first, i, last

      below = 0.0_wp
      ends = [-huge(ends), huge(ends)]
      if (size(values) >= 2*n_some) then
         some = values([(1 + ((i - 1)*size(values))/n_some, i=1, n_some)])
         some = some(sort_order(some))
         first = floor(low/total*n_some) - margin
         last = ceiling(high/total*n_some) + margin
         do
            ends(1) = merge(some(max(first, 1)), -huge(ends), first >= 1)
            ends(2) = merge(some(min(last, n_some)), huge(ends), last <= n_some)
            call find_weights_below(values, weight, ends, under)
            if ((first < 1 .or. under(1) <= low) .and. (last > n_some .or. under(2) >= high)) exit
            if (under(1) > low) first = first - margin
            if (under(2) < high) last = last + margin
         end do
         if (first >= 1) below = under(1)
      end if
      places = places_between(values, ends(1), ends(2))
   end subroutine find_near_values

   !> Places of the values above `from` and up to `to`.
   pure function places_between(values, from, to) result(places)
      real(wp), intent(in), contiguous :: values(:)
      real(wp), intent(in) :: from, to
      integer, allocatable :: places(:)
      integer, parameter :: block_length = 64   ! many blocks hold none: neighbours are alike
      integer :: first, found(size(values)), is_between(size(values)), last, m, n

      is_between = merge(1, 0, values > from .and. values <= to)
      n = 0
      do first = 1, size(values), block_length
         last = min(first + block_length - 1, size(values))
         if (sum(is_between(first:last)) == 0) cycle
         do m = first, last   ! without branches, which could not be predicted
            found(n + 1) = m
            n = n + is_between(m)
         end do
      end do
      places = found(:n)
   end function places_between

   pure real(wp) function largest(values)
      real(wp), intent(in), contiguous :: values(:)
      integer :: m

      largest = -huge(largest)
      !$omp simd reduction(max:largest)
      do m = 1, size(values)
         largest = max(largest, values(m))
      end do
   end function largest

   !> Computes the total weight of the values up to either threshold.
   pure subroutine find_weights_below(values, weight, threshold, below)
      real(wp), intent(in), contiguous :: values(:), weight(:)
      real(wp), intent(in) :: threshold(2)
      real(wp), intent(out) :: below(2)
      real(wp) :: first, second, w
      integer :: m

      first = 0.0_wp
      second = 0.0_wp
      !$omp simd reduction(+:first, second) private(w)
      do m = 1, size(values)
         w = weight(m)
         first = first + w*merge(1.0_wp, 0.0_wp, values(m) <= threshold(1))
         second = second + w*merge(1.0_wp, 0.0_wp, values(m) <= threshold(2))
      end do
      below = [first, second]
   end subroutine find_weights_below

end module statistics_percentiles
