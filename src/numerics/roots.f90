!> Roots of polynomials, and of an increasing function that the caller evaluates at given points.
module numerics_roots
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: find_eigenvalues
   use numerics_sorting, only: sort_order
   implicit none(type, external)
   private
   public :: find_polynomial_roots, root_search

   !> Search for the root of an increasing function: steps that double until the root is bracketed,
   !> then regula falsi of Anderson and Bjorck.
   type :: root_search
      real(wp) :: step = 1.0_wp                              !! next step, until it is bracketed
      real(wp) :: low = -huge(1.0_wp), high = huge(1.0_wp)   !! bracket of the root
      real(wp), private :: low_value = -huge(1.0_wp), high_value = huge(1.0_wp)
      integer, private :: side = 0                           !! sign of the last value
   contains
      procedure :: advance
   end type root_search

contains

   !> Finds all roots of x**n + sum c_q x**(n-q), in order of descending modulus, conjugate pairs
   !> together: eigenvalues of the companion matrix, refined by Newton's method.
   subroutine find_polynomial_roots(coefficients, roots, error)
      real(wp), intent(in) :: coefficients(:)             !! c_q, q = 1..n
      complex(wp), allocatable, intent(out) :: roots(:)   !! (n)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: companion(:, :)
      integer :: i, n

      n = size(coefficients)
      if (n == 0) then
         allocate (roots(0))
         return
      end if
      allocate (companion(n, n), source=0.0_wp)
      companion(1, :) = -coefficients
      do i = 2, n
         companion(i, i - 1) = 1.0_wp
      end do
      call find_eigenvalues(companion, roots, error)
      if (allocated(error)) return
      call polish(coefficients, roots)
      roots = roots(sort_order(-abs(roots)))   ! the order of equal moduli, as of pairs, stays
   end subroutine find_polynomial_roots

   !> Refines roots by Newton steps while these lower |p|. The second root of a pair is set to the
   !> conjugate of the first.
   pure subroutine polish(coefficients, roots)
      real(wp), intent(in) :: coefficients(:)
      complex(wp), intent(inout) :: roots(:)
      integer, parameter :: max_steps = 4   ! eigenvalues lack only a few digits
      complex(wp) :: slope, trial, trial_slope, trial_value, value
      integer :: i, step

      do i = 1, size(roots)
         if (roots(i)%im < 0.0_wp) cycle
         call evaluate(coefficients, roots(i), value, slope)
         do step = 1, max_steps
            if (.not. abs(slope) > 0.0_wp) exit
            trial = roots(i) - value/slope
            call evaluate(coefficients, trial, trial_value, trial_slope)
            if (.not. abs(trial_value) < abs(value)) exit
            roots(i) = trial
            value = trial_value
            slope = trial_slope
         end do
         if (i < size(roots) .and. roots(i)%im > 0.0_wp) roots(i + 1) = conjg(roots(i))
      end do
   end subroutine polish

   !> Evaluates a polynomial and its derivative by Horner's rule.
   pure subroutine evaluate(coefficients, x, value, slope)
      real(wp), intent(in) :: coefficients(:)
      complex(wp), intent(in) :: x
      complex(wp), intent(out) :: value, slope
      integer :: q

      value = (1.0_wp, 0.0_wp)
      slope = (0.0_wp, 0.0_wp)
      do q = 1, size(coefficients)
         slope = slope*x + value
         value = value*x + coefficients(q)
      end do
   end subroutine evaluate

   !> Narrows the bracket by the function's value at x and moves x to the next point.
   pure subroutine advance(self, x, value)
      class(root_search), intent(inout) :: self
      real(wp), intent(inout) :: x
      real(wp), intent(in) :: value
      integer :: side

      side = merge(1, -1, value > 0.0_wp)
      if (side == 1) then   ! if the other end stays a second time, its value is reduced
         if (self%side == side) self%low_value = self%low_value*reduction(value, self%high_value)
         self%high = x
         self%high_value = value
      else
         if (self%side == side) self%high_value = self%high_value*reduction(value, self%low_value)
         self%low = x
         self%low_value = value
      end if
      if (self%low > -huge(1.0_wp) .and. self%high < huge(1.0_wp)) then
         self%side = side
         x = (self%low*self%high_value - self%high*self%low_value) &
             /(self%high_value - self%low_value)
         x = max(self%low, min(self%high, x))
      else
         x = x - side*self%step
         self%step = 2.0_wp*self%step
      end if
   end subroutine advance

   !> Factor by which Anderson and Bjorck reduce the value at the end that stays.
   elemental function reduction(value, before) result(factor)
      real(wp), intent(in) :: value, before   !! new and old value at the end that moves
      real(wp) :: factor

      factor = 1.0_wp - value/before
      if (.not. factor > 0.0_wp) factor = 0.5_wp
   end function reduction

end module numerics_roots
