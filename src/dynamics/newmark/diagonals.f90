!> Matrices by their diagonals: products with a vector go along them, by whole registers.
module dynamics_newmark_diagonals
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: diagonal_matrix, diagonals_of, put_product

   !> The main diagonal, and the others that have an entry that is not zero.
   type :: diagonal_matrix
      integer :: n_diagonals = 0
      integer, allocatable :: offset(:)      !! (diagonal) column less row
      integer, allocatable :: span(:, :)     !! (2, diagonal) its first and last row that count
      real(wp), allocatable :: value(:, :)   !! (row, diagonal)
   end type diagonal_matrix

contains

   !> Takes a full matrix by its diagonals.
   pure subroutine diagonals_of(full, matrix)
      real(wp), intent(in) :: full(:, :)   !! (row, column)
      type(diagonal_matrix), intent(out) :: matrix
      integer :: d, first, i, last, offset(sum(shape(full)))

      d = 1   ! the main one is the first, be it empty or not
      offset(1) = 0
      do i = 1 - size(full, 1), size(full, 2) - 1
         if (i /= 0 .and. .not. is_empty(i)) then
            d = d + 1
            offset(d) = i
         end if
      end do
      matrix%n_diagonals = d
      matrix%offset = offset(:d)
      allocate (matrix%span(2, d))
      allocate (matrix%value(size(full, 1), d), source=0.0_wp)
      do d = 1, matrix%n_diagonals
         matrix%span(:, d) = [1, 0]
         call find_rows(offset(d), first, last)
         do i = first, last
            matrix%value(i, d) = full(i, i + offset(d))
            if (.not. abs(matrix%value(i, d)) > 0.0_wp) cycle
            if (matrix%span(2, d) == 0) matrix%span(1, d) = i
            matrix%span(2, d) = i
         end do
      end do

   contains

      pure logical function is_empty(offset)
         integer, intent(in) :: offset
         integer :: first, i, last

         call find_rows(offset, first, last)
         is_empty = all([(abs(full(i, i + offset)) <= 0.0_wp, i=first, last)])
      end function is_empty

      !> Finds the first and last row of a diagonal.
      pure subroutine find_rows(offset, first, last)
         integer, intent(in) :: offset
         integer, intent(out) :: first, last

         first = max(1, 1 - offset)
         last = min(size(full, 1), size(full, 2) - offset)
      end subroutine find_rows

   end subroutine diagonals_of

   !> Puts y = A x; rows of y beyond those of A are zero.
   pure subroutine put_product(matrix, x, y)
      type(diagonal_matrix), intent(in) :: matrix
      real(wp), intent(in), contiguous :: x(:)      !! (column)
      real(wp), intent(out), contiguous :: y(:)     !! (row)

      call add_diagonals(size(matrix%value, 1), matrix%n_diagonals, matrix%offset, matrix%span, &
                         matrix%value, x, size(y), y)
   end subroutine put_product

   pure subroutine add_diagonals(n_rows, n_diagonals, offset, span, value, x, n, y)
      integer, intent(in) :: n_rows, n_diagonals, offset(n_diagonals), span(2, n_diagonals), n
      real(wp), intent(in) :: value(n_rows, n_diagonals), x(*)
      real(wp), intent(out) :: y(n)
      integer :: d, i, shift

      do i = 1, span(1, 1) - 1
         y(i) = 0.0_wp
      end do
      do i = span(1, 1), span(2, 1)
         y(i) = value(i, 1)*x(i)
      end do
      do i = span(2, 1) + 1, n
         y(i) = 0.0_wp
      end do
      do d = 2, n_diagonals
         shift = offset(d)
         do i = span(1, d), span(2, d)
            y(i) = y(i) + value(i, d)*x(i + shift)
         end do
      end do
   end subroutine add_diagonals

end module dynamics_newmark_diagonals
