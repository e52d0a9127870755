!> Linear systems, eigenproblems and matrix products by LAPACK and BLAS; no other module calls them.
!>
!> The last bits of a BLAS's sums depend on its number of threads, so each procedure first sets the
!> BLAS to one thread, whatever the environment says.
module numerics_lapack
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr, c_long, &
                                          c_null_char, c_null_ptr
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: wp
   use core_system, only: c_dlsym
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: find_eigenvalues, invert_matrix, lapack_version, multiply
   public :: find_symmetric_eigenvectors, solve_banded_factor, solve_linear_system, &
      solve_positive_definite, solve_symmetric_eigenproblem, unit_matrix

   !> Calls that set the number of threads in threaded BLAS libraries.
   character(*), parameter :: thread_setters(*) = [character(28) :: &
      'openblas_set_num_threads', 'MKL_Set_Num_Threads', 'bli_thread_set_num_threads', &
      'flexiblas_set_num_threads']

   logical :: has_setters = .false.                 !! the addresses in `setters` are looked up
   type(c_funptr) :: setters(size(thread_setters))  !! null: the program has not loaded that library

   abstract interface
      !> Sets the number of threads, an int or a long; both are passed in the same register.
      subroutine set_threads(n) bind(c)
         import :: c_long
         integer(c_long), value :: n
      end subroutine set_threads
   end interface

   interface
      subroutine ilaver(major, minor, patch)
         integer, intent(out) :: major, minor, patch
      end subroutine ilaver

      subroutine dsygvd(itype, jobz, uplo, n, a, lda, b, ldb, w, work, lwork, iwork, liwork, info)
         import :: wp
         integer, intent(in) :: itype, n, lda, ldb, lwork, liwork
         character, intent(in) :: jobz, uplo
         real(wp), intent(inout) :: a(lda, *), b(ldb, *), work(*)
         real(wp), intent(out) :: w(*)
         integer, intent(inout) :: iwork(*)
         integer, intent(out) :: info
      end subroutine dsygvd

      subroutine dsyevd(jobz, uplo, n, a, lda, w, work, lwork, iwork, liwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, lwork, liwork
         real(wp), intent(inout) :: a(lda, *), work(*)
         real(wp), intent(out) :: w(*)
         integer, intent(inout) :: iwork(*)
         integer, intent(out) :: info
      end subroutine dsyevd

      subroutine dgemm(transa, transb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc)
         import :: wp
         character, intent(in) :: transa, transb
         integer, intent(in) :: m, n, k, lda, ldb, ldc
         real(wp), intent(in) :: alpha, beta, a(lda, *), b(ldb, *)
         real(wp), intent(inout) :: c(ldc, *)
      end subroutine dgemm

      subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         integer, intent(in) :: n, lda, ldvl, ldvr, lwork
         character, intent(in) :: jobvl, jobvr
         real(wp), intent(inout) :: a(lda, *), work(*)
         real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *)
         integer, intent(out) :: info
      end subroutine dgeev

      subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine dgesv

      subroutine dpbtrf(uplo, n, kd, ab, ldab, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, kd, ldab
         real(wp), intent(inout) :: ab(ldab, *)
         integer, intent(out) :: info
      end subroutine dpbtrf

      subroutine dtbsv(uplo, trans, diag, n, k, a, lda, x, incx)
         import :: wp
         character, intent(in) :: uplo, trans, diag
         integer, intent(in) :: n, k, lda, incx
         real(wp), intent(in) :: a(lda, *)
         real(wp), intent(inout) :: x(*)
      end subroutine dtbsv

      subroutine dposv(uplo, n, nrhs, a, lda, b, ldb, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: info
      end subroutine dposv
   end interface

contains

   !> Version of LAPACK's interface, such as '3.9.0'.
   function lapack_version() result(text)
      character(:), allocatable :: text
      integer :: major, minor, patch

      call ilaver(major, minor, patch)
      text = to_text(major)//'.'//to_text(minor)//'.'//to_text(patch)
   end function lapack_version

   !> Sets the BLAS to one thread. The call is looked up at run time, because it depends on the
   !> library that the system loads.
   subroutine use_one_thread()
      procedure(set_threads), pointer :: set
      integer :: i

      if (.not. has_setters) then
         do i = 1, size(setters)
            setters(i) = c_dlsym(c_null_ptr, trim(thread_setters(i))//c_null_char)
         end do
         has_setters = .true.
      end if
      do i = 1, size(setters)
         if (.not. c_associated(setters(i))) cycle
         call c_f_procpointer(setters(i), set)
         call set(1_c_long)
      end do
   end subroutine use_one_thread

   !> Finds all eigenvalues of A x = lambda B x, A symmetric, B symmetric positive definite, and at
   !> three times the cost the eigenvectors, X' B X = 1. If B is not positive definite, the error is
   !> exit_bad_input.
   subroutine solve_symmetric_eigenproblem(a, b, eigenvalues, error, eigenvectors)
      real(wp), intent(in) :: a(:, :), b(:, :)               !! (n, n)
      real(wp), allocatable, intent(out) :: eigenvalues(:)      !! (n), ascending
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out), optional :: eigenvectors(:, :)  !! (n, pair)
      real(wp), allocatable :: factor(:, :), matrix(:, :), work(:)
      integer, allocatable :: integer_work(:)
      integer :: info, n

      n = size(a, 1)
      allocate (matrix, source=a)   ! not by =, which would read bounds it does not have yet
      allocate (factor, source=b)
      allocate (eigenvalues(n), work(1 + 6*n + 2*n**2), integer_work(3 + 5*n))   ! as LAPACK asks
      call use_one_thread()
      call dsygvd(1, merge('V', 'N', present(eigenvectors)), 'L', n, matrix, n, factor, n, &
                  eigenvalues, work, size(work), integer_work, size(integer_work), info)
      if (info /= 0) call raise(error, merge(exit_bad_input, exit_no_solution, info > n), &
                                'symmetric eigenproblem of order '//to_text(n)// &
                                ': LAPACK dsygvd returned '//to_text(info))
      if (present(eigenvectors)) call move_alloc(matrix, eigenvectors)
   end subroutine solve_symmetric_eigenproblem

   !> Finds all eigenvalues of a symmetric matrix and overwrites it by its unit eigenvectors.
   subroutine find_symmetric_eigenvectors(a, eigenvalues, error)
      real(wp), intent(inout), contiguous :: a(:, :)   !! (n, n); then (n, eigenvalue)
      real(wp), intent(out) :: eigenvalues(:)          !! (n), ascending
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: work(:)
      integer, allocatable :: integer_work(:)
      integer :: info, n

      n = size(a, 1)
      allocate (work(1 + 6*n + 2*n**2), integer_work(3 + 5*n))   ! as LAPACK asks
      call use_one_thread()
      call dsyevd('V', 'L', n, a, n, eigenvalues, work, size(work), integer_work, &
                  size(integer_work), info)
      if (info /= 0) call raise(error, exit_no_solution, 'eigenvectors of a matrix of order '// &
                                to_text(n)//': LAPACK dsyevd returned '//to_text(info))
   end subroutine find_symmetric_eigenvectors

   !> Finds C = A B, or A' B.
   subroutine multiply(a, b, c, transposes_a)
      real(wp), intent(in), contiguous :: a(:, :), b(:, :)
      real(wp), intent(out), contiguous :: c(:, :)
      logical, intent(in), optional :: transposes_a
      character :: form

      form = 'N'
      if (present(transposes_a)) form = merge('T', 'N', transposes_a)
      call use_one_thread()
      call dgemm(form, 'N', size(c, 1), size(c, 2), size(b, 1), 1.0_wp, a, size(a, 1), &
                 b, size(b, 1), 0.0_wp, c, size(c, 1))
   end subroutine multiply

   !> Finds all eigenvalues of a general matrix, in LAPACK's order, and their right eigenvectors. A
   !> conjugate pair has two columns: the real and the imaginary part of the first one's
   !> eigenvector. Raises an error if an element is not finite.
   subroutine find_eigenvalues(a, eigenvalues, error, eigenvectors)
      real(wp), intent(in) :: a(:, :)                          !! (n, n)
      complex(wp), allocatable, intent(out) :: eigenvalues(:)  !! (n)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out), optional :: eigenvectors(:, :)   !! (n, column)
      real(wp), allocatable :: copy(:, :), im(:), re(:), vectors(:, :), work(:)
      real(wp) :: no_left(1, 1)
      integer :: info, n

      n = size(a, 1)
      copy = a
      allocate (re(n), im(n), work(34*n), vectors(n, merge(n, 1, present(eigenvectors))))
      call use_one_thread()
      info = -5   ! LAPACK's code for a bad fifth argument, the matrix
      if (all(abs(a) <= huge(1.0_wp))) &
         call dgeev('N', merge('V', 'N', present(eigenvectors)), n, copy, n, re, im, no_left, 1, &
                    vectors, n, work, size(work), info)
      if (info /= 0) then
         call raise(error, exit_no_solution, 'eigenvalues of a matrix of order '//to_text(n)// &
                    ': LAPACK dgeev returned '//to_text(info))
         return
      end if
      eigenvalues = cmplx(re, im, wp)
      if (present(eigenvectors)) call move_alloc(vectors, eigenvectors)
   end subroutine find_eigenvalues

   !> Solves A x = b, A general.
   subroutine solve_linear_system(a, b, x, error)
      real(wp), intent(in) :: a(:, :)            !! (n, n)
      real(wp), intent(in) :: b(:)               !! (n)
      real(wp), allocatable, intent(out) :: x(:) !! (n)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: column(size(b), 1)

      column(:, 1) = b
      call solve_columns(a, column, error)
      if (.not. allocated(error)) x = column(:, 1)
   end subroutine solve_linear_system

   !> Finds A^-1, A general.
   subroutine invert_matrix(a, inverse, error)
      real(wp), intent(in) :: a(:, :)                        !! (n, n)
      real(wp), allocatable, intent(out) :: inverse(:, :)    !! (n, n)
      type(error_type), allocatable, intent(out) :: error

      allocate (inverse, source=unit_matrix(size(a, 1)))
      call solve_columns(a, inverse, error)
   end subroutine invert_matrix

   !> Solves A X = B, A general; overwrites B by X.
   subroutine solve_columns(a, b, error)
      real(wp), intent(in) :: a(:, :)                 !! (n, n)
      real(wp), intent(inout), contiguous :: b(:, :)  !! (n, right-hand side)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :)
      integer :: info, n, pivots(size(a, 1))

      n = size(a, 1)
      factor = a
      call use_one_thread()
      call dgesv(n, size(b, 2), factor, n, pivots, b, n, info)
      if (info /= 0) call raise(error, exit_no_solution, 'matrix of order '//to_text(n)// &
                                ': it is singular (pivot '//to_text(info)//' is zero)')
   end subroutine solve_columns

   !> Solves A X = B, A symmetric positive definite; overwrites B by X and A by its Cholesky factor.
   subroutine solve_positive_definite(a, b, error)
      real(wp), intent(inout), contiguous :: a(:, :)   !! (n, n)
      real(wp), intent(inout), contiguous :: b(:, :)   !! (n, right-hand side)
      type(error_type), allocatable, intent(out) :: error
      integer :: info, n

      n = size(a, 1)
      call use_one_thread()
      call dposv('L', n, size(b, 2), a, n, b, n, info)
      if (info /= 0) call raise(error, exit_no_solution, 'positive definite system of order '// &
                                to_text(n)//': LAPACK dposv returned '//to_text(info))
   end subroutine solve_positive_definite

   !> Solves L' x = white noise, where L L' is the banded Toeplitz matrix of entries band(abs(i -
   !> j)): the covariance of x is the inverse of that matrix.
   subroutine solve_banded_factor(band, x, error)
      real(wp), intent(in) :: band(0:)
      real(wp), intent(inout), contiguous :: x(:)   !! (n); white noise, then x
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :)         ! (diagonal from the main one down, column)
      integer :: info, n, width

      n = size(x)
      width = ubound(band, 1)
      factor = spread(band, 2, n)
      call use_one_thread()
      call dpbtrf('L', n, width, factor, width + 1, info)
      if (info /= 0) then
         call raise(error, exit_no_solution, 'banded matrix of order '//to_text(n)// &
                    ': LAPACK dpbtrf returned '//to_text(info))
      else
         call dtbsv('L', 'T', 'N', n, width, factor, width + 1, x, 1)
      end if
   end subroutine solve_banded_factor

   !> Unit matrix of n rows.
   pure function unit_matrix(n) result(matrix)
      integer, intent(in) :: n
      real(wp) :: matrix(n, n)
      integer :: i

      matrix = 0.0_wp
      do i = 1, n
         matrix(i, i) = 1.0_wp
      end do
   end function unit_matrix

end module numerics_lapack
