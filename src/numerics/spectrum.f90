!> Power spectral densities by Welch's method, accumulated while records are computed.
!>
!> Segments overlap. The mean of each is subtracted, a periodic Hann window multiplies it, and the
!> periodograms are averaged. Densities are one-sided, per Hz. Their sum over all frequencies times
!> the spacing is the mean square of the windowed record (Parseval).
!>
!> The power within ranges of frequencies can also be recorded for consecutive batches of segments.
!> Its scatter over batches gives the standard error of an average over all segments.
module numerics_spectrum
   use core_kinds, only: two_pi, wp
   use numerics_correlated, only: n_batches
   use numerics_fftw, only: real_fft
   implicit none(type, external)
   private
   public :: welch_type, count_segments, has_enough_batches, error_of_density, last_of_ranges

   real(wp), parameter :: growth = 1.5_wp   !! last frequency of a range over that of the one before

   !> Spectra of records of the same length, which are added in pieces of any length.
   type :: welch_type
      integer :: n_segments = 0                          !! segments so far
      integer, private :: length = 0, overlap = 0        !! values of a segment, those shared
      integer, private :: n_filled = 0                   !! values in `segment`
      integer, private :: first = 1                      !! place of its first value; it is cyclic
      real(wp), private :: interval = 0.0_wp             !! time between values [s]
      real(wp), allocatable, private :: window(:)
      real(wp), allocatable, private :: segment(:, :)    !! (place, series) segment being filled
      real(wp), allocatable, private :: power(:, :)      !! (frequency, series) sum of |X|^2
      type(real_fft), private :: transform
      integer, private :: n_expected = 0, n_batches_done = 0   !! segments in all, batches so far
      !> (batch, range, series) sum over segments up to the end of a batch of the mean square of the
      !> record within the range; unallocated: batches are not recorded
      real(wp), allocatable, private :: cumulative(:, :, :)
   contains
      procedure :: start
      procedure :: add
      procedure :: finish
      procedure :: power_series
      procedure, private :: add_periodogram
      procedure, private :: end_batch
   end type welch_type

