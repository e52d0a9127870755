!> Kernel of the regression: covariance of the response at two vectors of friction values, up to a
!> factor. Formula (2) of docs/regression.md. Inputs are standardised; the squares of the weights
!> add up to 5.
module statistics_kernel
   use core_kinds, only: wp
   use numerics_elementary, only: exponentiate
   use numerics_lapack, only: multiply
   implicit none(type, external)
   private
   public :: kernel_type, kernel_diagonal, kernel_rows, new_kernel

   real(wp), parameter :: sum_of_squares = 5.0_wp   !! sum of the squares of the weights
   !> factors of the three parts of formula (2)
   real(wp), parameter :: linear_factor = 10.0_wp, additive_factor = 0.5_wp, joint_factor = 0.5_wp
   real(wp), parameter :: third = 1.0_wp/3.0_wp
   real(wp), parameter :: smallest_share = 1.0e-3_wp   !! least q_j that counts, formula (2)

   !> Weights and length of a kernel.
   type :: kernel_type
      real(wp), allocatable :: weight(:)   !! (input)
      real(wp) :: length = 1.0_wp          !! l
   end type kernel_type

contains

   !> Kernel with weights in given proportions.
   pure type(kernel_type) function new_kernel(proportion, length) result(kernel)
      real(wp), intent(in) :: proportion(:)   !! (input)
      real(wp), intent(in) :: length

      kernel%weight = proportion*sqrt(sum_of_squares/sum(proportion**2))
      kernel%length = length
   end function new_kernel

   !> Computes k(x, x') for all pairs of x and x'.
   subroutine kernel_rows(kernel, x, x_prime, rows)
      type(kernel_type), intent(in) :: kernel
      real(wp), intent(in), contiguous :: x(:, :)         !! (point, input)
      real(wp), intent(in), contiguous :: x_prime(:, :)   !! (sample, input)
      real(wp), intent(out), contiguous :: rows(:, :)     !! (point, sample)
      real(wp) :: a(size(x, 1), size(x, 2)), b(size(x, 2), size(x_prime, 1))
      real(wp) :: grown(size(x, 1), size(x, 2)), shrunk(size(x, 1), size(x, 2))
      real(wp) :: grown_prime(size(x_prime, 1), size(x, 2))
      real(wp) :: square(size(x, 1)), s(size(x, 1)), decay(size(x, 1))
      real(wp) :: rate, share, square_prime
      integer :: i, j

      rate = sqrt(5.0_wp)/kernel%length
      do j = 1, size(x, 2)
         a(:, j) = kernel%weight(j)*x(:, j)
         b(j, :) = kernel%weight(j)*x_prime(:, j)
      end do
      square = sum(a**2, 2)
      grown = rate*x
      grown_prime = rate*x_prime
      do j = 1, size(x, 2)
         call exponentiate(grown(:, j))
         call exponentiate(grown_prime(:, j))
      end do
      shrunk = 1.0_wp/grown
      call multiply(a, b, rows)
      do i = 1, size(x_prime, 1)
         square_prime = sum(b(:, i)**2)
         s = sqrt(max(square + square_prime - 2.0_wp*rows(:, i), 0.0_wp))*rate
         decay = -s
         call exponentiate(decay)
         rows(:, i) = linear_factor/sum_of_squares*rows(:, i) &
                      + joint_factor*(1.0_wp + s*(1.0_wp + third*s))*decay
         do j = 1, size(x, 2)
            share = kernel%weight(j)**2/sum_of_squares
            if (share < smallest_share) cycle
            call add_additive_part(additive_factor*share, x(:, j), grown(:, j), shrunk(:, j), &
                                   x_prime(i, j), grown_prime(i, j), rate, rows(:, i))
         end do
      end do
   end subroutine kernel_rows

   !> k(x, x).
   pure function kernel_diagonal(kernel, x) result(diagonal)
      type(kernel_type), intent(in) :: kernel
      real(wp), intent(in) :: x(:, :)   !! (point, input)
      real(wp) :: diagonal(size(x, 1))
      real(wp) :: share(size(x, 2))

      share = kernel%weight**2/sum_of_squares
      diagonal = linear_factor*matmul(x**2, share) + joint_factor &
                 + additive_factor*sum(share, share >= smallest_share)
   end function kernel_diagonal

   !> Adds the additive part of one input to k(., x'). The smaller one of exp(rate x) exp(-rate x')
   !> and its reciprocal is exp(-rate |x - x'|).
   pure subroutine add_additive_part(share, x, grown, shrunk, x_prime, grown_prime, rate, row)
      real(wp), intent(in) :: share
      real(wp), intent(in), contiguous :: x(:)                  !! (point)
      real(wp), intent(in), contiguous :: grown(:), shrunk(:)   !! (point) exp(rate x), exp(-rate x)
      real(wp), intent(in) :: x_prime, grown_prime, rate
      real(wp), intent(inout), contiguous :: row(:)
      real(wp) :: decay, s, shrunk_prime
      integer :: m

      shrunk_prime = 1.0_wp/grown_prime
      do m = 1, size(x)
         decay = merge(grown(m)*shrunk_prime, shrunk(m)*grown_prime, x(m) < x_prime)
         s = rate*abs(x(m) - x_prime)
         row(m) = row(m) + share*(1.0_wp + s*(1.0_wp + third*s))*decay
      end do
   end subroutine add_additive_part

end module statistics_kernel
