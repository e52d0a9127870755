!> Ascending order of numbers.
module numerics_sorting
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: sort_order

   integer, parameter :: first_run = 128   !! values whose ranks are counted

contains

   !> Positions of the values in ascending order; equal values keep their order (merge sort).
   pure function sort_order(values) result(order)
      real(wp), intent(in) :: values(:)   !! no NaN
      integer :: order(size(values))
      real(wp), allocatable :: key(:, :)
      integer, allocatable :: place(:, :)
      integer :: first, from, last, middle, n, run, to

      n = size(values)
      allocate (key(n, 2), place(n, 2))
      do first = 1, n, first_run
         last = min(first + first_run - 1, n)
         call rank_all(values(first:last), first, key(first:last, 1), place(first:last, 1))
      end do
      from = 1
      run = first_run
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

   !> Sorts a few values by counting their ranks, vectorized; `first` is the first one's place.
   pure subroutine rank_all(values, first, key, place)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: first
      real(wp), intent(out) :: key(:)
      integer, intent(out) :: place(:)
      real(wp) :: place_of(size(values)), value(size(values))
      integer :: i, j

      place_of = 1.0_wp
      value = values
      do j = 1, size(value)
         !$omp simd
         do i = 1, j - 1
            place_of(i) = place_of(i) + merge(1.0_wp, 0.0_wp, value(j) < value(i))
         end do
         !$omp simd
         do i = j + 1, size(value)
            place_of(i) = place_of(i) + merge(1.0_wp, 0.0_wp, value(j) <= value(i))
         end do
      end do
      do i = 1, size(value)
         key(int(place_of(i))) = value(i)
         place(int(place_of(i))) = first + i - 1
      end do
   end subroutine rank_all

   !> Merges two ascending runs, of n_left values and of the rest. It does not branch on the smaller
   !> of two values, which is unpredictable.
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
