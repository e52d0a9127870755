!> Statistics of a response over a friction law, from a fit to few samples and many points of the
!> law, with the influence of each sample: formulas (4) and (5) of docs/regression.md.
module statistics_regression
   use core_kinds, only: wp
   use numerics_elementary, only: exponentiate
   use numerics_lapack, only: multiply
   use statistics_estimates, only: estimates_type
   use statistics_influences, only: excess_of, find_weights, kappa_of, scale_influences, thinning, &
                                    view_type, weigh_residuals, width_of, width_of_densities
   use statistics_percentiles, only: find_quantile
   use statistics_surrogate, only: average_features, fit_type, predict_variance, surrogate_type
   implicit none(type, external)
   private
   public :: law_deviation, law_mean, law_mean_of_exponential, law_percentile

   real(wp), parameter :: window = 0.01_wp         !! of ranks about a percentile
   real(wp), parameter :: share_of_near = 0.08_wp  !! of a case's samples, on either side
   integer, parameter :: least_near = 4
   integer, parameter :: most_in_window = 24       !! points whose features are averaged
   real(wp), parameter :: largest = 1.0_wp         !! v/2 that is allowed for
   !> of the way to the mean of exp(G + v/2), which is too large where the noise is
   real(wp), parameter :: share_of_variance = 0.25_wp

