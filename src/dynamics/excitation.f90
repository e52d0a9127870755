!> Gaussian white noise in a band of frequencies (Sec. 3), by Fourier synthesis.
module dynamics_excitation
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_random, only: stream_type
   use core_text, only: to_text
   use numerics_fftw, only: good_fft_length
   use numerics_synthesis, only: sum_lines
   implicit none(type, external)
   private
   public :: band_limited_force

   integer, parameter :: fewest_lines = 64          !! in the band, however short the record
   integer, parameter :: longest_period = 2**28     !! of the synthesis [steps]

contains

   !> A record of a stationary Gaussian process with a flat density on the band and unit variance in
   !> expectation; the same stream gives the same record.
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
      real(wp), allocatable :: normal(:)
      complex(wp), allocatable :: line(:)
      real(wp) :: spacing, scale
      integer :: first, last, n, k

      call check_band(band, dt, error)
      if (allocated(error)) return
      n = good_fft_length(max(size(force), ceiling(fewest_lines/((band(2) - band(1))*dt))))
      spacing = 1.0_wp/(n*dt)
      first = nint(band(1)/spacing)
      last = min(nint(band(2)/spacing), n/2)

      allocate (normal(2*(last - first + 1)))
      call stream%normals(normal)
      allocate (line(first:last))
      do k = first, last
         scale = sqrt(share_of_line(k, spacing, band))
         associate (z => normal(2*(k - first) + 1:2*(k - first) + 2))
            if (k == 0 .or. 2*k == n) then
               line(k) = scale*z(1)
            else
               line(k) = 0.5_wp*scale*cmplx(z(1), -z(2), wp)
            end if
         end associate
      end do
      call sum_lines(n, first, line, force)
   end subroutine band_limited_force

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

   pure subroutine check_band(band, dt, error)
      real(wp), intent(in) :: band(2), dt
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: name

      name = 'excitation%band = '//to_text(band(1))//', '//to_text(band(2))//': '
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
