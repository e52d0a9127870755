!> Estimates that know what each sample contributes to their error, and those of plain sampling:
!> formulas (4), (10) and (11) of docs/regression.md.
module statistics_estimates
   use core_kinds, only: wp
   use numerics_sorting, only: sort_order
   use statistics_order, only: at_rank
   implicit none(type, external)
   private
   public :: statistic_type, numbers_of_statistic, estimates_type, blank_estimates, &
             downward_error, end_beyond, inverse_density, plain_deviation, plain_mean, &
             plain_percentile, stated_error, student_factor, two_sided, uncross, upward_error

   real(wp), parameter :: two_sided = 1.959964_wp   !! standard errors of a 95 % interval
   real(wp), parameter :: least_stretch = 0.5_wp   !! where samples tie; a blend with a fit does not
   real(wp), parameter :: largest_relative = 1.0_wp    !! error that is taken as one of a logarithm
   real(wp), parameter :: fewest_freedoms = 3.0_wp     !! of Student's law

   !> A statistic over the samples of a case, with what is known of its error: a standard error, or,
   !> of a percentile, a 95 % interval.
   type :: statistic_type
      real(wp) :: value = 0.0_wp
      real(wp) :: error = 0.0_wp                   !! standard error
      real(wp) :: low = 0.0_wp, high = 0.0_wp      !! ends of the interval
      real(wp) :: ratio = 1.0_wp                   !! plain sampling's error over that of value
   end type statistic_type
   integer, parameter :: numbers_of_statistic = storage_size(statistic_type())/storage_size(1.0_wp)

   !> Several outputs estimated from the same samples.
   type :: estimates_type
      real(wp), allocatable :: value(:)          !! (output)
      real(wp), allocatable :: influence(:, :)   !! (sample, output)
      real(wp), allocatable :: bias(:)           !! (output) allowance for value minus truth
      real(wp), allocatable :: kappa(:)          !! (output) influences are divided by kappa^(1/4)
      !> (fit or plain sampling, output) by how much the influences are too small where the samples
      !> lack a tail of the law that the fit knows; absent: 1
      real(wp), allocatable :: excess(:, :)
      !> (down or up, output) how far an interval reaches, over what the standard error says;
      !> absent: 1
      real(wp), allocatable :: stretch(:, :)
      !> (output) of a join: plain sampling's share; standard error, plain sampling's over it
      real(wp), allocatable :: share(:), stated(:), ratio(:)
   end type estimates_type

