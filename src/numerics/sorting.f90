!> Sorting of numbers.
module numerics_sorting
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: sort_order

   integer, parameter :: short_run = 128   !! length of the runs that are sorted by counting

contains

   !> Indices of the values in ascending order, equal values in their own order (merge sort).
   pure function sort_order(values) result(order)
      real(wp), intent(in) :: values(:)   !! no NaN
      integer :: order(size(values))
      real(wp), allocatable :: key(:, :)
      integer, allocatable :: place(:, :)
      integer :: first, from, last, middle, n, run, to

      n = size(values)
      allocate (key(n, 2), place(n, 2))
      do first = 1, n, short_run
         last = min(first + short_run - 1, n)
         call sort_by_ranks(values(first:last), first, key(first:last, 1), place(first:last, 1))
      end do
      from = 1
      run = short_run
      do while (run < n)
         to = 3 - from
         do first = 1, n, 2*run
            middle = min(first + run, n + 1)
            last = min(first + 2*run - 1, n)
            call merge_runs(middle - first, key(first:last, from), place(first:last, from), &
                            key(first:last, to), place(first:last, to))
         end do
         from = to
         run = 2*run
      end do
      order = place(:, from)
   end function sort_order

   !> Sorts a few values: the place of each is 1 plus the number of values before it. The loops over
   !> i are vector operations, so places are counted in reals.
   pure subroutine sort_by_ranks(values, first, key, place)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: first           !! index of the first value
      real(wp), intent(out) :: key(:)
      integer, intent(out) :: place(:)
      real(wp) :: position(size(values)), value(size(values))
      integer :: i, j

      position = 1.0_wp
      value = values
      do j = 1, size(value)
         !$omp simd
         do i = 1, j - 1
            position(i) = position(i) + merge(1.0_wp, 0.0_wp, value(j) < value(i))
         end do
         !$omp simd
         do i = j + 1, size(value)
            position(i) = position(i) + merge(1.0_wp, 0.0_wp, value(j) <= value(i))
         end do
      end do
      do i = 1, size(value)
         key(int(position(i))) = value(i)
         place(int(position(i))) = first + i - 1
      end do
   end subroutine sort_by_ranks

   !> Merges two ascending runs: the first n_left values and the others. It selects the smaller of
   !> two values without a branch, which a processor could not predict.
   pure subroutine merge_runs(n_left, key, place, merged_key, merged_place)
      integer, intent(in) :: n_left
      real(wp), intent(in), contiguous :: key(:)
      integer, intent(in), contiguous :: place(:)
      real(wp), intent(out), contiguous :: merged_key(:)
      integer, intent(out), contiguous :: merged_place(:)
      integer :: from, left, right, k

      left = 1
      right = n_left + 1
      k = 0
      do while (left <= n_left .and. right <= size(key))
         k = k + 1
         from = merge(right, left, key(right) < key(left))
         merged_key(k) = key(from)
         merged_place(k) = place(from)
         right = right + merge(1, 0, from == right)
         left = k + n_left + 2 - right
      end do
      from = merge(left, right, left <= n_left)
      merged_key(k + 1:) = key(from:from + size(key) - k - 1)
      merged_place(k + 1:) = place(from:from + size(key) - k - 1)
   end subroutine merge_runs

end module numerics_sorting
