!> Percentiles of a law that weighted points stand for.
module statistics_percentiles
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: find_quantile

   real(wp), parameter :: margin = 0.01_wp   !! weight that is sorted beyond the window

contains

   !> The value below which the weight p lies: linear between points, each at the middle of its
   !> weight. `near`: the points within half_width of p, in weight.
   pure subroutine find_quantile(values, weight, p, half_width, quantile, near)
      real(wp), intent(in) :: values(:), weight(:)   !! (point), the weights' sum is 1
      real(wp), intent(in) :: p, half_width
      real(wp), intent(out) :: quantile
      integer, allocatable, intent(out) :: near(:)
      real(wp) :: at, before, below, from, reach, to
      integer, allocatable :: places(:)
      integer :: first, k, last

      reach = half_width + maxval(weight)   ! so that a point on either side of p is there
      call bracket(values, weight, p - reach, p + reach, from, to, below)
      places = pack([(k, k=1, size(values))], values > from .and. values <= to)
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

   !> Thresholds with at most the weight `low` and at least the weight `high` at or below them, by
   !> bisection until they are near; the weight at or below the first one.
   pure subroutine bracket(values, weight, low, high, from, to, below)
      real(wp), intent(in) :: values(:), weight(:), low, high
      real(wp), intent(out) :: from, to, below
      integer, parameter :: most = 40
      real(wp) :: middle, until, weight_there
      integer :: i

      to = maxval(values)
      from = minval(values)
      from = from - max(abs(from), to - from, 1.0_wp)*1.0e-6_wp
      below = 0.0_wp
      until = to
      do i = 1, most
         if (low - below <= margin) exit
         middle = 0.5_wp*(from + until)
         weight_there = weight_below(values, weight, middle)
         if (weight_there <= low) then
            from = middle
            below = weight_there
         else
            until = middle
         end if
      end do
      until = from
      weight_there = 1.0_wp
      do i = 1, most
         if (weight_there - high <= margin) exit
         middle = 0.5_wp*(until + to)
         if (weight_below(values, weight, middle) >= high) then
            to = middle
            weight_there = weight_below(values, weight, middle)
         else
            until = middle
         end if
      end do
   end subroutine bracket

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
