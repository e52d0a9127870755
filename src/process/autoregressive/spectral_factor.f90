!> Spectral factorization: finds the autoregressive process whose spectrum is the reciprocal of a
!> banded symbol.
!>
!> The symbol g(t) = g_0 + 2 sum g_m cos(mt), m = 1..order, positive for all t, is |B(exp(it))|^2
!> with B(z) = (1 + sum a_q z^-q)/b0 and all zeros of B inside the unit circle. Nothing is sampled,
!> so the zeros may lie nearer to the circle than any FFT could resolve.
module process_autoregressive_spectral_factor
   use core_kinds, only: wp
   use process_autoregressive_model, only: autocovariance_of, innovation_std, reflection_of
   implicit none(type, external)
   private
   public :: equivalent_process, change_of_factor, symbol_of_process, &
             reciprocal_of_process

contains

   !> Computes the autoregressive process, Eq. (39), whose inverse covariance has the given symbol.
   !> Solves |B|^2 = g by Newton's method (Wilson, 1969), which converges from any stable start if
   !> the symbol is positive. If it is not, to double precision, `a` and `b0` are undefined.
   pure subroutine equivalent_process(symbol, a, b0, is_positive)
      real(wp), intent(in) :: symbol(0:)               !! g_m, m = 0..order
      real(wp), allocatable, intent(inout) :: a(:)     !! a_q, q = 1..order; a start if allocated
      real(wp), intent(inout) :: b0                    !! on entry b0 of the start
      logical, intent(out) :: is_positive
      integer, parameter :: max_iterations = 80   ! one per halving of the nearest zero's distance
      real(wp), dimension(0:ubound(symbol, 1)) :: defect, factor
      real(wp) :: error, last_error, reciprocal(0:2*ubound(symbol, 1)), rounding
      integer :: iteration
      logical :: is_last

      is_positive = symbol(0) > 0.0_wp
      if (.not. is_positive) return
      if (.not. allocated(a)) then
         a = 0.0_wp*symbol(1:)
         b0 = 1.0_wp/sqrt(symbol(0))
      end if
      rounding = 4*epsilon(1.0_wp)*symbol(0)
      factor = [1.0_wp, a]/b0
      last_error = huge(1.0_wp)
      is_last = .false.
      do iteration = 1, max_iterations
         defect = symbol - autocorrelation(factor)
         error = maxval(abs(defect))
         ! at the end only rounding is left, which varies; one more step refines small coefficients
         is_positive = is_last
         is_last = error <= rounding .or. &
                   error <= 1.0e3_wp*rounding .and. error >= 0.5_wp*last_error
         if (is_positive .or. .not. error < huge(1.0_wp)) exit
         last_error = error
         call reciprocal_of_process(factor(1:)/factor(0), 1.0_wp/factor(0), reciprocal, is_positive)
         if (.not. is_positive) exit
         is_positive = .false.
         factor = factor + change_of_factor(factor, reciprocal, defect)
         if (.not. factor(0) > 0.0_wp) exit
      end do
      if (.not. is_positive) return
      a = factor(1:)/factor(0)
      b0 = 1.0_wp/factor(0)
      is_positive = all(abs(reflection_of(a)) < 1.0_wp)
   end subroutine equivalent_process

   !> First-order change of B, (0:order), by a change of its symbol: B times the causal half of
   !> change/|B|^2.
   pure function change_of_factor(factor, reciprocal, change) result(step)
      real(wp), intent(in) :: factor(0:)       !! B = [1, a]/b0
      real(wp), intent(in) :: reciprocal(0:)   !! coefficients of 1/|B|^2 to lag 2 order
      real(wp), intent(in) :: change(0:)       !! change of the symbol, (0:order)
      real(wp) :: step(0:ubound(factor, 1))
      real(wp) :: both_sides(-ubound(reciprocal, 1):ubound(reciprocal, 1))
      real(wp) :: ratio(0:ubound(factor, 1))   ! causal half of change/|B|^2
      integer :: j, order

      order = ubound(factor, 1)
      both_sides(0:) = reciprocal
      both_sides(:-1) = reciprocal(ubound(reciprocal, 1):1:-1)
      ratio = change(0)*reciprocal(:order)
      do j = 1, order
         if (abs(change(j)) > 0.0_wp) &
            ratio = ratio + change(j)*(both_sides(-j:order - j) + both_sides(j:order + j))
      end do
      ratio(0) = 0.5_wp*ratio(0)
      step = 0.0_wp
      do j = 0, order
         step(j:) = step(j:) + ratio(j)*factor(:order - j)
      end do
   end function change_of_factor

   !> Symbol g_m, m = 0..order, of a process: the reciprocal of its spectrum.
   pure function symbol_of_process(a, b0) result(symbol)
      real(wp), intent(in) :: a(:), b0
      real(wp) :: symbol(0:size(a))

      symbol = autocorrelation([1.0_wp, a])/b0**2
   end function symbol_of_process

   !> Symbol |B|^2: sum_q B_q B_(q+m), m = 0..order.
   pure function autocorrelation(factor) result(symbol)
      real(wp), intent(in) :: factor(0:)
      real(wp) :: symbol(0:ubound(factor, 1))
      integer :: j, order

      order = ubound(factor, 1)
      symbol = 0.0_wp
      do j = 0, order
         symbol(:order - j) = symbol(:order - j) + factor(j)*factor(j:)
      end do
   end function autocorrelation

   !> Computes the Fourier coefficients of 1/g, the autocovariance of the process, to the last lag
   !> of `reciprocal`.
   pure subroutine reciprocal_of_process(a, b0, reciprocal, is_stable)
      real(wp), intent(in) :: a(:), b0
      real(wp), intent(out) :: reciprocal(0:)
      logical, intent(out) :: is_stable   !! false if poles lie outside the circle: no result
      real(wp) :: kappa(size(a))

      kappa = reflection_of(a)
      is_stable = all(abs(kappa) < 1.0_wp)
      if (is_stable) reciprocal = (b0/innovation_std(kappa, 1.0_wp))**2* &
                                  autocovariance_of(kappa, ubound(reciprocal, 1))
   end subroutine reciprocal_of_process

end module process_autoregressive_spectral_factor
