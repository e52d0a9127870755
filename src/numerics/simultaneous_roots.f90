!> All roots of a polynomial of high degree at once (Ehrlich and Aberth), at a cost of n^2 a sweep.
!>
!> Starts lie on circles whose radii are read off the coefficients (Bini, 1996).
module numerics_simultaneous_roots
   use core_kinds, only: two_pi, wp
   implicit none(type, external)
   private
   public :: find_roots_together

contains

   !> Finds all roots of x**n + sum c_q x**(n-q), conjugates together, upper half first. `is_found`
   !> is false where the sweeps did not converge, or the roots do not come in conjugate pairs.
   pure subroutine find_roots_together(coefficients, roots, is_found)
      real(wp), intent(in) :: coefficients(:)             !! c_q, q = 1..n; c_n not zero
      complex(wp), allocatable, intent(out) :: roots(:)   !! (n)
      logical, intent(out) :: is_found
      integer, parameter :: max_sweeps = 100
      complex(wp) :: z(size(coefficients)), step
      complex(wp), allocatable :: newton(:)
      logical :: is_settled(size(coefficients))
      logical, allocatable :: is_rounding(:)
      integer, allocatable :: active(:)
      integer :: i, sweep

      z = starting_points(coefficients)
      is_settled = .false.
      do sweep = 1, max_sweeps
         active = pack([(i, i=1, size(z))], (.not. is_settled))
         if (size(active) == 0) exit
         call newton_steps(coefficients, z(active), newton, is_rounding)
         do i = 1, size(active)
            step = newton(i)/(1.0_wp - newton(i)*repulsion(z, active(i)))
            is_settled(active(i)) = is_rounding(i) .or. &
               abs(step) <= epsilon(1.0_wp)*abs(z(active(i)))
            if (.not. is_rounding(i)) z(active(i)) = z(active(i)) - step
         end do
      end do
      is_found = all(is_settled)
      if (is_found) call pair_conjugates(z, roots, is_found)
   end subroutine find_roots_together

   !> Sum over the other roots of 1/(z_i - z_j).
   pure function repulsion(z, i) result(total)
      complex(wp), intent(in) :: z(:)
      integer, intent(in) :: i
      complex(wp) :: total
      real(wp) :: re, im, x, y, weight
      integer :: j

      re = 0.0_wp
      im = 0.0_wp
      !$omp simd reduction(+: re, im) private(x, y, weight)
      do j = 1, size(z)
         x = z(i)%re - z(j)%re
         y = z(i)%im - z(j)%im
         weight = 1.0_wp/max(x*x + y*y, tiny(1.0_wp))   ! nothing for j = i
         re = re + x*weight
         im = im - y*weight
      end do
      total = cmplx(re, im, wp)
   end function repulsion

   !> Computes p/p' at several points; outside the unit circle by the reversed polynomial, so that
   !> nothing overflows.
   pure subroutine newton_steps(coefficients, z, step, is_rounding)
      real(wp), intent(in) :: coefficients(:)
      complex(wp), intent(in) :: z(:)
      complex(wp), allocatable, intent(out) :: step(:)    !! (size(z))
      logical, allocatable, intent(out) :: is_rounding(:) !! (size(z)) p is zero to rounding
      real(wp) :: forward(0:size(coefficients)), backward(0:size(coefficients))
      complex(wp), allocatable :: slope(:), value(:)
      integer, allocatable :: inner(:), outer(:)
      integer :: i, n

      n = size(coefficients)
      forward = [1.0_wp, coefficients]
      backward = forward(n:0:-1)
      allocate (step(size(z)), is_rounding(size(z)))
      inner = pack([(i, i=1, size(z))], abs(z) <= 1.0_wp)
      outer = pack([(i, i=1, size(z))], abs(z) > 1.0_wp)
      call evaluate(forward, z(inner), value, slope, is_rounding, inner)
      step(inner) = value/nonzero(slope)
      call evaluate(backward, 1.0_wp/z(outer), value, slope, is_rounding, outer)
      step(outer) = z(outer)*value/nonzero(n*value - slope/z(outer))
   end subroutine newton_steps

   !> Evaluates by Horner's rule at many points together, with a bound of its rounding.
   pure subroutine evaluate(c, z, value, slope, is_rounding, places)
      real(wp), intent(in) :: c(0:)                           !! from the highest power down
      complex(wp), intent(in) :: z(:)
      complex(wp), allocatable, intent(out) :: value(:), slope(:)
      logical, intent(inout) :: is_rounding(:)
      integer, intent(in) :: places(:)                        !! elements of z in `is_rounding`
      real(wp), dimension(size(z)) :: x, y, r, p, q, dp, dq, bound
      real(wp) :: next
      integer :: i, k

      x = z%re
      y = z%im
      r = abs(z)
      p = c(0)
      q = 0.0_wp
      dp = 0.0_wp
      dq = 0.0_wp
      bound = abs(c(0))
      do k = 1, ubound(c, 1)
         !$omp simd private(next)
         do i = 1, size(z)
            next = dp(i)*x(i) - dq(i)*y(i) + p(i)
            dq(i) = dp(i)*y(i) + dq(i)*x(i) + q(i)
            dp(i) = next
            next = p(i)*x(i) - q(i)*y(i) + c(k)
            q(i) = p(i)*y(i) + q(i)*x(i)
            p(i) = next
            bound(i) = bound(i)*r(i) + abs(c(k))
         end do
      end do
      value = cmplx(p, q, wp)
      slope = cmplx(dp, dq, wp)
      is_rounding(places) = abs(value) <= 4*epsilon(1.0_wp)*bound
   end subroutine evaluate

   elemental function nonzero(z) result(safe)
      complex(wp), intent(in) :: z
      complex(wp) :: safe

      safe = z
      if (.not. abs(z) > 0.0_wp) safe = tiny(1.0_wp)
   end function nonzero

   !> Points on circles of the radii at which two terms of the polynomial balance: slopes of the
   !> upper hull of ln |c_q|.
   pure function starting_points(coefficients) result(z)
      real(wp), intent(in) :: coefficients(:)
      complex(wp) :: z(size(coefficients))
      real(wp) :: angle, height(0:size(coefficients)), radius
      integer :: corner(0:size(coefficients)), i, j, k, n, n_corners, n_here

      n = size(coefficients)
      height = log(max(abs([1.0_wp, coefficients]), tiny(1.0_wp)))
      n_corners = 0
      corner(0) = 0
      do i = 1, n
         do while (n_corners > 0)
            j = corner(n_corners)
            k = corner(n_corners - 1)
            if ((height(i) - height(j))*(j - k) < (height(j) - height(k))*(i - j)) exit
            n_corners = n_corners - 1
         end do
         n_corners = n_corners + 1
         corner(n_corners) = i
      end do
      do k = 1, n_corners
         i = corner(k - 1)
         n_here = corner(k) - i
         radius = exp((height(i + n_here) - height(i))/n_here)
         do j = 1, n_here   ! no start on the real axis, none above another
            angle = two_pi*(j/real(n_here, wp) + k/real(n, wp)) + 0.7_wp
            z(i + j) = radius*cmplx(cos(angle), sin(angle), wp)
         end do
      end do
   end function starting_points

   !> Finds real roots and the upper one of each pair with its exact conjugate.
   pure subroutine pair_conjugates(z, roots, is_paired)
      complex(wp), intent(in) :: z(:)
      complex(wp), allocatable, intent(out) :: roots(:)
      logical, intent(out) :: is_paired
      real(wp), parameter :: real_axis = 1.0e-10_wp   ! roots are good to some 1e-13
      complex(wp), allocatable :: upper(:)
      integer :: n

      upper = pack(z, z%im > real_axis*abs(z))
      n = size(upper)
      allocate (roots(size(z)))
      is_paired = count(z%im < -real_axis*abs(z)) == n
      if (.not. is_paired) return
      roots(1:2*n:2) = upper
      roots(2:2*n:2) = conjg(upper)
      roots(2*n + 1:) = cmplx(real(pack(z, abs(z%im) <= real_axis*abs(z)), wp), kind=wp)
   end subroutine pair_conjugates

end module numerics_simultaneous_roots
