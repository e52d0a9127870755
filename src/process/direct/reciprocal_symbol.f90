!> Fourier coefficients of the reciprocal of a banded symbol g(t) = g_0 + 2 sum g_m cos(mt), m =
!> 1..m_max.
!>
!> In an infinite domain the inverse of the banded Toeplitz matrix with these entries is the
!> Toeplitz matrix of these coefficients. They come from the spectral factor B of g, |B|^2 = g, as
!> do the derivatives of the mean of ln g, which is 2 ln B_0: no sampling, however near the circle
!> zeros of g lie.
module process_direct_reciprocal_symbol
   use core_kinds, only: wp
   use process_autoregressive_spectral_factor, only: change_of_factor, factor_symbol, &
                                                     reciprocal_of_process
   implicit none(type, external)
   private
   public :: evaluate_symbol, symbol_evaluation

   !> Values at a symbol g. Derivatives of the mean of ln g are taken along directions: the
   !! first one is a symbol A, the others are cosines, cos(mt).
   type :: symbol_evaluation
      logical :: is_positive = .false.             !! g > 0; all else holds only then
      real(wp) :: log_mean = 0.0_wp                !! mean of ln g over the circle
      real(wp), allocatable :: reciprocal(:)       !! of 1/g, lags 0..m_max
      real(wp), allocatable :: gradient(:)         !! of the mean of ln g, 0: along A
      real(wp), allocatable :: curvature(:, :)     !! minus its second derivatives
      real(wp), allocatable, private :: a(:)       !! B = [1, a]/b0: the next one is begun with it
      real(wp), private :: b0 = 0.0_wp
   end type symbol_evaluation

contains

   !> Evaluates g and its derivatives along A and along the cosines.
   pure subroutine evaluate_symbol(symbol, along, cosines, evaluation)
      real(wp), intent(in) :: symbol(0:)   !! g_m, m = 0..m_max
      real(wp), intent(in) :: along(0:)    !! A_m, m = 0..m_max
      integer, intent(in) :: cosines(:)    !! their lags, 1..m_max
      type(symbol_evaluation), intent(inout) :: evaluation   !! of a symbol near this one, or new
      real(wp) :: reciprocal(0:2*ubound(symbol, 1))
      integer :: m_max

      m_max = ubound(symbol, 1)
      evaluation%is_positive = symbol(0) > 0.0_wp
      if (.not. evaluation%is_positive) return
      if (.not. allocated(evaluation%a)) then
         evaluation%a = 0.0_wp*symbol(1:)
         evaluation%b0 = 1.0_wp/sqrt(symbol(0))
      end if
      associate (a => evaluation%a, b0 => evaluation%b0)
         call factor_symbol(symbol, a, b0, evaluation%is_positive)
         if (evaluation%is_positive) &
            call reciprocal_of_process(a, b0, reciprocal, evaluation%is_positive)
      end associate
      if (.not. evaluation%is_positive) then
         deallocate (evaluation%a)
         return
      end if
      if (.not. allocated(evaluation%reciprocal)) then
         allocate (evaluation%reciprocal(0:m_max), evaluation%gradient(0:size(cosines)))
         allocate (evaluation%curvature(0:size(cosines), 0:size(cosines)))
      end if
      evaluation%reciprocal(:) = reciprocal(:m_max)
      evaluation%log_mean = -2.0_wp*log(evaluation%b0)
      call differentiate([1.0_wp, evaluation%a]/evaluation%b0, reciprocal, along, cosines, &
                         evaluation)
   end subroutine evaluate_symbol

   !> Computes gradient and curvature from the changes of B along each direction: as exact as B.
   pure subroutine differentiate(factor, reciprocal, along, cosines, evaluation)
      real(wp), intent(in) :: factor(0:)       !! B
      real(wp), intent(in) :: reciprocal(0:)   !! to twice the order
      real(wp), intent(in) :: along(0:)
      integer, intent(in) :: cosines(:)
      type(symbol_evaluation), intent(inout) :: evaluation
      real(wp) :: change(0:ubound(factor, 1), 0:size(cosines))
      real(wp) :: cosine(0:ubound(factor, 1)), image(0:ubound(factor, 1))
      integer :: i, j

      change(:, 0) = change_of_factor(factor, reciprocal, along)
      do j = 1, size(cosines)
         cosine = 0.0_wp
         cosine(cosines(j)) = 0.5_wp
         change(:, j) = change_of_factor(factor, reciprocal, cosine)
      end do
      evaluation%gradient(0) = product_mean(along, reciprocal(:ubound(along, 1)))
      evaluation%gradient(1:) = reciprocal(cosines)
      do j = 0, size(cosines)
         image = toeplitz_product(reciprocal, change(:, j))
         do i = 0, size(cosines)
            evaluation%curvature(i, j) = 2.0_wp*dot_product(change(:, i), image) &
                                         + 0.5_wp*evaluation%gradient(i)*evaluation%gradient(j)
         end do
      end do
   end subroutine differentiate

   !> Mean over the circle of the product of two even functions, one of them a banded symbol.
   pure function product_mean(symbol, coefficients) result(mean)
      real(wp), intent(in) :: symbol(0:), coefficients(0:)
      real(wp) :: mean

      mean = symbol(0)*coefficients(0) + 2.0_wp*dot_product(symbol(1:), coefficients(1:))
   end function product_mean

   !> Symmetric Toeplitz matrix, given by its first row, times a vector.
   pure function toeplitz_product(row, x) result(y)
      real(wp), intent(in) :: row(0:), x(0:)
      real(wp) :: y(0:ubound(x, 1))
      integer :: j, n

      n = ubound(x, 1)
      y = 0.0_wp
      do j = 0, n
         y(j:) = y(j:) + x(j)*row(:n - j)
         y(:j - 1) = y(:j - 1) + x(j)*row(j:1:-1)
      end do
   end function toeplitz_product

end module process_direct_reciprocal_symbol
