!> The one door to LAPACK: checked front ends over its double-precision routines.
module numerics_lapack
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: solve_symmetric_eigenproblem

   interface
      subroutine dsygv(itype, jobz, uplo, n, a, lda, b, ldb, w, work, lwork, info)
         import :: wp
         integer, intent(in) :: itype, n, lda, ldb, lwork
         character, intent(in) :: jobz, uplo
         real(wp), intent(inout) :: a(lda, *), b(ldb, *), work(*)
         real(wp), intent(out) :: w(*)
         integer, intent(out) :: info
      end subroutine dsygv
   end interface

contains

   !> All pairs of A x = lambda B x, A symmetric, B symmetric positive definite; X' B X = 1.
   subroutine solve_symmetric_eigenproblem(a, b, eigenvalues, eigenvectors, error)
      real(wp), intent(in) :: a(:, :), b(:, :)               !! (n, n)
      real(wp), allocatable, intent(out) :: eigenvalues(:)      !! (n), ascending
      real(wp), allocatable, intent(out) :: eigenvectors(:, :)  !! (n, pair)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :), work(:)
      integer :: info, n

      n = size(a, 1)
      eigenvectors = a
      factor = b
      allocate (eigenvalues(n), work(34*n))
      call dsygv(1, 'V', 'L', n, eigenvectors, n, factor, n, eigenvalues, work, size(work), info)
      if (info /= 0) call raise(error, exit_no_solution, 'symmetric eigenproblem of order '// &
                                to_text(n)//': LAPACK dsygv returned '//to_text(info))
   end subroutine solve_symmetric_eigenproblem

end module numerics_lapack
