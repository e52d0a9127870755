!> Estimates of means, standard deviations and percentiles of a response over the law of the
!> friction, by a fit G to few samples and its values at many points of the law; with the influence
!> of each sample on them. Formulas (4) and (5) of docs/regression.md.
module statistics_regression
   use core_kinds, only: wp
   use numerics_elementary, only: exponentiate
   use numerics_lapack, only: multiply
   use numerics_sorting, only: sort_order
   use statistics_estimates, only: estimates_type
   use statistics_fit, only: fit_type
   use statistics_influences, only: add_hidden_errors, case_law_type, density_tail_ratio, &
                                    find_influences, find_weights, kappa_of, pair_thinning, &
                                    scale_by_pairs, tail_factors, tail_ratio, thinning
   use statistics_percentiles, only: find_quantile
   use statistics_surrogate, only: average_features, evenly_spaced, surrogate_type
   implicit none(type, external)
   private
   public :: law_deviation, law_mean, law_mean_of_exponential, law_percentiles

   !> probability on either side of a percentile: its points, and those of its hidden error
   real(wp), parameter :: half_window = 0.01_wp, half_pair_window = 0.03_wp
   real(wp), parameter :: near_factor = 0.8_wp     !! near samples on a side, over root of all
   integer, parameter :: most_averaged = 24        !! points near a percentile in a mean of c_i
   real(wp), parameter :: largest_half_variance = 1.0_wp   !! upper limit of v/2
   real(wp), parameter :: variance_share = 0.25_wp   !! weight of [exp(G + v/2)] in a mean density

