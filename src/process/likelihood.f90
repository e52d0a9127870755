!> Restricted likelihood of measured values, and the process of a grid that has the largest.
!>
!> Candidates are the autoregressive maximum-entropy processes on a grid of L0 and order. Each one
!> gives the correlation matrix S of the measured points; points without a value are left out. With
!> the generalized least squares mean m and sigma^2 = (y - m)' S^-1 (y - m)/(n - 1), the restricted
!> likelihood of the n values y is
!>
!>    -2 ln L = (n - 1) ln sigma^2 + ln det S + ln 1' S^-1 1.                                  (1)
!>
!> The lengths of the best trial are refined by a parabola through its neighbours in ln L0.
module process_likelihood
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: multiply, solve_positive_definite, unit_matrix
   use numerics_sorting, only: sort_order
   use process_autoregressive_fit, only: equal_reflection
   use process_autoregressive_model, only: autocovariance_of
   use process_autoregressive_sums, only: correlation_sums, positive_sums
   use process_model, only: process_moments
   implicit none(type, external)
   private
   public :: correlate, fit_columns, list_trials
   public :: fit_type, piece_group, trial_type

   integer, parameter :: orders(*) = [1, 2, 3, 5, 7, 10]          !! orders of the trials
   integer, parameter :: lengths_per_decade = 12                  !! L0 of the trials
   real(wp), parameter :: shortest = 0.02_wp, longest = 20.0_wp   !! L0 of the trials [lags]
   integer, parameter, public :: n_lags_tested = 8   !! lags in the test of the correlation

   !> Pieces of records whose points have the same distances, so that they share a correlation
   !> matrix.
   type :: piece_group
      integer, allocatable :: point(:)   !! (value) distance from the first point
      integer, allocatable :: row(:)     !! (piece) row before its values in the columns of values
   end type piece_group

   !> Candidate. Those of one order stand in ascending order of L0.
   type :: trial_type
      integer :: order = 0
      real(wp) :: l0 = 0.0_wp, l1 = 0.0_wp
      real(wp), allocatable :: correlation(:)   !! K(m)/K(0), m = 0..
   end type trial_type

   !> Estimates from one column of values, and the statistics of its tests.
   type, extends(process_moments) :: fit_type
      integer :: order = 0
      real(wp) :: gain = 0.0_wp       !! -2 ln L of white noise less that of the best trial
      real(wp) :: misfit = 0.0_wp     !! correlation of the innovations (Box and Pierce, 1970)
      real(wp) :: distance = 0.0_wp   !! A^2 of the standardized values
   end type fit_type

