!> Fourier coefficients of 1/g for a banded symbol g(t) = g_0 + 2 sum g_m cos(mt), m = 1..m_max, and
!> derivatives of the mean of ln g.
!>
!> In an infinite domain these coefficients are the entries of the inverse of the banded Toeplitz
!> matrix with the entries g_m. They follow from the spectral factor B of g, |B|^2 = g, and so does
!> the mean of ln g, 2 ln B_0. Nothing is sampled, so zeros of g may lie near the circle.
module process_direct_reciprocal_symbol
   use core_kinds, only: two_pi, wp
   use process_autoregressive_spectral_factor, only: change_of_factor, equivalent_process, &
                                                     reciprocal_of_process
   implicit none(type, external)
   private
   public :: evaluate_symbol, symbol_evaluation, touching_multiplier

   !> Values at a symbol g, with the derivatives of the mean of ln g along other symbols, the
   !> directions.
   type :: symbol_evaluation
      logical :: is_positive = .false.             !! g > 0; else the rest is undefined
      real(wp) :: log_mean = 0.0_wp                !! mean of ln g over the circle
      real(wp), allocatable :: reciprocal(:)       !! coefficients of 1/g, lags 0..m_max
      real(wp), allocatable :: gradient(:)         !! (0:) first derivatives
      real(wp), allocatable :: curvature(:, :)     !! (0:, 0:) minus second derivatives
      real(wp), allocatable :: a(:)                !! B = [1, a]/b0, the start for the next g
      real(wp) :: b0 = 0.0_wp
   end type symbol_evaluation

contains

   !> Evaluates 1/g, and the mean of ln g with its derivatives, by the changes of B along the
   !> directions.
   pure subroutine evaluate_symbol(symbol, directions, evaluation)
      real(wp), intent(in) :: symbol(0:)           !! g_m, m = 0..m_max
      real(wp), intent(in) :: directions(0:, 0:)   !! (m, direction) m = 0..m_max
      type(symbol_evaluation), intent(inout) :: evaluation   !! earlier evaluation nearby, or new
      real(wp) :: change(0:ubound(symbol, 1), 0:ubound(directions, 2))
      real(wp) :: reciprocal(0:2*ubound(symbol, 1))   ! coefficients of 1/g
      real(wp) :: toeplitz(0:ubound(symbol, 1), 0:ubound(symbol, 1))   ! matrix of the reciprocal
      integer :: j, last, m_max

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
      do j = 0, m_max
         toeplitz(:, j) = [reciprocal(j:1:-1), reciprocal(:m_max - j)]
      end do
      do j = 0, last
         associate (along => directions(:, j))
            change(:, j) = change_of_factor([1.0_wp, evaluation%a]/evaluation%b0, reciprocal, along)
            evaluation%gradient(j) = along(1)*reciprocal(0) + &   ! mean of along/g
                                     2.0_wp*dot_product(along(2:), reciprocal(1:m_max))
         end associate
      end do
      evaluation%curvature(:, :) = 2.0_wp*matmul(transpose(change), matmul(toeplitz, change))
      do j = 0, last
         evaluation%curvature(:, j) = evaluation%curvature(:, j) &
                                      + 0.5_wp*evaluation%gradient*evaluation%gradient(j)
      end do
   end subroutine evaluate_symbol

   !> Smallest delta at which 1 + delta A(t) is zero somewhere; huge if A is nowhere negative.
   pure real(wp) function touching_multiplier(along) result(delta)
      real(wp), intent(in) :: along(0:)   !! symbol of A
      real(wp), allocatable :: cosine(:)
      real(wp) :: bend, lowest, t
      integer :: j, lag(ubound(along, 1)), m, n, step

      lag = [(m, m=1, size(lag))]
      n = max(64, 8*size(lag))   ! points on the circle; the lowest one is refined
      cosine = [(cos(two_pi*j/n), j=0, n - 1)]
      t = two_pi/n*(minloc([(dot_product(along(1:), cosine(1 + modulo(j*lag, n))), j=0, n/2)], 1) &
                    - 1)
      lowest = huge(1.0_wp)
      do step = 1, 5
         lowest = min(lowest, along(0) + 2.0_wp*sum(along(1:)*cos(lag*t)))
         bend = sum(lag**2*along(1:)*cos(lag*t))
         if (.not. abs(bend) > 0.0_wp) exit
         t = t - sum(lag*along(1:)*sin(lag*t))/bend
      end do
      delta = huge(1.0_wp)
      if (lowest < -1.0e-13_wp*sum(abs(along))) delta = -1.0_wp/lowest
   end function touching_multiplier

end module process_direct_reciprocal_symbol
