!> Fourier coefficients of the reciprocal of a banded symbol g(t) = g_0 + 2 sum g_m cos(mt), m =
!> 1..m_max.
!>
!> In an infinite domain the inverse of the banded Toeplitz matrix with these entries is the
!> Toeplitz matrix of these coefficients. They are computed by FFT, with a length that doubles until
!> what is folded back is below rounding; where zeros of g lie too near the circle for that, from
!> the spectral factor of g.
module process_direct_reciprocal_symbol
   use core_kinds, only: wp
   use numerics_fftw, only: forward_fft, good_fft_length, inverse_fft
   use process_autoregressive_spectral_factor, only: change_of_factor, factor_symbol, &
      reciprocal_of_process
   implicit none(type, external)
   private
   public :: symbol_evaluation, reciprocal_workspace

   integer, parameter :: n_levels = 16   !! lengths tried: the first one times 2**(level - 1)

   !> Values at a symbol g. Derivatives of the mean of ln g are taken along directions: the
   !! first one is a symbol A, the others are cosines, cos(mt).
   type :: symbol_evaluation
      logical :: is_positive = .false.             !! g > 0; all else holds only then
      real(wp) :: log_mean = 0.0_wp                !! mean of ln g over the circle
      real(wp), allocatable :: reciprocal(:)       !! of 1/g, lags 0..m_max
      real(wp), allocatable :: gradient(:)         !! of the mean of ln g, 0: along A
      real(wp), allocatable :: curvature(:, :)     !! minus its second derivatives
   end type symbol_evaluation

   !> Transforms that have been planned, and the last spectral factor to start the next one from.
   type :: reciprocal_workspace
      private
      integer :: m_max = -1
      integer :: first_length = 0
      integer :: longest_length = 0
      integer :: level = 1                   !! of the length in use
      type(inverse_fft) :: to_circle(n_levels)
      type(forward_fft) :: to_lags(n_levels)
      real(wp), allocatable :: a(:)          !! spectral factor, where it was needed
      real(wp) :: b0 = 0.0_wp
   contains
      procedure :: prepare
      procedure :: evaluate
      procedure :: values_on_circle
      final :: finish_workspace
   end type reciprocal_workspace

