!> Best estimates of the spectra of a case: mean and percentiles over the friction law at each
!> frequency that has power ((1) of docs/regression.md), their pseudo-variances, Eq. (46), and the
!> ratio of the outer percentiles'.
module statistics_spectra
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_elementary, only: exponentiate
   use numerics_sorting, only: sort_order
   use statistics_blend, only: join, state_error
   use statistics_estimates, only: downward_error, estimates_type, inverse_density, plain_mean, &
                                   plain_percentile, two_sided, upward_error
   use statistics_influences, only: thin_view, view_law, view_type, width_of
   use statistics_kernel_choice, only: learn_kernel
   use statistics_law, only: choose_points, error_of_points, law_type, n_points
   use statistics_pool, only: among_all, pool_type, residual_share
   use statistics_regression, only: law_mean_of_exponential, law_percentile
   use statistics_surrogate, only: fit_outputs, fit_type, make_room, predict, surrogate_type
   implicit none(type, external)
   private
   public :: spectrum_type, estimate_spectrum, last_powerful

   integer, parameter, public :: together = 128   !! frequencies
   integer, parameter :: choosing = 24        !! frequencies choose the kernel, or a few more
   real(wp), parameter :: share_above = 1.0e-4_wp   !! of the power, left to plain sampling
   real(wp), parameter :: least_density = 1.0e-290_wp   !! its logarithm is finite

   !> Errors are standard errors, low and high the ends of 95 % intervals; ratios are the errors of
   !> plain sampling over those of the estimates.
   type :: spectrum_type
      real(wp), allocatable :: mean(:), mean_error(:), mean_ratio(:)            !! (frequency)
      real(wp), allocatable :: percentile(:, :), low(:, :), high(:, :)          !! (frequency, p)
      real(wp), allocatable :: percentile_ratio(:, :)
      real(wp) :: variance_mean = 0.0_wp, variance_mean_error = 0.0_wp, variance_mean_ratio = 1.0_wp
      real(wp), allocatable :: variance(:), variance_error(:), variance_ratio(:)   !! (percentile)
      real(wp) :: ratio = 0.0_wp, ratio_low = 0.0_wp, ratio_high = 0.0_wp, ratio_ratio = 1.0_wp
   end type spectrum_type

   !> An integral over frequency, in the making.
   type :: integral_type
      real(wp) :: value = 0.0_wp, bias = 0.0_wp
      real(wp), allocatable :: influence(:), plain_influence(:)   !! (sample)
      real(wp) :: parts = 0.0_wp, stretched(2) = 0.0_wp   !! sums of parts' errors, times stretch
   end type integral_type

