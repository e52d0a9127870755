!> Best estimates of the statistics of numbers of the samples: slip fractions, slip distances,
!> dissipations, amplitudes.
module statistics_scalars
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_blend, only: join
   use statistics_estimates, only: estimates_type, inverse_density, plain_deviation, plain_mean, &
                                   plain_percentile, two_sided, upward_error
   use statistics_influences, only: view_law, view_type, width_of
   use statistics_kernel_choice, only: learn_kernel
   use statistics_law, only: choose_points, law_type, n_points
   use statistics_pool, only: among_all, pool_type, residual_share
   use statistics_regression, only: law_deviation, law_mean, law_percentile
   use statistics_sensitivity, only: find_sensitivity
   use statistics_surrogate, only: fit_outputs, fit_type, predict, surrogate_type
   implicit none(type, external)
   private
   public :: scalar_type, estimate_scalars

   real(wp), parameter :: right_angle = 2.0_wp*atan(1.0_wp)

   !> Errors are standard errors, low and high the ends of 95 % intervals; ratios are the errors of
   !> plain sampling over those of the estimates.
   type :: scalar_type
      real(wp) :: mean = 0.0_wp, mean_error = 0.0_wp, mean_ratio = 1.0_wp
      real(wp) :: deviation = 0.0_wp, deviation_error = 0.0_wp, deviation_ratio = 1.0_wp
      real(wp), allocatable :: percentile(:), low(:), high(:), percentile_ratio(:)
      real(wp), allocatable :: sensitivity(:), sensitivity_error(:)   !! (input)
   end type scalar_type