contains

   !> Prepares the workspace for symbols of this band, and forgets which transform length and
   !> spectral factor the last ones needed; plans of the same band stay.
   subroutine prepare(self, m_max)
      class(reciprocal_workspace), intent(inout) :: self
      integer, intent(in) :: m_max
      integer, parameter :: longest = 2**21   ! points; some 0.1 s for a transform
      integer :: level

      if (m_max /= self%m_max) then
         do level = 1, n_levels
            self%to_circle(level)%n = 0   ! to be planned anew
         end do
      end if
      self%m_max = m_max
      self%first_length = good_fft_length(max(64, 8*m_max))
      ! the spectral factor costs about as much as an FFT of 1.5 m_max**2 points
      self%longest_length = max(self%first_length, min(longest, max(512, 3*m_max*m_max/2)))
      self%level = 1
      if (allocated(self%a)) deallocate (self%a)
   end subroutine prepare

   subroutine finish_workspace(self)
      type(reciprocal_workspace), intent(inout) :: self
      integer :: level

      do level = 1, n_levels
         call self%to_circle(level)%release()
         call self%to_lags(level)%release()
      end do
   end subroutine finish_workspace

   !> Evaluates g and its derivatives along A and along the cosines.
   subroutine evaluate(self, symbol, along, cosines, evaluation)
      class(reciprocal_workspace), intent(inout) :: self
      real(wp), intent(in) :: symbol(0:)   !! g_m, m = 0..m_max
      real(wp), intent(in) :: along(0:)    !! A_m, m = 0..m_max
      integer, intent(in) :: cosines(:)    !! their lags, 1..m_max
      type(symbol_evaluation), intent(inout) :: evaluation
      logical :: is_resolved

      if (.not. allocated(evaluation%reciprocal)) then
         allocate (evaluation%reciprocal(0:self%m_max), evaluation%gradient(0:size(cosines)))
         allocate (evaluation%curvature(0:size(cosines), 0:size(cosines)))
      end if
      do while (self%level <= n_levels)
         if (self%first_length*2**(self%level - 1) > self%longest_length) exit
         call evaluate_by_fft(self, symbol, along, cosines, evaluation, is_resolved)
         if (is_resolved .or. .not. evaluation%is_positive) return
         self%level = self%level + 1
      end do
      call evaluate_by_factor(self, symbol, along, cosines, evaluation)
   end subroutine evaluate

   !> Computes a symbol's values at the points 2 pi j/n, j = 0..n/2, n the length in use.
   subroutine values_on_circle(self, symbol, values)
      class(reciprocal_workspace), intent(inout) :: self
      real(wp), intent(in) :: symbol(0:)
      real(wp), allocatable, intent(out) :: values(:)

      call plan_level(self)
      associate (circle => self%to_circle(self%level))
         call set_symbol(circle, symbol)
         call circle%execute()
         allocate (values(0:circle%n/2))
         values(:) = circle%signal(:circle%n/2)
      end associate
   end subroutine values_on_circle

   !> Evaluates on n points of the circle, n the length in use. `is_resolved` is false where the
   !> Fourier coefficients of 1/g around lag n/2 are not negligible: others are folded back on them.
   subroutine evaluate_by_fft(self, symbol, along, cosines, evaluation, is_resolved)
      class(reciprocal_workspace), intent(inout) :: self
      real(wp), intent(in) :: symbol(0:), along(0:)
      integer, intent(in) :: cosines(:)
      type(symbol_evaluation), intent(inout) :: evaluation
      logical, intent(out) :: is_resolved
      real(wp), parameter :: folded = 1.0e-9_wp   ! at lag n/2; at n - m_max nearly its square
      real(wp), allocatable :: g(:), weight(:)
      real(wp) :: square(0:2*maxval([0, cosines])), slope(0:self%m_max)
      integer :: half, n

      is_resolved = .false.
      call self%values_on_circle(symbol, g)
      evaluation%is_positive = minval(g) > 0.0_wp
      if (.not. evaluation%is_positive) return
      half = ubound(g, 1)
      n = 2*half
      associate (lags => self%to_lags(self%level), circle => self%to_circle(self%level))
         allocate (weight(0:half))
         weight(:) = 1.0_wp/g
         call fill_evenly(lags%signal, weight)
         call lags%execute()
         evaluation%reciprocal(:) = lags%spectrum(:self%m_max)%re/n
         is_resolved = all(abs(lags%spectrum(half - self%m_max:half)%re) <= &
                           folded*lags%spectrum(0)%re)
         if (.not. is_resolved) return
         evaluation%log_mean = (sum(log(g(1:half - 1))) + 0.5_wp*(log(g(0)) + log(g(half))))/half
         if (size(cosines) > 0) then
            call fill_evenly(lags%signal, weight**2)
            call lags%execute()
            square = lags%spectrum(:ubound(square, 1))%re/n   ! of 1/g^2
         end if
         call set_symbol(circle, along)
         call circle%execute()
         call fill_evenly(lags%signal, circle%signal(:half)*weight**2)
         call lags%execute()
         slope = lags%spectrum(:self%m_max)%re/n              ! of A/g^2
      end associate
      call fill_derivatives(along, cosines, slope, square, evaluation)
   end subroutine evaluate_by_fft

   !> Computes gradient and curvature from the Fourier coefficients of 1/g, A/g^2 and 1/g^2.
   pure subroutine fill_derivatives(along, cosines, slope, square, evaluation)
      real(wp), intent(in) :: along(0:)
      integer, intent(in) :: cosines(:)
      real(wp), intent(in) :: slope(0:), square(0:)
      type(symbol_evaluation), intent(inout) :: evaluation
      integer :: i, j

      evaluation%gradient(0) = product_mean(along, evaluation%reciprocal)
      evaluation%gradient(1:) = evaluation%reciprocal(cosines)
      evaluation%curvature(0, 0) = product_mean(along, slope)
      evaluation%curvature(1:, 0) = slope(cosines)
      evaluation%curvature(0, 1:) = slope(cosines)
      do j = 1, size(cosines)
         do i = 1, size(cosines)
            evaluation%curvature(i, j) = 0.5_wp*(square(abs(cosines(i) - cosines(j))) + &
                                                 square(cosines(i) + cosines(j)))
         end do
      end do
   end subroutine fill_derivatives

   !> Mean over the circle of the product of two even functions, one of them a banded symbol.
   pure function product_mean(symbol, coefficients) result(mean)
      real(wp), intent(in) :: symbol(0:), coefficients(0:)
      real(wp) :: mean

      mean = symbol(0)*coefficients(0) + 2.0_wp*dot_product(symbol(1:), coefficients(1:))
   end function product_mean

   subroutine plan_level(self)
      class(reciprocal_workspace), intent(inout) :: self
      integer :: n

      n = self%first_length*2**(self%level - 1)
      if (self%to_circle(self%level)%n == n) return
      call self%to_circle(self%level)%prepare(n)
      call self%to_lags(self%level)%prepare(n)
   end subroutine plan_level

   subroutine set_symbol(circle, symbol)
      type(inverse_fft), intent(inout) :: circle
      real(wp), intent(in) :: symbol(0:)

      circle%spectrum = (0.0_wp, 0.0_wp)
      circle%spectrum(:ubound(symbol, 1)) = cmplx(symbol, kind=wp)
   end subroutine set_symbol

   !> Fills the circle with an even function, given on half of it.
   pure subroutine fill_evenly(signal, values)
      real(wp), intent(inout) :: signal(0:)
      real(wp), intent(in) :: values(0:)
      integer :: half

      half = ubound(values, 1)
      signal(:half) = values
      signal(half + 1:) = values(half - 1:1:-1)
   end subroutine fill_evenly

   !> Evaluates from the spectral factor B, without any sampling: the mean of ln g is 2 ln B_0.
   subroutine evaluate_by_factor(self, symbol, along, cosines, evaluation)
      class(reciprocal_workspace), intent(inout) :: self
      real(wp), intent(in) :: symbol(0:), along(0:)
      integer, intent(in) :: cosines(:)
      type(symbol_evaluation), intent(inout) :: evaluation
      real(wp), parameter :: many = 3.0e7_wp   ! products for one evaluation: some 0.01 s
      real(wp) :: reciprocal(0:2*self%m_max)

      evaluation%is_positive = symbol(0) > 0.0_wp
      if (.not. evaluation%is_positive) return
      if (.not. allocated(self%a)) then
         self%a = 0.0_wp*symbol(1:)
         self%b0 = 1.0_wp/sqrt(symbol(0))
      end if
      call factor_symbol(symbol, self%a, self%b0, evaluation%is_positive)
      if (evaluation%is_positive) &
         call reciprocal_of_process(self%a, self%b0, reciprocal, evaluation%is_positive)
      if (.not. evaluation%is_positive) then
         deallocate (self%a)
         return
      end if
      evaluation%reciprocal(:) = reciprocal(:self%m_max)
      evaluation%log_mean = -2.0_wp*log(self%b0)
      if (size(cosines)*real(self%m_max, wp)**2 < many) then
         call differentiate_factor([1.0_wp, self%a]/self%b0, reciprocal, along, cosines, evaluation)
      else
         call differentiate_square(self%a, self%b0, along, cosines, evaluation)
      end if
   end subroutine evaluate_by_factor

   !> Computes gradient and curvature from the changes of B along each direction: as exact as B.
   pure subroutine differentiate_factor(factor, reciprocal, along, cosines, evaluation)
      real(wp), intent(in) :: factor(0:)       !! B
      real(wp), intent(in) :: reciprocal(0:)   !! to twice the order
      real(wp), intent(in) :: along(0:)
      integer, intent(in) :: cosines(:)
      type(symbol_evaluation), intent(inout) :: evaluation
      real(wp) :: change(0:ubound(factor, 1), 0:size(cosines))
      real(wp) :: cosine(0:ubound(factor, 1)), image(0:ubound(factor, 1))
      integer :: i, j

      change(:, 0) = change_of_factor(factor, reciprocal, along)
      do j = 1, size(cosines)
         cosine = 0.0_wp
         cosine(cosines(j)) = 0.5_wp
         change(:, j) = change_of_factor(factor, reciprocal, cosine)
      end do
      evaluation%gradient(0) = product_mean(along, reciprocal(:ubound(along, 1)))
      evaluation%gradient(1:) = reciprocal(cosines)
      do j = 0, size(cosines)
         image = toeplitz_product(reciprocal, change(:, j))
         do i = 0, size(cosines)
            evaluation%curvature(i, j) = 2.0_wp*dot_product(change(:, i), image) &
                                         + 0.5_wp*evaluation%gradient(i)*evaluation%gradient(j)
         end do
      end do
   end subroutine differentiate_factor

   !> Symmetric Toeplitz matrix, given by its first row, times a vector.
   pure function toeplitz_product(row, x) result(y)
      real(wp), intent(in) :: row(0:), x(0:)
      real(wp) :: y(0:ubound(x, 1))
      integer :: j, n

      n = ubound(x, 1)
      y = 0.0_wp
      do j = 0, n
         y(j:) = y(j:) + x(j)*row(:n - j)
         y(:j - 1) = y(:j - 1) + x(j)*row(j:1:-1)
      end do
   end function toeplitz_product

   !> Computes gradient and curvature from 1/g^2, the spectrum of the process that has every pole of
   !> 1/g twice: cheap for many cosines, less exact where poles are very near the circle.
   pure subroutine differentiate_square(a, b0, along, cosines, evaluation)
      real(wp), intent(in) :: a(:), b0
      real(wp), intent(in) :: along(0:)
      integer, intent(in) :: cosines(:)
      type(symbol_evaluation), intent(inout) :: evaluation
      real(wp) :: factor(0:size(a)), twice(0:2*size(a)), square(0:2*size(a)), slope(0:size(a))
      integer :: i, j, order

      order = size(a)
      factor = [1.0_wp, a]
      twice = 0.0_wp
      do j = 0, order
         twice(j:j + order) = twice(j:j + order) + factor(j)*factor
      end do
      call reciprocal_of_process(twice(1:), b0**2, square, evaluation%is_positive)
      if (.not. evaluation%is_positive) return
      slope = along(0)*square(:order)
      do j = 1, order
         slope = slope + along(j)*(square(j:j + order) + [(square(abs(i - j)), i=0, order)])
      end do
      call fill_derivatives(along, cosines, slope, square, evaluation)
   end subroutine differentiate_square

end module process_direct_reciprocal_symbol
