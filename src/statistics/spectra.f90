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
                                   plain_percentile, statistic_type, two_sided, uncross, &
                                   upward_error
   use statistics_influences, only: thin_view, view_law, view_type, width_of
   use statistics_kernel_choice, only: learn_kernel
   use statistics_law, only: choose_points, error_of_points, n_points
   use statistics_pool, only: among_all, pool_type, residual_share
   use statistics_regression, only: law_mean_of_exponential, law_percentile
   use statistics_surrogate, only: fit_outputs, fit_type, make_room, predict, surrogate_type
   implicit none(type, external)
   private
   public :: estimate_spectrum, last_powerful

   integer, parameter, public :: together = 128   !! frequencies
   integer, parameter :: choosing = 24        !! frequencies choose the kernel, or a few more
   real(wp), parameter :: share_above = 1.0e-4_wp   !! of the power, left to plain sampling
   real(wp), parameter :: least_density = 1.0e-290_wp   !! its logarithm is finite

   !> An integral over frequency, in the making.
   type :: integral_type
      real(wp) :: value = 0.0_wp, bias = 0.0_wp
      real(wp), allocatable :: influence(:), plain_influence(:)   !! (sample)
      real(wp) :: parts = 0.0_wp, stretched(2) = 0.0_wp   !! sums of parts' errors, times stretch
   end type integral_type

