!> Best estimates of the statistics of numbers of the samples: slip fractions, slip distances,
!> dissipations, amplitudes.
module statistics_scalars
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_blend, only: join
   use statistics_estimates, only: estimates_type, inverse_density, plain_deviation, plain_mean, &
                                   plain_percentile, statistic_type, two_sided, uncross, &
                                   upward_error
   use statistics_influences, only: view_law, view_type, width_of
   use statistics_kernel_choice, only: learn_kernel
   use statistics_law, only: choose_points, n_points
   use statistics_pool, only: among_all, pool_type, residual_share
   use statistics_regression, only: law_deviation, law_mean, law_percentile
   use statistics_sensitivity, only: find_sensitivity
   use statistics_surrogate, only: fit_outputs, fit_type, predict, surrogate_type
   implicit none(type, external)
   private
   public :: estimate_scalars

   real(wp), parameter :: right_angle = 2.0_wp*atan(1.0_wp)

contains

   !> Estimates several numbers of the samples, amounts and fractions, none negative, for every
   !> case of a pool. For percentiles fits the root of an amount and the angle asin(sqrt(y)) of a
   !> fraction. A table of statistics has the mean, the percentiles, and the standard deviation.
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
      real(wp) :: bent(size(y, 1), size(y, 2))   ! (sample, number)
      type(surrogate_type) :: surrogate
      type(fit_type) :: fit, bent_fit
      type(view_type) :: view
      integer :: case_number, number

      do number = 1, size(y, 2)
         bent(:, number) = bend(y(:, number), is_fraction(number))
      end do
      call learn_kernel(pool%x, reshape([y, bent], [size(y, 1), 2*size(y, 2)]), surrogate, error)
      if (allocated(error)) return
      call fit_outputs(surrogate, y, fit)
      call fit_outputs(surrogate, bent, bent_fit)
      do case_number = 1, size(plain, 3)
         call choose_points(pool%draws(case_number), surrogate%direction, n_points, &
                            view%law_type, error)
         if (allocated(error)) return
         call view_law(surrogate, pool%first(case_number), pool%first(case_number + 1) - 1, view)
         call estimate_moments(case_number, estimates(:, :, case_number))
         if (allocated(error)) return
         call estimate_percentiles(case_number, estimates(:, :, case_number))
         if (allocated(error)) return
      end do

   contains

      subroutine estimate_moments(case_number, best)
         integer, intent(in) :: case_number
         type(statistic_type), intent(inout) :: best(:, :)   !! (number, statistic)
         type(estimates_type) :: ours, theirs, both
         real(wp) :: values(size(view%weight), size(y, 2))
         integer :: i

         associate (own => y(view%first:view%last, :), n => pool%n_samples(case_number), &
                    sampled => plain(:, :, case_number), last => size(plain, 2))
            call predict(fit, view%rows, values)
            call law_mean(surrogate, fit, view, values, ours)
            theirs = among_all(pool, case_number, plain_mean(own), sampled(:, 1)%value)
            call join(view, values, n, ours, theirs, [(0.0_wp, i=1, size(y, 2))], both, error)
            if (allocated(error)) return
            best(:, 1)%value = both%value
            best(:, 1)%error = upward_error(both%value, both%stated)
            best(:, 1)%ratio = both%ratio
            call law_deviation(surrogate, fit, view, values, ours)
            theirs = among_all(pool, case_number, plain_deviation(own), &
                               sampled(:, last)%value)
            call find_sensitivity(surrogate, fit, view, values(:, 1), ours, &
                                  sensitivity(:, case_number), error)
            if (allocated(error)) return
            do i = 1, size(y, 2)   ! the root of a mean of squares
               values(:, i) = (values(:, i) - dot_product(view%weight, values(:, i)))**2 &
                              /(2.0_wp*ours%value(i))
            end do
            call join(view, values, n, ours, theirs, &
                      residual_share(fit%residual(view%first:view%last, :), own), both, error)
            if (allocated(error)) return
            best(:, last)%value = both%value
            best(:, last)%error = upward_error(both%value, both%stated)
            best(:, last)%ratio = both%ratio
         end associate
      end subroutine estimate_moments

      subroutine estimate_percentiles(case_number, best)
         integer, intent(in) :: case_number
         type(statistic_type), intent(inout) :: best(:, :)   !! (number, statistic)
         type(estimates_type) :: ours, theirs, both
         real(wp), dimension(size(view%weight), size(y, 2)) :: of_point, values
         real(wp) :: least(size(y, 2)), ends(2), inverse, width(2, size(y, 2))
         integer :: i, n, p

         n = pool%n_samples(case_number)
         call predict(bent_fit, view%rows, values)
         values = max(0.0_wp, values)
         do i = 1, size(y, 2)
            if (is_fraction(i)) values(:, i) = min(values(:, i), right_angle)
            width(:, i) = width_of(view, values(:, i), bent_fit%predicted(:, i))
         end do
         least = residual_share(bent_fit%residual(view%first:view%last, :), &
                                bent(view%first:view%last, :))
         do p = 1, size(share_below)
            call law_percentile(surrogate, bent_fit, view, values, width, share_below(p), ours)
            theirs = among_all(pool, case_number, plain_percentile(bent(view%first:view%last, :), &
                                                                   share_below(p)), &
                               bend(plain(:, 1 + p, case_number)%value, is_fraction))
            do i = 1, size(y, 2)
               inverse = inverse_density(theirs%influence(:, i), n, share_below(p))
               of_point(:, i) = merge(-inverse, 0.0_wp, values(:, i) <= ours%value(i))
            end do
            call join(view, of_point, n, ours, theirs, least, both, error)
            if (allocated(error)) return
            do i = 1, size(y, 2)
               ends = both%stated(i)*both%stretch(:, i)
               if (share_below(p) > 0.5_wp) ends(2) = upward_error(both%value(i), ends(2))
               ends = unbend(both%value(i) + two_sided*[-ends(1), ends(2)], is_fraction(i))
               if (may_be_zero(y(view%first:view%last, i), share_below(p))) ends(1) = 0.0_wp
               best(i, 1 + p) = statistic_type(unbend(both%value(i), is_fraction(i)), &
                                               low=ends(1), high=ends(2), ratio=both%ratio(i))
            end do
         end do
         do i = 1, size(y, 2)
            call uncross(best(i, 2:1 + size(share_below)))
         end do
      end subroutine estimate_percentiles

   end subroutine estimate_scalars

   !> True if as many samples are zero as plain sampling's interval of a percentile leaves below it
   !> (binomial, two-sided 95 %), and more than one. The law may have a share p at zero then, where
   !> it ends; a continuous G is not there.
   pure logical function may_be_zero(y, p)
      real(wp), intent(in) :: y(:)   !! (sample), not negative
      real(wp), intent(in) :: p      !! share of the law below
      integer :: n, n_zero

      n = size(y)
      n_zero = count(.not. y > 0.0_wp)
      may_be_zero = n_zero > 1 .and. n_zero >= 1 + p*(n - 1) - two_sided*sqrt(p*(1.0_wp - p)*n)
   end function may_be_zero

   !> The angle of a fraction, the root of an amount.
   elemental real(wp) function bend(value, is_fraction)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_fraction

      bend = sqrt(value)
      if (is_fraction) bend = asin(min(bend, 1.0_wp))
   end function bend

   !> Value whose angle was taken.
   elemental real(wp) function unbend(value, is_fraction)
      real(wp), intent(in) :: value
      logical, intent(in) :: is_fraction

      unbend = max(0.0_wp, value)
      if (is_fraction) unbend = sin(min(unbend, right_angle))
      unbend = unbend**2
   end function unbend

end module statistics_scalars
