!> Periodic signals from a few spectral lines: short inverse transforms in place of a long one.
!>
!> Only lines k <= last of a period of n values are not zero. With n = P m and m > 2 last, the
!> values p, p + P, p + 2 P, ... of phase p are an inverse transform of length m of the lines times
!> exp(2 pi i k p/n). The P short transforms stay in the cache.
module numerics_synthesis
   use core_kinds, only: two_pi, wp
   use numerics_fftw, only: real_fft
   implicit none(type, external)
   private
   public :: signal_of_lines

   integer, parameter :: max_phases = 64   !! each phase adds a rounding error to the factors
   integer, parameter :: together = 8      !! phases that are stored side by side

contains

   !> Computes signal(j) = sum over k of line(k) exp(2 pi i j k/n) + its conjugate; lines 0 and n/2
   !> count once, with their real parts.
   subroutine signal_of_lines(n, first, line, signal)
      integer, intent(in) :: n                    !! values of a period
      integer, intent(in) :: first                !! index of the first line, at least 0
      complex(wp), intent(in) :: line(first:)     !! (k), up to n/2 at most
      real(wp), intent(out) :: signal(0:)         !! (j), the first values of a period
      type(real_fft) :: transform
      complex(wp), allocatable :: turned(:), turn(:)   ! (k) lines of a phase; exp(2 pi i k/n)
      real(wp), allocatable :: part(:, :)              ! (phase, value)
      integer :: i, k, last, n_phases, p, place, values, width

      last = ubound(line, 1)
      n_phases = count_phases(n, last)
      values = n/n_phases
      call transform%prepare(values, is_inverse=.true.)
      allocate (turned(first:last), turn(first:last))
      allocate (part(min(together, n_phases), 0:values - 1))
      do k = first, last
         turned(k) = line(k)
         turn(k) = cmplx(cos(two_pi*k/n), sin(two_pi*k/n), wp)
      end do
      do p = 0, n_phases - 1, together
         width = min(together, n_phases - p)
         do i = 1, width
            transform%spectrum = 0.0_wp
            transform%spectrum(first:last) = turned
            call transform%execute()
            part(i, :) = transform%signal
            turned = turned*turn
         end do
         do k = 0, values - 1
            place = p + n_phases*k
            if (place >= size(signal)) exit
            i = min(width, size(signal) - place)
            signal(place:place + i - 1) = part(:i, k)
         end do
      end do
   end subroutine signal_of_lines

   !> Largest number of phases P that divides n with n/P > 2 last.
   pure integer function count_phases(n, last)
      integer, intent(in) :: n, last

      do count_phases = min(max_phases, n), 2, -1
         if (modulo(n, count_phases) == 0 .and. n/count_phases > 2*last) exit
      end do
   end function count_phases

end module numerics_synthesis