contains

   !> Estimates the spectra of one dof for every case of a pool, at the first frequencies; those
   !> above are plain sampling's in the integrals. A spectrum has the mean and the percentiles, the
   !> integrals of both are followed by the band ratio.
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
      real(wp), allocatable :: outputs(:, :), some(:, :)
      !> (point, frequency) of a part: G; exp(G), then influences of points on a percentile
      real(wp), allocatable :: values(:, :), grown(:, :)
      type(surrogate_type) :: surrogate
      type(fit_type), allocatable :: fits(:)
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
      do number = 1, size(plain, 3)
         call choose_points(pool%draws(number), surrogate%direction, n_points, view%law_type, &
                            error)
         if (allocated(error)) return
         call view_law(surrogate, pool%first(number), pool%first(number + 1) - 1, view)
         call thin_view(surrogate, view)
         call estimate_case(number, spectra(:, :, number), integrals(:, number))
      end do

   contains

      !> First frequency of a part.
      pure integer function first_of(k)
         integer, intent(in) :: k

         first_of = min(1 + (k - 1)*together, size(outputs, 2) + 1)
      end function first_of

      subroutine estimate_case(number, spectrum, integral)
         integer, intent(in) :: number
         type(statistic_type), intent(inout) :: spectrum(:, :)   !! (frequency, statistic)
         type(statistic_type), intent(inout) :: integral(:)      !! (statistic)
         type(integral_type) :: sums(size(spectrum, 2))          ! (statistic)
         integer, allocatable :: ranking(:, :)   ! (rank, frequency) the case's samples
         real(wp), allocatable :: width(:, :)    ! (2, frequency) of G
         !> of exp(G) at each point; influences of each point on those of percentiles, and on the
         !> logarithm of the last one's over the first one's
         real(wp) :: power(size(view%weight), size(integral))
         real(wp) :: of_points(size(integral)), reach(2)
         integer :: f, first, k, last, n, s

         sums%value = step*sum(plain(size(outputs, 2) + 1:, :, number)%value, 1)
         call make_room(values, size(view%weight), together)
         call make_room(grown, size(view%weight), together)
         power = 0.0_wp
         do k = 1, size(fits)
            first = first_of(k)
            last = first_of(k + 1) - 1
            n = last - first + 1
            call predict(fits(k), view%rows, values(:, :n))
            call estimate_means(number, k, spectrum(first:last, 1), sums(1), power(:, 1))
            if (allocated(error)) return
            allocate (ranking(view%last - view%first + 1, n), width(2, n))
            do f = 1, n
               width(:, f) = width_of(view, values(:, f), fits(k)%predicted(:, f))
               ranking(:, f) = sort_order(outputs(view%first:view%last, first + f - 1))
            end do
            do s = 2, size(sums)
               call estimate_percentiles(number, k, s, ranking, width, spectrum(first:last, s), &
                                         sums(s), power(:, s))
               if (allocated(error)) return
            end do
            do f = first, last
               call uncross(spectrum(f, 2:size(sums)))
            end do
            do s = 2, size(sums)
               sums(s)%value = sums(s)%value + step*sum(spectrum(first:last, s)%value)
            end do
            deallocate (ranking, width)
         end do
         n = size(sums)
         power(:, n + 1) = power(:, n)/sums(n)%value - power(:, 2)/sums(2)%value
         call error_of_points(view, power, of_points, error)
         if (allocated(error)) return
         do s = 1, n   ! of percentiles the longer side of the logarithm's interval
            integral(s)%value = sums(s)%value
            call state_error(of_points(s), pool%n_samples(number), sums(s)%influence, &
                             sums(s)%bias, sums(s)%plain_influence, 1.0_wp, integral(s)%error, &
                             integral(s)%ratio)
            reach = integral(s)%error*stretch_of(sums(s))
            integral(s)%error = reach(2)
            if (s > 1) integral(s)%error = max(downward_error(sums(s)%value, reach(1)), &
                                               upward_error(sums(s)%value, reach(2)))
         end do
         call find_ratio(number, of_points(n + 1), sums(2), sums(n), integral(n + 1))
      end subroutine estimate_case

      subroutine estimate_means(number, k, best, integral, power)
         integer, intent(in) :: number, k
         type(statistic_type), intent(inout) :: best(:)      !! (frequency) of part k
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: power(:)   !! (point) of the regression's share
         type(estimates_type) :: ours, theirs, both
         integer :: first, last, n, o

         n = size(best)
         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (own => density(view%first:view%last, first:last))
            theirs = among_all(pool, number, plain_mean(own), plain(first:last, 1, number)%value)
            do o = 1, n
               grown(:, o) = values(:, o)
               call exponentiate(grown(:, o))
            end do
            call law_mean_of_exponential(surrogate, fits(k), view, grown(:, :n), own, ours)
         end associate
         call join(view, grown(:, :n), pool%n_samples(number), ours, theirs, &
                   [(0.0_wp, o=1, n)], both, error)
         if (allocated(error)) return
         do o = 1, n
            power = power + (step*(1.0_wp - both%share(o)))*grown(:, o)
         end do
         best%value = both%value
         best%error = upward_error(both%value, both%stated)
         best%ratio = both%ratio
         allocate (both%stretch(2, n), source=1.0_wp)
         where (both%stated > 0.0_wp) both%stretch(2, :) = best%error/both%stated
         call add_to(integral, both, theirs, [(step, o=1, n)], [(step, o=1, n)])
         integral%value = integral%value + step*sum(both%value)
      end subroutine estimate_means

      subroutine estimate_percentiles(number, k, s, ranking, width, best, integral, power)
         integer, intent(in) :: number, k, ranking(:, :)
         integer, intent(in) :: s                            !! statistic
         real(wp), intent(in) :: width(:, :)
         type(statistic_type), intent(inout) :: best(:)      !! (frequency) of part k
         type(integral_type), intent(inout) :: integral
         real(wp), intent(inout) :: power(:)   !! (point) influence of the regression's share
         type(estimates_type) :: ours, theirs, both
         real(wp) :: reach
         integer :: first, last, n, o

         n = size(best)
         first = first_of(k)
         last = first_of(k + 1) - 1
         associate (n_samples => pool%n_samples(number), p => share_below(s - 1))
            associate (own => outputs(view%first:view%last, first:last))
               theirs = among_all(pool, number, plain_percentile(own, p, ranking), &
                                  log(max(plain(first:last, s, number)%value, least_density)))
               call law_percentile(surrogate, fits(k), view, values(:, :n), width, p, ours)
               do o = 1, n   ! leaving a point out moves a percentile by 1/density
                  reach = inverse_density(theirs%influence(:, o), n_samples, p)
                  grown(:, o) = merge(-reach, 0.0_wp, values(:, o) <= ours%value(o))
               end do
               call join(view, grown(:, :n), n_samples, ours, theirs, &
                         residual_share(fits(k)%residual(view%first:view%last, :), own), both, &
                         error)
               if (allocated(error)) return
            end associate
         end associate
         do o = 1, n
            power = power + (step*exp(both%value(o))*(1.0_wp - both%share(o)))*grown(:, o)
         end do
         best%value = exp(both%value)
         best%low = exp(both%value - two_sided*both%stated*both%stretch(1, :))
         best%high = exp(both%value + two_sided*both%stated*both%stretch(2, :))
         best%ratio = both%ratio
         call add_to(integral, both, theirs, step*best%value, step*exp(theirs%value))
      end subroutine estimate_percentiles

      !> Computes the ratio of the last percentile's integral to the first one's; errors are those
      !> of its logarithm.
      pure subroutine find_ratio(number, of_points, bottom, top, best)
         integer, intent(in) :: number
         real(wp), intent(in) :: of_points   !! standard error that they leave
         type(integral_type), intent(in) :: bottom, top
         type(statistic_type), intent(out) :: best
         real(wp) :: of_plain(size(top%plain_influence)), ends(2), of_bottom, of_top, stated

         of_plain = top%plain_influence/top%value - bottom%plain_influence/bottom%value
         call state_error(of_points, pool%n_samples(number), &
                          top%influence/top%value - bottom%influence/bottom%value, &
                          top%bias/top%value - bottom%bias/bottom%value, of_plain, 1.0_wp, stated, &
                          best%ratio)
         best%value = top%value/bottom%value
         of_top = norm2(top%influence)/top%value
         of_bottom = norm2(bottom%influence)/bottom%value
         ends = stretch_of(bottom)
         ends = (of_top*stretch_of(top) + of_bottom*ends(2:1:-1)) &
                /max(of_top + of_bottom, tiny(stated))
         best%low = best%value*exp(-two_sided*stated*ends(1))
         best%high = best%value*exp(two_sided*stated*ends(2))
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
