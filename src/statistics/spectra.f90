!> Estimates of the spectra of a case, by the regression and plain sampling together: mean and
!> percentiles of the power spectral density at each frequency that has power, formula (1) of
!> docs/regression.md; their integrals, the pseudo-variances of Eq. (46); and the band ratio, the
!> integral of the last percentile over that of the first.
module statistics_spectra
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_elementary, only: exponentiate
   use numerics_sorting, only: sort_order
   use statistics_blend, only: combine, state_error
   use statistics_estimates, only: downward_error, estimates_type, nonnegative_statistic, &
                                   plain_mean, plain_percentile, statistic_type, normal_95, &
                                   sort_percentiles, upward_error
   use statistics_fit, only: fit_outputs, fit_type, predict
   use statistics_influences, only: case_law_type, extrapolation_of, prepare_law, &
                                    prepare_thin_points
   use statistics_kernel_choice, only: choose_kernel
   use statistics_law, only: error_of_points
   use statistics_pool, only: over_all_samples, least_plain_share, pool_type
   use statistics_regression, only: law_mean_of_exponential, law_percentiles
   use statistics_surrogate, only: reallocate, surrogate_type
   implicit none(type, external)
   private
   public :: estimate_spectrum, last_powerful

   integer, parameter, public :: together = 128   !! frequencies that are estimated together
   integer, parameter, public :: n_choosing = 24  !! frequencies at which the kernel is chosen
   real(wp), parameter :: power_above = 1.0e-4_wp       !! share of the power, by plain sampling
   !> limit of G beyond the samples in a mean density, over the range of the samples: of a normal
   !> G 30 samples span 4 standard deviations, and 1 of 3000 points of the law lies 1.5 beyond
   real(wp), parameter :: beyond = 0.5_wp
   real(wp), parameter :: least_density = 1.0e-290_wp   !! keeps the logarithm finite

   !> Integral of a statistic over frequency, as far as it is summed.
   type :: integral_type
      real(wp) :: value = 0.0_wp, bias = 0.0_wp
      !> (sample of the pool, then beyond it), (sample of the case)
      real(wp), allocatable :: influence(:), plain_influence(:)
      !> sum over frequencies of the standard errors, and of these times the stretch down and up
      real(wp) :: error_sum = 0.0_wp, stretched_sum(2) = 0.0_wp
   end type integral_type

