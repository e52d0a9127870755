!> Fourier coefficients of the reciprocal of a banded symbol g(t) = g_0 + 2 sum g_m cos(mt), m =
!> 1..m_max.
!>
!> In an infinite domain the inverse of the banded Toeplitz matrix with these entries is the
!> Toeplitz matrix of these coefficients. They come from the spectral factor B of g, |B|^2 = g, as
!> do the derivatives of the mean of ln g, which is 2 ln B_0: no sampling, however near the circle
!> zeros of g lie.
module process_direct_reciprocal_symbol
   use core_kinds, only: two_pi, wp
   use process_autoregressive_spectral_factor, only: change_of_factor, equivalent_process, &
                                                     reciprocal_of_process
   implicit none(type, external)
   private
   public :: evaluate_symbol, symbol_evaluation, touching_multiplier

   !> Values at a symbol g. Derivatives of the mean of ln g are taken along other symbols, their
   !! directions.
   type :: symbol_evaluation
      logical :: is_positive = .false.             !! g > 0; all else holds only then
      real(wp) :: log_mean = 0.0_wp                !! mean of ln g over the circle
      real(wp), allocatable :: reciprocal(:)       !! of 1/g, lags 0..m_max
      real(wp), allocatable :: gradient(:)         !! (0:) of the mean of ln g
      real(wp), allocatable :: curvature(:, :)     !! minus its second derivatives
      real(wp), allocatable, private :: a(:)       !! B = [1, a]/b0: the next one is begun with it
      real(wp), private :: b0 = 0.0_wp
   end type symbol_evaluation

contains

   !> Evaluates g and its derivatives along symbols.
   pure subroutine evaluate_symbol(symbol, directions, evaluation)
      real(wp), intent(in) :: symbol(0:)           !! g_m, m = 0..m_max
      real(wp), intent(in) :: directions(0:, 0:)   !! A_m, m = 0..m_max, of each
      type(symbol_evaluation), intent(inout) :: evaluation   !! of a symbol near this one, or new
      real(wp) :: reciprocal(0:2*ubound(symbol, 1))
      integer :: last, m_max

      m_max = ubound(symbol, 1)
      last = ubound(directions, 2)
      call equivalent_process(symbol, evaluation%a, evaluation%b0, evaluation%is_positive)
      if (evaluation%is_positive) &
         call reciprocal_of_process(evaluation%a, evaluation%b0, reciprocal, evaluation%is_positive)
      if (.not. evaluation%is_positive) then
         if (allocated(evaluation%a)) deallocate (evaluation%a)
         return
      end if
      if (.not. allocated(evaluation%reciprocal)) &
         allocate (evaluation%reciprocal(0:m_max), evaluation%gradient(0:last), &
                   evaluation%curvature(0:last, 0:last))
      evaluation%reciprocal(:) = reciprocal(:m_max)
      evaluation%log_mean = -2.0_wp*log(evaluation%b0)
      call differentiate([1.0_wp, evaluation%a]/evaluation%b0, reciprocal, directions, evaluation)
   end subroutine evaluate_symbol

   !> Computes gradient and curvature from the changes of B along each direction: as exact as B.
   pure subroutine differentiate(factor, reciprocal, directions, evaluation)
      real(wp), intent(in) :: factor(0:)       !! B
      real(wp), intent(in) :: reciprocal(0:)   !! to twice the order
      real(wp), intent(in) :: directions(0:, 0:)
      type(symbol_evaluation), intent(inout) :: evaluation
      real(wp) :: change(0:ubound(factor, 1), 0:ubound(directions, 2)), image(0:ubound(factor, 1))
      integer :: i, j

      do j = 0, ubound(directions, 2)
         associate (symbol => directions(:, j))
            change(:, j) = change_of_factor(factor, reciprocal, symbol)
            evaluation%gradient(j) = symbol(1)*reciprocal(0) + &   ! mean of symbol/g
               2.0_wp*dot_product(symbol(2:), reciprocal(1:size(symbol) - 1))
         end associate
      end do
      do j = 0, ubound(directions, 2)
         image = toeplitz_product(reciprocal, change(:, j))
         do i = 0, ubound(directions, 2)
            evaluation%curvature(i, j) = 2.0_wp*dot_product(change(:, i), image) &
                                         + 0.5_wp*evaluation%gradient(i)*evaluation%gradient(j)
         end do
      end do
   end subroutine differentiate

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

   !> delta at which 1 + delta A(t) first touches zero; huge when A is nowhere negative.
   pure function touching_multiplier(along) result(delta)
      real(wp), intent(in) :: along(0:)   !! symbol of A
      real(wp) :: delta
      real(wp) :: bend, lowest, t
      integer :: j, m, n, step

      n = max(64, 8*ubound(along, 1))   ! points on the circle, of which the lowest is refined
      t = two_pi/n*(minloc([(rough_value(along, two_pi*j/n), j=0, n/2)], dim=1) - 1)
      lowest = huge(1.0_wp)
      do step = 1, 5
         lowest = min(lowest, along(0) + 2.0_wp*sum([(along(m)*cos(m*t), m=1, ubound(along, 1))]))
         bend = sum([(m**2*along(m)*cos(m*t), m=1, ubound(along, 1))])
         if (.not. abs(bend) > 0.0_wp) exit
         t = t - sum([(m*along(m)*sin(m*t), m=1, ubound(along, 1))])/bend
      end do
      delta = huge(1.0_wp)
      if (lowest < -1.0e-13_wp*sum(abs(along))) delta = -1.0_wp/lowest
   end function touching_multiplier

   !> A(t) = A_0 + 2 sum A_m cos(mt), by Clenshaw's recurrence: fast, with the rounding of its sums.
   pure real(wp) function rough_value(along, t) result(value)
      real(wp), intent(in) :: along(0:), t
      real(wp) :: b(0:2)
      integer :: m

      b = 0.0_wp
      do m = ubound(along, 1), 1, -1
         b(1:2) = b(0:1)
         b(0) = 2.0_wp*(along(m) + cos(t)*b(1)) - b(2)
      end do
      value = along(0) + cos(t)*b(0) - b(1)
   end function rough_value

end module process_direct_reciprocal_symbol