contains

   !> Estimates the mean half way between that of G and that plus the mean of what G leaves of the
   !> case's own samples, with half of their difference as bias. A case alone has no such rest.
   subroutine law_mean(surrogate, fit, view, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: average_row(size(view%rows, 1), 1)
      real(wp) :: average(size(surrogate%eigenvalue), size(fit%mean))
      real(wp) :: of_own(size(surrogate%eigenvalue))   ! average over own samples
      integer :: n, o

      n = view%last - view%first + 1
      average_row(:, 1) = matmul(view%rows, view%weight)
      call average_features(surrogate, average_row, 1.0_wp, average(:, 1:1))
      of_own = sum(surrogate%feature(view%first:view%last, :), 1)/n
      estimate%value = fit%mean + matmul(average(:, 1), fit%coefficient)
      estimate%bias = -0.5_wp*(fit%mean + matmul(of_own, fit%coefficient))
      do o = 1, size(fit%mean)
         estimate%bias(o) = estimate%bias(o) &
                            + 0.5_wp*sum(fit%predicted(view%first:view%last, o) &
                                         + fit%residual(view%first:view%last, o))/n
      end do
      estimate%value = estimate%value + estimate%bias
      average = spread(average(:, 1) - 0.5_wp*of_own, 2, size(average, 2))
      call find_weights(surrogate, fit, average, 0.5_wp, estimate%influence)
      estimate%influence(view%first:view%last, :) = &
         estimate%influence(view%first:view%last, :) + 0.5_wp/n
      call weigh_residuals(surrogate, fit, estimate)
      allocate (estimate%excess(2, size(fit%mean)))
      do o = 1, size(fit%mean)
         estimate%excess(:, o) = &
            excess_of(width_of(view, values(:, o), fit%predicted(:, o))**2, estimate%kappa(o))
      end do
   end subroutine law_mean

   !> Estimates the standard deviation by that of G plus the case's own residuals; half of what
   !> they add is allowed for as bias.
   subroutine law_deviation(surrogate, fit, view, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: of_rows(size(view%rows, 1), size(values, 2))
      real(wp) :: covariance(size(surrogate%eigenvalue), size(values, 2))
      real(wp) :: of_values(size(values, 2)), of_residuals(size(values, 2))
      real(wp) :: centred(size(values, 1)), residual(view%last - view%first + 1)
      integer :: o

      do o = 1, size(values, 2)
         centred = values(:, o) - dot_product(view%weight, values(:, o))
         of_values(o) = dot_product(view%weight, centred**2)   ! to the digits of a small scatter
         of_rows(:, o) = matmul(view%rows, view%weight*centred)
      end do
      call average_features(surrogate, of_rows, 0.0_wp, covariance)
      call find_weights(surrogate, fit, covariance, 0.0_wp, estimate%influence)
      call weigh_residuals(surrogate, fit, estimate)
      allocate (estimate%value(size(values, 2)), estimate%excess(2, size(values, 2)))
      allocate (estimate%bias, mold=estimate%value)
      do o = 1, size(values, 2)
         associate (own => fit%predicted(view%first:view%last, o))
            estimate%excess(:, o) = &
               excess_of(width_of(view, &
                                  (values(:, o) - dot_product(view%weight, values(:, o)))**2, &
                                  (fit%predicted(:, o) - sum(own)/size(own))**2)**2, &
                         estimate%kappa(o))
         end associate
         residual = fit%residual(view%first:view%last, o)
         residual = (residual - sum(residual)/size(residual))**2
         of_residuals(o) = sum(residual)/size(residual)
         estimate%value(o) = sqrt(max(of_values(o) + of_residuals(o), tiny(1.0_wp)))
         estimate%bias(o) = 0.5_wp*(estimate%value(o) - sqrt(of_values(o)))
         associate (own => estimate%influence(view%first:view%last, o))
            own = own + 0.5_wp*(residual - of_residuals(o))/size(residual)
         end associate
         estimate%influence(:, o) = estimate%influence(:, o)/estimate%value(o)
      end do
   end subroutine law_deviation

   !> Estimates a percentile half way between that of G and that of G plus residuals of samples
   !> predicted near it; half of their difference is allowed for as bias.
   subroutine law_percentile(surrogate, fit, view, values, width, p, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      real(wp), intent(in) :: width(:, :)     !! (2, output) of G, by width_of
      real(wp), intent(in) :: p               !! share of the law below
      type(estimates_type), intent(out) :: estimate
      real(wp) :: average_row(size(view%rows, 1), size(values, 2))
      real(wp) :: average(size(surrogate%eigenvalue), size(values, 2)), smeared(size(values, 1))
      integer :: near(2*half_of_near(view), size(values, 2)), o
      real(wp) :: residual(size(near, 1)), bare, full
      integer, allocatable :: around(:)

      allocate (estimate%value(size(values, 2)), estimate%bias(size(values, 2)))
      allocate (estimate%excess, mold=width)
      do o = 1, size(values, 2)
         call find_quantile(values(:, o), view%weight, p, window, bare, around)
         average_row(:, o) = mean_of_some(view%rows, around)
         near(:, o) = samples_near(fit%predicted(:, o), bare, size(near, 1))
         associate (own => fit%residual(view%first:view%last, o))
            residual = fit%residual(near(:, o), o) - sum(own)/size(own)
         end associate
         smeared = plus_in_turn(values(:, o), residual)
         call find_quantile(smeared, view%weight, p, 0.0_wp, full, around)
         estimate%value(o) = 0.5_wp*(bare + full)
         estimate%bias(o) = 0.5_wp*(bare - full)   ! inwards, as plain sampling's
      end do
      call average_features(surrogate, average_row, 1.0_wp, average)
      call find_weights(surrogate, fit, average, 1.0_wp, estimate%influence)
      call weigh_residuals(surrogate, fit, estimate)
      do o = 1, size(values, 2)
         residual = fit%residual(near(:, o), o)
         residual = (residual - sum(residual)/size(residual))/(2*size(residual))
         estimate%influence(near(:, o), o) = estimate%influence(near(:, o), o) + residual
         estimate%excess(:, o) = excess_of(width(:, o), estimate%kappa(o))
      end do
   end subroutine law_percentile

   !> Values plus residuals, which are taken in turn.
   pure function plus_in_turn(values, residual) result(smeared)
      real(wp), intent(in) :: values(:), residual(:)
      real(wp) :: smeared(size(values))
      integer :: first, n

      do first = 1, size(values), size(residual)
         n = min(size(residual), size(values) - first + 1)
         smeared(first:first + n - 1) = values(first:first + n - 1) + residual(:n)
      end do
   end function plus_in_turn

   pure integer function half_of_near(view)
      type(view_type), intent(in) :: view

      half_of_near = max(least_near, nint(share_of_near*(view%last - view%first + 1)))
   end function half_of_near

   !> Mean of columns, of as many as matter.
   pure function mean_of_some(columns, places) result(mean)
      real(wp), intent(in) :: columns(:, :)
      integer, intent(in) :: places(:)
      real(wp) :: mean(size(columns, 1))
      integer :: i, n

      n = min(size(places), most_in_window)
      mean = 0.0_wp
      do i = 1, n
         mean = mean + columns(:, places(1 + ((i - 1)*size(places))/n))
      end do
      mean = mean/n
   end function mean_of_some

   !> The samples whose predictions are next in rank to a value, as many on either side where there
   !> are as many.
   pure function samples_near(predicted, value, n_near) result(near)
      real(wp), intent(in) :: predicted(:)   !! (sample)
      real(wp), intent(in) :: value
      integer, intent(in) :: n_near
      integer :: near(n_near)
      integer :: n_below, n_from_below

      n_below = count(predicted < value)
      n_from_below = max(min(n_near/2, n_below), n_near - (size(predicted) - n_below))
      near(:n_from_below) = places_of_least(value - predicted, predicted < value, n_from_below)
      near(n_from_below + 1:) = places_of_least(predicted - value, predicted >= value, &
                                        n_near - n_from_below)
   end function samples_near

   !> The places of the least values among some, the least first.
   pure function places_of_least(values, is_meant, n) result(places)
      real(wp), intent(in) :: values(:)
      logical, intent(in) :: is_meant(:)   !! n or more
      integer, intent(in) :: n
      integer :: places(n)
      integer :: found, i, k

      found = 0
      do i = 1, size(values)
         if (.not. is_meant(i)) cycle
         if (found == n) then
            if (n == 0) return
            if (values(i) >= values(places(n))) cycle
         else
            found = found + 1
         end if
         k = found
         do while (k > 1)
            if (values(places(k - 1)) <= values(i)) exit
            places(k) = places(k - 1)
            k = k - 1
         end do
         places(k) = i
      end do
   end function places_of_least

   !> Estimates the mean of y = exp(output) half way between the mean of exp(G) and the ratio
   !> estimate from it, half of their difference as bias; then a part of the way from there to the
   !> mean of exp(G + v/2), v the variance of G, with that as bias if it is larger.
   subroutine law_mean_of_exponential(surrogate, fit, view, grown, y, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(view_type), intent(in) :: view
      real(wp), intent(in), contiguous :: grown(:, :)   !! (point, output) exp(G)
      real(wp), intent(in) :: y(:, :)         !! (own sample, output)
      type(estimates_type), intent(out) :: estimate
      real(wp), allocatable :: weighted(:, :), average_row(:, :), average(:, :)
      real(wp), allocatable :: of_samples(:, :), average_of_samples(:, :)
      real(wp), allocatable :: feature(:, :), variance(:, :), weight(:, :)
      real(wp) :: each(size(grown, 1)), some_weight(size(view%some_rows, 2)), width(size(grown, 2))
      real(wp) :: mean, part, ratio
      integer :: o

      allocate (weighted(size(view%some_rows, 2), size(grown, 2)))
      allocate (variance, mold=weighted)
      allocate (average_row(size(view%rows, 1), size(grown, 2)))
      allocate (average(size(surrogate%eigenvalue), size(grown, 2)))
      allocate (average_of_samples, mold=average)
      allocate (estimate%value(size(grown, 2)), estimate%excess(2, size(grown, 2)))
      allocate (estimate%bias, mold=estimate%value)
      call predict_variance(surrogate, fit, view%some_square, view%rest, variance)
      some_weight = view%weight(::thinning)/sum(view%weight(::thinning))
      of_samples = fit%predicted(view%first:view%last, :)
      do o = 1, size(grown, 2)
         call exponentiate(of_samples(:, o))
         each = view%weight*grown(:, o)
         mean = sum(each)
         weighted(:, o) = each(::thinning)/sum(each(::thinning))
         ratio = sum(y(:, o))/sum(of_samples(:, o))
         of_samples(:, o) = of_samples(:, o)/sum(of_samples(:, o))
         estimate%value(o) = mean*sqrt(ratio)
         estimate%bias(o) = 0.5_wp*mean*(ratio - 1.0_wp)
         associate (e => fit%residual(view%first:view%last, o), &
                    left => fit%left(view%first:view%last, o))
            variance(:, o) = min(largest, 0.5_wp*variance(:, o) &
                                 *noise_of(of_samples(:, o), e**2*left))
         end associate
         call exponentiate(variance(:, o))
         width(o) = width_of_densities(some_weight, weighted(:, o), variance(:, o), y(:, o))
         part = share_of_variance*(mean*dot_product(weighted(:, o), variance(:, o)) &
                                   - estimate%value(o))
         estimate%value(o) = estimate%value(o) + part
         if (abs(part) > abs(estimate%bias(o))) estimate%bias(o) = part
      end do
      call multiply(view%some_rows, weighted, average_row)
      call average_features(surrogate, average_row, 1.0_wp, average)
      feature = surrogate%feature(view%first:view%last, :)
      call multiply(feature, of_samples, average_of_samples, transposes_a=.true.)
      average = average - 0.5_wp*average_of_samples
      call find_weights(surrogate, fit, average, 0.5_wp, weight)
      estimate%influence = fit%residual*weight
      do o = 1, size(grown, 2)
         associate (own => estimate%influence(view%first:view%last, o), &
                    of_own => weight(view%first:view%last, o))
            own = own + 0.5_wp*(y(:, o)/sum(y(:, o)) - of_samples(:, o))
            of_own = of_own + 0.5_wp*of_samples(:, o)   ! y/exp(G) - 1 is about the residual
         end associate
         estimate%influence(:, o) = estimate%influence(:, o)*estimate%value(o)
      end do
      estimate%kappa = kappa_of(fit, weight)
      call scale_influences(surrogate, estimate)
      do o = 1, size(grown, 2)
         estimate%excess(:, o) = excess_of(spread(width(o), 1, 2), estimate%kappa(o))
      end do
   end subroutine law_mean_of_exponential

   !> Variance of the noise: the mean of the samples' own; that by their shares in the mean where
   !> those that carry it have less.
   pure real(wp) function noise_of(share, of_sample)
      real(wp), intent(in) :: share(:)       !! (sample) their sum is 1
      real(wp), intent(in) :: of_sample(:)   !! (sample)

      noise_of = min(sum(of_sample)/size(of_sample), dot_product(share, of_sample))
   end function noise_of

end module statistics_regression
