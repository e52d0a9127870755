!> Force records: Gaussian noise by Fourier synthesis, white in a band (Sec. 3) or with a given
!> power spectral density, and sines.
module dynamics_excitation
   use core_kinds, only: two_pi, wp
   use core_random, only: stream_type
   use core_text, only: brief, rounded_text
   use numerics_fftw, only: good_fft_length
   use numerics_synthesis, only: signal_of_lines
   implicit none(type, external)
   private
   public :: band_rule, noise_force, sine_force

   integer, parameter :: fewest_lines = 64        !! lines in the band, for any length of record
   integer, parameter :: longest_period = 2**28   !! period of the synthesis [steps]

contains

   !> Makes a record of a stationary Gaussian process. Its one-sided power spectral density is
   !> linear between the given values and zero outside of them; its expected variance is their
   !> integral. Without values the density is flat and the variance 1. The band must keep
   !> `band_rule`.
   !>
   !> The record is a piece of a periodic one. Each spectral line has the power of the frequencies
   !> that are nearer to it than to its neighbours and inside the band, so that the expected
   !> variance is exact for every band, with or without zero and the Nyquist frequency.
   subroutine noise_force(frequency, dt, stream, force, density)
      real(wp), intent(in) :: frequency(:)   !! [Hz], ascending, within 0 and 1/(2 dt)
      real(wp), intent(in) :: dt             !! [s]
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: force(:)      !! (step) values dt apart [N]
      real(wp), intent(in), optional :: density(:)   !! at each frequency, not negative [N^2/Hz]
      real(wp), allocatable :: level(:), normal(:)
      complex(wp), allocatable :: line(:)   ! line k at k times the spacing
      real(wp) :: band(2), spacing          ! [Hz]
      real(wp) :: scale, unit               ! rms of a line; power that counts as 1
      integer :: first, k, last, n          ! n: period [steps]

      band = [frequency(1), frequency(size(frequency))]
      if (present(density)) then
         level = density
         unit = 1.0_wp
      else
         level = spread(1.0_wp, 1, size(frequency))
         unit = band(2) - band(1)
      end if
      if (band_rule(band, dt) /= '') error stop 'noise_force: a band that breaks its rule'
      n = good_fft_length(max(size(force), ceiling(fewest_lines/((band(2) - band(1))*dt))))
      spacing = 1.0_wp/(n*dt)
      first = nint(band(1)/spacing)
      last = min(nint(band(2)/spacing), n/2)
      allocate (normal(2*(last - first + 1)), line(first:last))
      call stream%normals(normal)
      do k = first, last
         scale = sqrt(power_between(frequency, level, (k - 0.5_wp)*spacing, &
                                    (k + 0.5_wp)*spacing)/unit)
         associate (z => normal(2*(k - first) + 1:2*(k - first) + 2))
            if (k == 0 .or. 2*k == n) then
               line(k) = scale*z(1)
            else
               line(k) = 0.5_wp*scale*cmplx(z(1), -z(2), wp)
            end if
         end associate
      end do
      call signal_of_lines(n, first, line, force)
   end subroutine noise_force

   !> Makes a sine force, linear between steps, whose fundamental is sin(2 pi f t). With values
   !> sin(2 pi f t) the fundamental would be (sin(x)/x)^2 of that, x = pi f dt.
   pure subroutine sine_force(frequency, dt, force)
      real(wp), intent(in) :: frequency   !! [Hz]
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(out) :: force(0:)  !! (step)
      real(wp) :: amplitude, turns, x
      integer :: i

      x = 0.5_wp*two_pi*frequency*dt
      amplitude = (x/sin(x))**2
      do i = 0, ubound(force, 1)
         turns = i*(frequency*dt)   ! reduced to half a turn below, to keep digits
         force(i) = amplitude*sin(two_pi*(turns - anint(turns)))
      end do
   end subroutine sine_force

   !> Integral from low to high of a piecewise linear density that is zero elsewhere [N^2].
   pure function power_between(frequency, density, low, high) result(power)
      real(wp), intent(in) :: frequency(:), density(:)
      real(wp), intent(in) :: low, high   !! [Hz]
      real(wp) :: power
      real(wp) :: from, share, to
      integer :: i

      power = 0.0_wp
      do i = 1, size(frequency) - 1
         from = max(low, frequency(i))
         to = min(high, frequency(i + 1))
         if (to <= from) cycle
         share = (0.5_wp*(from + to) - frequency(i))/(frequency(i + 1) - frequency(i))
         power = power + (density(i) + share*(density(i + 1) - density(i)))*(to - from)
      end do
   end function power_between

   !> Rule that a band of noise breaks; '' if it breaks none.
   pure function band_rule(band, dt) result(rule)
      real(wp), intent(in) :: band(2)   !! [Hz]
      real(wp), intent(in) :: dt        !! [s]
      character(:), allocatable :: rule

      rule = ''
      if (.not. dt > 0.0_wp) then
         rule = 'needs a positive integration%dt'
      else if (.not. (band(1) >= 0.0_wp .and. band(2) > band(1))) then
         rule = 'must ascend from 0 or more'
      else if (.not. 2.0_wp*band(2)*dt <= 1.0_wp + 4.0_wp*epsilon(1.0_wp)) then
         rule = 'must not exceed half the sampling rate, 0.5/integration%dt = '// &
                rounded_text(0.5_wp/dt, 6, down=.true.)//' Hz'
      else if (band(2) - band(1) < fewest_lines/(longest_period*dt)) then
         rule = 'must not be narrower than about '//brief(fewest_lines/(longest_period*dt))// &
                ' Hz, the least with this integration%dt'
      end if
   end function band_rule

end module dynamics_excitation