contains

   !> Estimates the spectra of one dof for every case of a pool, at the frequencies that have power;
   !> the integrals include plain sampling's spectra above them. A spectrum has the mean and the
   !> percentiles; the integrals are those of the same, then the band ratio.
   subroutine estimate_spectrum(pool, density, step, share_below, plain, spectra, integrals, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: density(:, :)        !! (sample, frequency) up to last_powerful
      real(wp), intent(in) :: step                 !! between frequencies [Hz]
      real(wp), intent(in) :: share_below(:)       !! (percentile)
      !> (frequency, statistic, case) values over all samples of the case
      type(statistic_type), intent(in) :: plain(:, :, :)
      type(statistic_type), intent(out) :: spectra(:, :, :)   !! (frequency, statistic, case)
      type(statistic_type), intent(out) :: integrals(:, :)    !! (statistic, case)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: outputs(:, :)       ! (sample, frequency) ln density
      real(wp), allocatable :: values(:, :)        ! (point, frequency of a group) G
      !> (point, frequency of a group) function whose mean over the law is estimated: exp(G), or the
      !> influence of the points on a percentile
      real(wp), allocatable :: averaged(:, :)
      type(surrogate_type) :: surrogate
      type(fit_type), allocatable :: fits(:)       ! (group of frequencies)
      type(case_law_type) :: law
      integer :: case_number, k

      outputs = log(max(density, least_density))
      call choose_kernel(pool%x, outputs(:, ::max(1, size(outputs, 2)/n_choosing)), surrogate, &
                         error)
      if (allocated(error)) return
      allocate (fits((size(outputs, 2) - 1)/together + 1))
      do k = 1, size(fits)
         call fit_outputs(surrogate, outputs(:, first_of(k):first_of(k + 1) - 1), fits(k))
      end do
      do case_number = 1, size(plain, 3)
         if (.not. allocated(pool%draws(case_number)%x)) cycle
         call prepare_law(pool, case_number, surrogate, law, error)
         if (allocated(error)) return
         call prepare_thin_points(surrogate, law)
         call estimate_case(spectra(:, :, case_number), integrals(:, case_number))
      end do

   contains

      !> First frequency of a group.
      pure integer function first_of(k)
         integer, intent(in) :: k

         first_of = min(1 + (k - 1)*together, size(outputs, 2) + 1)
      end function first_of

      !> Estimates the spectra and the integrals of the current case.
      subroutine estimate_case(spectrum, integral)
         type(statistic_type), intent(inout) :: spectrum(:, :)   !! (frequency, statistic)
         type(statistic_type), intent(inout) :: integral(:)      !! (statistic)
         type(integral_type) :: sums(size(spectrum, 2))          ! (statistic)
         type(estimates_type) :: fitted(size(share_below))       ! (percentile)
         integer, allocatable :: ranking(:, :)   ! (rank, frequency of the group) samples
         !> influences of the points on the regression's share of the integrals, and of the
         !> logarithm of the band ratio
         real(wp) :: point_influence(size(law%weight), size(integral))
         real(wp) :: point_error(size(integral)), sides(2)
         integer :: f, first, k, last, n, s

         sums%value = step*sum(plain(size(outputs, 2) + 1:, :, case_number)%value, 1)
         call reallocate(values, size(law%weight), together)
         call reallocate(averaged, size(law%weight), together)
         point_influence = 0.0_wp
         do k = 1, size(fits)
            first = first_of(k)
            last = first_of(k + 1) - 1
            n = last - first + 1
            call predict(fits(k), law%rows, values(:, :n))
            call estimate_means(k, spectrum(first:last, 1), sums(1), point_influence(:, 1))
            allocate (ranking(law%last - law%first + 1, n))
            do f = 1, n
               ranking(:, f) = sort_order(outputs(law%first:law%last, first + f - 1))
            end do
            call law_percentiles(surrogate, fits(k), law, values(:, :n), share_below, fitted)
            do s = 2, size(sums)
               call estimate_percentiles(k, s, ranking, fitted(s - 1), spectrum(first:last, s), &
                                         sums(s), point_influence(:, s))
            end do
            do f = first, last
               call sort_percentiles(spectrum(f, 2:size(sums)))
            end do
            if (.not. law%has_samples) &
               spectrum(first:last, :)%ratio = &
                  spread(extrapolation_of(law, surrogate, fits(k)), 2, size(sums))
            do s = 2, size(sums)
               sums(s)%value = sums(s)%value + step*sum(spectrum(first:last, s)%value)
            end do
            deallocate (ranking)
         end do
         n = size(sums)
         point_influence(:, n + 1) = point_influence(:, n)/sums(n)%value &
                                     - point_influence(:, 2)/sums(2)%value
         call error_of_points(law, point_influence, point_error)
         do s = 1, n
            integral(s)%value = sums(s)%value
            call state_error(point_error(s), law%n_samples, sums(s)%influence, sums(s)%bias, &
                             sums(s)%plain_influence, 1.0_wp, integral(s)%error, integral(s)%ratio)
            sides = integral(s)%error*stretch_of(sums(s))
            integral(s)%error = sides(2)
            ! the longer side of the interval of a percentile's logarithm
            if (s > 1) integral(s)%error = max(downward_error(sums(s)%value, sides(1)), &
                                               upward_error(sums(s)%value, sides(2)))
         end do
         call find_ratio(point_error(n + 1), sums(2), sums(n), integral(n + 1))
         if (law%has_samples) return
         integral(:n)%ratio = sum(spectrum%value*spectrum%ratio, 1)/sum(spectrum%value, 1)
         integral(n + 1)%ratio = max(integral(2)%ratio, integral(n)%ratio)
      end subroutine estimate_case

      !> Estimates the mean spectrum of the current case in group k.
      subroutine estimate_means(k, best, integral, point_influence)
         integer, intent(in) :: k
         type(statistic_type), intent(inout) :: best(:)      !! (frequency) of group k
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: point_influence(:)       !! on the integral
         type(estimates_type) :: fitted, sampled, blended
         integer :: first, last, n, o

         n = size(best)
         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (own => density(law%first:law%last, first:last))
            sampled = over_all_samples(pool, case_number, plain_mean(own), &
                                       plain(first:last, 1, case_number)%value)
            do o = 1, n
               associate (logarithm => outputs(:, first + o - 1))
                  averaged(:, o) = min(values(:, o), maxval(logarithm) &
                                       + beyond*(maxval(logarithm) - minval(logarithm)))
               end associate
               call exponentiate(averaged(:, o))
            end do
            call law_mean_of_exponential(surrogate, fits(k), law, averaged(:, :n), own, fitted)
         end associate
         call combine(law, averaged(:, :n), fitted, sampled, [(0.0_wp, o=1, n)], blended)
         do o = 1, n
            point_influence = point_influence + (step*(1.0_wp - blended%share(o)))*averaged(:, o)
         end do
         best = nonnegative_statistic(blended%value, blended%error, blended%ratio)
         allocate (blended%stretch(2, n), source=1.0_wp)
         where (blended%error > 0.0_wp) blended%stretch(2, :) = best%error/blended%error
         call add_frequencies(integral, blended, sampled, [(step, o=1, n)], [(step, o=1, n)])
         integral%value = integral%value + step*sum(blended%value)
      end subroutine estimate_means

      !> Blends one percentile of the spectrum of the current case in group k.
      subroutine estimate_percentiles(k, s, ranking, fitted, best, integral, point_influence)
         integer, intent(in) :: k, s                         !! group, statistic
         integer, intent(in) :: ranking(:, :)                !! as in estimate_case
         type(estimates_type), intent(in) :: fitted          !! by the regression
         type(statistic_type), intent(inout) :: best(:)      !! (frequency) of group k
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: point_influence(:)       !! on the integral
         type(estimates_type) :: sampled, blended
         integer :: first, last, n, o

         n = size(best)
         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (p => share_below(s - 1), own => outputs(law%first:law%last, first:last), &
                    residual => fits(k)%residual(law%first:law%last, :))
            sampled = over_all_samples(pool, case_number, plain_percentile(own, p, ranking), &
                                       log(max(plain(first:last, s, case_number)%value, &
                                               least_density)))
            do o = 1, n   ! leaving a point out moves a percentile by 1/density
               averaged(:, o) = merge(-fitted%inverse_density(o), 0.0_wp, &
                                      values(:, o) <= fitted%value(o))
            end do
            call combine(law, averaged(:, :n), fitted, sampled, &
                         least_plain_share(residual, own), blended)
         end associate
         best%value = exp(blended%value)
         best%low = exp(blended%value - normal_95*blended%error*blended%stretch(1, :))
         best%high = exp(blended%value + normal_95*blended%error*blended%stretch(2, :))
         best%ratio = blended%ratio
         do o = 1, n
            point_influence = point_influence &
                              + (step*best(o)%value*(1.0_wp - blended%share(o)))*averaged(:, o)
         end do
         call add_frequencies(integral, blended, sampled, step*best%value, step*exp(sampled%value))
      end subroutine estimate_percentiles

      !> Computes the ratio of the last percentile's integral to the first one's; errors are those
      !> of its logarithm.
      pure subroutine find_ratio(point_error, bottom, top, best)
         real(wp), intent(in) :: point_error   !! standard error by the points
         type(integral_type), intent(in) :: bottom, top
         type(statistic_type), intent(out) :: best
         real(wp) :: bottom_error, error, sides(2), top_error

         call state_error(point_error, law%n_samples, &
                          top%influence/top%value - bottom%influence/bottom%value, &
                          top%bias/top%value - bottom%bias/bottom%value, &
                          top%plain_influence/top%value - bottom%plain_influence/bottom%value, &
                          1.0_wp, error, best%ratio)
         best%value = top%value/bottom%value
         top_error = norm2(top%influence)/top%value
         bottom_error = norm2(bottom%influence)/bottom%value
         sides = stretch_of(bottom)
         sides = (top_error*stretch_of(top) + bottom_error*sides(2:1:-1)) &
                 /max(top_error + bottom_error, tiny(error))
         best%low = max(1.0_wp, best%value*exp(-normal_95*error*sides(1)))
         best%high = best%value*exp(normal_95*error*sides(2))
      end subroutine find_ratio

   end subroutine estimate_spectrum

   !> Mean stretch over the frequencies of an integral, weighted by their errors; 1 without errors.
   pure function stretch_of(integral) result(stretch)
      type(integral_type), intent(in) :: integral
      real(wp) :: stretch(2)   !! down, up

      stretch = 1.0_wp
      if (integral%error_sum > 0.0_wp) stretch = integral%stretched_sum/integral%error_sum
   end function stretch_of

   !> Number of the frequency above which there is 1e-4 of the power.
   pure integer function last_powerful(mean)
      real(wp), intent(in) :: mean(:)   !! (frequency) mean density
      real(wp) :: above, total

      total = sum(mean)
      above = 0.0_wp
      do last_powerful = size(mean), 2, -1
         above = above + mean(last_powerful)
         if (above > power_above*total) exit
      end do
   end function last_powerful

   !> Adds the biases and influences at some frequencies to those of an integral.
   subroutine add_frequencies(integral, blended, sampled, slope, plain_slope)
      type(integral_type), intent(inout) :: integral
      type(estimates_type), intent(in) :: blended, sampled
      real(wp), intent(in) :: slope(:)         !! (frequency) derivative of the integral by blended
      real(wp), intent(in) :: plain_slope(:)   !! (frequency) the same of plain sampling's
      real(wp) :: error(size(slope))
      integer :: o

      if (.not. allocated(integral%influence)) then
         allocate (integral%influence(size(blended%influence, 1)), source=0.0_wp)
         allocate (integral%plain_influence(size(sampled%influence, 1)), source=0.0_wp)
      end if
      integral%bias = integral%bias + dot_product(slope, blended%bias)
      integral%influence = integral%influence + matmul(blended%influence, slope)
      integral%plain_influence = integral%plain_influence + matmul(sampled%influence, plain_slope)
      error = [(slope(o)*norm2(blended%influence(:, o)), o=1, size(slope))]
      integral%error_sum = integral%error_sum + sum(error)
      integral%stretched_sum = integral%stretched_sum + matmul(blended%stretch, error)
   end subroutine add_frequencies

end module statistics_spectra
