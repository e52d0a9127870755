!> Ascending order of numbers.
module numerics_sorting
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: sort_order

contains

   !> Positions of the values in ascending order; equal values stay as they came (merge sort).
   pure function sort_order(values) result(order)
      real(wp), intent(in) :: values(:)   !! no NaN
      integer :: order(size(values))
      integer :: other(size(values))
      integer :: n, run, first, middle, last

      n = size(values)
      order = [(first, first=1, n)]
      run = 1
      do while (run < n)
         do first = 1, n, 2*run
            middle = min(first + run, n + 1)
            last = min(first + 2*run - 1, n)
            call merge_runs(values, order(first:middle - 1), order(middle:last), other(first:last))
         end do
         order = other
         run = 2*run
      end do
   end function sort_order

   !> Two ascending runs of positions become one.
   pure subroutine merge_runs(values, left, right, merged)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: left(:), right(:)
      integer, intent(out) :: merged(:)
      integer :: i, j, k

      i = 1
      j = 1
      do k = 1, size(merged)
         if (i > size(left)) then
            merged(k:) = right(j:)
            return
         else if (j > size(right)) then
            merged(k:) = left(i:)
            return
         else if (values(right(j)) < values(left(i))) then
            merged(k) = right(j)
            j = j + 1
         else
            merged(k) = left(i)
            i = i + 1
         end if
      end do
   end subroutine merge_runs

end module numerics_sorting
