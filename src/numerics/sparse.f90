!> Sparse matrices, stored by rows, and their products with a vector.
module numerics_sparse
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: sparse_matrix, sparse_of

   !> Nonzero entries of a matrix, row by row.
   type :: sparse_matrix
      integer :: n_rows = 0
      integer, allocatable :: start(:)     !! (row) its first entry; (n_rows + 1): entries plus 1
      integer, allocatable :: column(:)    !! (entry)
      real(wp), allocatable :: value(:)    !! (entry)
   contains
      procedure :: multiply
      procedure :: row_of_entries
   end type sparse_matrix

contains

   !> Sparse form of a full matrix.
   pure function sparse_of(full) result(sparse)
      real(wp), intent(in) :: full(:, :)   !! (row, column)
      type(sparse_matrix) :: sparse
      integer :: i, j, n

      sparse%n_rows = size(full, 1)
      n = count(abs(full) > 0.0_wp)
      allocate (sparse%start(size(full, 1) + 1), sparse%column(n), sparse%value(n))
      n = 0
      do i = 1, size(full, 1)
         sparse%start(i) = n + 1
         do j = 1, size(full, 2)
            if (.not. abs(full(i, j)) > 0.0_wp) cycle
            n = n + 1
            sparse%column(n) = j
            sparse%value(n) = full(i, j)
         end do
      end do
      sparse%start(size(full, 1) + 1) = n + 1
   end function sparse_of

   !> Finds y = A x.
   pure subroutine multiply(self, x, y)
      class(sparse_matrix), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)      !! (column)
      real(wp), intent(inout), contiguous :: y(:)   !! (row)
      real(wp) :: total
      integer :: i, k

      do i = 1, self%n_rows
         total = 0.0_wp
         do k = self%start(i), self%start(i + 1) - 1
            total = total + self%value(k)*x(self%column(k))
         end do
         y(i) = total
      end do
   end subroutine multiply

   !> Row of each entry.
   pure function row_of_entries(self) result(row)
      class(sparse_matrix), intent(in) :: self
      integer :: row(size(self%value))
      integer :: i

      do i = 1, self%n_rows
         row(self%start(i):self%start(i + 1) - 1) = i
      end do
   end function row_of_entries

end module numerics_sparse
