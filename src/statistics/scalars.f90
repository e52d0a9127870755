!> Best estimates of the statistics of one number per sample: a slip fraction, a slip distance, a
!> dissipation, an amplitude.
module statistics_scalars
   use core_error, only: error_type
   use core_kinds, only: wp
   use statistics_estimates, only: blend, estimates_type, plain_deviation, plain_mean, &
                                   plain_percentile, stated_error
   use statistics_law, only: choose_points, error_share, law_type, of_means, of_percentiles_along
   use statistics_pool, only: among_all, pool_type, residual_share
   use statistics_regression, only: law_deviation, law_mean, law_percentile, view_law, view_type
   use statistics_sensitivity, only: find_sensitivity
   use statistics_surrogate, only: fit_outputs, fit_type, learn_kernel, predict, surrogate_type
   implicit none(type, external)
   private
   public :: scalar_plain, scalar_type, estimate_scalar, scalar_from, scalar_values

   integer, parameter :: n_points = 4096   !! of a law
   real(wp), parameter :: two_sided = 1.959964_wp
   integer, parameter :: raw = 1, angle = 2   !! outputs that are fitted

   !> Plain statistics over all samples of a case.
   type :: scalar_plain
      real(wp) :: mean = 0.0_wp, deviation = 0.0_wp
      real(wp), allocatable :: percentile(:)
   end type scalar_plain

   !> Errors are standard errors, low and high the ends of 95 % intervals; ratios are the errors of
   !> plain sampling over those of the estimates.
   type :: scalar_type
      real(wp) :: mean = 0.0_wp, mean_error = 0.0_wp, mean_ratio = 1.0_wp
      real(wp) :: deviation = 0.0_wp, deviation_error = 0.0_wp, deviation_ratio = 1.0_wp
      real(wp), allocatable :: percentile(:), low(:), high(:), percentile_ratio(:)
      real(wp), allocatable :: sensitivity(:), sensitivity_error(:)   !! (input)
   end type scalar_type