contains

   !> Estimates several numbers of the samples, amounts and fractions, none negative, for every
   !> case of a pool. For percentiles fits the root of an amount and the angle asin(sqrt(y)) of a
   !> fraction. Only the first number has sensitivities, the others zeros.
   subroutine estimate_scalars(pool, y, is_fraction, share_below, plain, estimates, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in), contiguous :: y(:, :)     !! (sample, number)
      logical, intent(in) :: is_fraction(:)           !! (number)
      real(wp), intent(in) :: share_below(:)          !! (percentile)
      !> (number, case) mean, deviation and percentiles over all samples of the case
      type(scalar_type), intent(in) :: plain(:, :)
      type(scalar_type), intent(out) :: estimates(:, :)   !! (number, case)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: bent(size(y, 1), size(y, 2))   ! (sample, number)
      type(surrogate_type) :: surrogate
      type(fit_type) :: fit, bent_fit
      type(law_type) :: law
      type(view_type) :: view
      integer :: case_number, number

      do number = 1, size(y, 2)
         bent(:, number) = bend(y(:, number), is_fraction(number))
      end do
      call learn_kernel(pool%x, reshape([y, bent], [size(y, 1), 2*size(y, 2)]), surrogate, error)
      if (allocated(error)) return
      call fit_outputs(surrogate, y, fit)
      call fit_outputs(surrogate, bent, bent_fit)
      do case_number = 1, size(plain, 2)
         call choose_points(pool%draws(case_number), surrogate%direction, n_points, law, error)
         if (allocated(error)) return
         call view_law(surrogate, law, pool%first(case_number), &
                       pool%first(case_number + 1) - 1, view)
         call estimate_moments(case_number, estimates(:, case_number))
         if (allocated(error)) return
         call estimate_percentiles(case_number, estimates(:, case_number))
         if (allocated(error)) return
      end do

   contains

      subroutine estimate_moments(case_number, best)
         integer, intent(in) :: case_number
         type(scalar_type), intent(inout) :: best(:)   !! (number)
         type(estimates_type) :: ours, theirs, both
         real(wp) :: values(size(law%weight), size(y, 2))
         integer :: i

         associate (own => y(view%first:view%last, :), n => pool%n_samples(case_number), &
                    sampled => plain(:, case_number))
            call predict(fit, view%rows, values)
            call law_mean(surrogate, fit, view, values, ours)
            theirs = among_all(pool, case_number, plain_mean(own), [sampled%mean])
            call join(law, values, n, ours, theirs, [(0.0_wp, i=1, size(best))], both, error)
            if (allocated(error)) return
            best%mean = both%value
            best%mean_error = upward_error(both%value, both%stated)
            best%mean_ratio = both%ratio
            call law_deviation(surrogate, fit, view, values, ours)
            theirs = among_all(pool, case_number, plain_deviation(own), [sampled%deviation])
            call find_sensitivity(surrogate, fit, view, law, values(:, 1), ours, &
                                  best(1)%sensitivity, best(1)%sensitivity_error, error)
            if (allocated(error)) return
            do i = 1, size(best)   ! the root of a mean of squares
               values(:, i) = (values(:, i) - dot_product(law%weight, values(:, i)))**2 &
                              /(2.0_wp*ours%value(i))
            end do
            call join(law, values, n, ours, theirs, &
                      residual_share(fit%residual(view%first:view%last, :), own), both, error)
            if (allocated(error)) return
            best%deviation = both%value
            best%deviation_error = upward_error(both%value, both%stated)
            best%deviation_ratio = both%ratio
            do i = 2, size(best)
               allocate (best(i)%sensitivity, best(i)%sensitivity_error, &
                         source=0.0_wp*best(1)%sensitivity)
            end do
         end associate
      end subroutine estimate_moments

      subroutine estimate_percentiles(case_number, best)
         integer, intent(in) :: case_number
         type(scalar_type), intent(inout) :: best(:)   !! (number)
         type(estimates_type) :: ours, theirs, both
         real(wp), dimension(size(law%weight), size(y, 2)) :: of_point, values
         real(wp) :: least(size(y, 2)), at_plain(size(y, 2)), ends(2), inverse
         real(wp) :: width(2, size(y, 2))
         integer :: i, n, p

         n = pool%n_samples(case_number)
         call predict(bent_fit, view%rows, values)
         values = max(0.0_wp, values)
         do i = 1, size(best)
            if (is_fraction(i)) values(:, i) = min(values(:, i), right_angle)
            width(:, i) = width_of(view, values(:, i), bent_fit%predicted(:, i))
            allocate (best(i)%percentile(size(share_below)))
            allocate (best(i)%low, best(i)%high, best(i)%percentile_ratio, mold=best(i)%percentile)
         end do
         least = residual_share(bent_fit%residual(view%first:view%last, :), &
                                bent(view%first:view%last, :))
         do p = 1, size(share_below)
            do i = 1, size(best)
               at_plain(i) = bend(plain(i, case_number)%percentile(p), is_fraction(i))
            end do
            call law_percentile(surrogate, bent_fit, view, values, width, share_below(p), ours)
            theirs = among_all(pool, case_number, plain_percentile(bent(view%first:view%last, :), &
                                                                   share_below(p)), at_plain)
            do i = 1, size(best)
               inverse = inverse_density(theirs%influence(:, i), n, share_below(p))
               of_point(:, i) = merge(-inverse, 0.0_wp, values(:, i) <= ours%value(i))
            end do
            call join(law, of_point, n, ours, theirs, least, both, error)
            if (allocated(error)) return
            do i = 1, size(best)
               best(i)%percentile_ratio(p) = both%ratio(i)
               best(i)%percentile(p) = unbend(both%value(i), is_fraction(i))
               ends = both%stated(i)*both%stretch(:, i)
               if (share_below(p) > 0.5_wp) ends(2) = upward_error(both%value(i), ends(2))
               ends = both%value(i) + two_sided*[-ends(1), ends(2)]
               best(i)%low(p) = unbend(ends(1), is_fraction(i))
               best(i)%high(p) = unbend(ends(2), is_fraction(i))
               if (may_be_zero(y(view%first:view%last, i), share_below(p))) best(i)%low(p) = 0.0_wp
            end do
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
