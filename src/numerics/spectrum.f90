!> Power spectral densities by Welch's method, accumulated while a record is being made.
!>
!> Segments overlap. Each loses its mean and is weighted with a periodic Hann window; their
!> periodograms are averaged. Densities are one-sided, per Hz. Their sum over all frequencies times
!> the spacing is the mean square of the weighted record (Parseval, to rounding).
!>
!> The power within some ranges of frequencies can also be recorded for consecutive batches of
!> segments. Its scatter over batches gives the standard error of an average over all of them.
module numerics_spectrum
   use core_kinds, only: two_pi, wp
   use numerics_correlated, only: n_batches
   use numerics_fftw, only: real_fft
   implicit none(type, external)
   private
   public :: welch_type, count_segments, can_follow_power, error_of_density, last_of_ranges

   real(wp), parameter :: growth = 1.5_wp   !! width of a range of frequencies over the one before

   !> Spectra of many records of the same length, which are added in pieces of any length.
   type :: welch_type
      integer :: n_segments = 0                             !! averaged so far
      integer, private :: length = 0, overlap = 0, filled = 0
      integer, private :: first = 1                         !! where the segment begins, cyclic
      real(wp), private :: interval = 0.0_wp                !! between values [s]
      real(wp), allocatable, private :: window(:)
      real(wp), allocatable, private :: segment(:, :)       !! (place, series) the one being filled
      real(wp), allocatable, private :: power(:, :)         !! (frequency, series) sum of |X|^2
      type(real_fft), private :: transform
      integer, private :: n_expected = 0                    !! segments, where power is followed
      integer, private :: n_ended = 0                       !! batches of them that are over
      !> (batch, range, series) mean square of the records in the segments up to the end of a batch,
      !> added up; unallocated: power is not followed
      real(wp), allocatable, private :: followed(:, :, :)
   contains
      procedure :: start
      procedure :: add
      procedure :: finish
      procedure :: power_series
      procedure, private :: take_segment
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

   !> True if the segments fill batches of two or more each, which the scatter needs.
   pure logical function can_follow_power(n_segments)
      integer, intent(in) :: n_segments

      can_follow_power = n_segments >= 2*n_batches
   end function can_follow_power

   !> Relative standard error of a density of a Gaussian record, from segments that overlap by half:
   !> neighbouring Hann segments have a correlation of 1/6 in amplitude and 1/36 in power (Welch,
   !> IEEE Trans. AU-15, 1967).
   elemental function error_of_density(n_segments) result(error)
      integer, intent(in) :: n_segments
      real(wp) :: error

      error = sqrt((1.0_wp + (1.0_wp - 1.0_wp/n_segments)/18.0_wp)/n_segments)
   end function error_of_density

   !> The last frequency of each range; the first ranges have one frequency, later ones more.
   pure function last_of_ranges(n_frequencies) result(last)
      integer, intent(in) :: n_frequencies
      integer, allocatable :: last(:)   !! counted from 1; the last is n_frequencies

      last = [1]
      do while (last(size(last)) < n_frequencies)
         last = [last, min(n_frequencies, ceiling(growth*last(size(last))))]
      end do
   end function last_of_ranges

   !> Empties the spectra and sets the segments: `length` values, `overlap` shared by neighbours.
   !> With n_expected, the number of segments, the power in batches of them is recorded.
   subroutine start(self, n_series, length, overlap, interval, n_expected)
      class(welch_type), intent(inout) :: self
      integer, intent(in) :: n_series, length, overlap
      real(wp), intent(in) :: interval   !! between values [s]
      integer, intent(in), optional :: n_expected
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
      self%n_ended = 0
      if (allocated(self%followed)) deallocate (self%followed)
      if (.not. present(n_expected)) return
      self%n_expected = n_expected
      allocate (self%followed(n_batches, size(last_of_ranges(length/2 + 1)), n_series))
   end subroutine start

   !> Adds the next values of all records.
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

   !> Adds the periodogram of a full segment and keeps the values shared with the next one.
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
      if (allocated(self%followed)) then
         do while (self%n_ended < n_batches)
            if (end_of_batch(self, self%n_ended + 1) > self%n_segments) exit
            call self%end_batch()
         end do
      end if
   end subroutine take_segment

   !> The number of the last segment of a batch.
   pure integer function end_of_batch(self, batch)
      class(welch_type), intent(in) :: self
      integer, intent(in) :: batch

      end_of_batch = batch*self%n_expected/n_batches
   end function end_of_batch

   !> Ends a batch and records its power in each range.
   subroutine end_batch(self)
      class(welch_type), intent(inout) :: self
      real(wp) :: squares(size(self%power, 1))
      integer :: first, i, series
      integer, allocatable :: last(:)

      last = last_of_ranges(size(squares))
      self%n_ended = self%n_ended + 1
      do series = 1, size(self%power, 2)
         squares = densities(self, self%power(:, series), 1)/(self%length*self%interval)
         first = 1
         do i = 1, size(last)
            self%followed(self%n_ended, i, series) = sum(squares(first:last(i)))
            first = last(i) + 1
         end do
      end do
   end subroutine end_batch

   !> The mean square of the records within each range of frequencies, in each batch. Needs all
   !> expected segments.
   pure function power_series(self) result(power)
      class(welch_type), intent(in) :: self
      real(wp) :: power(size(self%followed, 1), size(self%followed, 2), size(self%followed, 3))
      integer :: b

      power = self%followed
      do b = n_batches, 2, -1
         power(b, :, :) = (power(b, :, :) - power(b - 1, :, :)) &
                          /(end_of_batch(self, b) - end_of_batch(self, b - 1))
      end do
      power(1, :, :) = power(1, :, :)/end_of_batch(self, 1)
   end function power_series

   !> Subtracts the mean of the values and multiplies by the window. The values begin at `first` and
   !> continue at 1. The mean is summed in several independent parts, because in one sum each
   !> addition waits for the one before.
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

   !> Finds the densities and gives the memory of the records back; values that fill no segment are
   !> left out. Needs one segment.
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
