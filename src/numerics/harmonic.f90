!> Fundamental of a nearly periodic motion: least-squares fit of a constant, a drift and five
!> harmonics to the values of a window of about ten periods. A free structure drifts: started from
!> rest, a sine gives it a mean velocity.
!>
!> A window need not hold whole periods. Harmonics above the fifth are not fitted; they change the
!> fundamental by less than 1 % of their own amplitude.
module numerics_harmonic
   use core_error, only: error_type
   use core_kinds, only: two_pi, wp
   use numerics_lapack, only: solve_positive_definite
   implicit none(type, external)
   private
   public :: harmonic_window, new_harmonic_window, periods_of_window

   integer, parameter :: periods_of_window = 10
   integer, parameter :: n_harmonics = 5
   integer, parameter :: n_terms = 2 + 2*n_harmonics
   real(wp), parameter :: rounding = 1.0e-3_wp   !! rounding error of a number of values

   !> A window of values at equal intervals.
   type :: harmonic_window
      integer :: n_values = 0
      real(wp) :: frequency = 0.0_wp                     !! frequency of the fundamental [Hz]
      real(wp) :: interval = 0.0_wp                      !! [s]
      real(wp), allocatable, private :: weight(:, :)     !! (value, sine and cosine) of the fit
   contains
      procedure :: fundamental_share
   end type harmonic_window

contains

   !> Prepares windows of ten periods, rounded down to a whole number of values, so that two of them
   !> fit into twenty periods.
   subroutine new_harmonic_window(frequency, interval, window, error)
      real(wp), intent(in) :: frequency   !! [Hz], at most 1/(12 interval)
      real(wp), intent(in) :: interval    !! [s]
      type(harmonic_window), intent(out) :: window
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: normal(n_terms, n_terms), unit(n_terms, 2)
      real(wp), allocatable :: terms(:, :)   ! (value, term) at the times of the window
      real(wp) :: phase
      integer :: i, k

      window%frequency = frequency
      window%interval = interval
      window%n_values = int(periods_of_window/(frequency*interval) + rounding)
      allocate (terms(window%n_values, n_terms))
      terms(:, 1) = 1.0_wp
      do i = 1, window%n_values
         terms(i, n_terms) = real(i, wp)/window%n_values
         phase = two_pi*frequency*interval*i
         do k = 1, n_harmonics
            terms(i, 2*k) = sin(k*phase)
            terms(i, 2*k + 1) = cos(k*phase)
         end do
      end do
      normal = matmul(transpose(terms), terms)
      unit = 0.0_wp
      unit(2, 1) = 1.0_wp
      unit(3, 2) = 1.0_wp
      call solve_positive_definite(normal, unit, error)
      window%weight = matmul(terms, unit)
   end subroutine new_harmonic_window

   !> Contribution of some values of the window to the fundamental s + i c of
   !> x = s sin(2 pi f t) + c cos(2 pi f t), the sum of all contributions.
   pure function fundamental_share(self, first, start, values) result(share)
      class(harmonic_window), intent(in) :: self
      integer, intent(in) :: first           !! place of the first value in the window
      real(wp), intent(in) :: start          !! time one interval before the window [s]
      real(wp), intent(in) :: values(:)      !! consecutive
      complex(wp) :: share
      real(wp) :: phase, s, c
      integer :: last

      last = first + size(values) - 1
      s = dot_product(self%weight(first:last, 1), values)
      c = dot_product(self%weight(first:last, 2), values)
      phase = start*self%frequency
      phase = two_pi*(phase - anint(phase))
      share = cmplx(s, c, wp)*cmplx(cos(phase), -sin(phase), wp)
   end function fundamental_share

end module numerics_harmonic