contains

   !> Of every case of a pool. A fraction is fitted by its angle asin(sqrt(y)) too, for percentiles.
   subroutine estimate_scalar(pool, y, is_fraction, share_below, plain, estimates, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: y(:)                 !! (sample)
      logical, intent(in) :: is_fraction           !! all are between 0 and 1
      real(wp), intent(in) :: share_below(:)       !! (percentile)
      type(scalar_plain), intent(in) :: plain(:)   !! (case)
      type(scalar_type), intent(out) :: estimates(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: outputs(size(y), 2)
      type(surrogate_type) :: surrogate
      type(fit_type) :: fits(2)
      type(law_type) :: law
      type(view_type) :: view
      integer :: number

      outputs(:, raw) = y
      outputs(:, angle) = y
      if (is_fraction) outputs(:, angle) = asin(sqrt(y))
      call learn_kernel(pool%x, outputs, surrogate, error)
      if (allocated(error)) return
      call fit_outputs(surrogate, outputs(:, raw:raw), fits(raw))
      call fit_outputs(surrogate, outputs(:, angle:angle), fits(angle))
      do number = 1, size(plain)
         call choose_points(pool%draws(number), surrogate%direction, n_points, law, error)
         if (allocated(error)) return
         call view_law(surrogate, law, pool%first(number), pool%first(number + 1) - 1, view)
         call estimate_case(number)
      end do

   contains

      subroutine estimate_case(number)
         integer, intent(in) :: number
         type(estimates_type) :: ours, theirs, both
         real(wp) :: values(size(law%weight), 1), least(1), share(1)
         integer :: p

         associate (own => outputs(view%first:view%last, :), best => estimates(number), &
                    residual => fits(raw)%residual(view%first:view%last, :), &
                    n => pool%n_samples(number))
            call predict(fits(raw), view%feature, values)
            call law_mean(surrogate, fits(raw), view, ours)
            theirs = among_all(pool, number, plain_mean(own(:, :1)), [plain(number)%mean])
            call blend(ours, theirs, [0.0_wp], both, share)
            best%mean = both%value(1)
            call state_error(both, theirs, of_means, n, best%mean_error, best%mean_ratio)

            least = residual_share(residual, own(:, :1))
            call law_deviation(surrogate, fits(raw), view, values, ours)
            theirs = among_all(pool, number, plain_deviation(own(:, :1)), [plain(number)%deviation])
            call find_sensitivity(surrogate, fits(raw), view, law, values(:, 1), ours, &
                                  best%sensitivity, best%sensitivity_error, error)
            if (allocated(error)) return
            call blend(ours, theirs, least, both, share)
            best%deviation = both%value(1)
            call state_error(both, theirs, of_means, n, best%deviation_error, best%deviation_ratio)

            allocate (best%percentile(size(share_below)), best%low(size(share_below)), &
                      best%high(size(share_below)), best%percentile_ratio(size(share_below)))
            call predict(fits(angle), view%feature, values)
            if (is_fraction) values = max(0.0_wp, min(values, 2.0_wp*atan(1.0_wp)))
            least = residual_share(fits(angle)%residual(view%first:view%last, :), own(:, 2:))
            do p = 1, size(share_below)
               call estimate_percentile(number, p, values, least, best)
            end do
         end associate
      end subroutine estimate_case

      subroutine estimate_percentile(number, p, values, least, best)
         integer, intent(in) :: number, p
         real(wp), intent(in) :: values(:, :), least(:)
         type(scalar_type), intent(inout) :: best
         type(estimates_type) :: ours, theirs, both
         real(wp) :: share(1), at_plain, reach

         at_plain = plain(number)%percentile(p)
         if (is_fraction) at_plain = asin(sqrt(at_plain))
         call law_percentile(surrogate, fits(angle), view, values, share_below(p), ours)
         theirs = among_all(pool, number, plain_percentile(outputs(view%first:view%last, 2:), &
                                                           share_below(p)), [at_plain])
         call blend(ours, theirs, least, both, share)
         call state_error(both, theirs, of_percentiles_along, pool%n_samples(number), reach, &
                          best%percentile_ratio(p))
         best%percentile(p) = back(both%value(1))
         best%low(p) = back(both%value(1) - two_sided*reach)
         best%high(p) = back(both%value(1) + two_sided*reach)
      end subroutine estimate_percentile

      !> That of the regression and of the points of the law, and how much larger plain sampling's
      !> is.
      pure subroutine state_error(both, theirs, efficiency, n_samples, stated, ratio)
         type(estimates_type), intent(in) :: both, theirs
         real(wp), intent(in) :: efficiency
         integer, intent(in) :: n_samples
         real(wp), intent(out) :: stated, ratio
         real(wp) :: of_plain

         of_plain = stated_error(theirs%influence(:, 1), 0.0_wp, n_samples)
         stated = hypot(stated_error(both%influence(:, 1), both%bias(1), n_samples), &
                        of_plain*error_share(law, efficiency, n_samples))
         ratio = 1.0_wp
         if (stated > 0.0_wp) ratio = of_plain/stated
      end subroutine state_error

      pure real(wp) function back(value)
         real(wp), intent(in) :: value

         back = value
         if (is_fraction) back = sin(max(0.0_wp, min(value, 2.0_wp*atan(1.0_wp))))**2
      end function back

   end subroutine estimate_scalar

   !> All of an estimate as numbers, to travel between ranks.
   pure function scalar_values(estimate) result(values)
      type(scalar_type), intent(in) :: estimate
      real(wp), allocatable :: values(:)

      associate (it => estimate)
         values = [it%mean, it%mean_error, it%mean_ratio, it%deviation, it%deviation_error, &
                   it%deviation_ratio, it%percentile, it%low, it%high, it%percentile_ratio, &
                   it%sensitivity, it%sensitivity_error]
      end associate
   end function scalar_values

   !> The estimate that numbers are those of.
   pure function scalar_from(values, n_percentiles) result(estimate)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n_percentiles
      type(scalar_type) :: estimate
      integer :: n_inputs

      associate (it => estimate, np => n_percentiles)
         n_inputs = (size(values) - 6 - 4*np)/2
         it%mean = values(1)
         it%mean_error = values(2)
         it%mean_ratio = values(3)
         it%deviation = values(4)
         it%deviation_error = values(5)
         it%deviation_ratio = values(6)
         it%percentile = values(7:6 + np)
         it%low = values(7 + np:6 + 2*np)
         it%high = values(7 + 2*np:6 + 3*np)
         it%percentile_ratio = values(7 + 3*np:6 + 4*np)
         it%sensitivity = values(7 + 4*np:6 + 4*np + n_inputs)
         it%sensitivity_error = values(7 + 4*np + n_inputs:)
      end associate
   end function scalar_from

end module statistics_scalars