contains

   !> Number of segments in a record of n values.
   pure function count_segments(n, length, overlap) result(segments)
      integer, intent(in) :: n, length, overlap
      integer :: segments

      segments = 0
      if (n >= length) segments = 1 + (n - length)/(length - overlap)
   end function count_segments

   !> True if there are at least two segments for each batch.
   pure logical function has_enough_batches(n_segments)
      integer, intent(in) :: n_segments

      has_enough_batches = n_segments >= 2*n_batches
   end function has_enough_batches

   !> Relative standard error of a density of a Gaussian record, for segments that overlap by half.
   !> The correlation of neighbouring Hann segments is 1/6 in amplitude and 1/36 in power (Welch,
   !> IEEE Trans. AU-15, 1967).
   elemental function error_of_density(n_segments) result(error)
      integer, intent(in) :: n_segments
      real(wp) :: error

      error = sqrt((1.0_wp + (1.0_wp - 1.0_wp/n_segments)/18.0_wp)/n_segments)
   end function error_of_density

   !> Last frequency of each range. The first ranges have one frequency, later ones more.
   pure function last_of_ranges(n_frequencies) result(last)
      integer, intent(in) :: n_frequencies
      integer, allocatable :: last(:)   !! counted from 1; the last is n_frequencies

      last = [1]
      do while (last(size(last)) < n_frequencies)
         last = [last, min(n_frequencies, ceiling(growth*last(size(last))))]
      end do
   end function last_of_ranges

   !> Starts new spectra, with segments of `length` values of which neighbours share `overlap`.
   subroutine start(self, n_series, length, overlap, interval, n_expected)
      class(welch_type), intent(inout) :: self
      integer, intent(in) :: n_series, length, overlap
      real(wp), intent(in) :: interval              !! time between values [s]
      integer, intent(in), optional :: n_expected   !! segments in all; absent: no batches
      integer :: i

      self%n_segments = 0
      self%n_filled = 0
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
      self%n_batches_done = 0
      if (allocated(self%cumulative)) deallocate (self%cumulative)
      if (.not. present(n_expected)) return
      self%n_expected = n_expected
      allocate (self%cumulative(n_batches, size(last_of_ranges(length/2 + 1)), n_series))
   end subroutine start

   !> Adds the next values of all records.
   subroutine add(self, values)
      class(welch_type), intent(inout) :: self
      real(wp), intent(in) :: values(:, :)   !! (value, series)
      integer :: n_taken, n, place, series

      n_taken = 0
      do while (n_taken < size(values, 1))
         place = modulo(self%first + self%n_filled - 1, self%length)
         n = min(size(values, 1) - n_taken, self%length - max(self%n_filled, place))
         do series = 1, size(values, 2)
            self%segment(place + 1:place + n, series) = values(n_taken + 1:n_taken + n, series)
         end do
         self%n_filled = self%n_filled + n
         n_taken = n_taken + n
         if (self%n_filled == self%length) call self%add_periodogram()
      end do
   end subroutine add

   !> Adds the periodogram of a full segment and keeps the values that the next one shares.
   subroutine add_periodogram(self)
      class(welch_type), intent(inout) :: self
      integer :: series

      do series = 1, size(self%segment, 2)
         call apply_window(self%length, self%first, self%window, self%segment(:, series), &
                           self%transform%signal)
         call self%transform%execute()
         call add_square(size(self%power, 1), self%transform%spectrum, self%power(:, series))
      end do
      self%first = 1 + modulo(self%first + self%length - self%overlap - 1, self%length)
      self%n_filled = self%overlap
      self%n_segments = self%n_segments + 1
      if (allocated(self%cumulative)) then
         do while (self%n_batches_done < n_batches)
            if (end_of_batch(self, self%n_batches_done + 1) > self%n_segments) exit
            call self%end_batch()
         end do
      end if
   end subroutine add_periodogram

   !> Number of the last segment of a batch.
   pure integer function end_of_batch(self, batch)
      class(welch_type), intent(in) :: self
      integer, intent(in) :: batch

      end_of_batch = batch*self%n_expected/n_batches
   end function end_of_batch

   !> Records the power in each range at the end of a batch.
   subroutine end_batch(self)
      class(welch_type), intent(inout) :: self
      real(wp) :: squares(size(self%power, 1))
      integer :: first, i, series
      integer, allocatable :: last(:)

      last = last_of_ranges(size(squares))
      self%n_batches_done = self%n_batches_done + 1
      do series = 1, size(self%power, 2)
         squares = densities(self, self%power(:, series), 1)/(self%length*self%interval)
         first = 1
         do i = 1, size(last)
            self%cumulative(self%n_batches_done, i, series) = sum(squares(first:last(i)))
            first = last(i) + 1
         end do
      end do
   end subroutine end_batch

   !> Mean square of the records within each range of frequencies, in each batch (batch, range,
   !> series). Needs all expected segments.
   pure function power_series(self) result(power)
      class(welch_type), intent(in) :: self
      real(wp), allocatable :: power(:, :, :)
      integer :: b

      power = self%cumulative
      do b = n_batches, 2, -1
         power(b, :, :) = (power(b, :, :) - power(b - 1, :, :)) &
                          /(end_of_batch(self, b) - end_of_batch(self, b - 1))
      end do
      power(1, :, :) = power(1, :, :)/end_of_batch(self, 1)
   end function power_series

   !> Subtracts the mean of a segment and multiplies it by the window. The segment begins at `first`
   !> and continues at 1. The mean is the sum of several independent sums, because in one sum each
   !> addition would wait for the one before.
   pure subroutine apply_window(n, first, window, values, weighted)
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
   end subroutine apply_window

   !> Adds |X|^2 to the power.
   pure subroutine add_square(n, spectrum, power)
      integer, intent(in) :: n
      complex(wp), intent(in) :: spectrum(n)
      real(wp), intent(inout) :: power(n)

      power = power + real(spectrum, wp)**2 + aimag(spectrum)**2
   end subroutine add_square

   !> Finds the densities and frees memory. Values after the last full segment are left out. Needs
   !> one segment.
   subroutine finish(self, psd)
      class(welch_type), intent(inout) :: self
      !> (frequency, series) [unit^2/Hz], at 0..length/2 times 1/(length interval)
      real(wp), intent(out) :: psd(0:, :)
      integer :: series

      do series = 1, size(psd, 2)
         psd(:, series) = densities(self, self%power(:, series), self%n_segments)
      end do
      deallocate (self%segment, self%power)
   end subroutine finish

   !> Spectral densities of one record, from its power in a number of segments.
   pure function densities(self, power, n_segments) result(psd)
      class(welch_type), intent(in) :: self
      real(wp), intent(in) :: power(0:)
      integer, intent(in) :: n_segments
      real(wp) :: psd(0:size(power) - 1)
      real(wp) :: scale

      scale = self%interval/(sum(self%window**2)*n_segments)
      psd = 2.0_wp*scale*power
      psd(0) = scale*power(0)
      if (modulo(self%length, 2) == 0) psd(self%length/2) = scale*power(self%length/2)
   end function densities

end module numerics_spectrum
