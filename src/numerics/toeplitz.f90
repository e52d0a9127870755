!> Symmetric banded Toeplitz matrices: Cholesky factor, solutions, the dense matrix.
module numerics_toeplitz
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: banded_cholesky, factor_banded_toeplitz, dense_toeplitz

   !> Lower factor L of a banded matrix, L L' = G; only the band is stored.
   type :: banded_cholesky
      integer :: n = 0
      integer :: width = 0
      real(wp), allocatable :: rows(:, :)   !! L(i, i - q) at (q, i), q = 0..width
   contains
      procedure :: solve_transposed
   end type banded_cholesky

contains

   !> Factors the n by n matrix with entries `band(abs(i - j))`. The factor's rows tend to the
   !> coefficients of the spectral factor. `is_positive` is false if the matrix is not positive
   !> definite.
   pure subroutine factor_banded_toeplitz(band, n, factor, is_positive)
      real(wp), intent(in) :: band(0:)
      integer, intent(in) :: n
      type(banded_cholesky), intent(out) :: factor
      logical, intent(out) :: is_positive
      real(wp) :: rest
      integer :: first, i, j, width

      width = ubound(band, 1)
      factor%n = n
      factor%width = width
      allocate (factor%rows(0:width, n), source=0.0_wp)
      is_positive = .true.
      associate (rows => factor%rows)
         do i = 1, n
            first = max(1, i - width)
            do j = first, i
               ! columns first..j-1 of rows i and j
               rest = band(i - j) - dot_product(rows(i - first:i - j + 1:-1, i), &
                                                rows(j - first:1:-1, j))
               if (j < i) then
                  rows(i - j, i) = rest/rows(0, j)
               else
                  is_positive = rest > 0.0_wp
                  if (.not. is_positive) return
                  rows(0, i) = sqrt(rest)
               end if
            end do
         end do
      end associate
   end subroutine factor_banded_toeplitz

   !> Finds x of L' x = b. If b is white noise, x has the covariance (L L')^-1.
   pure subroutine solve_transposed(self, x)
      class(banded_cholesky), intent(in) :: self
      real(wp), intent(inout) :: x(:)   !! (n) b, then the solution
      integer :: i, q

      do i = self%n, 1, -1
         x(i) = x(i)/self%rows(0, i)
         do q = 1, min(self%width, i - 1)
            x(i - q) = x(i - q) - self%rows(q, i)*x(i)
         end do
      end do
   end subroutine solve_transposed

   !> The matrix with all its entries.
   pure function dense_toeplitz(band, n) result(matrix)
      real(wp), intent(in) :: band(0:)
      integer, intent(in) :: n
      real(wp) :: matrix(n, n)
      integer :: j, q

      matrix = 0.0_wp
      do j = 1, n
         do q = 0, min(ubound(band, 1), n - j)
            matrix(j + q, j) = band(q)
            matrix(j, j + q) = band(q)
         end do
      end do
   end function dense_toeplitz

end module numerics_toeplitz
