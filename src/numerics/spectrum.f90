!> Power spectral densities by Welch's method, accumulated while a record is being made.
!>
!> Segments overlap, lose their mean, are weighted with a periodic Hann window, and their
!> periodograms are averaged. Densities are one-sided, per Hz; summed over all frequencies times
!> their spacing they give the mean square of the weighted record, so its variance (Parseval, to
!> rounding).
module numerics_spectrum
   use core_kinds, only: wp
   use numerics_fftw, only: forward_fft
   implicit none(type, external)
   private
   public :: welch_type, count_segments

   !> Spectra of many records of the same length, which come in pieces of any length.
   type :: welch_type
      integer :: n_segments = 0                             !! averaged so far
      integer, private :: length = 0, overlap = 0, filled = 0
      integer, private :: first = 1                         !! where the segment begins, cyclic
      real(wp), private :: interval = 0.0_wp                !! between values [s]
      real(wp), allocatable, private :: window(:)
      real(wp), allocatable, private :: segment(:, :)       !! (place, series) the one being filled
      real(wp), allocatable, private :: power(:, :)         !! (frequency, series) sum of |X|^2
      type(forward_fft), private :: transform
   contains
      procedure :: start
      procedure :: add
      procedure :: finish
      procedure, private :: take_segment
   end type welch_type

contains

   !> Segments that a record of n values holds.
   pure function count_segments(n, length, overlap) result(segments)
      integer, intent(in) :: n, length, overlap
      integer :: segments

      segments = 0
      if (n >= length) segments = 1 + (n - length)/(length - overlap)
   end function count_segments

   !> Empties the spectra and sets the segments: `length` values, `overlap` shared by neighbours.
   subroutine start(self, n_series, length, overlap, interval)
      class(welch_type), intent(inout) :: self
      integer, intent(in) :: n_series, length, overlap
      real(wp), intent(in) :: interval   !! between values [s]
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      integer :: i

      self%n_segments = 0
      self%filled = 0
      self%first = 1
      self%overlap = overlap
      self%interval = interval
      if (self%transform%n /= length) then
         self%length = length
         self%window = [(0.5_wp*(1.0_wp - cos(two_pi*i/length)), i=0, length - 1)]
         call self%transform%prepare(length)
      end if
      if (allocated(self%segment)) deallocate (self%segment, self%power)
      allocate (self%segment(length, n_series), self%power(0:length/2, n_series))
      self%power = 0.0_wp
   end subroutine start

   !> The next values of all records.
   subroutine add(self, values)
      class(welch_type), intent(inout) :: self
      real(wp), intent(in) :: values(:, :)   !! (value, series)
      integer :: taken, n, place, series

      taken = 0
      do while (taken < size(values, 1))
         place = modulo(self%first + self%filled - 1, self%length)
         n = min(size(values, 1) - taken, self%length - max(self%filled, place))
         do series = 1, size(values, 2)
            self%segment(place + 1:place + n, series) = values(taken + 1:taken + n, series)
         end do
         self%filled = self%filled + n
         taken = taken + n
         if (self%filled == self%length) call self%take_segment()
      end do
   end subroutine add

   !> Adds the periodogram of a full segment. What the next one shares with it stays in its place.
   subroutine take_segment(self)
      class(welch_type), intent(inout) :: self
      integer :: series

      do series = 1, size(self%segment, 2)
         call weigh(self%length, self%first, self%window, self%segment(:, series), &
                    self%transform%signal)
         call self%transform%execute()
         call add_square(size(self%power, 1), self%transform%spectrum, self%power(:, series))
      end do
      self%first = 1 + modulo(self%first + self%length - self%overlap - 1, self%length)
      self%filled = self%overlap
      self%n_segments = self%n_segments + 1
   end subroutine take_segment

   !> The values without their mean, times the window; they begin at `first` and go on at 1. The
   !> mean is summed in several parts at once: in one sum each addition waits for the one before.
   pure subroutine weigh(n, first, window, values, weighted)
      integer, intent(in) :: n, first
      real(wp), intent(in) :: window(n), values(n)
      real(wp), intent(out) :: weighted(n)
      real(wp) :: mean
      integer :: i, left

      mean = 0.0_wp
      !$omp simd reduction(+:mean)
      do i = 1, n
         mean = mean + values(i)
      end do
      mean = mean/n
      left = n - first + 1
      weighted(:left) = window(:left)*(values(first:) - mean)
      weighted(left + 1:) = window(left + 1:)*(values(:first - 1) - mean)
   end subroutine weigh

   pure subroutine add_square(n, spectrum, power)
      integer, intent(in) :: n
      complex(wp), intent(in) :: spectrum(n)
      real(wp), intent(inout) :: power(n)

      power = power + real(spectrum, wp)**2 + aimag(spectrum)**2
   end subroutine add_square

   !> The densities; values that fill no segment are left out. Needs one segment.
   subroutine finish(self, psd)
      class(welch_type), intent(in) :: self
      !> (frequency, series) [unit^2/Hz], at 0..length/2 times 1/(length interval)
      real(wp), intent(out) :: psd(0:, :)
      real(wp) :: scale

      scale = self%interval/(sum(self%window**2)*self%n_segments)
      psd = 2.0_wp*scale*self%power
      psd(0, :) = scale*self%power(0, :)
      if (modulo(self%length, 2) == 0) psd(self%length/2, :) = scale*self%power(self%length/2, :)
   end subroutine finish

end module numerics_spectrum
