!> Estimates of means, standard deviations and percentiles of slip fractions, slip distances,
!> dissipations and amplitudes, by the regression and plain sampling together (docs/regression.md).
module statistics_scalars
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_blend, only: combine
   use statistics_estimates, only: estimates_type, nonnegative_statistic, plain_deviation, &
                                   plain_mean, plain_percentile, statistic_type, normal_95, &
                                   sort_percentiles, upward_error
   use statistics_fit, only: fit_outputs, fit_type, predict
   use statistics_influences, only: case_law_type, extrapolation_of, prepare_law, &
                                    prepare_thin_points
   use statistics_kernel_choice, only: choose_kernel
   use statistics_pool, only: over_all_samples, pool_type, least_plain_share
   use statistics_regression, only: law_deviation, law_mean, law_percentiles
   use statistics_sensitivity, only: find_sensitivity
   use statistics_surrogate, only: surrogate_type
   implicit none(type, external)
   private
   public :: estimate_scalars

   real(wp), parameter :: right_angle = 2.0_wp*atan(1.0_wp)

contains

   !> Estimates the mean, the percentiles and the standard deviation, in this order, of several
   !> numbers of the samples, for every case of a pool. The numbers are amounts and fractions, none
   !> negative. Percentiles come from a fit to the root of an amount and the angle of a fraction.
   subroutine estimate_scalars(pool, y, is_fraction, share_below, plain, estimates, sensitivity, &
                               error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in), contiguous :: y(:, :)     !! (sample, number)
      logical, intent(in) :: is_fraction(:)           !! (number)
      real(wp), intent(in) :: share_below(:)          !! (percentile)
      !> (number, statistic, case) values over all samples of the case
      type(statistic_type), intent(in) :: plain(:, :, :)
      type(statistic_type), intent(out) :: estimates(:, :, :)   !! (number, statistic, case)
      type(statistic_type), intent(out) :: sensitivity(:, :)    !! (input, case) of the first number
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: transformed(size(y, 1), size(y, 2))   ! (sample, number)
      type(surrogate_type) :: surrogate
      type(fit_type) :: fit, transformed_fit
      type(case_law_type) :: law
      integer :: case_number, i, n_numbers

      n_numbers = size(y, 2)
      do i = 1, n_numbers
         transformed(:, i) = transform(y(:, i), is_fraction(i))
      end do
      call choose_kernel(pool%x, reshape([y, transformed], [size(y, 1), 2*n_numbers]), surrogate, &
                         error)
      if (allocated(error)) return
      call fit_outputs(surrogate, y, fit)
      call fit_outputs(surrogate, transformed, transformed_fit)
      do case_number = 1, size(plain, 3)
         if (.not. allocated(pool%draws(case_number)%x)) cycle
         call prepare_law(pool, case_number, surrogate, law, error)
         if (allocated(error)) return
         if (.not. law%has_samples) call prepare_thin_points(surrogate, law)
         associate (best => estimates(:, :, case_number), last => size(estimates, 2))
            call estimate_moments(best)
            if (allocated(error)) return
            call estimate_percentiles(best)
            if (law%has_samples) cycle
            best(:, 1)%ratio = extrapolation_of(law, surrogate, fit)
            best(:, last)%ratio = best(:, 1)%ratio
            best(:, 2:last - 1)%ratio = &
               spread(extrapolation_of(law, surrogate, transformed_fit), 2, last - 2)
         end associate
      end do

   contains

      !> Estimates the mean and the standard deviation of every number for the current case.
      subroutine estimate_moments(best)
         type(statistic_type), intent(inout) :: best(:, :)   !! (number, statistic)
         type(estimates_type) :: fitted, sampled, blended
         real(wp) :: values(size(law%weight), n_numbers)
         real(wp) :: m(n_numbers)   ! upper end of the interval of a fraction's mean, at most 1/2
         integer :: i

         associate (own => y(law%first:law%last, :), last => size(plain, 2), &
                    residual => fit%residual(law%first:law%last, :))
            call predict(fit, law%rows, values)
            call law_mean(surrogate, fit, law, values, fitted)
            sampled = over_all_samples(pool, case_number, plain_mean(own), &
                                       plain(:, 1, case_number)%value)
            call combine(law, values, fitted, sampled, &
                         [(0.0_wp, i=1, n_numbers)], blended)
            best(:, 1) = nonnegative_statistic(blended%value, blended%error, blended%ratio)
            where (is_fraction) best(:, 1)%value = min(1.0_wp, best(:, 1)%value)
            if (law%has_samples) then
               where (is_fraction) best(:, 1)%error = &
                  min(best(:, 1)%error, &
                      error_limit(best(:, 1)%value, sampled%value, law%n_samples))
            end if
            call law_deviation(surrogate, fit, law, values, fitted)
            sampled = over_all_samples(pool, case_number, plain_deviation(own), &
                                       plain(:, last, case_number)%value)
            call find_sensitivity(surrogate, fit, law, values(:, 1), fitted, &
                                  sensitivity(:, case_number), error)
            if (allocated(error)) return
            do i = 1, n_numbers   ! change of the root of the variance
               values(:, i) = (values(:, i) - dot_product(law%weight, values(:, i)))**2 &
                              /(2.0_wp*fitted%value(i))
            end do
            call combine(law, values, fitted, sampled, &
                         least_plain_share(residual, own), blended)
            best(:, last) = nonnegative_statistic(blended%value, blended%error, blended%ratio)
            m = max(0.0_wp, min(best(:, 1)%value + normal_95*best(:, 1)%error, 0.5_wp))
            ! the standard deviation of a fraction of mean m is sqrt(m - m**2) at most
            associate (std => best(:, last)%value, stated => best(:, last)%error)
               where (is_fraction) stated = min(stated, max(std, sqrt(m - m**2) - std)/normal_95)
            end associate
         end associate
      end subroutine estimate_moments

      !> Estimates the percentiles of every number for the current case.
      subroutine estimate_percentiles(best)
         type(statistic_type), intent(inout) :: best(:, :)   !! (number, statistic)
         type(estimates_type) :: fitted(size(share_below)), sampled, blended
         real(wp), dimension(size(law%weight), n_numbers) :: point_influence, values
         real(wp) :: least_share(n_numbers)
         real(wp) :: ends(2)
         integer :: i, p

         call predict(transformed_fit, law%rows, values)
         values = max(0.0_wp, values)
         do i = 1, n_numbers
            if (is_fraction(i)) values(:, i) = min(values(:, i), right_angle)
         end do
         associate (own => transformed(law%first:law%last, :))
            least_share = least_plain_share(transformed_fit%residual(law%first:law%last, :), own)
            call law_percentiles(surrogate, transformed_fit, law, values, share_below, fitted)
            do p = 1, size(share_below)
               sampled = over_all_samples(pool, case_number, &
                                          plain_percentile(own, share_below(p)), &
                                          transform(plain(:, 1 + p, case_number)%value, &
                                                    is_fraction))
               do i = 1, n_numbers   ! leaving a point out moves a percentile by 1/density
                  point_influence(:, i) = merge(-fitted(p)%inverse_density(i), 0.0_wp, &
                                                values(:, i) <= fitted(p)%value(i))
               end do
               call combine(law, point_influence, fitted(p), sampled, least_share, blended)
               do i = 1, n_numbers
                  ends = blended%error(i)*blended%stretch(:, i)
                  if (share_below(p) > 0.5_wp) ends(2) = upward_error(blended%value(i), ends(2))
                  ends = transform_back(blended%value(i) + normal_95*[-ends(1), ends(2)], &
                                        is_fraction(i))
                  if (may_be_zero(y(law%first:law%last, i), share_below(p))) ends(1) = 0.0_wp
                  best(i, 1 + p) = &
                     statistic_type(transform_back(blended%value(i), is_fraction(i)), &
                                    low=ends(1), high=ends(2), ratio=blended%ratio(i))
               end do
            end do
         end associate
         do i = 1, n_numbers
            call sort_percentiles(best(i, 2:1 + size(share_below)))
         end do
      end subroutine estimate_percentiles

   end subroutine estimate_scalars

   !> Standard error with which the interval of a fraction's mean reaches the farther end of
   !> Wilson's, |m - sample_mean| <= 1.96 sqrt(m (1 - m)/n).
   elemental real(wp) function error_limit(mean, sample_mean, n)
      real(wp), intent(in) :: mean, sample_mean   !! estimate; mean of n samples
      integer, intent(in) :: n
      real(wp) :: q

      q = normal_95**2/n
      error_limit = (abs(mean*(1.0_wp + q) - sample_mean - 0.5_wp*q) &
                     + sqrt(q*(sample_mean*(1.0_wp - sample_mean) + 0.25_wp*q))) &
                    /((1.0_wp + q)*normal_95)
   end function error_limit

   !> True if the interval of a percentile may begin at zero: more than one sample is zero, and as
   !> many as lie below plain sampling's interval (binomial, 95 %). A continuous G has no finite
   !> probability at zero.
   pure logical function may_be_zero(y, p)
      real(wp), intent(in) :: y(:)   !! (sample), not negative
      real(wp), intent(in) :: p      !! share of the law below the percentile
      integer :: n, n_zero

      n = size(y)
      n_zero = count(.not. y > 0.0_wp)
      may_be_zero = n_zero > 1 .and. n_zero >= 1 + p*(n - 1) - normal_95*sqrt(p*(1.0_wp - p)*n)
   end function may_be_zero

   !> Angle asin(sqrt(y)) of a fraction, root of an amount.
   elemental real(wp) function transform(value, is_fraction)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_fraction

      transform = sqrt(value)
      if (is_fraction) transform = asin(min(transform, 1.0_wp))
   end function transform

   !> Fraction or amount, from its angle or root.
   elemental real(wp) function transform_back(value, is_fraction)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_fraction

      transform_back = max(0.0_wp, value)
      if (is_fraction) transform_back = sin(min(transform_back, right_angle))
      transform_back = transform_back**2
   end function transform_back

end module statistics_scalars
