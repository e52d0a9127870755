!> Gauss-Legendre quadrature.
module numerics_quadrature
   use core_kinds, only: pi, wp
   implicit none(type, external)
   private
   public :: gauss_legendre

contains

   !> Computes n nodes, ascending, and their weights on [low, high]; exact for polynomials of degree
   !> 2n - 1.
   pure subroutine gauss_legendre(low, high, nodes, weights)
      real(wp), intent(in) :: low, high
      real(wp), intent(out) :: nodes(:), weights(:)   !! (n)
      real(wp) :: last, p, previous, slope, swap, x
      integer :: degree, i, n, step

      n = size(nodes)
      do i = 1, n
         x = -cos(pi*(i - 0.25_wp)/(n + 0.5_wp))
         do step = 1, 8   ! Newton's method for P_n(x) = 0
            last = x
            p = x
            previous = 1.0_wp
            do degree = 2, n
               swap = ((2*degree - 1)*x*p - (degree - 1)*previous)/degree
               previous = p
               p = swap
            end do
            slope = n*(x*p - previous)/((x - 1.0_wp)*(x + 1.0_wp))
            x = x - p/slope
            if (.not. abs(x - last) > 0.0_wp) exit
         end do
         nodes(i) = 0.5_wp*(low + high) + 0.5_wp*(high - low)*x
         weights(i) = (high - low)/((1.0_wp - x)*(1.0_wp + x)*slope**2)
      end do
   end subroutine gauss_legendre

end module numerics_quadrature
