!> Forces as functions of time: Gaussian noise by Fourier synthesis, white in a band (Sec. 3) or of
!> a given spectrum, and sines.
module dynamics_excitation
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: two_pi, wp
   use core_random, only: stream_type
   use core_text, only: to_text
   use numerics_fftw, only: good_fft_length
   use numerics_synthesis, only: sum_lines
   implicit none(type, external)
   private
   public :: band_limited_force, coloured_force, sine_force

   integer, parameter :: fewest_lines = 64          !! in the band, however short the record
   integer, parameter :: longest_period = 2**28     !! of the synthesis [steps]

contains

   !> Makes a record of a stationary Gaussian process with a flat density on the band and unit
   !> variance in expectation; the same stream gives the same record.
   !>
   !> It is a piece of a periodic one, not shorter than the record. Each line stands for the
   !> frequencies nearer to it than to its neighbours, and a line at the edge only for those inside
   !> the band, so that the expected variance is exact for every band, with or without zero and the
   !> Nyquist frequency.
   subroutine band_limited_force(band, dt, stream, force, error)
      real(wp), intent(in) :: band(2)                !! [Hz], within 0 and 1/(2 dt)
      real(wp), intent(in) :: dt                     !! [s]
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: force(:)              !! (step) values dt apart
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: power(:)
      integer :: first, i, last, n

      call check_band('excitation%band', band, dt, error)
      if (allocated(error)) return
      call choose_lines(band, dt, size(force), n, first, last)
      power = [(share_of_line(i, 1.0_wp/(n*dt), band), i=first, last)]
      call synthesize(power, first, n, stream, force)
   end subroutine band_limited_force

   !> Makes a record of a stationary Gaussian process whose one-sided density is linear between the
   !> given values and zero outside of them. Its expected variance is the integral of the density.
   !> Made as by band_limited_force.
   subroutine coloured_force(frequency, density, dt, stream, force, error)
      real(wp), intent(in) :: frequency(:)   !! [Hz], ascending, within 0 and 1/(2 dt)
      real(wp), intent(in) :: density(:)     !! not negative [N^2/Hz]
      real(wp), intent(in) :: dt             !! [s]
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: force(:)      !! (step) values dt apart [N]
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: power(:)
      real(wp) :: band(2), spacing
      integer :: first, i, last, n

      band = [frequency(1), frequency(size(frequency))]
      call check_band('band of excitation%psd', band, dt, error)
      if (allocated(error)) return
      call choose_lines(band, dt, size(force), n, first, last)
      spacing = 1.0_wp/(n*dt)
      power = [(power_below(frequency, density, (i + 0.5_wp)*spacing) &
                - power_below(frequency, density, (i - 0.5_wp)*spacing), i=first, last)]
      power = max(power, 0.0_wp)   ! where the difference of equal integrals is rounded
      call synthesize(power, first, n, stream, force)
   end subroutine coloured_force

   !> Makes a force whose fundamental is sin(2 pi f t), with the phase reduced to half a turn.
   !> Linear between values sin(2 pi f t) it would have (sin(x)/x)^2 of it, x = pi f dt.
   pure subroutine sine_force(frequency, dt, force)
      real(wp), intent(in) :: frequency   !! [Hz]
      real(wp), intent(in) :: dt          !! [s]
      real(wp), intent(out) :: force(0:)  !! (step)
      real(wp) :: amplitude, turns, x
      integer :: i

      x = 0.5_wp*two_pi*frequency*dt
      amplitude = (x/sin(x))**2
      do i = 0, ubound(force, 1)
         turns = i*(frequency*dt)
         force(i) = amplitude*sin(two_pi*(turns - anint(turns)))
      end do
   end subroutine sine_force

   !> Chooses the lines of a synthesis that lie in a band.
   subroutine choose_lines(band, dt, n_values, n, first, last)
      real(wp), intent(in) :: band(2), dt      !! [Hz], [s]
      integer, intent(in) :: n_values          !! of the record
      integer, intent(out) :: n                !! steps of the period
      integer, intent(out) :: first, last      !! lines, 1/(n dt) apart, from 0
      real(wp) :: spacing

      n = good_fft_length(max(n_values, ceiling(fewest_lines/((band(2) - band(1))*dt))))
      spacing = 1.0_wp/(n*dt)
      first = nint(band(1)/spacing)
      last = min(nint(band(2)/spacing), n/2)
   end subroutine choose_lines

   !> Adds up lines with random amplitudes, of the given powers in expectation.
   subroutine synthesize(power, first, n, stream, force)
      real(wp), intent(in) :: power(:)      !! (line) from the first [N^2]
      integer, intent(in) :: first, n       !! first line; steps of the period
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: force(:)     !! (step)
      real(wp), allocatable :: normal(:)
      complex(wp), allocatable :: line(:)
      real(wp) :: scale
      integer :: i

      allocate (normal(2*size(power)))
      call stream%normals(normal)
      allocate (line(first:first + size(power) - 1))
      do i = 1, size(power)
         scale = sqrt(power(i))
         associate (z => normal(2*i - 1:2*i), k => first + i - 1)
            if (k == 0 .or. 2*k == n) then
               line(k) = scale*z(1)
            else
               line(k) = 0.5_wp*scale*cmplx(z(1), -z(2), wp)
            end if
         end associate
      end do
      call sum_lines(n, first, line, force)
   end subroutine synthesize

   !> Integral of a piecewise linear density from its first frequency to f [N^2].
   pure function power_below(frequency, density, f) result(power)
      real(wp), intent(in) :: frequency(:), density(:)
      real(wp), intent(in) :: f   !! [Hz]
      real(wp) :: power
      real(wp) :: end_density, share
      integer :: i

      power = 0.0_wp
      do i = 1, size(frequency) - 1
         if (f <= frequency(i)) return
         associate (width => frequency(i + 1) - frequency(i))
            share = min(1.0_wp, (f - frequency(i))/width)
            end_density = density(i) + share*(density(i + 1) - density(i))
            power = power + 0.5_wp*(density(i) + end_density)*share*width
         end associate
      end do
   end function power_below

   !> The share of the band that line k stands for.
   pure function share_of_line(k, spacing, band) result(share)
      integer, intent(in) :: k
      real(wp), intent(in) :: spacing, band(2)   !! [Hz]
      real(wp) :: share
      real(wp) :: low, high

      low = max((k - 0.5_wp)*spacing, band(1))
      high = min((k + 0.5_wp)*spacing, band(2))
      share = max(high - low, 0.0_wp)/(band(2) - band(1))
   end function share_of_line

   pure subroutine check_band(what, band, dt, error)
      character(*), intent(in) :: what
      real(wp), intent(in) :: band(2), dt
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: name

      name = what//' = '//to_text(band(1))//', '//to_text(band(2))//': '
      if (.not. dt > 0.0_wp) then
         call raise(error, exit_bad_input, 'integration%dt = '//to_text(dt)//': must be positive')
      else if (.not. (band(1) >= 0.0_wp .and. band(2) > band(1))) then
         call raise(error, exit_bad_input, name//'must ascend from 0 or more')
      else if (.not. 2.0_wp*band(2)*dt <= 1.0_wp + 4.0_wp*epsilon(1.0_wp)) then
         call raise(error, exit_bad_input, name//'must end at the Nyquist frequency 1/(2 dt) = '// &
                    to_text(0.5_wp/dt)//' or below')
      else if ((band(2) - band(1))*dt < real(fewest_lines, wp)/longest_period) then
         call raise(error, exit_bad_input, name//'is narrower than '// &
                    to_text(fewest_lines/(longest_period*dt))//' Hz, the least with this dt')
      end if
   end subroutine check_band

end module dynamics_excitation
