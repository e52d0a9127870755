!> Products of a matrix with eight columns side by side.
!>
!> The sums of four rows and eight columns stay in registers; x is read once for the four rows. A
!> matrix is packed by four rows and padded with rows of zeros. Columns with zero factors can be
!> left out; y keeps its bits.
module numerics_dense_product
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: packed_matrix, pack_matrix, padded_rows, product_width

   integer, parameter :: product_width = 8, rows_together = 4

   !> A matrix by fours of rows.
   type :: packed_matrix
      integer :: n_fours = 0
      real(wp), allocatable :: value(:, :, :)   !! (row of the four, column, four)
      integer, allocatable :: all_columns(:)    !! 1, 2, ...
   contains
      procedure :: multiply
      procedure :: multiply_some
   end type packed_matrix

contains

   !> n, rounded up to a multiple of four.
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
      packed%all_columns = [(j, j=1, size(a, 2))]
      allocate (packed%value(rows_together, size(a, 2), packed%n_fours), source=0.0_wp)
      do q = 1, packed%n_fours
         do r = 1, min(rows_together, size(a, 1) - rows_together*(q - 1))
            packed%value(r, :, q) = a(rows_together*(q - 1) + r, :)
         end do
      end do
   end subroutine pack_matrix

   !> Finds y = A x. Padded rows of y become zero.
   pure subroutine multiply(self, x, y)
      class(packed_matrix), intent(in) :: self
      real(wp), intent(in) :: x(product_width, *)      !! (8, column)
      real(wp), intent(inout) :: y(product_width, *)   !! (8, padded row)

      call self%multiply_some(self%all_columns, 1, .false., x, 1, y)
   end subroutine multiply

   !> Finds A x, or adds it to y, with some columns of each layer (as many columns of A one after
   !> another), in the first of every `stride` columns of y. Goes over the fours of rows.
   pure subroutine multiply_some(self, columns, n_layers, is_added, x, stride, y)
      class(packed_matrix), intent(in) :: self
      integer, intent(in), contiguous :: columns(:)    !! of the first layer
      integer, intent(in) :: n_layers, stride
      logical, intent(in) :: is_added
      real(wp), intent(in) :: x(product_width, *)      !! (8, column)
      real(wp), intent(inout) :: y(product_width, stride, *)
      integer :: all_columns(n_layers*size(columns)), k, n

      n = size(columns)
      if (n == 0) then
         if (.not. is_added) y(:, 1, :rows_together*self%n_fours) = 0.0_wp
         return
      end if
      do k = 0, n_layers - 1
         all_columns(k*n + 1:(k + 1)*n) = columns + k*(size(self%value, 2)/n_layers)
      end do
      call multiply_fours(self%n_fours, size(self%value, 2), self%value, all_columns, is_added, x, &
                          stride, y)
   end subroutine multiply_some

   pure subroutine multiply_fours(n_fours, n_columns, a, columns, is_added, x, stride, y)
      integer, intent(in) :: n_fours, n_columns
      real(wp), intent(in) :: a(rows_together, n_columns, n_fours)
      integer, intent(in), contiguous :: columns(:)   !! not none
      integer, intent(in) :: stride
      logical, intent(in) :: is_added
      real(wp), intent(in) :: x(product_width, *)
      real(wp), intent(inout) :: y(product_width, stride, rows_together, *)
      real(wp) :: total(product_width, rows_together)
      integer :: c, l, q, r

      do q = 1, n_fours
         do r = 1, rows_together
            total(:, r) = a(r, columns(1), q)*x(:, columns(1))
         end do
         do c = 2, size(columns)
            do r = 1, rows_together
               do l = 1, product_width
                  total(l, r) = total(l, r) + a(r, columns(c), q)*x(l, columns(c))
               end do
            end do
         end do
         if (is_added) then
            y(:, 1, :, q) = y(:, 1, :, q) + total
         else
            y(:, 1, :, q) = total
         end if
      end do
   end subroutine multiply_fours

end module numerics_dense_product
