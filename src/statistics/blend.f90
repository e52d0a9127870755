!> Weighted means of a regression's estimates and plain sampling's, and their standard errors:
!> formulas (6), (8) and (9) of docs/regression.md.
module statistics_blend
   use core_kinds, only: wp
   use statistics_estimates, only: estimates_type, stated_error
   use statistics_influences, only: case_law_type
   use statistics_law, only: error_of_points
   implicit none(type, external)
   private
   public :: blend, combine, state_error

contains

   !> Blends the estimates of a regression with those of plain sampling and states their errors.
   !> A law without samples has the estimates of the regression alone, or the value that all samples
   !> of the pool have.
   subroutine combine(law, averaged, fitted, plain, least_share, blended)
      type(case_law_type), intent(in) :: law
      !> (point, output) function whose mean over the law is `fitted`, for its error by the points
      real(wp), intent(in), contiguous :: averaged(:, :)
      type(estimates_type), intent(in) :: fitted     !! estimates of the regression
      type(estimates_type), intent(inout) :: plain   !! returned with influences times tail factors
      real(wp), intent(in) :: least_share(:)         !! (output) least weight of plain sampling
      type(estimates_type), intent(out) :: blended
      real(wp) :: point_error(size(least_share))
      integer :: o

      call error_of_points(law, averaged, point_error)
      if (law%has_samples) then
         call blend(fitted, plain, law%first, law%last, least_share, blended)
      else
         blended = fitted
         blended%share = merge(0.0_wp, 1.0_wp, any(abs(plain%influence) > 0.0_wp, 1))
         where (blended%share > 0.0_wp) blended%value = plain%value
         if (allocated(plain%stretch)) &
            allocate (blended%stretch(2, size(least_share)), source=1.0_wp)
      end if
      allocate (blended%error(size(least_share)), blended%ratio(size(least_share)))
      do o = 1, size(least_share)
         if (allocated(blended%tail_factor)) then
            blended%influence(:, o) = blended%tail_factor(1, o)*blended%influence(:, o)
            plain%influence(:, o) = blended%tail_factor(2, o)*plain%influence(:, o)
         end if
         call state_error(point_error(o), law%n_samples, blended%influence(:, o), blended%bias(o), &
                          plain%influence(:, o), 1.0_wp - blended%share(o), blended%error(o), &
                          blended%ratio(o))
      end do
      if (allocated(plain%stretch) .or. .not. law%has_samples) return
      ! a blend of least variance is no worse than plain sampling, whose error has its tails too
      blended%error = blended%error*min(1.0_wp, blended%ratio)
      blended%ratio = max(1.0_wp, blended%ratio)
   end subroutine combine

   !> Blends estimates of a regression and of plain sampling by the weights of least variance, but
   !> at least `least_share` for plain sampling, and 1 where it has no error. Their covariance
   !> follows from their influences. Plain sampling has those of the case's samples alone, and may
   !> have more samples, at the end.
   pure subroutine blend(fitted, plain, first, last, least_share, blended)
      type(estimates_type), intent(in) :: fitted, plain
      integer, intent(in) :: first, last       !! samples of the case among those of the regression
      real(wp), intent(in) :: least_share(:)   !! (output) least weight of plain sampling
      type(estimates_type), intent(out) :: blended
      real(wp) :: share(size(least_share)), fit_variance, plain_variance, covariance, denominator
      integer :: n, n_more, n_own, o

      n = size(fitted%influence, 1)
      n_own = last - first + 1
      n_more = size(plain%influence, 1) - n_own
      allocate (blended%influence(n + n_more, size(least_share)))
      do o = 1, size(plain%value)
         associate (phi => fitted%influence(:, o), psi => plain%influence(:, o), &
                    influence => blended%influence(:, o))
            fit_variance = sum(phi**2) + fitted%bias(o)**2
            plain_variance = sum(psi**2) + plain%bias(o)**2
            covariance = dot_product(phi(first:last), psi(:n_own)) + fitted%bias(o)*plain%bias(o)
            denominator = max(fit_variance + plain_variance - 2.0_wp*covariance, tiny(covariance))
            share(o) = max(least_share(o), &
                           min(1.0_wp, max(0.0_wp, (fit_variance - covariance)/denominator)))
            if (.not. plain_variance > 0.0_wp) share(o) = 1.0_wp
            influence(:n) = (1.0_wp - share(o))*phi
            influence(first:last) = influence(first:last) + share(o)*psi(:n_own)
            influence(n + 1:) = share(o)*psi(n_own + 1:)
         end associate
      end do
      blended%share = share
      blended%value = (1.0_wp - share)*fitted%value + share*plain%value
      blended%bias = (1.0_wp - share)*fitted%bias + share*plain%bias
      if (allocated(plain%stretch)) &
         blended%stretch = 1.0_wp + spread(share, 1, 2)*(plain%stretch - 1.0_wp)
      if (allocated(fitted%tail_factor)) then
         blended%tail_factor = fitted%tail_factor
         associate (factor => blended%tail_factor)
            factor(1, :) = (1.0_wp - share)*factor(1, :) + share*factor(2, :)
         end associate
         if (n_more > 0) blended%tail_factor = 1.0_wp
      end if
   end subroutine blend

   !> Computes the standard error of an estimate, from its influences and the points of the law, and
   !> that of plain sampling over it.
   pure subroutine state_error(point_error, n_samples, influence, bias, plain_influence, share, &
                               error, ratio)
      real(wp), intent(in) :: point_error   !! standard error of the regression by the points
      integer, intent(in) :: n_samples
      real(wp), intent(in), contiguous :: influence(:)   !! (sample) on the estimate
      real(wp), intent(in) :: bias
      real(wp), intent(in), contiguous :: plain_influence(:)   !! (sample) on plain sampling's
      real(wp), intent(in) :: share                      !! weight of the regression
      real(wp), intent(out) :: error, ratio
      real(wp) :: plain_error

      plain_error = stated_error(plain_influence, 0.0_wp, n_samples)
      error = plain_error
      if (share > 0.0_wp) error = hypot(stated_error(influence, bias, n_samples), share*point_error)
      ratio = 1.0_wp
      if (error > 0.0_wp) ratio = plain_error/error
   end subroutine state_error

end module statistics_blend