contains

   !> Estimates the mean, [G] + b, with b as bias: half the mean of y - G over the law's shares of
   !> the samples, which is 0 if no other case is in the fit.
   subroutine law_mean(surrogate, fit, law, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: average_row(size(law%rows, 1), 1)
      real(wp) :: average(size(surrogate%eigenvalue), size(fit%mean))
      real(wp) :: own_average(size(surrogate%eigenvalue))   ! (feature) over the shares
      integer :: o

      average_row(:, 1) = matmul(law%rows, law%weight)
      call average_features(surrogate, average_row, 1.0_wp, average(:, 1:1))
      own_average = matmul(law%share, surrogate%feature)
      estimate%value = fit%mean + matmul(average(:, 1), fit%coefficient)
      estimate%bias = 0.5_wp*(matmul(law%share, fit%predicted + fit%residual) &
                              - fit%mean - matmul(own_average, fit%coefficient))
      estimate%value = estimate%value + estimate%bias
      average = spread(average(:, 1) - 0.5_wp*own_average, 2, size(average, 2))
      if (.not. law%has_samples) &
         call add_hidden_errors(surrogate, fit, law, spread(law%pair_weight, 2, size(average, 2)), &
                                spread(1.0_wp, 1, size(average, 2)), estimate, &
                                spread(law%share, 2, size(average, 2)))
      call find_weights(surrogate, fit, average, 0.5_wp, estimate%influence)
      estimate%influence = estimate%influence + spread(0.5_wp*law%share, 2, size(fit%mean))
      call find_influences(surrogate, fit, estimate, is_bound=.false.)
      allocate (estimate%tail_factor(2, size(fit%mean)))
      do o = 1, size(fit%mean)
         estimate%tail_factor(:, o) = &
            tail_factors(tail_ratio(law, values(:, o), fit%predicted(:, o))**2, estimate%kappa(o))
      end do
   end subroutine law_mean

   !> Estimates the standard deviation, the root of the variance of G plus that of the residuals
   !> over the law's shares of the samples, and b of law_mean with the derivative by G. Half of what
   !> the residuals add, and b, are bias.
   subroutine law_deviation(surrogate, fit, law, values, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      type(estimates_type), intent(out) :: estimate
      real(wp) :: row_covariance(size(law%rows, 1), size(values, 2))
      real(wp) :: covariance(size(surrogate%eigenvalue), size(values, 2))
      real(wp) :: centred(size(values, 1), size(values, 2))
      real(wp) :: moment(size(law%share), size(values, 2))   ! (sample) half of share*(G - [G])
      real(wp), dimension(size(law%share)) :: fitted, square   ! (sample) G; square of a residual
      real(wp) :: addition(size(values, 2)), fit_variance, residual_variance
      integer :: o

      do o = 1, size(values, 2)
         centred(:, o) = values(:, o) - dot_product(law%weight, values(:, o))
         row_covariance(:, o) = matmul(law%rows, law%weight*centred(:, o))
      end do
      call average_features(surrogate, row_covariance, 0.0_wp, covariance)
      call multiply(surrogate%feature, fit%coefficient, moment)
      do o = 1, size(values, 2)
         fitted = fit%mean(o) + moment(:, o)
         moment(:, o) = 0.5_wp*law%share*(fitted - dot_product(law%weight, values(:, o)))
         addition(o) = dot_product(moment(:, o), &
                                   fit%predicted(:, o) + fit%residual(:, o) - fitted)
         covariance(:, o) = covariance(:, o) - matmul(moment(:, o), surrogate%feature)
      end do
      call find_weights(surrogate, fit, covariance, 0.0_wp, estimate%influence)
      estimate%influence = estimate%influence + moment
      call find_influences(surrogate, fit, estimate, is_bound=.false.)
      allocate (estimate%value(size(values, 2)), estimate%tail_factor(2, size(values, 2)))
      allocate (estimate%bias, mold=estimate%value)
      do o = 1, size(values, 2)
         estimate%tail_factor(:, o) = &
            tail_factors(tail_ratio(law, centred(:, o)**2, &
                                    (fit%predicted(:, o) &
                                     - dot_product(law%share, fit%predicted(:, o)))**2)**2, &
                         estimate%kappa(o))
         square = (fit%residual(:, o) - dot_product(law%share, fit%residual(:, o)))**2
         fit_variance = dot_product(law%weight, centred(:, o)**2)
         residual_variance = dot_product(law%share, square)
         estimate%value(o) = sqrt(max(fit_variance + residual_variance, tiny(1.0_wp)))
         addition(o) = addition(o)/estimate%value(o)
         estimate%bias(o) = 0.5_wp*(estimate%value(o) - sqrt(fit_variance)) + addition(o)
         associate (influence => estimate%influence(:, o))
            influence = (influence + 0.5_wp*law%share*(square - residual_variance)) &
                        /estimate%value(o)
         end associate
         estimate%value(o) = estimate%value(o) + addition(o)
      end do
      if (.not. law%has_samples) &
         call add_hidden_errors(surrogate, fit, law, centred(::pair_thinning, :) &
                                *spread(law%pair_weight, 2, size(values, 2)), &
                                1.0_wp/(estimate%value - addition), estimate, 2.0_wp*moment)
   end subroutine law_deviation

   !> Estimates percentiles, each half way between that of G and that of G + s or G - s, with s the
   !> spread of the residuals near each point, plus b: half the mean of y - G over the law's samples
   !> near. Any residuals of the mean 0 and the variance s^2 move a percentile as these two do, to
   !> second order: by -(s^2 f)'/2f, f the density of G. Half of this, and b, are bias.
   subroutine law_percentiles(surrogate, fit, law, values, p, estimates)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: values(:, :)   !! (point, output) G
      real(wp), intent(in) :: p(:)                       !! shares of the law below the percentiles
      type(estimates_type), intent(out) :: estimates(:)  !! (percentile)
      real(wp) :: average_row(size(law%rows, 1), size(values, 2), size(p))
      real(wp) :: average(size(surrogate%eigenvalue), size(values, 2))
      integer :: near(2*nint(near_factor*sqrt(real(law%last - law%first + 1, wp))), &
                      size(values, 2), size(p)), o, s     ! (number, output, percentile) samples
      real(wp) :: residual(size(near, 1)), tail(2, size(values, 2)), of_fit(size(p))
      real(wp) :: of_sums, shift
      real(wp), dimension(2*size(values, 1)) :: sums, half_weight   ! (point and side)
      !> (every 16th point, output, percentile) near the percentile
      real(wp), allocatable :: pair_share(:, :, :)
      integer, allocatable :: points(:)
      logical :: is_pooled

      is_pooled = law%last - law%first + 1 < size(law%share)
      half_weight = 0.5_wp*[law%weight, law%weight]
      do s = 1, size(p)
         allocate (estimates(s)%value(size(values, 2)), estimates(s)%bias(size(values, 2)), &
                   estimates(s)%inverse_density(size(values, 2)))
         allocate (estimates(s)%tail_factor, mold=tail)
      end do
      if (.not. law%has_samples) &
         allocate (pair_share(size(law%pair_weight), size(values, 2), size(p)), source=0.0_wp)
      do o = 1, size(values, 2)
         tail(:, o) = tail_ratio(law, values(:, o), fit%predicted(:, o))
         do s = 1, size(p)
            call find_quantile(values(:, o), law%weight, p(s), half_window, of_fit(s), points)
            associate (first => points(1), last => points(size(points)), &
                       some => points(evenly_spaced(size(points), most_averaged)))
               average_row(:, o, s) = sum(law%rows(:, some), 2)/size(some)
               estimates(s)%inverse_density(o) = (values(last, o) - values(first, o)) &
                                                 /sum(law%weight(points))
            end associate
         end do
         call spread_by_residuals(law, fit, o, values(:, o), of_fit, near(:, o, :), sums)
         do s = 1, size(p)
            call find_quantile(sums, half_weight, p(s), 0.0_wp, of_sums, points)
            residual = fit%residual(near(:, o, s), o)*fit%one_minus_h(near(:, o, s), o)   ! y - G
            shift = 0.5_wp*(of_sums - of_fit(s))
            associate (b => 0.5_wp*sum(residual)/size(residual), estimate => estimates(s))
               estimate%value(o) = of_fit(s) + shift + b
               estimate%bias(o) = -sign(hypot(shift, b), shift)   ! inwards, as plain sampling's
            end associate
            if (law%has_samples) cycle
            call find_quantile(values(::pair_thinning, o), law%pair_weight, p(s), &
                               half_pair_window, of_sums, points)
            pair_share(points, o, s) = 1.0_wp/size(points)
         end do
      end do
      do s = 1, size(p)
         associate (estimate => estimates(s))
            call average_features(surrogate, average_row(:, :, s), 1.0_wp, average)
            if (.not. law%has_samples) &
               call add_hidden_errors(surrogate, fit, law, pair_share(:, :, s), &
                                      spread(1.0_wp, 1, size(values, 2)), estimate)
            call find_weights(surrogate, fit, average, 1.0_wp, estimate%influence)
            call find_influences(surrogate, fit, estimate, is_bound=is_pooled)
            do o = 1, size(values, 2)
               residual = fit%residual(near(:, o, s), o)
               residual = (residual - sum(residual)/size(residual))/(2*size(residual))
               estimate%influence(near(:, o, s), o) = estimate%influence(near(:, o, s), o) &
                                                      + residual
               estimate%tail_factor(:, o) = tail_factors(tail(:, o), estimate%kappa(o))
            end do
         end associate
      end do
   end subroutine law_percentiles

   !> Computes G - s and G + s at each point. s is the standard deviation of the residuals near: of
   !> the samples of the law predicted near it, the same for all points in one part of the range of
   !> predictions. Other laws may have smaller residuals at the same predictions: they come to them
   !> by other friction values.
   pure subroutine spread_by_residuals(law, fit, o, values, of_fit, near, sums)
      type(case_law_type), intent(in) :: law
      type(fit_type), intent(in) :: fit
      integer, intent(in) :: o                        !! output
      real(wp), intent(in), contiguous :: values(:)   !! (point) G
      real(wp), intent(in) :: of_fit(:)               !! percentiles of G
      integer, intent(out) :: near(:, :)              !! (number, percentile) samples predicted near
      real(wp), intent(out), contiguous :: sums(:)    !! (point and side)
      integer, parameter :: n_parts = 512
      integer :: before(n_parts)    ! (part) samples before those near to its middle
      real(wp) :: spread(n_parts)   ! (part) s
      integer :: ranking(law%last - law%first + 1)           ! (rank) samples of the law
      real(wp), dimension(size(ranking)) :: place, residual  ! (rank) place of the prediction
      real(wp) :: after(0:size(ranking) - size(near, 1))     ! (samples before) s of those near
      real(wp) :: least, parts_per_unit, s
      integer :: first, k, m, n, n_near

      n = size(ranking)
      n_near = size(near, 1)
      ranking = law%first - 1 + sort_order(fit%predicted(law%first:law%last, o))
      residual = fit%residual(ranking, o)
      place = fit%predicted(ranking, o)
      least = place(1)
      parts_per_unit = n_parts/max(place(n) - least, sqrt(tiny(least)))
      place = (place - least)*parts_per_unit
      do m = 0, n - n_near
         associate (some => residual(m + 1:m + n_near))
            after(m) = sqrt(sum((some - sum(some)/n_near)**2)/(n_near - 1))
         end associate
      end do
      m = 0
      do k = 1, n_parts
         do while (m < n)
            if (place(m + 1) > k - 0.5_wp) exit
            m = m + 1
         end do
         before(k) = max(0, min(m - n_near/2, n - n_near))
      end do
      spread = after(before)
      !$omp simd private(s)
      do m = 1, size(values)
         s = spread(part_of(values(m)))
         sums(m) = values(m) - s
         sums(m + size(values)) = values(m) + s
      end do
      do k = 1, size(of_fit)
         first = before(part_of(of_fit(k)))
         near(:, k) = ranking(first + 1:first + n_near)
      end do

   contains

      pure integer function part_of(value)
         real(wp), intent(in) :: value

         part_of = 1 + int(max(0.0_wp, min((value - least)*parts_per_unit, n_parts - 1.0_wp)))
      end function part_of

   end subroutine spread_by_residuals

   !> Estimates the mean of y = exp(output), a density: D + ([exp(G + v/2)] - D)/4 with v the
   !> variance of G and D = [exp G] sqrt(ratio), ratio = sum y/sum exp(predicted). The bias is half
   !> of what the ratio or, if it is larger, the whole of what v adds.
   subroutine law_mean_of_exponential(surrogate, fit, law, exp_values, y, estimate)
      type(surrogate_type), intent(in) :: surrogate
      type(fit_type), intent(in) :: fit
      type(case_law_type), intent(in) :: law
      real(wp), intent(in), contiguous :: exp_values(:, :)   !! (point, output) exp(G)
      real(wp), intent(in) :: y(:, :)                        !! (sample of the case, output)
      type(estimates_type), intent(out) :: estimate
      real(wp), allocatable :: average_row(:, :), average(:, :), feature(:, :), weight(:, :)
      real(wp) :: growth(size(law%thin_rows, 2))    ! (every 4th point) exp(v/2)
      real(wp), allocatable :: point_share(:, :)    ! (every 4th point, output) in [exp G]
      real(wp), allocatable :: sample_share(:, :)   ! (sample of the case, output) in the same
      real(wp), allocatable :: sample_average(:, :)
      real(wp) :: density(size(exp_values, 1)), thin_weight(size(law%thin_rows, 2))
      real(wp) :: correction, mean, ratio, tail(size(exp_values, 2))
      integer :: n, o

      n = size(exp_values, 2)
      allocate (point_share(size(law%thin_rows, 2), n), average_row(size(law%rows, 1), n))
      allocate (average(size(surrogate%eigenvalue), n))
      allocate (sample_average, mold=average)
      allocate (estimate%value(n), estimate%bias(n), estimate%tail_factor(2, n))
      thin_weight = law%weight(::thinning)/sum(law%weight(::thinning))
      sample_share = fit%predicted(law%first:law%last, :)
      do o = 1, n
         call exponentiate(sample_share(:, o))
         density = law%weight*exp_values(:, o)
         mean = sum(density)
         point_share(:, o) = density(::thinning)/sum(density(::thinning))
         ratio = sum(y(:, o))/sum(sample_share(:, o))
         sample_share(:, o) = sample_share(:, o)/sum(sample_share(:, o))
         estimate%value(o) = mean*sqrt(ratio)
         estimate%bias(o) = 0.5_wp*mean*(ratio - 1.0_wp)
         associate (square => fit%residual(law%first:law%last, o)**2 &
                    *fit%one_minus_h(law%first:law%last, o))   ! e^2 (1 - h), for tau^2
            growth = min(largest_half_variance, 0.5_wp*law%thin_variance(:, fit%noise_ratio(o)) &
                         *min(sum(square)/size(square), dot_product(sample_share(:, o), square)))
         end associate
         call exponentiate(growth)
         tail(o) = density_tail_ratio(thin_weight, point_share(:, o), growth, y(:, o))
         correction = variance_share*(mean*dot_product(point_share(:, o), growth) &
                                      - estimate%value(o))
         estimate%value(o) = estimate%value(o) + correction
         if (abs(correction) > abs(estimate%bias(o))) estimate%bias(o) = correction
      end do
      call multiply(law%thin_rows, point_share, average_row)
      call average_features(surrogate, average_row, 1.0_wp, average)
      feature = surrogate%feature(law%first:law%last, :)
      call multiply(feature, sample_share, sample_average, transposes_a=.true.)
      average = average - 0.5_wp*sample_average
      associate (share => point_share(::pair_thinning/thinning, :))
         if (.not. law%has_samples) &
            call add_hidden_errors(surrogate, fit, law, share/spread(sum(share, 1), 1, &
                                                                     size(share, 1)), &
                                   estimate%value, estimate)
      end associate
      call find_weights(surrogate, fit, average, 0.5_wp, weight)
      estimate%influence = fit%residual*weight
      do o = 1, n
         associate (influence => estimate%influence(law%first:law%last, o), &
                    own_weight => weight(law%first:law%last, o))
            influence = influence + 0.5_wp*(y(:, o)/sum(y(:, o)) - sample_share(:, o))
            ! for kappa: y/exp(predicted) - 1 is nearly the residual
            own_weight = own_weight + 0.5_wp*sample_share(:, o)
         end associate
         estimate%influence(:, o) = estimate%influence(:, o)*estimate%value(o)
      end do
      estimate%kappa = kappa_of(fit, weight)
      call scale_by_pairs(surrogate, estimate)
      do o = 1, n
         estimate%tail_factor(:, o) = tail_factors([tail(o), tail(o)], estimate%kappa(o))
      end do
   end subroutine law_mean_of_exponential

end module statistics_regression
