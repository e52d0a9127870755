!> Infinite correlation lengths of a process of the direct method, of any order (Eqs. (8), (9)).
module process_direct_sums
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_fftw, only: forward_fft, good_fft_length, inverse_fft
   use process_autoregressive_model, only: reflection_of
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_autoregressive_sums, only: correlation_sums, log_spectral_ratios, sum_correlation
   implicit none(type, external)
   private
   public :: sum_direct_correlation

contains

   !> Adds up |K(m)| and m |K(m)| over all lags.
   !>
   !> With every s_m = +1 and no penalized lag, 1/g is a series in powers of a sum of cosines with
   !> positive factors: all K(m) > 0, and the sums are closed forms (see
   !> `process_autoregressive_sums`). Else all moduli are summed, above order `high_order` from an
   !> FFT.
   subroutine sum_direct_correlation(a, is_positive, sums, error)
      real(wp), intent(in) :: a(:)
      logical, intent(in) :: is_positive   !! all K(m) > 0 is known
      type(correlation_sums), intent(out) :: sums
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: high_order = 64
      real(wp) :: log_r(0:size(a))
      integer :: order

      order = size(a)
      if (is_positive) then
         log_r = log_spectral_ratios(reflection_of(a))
         sums%is_nonnegative = .true.
         sums%l0 = 0.5_wp*(exp(log_r(order)) - 1.0_wp)
         if (log_r(order) < 1.0_wp) sums%l0 = exp(0.5_wp*log_r(order))*sinh(0.5_wp*log_r(order))
         sums%l1 = 0.5_wp*exp(log_r(order))*sum(sinh(log_r(order) - log_r(:order - 1)))/ &
                   (1.0_wp + sums%l0)
      else if (order <= high_order) then
         call sum_correlation(reflection_of(a), sums, error)
      else
         call sum_by_fft(a, sums, error)
      end if
   end subroutine sum_direct_correlation

   !> Adds up the moduli of all lags at once, on a circle so long that the last ones are negligible.
   subroutine sum_by_fft(a, sums, error)
      real(wp), intent(in) :: a(:)
      type(correlation_sums), intent(out) :: sums
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: longest = 2**23
      real(wp), parameter :: negligible = 1.0e-14_wp   ! of K(0)
      type(inverse_fft) :: circle
      type(forward_fft) :: lags
      real(wp), allocatable :: modulus(:)
      integer :: m, n

      n = good_fft_length(16*size(a))
      do
         call circle%prepare(n)
         call lags%prepare(n)
         circle%spectrum = (0.0_wp, 0.0_wp)
         circle%spectrum(:size(a)) = cmplx(symbol_of_process(a, 1.0_wp), kind=wp)
         call circle%execute()
         lags%signal = 1.0_wp/circle%signal
         call lags%execute()
         sums%n_lags = n/2
         associate (variance => lags%spectrum(0)%re, last => lags%spectrum(n/2 - size(a):)%re)
            if (maxval(abs(last)) <= negligible*variance) exit
         end associate
         n = 2*n
         if (n > longest) then
            call raise(error, exit_no_solution, 'correlation lengths of order '// &
                       to_text(size(a))//': more than '//to_text(longest/2)//' lags count')
            return
         end if
      end do
      modulus = abs(lags%spectrum(1:)%re)/lags%spectrum(0)%re
      sums%l0 = sum(modulus)
      sums%l1 = dot_product([(real(m, wp), m=1, size(modulus))], modulus)/(1.0_wp + sums%l0)
   end subroutine sum_by_fft

end module process_direct_sums
