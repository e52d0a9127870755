!> Exponential of a matrix, exp(A t), and its moments, integrals of exp(A s) B s^k.
module numerics_exponential
   use core_kinds, only: wp
   use numerics_lapack, only: unit_matrix
   implicit none(type, external)
   private
   public :: exponential_type, find_exponential

   !> exp(A t), and its moments J_k(t) = integral of exp(A s) B s^k over s from 0 to t.
   type :: exponential_type
      real(wp), allocatable :: value(:, :)       !! (n, n)
      real(wp), allocatable :: moment(:, :, :)   !! (n, column of B, k from 0)
   end type exponential_type

contains

   !> Computes exp(A t) and J_k(t) at t = 1/2 and t = 1, by power series at t = 2^-s, where
   !> |A| t <= 1/2 and s >= 1, then by doublings of t.
   pure subroutine find_exponential(a, b, last_moment, half, full)
      real(wp), intent(in) :: a(:, :)      !! (n, n)
      real(wp), intent(in) :: b(:, :)      !! (n, column)
      integer, intent(in) :: last_moment   !! largest k
      type(exponential_type), intent(out) :: half, full
      integer :: doublings, pass
      real(wp) :: t

      doublings = 1
      t = 0.5_wp
      do while (maxval(sum(abs(a), 1))*t > 0.5_wp)
         doublings = doublings + 1
         t = 0.5_wp*t
      end do
      call sum_series(a, b, last_moment, t, full)
      do pass = 1, doublings
         if (pass == doublings) half = full
         call double_time(t, full)
         t = 2.0_wp*t
      end do
   end subroutine find_exponential

   !> Sums exp(A t) = sum_i A^i t^i/i!, J_k(t) = sum_i A^i B t^(i + k + 1)/(i! (i + k + 1)).
   pure subroutine sum_series(a, b, last_moment, t, series)
      real(wp), intent(in) :: a(:, :), b(:, :), t
      integer, intent(in) :: last_moment
      type(exponential_type), intent(out) :: series
      integer, parameter :: last_term = 16   !! 0.5^17/17! = 2e-20
      real(wp) :: power(size(a, 1), size(a, 1)), power_b(size(a, 1), size(b, 2))
      integer :: i, k

      power = unit_matrix(size(a, 1))
      allocate (series%value, source=power)
      allocate (series%moment(size(a, 1), size(b, 2), 0:last_moment), source=0.0_wp)
      do i = 0, last_term
         if (i > 0) power = matmul(power, a)*(t/i)
         if (i > 0) series%value = series%value + power
         power_b = matmul(power, b)
         do k = 0, last_moment
            series%moment(:, :, k) = series%moment(:, :, k) + (t**(k + 1)/(i + k + 1))*power_b
         end do
      end do
   end subroutine sum_series

   !> Doubles t: J_k(2t) = J_k(t) + exp(A t) sum_i binomial(k, i) t^(k - i) J_i(t).
   pure subroutine double_time(t, series)
      real(wp), intent(in) :: t
      type(exponential_type), intent(inout) :: series
      real(wp) :: binomial, shifted(size(series%moment, 1), size(series%moment, 2))
      integer :: i, k

      do k = ubound(series%moment, 3), 0, -1   ! J_i of i <= k are still those at t
         shifted = 0.0_wp
         binomial = 1.0_wp
         do i = k, 0, -1
            shifted = shifted + binomial*t**(k - i)*series%moment(:, :, i)
            binomial = binomial*i/(k - i + 1)
         end do
         series%moment(:, :, k) = series%moment(:, :, k) + matmul(series%value, shifted)
      end do
      series%value = matmul(series%value, series%value)
   end subroutine double_time

end module numerics_exponential
