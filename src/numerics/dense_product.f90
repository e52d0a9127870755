!> Products of a matrix with 32 columns side by side.
!>
!> Sums of three rows by four vectors of four columns stay in registers; the columns of x are read
!> once for three rows. A matrix is packed by triples of rows and padded with rows of zeros.
module numerics_dense_product
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: packed_matrix, pack_matrix, padded_rows, product_width

   integer, parameter :: lanes = 4, vectors = 4, groups = 2, rows_together = 3
   integer, parameter :: product_width = lanes*vectors*groups

   !> A matrix by triples of rows.
   type :: packed_matrix
      integer :: n_triples = 0, n_columns = 0
      real(wp), allocatable :: value(:, :, :)   !! (row of the triple, column, triple)
   contains
      procedure :: multiply
      procedure :: multiply_add
   end type packed_matrix

contains

   !> n, padded to whole triples.
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
      packed%n_triples = padded_rows(size(a, 1))/rows_together
      allocate (packed%value(rows_together, packed%n_columns, packed%n_triples), source=0.0_wp)
      do q = 1, packed%n_triples
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

      call add_rows(self%n_triples, self%n_columns, is_added=.false., a=self%value, x=x, y=y)
   end subroutine multiply

   !> y = y + A x.
   pure subroutine multiply_add(self, x, y)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (32, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (32, padded row)

      call add_rows(self%n_triples, self%n_columns, is_added=.true., a=self%value, x=x, y=y)
   end subroutine multiply_add

   !> y = A x, or y + A x, three rows at a time.
   pure subroutine add_rows(n_triples, n_columns, is_added, a, x, y)
      integer, intent(in) :: n_triples, n_columns
      logical, intent(in) :: is_added
      real(wp), intent(in) :: a(rows_together, n_columns, n_triples)
      real(wp), intent(in) :: x(lanes, vectors, groups, n_columns)
      real(wp), intent(inout) :: y(lanes, vectors, groups, rows_together, n_triples)
      real(wp), dimension(lanes) :: a1, a2, a3, a4, b1, b2, b3, b4, c1, c2, c3, c4
      real(wp) :: d1, d2, d3, d4
      integer :: g, j, l, q

      do q = 1, n_triples
         do g = 1, groups
            a1 = 0.0_wp
            a2 = 0.0_wp
            a3 = 0.0_wp
            a4 = 0.0_wp
            b1 = 0.0_wp
            b2 = 0.0_wp
            b3 = 0.0_wp
            b4 = 0.0_wp
            c1 = 0.0_wp
            c2 = 0.0_wp
            c3 = 0.0_wp
            c4 = 0.0_wp
            if (is_added) then
               do l = 1, lanes
                  a1(l) = y(l, 1, g, 1, q)
                  a2(l) = y(l, 2, g, 1, q)
                  a3(l) = y(l, 3, g, 1, q)
                  a4(l) = y(l, 4, g, 1, q)
                  b1(l) = y(l, 1, g, 2, q)
                  b2(l) = y(l, 2, g, 2, q)
                  b3(l) = y(l, 3, g, 2, q)
                  b4(l) = y(l, 4, g, 2, q)
                  c1(l) = y(l, 1, g, 3, q)
                  c2(l) = y(l, 2, g, 3, q)
                  c3(l) = y(l, 3, g, 3, q)
                  c4(l) = y(l, 4, g, 3, q)
               end do
            end if
            do j = 1, n_columns
               do l = 1, lanes
                  d1 = x(l, 1, g, j)
                  d2 = x(l, 2, g, j)
                  d3 = x(l, 3, g, j)
                  d4 = x(l, 4, g, j)
                  a1(l) = a1(l) + a(1, j, q)*d1
                  a2(l) = a2(l) + a(1, j, q)*d2
                  a3(l) = a3(l) + a(1, j, q)*d3
                  a4(l) = a4(l) + a(1, j, q)*d4
                  b1(l) = b1(l) + a(2, j, q)*d1
                  b2(l) = b2(l) + a(2, j, q)*d2
                  b3(l) = b3(l) + a(2, j, q)*d3
                  b4(l) = b4(l) + a(2, j, q)*d4
                  c1(l) = c1(l) + a(3, j, q)*d1
                  c2(l) = c2(l) + a(3, j, q)*d2
                  c3(l) = c3(l) + a(3, j, q)*d3
                  c4(l) = c4(l) + a(3, j, q)*d4
               end do
            end do
            do l = 1, lanes
               y(l, 1, g, 1, q) = a1(l)
               y(l, 2, g, 1, q) = a2(l)
               y(l, 3, g, 1, q) = a3(l)
               y(l, 4, g, 1, q) = a4(l)
               y(l, 1, g, 2, q) = b1(l)
               y(l, 2, g, 2, q) = b2(l)
               y(l, 3, g, 2, q) = b3(l)
               y(l, 4, g, 2, q) = b4(l)
               y(l, 1, g, 3, q) = c1(l)
               y(l, 2, g, 3, q) = c2(l)
               y(l, 3, g, 3, q) = c3(l)
               y(l, 4, g, 3, q) = c4(l)
            end do
         end do
      end do
   end subroutine add_rows

end module numerics_dense_product
