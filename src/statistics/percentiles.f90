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
      real(wp), intent(in) :: values(:), weight(:)   !! (point), the weights' sum is 1
      real(wp), intent(in) :: p, half_width
      real(wp), intent(out) :: quantile
      integer, allocatable, intent(out) :: near(:)
      real(wp) :: at, before, below, reach, under
      integer, allocatable :: inner(:), places(:)
      integer :: first, k, last

      reach = half_width + largest(weight)   ! so that a point on either side of p is there
      call narrow(values, weight, 1.0_wp, p - reach, p + reach, places, under)
      call narrow(values(places), weight(places), sum(weight(places)), p - reach - under, &
                  p + reach - under, inner, below)
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
      real(wp), intent(in) :: values(:), weight(:)
      real(wp), intent(in) :: total       !! of the weights
      real(wp), intent(in) :: low, high
      integer, allocatable, intent(out) :: places(:)
      real(wp), intent(out) :: below
      integer, parameter :: looked_at = 64, reach = 2   ! values, ranks
      real(wp) :: from, some(looked_at), to
      integer :: first, i, last

      below = 0.0_wp
      from = -huge(from)
      to = huge(to)
      if (size(values) >= 2*looked_at) then
         some = values([(1 + ((i - 1)*size(values))/looked_at, i=1, looked_at)])
         some = some(sort_order(some))
         first = floor(low/total*looked_at) - reach
         do while (first >= 1)
            below = weight_below(values, weight, some(first))
            if (below <= low) exit
            first = first - reach
         end do
         if (first >= 1) from = some(first)
         if (first < 1) below = 0.0_wp
         last = ceiling(high/total*looked_at) + reach
         do while (last <= looked_at)
            if (weight_below(values, weight, some(last)) >= high) exit
            last = last + reach
         end do
         if (last <= looked_at) to = some(last)
      end if
      places = between(values, from, to)
   end subroutine narrow

   !> The places of the values above one threshold and not above the other.
   pure function between(values, from, to) result(places)
      real(wp), intent(in) :: values(:), from, to
      integer, allocatable :: places(:)
      integer :: found(size(values)), m, n

      n = 0
      do m = 1, size(values)   ! without branches: a tenth is there, and none can tell where
         found(n + 1) = m
         n = n + merge(1, 0, values(m) > from .and. values(m) <= to)
      end do
      places = found(:n)
   end function between

   pure real(wp) function largest(values)
      real(wp), intent(in) :: values(:)
      integer :: m

      largest = -huge(largest)
      !$omp simd reduction(max:largest)
      do m = 1, size(values)
         largest = max(largest, values(m))
      end do
   end function largest

   pure real(wp) function weight_below(values, weight, threshold)
      real(wp), intent(in) :: values(:), weight(:), threshold
      integer :: m

      weight_below = 0.0_wp
      !$omp simd reduction(+:weight_below)
      do m = 1, size(values)
         weight_below = weight_below + merge(weight(m), 0.0_wp, values(m) <= threshold)
      end do
   end function weight_below

end module statistics_percentiles