contains

   !> Lists the trials: white noise, then every order with L0 from the shortest to the longest,
   !> as long as L1 is at most a third of the number of values. A longer correlation can hardly be
   !> distinguished from a change of the mean.
   pure subroutine list_trials(n_values, largest_lag, trials)
      integer, intent(in) :: n_values, largest_lag
      type(trial_type), allocatable, intent(out) :: trials(:)
      type(trial_type) :: trial
      type(correlation_sums) :: sums
      real(wp), allocatable :: kappa(:)
      integer :: i, k

      trial%order = 1
      allocate (trial%correlation(0:max(largest_lag, n_lags_tested)), source=0.0_wp)
      trial%correlation(0) = 1.0_wp
      trials = [trial]
      do i = 1, size(orders)
         trial%order = orders(i)
         do k = 0, nint(lengths_per_decade*log10(longest/shortest))
            trial%l0 = shortest*10.0_wp**(real(k, wp)/lengths_per_decade)
            kappa = equal_reflection(trial%l0, trial%order)
            sums = positive_sums(kappa)
            trial%l1 = sums%l1
            if (trial%l1 > n_values/3.0_wp) exit
            trial%correlation(:) = autocovariance_of(kappa, ubound(trial%correlation, 1))
            trials = [trials, trial]
         end do
      end do
   end subroutine list_trials

   !> Finds the best trial of each column by Eq. (1), and the statistics of its tests.
   subroutine fit_columns(values, groups, trials, fits, error)
      real(wp), intent(in) :: values(:, :)   !! (value, column)
      type(piece_group), intent(in) :: groups(:)
      type(trial_type), intent(in) :: trials(:)
      type(fit_type), allocatable, intent(out) :: fits(:)   !! (column)
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(trials), size(values, 2)) :: deviance, mean, variance
      real(wp), dimension(n_lags_tested) :: products, squares
      real(wp) :: residuals(size(values, 1))
      integer :: best, column, n_pairs(n_lags_tested)

      call find_deviances(values, groups, trials, deviance, mean, variance, error)
      if (allocated(error)) return
      allocate (fits(size(values, 2)))
      do column = 1, size(fits)
         best = minloc(deviance(:, column), 1)
         associate (fit => fits(column))
            fit%order = trials(best)%order
            fit%gain = deviance(1, column) - deviance(best, column)
            fit%mean = mean(best, column)
            fit%std = sqrt(variance(best, column))
            call refine_lengths(trials, best, deviance(:, column), fit%l0, fit%l1)
            residuals = (values(:, column) - fit%mean)/fit%std
            fit%distance = anderson_darling(residuals)
            call whiten(groups, trials(best)%correlation, residuals, error)
            if (allocated(error)) return
            call correlate(residuals, groups, products, squares, n_pairs)
            fit%misfit = sum(products**2/max(n_pairs, 1))
         end associate
      end do
   end subroutine fit_columns

   !> Computes -2 ln L of Eq. (1) for each trial and column, with its mean and variance. The sum of
   !> y' S^-1 y over the pieces y of a group is the trace of S^-1 (sum of y y').
   subroutine find_deviances(values, groups, trials, deviance, mean, variance, error)
      real(wp), intent(in) :: values(:, :)       !! (value, column)
      type(piece_group), intent(in) :: groups(:)
      type(trial_type), intent(in) :: trials(:)
      real(wp), intent(out) :: deviance(:, :), mean(:, :), variance(:, :)   !! (trial, column)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: inverse(:, :), s(:, :), y(:, :)
      real(wp), allocatable :: inverses(:, :), moments(:, :)   ! S^-1 (entry, trial), sum of y y'
      real(wp), allocatable :: inverse_sums(:, :), value_sums(:, :)   ! S^-1 1, sum of y
      real(wp), dimension(size(trials), size(values, 2)) :: one_group, products, squares
      real(wp), dimension(size(trials)) :: ln_det, ones
      real(wp) :: origin
      integer :: c, column, i, k, n

      n = size(values, 2)
      origin = values(1, 1)   ! near the mean, against cancellation
      ones = 0.0_wp
      ln_det = 0.0_wp
      products = 0.0_wp
      squares = 0.0_wp
      do i = 1, size(groups)
         associate (m => size(groups(i)%point), row => groups(i)%row)
            allocate (inverse_sums(m, size(trials)), value_sums(m, n), &
                      inverses(m*m, size(trials)), moments(m*m, n))
            do column = 1, n
               y = reshape([(values(row(k) + 1:row(k) + m, column) - origin, k=1, size(row))], &
                           [m, size(row)])
               value_sums(:, column) = sum(y, 2)
               moments(:, column) = reshape(matmul(y, transpose(y)), [m*m])
            end do
            do c = 1, size(trials)
               s = correlation_matrix(groups(i)%point, trials(c)%correlation)
               inverse = unit_matrix(m)
               call solve_positive_definite(s, inverse, error)   ! leaves its Cholesky factor in s
               if (allocated(error)) return
               inverses(:, c) = reshape(inverse, [m*m])
               inverse_sums(:, c) = sum(inverse, 2)
               ln_det(c) = ln_det(c) + 2.0_wp*size(row)*sum([(log(s(k, k)), k=1, m)])
               ones(c) = ones(c) + size(row)*sum(inverse)
            end do
            call multiply(inverse_sums, value_sums, one_group, transposes_a=.true.)
            products = products + one_group
            call multiply(inverses, moments, one_group, transposes_a=.true.)
            squares = squares + one_group
            deallocate (inverse_sums, inverses, moments, value_sums)
         end associate
      end do
      mean = origin + products/spread(ones, 2, n)
      variance = (squares - products**2/spread(ones, 2, n))/(size(values, 1) - 1)
      deviance = (size(values, 1) - 1)*log(variance) + spread(ln_det + log(ones), 2, n)
   end subroutine find_deviances

   !> Correlation matrix S (point, point) of the points of a piece.
   pure function correlation_matrix(point, correlation) result(s)
      integer, intent(in) :: point(:)
      real(wp), intent(in) :: correlation(0:)   !! K(m)/K(0)
      real(wp) :: s(size(point), size(point))
      integer :: j

      do j = 1, size(point)
         s(:, j) = correlation(abs(point - point(j)))
      end do
   end function correlation_matrix

   !> Turns standardized values x into innovations L^-1 x, S = L L', which are uncorrelated and of
   !> variance 1 if x has the correlation S.
   subroutine whiten(groups, correlation, x, error)
      type(piece_group), intent(in) :: groups(:)
      real(wp), intent(in) :: correlation(0:)   !! K(m)/K(0)
      real(wp), intent(inout) :: x(:)           !! (value)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: s(:, :), solved(:, :)   ! solved: (value, piece)
      integer :: i, j, k

      do i = 1, size(groups)
         associate (m => size(groups(i)%point), row => groups(i)%row)
            s = correlation_matrix(groups(i)%point, correlation)
            solved = reshape([(x(row(k) + 1:row(k) + m), k=1, size(row))], [m, size(row)])
            call solve_positive_definite(s, solved, error)   ! leaves its Cholesky factor in s
            if (allocated(error)) return
            do k = 1, size(row)   ! L' S^-1 x
               x(row(k) + 1:row(k) + m) = [(dot_product(s(j:, j), solved(j:, k)), j=1, m)]
            end do
         end associate
      end do
   end subroutine whiten

   !> Refines L0 and L1 by a parabola through the best trial and its neighbours of the same
   !> order. At an end of the grid they are those of the best trial.
   pure subroutine refine_lengths(trials, best, deviance, l0, l1)
      type(trial_type), intent(in) :: trials(:)
      integer, intent(in) :: best
      real(wp), intent(in) :: deviance(:)
      real(wp), intent(out) :: l0, l1
      real(wp) :: below, above, shift
      integer :: neighbour

      l0 = trials(best)%l0
      l1 = trials(best)%l1
      if (best < 3 .or. best == size(trials)) return
      if (trials(best - 1)%order /= trials(best + 1)%order) return
      below = deviance(best - 1) - deviance(best)
      above = deviance(best + 1) - deviance(best)
      if (.not. below + above > 0.0_wp) return
      shift = 0.5_wp*(below - above)/(below + above)
      neighbour = best + merge(1, -1, shift > 0.0_wp)
      l0 = l0*(trials(neighbour)%l0/l0)**abs(shift)
      l1 = l1*(trials(neighbour)%l1/l1)**abs(shift)
   end subroutine refine_lengths

   !> Computes sums over the pairs of values at lags 1 to n_lags_tested, and the number of pairs.
   pure subroutine correlate(x, groups, products, squares, n_pairs)
      real(wp), intent(in) :: x(:)   !! (value)
      type(piece_group), intent(in) :: groups(:)
      real(wp), dimension(n_lags_tested), intent(out) :: products   !! sums of products
      real(wp), dimension(n_lags_tested), intent(out) :: squares    !! sums of mean squares
      integer, intent(out) :: n_pairs(n_lags_tested)
      integer :: i, j, k, lag

      products = 0.0_wp
      squares = 0.0_wp
      n_pairs = 0
      do i = 1, size(groups)
         associate (point => groups(i)%point, row => groups(i)%row)
            do j = 1, size(point)
               do k = j + 1, size(point)
                  lag = point(k) - point(j)
                  if (lag > n_lags_tested) exit
                  products(lag) = products(lag) + sum(x(row + j)*x(row + k))
                  squares(lag) = squares(lag) + 0.5_wp*sum(x(row + j)**2 + x(row + k)**2)
                  n_pairs(lag) = n_pairs(lag) + size(row)
               end do
            end do
         end associate
      end do
   end subroutine correlate

   !> Distance A^2 of the values from a standard normal law (Anderson and Darling, 1952).
   pure function anderson_darling(x) result(distance)
      real(wp), intent(in) :: x(:)   !! (value) standardized
      real(wp) :: distance
      real(wp) :: below(size(x)), above(size(x))   ! ln of the probability below and above
      integer :: i, n

      n = size(x)
      associate (ascending => x(sort_order(x)))
         below = log(max(0.5_wp*erfc(-ascending/sqrt(2.0_wp)), tiny(1.0_wp)))
         above = log(max(0.5_wp*erfc(ascending/sqrt(2.0_wp)), tiny(1.0_wp)))
      end associate
      distance = -n - sum([((2*i - 1)*(below(i) + above(n + 1 - i)), i=1, n)])/n
   end function anderson_darling

end module process_likelihood