contains

   !> Mean over samples.
   pure function plain_mean(y) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output)
      type(estimates_type) :: plain
      integer :: o

      plain = blank_estimates(size(y, 1), size(y, 2))
      do o = 1, size(y, 2)
         plain%value(o) = sum(y(:, o))/size(y, 1)
         plain%influence(:, o) = (y(:, o) - plain%value(o))/size(y, 1)
      end do
   end function plain_mean

   !> Standard deviation, n - 1 in the denominator.
   pure function plain_deviation(y) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output), two samples or more
      type(estimates_type) :: plain
      real(wp) :: square(size(y, 1)), variance
      integer :: o

      plain = blank_estimates(size(y, 1), size(y, 2))
      do o = 1, size(y, 2)
         square = (y(:, o) - sum(y(:, o))/size(y, 1))**2
         variance = sum(square)/(size(y, 1) - 1)
         if (.not. variance > 0.0_wp) cycle
         plain%value(o) = sqrt(variance)
         plain%influence(:, o) = (square - sum(square)/size(y, 1)) &
                                 /(2.0_wp*plain%value(o)*(size(y, 1) - 1))
      end do
   end function plain_deviation

   !> Percentile between order statistics (Hyndman and Fan, type 7). The density comes from those
   !> one binomial standard deviation of the rank to both sides; the interval ends at those
   !> two-sided 95 % of it away; where there are none, at as many standard errors with Student's
   !> factor.
   pure function plain_percentile(y, p, ranking) result(plain)
      real(wp), intent(in) :: y(:, :)   !! (sample, output)
      real(wp), intent(in) :: p         !! share of the law below
      integer, intent(in), optional :: ranking(:, :)   !! (rank, output) samples, where known
      type(estimates_type) :: plain
      real(wp) :: sorted(size(y, 1)), factor, rank, reach, scatter, slope
      logical :: has_ends(2)   ! order statistics where the interval ends
      integer :: n, o

      n = size(y, 1)
      plain = blank_estimates(n, size(y, 2))
      allocate (plain%stretch(2, size(y, 2)), source=1.0_wp)
      rank = 1.0_wp + p*(n - 1)
      scatter = sqrt(p*(1.0_wp - p)*n)
      reach = min(scatter, rank - 1.0_wp, n - rank)
      has_ends = [rank - two_sided*scatter >= 1.0_wp, rank + two_sided*scatter <= n]
      do o = 1, size(y, 2)
         if (present(ranking)) then
            sorted = y(ranking(:, o), o)
         else
            sorted = y(sort_order(y(:, o)), o)
         end if
         plain%value(o) = at_rank(sorted, rank)
         slope = slope_between(sorted, rank - scatter, rank + scatter)
         plain%influence(:, o) = slope*merge(p - 1.0_wp, p, y(:, o) <= plain%value(o))
         plain%influence(:, o) = plain%influence(:, o) - sum(plain%influence(:, o))/n
         ! the law's share below the order statistic of a rank is rank/(n + 1) in the mean; that
         ! scatters, and the quantile bends
         plain%bias(o) = n*slope*(rank/(n + 1) - p)
         if (reach > 0.0_wp) plain%bias(o) = plain%bias(o) + 0.5_wp*(scatter/reach)**2 &
                                             *(at_rank(sorted, rank + reach) - plain%value(o) &
                                               + at_rank(sorted, rank - reach) - plain%value(o))
         if (.not. slope > 0.0_wp) cycle
         factor = 1.0_wp/student_factor(freedoms_of(plain%influence(:, o), &
                                                    sum_of_squares(plain%influence(:, o))))
         plain%stretch(:, o) = max(least_stretch, merge(factor, 1.0_wp, has_ends) &
                                   *[slope_between(sorted, rank - two_sided*scatter, rank), &
                                     slope_between(sorted, rank, rank + two_sided*scatter)]/slope)
      end do
   end function plain_percentile

   !> Puts estimates of ascending percentiles, and the ends of their intervals, into ascending
   !> order: that brings them nearer to the truth (Chernozhukov, Fernandez-Val and Galichon 2010).
   pure subroutine uncross(percentiles)
      type(statistic_type), intent(inout) :: percentiles(:)

      associate (value => percentiles%value, low => percentiles%low, high => percentiles%high)
         value = value(sort_order(value))
         low = low(sort_order(low))
         high = high(sort_order(high))
      end associate
   end subroutine uncross

   !> End of the interval of a percentile of numbers that are not negative where no order statistic
   !> is far enough out. Of their roots it is the farther of two: as many standard errors away, with
   !> Student's factor; and the tolerance limit of a normal law.
   pure function end_beyond(sorted, p, is_upper) result(value)
      real(wp), intent(in) :: sorted(:)   !! ascending
      real(wp), intent(in) :: p           !! share of the law below
      logical, intent(in) :: is_upper
      real(wp) :: value
      type(estimates_type) :: root
      real(wp) :: centre, limit, reach, scatter
      integer :: i, n

      n = size(sorted)
      root = plain_percentile(reshape(sqrt(sorted), [n, 1]), p, reshape([(i, i=1, n)], [n, 1]))
      reach = two_sided*stated_error(root%influence(:, 1), 0.0_wp, n)
      centre = sum(sqrt(sorted))/n
      scatter = sqrt(sum((sqrt(sorted) - centre)**2)/(n - 1))
      limit = scatter*tolerance_factor(n, merge(p, 1.0_wp - p, is_upper))
      if (is_upper) then
         value = max(sorted(n), max(root%value(1) + reach*root%stretch(2, 1), centre + limit)**2)
      else
         value = min(sorted(1), max(0.0_wp, min(root%value(1) - reach*root%stretch(1, 1), &
                                                centre - limit))**2)
      end if
   end function end_beyond

   !> Standard deviations of n normal values from their mean to the limit below which the share p of
   !> their law lies with probability 0.975 (Natrella 1963, 2-13); for n = 2 as for 3.
   pure real(wp) function tolerance_factor(n, p)
      integer, intent(in) :: n
      real(wp), intent(in) :: p
      real(wp) :: a, b, z

      z = normal_point(p)
      a = 1.0_wp - two_sided**2/(2*max(n - 1, 2))
      b = z**2 - two_sided**2/n
      tolerance_factor = (z + sqrt(z**2 - a*b))/a
   end function tolerance_factor

   !> The value below which the share p of the normal law lies, to 4.5e-4 (Abramowitz and Stegun
   !> 26.2.23).
   pure real(wp) function normal_point(p)
      real(wp), intent(in) :: p
      real(wp) :: t

      t = sqrt(-2.0_wp*log(min(p, 1.0_wp - p)))
      normal_point = t - (2.515517_wp + t*(0.802853_wp + t*0.010328_wp)) &
                     /(1.0_wp + t*(1.432788_wp + t*(0.189269_wp + t*0.001308_wp)))
      if (p < 0.5_wp) normal_point = -normal_point
   end function normal_point

   !> Mean difference of neighbouring order statistics between two ranks, as far as there are any.
   pure real(wp) function slope_between(sorted, low, high)
      real(wp), intent(in) :: sorted(:), low, high
      real(wp) :: first, last

      first = max(low, 1.0_wp)
      last = min(high, real(size(sorted), wp))
      slope_between = (at_rank(sorted, last) - at_rank(sorted, first))/(last - first)
   end function slope_between

   !> Estimates of zero without errors.
   pure function blank_estimates(n, n_out) result(blank)
      integer, intent(in) :: n, n_out   !! samples, outputs
      type(estimates_type) :: blank

      allocate (blank%value(n_out), blank%bias(n_out), source=0.0_wp)
      allocate (blank%influence(n, n_out), source=0.0_wp)
   end function blank_estimates

   !> 1/density at a percentile, from the influences of plain sampling on it.
   pure real(wp) function inverse_density(influence, n_samples, p)
      real(wp), intent(in), contiguous :: influence(:)   !! (sample)
      integer, intent(in) :: n_samples                   !! of the case
      real(wp), intent(in) :: p                          !! share of the law below

      inverse_density = sqrt(n_samples*sum_of_squares(influence)/(p*(1.0_wp - p)))
   end function inverse_density

   !> Standard error of one output.
   pure function stated_error(influence, bias, n_samples) result(error)
      real(wp), intent(in), contiguous :: influence(:)   !! (sample)
      real(wp), intent(in) :: bias
      integer, intent(in) :: n_samples                   !! of the case
      real(wp) :: error
      real(wp) :: square

      square = sum_of_squares(influence)
      error = abs(bias)
      if (square > 0.0_wp) error = hypot(student_factor(freedoms_of(influence, square)) &
                                         *sqrt(square*n_samples/(n_samples - 1.0_wp)), bias)
   end function stated_error

   !> Sum of squares, in whole vectors.
   pure real(wp) function sum_of_squares(values) result(total)
      real(wp), intent(in), contiguous :: values(:)
      integer :: i

      total = 0.0_wp
      !$omp simd reduction(+:total)
      do i = 1, size(values)
         total = total + values(i)**2
      end do
   end function sum_of_squares

   !> Degrees of freedom of an error: (sum of squares)^2/(sum of fourth powers).
   pure real(wp) function freedoms_of(influence, square)
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
      freedoms_of = 1.0_wp/fourth
   end function freedoms_of

   !> The standard error of a number that is not negative, such that 1.96 of it reach as far as
   !> those of its logarithm do upwards: where the large samples that carry it are missing, the
   !> number and its error are both too small.
   elemental real(wp) function upward_error(value, error)
      real(wp), intent(in) :: value, error   !! standard
      real(wp) :: relative

      upward_error = error
      relative = two_sided*min(error, largest_relative*value)/max(value, tiny(value))
      if (relative > 0.0_wp) upward_error = error*(exp(relative) - 1.0_wp)/relative
   end function upward_error

   !> The same downwards: it is smaller.
   elemental real(wp) function downward_error(value, error)
      real(wp), intent(in) :: value, error   !! standard

      downward_error = value*(1.0_wp - exp(-two_sided*error/max(value, tiny(value))))/two_sided
   end function downward_error

   !> Two-sided 95 % point of Student's law over that of the normal one, by the expansion of Cornish
   !> and Fisher to 1/v^3 (Abramowitz and Stegun 26.7.5): 3 % low at v = 3.
   elemental real(wp) function student_factor(freedoms)
      real(wp), intent(in) :: freedoms
      real(wp) :: v

      v = max(freedoms, fewest_freedoms)
      associate (z => two_sided)
         student_factor = 1.0_wp + (z**2 + 1.0_wp)/(4*v) + (5*z**4 + 16*z**2 + 3.0_wp)/(96*v**2) &
                          + (3*z**6 + 19*z**4 + 17*z**2 - 15.0_wp)/(384*v**3)
      end associate
   end function student_factor

end module statistics_estimates
