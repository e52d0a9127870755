!> Percentiles of a law that weighted points stand for.
module statistics_percentiles
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: find_quantile

contains

   !> Finds the value below which the weight p lies: linear between points, each at the middle of
   !> its weight. `near`: the points within half_width of p, in weight.
   pure subroutine find_quantile(values, weight, p, half_width, quantile, near)
      real(wp), intent(in), contiguous :: values(:), weight(:)   !! (point), the weights' sum is 1
      real(wp), intent(in) :: p, half_width
      real(wp), intent(out) :: quantile
      integer, allocatable, intent(out) :: near(:)
      real(wp) :: at, before, below, reach, under
      integer, allocatable :: inner(:), places(:)
      real(wp), allocatable :: some(:), some_weight(:)
      integer :: first, k, last

      reach = half_width + largest(weight)   ! so that a point on either side of p is there
      call narrow(values, weight, 1.0_wp, p - reach, p + reach, places, under)
      some = values(places)
      some_weight = weight(places)
      call narrow(some, some_weight, sum(some_weight), p - reach - under, p + reach - under, &
                  inner, below)
      below = below + under
      places = places(inner)
      places = places(sort_order(values(places)))
      quantile = values(places(1))
      before = p
      first = 0
      last = 0
      do k = 1, size(places)
         at = below + 0.5_wp*weight(places(k))
         below = below + weight(places(k))
         if (at <= p) quantile = values(places(k))
         if (at > p .and. before <= p .and. k > 1) quantile = values(places(k - 1)) &
               + (values(places(k)) - values(places(k - 1)))*(p - before)/(at - before)
         before = at
         if (at < p - half_width) first = k
         if (at <= p + half_width) last = k
      end do
      first = min(first + 1, size(places))
      near = places(first:max(first, last))
   end subroutine find_quantile

   !> Finds the places of the values whose cumulative weight is between `low` and `high`, and of a
   !> few around them; `below` is the weight under them. Looks where a sorted subset points to.
   pure subroutine narrow(values, weight, total, low, high, places, below)
      real(wp), intent(in), contiguous :: values(:), weight(:)
      real(wp), intent(in) :: total       !! of the weights
      real(wp), intent(in) :: low, high
      integer, allocatable, intent(out) :: places(:)
      real(wp), intent(out) :: below
      integer, parameter :: looked_at = 64, reach = 2   ! values, ranks
      real(wp) :: ends(2), some(looked_at), under(2)
      integer :: first, i, last

      below = 0.0_wp
      ends = [-huge(ends), huge(ends)]
      if (size(values) >= 2*looked_at) then
         some = values([(1 + ((i - 1)*size(values))/looked_at, i=1, looked_at)])
         some = some(sort_order(some))
         first = floor(low/total*looked_at) - reach
         last = ceiling(high/total*looked_at) + reach
         do
            ends(1) = merge(some(max(first, 1)), -huge(ends), first >= 1)
            ends(2) = merge(some(min(last, looked_at)), huge(ends), last <= looked_at)
            call find_weights_below(values, weight, ends, under)
            if ((first < 1 .or. under(1) <= low) .and. (last > looked_at .or. under(2) >= high)) &
               exit
            if (under(1) > low) first = first - reach
            if (under(2) < high) last = last + reach
         end do
         if (first >= 1) below = under(1)
      end if
      places = between(values, ends(1), ends(2))
   end subroutine narrow

   !> The places of the values above one threshold and not above the other.
   pure function between(values, from, to) result(places)
      real(wp), intent(in), contiguous :: values(:)
      real(wp), intent(in) :: from, to
      integer, allocatable :: places(:)
      integer :: found(size(values)), m, n

      n = 0
      do m = 1, size(values)   ! without branches: a tenth is there, and none can tell where
         found(n + 1) = m
         n = n + iand(merge(1, 0, values(m) > from), merge(1, 0, values(m) <= to))
      end do
      places = found(:n)
   end function between

   pure real(wp) function largest(values)
      real(wp), intent(in), contiguous :: values(:)
      integer :: m

      largest = -huge(largest)
      !$omp simd reduction(max:largest)
      do m = 1, size(values)
         largest = max(largest, values(m))
      end do
   end function largest

   !> Computes the weights of the values up to two thresholds.
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
