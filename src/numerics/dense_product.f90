!> Products of a matrix with 32 columns side by side.
!>
!> The sums of four rows and eight columns fill eight arrays of four numbers, which stay in
!> registers; x is read once for the four rows. A matrix is packed by four rows and padded with rows
!> of zeros. Columns that are zero in a group of eight can be left out: no bit of y changes.
module numerics_dense_product
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: packed_matrix, pack_matrix, padded_rows, product_width, groups

   integer, parameter :: lanes = 4, vectors = 2, groups = 4, rows_together = 4
   integer, parameter :: product_width = lanes*vectors*groups   !! 32: four groups of eight

   !> A matrix by fours of rows.
   type :: packed_matrix
      integer :: n_fours = 0
      real(wp), allocatable :: value(:, :, :)   !! (row of the four, column, four)
      integer, allocatable :: all_columns(:, :) !! (entry, group) 1, 2, ...
      integer :: n_all(groups) = 0              !! entries
   contains
      procedure :: multiply
      procedure :: multiply_add
   end type packed_matrix

contains

   !> n, padded to whole fours.
   elemental integer function padded_rows(n)
      integer, intent(in) :: n

      padded_rows = rows_together*((n + rows_together - 1)/rows_together)
   end function padded_rows

   !> Makes a matrix ready for products. (A function's result would leak with gfortran 12.)
   pure subroutine pack_matrix(a, packed)
      real(wp), intent(in) :: a(:, :)   !! (row, column)
      type(packed_matrix), intent(out) :: packed
      integer :: j, q, r

      packed%n_fours = padded_rows(size(a, 1))/rows_together
      packed%all_columns = spread([(j, j=1, size(a, 2))], 2, groups)
      packed%n_all = size(a, 2)
      allocate (packed%value(rows_together, size(a, 2), packed%n_fours), source=0.0_wp)
      do q = 1, packed%n_fours
         do r = 1, min(rows_together, size(a, 1) - rows_together*(q - 1))
            packed%value(r, :, q) = a(rows_together*(q - 1) + r, :)
         end do
      end do
   end subroutine pack_matrix

   !> Finds y = A x. Padded rows of y become zero.
   pure subroutine multiply(self, x, y, columns, n_columns)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (32, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (32, padded row)
      !> columns(:n_columns(group), group) that are not zero there; all if absent
      integer, intent(in), optional, contiguous :: columns(:, :)
      integer, intent(in), optional :: n_columns(groups)

      if (present(columns)) then
         call add_rows(self, columns, n_columns, .false., x, y)
      else
         call add_rows(self, self%all_columns, self%n_all, .false., x, y)
      end if
   end subroutine multiply

   !> Finds y = y + A x.
   pure subroutine multiply_add(self, x, y, columns, n_columns)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (32, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (32, padded row)
      !> columns(:n_columns(group), group) that are not zero there; all if absent
      integer, intent(in), optional, contiguous :: columns(:, :)
      integer, intent(in), optional :: n_columns(groups)

      if (present(columns)) then
         call add_rows(self, columns, n_columns, .true., x, y)
      else
         call add_rows(self, self%all_columns, self%n_all, .true., x, y)
      end if
   end subroutine multiply_add

   !> Finds y = A x, or y + A x, group by group, so that one group of x stays in the cache.
   pure subroutine add_rows(self, columns, n_columns, is_added, x, y)
      type(packed_matrix), intent(in) :: self
      integer, intent(in), contiguous :: columns(:, :)
      integer, intent(in) :: n_columns(groups)
      logical, intent(in) :: is_added
      real(wp), intent(in) :: x(product_width, *)
      real(wp), intent(inout) :: y(product_width, *)
      integer :: g

      do g = 1, groups
         if (n_columns(g) > 0) then
            call add_group(g, self%n_fours, size(self%value, 2), self%value, &
                           columns(:n_columns(g), g), is_added, x, y)
         else if (.not. is_added) then
            y(lanes*vectors*(g - 1) + 1:lanes*vectors*g, :rows_together*self%n_fours) = 0.0_wp
         end if
      end do
   end subroutine add_rows

   pure subroutine add_group(g, n_fours, n_columns, a, columns, is_added, x, y)
      integer, intent(in) :: g, n_fours, n_columns
      real(wp), intent(in) :: a(rows_together, n_columns, n_fours)
      integer, intent(in), contiguous :: columns(:)   !! not none
      logical, intent(in) :: is_added
      real(wp), intent(in) :: x(lanes, vectors, groups, *)
      real(wp), intent(inout) :: y(lanes, vectors, groups, rows_together, *)
      real(wp), dimension(lanes) :: a1, a2, b1, b2, c1, c2, d1, d2
      real(wp) :: x1, x2
      integer :: c, j, l, q

      do q = 1, n_fours
         j = columns(1)
         !$omp simd
         do l = 1, lanes
            x1 = x(l, 1, g, j)
            x2 = x(l, 2, g, j)
            a1(l) = a(1, j, q)*x1
            a2(l) = a(1, j, q)*x2
            b1(l) = a(2, j, q)*x1
            b2(l) = a(2, j, q)*x2
            c1(l) = a(3, j, q)*x1
            c2(l) = a(3, j, q)*x2
            d1(l) = a(4, j, q)*x1
            d2(l) = a(4, j, q)*x2
         end do
         do c = 2, size(columns)
            j = columns(c)
            !$omp simd
            do l = 1, lanes
               x1 = x(l, 1, g, j)
               x2 = x(l, 2, g, j)
               a1(l) = a1(l) + a(1, j, q)*x1
               a2(l) = a2(l) + a(1, j, q)*x2
               b1(l) = b1(l) + a(2, j, q)*x1
               b2(l) = b2(l) + a(2, j, q)*x2
               c1(l) = c1(l) + a(3, j, q)*x1
               c2(l) = c2(l) + a(3, j, q)*x2
               d1(l) = d1(l) + a(4, j, q)*x1
               d2(l) = d2(l) + a(4, j, q)*x2
            end do
         end do
         if (is_added) then
            !$omp simd
            do l = 1, lanes
               y(l, 1, g, 1, q) = y(l, 1, g, 1, q) + a1(l)
               y(l, 2, g, 1, q) = y(l, 2, g, 1, q) + a2(l)
               y(l, 1, g, 2, q) = y(l, 1, g, 2, q) + b1(l)
               y(l, 2, g, 2, q) = y(l, 2, g, 2, q) + b2(l)
               y(l, 1, g, 3, q) = y(l, 1, g, 3, q) + c1(l)
               y(l, 2, g, 3, q) = y(l, 2, g, 3, q) + c2(l)
               y(l, 1, g, 4, q) = y(l, 1, g, 4, q) + d1(l)
               y(l, 2, g, 4, q) = y(l, 2, g, 4, q) + d2(l)
            end do
         else
            !$omp simd
            do l = 1, lanes
               y(l, 1, g, 1, q) = a1(l)
               y(l, 2, g, 1, q) = a2(l)
               y(l, 1, g, 2, q) = b1(l)
               y(l, 2, g, 2, q) = b2(l)
               y(l, 1, g, 3, q) = c1(l)
               y(l, 2, g, 3, q) = c2(l)
               y(l, 1, g, 4, q) = d1(l)
               y(l, 2, g, 4, q) = d2(l)
            end do
         end if
      end do
   end subroutine add_group

end module numerics_dense_product
