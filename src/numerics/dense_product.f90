!> Products of a matrix with 32 columns side by side.
!>
!> The sums of two rows fill eight arrays of four columns, which stay in registers; x is read once
!> for both rows. A matrix is packed by pairs of rows and padded with a row of zeros.
module numerics_dense_product
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: packed_matrix, pack_matrix, padded_rows, product_width

   integer, parameter :: lanes = 4, vectors = 4, groups = 2, rows_together = 2
   integer, parameter :: product_width = lanes*vectors*groups

   !> A matrix by pairs of rows.
   type :: packed_matrix
      integer :: n_pairs = 0, n_columns = 0
      real(wp), allocatable :: value(:, :, :)   !! (row of the pair, column, pair)
   contains
      procedure :: multiply
      procedure :: multiply_add
   end type packed_matrix

contains

   !> n, padded to whole pairs.
   elemental integer function padded_rows(n)
      integer, intent(in) :: n

      padded_rows = rows_together*((n + rows_together - 1)/rows_together)
   end function padded_rows

   !> A matrix made ready for products.
   pure function pack_matrix(a) result(packed)
      real(wp), intent(in) :: a(:, :)   !! (row, column)
      type(packed_matrix) :: packed
      integer :: q, r

      packed%n_columns = size(a, 2)
      packed%n_pairs = padded_rows(size(a, 1))/rows_together
      allocate (packed%value(rows_together, packed%n_columns, packed%n_pairs), source=0.0_wp)
      do q = 1, packed%n_pairs
         do r = 1, min(rows_together, size(a, 1) - rows_together*(q - 1))
            packed%value(r, :, q) = a(rows_together*(q - 1) + r, :)
         end do
      end do
   end function pack_matrix

   !> y = A x. Padded rows of y become zero.
   pure subroutine multiply(self, x, y)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (32, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (32, padded row)

      call add_rows(self%n_pairs, self%n_columns, is_added=.false., a=self%value, x=x, y=y)
   end subroutine multiply

   !> y = y + A x.
   pure subroutine multiply_add(self, x, y)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (32, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (32, padded row)

      call add_rows(self%n_pairs, self%n_columns, is_added=.true., a=self%value, x=x, y=y)
   end subroutine multiply_add

   !> y = A x, or y + A x.
   pure subroutine add_rows(n_pairs, n_columns, is_added, a, x, y)
      integer, intent(in) :: n_pairs, n_columns
      logical, intent(in) :: is_added
      real(wp), intent(in) :: a(rows_together, n_columns, n_pairs)
      real(wp), intent(in) :: x(lanes, vectors, groups, n_columns)
      real(wp), intent(inout) :: y(lanes, vectors, groups, rows_together, n_pairs)
      real(wp), dimension(lanes) :: a1, a2, a3, a4, b1, b2, b3, b4
      real(wp) :: x1, x2, x3, x4
      integer :: g, j, l, q

      do q = 1, n_pairs
         do g = 1, groups
            a1 = 0.0_wp
            a2 = 0.0_wp
            a3 = 0.0_wp
            a4 = 0.0_wp
            b1 = 0.0_wp
            b2 = 0.0_wp
            b3 = 0.0_wp
            b4 = 0.0_wp
            if (is_added) then
               !$omp simd
               do l = 1, lanes
                  a1(l) = y(l, 1, g, 1, q)
                  a2(l) = y(l, 2, g, 1, q)
                  a3(l) = y(l, 3, g, 1, q)
                  a4(l) = y(l, 4, g, 1, q)
                  b1(l) = y(l, 1, g, 2, q)
                  b2(l) = y(l, 2, g, 2, q)
                  b3(l) = y(l, 3, g, 2, q)
                  b4(l) = y(l, 4, g, 2, q)
               end do
            end if
            do j = 1, n_columns
               !$omp simd
               do l = 1, lanes
                  x1 = x(l, 1, g, j)
                  x2 = x(l, 2, g, j)
                  x3 = x(l, 3, g, j)
                  x4 = x(l, 4, g, j)
                  a1(l) = a1(l) + a(1, j, q)*x1
                  a2(l) = a2(l) + a(1, j, q)*x2
                  a3(l) = a3(l) + a(1, j, q)*x3
                  a4(l) = a4(l) + a(1, j, q)*x4
                  b1(l) = b1(l) + a(2, j, q)*x1
                  b2(l) = b2(l) + a(2, j, q)*x2
                  b3(l) = b3(l) + a(2, j, q)*x3
                  b4(l) = b4(l) + a(2, j, q)*x4
               end do
            end do
            !$omp simd
            do l = 1, lanes
               y(l, 1, g, 1, q) = a1(l)
               y(l, 2, g, 1, q) = a2(l)
               y(l, 3, g, 1, q) = a3(l)
               y(l, 4, g, 1, q) = a4(l)
               y(l, 1, g, 2, q) = b1(l)
               y(l, 2, g, 2, q) = b2(l)
               y(l, 3, g, 2, q) = b3(l)
               y(l, 4, g, 2, q) = b4(l)
            end do
         end do
      end do
   end subroutine add_rows

end module numerics_dense_product
