!> Estimates of statistics with the influence of each sample on them, from which their standard
!> errors follow; and those of plain sampling. Formulas (4), (10) and (11) of docs/regression.md.
module statistics_estimates
   use core_kinds, only: two_pi, wp
   use numerics_sorting, only: sort_order
   use statistics_percentiles, only: at_rank
   implicit none(type, external)
   private
   public :: downward_error, estimates_type, is_near_samples, limit_beyond_samples, &
             nonnegative_statistic, normal_95, numbers_of_statistic, &
             plain_deviation, plain_mean, plain_percentile, sort_percentiles, stated_error, &
             statistic_type, student_factor, upward_error

   real(wp), parameter :: normal_95 = 1.959964_wp   !! half of a normal 95 % interval, over sigma
   real(wp), parameter :: least_stretch = 0.5_wp    !! lower limit of stretch, where samples tie
   real(wp), parameter :: fewest_degrees = 3.0_wp   !! lower limit of the degrees of freedom
   !> largest extrapolation of a law without samples that has an estimate, formula (14)
   real(wp), parameter :: most_extrapolation = 5.0_wp

   !> Statistic over the samples of a case, with its standard error or, for a percentile, its 95 %
   !> interval.
   type :: statistic_type
      real(wp) :: value = 0.0_wp
      real(wp) :: error = 0.0_wp                   !! standard error
      real(wp) :: low = 0.0_wp, high = 0.0_wp      !! ends of the interval
      !> plain sampling's error over this one; of a law without samples its extrapolation
      real(wp) :: ratio = 1.0_wp
   end type statistic_type
   integer, parameter :: numbers_of_statistic = storage_size(statistic_type())/storage_size(1.0_wp)

   !> Estimates of one statistic for several outputs, from the same samples.
   type :: estimates_type
      real(wp), allocatable :: value(:)          !! (output)
      real(wp), allocatable :: influence(:, :)   !! (sample, output) of formula (4)
      real(wp), allocatable :: bias(:)           !! (output) estimate of value minus truth
      real(wp), allocatable :: kappa(:)          !! (output) of formula (7)
      !> (output) of a percentile by a fit: 1/density of G there
      real(wp), allocatable :: inverse_density(:)
      !> (fit or plain sampling, output) factor on the influences for tails of the law that the
      !> samples lack, formula (8); unallocated: 1
      real(wp), allocatable :: tail_factor(:, :)
      !> (down or up, output) length of either side of an interval over that of a normal law with
      !> this standard error; unallocated: 1
      real(wp), allocatable :: stretch(:, :)
      !> (output) blended estimates alone: weight of plain sampling; standard error; plain
      !> sampling's standard error over it
      real(wp), allocatable :: share(:), error(:), ratio(:)
   end type estimates_type