contains

   !> Estimates the spectra of one dof for every case of a pool, at the first frequencies; those
   !> above are plain sampling's in the integrals.
   subroutine estimate_spectrum(pool, density, step, share_below, plain, estimates, error)
      type(pool_type), intent(in) :: pool
      real(wp), intent(in) :: density(:, :)        !! (sample, frequency) up to last_powerful
      real(wp), intent(in) :: step                 !! between frequencies [Hz]
      real(wp), intent(in) :: share_below(:)       !! (percentile)
      type(spectrum_type), intent(in) :: plain(:)  !! (case) mean, percentiles over all its samples
      type(spectrum_type), intent(out) :: estimates(:)   !! (case)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: outputs(:, :), some(:, :)
      !> (point, frequency) of a part: G; exp(G), then influences of points on a percentile
      real(wp), allocatable :: values(:, :), grown(:, :)
      type(surrogate_type) :: surrogate
      type(fit_type), allocatable :: fits(:)
      type(law_type) :: law
      type(view_type) :: view
      integer :: k, number

      outputs = log(max(density, least_density))
      some = outputs(:, ::max(1, size(outputs, 2)/choosing))
      call learn_kernel(pool%x, some, surrogate, error)
      if (allocated(error)) return
      allocate (fits((size(outputs, 2) - 1)/together + 1))
      do k = 1, size(fits)
         call fit_outputs(surrogate, outputs(:, first_of(k):first_of(k + 1) - 1), fits(k))
      end do
      do number = 1, size(plain)
         call choose_points(pool%draws(number), surrogate%direction, n_points, law, error)
         if (allocated(error)) return
         call view_law(surrogate, law, pool%first(number), pool%first(number + 1) - 1, view)
         call thin_view(surrogate, law, view)
         call estimate_case(number, estimates(number))
      end do

   contains

      !> First frequency of a part.
      pure integer function first_of(k)
         integer, intent(in) :: k

         first_of = min(1 + (k - 1)*together, size(outputs, 2) + 1)
      end function first_of

      subroutine estimate_case(number, best)
         integer, intent(in) :: number
         type(spectrum_type), intent(inout) :: best
         type(integral_type) :: of_mean, of_percentile(size(share_below))
         integer, allocatable :: ranking(:, :)   ! (rank, frequency) the case's samples
         real(wp), allocatable :: width(:, :)    ! (2, frequency) of G
         !> of exp(G) at each point; influences of each point on those of percentiles, and on the
         !> logarithm of the last one's over the first one's
         real(wp) :: power(size(law%weight), 0:size(share_below) + 1)
         real(wp) :: of_points(0:size(share_below) + 1), reach(2)
         integer :: f, k, n, p

         n = size(outputs, 2)
         call start(best, n, size(share_below))
         of_mean%value = step*sum(plain(number)%mean(n + 1:))
         of_percentile%value = step*sum(plain(number)%percentile(n + 1:, :), 1)
         call make_room(values, size(law%weight), together)
         call make_room(grown, size(law%weight), together)
         power = 0.0_wp
         do k = 1, size(fits)
            n = first_of(k + 1) - first_of(k)
            call predict(fits(k), view%rows, values(:, :n))
            call estimate_means(number, k, n, best, of_mean, power(:, 0))
            if (allocated(error)) return
            allocate (ranking(view%last - view%first + 1, n), width(2, n))
            do f = 1, n
               width(:, f) = width_of(view, values(:, f), fits(k)%predicted(:, f))
               ranking(:, f) = sort_order(outputs(view%first:view%last, first_of(k) + f - 1))
            end do
            do p = 1, size(share_below)
               call estimate_percentiles(number, k, p, ranking, width, best, of_percentile(p), &
                                         power(:, p))
               if (allocated(error)) return
            end do
            deallocate (ranking, width)
         end do
         n = size(share_below)
         power(:, n + 1) = power(:, n)/of_percentile(n)%value - power(:, 1)/of_percentile(1)%value
         call error_of_points(law, power, of_points, error)
         if (allocated(error)) return
         call close_integral(number, of_points(0), of_mean, best%variance_mean, reach, &
                             best%variance_mean_ratio)
         best%variance_mean_error = reach(2)
         do p = 1, size(share_below)   ! the longer side of the logarithm's interval
            call close_integral(number, of_points(p), of_percentile(p), best%variance(p), reach, &
                                best%variance_ratio(p))
            best%variance_error(p) = max(downward_error(best%variance(p), reach(1)), &
                                         upward_error(best%variance(p), reach(2)))
         end do
         call find_ratio(number, of_points(n + 1), of_percentile(1), of_percentile(n), best)
      end subroutine estimate_case

      subroutine estimate_means(number, k, n, best, integral, power)
         integer, intent(in) :: number, k
         integer, intent(in) :: n   !! frequencies
         type(spectrum_type), intent(inout) :: best
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: power(:)   !! (point) of the regression's share
         type(estimates_type) :: ours, theirs, both
         integer :: first, last, o

         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (own => density(view%first:view%last, first:last))
            theirs = among_all(pool, number, plain_mean(own), plain(number)%mean(first:last))
            do o = 1, n
               grown(:, o) = values(:, o)
               call exponentiate(grown(:, o))
            end do
            call law_mean_of_exponential(surrogate, fits(k), view, grown(:, :n), own, ours)
         end associate
         call join(law, grown(:, :n), pool%n_samples(number), ours, theirs, &
                   [(0.0_wp, o=1, n)], both, error)
         if (allocated(error)) return
         do o = 1, n
            power = power + (step*(1.0_wp - both%share(o)))*grown(:, o)
         end do
         best%mean(first:last) = both%value
         best%mean_error(first:last) = upward_error(both%value, both%stated)
         best%mean_ratio(first:last) = both%ratio
         allocate (both%stretch(2, n), source=1.0_wp)
         where (both%stated > 0.0_wp) both%stretch(2, :) = best%mean_error(first:last)/both%stated
         call add_to(integral, both, theirs, [(step, o=1, n)], [(step, o=1, n)])
         integral%value = integral%value + step*sum(both%value)
      end subroutine estimate_means

      subroutine estimate_percentiles(number, k, p, ranking, width, best, integral, power)
         integer, intent(in) :: number, k, p, ranking(:, :)
         real(wp), intent(in) :: width(:, :)
         type(spectrum_type), intent(inout) :: best
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: power(:)   !! (point) influence of the regression's share
         type(estimates_type) :: ours, theirs, both
         real(wp) :: reach
         integer :: first, last, n, o

         n = size(ranking, 2)
         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (n_samples => pool%n_samples(number))
            associate (own => outputs(view%first:view%last, first:last))
               theirs = among_all(pool, number, plain_percentile(own, share_below(p), ranking), &
                                  log(max(plain(number)%percentile(first:last, p), least_density)))
               call law_percentile(surrogate, fits(k), view, values(:, :n), width, share_below(p), &
                                   ours)
               do o = 1, n   ! leaving a point out moves a percentile by 1/density
                  reach = inverse_density(theirs%influence(:, o), n_samples, share_below(p))
                  grown(:, o) = merge(-reach, 0.0_wp, values(:, o) <= ours%value(o))
               end do
               call join(law, grown(:, :n), n_samples, ours, theirs, &
                         residual_share(fits(k)%residual(view%first:view%last, :), own), both, &
                         error)
               if (allocated(error)) return
            end associate
            do o = 1, n
               power = power + (step*exp(both%value(o))*(1.0_wp - both%share(o)))*grown(:, o)
            end do
            best%percentile(first:last, p) = exp(both%value)
            best%low(first:last, p) = exp(both%value - two_sided*both%stated*both%stretch(1, :))
            best%high(first:last, p) = exp(both%value + two_sided*both%stated*both%stretch(2, :))
            best%percentile_ratio(first:last, p) = both%ratio
         end associate
         call add_to(integral, both, theirs, step*exp(both%value), step*exp(theirs%value))
         integral%value = integral%value + step*sum(exp(both%value))
      end subroutine estimate_percentiles

      !> Computes the value of an integral, the errors whose 1.96 its interval reaches down and up,
      !> and its ratio of errors.
      pure subroutine close_integral(number, of_points, integral, value, reach, ratio)
         integer, intent(in) :: number
         real(wp), intent(in) :: of_points   !! standard error that they leave
         type(integral_type), intent(in) :: integral
         real(wp), intent(out) :: value, reach(2), ratio
         real(wp) :: stated

         value = integral%value
         call state_error(of_points, pool%n_samples(number), integral%influence, &
                          integral%bias, integral%plain_influence, 1.0_wp, stated, ratio)
         reach = stated*stretch_of(integral)
      end subroutine close_integral

      !> Computes the ratio of the last percentile's integral to the first one's; errors are those
      !> of its logarithm.
      pure subroutine find_ratio(number, of_points, bottom, top, best)
         integer, intent(in) :: number
         real(wp), intent(in) :: of_points   !! standard error that they leave
         type(integral_type), intent(in) :: bottom, top
         type(spectrum_type), intent(inout) :: best
         real(wp) :: of_plain(size(top%plain_influence)), ends(2), of_bottom, of_top, stated

         of_plain = top%plain_influence/top%value - bottom%plain_influence/bottom%value
         call state_error(of_points, pool%n_samples(number), &
                          top%influence/top%value - bottom%influence/bottom%value, &
                          top%bias/top%value - bottom%bias/bottom%value, of_plain, 1.0_wp, stated, &
                          best%ratio_ratio)
         best%ratio = top%value/bottom%value
         of_top = norm2(top%influence)/top%value
         of_bottom = norm2(bottom%influence)/bottom%value
         ends = stretch_of(bottom)
         ends = (of_top*stretch_of(top) + of_bottom*ends(2:1:-1)) &
                /max(of_top + of_bottom, tiny(stated))
         best%ratio_low = best%ratio*exp(-two_sided*stated*ends(1))
         best%ratio_high = best%ratio*exp(two_sided*stated*ends(2))
      end subroutine find_ratio

   end subroutine estimate_spectrum

   !> Mean stretch of the parts of an integral; 1 where they have none.
   pure function stretch_of(integral) result(stretch)
      type(integral_type), intent(in) :: integral
      real(wp) :: stretch(2)   !! down, up

      stretch = 1.0_wp
      if (integral%parts > 0.0_wp) stretch = integral%stretched/integral%parts
   end function stretch_of

   !> The frequency above which there is 1e-4 of the power.
   pure integer function last_powerful(mean)
      real(wp), intent(in) :: mean(:)   !! (frequency)
      real(wp) :: above, total

      total = sum(mean)
      above = 0.0_wp
      do last_powerful = size(mean), 2, -1
         above = above + mean(last_powerful)
         if (above > share_above*total) exit
      end do
   end function last_powerful

   pure subroutine start(best, n_frequencies, n_percentiles)
      type(spectrum_type), intent(inout) :: best
      integer, intent(in) :: n_frequencies, n_percentiles

      allocate (best%mean(n_frequencies), best%mean_error(n_frequencies), &
                best%mean_ratio(n_frequencies))
      allocate (best%percentile(n_frequencies, n_percentiles))
      allocate (best%low, best%high, best%percentile_ratio, mold=best%percentile)
      allocate (best%variance(n_percentiles), best%variance_error(n_percentiles), &
                best%variance_ratio(n_percentiles))
   end subroutine start

   !> Adds the estimates at some frequencies to an integral, by its slopes.
   subroutine add_to(integral, both, plain, slope, plain_slope)
      type(integral_type), intent(inout) :: integral
      type(estimates_type), intent(in) :: both, plain
      real(wp), intent(in) :: slope(:), plain_slope(:)   !! (output) of the integral
      real(wp) :: part(size(slope))   ! error
      integer :: o

      if (.not. allocated(integral%influence)) then
         allocate (integral%influence(size(both%influence, 1)), source=0.0_wp)
         allocate (integral%plain_influence, source=integral%influence)
      end if
      integral%bias = integral%bias + dot_product(slope, both%bias)
      integral%influence = integral%influence + matmul(both%influence, slope)
      integral%plain_influence = integral%plain_influence + matmul(plain%influence, plain_slope)
      part = [(slope(o)*norm2(both%influence(:, o)), o=1, size(slope))]
      integral%parts = integral%parts + sum(part)
      integral%stretched = integral%stretched + matmul(both%stretch, part)
   end subroutine add_to

end module statistics_spectra