contains

   !> True if a statistic of a law without samples is near enough to them for an estimate.
   elemental logical function is_near_samples(statistic)
      type(statistic_type), intent(in) :: statistic

      is_near_samples = statistic%ratio <= most_extrapolation
   end function is_near_samples

   !> Mean over the samples.
   pure type(estimates_type) function plain_mean(y) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output)

      plain = zero_estimates(size(y, 1), size(y, 2))
      plain%value(:) = sum(y, 1)/size(y, 1)
      plain%influence(:, :) = (y - spread(plain%value, 1, size(y, 1)))/size(y, 1)
   end function plain_mean

   !> Standard deviation over the samples, with n - 1 in the denominator.
   pure type(estimates_type) function plain_deviation(y) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output), two samples or more
      real(wp) :: square(size(y, 1)), variance
      integer :: o

      plain = zero_estimates(size(y, 1), size(y, 2))
      do o = 1, size(y, 2)
         square = (y(:, o) - sum(y(:, o))/size(y, 1))**2
         variance = sum(square)/(size(y, 1) - 1)
         if (.not. variance > 0.0_wp) cycle
         plain%value(o) = sqrt(variance)
         plain%influence(:, o) = (square - sum(square)/size(y, 1)) &
                                 /(2.0_wp*plain%value(o)*(size(y, 1) - 1))
      end do
   end function plain_deviation

   !> Percentile over the samples, interpolated between order statistics (Hyndman and Fan, type 7).
   !> The rank has the standard deviation r = sqrt(p (1 - p) n) of the binomial law. The density
   !> follows from the order statistics r ranks below and above; the interval ends at those 1.96 r
   !> ranks away or, without such samples, 1.96 standard errors times Student's factor away. Where
   !> the rank's scatter leaves the samples they do not show the density: the error on this side
   !> reaches to the tolerance limit of a normal law.
   pure type(estimates_type) function plain_percentile(y, p, ranking) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output)
      real(wp), intent(in) :: p         !! share of the law below the percentile
      integer, intent(in), optional :: ranking(:, :)   !! (rank, output) samples; else computed
      real(wp) :: sorted(size(y, 1)), factor, rank, reach(2), shift, scatter, slope, square
      logical :: is_below(size(y, 1))
      logical :: has_ends(2)      ! order statistics exist where the interval ends
      logical :: has_density(2)   ! and one scatter of the rank away
      integer :: n, o

      n = size(y, 1)
      plain = zero_estimates(n, size(y, 2))
      allocate (plain%stretch(2, size(y, 2)), source=1.0_wp)
      rank = 1.0_wp + p*(n - 1)
      scatter = sqrt(p*(1.0_wp - p)*n)
      shift = min(scatter, rank - 1.0_wp, n - rank)
      has_ends = [rank - normal_95*scatter >= 1.0_wp, rank + normal_95*scatter <= n]
      has_density = [rank - scatter >= 1.0_wp, rank + scatter <= n]
      do o = 1, size(y, 2)
         if (present(ranking)) then
            sorted = y(ranking(:, o), o)
         else
            sorted = y(sort_order(y(:, o)), o)
         end if
         plain%value(o) = at_rank(sorted, rank)
         slope = slope_between(sorted, rank - scatter, rank + scatter)
         is_below = y(:, o) <= plain%value(o)
         if (all(is_below)) is_below = y(:, o) < plain%value(o)   ! some equal the largest
         plain%influence(:, o) = slope*merge(p - 1.0_wp, p, is_below)
         plain%influence(:, o) = plain%influence(:, o) - sum(plain%influence(:, o))/n
         ! a share rank/(n + 1) of the law is expected below an order statistic, and not p; its
         ! scatter r/n makes a further bias, half of the quantile's second derivative times r^2
         plain%bias(o) = n*slope*(rank/(n + 1) - p)
         if (shift > 0.0_wp) plain%bias(o) = plain%bias(o) + 0.5_wp*(scatter/shift)**2 &
                                             *(at_rank(sorted, rank + shift) - plain%value(o) &
                                               + at_rank(sorted, rank - shift) - plain%value(o))
         square = sum_of_squares(plain%influence(:, o))
         if (.not. square > 0.0_wp) cycle
         factor = 1.0_wp/student_factor(effective_degrees(plain%influence(:, o), square))
         plain%stretch(:, o) = max(least_stretch, merge(factor, 1.0_wp, has_ends) &
                                   *[slope_between(sorted, rank - normal_95*scatter, rank), &
                                     slope_between(sorted, rank, rank + normal_95*scatter)]/slope)
         if (all(has_density)) cycle
         reach = [-1.0_wp, 1.0_wp]*(tolerance_limits(sorted, p) - plain%value(o)) &
                 /(normal_95*stated_error(plain%influence(:, o), 0.0_wp, n))
         plain%stretch(:, o) = merge(plain%stretch(:, o), max(plain%stretch(:, o), reach), &
                                     has_density)
         factor = max(1.0_wp, maxval(reach, mask=.not. has_density))
         plain%influence(:, o) = factor*plain%influence(:, o)
         plain%stretch(:, o) = max(least_stretch, plain%stretch(:, o)/factor)
      end do
   end function plain_percentile

   !> Sorts estimates of ascending percentiles, and the ends of their intervals, into ascending
   !> order, which reduces their errors (Chernozhukov, Fernandez-Val and Galichon 2010).
   pure subroutine sort_percentiles(percentiles)
      type(statistic_type), intent(inout) :: percentiles(:)

      percentiles%value = percentiles(sort_order(percentiles%value))%value
      percentiles%low = percentiles(sort_order(percentiles%low))%low
      percentiles%high = percentiles(sort_order(percentiles%high))%high
   end subroutine sort_percentiles

   !> End of a percentile's interval where no order statistic is far enough out. The values are not
   !> negative; their roots have two limits, of which the farther one is taken: 1.96 standard errors
   !> times Student's factor away, and the tolerance limit of a normal law.
   pure real(wp) function limit_beyond_samples(sorted, p, is_upper) result(value)
      real(wp), intent(in) :: sorted(:)   !! ascending
      real(wp), intent(in) :: p           !! share of the law below the percentile
      logical, intent(in) :: is_upper
      type(estimates_type) :: root
      real(wp) :: limits(2), shift
      integer :: i, n

      n = size(sorted)
      root = plain_percentile(reshape(sqrt(sorted), [n, 1]), p, reshape([(i, i=1, n)], [n, 1]))
      shift = normal_95*stated_error(root%influence(:, 1), 0.0_wp, n)
      limits = tolerance_limits(sqrt(sorted), p)
      if (is_upper) then
         value = max(sorted(n), max(root%value(1) + shift*root%stretch(2, 1), limits(2))**2)
      else
         value = min(sorted(1), max(0.0_wp, min(root%value(1) - shift*root%stretch(1, 1), &
                                                limits(1)))**2)
      end if
   end function limit_beyond_samples

   !> Lower and upper tolerance limit of a normal law for the share p below a percentile.
   pure function tolerance_limits(values, p) result(limits)
      real(wp), intent(in) :: values(:), p
      real(wp) :: limits(2)
      real(wp) :: centre, scatter

      associate (n => size(values))
         centre = sum(values)/n
         scatter = sqrt(sum((values - centre)**2)/(n - 1))
         limits = centre + scatter*[-tolerance_factor(n, 1.0_wp - p), tolerance_factor(n, p)]
      end associate
   end function tolerance_limits

   !> Factor k of a one-sided normal tolerance limit: a share p of the law lies below mean + k std,
   !> both of n values, with probability 0.975 (Natrella 1963, 2-13). For n = 2 that of 3.
   pure real(wp) function tolerance_factor(n, p)
      integer, intent(in) :: n
      real(wp), intent(in) :: p
      real(wp) :: a, b, z

      z = normal_point(p)
      a = 1.0_wp - normal_95**2/(2*max(n - 1, 2))
      b = z**2 - normal_95**2/n
      tolerance_factor = (z + sqrt(z**2 - a*b))/a
   end function tolerance_factor

   !> Quantile of the standard normal law at probability p: Newton's iteration from 0, which
   !> approaches it from one side because the tail of the law is convex.
   pure real(wp) function normal_point(p)
      real(wp), intent(in) :: p
      real(wp), parameter :: small_step = 1.0e-9_wp   ! the next one is of the order of its square
      real(wp) :: step

      normal_point = 0.0_wp
      do
         step = (0.5_wp*erfc(normal_point/sqrt(2.0_wp)) - min(p, 1.0_wp - p)) &
                *sqrt(two_pi)*exp(0.5_wp*normal_point**2)
         normal_point = normal_point + step
         if (step <= small_step) exit
      end do
      if (p < 0.5_wp) normal_point = -normal_point
   end function normal_point

   !> Mean difference of neighbouring order statistics between two ranks, which are moved into 1..n.
   pure real(wp) function slope_between(sorted, low, high)
      real(wp), intent(in) :: sorted(:), low, high
      real(wp) :: lowest, highest

      lowest = max(low, 1.0_wp)
      highest = min(high, real(size(sorted), wp))
      slope_between = (at_rank(sorted, highest) - at_rank(sorted, lowest))/(highest - lowest)
   end function slope_between

   !> Estimates that are zero, with influences and biases of zero.
   pure type(estimates_type) function zero_estimates(n, n_out) result(estimates)
      integer, intent(in) :: n, n_out   !! samples, outputs

      allocate (estimates%value(n_out), estimates%bias(n_out), source=0.0_wp)
      allocate (estimates%influence(n, n_out), source=0.0_wp)
   end function zero_estimates

   !> Standard error of one output: root of Student's factor squared times the sum of squared
   !> influences times n/(n - 1), plus the bias squared; formula (10).
   pure real(wp) function stated_error(influence, bias, n_samples) result(error)
      real(wp), intent(in), contiguous :: influence(:)   !! (sample)
      real(wp), intent(in) :: bias
      integer, intent(in) :: n_samples                   !! samples of the case
      real(wp) :: square

      square = sum_of_squares(influence)
      error = abs(bias)
      if (square > 0.0_wp) error = hypot(student_factor(effective_degrees(influence, square)) &
                                         *sqrt(square*n_samples/(n_samples - 1.0_wp)), bias)
   end function stated_error

   !> Sum of squares.
   pure real(wp) function sum_of_squares(values) result(total)
      real(wp), intent(in), contiguous :: values(:)
      integer :: i

      total = 0.0_wp
      !$omp simd reduction(+:total)
      do i = 1, size(values)
         total = total + values(i)**2
      end do
   end function sum_of_squares

   !> Effective degrees of freedom of an error, (sum of squares)^2/(sum of fourth powers).
   pure real(wp) function effective_degrees(influence, square)
      real(wp), intent(in), contiguous :: influence(:)   !! (sample), not all 0
      real(wp), intent(in) :: square                     !! sum of their squares
      real(wp) :: fourth, scale
      integer :: i

      scale = 1.0_wp/sqrt(square)
      fourth = 0.0_wp
      !$omp simd reduction(+:fourth)
      do i = 1, size(influence)
         fourth = fourth + (scale*influence(i))**4
      end do
      effective_degrees = 1.0_wp/fourth
   end function effective_degrees

   !> Standard error e' of a value that is not negative with value + 1.96 e' = value
   !> exp(1.96 error/value), the upper end of the interval of its logarithm; e'/error is at most
   !> that of error = value. Where the few large samples that carry the value are missing, it and
   !> its error are both too small. The error of a negative value stays.
   elemental real(wp) function upward_error(value, error)
      real(wp), intent(in) :: value, error
      real(wp) :: relative

      upward_error = error
      relative = normal_95*min(error, max(value, 0.0_wp))/max(value, tiny(value))
      if (relative > 0.0_wp) upward_error = error*(exp(relative) - 1.0_wp)/relative
   end function upward_error

   !> Statistic that is not negative, with the standard error of upward_error. A fit far from its
   !> samples may give a negative value: zero is nearer to the truth.
   elemental type(statistic_type) function nonnegative_statistic(value, error, ratio)
      real(wp), intent(in) :: value, error, ratio   !! as in statistic_type

      nonnegative_statistic = statistic_type(max(0.0_wp, value), upward_error(value, error), &
                                             ratio=ratio)
   end function nonnegative_statistic

   !> Standard error e' with value - 1.96 e' = value exp(-1.96 error/value).
   elemental real(wp) function downward_error(value, error)
      real(wp), intent(in) :: value, error

      downward_error = value*(1.0_wp - exp(-normal_95*error/max(value, tiny(value))))/normal_95
   end function downward_error

   !> Two-sided 95 % point of Student's law with v degrees of freedom over that of the normal law:
   !> expansion to 1/v^3 of Abramowitz and Stegun 26.7.5, 3 % too small at v = 3.
   elemental real(wp) function student_factor(degrees)
      real(wp), intent(in) :: degrees
      real(wp) :: v

      v = max(degrees, fewest_degrees)
      associate (z => normal_95)
         student_factor = 1.0_wp + (z**2 + 1.0_wp)/(4*v) + (5*z**4 + 16*z**2 + 3.0_wp)/(96*v**2) &
                          + (3*z**6 + 19*z**4 + 17*z**2 - 15.0_wp)/(384*v**3)
      end associate
   end function student_factor

end module statistics_estimates
